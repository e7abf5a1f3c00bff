"""The experiments by the number of their chapter, and a reader's own by module and name."""

from __future__ import annotations

from collections.abc import Mapping

from inswsn_book.experiments.experiment import Experiment
from inswsn_book.plugins import import_object

#: Where the experiments of the chapters are, for those that have one
EXPERIMENTS: Mapping[str, str] = {"02": "inswsn_book.experiments.networked:NETWORKED"}

_ALLOWED = "the number of a chapter, or package.module:NAME, an inswsn_book.experiments.Experiment"


def find_experiment(word: str) -> Experiment:
    """Return the experiment of a chapter, or one that a reader has written.

    Parameters
    ----------
    word : str
        The number of a chapter, or ``package.module:NAME``; the module is installed or lies in the
        working folder.

    Returns
    -------
    Experiment

    Raises
    ------
    ParameterError
        If there is none.

    Examples
    --------
    >>> from inswsn_book.experiments import find_experiment
    >>> find_experiment("02").title
    "P1's scene while a network is heard"
    >>> find_experiment("inswsn_book.experiments.networked:NETWORKED") is find_experiment("02")
    True
    """
    found = import_object("NAME", EXPERIMENTS.get(word, word), _ALLOWED, Experiment)
    assert isinstance(found, Experiment)
    return found
