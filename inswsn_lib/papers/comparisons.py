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
