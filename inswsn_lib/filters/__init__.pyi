from .distributed import (
    handover_weights as handover_weights,
    patterns_of as patterns_of,
    run_distributed as run_distributed,
)
from .expected_ratio import (
    MISFIT as MISFIT,
    ErrorStatistics as ErrorStatistics,
    lasting_ratio as lasting_ratio,
    likely_interval as likely_interval,
)
from .federated import federated_covariance as federated_covariance, run_federated as run_federated
from .hinfinity import (
    deadbeat_gain as deadbeat_gain,
    run_hinfinity as run_hinfinity,
    run_switched as run_switched,
)
from .intersection import intersect as intersect, run_fused_locals as run_fused_locals
from .kalman import (
    KalmanDesign as KalmanDesign,
    design_kalman as design_kalman,
    predictor_gain as predictor_gain,
    run_kalman as run_kalman,
    steady_error as steady_error,
    stream_kalman as stream_kalman,
)
from .robust import adaptive as adaptive, gating as gating, huber as huber, run_robust as run_robust
from .schmidt import run_schmidt as run_schmidt
