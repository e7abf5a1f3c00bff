"""How a chapter shows its figures and tables: captioned and numbered in the book."""

from __future__ import annotations

import io

import pandas as pd
from IPython.display import display
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from inswsn_book.parameters import Schema
from inswsn_lib.errors import ParameterError


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
    >>> from inswsn_book.show import tick
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
    >>> from inswsn_book.parameters import read_schema
    >>> from inswsn_book.show import show_parameters
    >>> schema = read_schema('''
    ... # Periods to run.
    ... steps: int = 100  # periods; in (0, inf)
    ... ''')
    >>> show_parameters(schema, name="tbl-parameters")  # doctest: +ELLIPSIS
    {'text/markdown': ...`steps`...Periods to run...a whole number in (0, inf)...}
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
    >>> from inswsn_book.show import show_table
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


def show_figure(fig: Figure, *, name: str, caption: str, alt: str) -> None:
    """Show a figure with its caption and alternative text; the last thing a cell does.

    Parameters
    ----------
    fig : Figure
        The figure; it is closed.
    name : str
        The label that ``{numref}`` uses, for example ``"fig-table1-shifts"``.
    caption : str
        What to see in it, in MyST Markdown.
    alt : str
        What a reader who cannot see it needs: the message and its numbers.

    Raises
    ------
    ParameterError
        If the name, the caption or the alternative text is empty.

    Examples
    --------
    In a notebook the figure is shown; a plain interpreter prints what is sent to it, and a missing
    caption or alternative text is refused:

    >>> from inswsn_book.show import show_figure
    >>> from inswsn_lib.plotting import figure
    >>> fig, axes = figure()
    >>> line = axes.plot([0, 1], [0, 2])
    >>> show_figure(fig, name="fig-line", caption="A line.", alt=" ")
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: alt is ' '; it may be a text that is not empty.
    >>> show_figure(  # doctest: +ELLIPSIS
    ...     fig, name="fig-line", caption="A line.", alt="A line from 0 to 2."
    ... )
    {'image/svg+xml': ...<svg..., 'text/plain': 'A line from 0 to 2.'}
    """
    for field, text in (("name", name), ("caption", caption), ("alt", alt)):
        if not text.strip():
            raise ParameterError(field, text, "a text that is not empty")
    stream = io.StringIO()
    fig.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(fig)
    # the build moves this metadata to the cell, where the book's renderer looks for it
    display(
        {"image/svg+xml": stream.getvalue(), "text/plain": alt},
        metadata={"inswsn": {"name": name, "caption": caption, "alt": alt}},
        raw=True,
    )
