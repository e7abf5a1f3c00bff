"""Errors: what they can and cannot be, and whether they are as large as a filter says."""

from inswsn_lib.evaluation.consistency import mean_bounds, normalised_squares
from inswsn_lib.evaluation.drift import MOTIONS, DriftBound, Motion, drift_bound, longest_period

__all__ = [
    "MOTIONS",
    "DriftBound",
    "Motion",
    "drift_bound",
    "longest_period",
    "mean_bounds",
    "normalised_squares",
]
