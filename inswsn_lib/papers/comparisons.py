"""Comparing the rows of a printed table: reductions, orders, and what a set of sentences fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise, permutations

import pandas as pd

from inswsn_lib.papers.printed import (
    Derived,
    Interval,
    Printed,
    derive,
    intersects,
    interval,
    reduction,
)

#: The four error components, position then velocity
AXES = ("rx", "ry", "vx", "vy")
#: The columns of P1's Tables 2 and 3 in printed order, component before area
COLUMNS = tuple(axis + area for axis in AXES for area in "12")


def reductions(table: pd.DataFrame, better: str, worse: str) -> dict[str, Derived]:
    """Return by how much one method lowers the printed mean errors of another, in every column.

    Parameters
    ----------
    table : DataFrame
        A printed table: one row a method, the columns of `COLUMNS`.
    better, worse : str
        The two rows.

    Returns
    -------
    dict of str to Derived
        Per cent, by column.

    Examples
    --------
    By how much the filter of P1 lowers the error of the Kalman filter, per cent:

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.papers import read_table, reductions
    >>> table2 = read_table(data_file("papers/p1-table2.csv"), index="method")
    >>> found = reductions(table2, "HF", "KF")
    >>> print(f"{found['rx1'].value:.1f}, {found['vx1'].value:.1f}")
    86.7, 60.8
    """
    return {
        column: derive(reduction, _cell(table, better, column), _cell(table, worse, column))
        for column in COLUMNS
    }


def pooled_reductions(
    table: pd.DataFrame, better: str, worse: str, areas: str
) -> dict[str, Interval]:
    """Return the reduction of the errors summed over areas, per cent, by component.

    Parameters
    ----------
    table : DataFrame
        A printed table: one row a method, the columns of `COLUMNS`.
    better, worse : str
        The two rows.
    areas : str
        The areas to pool: ``"1"``, ``"2"`` or ``"12"``.

    Returns
    -------
    dict of str to mpmath.iv.mpf
        Per cent, by component.

    Examples
    --------
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.papers import pooled_reductions, read_table
    >>> table2 = read_table(data_file("papers/p1-table2.csv"), index="method")
    >>> pooled = pooled_reductions(table2, "HF", "KF", areas="12")
    >>> {axis: round(float(cell.mid), 1) for axis, cell in pooled.items()}
    {'rx': 95.1, 'ry': 90.8, 'vx': 64.1, 'vy': 86.9}
    """

    def total(method: str, axis: str) -> Interval:
        return sum(interval(_cell(table, method, axis + area)) for area in areas)

    return {axis: reduction(total(better, axis), total(worse, axis)) for axis in AXES}


def supported(
    table: pd.DataFrame, stated: Mapping[str, Interval], pairs: Sequence[tuple[str, str]]
) -> pd.DataFrame:
    """Count the stated reductions that each comparison within a table supports.

    Parameters
    ----------
    table : DataFrame
        A printed table: one row a method, the columns of `COLUMNS`.
    stated : mapping of str to interval
        What the text says, per cent, by component.
    pairs : sequence of (better, worse)
        The comparisons.

    Returns
    -------
    DataFrame
        One row a pair, one column a choice of areas: how many statements agree.

    Examples
    --------
    P1 says by how much its filter lowers the four errors of the Kalman filter, in the first area.
    How many of the four can its Table 2 give, in each area and in both pooled?

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.papers import about, read_numbers, read_table, supported
    >>> table2 = read_table(data_file("papers/p1-table2.csv"), index="method")
    >>> text = read_numbers(data_file("papers/p1.yaml"))["text"]
    >>> stated = {axis: about(number, 2.5) for axis, number in text["hf_vs_kf"].items()}
    >>> supported(table2, stated, [("HF", "KF")]).to_dict("index")
    {'KF to HF': {'No. 1': 1, 'No. 2': 0, 'both': 0}}
    """
    counts = {
        f"{worse} to {better}": [
            sum(
                intersects(cell, stated[axis])
                for axis, cell in pooled_reductions(table, better, worse, areas).items()
            )
            for areas in ("1", "2", "12")
        ]
        for better, worse in pairs
    }
    frame = pd.DataFrame.from_dict(counts, orient="index", columns=["No. 1", "No. 2", "both"])
    return frame.rename_axis("comparison")


def ordered_columns(table: pd.DataFrame, *methods: str) -> list[str]:
    """Return the columns in which each method's error is certainly below the next one's.

    Parameters
    ----------
    table : DataFrame
        A printed table: one row a method, the columns of `COLUMNS`.
    *methods : str
        Rows, the smallest error first. "Certainly" means: whatever the rounding hides.

    Returns
    -------
    list of str
        In the order of `COLUMNS`.

    Examples
    --------
    In all 8 columns of P1's Table 2 the filter is better than the Kalman filter, and that better
    than the INS alone:

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.papers import ordered_columns, read_table
    >>> table2 = read_table(data_file("papers/p1-table2.csv"), index="method")
    >>> len(ordered_columns(table2, "HF", "KF", "INS-only"))
    8
    """
    return [
        column
        for column in COLUMNS
        if all(
            interval(_cell(table, a, column)).b < interval(_cell(table, b, column)).a
            for a, b in pairwise(methods)
        )
    ]


def orders_below(
    fragments: Mapping[str, Sequence[Printed]], limits: Sequence[Printed]
) -> list[tuple[str, ...]]:
    """Return the orders of scattered fragments of a row that keep every cell below a limit.

    Parameters
    ----------
    fragments : mapping of str to sequence of str
        The fragments: runs of consecutive cells, by name.
    limits : sequence of str
        One printed number a column, which the cell of that column stays below.

    Returns
    -------
    list of tuple of str
        Each order as the names of the fragments.

    Examples
    --------
    Two pieces of a row of three cells; only with b first does each cell stay below its limit:

    >>> from inswsn_lib.papers import orders_below
    >>> orders_below({"a": ["1.0", "8.0"], "b": ["2.0"]}, ["3.0", "3.0", "9.0"])
    [('b', 'a')]
    """
    return [
        order
        for order in permutations(sorted(fragments))
        if all(
            float(cell) < float(limit)
            for cell, limit in zip(
                (cell for name in order for cell in fragments[name]), limits, strict=True
            )
        )
    ]


def _cell(table: pd.DataFrame, row: str, column: str) -> Printed:
    return str(table.loc[row, column])
