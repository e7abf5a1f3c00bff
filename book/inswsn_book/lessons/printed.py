"""A paper's own table in its lesson: printed, rebuilt, on equal terms, and recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import pandas as pd

from inswsn_book.record import ChapterRecord
from inswsn_book.results import Quantity
from inswsn_book.show import show_table
from inswsn_lib.evaluation import Finding

#: Columns of the table behind what is printed
COLUMNS = ("rebuilt", "on equal terms", "recorded")


class Cell(NamedTuple):
    """A printed cell, and the names of what evidence finds for it; a text where there is none."""

    label: str
    printed: str
    rebuilt: str
    equal: str
    recorded: str


def show_printed(
    record: ChapterRecord,
    evidence: str,
    cells: Iterable[Cell],
    compute: Callable[[], Mapping[str, Finding]],
    *,
    name: str,
    caption: str,
    first: Iterable[str] = (),
) -> dict[str, Quantity]:
    """Show a paper's table and record its numbers; return these.

    With the published parameters the numbers are those of the evidence, which has computed them by
    the same functions; with others they are computed here.

    Parameters
    ----------
    record : ChapterRecord
        Of the lesson.
    evidence : str
        The chapter that has the numbers of the published parameters.
    cells : iterable of Cell
        A row each. A name that no finding has is a word for the reader.
    compute : callable
        Gives the findings for the parameters of the lesson.
    name, caption : str
        Of the table.
    first : iterable of str
        Names of findings that are no cells and are recorded before them.
    """
    cells = [*cells]
    wanted = [*first, *(n for cell in cells for n in cell[2:] if "." in n)]
    found: dict[str, Quantity] = {}
    computed = {} if record.published else compute()
    for each in dict.fromkeys(wanted):
        if record.published:
            known = record.reference(evidence, each)
            fields = known.model_dump(exclude={"name", "value", "unit"})
            found[each] = record.quantity(each, known.value, known.unit, **fields)
        else:
            f = computed[each]
            ends = None if f.low == f.high else (f.low, f.high)
            basis = "emulation" if each.startswith("recorded.") else "simulation"
            found[each] = record.note(
                each, f.value, f.unit, f.how, interval=ends, kind=f.kind, basis=basis
            )
    rows = {c.label: [c.printed, *(_written(found.get(n), n) for n in c[2:])] for c in cells}
    frame = pd.DataFrame.from_dict(rows, orient="index", columns=["printed", *COLUMNS])
    show_table(frame.rename_axis("cell"), name=name, caption=caption)
    return found


def _written(quantity: Quantity | None, word: str) -> str:
    if quantity is None:
        return word
    ends = quantity.interval
    return f"{quantity.value:.3g}" + (f" ({ends[0]:.3g} to {ends[1]:.3g})" if ends else "")
