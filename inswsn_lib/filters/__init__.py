"""Filters that estimate the error of an inertial navigation system."""

from inswsn_lib.filters.kalman import KalmanDesign, design_kalman, run_kalman

__all__ = ["KalmanDesign", "design_kalman", "run_kalman"]
