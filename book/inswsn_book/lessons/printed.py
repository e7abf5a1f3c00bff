"""A paper's own table in its lesson: printed, rebuilt, on equal terms, and recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import pandas as pd

from inswsn_book.show import show_table

if TYPE_CHECKING:  # of which the page has less
    from inswsn_book.record import ChapterRecord
    from inswsn_book.record.results import Quantity
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
    by: Iterable[str],
    name: str,
    caption: str,
    first: Iterable[str] = (),
    fold: str = "",
    basis: str = "simulation",
    digits: int = 3,
) -> dict[str, Quantity]:
    """Show a paper's table and record its numbers; return these.

    If what the table depends on is as published the numbers are those of the evidence, which has
    computed them by the same functions; else they are computed here.

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
    by : iterable of str
        The parameters on which the table depends.
    name, caption : str
        Of the table.
    first : iterable of str
        Names of findings that are no cells and are recorded before them.
    fold : str
        As for `show_table`.
    basis : str
        Of what is computed here, as a `Quantity` has it.
    digits : int
        That count, of a number in the table.
    """
    cells = [*cells]
    frame = pd.DataFrame(index=pd.Index([c.label for c in cells], name="cell"))
    wanted = [*first, *(n for cell in cells for n in cell[2:] if "." in n)]
    found: dict[str, Quantity] = {}
    published = record.as_published(by)
    computed = {} if published else compute()
    for each in dict.fromkeys(wanted):
        if published:
            known = record.reference(evidence, each)
            fields = known.model_dump(exclude={"name", "value", "unit"})
            found[each] = record.quantity(each, known.value, known.unit, **fields)
        else:
            f = computed[each]
            ends = None if f.low == f.high else (f.low, f.high)
            kind = "emulation" if each.startswith("recorded.") else basis
            found[each] = record.note(
                each, f.value, f.unit, f.how, interval=ends, kind=f.kind, basis=kind
            )
    frame["printed"] = [c.printed for c in cells]
    for column, names in zip(COLUMNS, zip(*(c[2:] for c in cells), strict=True), strict=True):
        frame[column] = [_written(found.get(n), n, digits) for n in names]
    show_table(frame, name=name, caption=caption, fold=fold)
    return found


def _written(quantity: Quantity | None, word: str, digits: int) -> str:
    if quantity is None:
        return word
    numbers = (quantity.value, *(quantity.interval or ()))
    value, *ends = (f"{float(f'{x:.{digits}g}'):g}" for x in numbers)  # 1430, and not 1.43e+03
    return value + (f" ({' to '.join(ends)})" if ends else "")
