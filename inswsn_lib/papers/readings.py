"""Readings of a printed column: ways in which its authors may have computed it, and their score.

A reading is named before it is scored. Its score is the number of printed cells that it admits:
the cells that some values within the rounding of its operands give exactly as printed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from math import perm

import pandas as pd
from mpmath import iv

from inswsn_lib.errors import ParameterError
from inswsn_lib.papers.printed import Interval, Printed, admits, interval


@dataclass(frozen=True)
class Reading:
    """One way in which a column may have been computed.

    Parameters
    ----------
    name : str
        A few words for the reader.
    compute : callable
        Takes nothing, returns the column as a list of intervals.

    Examples
    --------
    >>> from inswsn_lib.papers import Reading, shifted_mean
    >>> own = Reading("mean of the row's own cells", lambda: shifted_mean(["1.0"], ["3.0"], 0))
    >>> [f"{float(cell.a):.2f} to {float(cell.b):.2f}" for cell in own.compute()]
    ['1.95 to 2.05']
    """

    name: str
    compute: Callable[[], Sequence[Interval]]


def shifted_mean(x: Sequence[Printed], y: Sequence[Printed], shift: int) -> list[Interval]:
    r"""Return the column :math:`(x_i + y_{i+s})/2` with a blank counted as zero.

    Parameters
    ----------
    x, y : sequence of str
        Two printed columns of one length.
    shift : int
        The row offset :math:`s` of the second column. Rows outside the table are blank, and a
        blank counts as exactly zero, as it does in a spreadsheet formula.

    Returns
    -------
    list of mpmath.iv.mpf
        One a row.

    Raises
    ------
    ParameterError
        If the columns differ in length.

    Examples
    --------
    The second column one row too low: row 1 takes the 4, and the last row takes a blank:

    >>> from inswsn_lib.papers import shifted_mean
    >>> column = shifted_mean(["1.0", "2.0"], ["9.0", "4.0"], 1)
    >>> [round(float(cell.mid), 3) for cell in column]
    [2.5, 1.0]
    """
    if len(x) != len(y):
        raise ParameterError("y", len(y), f"a column of {len(x)} rows, as many as x has")
    others = list(y)  # by position, whatever the labels of the rows
    column = []
    for i, cell in enumerate(x):
        j = i + shift
        other = interval(others[j]) if 0 <= j < len(others) else iv.mpf(0)
        column.append((interval(cell) + other) / 2)
    return column


def offset_scores(
    x: Sequence[Printed], y: Sequence[Printed], printed: Sequence[Printed]
) -> dict[int, int]:
    """Return how many printed means each row offset of the second column admits.

    Parameters
    ----------
    x, y, printed : sequence of str
        Three printed columns of one length.

    Returns
    -------
    dict of int to int
        By offset, from minus to plus the number of rows less one; see `shifted_mean`.

    Examples
    --------
    The printed means are those of the column moved by one row:

    >>> from inswsn_lib.papers import offset_scores
    >>> offset_scores(["1.0", "2.0"], ["9.0", "4.0"], ["2.5", "1.0"])
    {-1: 0, 0: 0, 1: 2}
    """
    rows = len(x)
    return {
        shift: sum(rows_admitted(shifted_mean(x, y, shift), printed))
        for shift in range(1 - rows, rows)
    }


def chance_assignments(
    x: Sequence[Printed], y: Sequence[Printed], printed: Sequence[Printed]
) -> tuple[int, int]:
    r"""Count the ways to hand out the cells of `y`, one a row, that admit every printed mean.

    The cells of `y` and one blank, which counts as zero, are handed out to the rows, each at most
    once. The quotient of the two counts is the probability that a random order explains the
    whole column.

    Parameters
    ----------
    x, y, printed : sequence of str
        Three printed columns of one length.

    Returns
    -------
    admitting, all : int
        The ways that admit every printed mean :math:`(x_i + y_j)/2`, and all ways.

    Examples
    --------
    Two cells and a blank can be handed out to two rows in six ways. One of them explains both
    means:

    >>> from inswsn_lib.papers import chance_assignments
    >>> chance_assignments(["1.0", "2.0"], ["9.0", "4.0"], ["2.5", "1.0"])
    (1, 6)
    """
    candidates = [*map(interval, y), iv.mpf(0)]
    fitting = [
        [j for j, other in enumerate(candidates) if admits((interval(cell) + other) / 2, text)]
        for cell, text in zip(x, printed, strict=True)
    ]

    @cache
    def ways(row: int, used: int) -> int:
        if row == len(fitting):
            return 1
        return sum(ways(row + 1, used | 1 << j) for j in fitting[row] if not used >> j & 1)

    return ways(0, 0), perm(len(candidates), len(fitting))


def rows_admitted(computed: Sequence[Interval], printed: Sequence[Printed]) -> list[bool]:
    """Tell for each row whether the computed interval admits the printed cell.

    Parameters
    ----------
    computed : sequence of interval
        What a reading gives.
    printed : sequence of str
        What the paper prints.

    Returns
    -------
    list of bool
        One a row.

    Raises
    ------
    ParameterError
        If the columns differ in length.

    Examples
    --------
    >>> from inswsn_lib.papers import rows_admitted, shifted_mean
    >>> rows_admitted(shifted_mean(["1.0", "2.0"], ["9.0", "4.0"], 0), ["5.0", "1.0"])
    [True, False]
    """
    if len(computed) != len(printed):
        raise ParameterError("computed", len(computed), f"a column of {len(printed)} rows")
    return [admits(x, text) for x, text in zip(computed, printed, strict=True)]


def score(readings: Iterable[Reading], printed: Sequence[Printed]) -> pd.DataFrame:
    """Score readings against a printed column.

    Parameters
    ----------
    readings : iterable of Reading
        The readings, named before they are scored.
    printed : sequence of str
        The column.

    Returns
    -------
    DataFrame
        One row a reading, in the order given: ``reading``, ``cells met``, ``of``.

    Examples
    --------
    >>> from inswsn_lib.papers import Reading, score, shifted_mean
    >>> x, y, printed = ["1.0", "2.0"], ["9.0", "4.0"], ["2.5", "1.0"]
    >>> own = Reading("own row", lambda: shifted_mean(x, y, 0))
    >>> following = Reading("next row", lambda: shifted_mean(x, y, 1))
    >>> print(score([own, following], printed).to_string(index=False))
     reading  cells met  of
     own row          0   2
    next row          2   2
    """
    rows = [
        (reading.name, sum(rows_admitted(reading.compute(), printed)), len(printed))
        for reading in readings
    ]
    return pd.DataFrame(rows, columns=["reading", "cells met", "of"])
