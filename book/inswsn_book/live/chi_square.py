"""Bounds of mean normalised squares without scipy: looked up in a table that scipy has made."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array


def bounds(degrees: ArrayLike) -> tuple[Array, Array]:
    """Return between what 95 % of chi-square values over their degrees of freedom are.

    Up to 100 whole degrees they are those of the table. Beyond, it is interpolated along straight
    lines over one over the root of the degrees, to 1e-6.

    Parameters
    ----------
    degrees : array_like
        1 or more.

    Returns
    -------
    low, high : ndarray
        Each as `degrees`.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_book.live.chi_square import bounds
    >>> np.round(bounds([4, 1000]), 3).tolist()
    [[0.121, 0.914], [2.786, 1.09]]
    """
    roots, low, high = _table()
    at = 1 / np.sqrt(np.asarray(degrees, dtype=float))
    return np.interp(at, roots, low), np.interp(at, roots, high)


@cache
def _table() -> tuple[Array, Array, Array]:
    kept = json.loads(Path(__file__).with_name("chi_square.json").read_text(encoding="utf-8"))
    return np.array(kept["roots"]), np.array(kept["low"]), np.array(kept["high"])
