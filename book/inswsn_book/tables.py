"""Tables of the texts that a build makes, as MyST Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def list_table(
    caption: str,
    name: str,
    rows: Iterable[Sequence[str]],
    *,
    header_rows: int = 1,
    stub_columns: int = 0,
    widths: str = "",
    style: str = "",
) -> str:
    """Return a table; a cell may hold several paragraphs.

    Parameters
    ----------
    caption, name : str
        What it shows, and by what name the book refers to it; either may be empty.
    rows : iterable of sequence of str
        The cells, of which the first rows are the head.
    header_rows, stub_columns : int
        How many rows and columns are headers.
    widths : str
        Of the columns, in parts.
    style : str
        Its class.

    Returns
    -------
    str
        A ``list-table`` directive, with a line break at its end.
    """
    options = {
        "name": name,
        "header-rows": header_rows,
        "stub-columns": stub_columns,
        "widths": widths,
        "class": style,
    }
    lines = [f":::::{{list-table}} {caption}".rstrip()]
    lines += [f":{option}: {value}" for option, value in options.items() if value]
    lines.append("")
    for row in rows:
        for i, cell in enumerate(row):
            first, *others = cell.split("\n")
            lines.append(f"{'* -' if i == 0 else '  -'} {first}".rstrip())
            lines += [f"    {line}".rstrip() for line in others]
    return "\n".join([*lines, ":::::\n"])
