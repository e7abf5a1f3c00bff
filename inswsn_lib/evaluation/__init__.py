"""Errors: what they can and cannot be, how large they are, and whether a filter knows it."""

from inswsn_lib.evaluation.consistency import mean_bounds, normalised_squares
from inswsn_lib.evaluation.drift import MOTIONS, DriftBound, Motion, drift_bound, longest_period
from inswsn_lib.evaluation.hypotheses import WITHIN, Score, score_hypothesis
from inswsn_lib.evaluation.metrics import (
    Spread,
    cluster_interval,
    largest_error,
    mean_absolute_error,
    root_mean_square_error,
    spread,
)
from inswsn_lib.evaluation.monte_carlo import GROUP, monte_carlo
from inswsn_lib.evaluation.noise import NoiseFit, fit_noise
from inswsn_lib.evaluation.scores import Lead, Leader, Scores, paired_lead
from inswsn_lib.evaluation.tuning import PatternSearch, Tuning, search_pattern, tune

__all__ = [
    "GROUP",
    "MOTIONS",
    "WITHIN",
    "DriftBound",
    "Lead",
    "Leader",
    "Motion",
    "NoiseFit",
    "PatternSearch",
    "Score",
    "Scores",
    "Spread",
    "Tuning",
    "cluster_interval",
    "drift_bound",
    "fit_noise",
    "largest_error",
    "longest_period",
    "mean_absolute_error",
    "mean_bounds",
    "monte_carlo",
    "normalised_squares",
    "paired_lead",
    "root_mean_square_error",
    "score_hypothesis",
    "search_pattern",
    "spread",
    "tune",
]
