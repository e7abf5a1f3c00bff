"""Axes that are exchanged, reversed or mirrored: every signed permutation against none."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f, t

from inswsn_lib.checks import Array
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding

_NAMES = "xyz"


def signed_permutations(dimensions: int) -> list[Array]:
    """Return the 2, 8 or 48 matrices that exchange and reverse axes, the identity first."""
    found = [
        np.eye(dimensions)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(dimensions))
        for signs in product((1.0, -1.0), repeat=dimensions)
    ]
    return sorted(found, key=lambda P: -float(np.trace(P)))


def in_words(P: Array) -> str:
    """Return what axes are, by those that they should be."""
    if len(P) == 1:
        return "the other way round"
    axes = [f"{'-' if row.min() < 0 else ''}{_NAMES[int(np.abs(row).argmax())]}" for row in P]
    return ", ".join(axes) + (" (mirrored)" if np.linalg.det(P) < 0 else "")


def judge_axes(
    subject: str, what: str, misfits: Array, starts: NDArray[np.intp], matrices: list[Array]
) -> Finding:
    """Return whether the identity fits better than every other signed permutation.

    Two tests of which either is enough: the means of the squared misfits are compared by Fisher's
    distribution with as many degrees of freedom as there are blocks of time; and the differences of
    the misfits, averaged over blocks, with their deviation by Student's. The first is sharp where
    what is wrong is much larger than noise, the second where both misfits have much in common.

    Parameters
    ----------
    subject, what : str
        Of the finding, and whose axes they are.
    misfits : ndarray, (n, P)
        Of each row, with each permutation.
    starts : ndarray of int, (blocks,)
        First rows of the blocks.
    matrices : list of ndarray
        The permutations, the identity first.
    """
    blocks, others = len(starts), len(matrices) - 1
    level = FALSE_ALARM / (4 * others)
    squares = np.mean(misfits**2, axis=0) + 1e-300
    ratio = squares[1:] / squares[0]
    enough = float(f.isf(level, blocks, blocks))
    counts = np.diff(np.append(starts, len(misfits)))[:, None]
    means = np.add.reduceat(misfits[:, 1:] - misfits[:, :1], starts, axis=0) / counts
    spread = means.std(axis=0, ddof=1) / np.sqrt(blocks)
    z = means.mean(axis=0) / np.maximum(spread, 1e-300)
    bound = float(t.isf(level, blocks - 1))
    better = (ratio <= 1 / enough) | (z <= -bound)
    worse = (ratio >= enough) | (z >= bound)
    nearest = int(np.argmin(ratio))
    value = float(ratio[nearest])
    if better[nearest]:
        says = f"{what} axes, by those that they should be, are {in_words(matrices[nearest + 1])}"
        return Finding("axes", subject, value, 1.0, np.inf, False, says)
    if not worse.all():
        like = matrices[1 + int(np.argmin(np.where(worse, np.inf, ratio)))]
        says = (
            f"too little turns for the data to tell {what} axes from {int(np.sum(~worse))} others "
            f"of {others}, such as {in_words(like)}"
        )
        return Finding("axes", subject, value, 1.0, np.inf, None, says)
    says = f"{what} axes are as they should be: no others of {others} fit as well"
    return Finding("axes", subject, value, 1.0, np.inf, True, says)


def unit_of(ratio: float, units: dict[str, float], near: float = 0.15) -> Iterator[str]:
    """Yield the units with which a ratio of what is logged to what should be is explained."""
    for unit, size in units.items():
        if abs(np.log(max(ratio, 1e-300) / size)) < near:
            yield unit
