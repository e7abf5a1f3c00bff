"""Filters that estimate the error of an inertial navigation system."""

from inswsn_lib.filters.hinfinity import deadbeat_gain, run_hinfinity
from inswsn_lib.filters.kalman import KalmanDesign, design_kalman, run_kalman
from inswsn_lib.filters.robust import adaptive, gating, huber, run_robust
from inswsn_lib.filters.steady import predictor_gain, steady_error

__all__ = [
    "KalmanDesign",
    "adaptive",
    "deadbeat_gain",
    "design_kalman",
    "gating",
    "huber",
    "predictor_gain",
    "run_hinfinity",
    "run_kalman",
    "run_robust",
    "steady_error",
]
