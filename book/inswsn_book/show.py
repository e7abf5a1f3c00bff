"""How a chapter shows its figures and tables, captioned and numbered in the book, and its labs.

A lab is a chart that a reader moves by sliders, drawn by ``book/_static/labs.js`` in the place of a
still figure of the same cell, which stays where no script runs, and in print.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from html import escape
from typing import Any

import numpy as np
import pandas as pd
from IPython.display import display
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from numpy.typing import NDArray

from inswsn_book.parameters import Schema
from inswsn_lib.errors import ParameterError


def tick(held: bool) -> str:
    """Return "yes" or "no" for a table cell: words, since a colour alone tells nobody."""
    return "yes" if held else "no"


def show_parameters(schema: Schema, *, name: str) -> None:
    """Show the declared parameters of a chapter in a table of that label."""
    rows = [
        (f"`{p.name}`", p.meaning, "–" if p.kind == "str" else p.unit, f"{p.default}", p.allowed)
        for p in schema.parameters
    ]
    columns = ["parameter", "what it is", "unit", "published run", "it may be"]
    frame = pd.DataFrame(rows, columns=columns).set_index("parameter")
    show_table(frame, name=name, caption="The parameters of this chapter.")


def show_table(frame: pd.DataFrame, *, name: str, caption: str) -> None:
    """Show a table with a caption; the book numbers it, and ``{numref}`` refers to it by its label.

    The index names the rows. Cells are written with ``str`` and may hold MyST Markdown of one line,
    as the caption may.
    """
    cells = [[str(frame.index.name or ""), *map(str, frame.columns)]]
    cells += [
        [str(label), *map(str, row)]
        for label, row in zip(frame.index, frame.to_numpy(), strict=True)
    ]
    fence = "~~~" if "`" in caption else "```"  # backticks do not stand behind backticks
    lines = [f"{fence}{{list-table}} {caption}", f":name: {name}"]
    lines += [":header-rows: 1", ":stub-columns: 1", ""]
    for row in cells:
        lines += [f"{'* -' if i == 0 else '  -'} {cell}".rstrip() for i, cell in enumerate(row)]
    lines.append(fence)
    display(
        {
            "text/markdown": "\n".join(lines),
            "text/html": frame.to_html(),
            "text/plain": f"{caption}\n\n{frame.to_string()}",
        },
        metadata={"table": {"name": name, "cells": cells}},  # for the results file
        raw=True,
    )


def show_figure(fig: Figure, *, name: str, caption: str, alt: str) -> None:
    """Show a figure, which is closed, with its label, caption and alternative text.

    It is the last thing that a cell does. The caption says what to see in it, in MyST Markdown; the
    alternative text what a reader who cannot see it needs: the message and its numbers. Neither may
    be empty.
    """
    for what, text in (("name", name), ("caption", caption), ("alt", alt)):
        if not text.strip():
            raise ParameterError(what, text, "a text that is not empty")
    stream = io.StringIO()
    fig.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(fig)
    # the build moves this metadata to the cell, where the book's renderer looks for it
    display(
        {"image/svg+xml": stream.getvalue(), "text/plain": alt},
        metadata={"inswsn": {"name": name, "caption": caption, "alt": alt}},
        raw=True,
    )


@dataclass(frozen=True)
class Slider:
    """A number that a reader of a lab may move; with `log` its places are powers of ten.

    Its ends are a whole number of steps apart, and it starts at one of its places.
    """

    name: str  # for the script
    label: str  # for the reader
    low: float
    high: float
    step: float
    start: float  # where it stands at first
    unit: str = ""
    log: bool = False
    by: str = ""  # the choice on which the unit depends, if it does
    units: Mapping[str, str] = field(default_factory=dict)  # of each option of that choice

    @property
    def places(self) -> NDArray[np.float64]:
        """Where it may stand."""
        count = round((self.high - self.low) / self.step) + 1
        return np.asarray(self.low + self.step * np.arange(count))

    @property
    def values(self) -> NDArray[np.float64]:
        """The values at its places."""
        return np.asarray(10.0**self.places if self.log else self.places)


@dataclass(frozen=True)
class Choice:
    """One of two or more things that a reader of a lab may choose, by radio buttons."""

    name: str
    label: str
    options: Mapping[str, str]  # for the script, and for the reader
    start: str


def show_lab(
    kind: str,
    *,
    title: str,
    figure: str,
    sliders: Sequence[Slider],
    choices: Sequence[Choice],
    data: Mapping[str, Any],
) -> None:
    """Show a lab in the place of a still figure of the same page, given by its label.

    Its `data` are made of strings, finite numbers, lists, mappings and arrays.
    """
    content = {
        "title": title,
        "sliders": [asdict(slider) for slider in sliders],
        # pairs, since the keys of an object that look like numbers lose their order
        "choices": [asdict(c) | {"options": list(c.options.items())} for c in choices],
        "data": data,
    }
    text = json.dumps(content, allow_nan=False, separators=(",", ":"), default=_plain)
    # no "<" in a script element: it could end it, or begin a comment
    text = text.replace("<", "\\u003c")
    page = (
        f'<section class="lab" id="lab-{kind}" data-lab="{kind}" '
        f'data-figure="{escape(figure)}" hidden>'
        f'<script type="application/json">{text}</script></section>'
    )
    plain = f"{title}: the sliders of this lab need the page of the book."
    display({"text/html": page, "text/plain": plain}, raw=True)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form.")
