from .centre import central_gain as central_gain
from .designs import Certificate as Certificate, FilterDesign as FilterDesign
from .filter_design import (
    certify as certify,
    design_filter as design_filter,
    inequality as inequality,
    minimise_gamma as minimise_gamma,
)
from .fusion import (
    FusionCertificate as FusionCertificate,
    FusionDesign as FusionDesign,
    design_fusion as design_fusion,
    fusion_gain as fusion_gain,
    fusion_system as fusion_system,
    tied_level as tied_level,
)
from .horizon import (
    WorstCase as WorstCase,
    buildable_system as buildable_system,
    enumerated_gain as enumerated_gain,
    finite_horizon_gain as finite_horizon_gain,
    worst_disturbance as worst_disturbance,
)
from .norms import (
    hinf_norm as hinf_norm,
    largest_singular_value as largest_singular_value,
    mean_square_radius as mean_square_radius,
    riccati_gain_below as riccati_gain_below,
    spectral_radius as spectral_radius,
    stochastic_gain as stochastic_gain,
)
from .proof import negative_definite as negative_definite, printed_steps as printed_steps
from .riccati import riccati_filter as riccati_filter, riccati_gamma as riccati_gamma
from .solvers import InfeasibleDesignError as InfeasibleDesignError, design_counts as design_counts
