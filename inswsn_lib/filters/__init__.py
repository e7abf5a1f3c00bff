"""Filters that estimate the error of an inertial navigation system."""

from inswsn_lib.filters.distributed import (
    handover_weights,
    patterns_of,
    run_distributed,
    run_switched,
)
from inswsn_lib.filters.federated import federated_covariance, run_federated
from inswsn_lib.filters.hinfinity import deadbeat_gain, run_hinfinity
from inswsn_lib.filters.intersection import intersect, run_fused_locals
from inswsn_lib.filters.kalman import KalmanDesign, design_kalman, run_kalman
from inswsn_lib.filters.robust import adaptive, gating, huber, run_robust
from inswsn_lib.filters.steady import predictor_gain, steady_error

__all__ = [
    "KalmanDesign",
    "adaptive",
    "deadbeat_gain",
    "design_kalman",
    "federated_covariance",
    "gating",
    "handover_weights",
    "huber",
    "intersect",
    "patterns_of",
    "predictor_gain",
    "run_distributed",
    "run_federated",
    "run_fused_locals",
    "run_hinfinity",
    "run_kalman",
    "run_robust",
    "run_switched",
    "steady_error",
]
