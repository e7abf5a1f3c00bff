"""Ratios of errors along one recording, whose neighbours are not independent."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import Array, array, number, whole
from inswsn_lib.errors import ParameterError

Whole = NDArray[np.int64]
_FEWEST = 3


def block_ratio(
    squares: ArrayLike, others: ArrayLike, block: int, *, level: float = 0.95, draws: int = 2000,
    seed: int = 0,
) -> tuple[float, float, float]:  # fmt: skip
    r"""Return the ratio of two methods' RMS errors on the same rows, and an interval for it.

    The circular block bootstrap (Politis and Romano 1992): blocks of neighbouring rows are drawn
    with replacement, the same for both methods, and the ratio

    .. math:: \sqrt{\textstyle\sum_k a_k \big/ \sum_k b_k}

    is taken of each draw; the interval holds the middle of them. Blocks must be longer than errors
    hang together. The interval speaks of other stretches of the same recording, not of another one.

    Parameters
    ----------
    squares, others : array_like, (rows,)
        Squared errors of a method, and of the one it is compared with; in the order of time.
    block : int
        Rows of a block, a third of all or fewer.
    level : float
        Of the interval.
    draws, seed : int
        Of the bootstrap.

    Returns
    -------
    ratio, low, high : float
        NaN where the other method has no error at all.

    Raises
    ------
    ParameterError
        If there are fewer than three blocks, or the arrays do not fit together.

    Examples
    --------
    A method with half of the error at every row: no draw has another ratio.

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import block_ratio
    >>> theirs = np.arange(1.0, 61.0)
    >>> print([f"{x:.2f}" for x in block_ratio(theirs / 4, theirs, block=10)])
    ['0.50', '0.50', '0.50']
    """
    number("level", level, above=0, below=1)
    drawn = ratio_draws(squares, others, block, draws=draws, seed=seed)
    if not np.any(others):
        return np.nan, np.nan, np.nan
    low, high = np.nanquantile(drawn, [(1 - level) / 2, (1 + level) / 2])
    return float(np.sqrt(np.sum(squares) / np.sum(others))), float(low), float(high)


def ratio_draws(
    squares: ArrayLike, others: ArrayLike, block: int, *, draws: int = 2000, seed: int = 0
) -> Array:
    """Return the ratio of each draw, (draws,), of which `block_ratio` takes the interval.

    NaN of a draw that has only rows without an error of the other.

    Parameters
    ----------
    squares, others, block, draws, seed
        As there.
    """
    mine = array("squares", squares, ("rows",))
    theirs = array("others", others, (len(mine),))
    whole("block", block, 1)
    count = len(mine) // block
    if count < _FEWEST:
        raise ParameterError("block", block, f"at most {len(mine) // _FEWEST} for {len(mine)} rows")
    begins = np.random.default_rng(seed).integers(len(mine), size=(draws, count))
    ours, other = (_sums(values, begins, block) for values in (mine, theirs))
    return np.sqrt(ours / np.where(other > 0, other, np.nan))


def _sums(values: Array, begins: Whole, block: int) -> Array:
    """Return the sums over the blocks of each draw, which go round at the end."""
    total = np.cumsum(np.concatenate([[0.0], values, values]))
    return np.asarray((total[begins + block] - total[begins]).sum(axis=1))
