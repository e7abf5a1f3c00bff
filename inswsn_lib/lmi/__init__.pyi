from .designs import (
    Certificate as Certificate,
    FilterDesign as FilterDesign,
    FusionCertificate as FusionCertificate,
    FusionDesign as FusionDesign,
    InfeasibleDesignError as InfeasibleDesignError,
)
from .filter_design import (
    central_gain as central_gain,
    design_filter as design_filter,
    minimise_gamma as minimise_gamma,
)
from .fusion import (
    design_fusion as design_fusion,
    fusion_gain as fusion_gain,
    fusion_system as fusion_system,
)
from .norms import (
    hinf_norm as hinf_norm,
    largest_singular_value as largest_singular_value,
    spectral_radius as spectral_radius,
)
from .riccati import riccati_filter as riccati_filter, riccati_gamma as riccati_gamma
from .stochastic import (
    WorstCase as WorstCase,
    finite_horizon_gain as finite_horizon_gain,
    mean_square_radius as mean_square_radius,
    stochastic_gain as stochastic_gain,
    worst_disturbance as worst_disturbance,
)
