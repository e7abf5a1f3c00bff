"""The Monte Carlo cores of chapters, as functions of declared parameters: what a sweep reruns."""

from inswsn_lib.experiments.experiment import Experiment, Judge, Trial
from inswsn_lib.experiments.networked import NETWORKED, NetworkedTrial
from inswsn_lib.experiments.registry import EXPERIMENTS, find_experiment
from inswsn_lib.experiments.summary import draw_summary, leading_methods, tidy_results

__all__ = [
    "EXPERIMENTS",
    "NETWORKED",
    "Experiment",
    "Judge",
    "NetworkedTrial",
    "Trial",
    "draw_summary",
    "find_experiment",
    "leading_methods",
    "tidy_results",
]
