"""Errors of answers, and their ratio to another entry's over several recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from inswsn_lib.benchmark.events import Answer
from inswsn_lib.checks import Array
from inswsn_lib.evaluation.block_bootstrap import ratio_draws

#: Within these an entry's covariance tells its errors: normalised squares over their number
CONSISTENT = (0.5, 2.0)
_BLOCK = 10.0  # s


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of the answers to n questions.

    Attributes
    ----------
    position : ndarray, (n,)
        Squared horizontal errors, m^2.
    velocity : float
        RMS horizontal error, m/s; NaN if one is not told.
    nees : float
        Mean normalised square of the error over its number of components; NaN without covariance.
    """

    position: Array
    velocity: float
    nees: float

    @property
    def rms(self) -> float:
        """Of the position, m."""
        return float(np.sqrt(self.position.mean()))


def errors_of(answers: Sequence[Answer], truth: Array) -> Errors:
    """Return the errors of answers.

    Parameters
    ----------
    answers : sequence of Answer
    truth : ndarray, (n, 4)
        Horizontal position and velocity.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.benchmark import Answer
    >>> from inswsn_lib.benchmark.scoring import errors_of
    >>> found = errors_of([Answer([3.0, 4.0], covariance=np.eye(2))], np.zeros((1, 4)))
    >>> found.rms, found.velocity, found.nees
    (5.0, nan, 12.5)
    """
    position = np.array([answer.position for answer in answers]) - truth[:, :2]
    known = all(answer.velocity is not None for answer in answers)
    velocity = np.nan
    if known:
        off = np.array([answer.velocity for answer in answers]) - truth[:, 2:]
        velocity = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    squares = [_normalised(*pair) for pair in zip(answers, truth, strict=True)]
    return Errors(np.sum(position**2, axis=1), velocity, float(np.mean(squares)))


def _normalised(answer: Answer, truth: Array) -> float:
    if answer.covariance is None:
        return np.nan
    P = np.asarray(answer.covariance)
    parts = [answer.position] if len(P) == 2 else [answer.position, answer.velocity]
    error = np.concatenate([np.asarray(part, dtype=float) for part in parts]) - truth[: len(P)]
    return float(error @ np.linalg.pinv(P, hermitian=True) @ error) / len(P)


def mean_ratio(
    pairs: Sequence[tuple[Array, Array]], periods: Sequence[float], seed: int = 0
) -> tuple[float, float, float]:
    """Return the geometric mean over recordings of a ratio of RMS errors, and its 95 % interval.

    The interval is by a block bootstrap in each recording, of blocks of 10 s, or a third of it.

    Parameters
    ----------
    pairs : sequence of (ndarray, ndarray)
        Squared errors of an entry and of another one at the same questions, for each recording.
    periods : sequence of float
        Of the questions, s.
    seed : int

    Examples
    --------
    Half the error in one recording, twice the error in another:

    >>> import numpy as np
    >>> from inswsn_lib.benchmark import mean_ratio
    >>> ones = np.ones(90)
    >>> mean_ratio([(ones / 4, ones), (4 * ones, ones)], periods=[1.0, 1.0])
    (1.0, 1.0, 1.0)
    """
    logs, points = [], []
    for number, ((mine, theirs), period) in enumerate(zip(pairs, periods, strict=True)):
        block = max(1, min(round(_BLOCK / period), len(mine) // 3))
        drawn = ratio_draws(mine, theirs, block, seed=seed + number)
        logs.append(np.log(drawn))
        points.append(0.5 * np.log(mine.sum() / theirs.sum()))
    low, high = np.exp(np.quantile(np.mean(logs, axis=0), [0.025, 0.975]))
    return float(np.exp(np.mean(points))), float(low), float(high)
