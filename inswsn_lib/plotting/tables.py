"""Tables: numbered and captioned in the book, plain HTML in a notebook."""

from __future__ import annotations

import pandas as pd
from IPython.display import display

from inswsn_lib.errors import ParameterError
from inswsn_lib.parameters import Schema


def tick(held: bool) -> str:
    """Return "yes" or "no" for a table cell: words, since a colour alone tells nobody.

    Parameters
    ----------
    held : bool
        Whether it holds.

    Returns
    -------
    str

    Examples
    --------
    >>> from inswsn_lib.plotting import tick
    >>> tick(0.3 < 0.5), tick(0.5 < 0.3)
    ('yes', 'no')
    """
    return "yes" if held else "no"


def show_parameters(schema: Schema, *, name: str) -> None:
    """Show the declared parameters of a chapter in a table.

    Parameters
    ----------
    schema : Schema
        The parameters, as ``ChapterRecord.schema`` has them.
    name : str
        The label that ``{numref}`` uses, for example ``"tbl-00-parameters"``.

    Examples
    --------
    >>> from inswsn_lib.parameters import read_schema
    >>> from inswsn_lib.plotting import show_parameters
    >>> schema = read_schema('''
    ... # Periods to run.
    ... steps: int = 100  # periods; value > 0
    ... ''')
    >>> show_parameters(schema, name="tbl-parameters")  # doctest: +ELLIPSIS
    {'text/markdown': ...`steps`...Periods to run...a whole number with value > 0...}
    """
    rows = [
        (
            f"`{p.name}`",
            p.meaning,
            "–" if p.kind == "str" else p.unit,
            f"{p.default}",
            p.allowed,
        )
        for p in schema.parameters
    ]
    columns = ["parameter", "what it is", "unit", "published run", "it may be"]
    frame = pd.DataFrame(rows, columns=columns).set_index("parameter")
    show_table(frame, name=name, caption="The parameters of this chapter.")


def show_table(frame: pd.DataFrame, *, name: str, caption: str) -> None:
    """Show a table with a caption; in the book it is numbered and can be referred to.

    Parameters
    ----------
    frame : DataFrame
        The table; its index names the rows. Cells are written with ``str`` and may hold MyST
        Markdown.
    name : str
        The label that ``{numref}`` uses, for example ``"tbl-table1-means"``.
    caption : str
        What to see in it, one line of MyST Markdown.

    Raises
    ------
    ParameterError
        If the caption or a cell has more than one line.

    Examples
    --------
    In a notebook the table is shown; a plain interpreter prints what is sent to it:

    >>> import pandas as pd
    >>> from inswsn_lib.plotting import show_table
    >>> frame = pd.DataFrame({"error, m": ["0.3881"]}, index=pd.Index(["HF"], name="method"))
    >>> show_table(frame, name="tbl-errors", caption="Errors.")  # doctest: +ELLIPSIS
    {'text/markdown': '```{list-table} Errors...* - method...error, m...* - HF...0.3881...}
    """
    cells = [[str(frame.index.name or ""), *map(str, frame.columns)]]
    cells += [
        [str(label), *map(str, row)]
        for label, row in zip(frame.index, frame.to_numpy(), strict=True)
    ]
    for text in (caption, *(cell for row in cells for cell in row)):
        if "\n" in text:
            raise ParameterError("caption or cell", text, "one line")
    fence = "~~~" if "`" in caption else "```"  # backticks do not stand behind backticks
    lines = [
        f"{fence}{{list-table}} {caption}",
        f":name: {name}",
        ":header-rows: 1",
        ":stub-columns: 1",
        "",
    ]
    for row in cells:
        lines += [f"{'* -' if i == 0 else '  -'} {cell}".rstrip() for i, cell in enumerate(row)]
    lines.append(fence)
    display(
        {
            "text/markdown": "\n".join(lines),
            "text/html": frame.to_html(),
            "text/plain": f"{caption}\n\n{frame.to_string()}",
        },
        raw=True,
    )
