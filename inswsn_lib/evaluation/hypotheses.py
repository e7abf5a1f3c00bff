"""Scoring what somebody may have computed against the cells that he printed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]

#: A cell is explained if the rebuilt one is within this share of it.
WITHIN = 0.1


@dataclass(frozen=True, eq=False)
class Score:
    """How well a hypothesis explains printed cells.

    Attributes
    ----------
    name : str
        The hypothesis.
    free : int
        Numbers that were chosen with these cells in view.
    ratios : ndarray, (cells,)
        Rebuilt over printed.

    Examples
    --------
    Two cells are met; a hypothesis with two free numbers could meet any two cells, and explains
    none.

    >>> from inswsn_lib.evaluation import score_hypothesis
    >>> fitted = score_hypothesis("fitted", rebuilt=[1.0, 2.0], printed=[1.0, 2.0], free=2)
    >>> fitted.met, fitted.explained
    (2, False)
    """

    name: str
    free: int
    ratios: Array

    @property
    def met(self) -> int:
        """How many cells are within `WITHIN`."""
        return int(np.sum(np.abs(self.ratios - 1) <= WITHIN))

    @property
    def explained(self) -> bool:
        """Whether all cells are, and there are more of them than free numbers."""
        return self.met == self.ratios.size > self.free

    @property
    def spread(self) -> float:
        """Root mean square of the logarithms of the ratios: 0.1 is about ten per cent."""
        return float(np.sqrt(np.mean(np.log(self.ratios) ** 2)))

    @property
    def worst(self) -> float:
        """The ratio that is farthest from one, on a logarithmic scale."""
        return float(self.ratios[np.argmax(np.abs(np.log(self.ratios)))])


def score_hypothesis(name: str, rebuilt: ArrayLike, printed: ArrayLike, free: int) -> Score:
    """Score one hypothesis.

    Parameters
    ----------
    name : str
        The hypothesis.
    rebuilt, printed : array_like, (cells,)
        Positive numbers.
    free : int
        Numbers that were chosen with these cells in view.

    Returns
    -------
    Score
        The ratios of rebuilt to printed, and what they say.

    Raises
    ------
    ParameterError
        If the cells do not pair, a cell is not positive, or `free` is negative.

    Examples
    --------
    >>> from inswsn_lib.evaluation import score_hypothesis
    >>> score = score_hypothesis("metres", rebuilt=[1.0, 2.1, 2.9], printed=[1.0, 2.0, 3.0], free=1)
    >>> score.met, score.explained, round(score.worst, 2)
    (3, True, 1.05)
    >>> score_hypothesis("feet", [3.28, 6.9, 9.5], [1.0, 2.0, 3.0], free=1).met
    0
    """
    a, b = np.asarray(rebuilt, dtype=float), np.asarray(printed, dtype=float)
    if a.ndim != 1 or a.shape != b.shape or a.size == 0:
        raise ParameterError("rebuilt and printed", (a.shape, b.shape), "of one shape, (cells,)")
    if not (np.isfinite(a).all() and np.isfinite(b).all() and (a > 0).all() and (b > 0).all()):
        raise ParameterError("rebuilt and printed", "not all positive", "positive numbers")
    if free < 0:
        raise ParameterError("free", free, "0 or more")
    return Score(name, free, a / b)
