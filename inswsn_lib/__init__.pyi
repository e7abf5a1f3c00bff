# The front door: what an engineer needs, by what it is for. Names are imported when first used.

# Rooms
from . import (
    inertial as inertial,
    evaluation as evaluation,
    filters as filters,
    learning as learning,
    lmi as lmi,
    logs as logs,
    navigation as navigation,
    papers as papers,
    plotting as plotting,
    simulation as simulation,
    vehicle as vehicle,
)

# Describe how an error moves and is measured
from .models import ErrorModel as ErrorModel

# Read a recording or a scenario
from .files import data_file as data_file
from .logs import (
    TrackPair as TrackPair,
    check_recording as check_recording,
    read_recording as read_recording,
)
from .scenario import (
    Setting as Setting,
    from_settings as from_settings,
    load_scenario as load_scenario,
    with_values as with_values,
)

# Read recorded data as they were logged, and follow them
from .streams import (
    Fixes as Fixes,
    Imu as Imu,
    Odometry as Odometry,
    Ranges as Ranges,
    Recording as Recording,
    Reference as Reference,
    Stream as Stream,
)
from .inertial import (
    align as align,
    run_error_state as run_error_state,
    smooth as smooth,
    smooth_with_lag as smooth_with_lag,
)
from .logs import (
    calibrate as calibrate,
    imu_clock as imu_clock,
    multilaterate_track as multilaterate_track,
    slope_velocity as slope_velocity,
)

# Run a filter: a model or a design and measurements (steps, outputs) give estimates
from .filters import (
    adaptive as adaptive,
    deadbeat_gain as deadbeat_gain,
    design_kalman as design_kalman,
    federated_covariance as federated_covariance,
    gating as gating,
    handover_weights as handover_weights,
    huber as huber,
    intersect as intersect,
    patterns_of as patterns_of,
    predictor_gain as predictor_gain,
    run_distributed as run_distributed,
    run_federated as run_federated,
    run_fused_locals as run_fused_locals,
    run_hinfinity as run_hinfinity,
    run_kalman as run_kalman,
    run_robust as run_robust,
    run_schmidt as run_schmidt,
    run_switched as run_switched,
    steady_error as steady_error,
    stream_kalman as stream_kalman,
)

# Design gains that come with a certificate
from .lmi import (
    FilterDesign as FilterDesign,
    FusionDesign as FusionDesign,
    InfeasibleDesignError as InfeasibleDesignError,
    design_filter as design_filter,
    design_fusion as design_fusion,
    hinf_norm as hinf_norm,
    spectral_radius as spectral_radius,
    stochastic_gain as stochastic_gain,
)

# Fit a regressor
from .learning import (
    BackpropRegressor as BackpropRegressor,
    HoldRegressor as HoldRegressor,
    LSSVMRegressor as LSSVMRegressor,
    RBFNetworkRegressor as RBFNetworkRegressor,
    SelectedLSSVM as SelectedLSSVM,
    select_lssvm as select_lssvm,
)

# Bridge an outage: a filter, and a regressor that stands in for it
from .navigation import HybridNavigator as HybridNavigator, observable_inputs as observable_inputs

# Follow a vehicle
from .logs import load_drive as load_drive
from .vehicle import (
    FilterSettings as FilterSettings,
    emulate_sensors as emulate_sensors,
    horizontal_error as horizontal_error,
    position_error as position_error,
    run_vehicle_filter as run_vehicle_filter,
)

# Simulate many runs
from .simulation import (
    ClusterScene as ClusterScene,
    Drive as Drive,
    Scene as Scene,
    multilaterate as multilaterate,
    simulate_drive as simulate_drive,
)
from .evaluation import monte_carlo as monte_carlo

# Score errors, and tune by them
from .evaluation import (
    fit_noise as fit_noise,
    mean_absolute_error as mean_absolute_error,
    mean_bounds as mean_bounds,
    normalised_squares as normalised_squares,
    root_mean_square_error as root_mean_square_error,
    spread as spread,
    tune as tune,
)

# Catch an error: one sentence that says which parameter, what it was, what it may be
from .errors import InswsnError as InswsnError, ParameterError as ParameterError
from .extras import MissingPackageError as MissingPackageError

__version__: str
