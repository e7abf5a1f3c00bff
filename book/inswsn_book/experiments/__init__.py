"""The Monte Carlo cores of chapters, as functions of declared parameters: what a sweep reruns.

Each experiment is a module of its own, which is imported when it is asked for: the processes of a
sweep start often, and load what they need.
"""

from inswsn_book.experiments.experiment import Experiment, Judge, Trial
from inswsn_book.experiments.registry import EXPERIMENTS, find_experiment

__all__ = [
    "EXPERIMENTS",
    "Experiment",
    "Judge",
    "Trial",
    "find_experiment",
]
