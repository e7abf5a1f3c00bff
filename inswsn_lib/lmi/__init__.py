"""Linear matrix inequalities of the H-infinity filters, and the norms that certify them."""

from inswsn_lib.lmi.centre import central_gain
from inswsn_lib.lmi.filter_design import (
    Certificate,
    FilterDesign,
    certify,
    design_filter,
    inequality,
    minimise_gamma,
)
from inswsn_lib.lmi.fusion import (
    FusionCertificate,
    FusionDesign,
    design_fusion,
    fusion_gain,
    fusion_system,
    tied_level,
)
from inswsn_lib.lmi.horizon import (
    WorstCase,
    buildable_system,
    enumerated_gain,
    finite_horizon_gain,
    worst_disturbance,
)
from inswsn_lib.lmi.norms import (
    hinf_norm,
    largest_singular_value,
    mean_square_radius,
    riccati_gain_below,
    spectral_radius,
    stochastic_gain,
)
from inswsn_lib.lmi.proof import negative_definite, printed_steps
from inswsn_lib.lmi.riccati import riccati_filter, riccati_gamma
from inswsn_lib.lmi.solvers import InfeasibleDesignError, design_counts

__all__ = [
    "Certificate",
    "FilterDesign",
    "FusionCertificate",
    "FusionDesign",
    "InfeasibleDesignError",
    "WorstCase",
    "buildable_system",
    "central_gain",
    "certify",
    "design_counts",
    "design_filter",
    "design_fusion",
    "enumerated_gain",
    "finite_horizon_gain",
    "fusion_gain",
    "fusion_system",
    "hinf_norm",
    "inequality",
    "largest_singular_value",
    "mean_square_radius",
    "minimise_gamma",
    "negative_definite",
    "printed_steps",
    "riccati_filter",
    "riccati_gain_below",
    "riccati_gamma",
    "spectral_radius",
    "stochastic_gain",
    "tied_level",
    "worst_disturbance",
]
