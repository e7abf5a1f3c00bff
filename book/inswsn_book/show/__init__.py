"""How a chapter shows its figures and tables, captioned and numbered in the book."""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Container, Mapping
from typing import TYPE_CHECKING, Any, Protocol

import pandas as pd
from IPython.display import display
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from inswsn_book.record.parameters import Schema
from inswsn_book.show.legible import least_points, legend_of, texts_in_the_way
from inswsn_lib.errors import ParameterError

if TYPE_CHECKING:
    from inswsn_book.judge.verdicts import Judged
    from inswsn_book.record import ChapterRecord
    from inswsn_book.record.results import Results
    from inswsn_lib.scenario import Setting

# Markdown in a cell of a table that a notebook shows by itself
_CODE, _LINK = re.compile(r"`([^`<]+)`"), re.compile(r"\[([^\]<]+)\]\(#[^)<]+\)")
_PATH = re.compile(r'(?<= d=")[^"]*')
_INDENT = re.compile(r"\n\s+")
_FINE = re.compile(r"(\.\d\d)\d+")


def tick(held: bool) -> str:
    """Return "yes" or "no" for a table cell: words, since a colour alone tells nobody."""
    return "yes" if held else "no"


def show_parameters(schema: Schema, *, name: str) -> None:
    """Show the declared parameters of a chapter in a table of that label."""
    rows = [
        (f"`{p.name}`", p.meaning, "–" if p.kind == "str" else p.unit, f"{p.default}", p.allowed)
        for p in schema.parameters
    ]
    columns = ["parameter", "what it is", "unit", "published run", "allowed values"]
    frame = pd.DataFrame(rows, columns=columns).set_index("parameter")
    show_table(frame, name=name, caption="The parameters of this chapter.")


def show_settings(record: ChapterRecord, settings: Mapping[str, Setting], *, name: str) -> None:
    """Show the settings of a scene in a table of that label; keep how many have each source."""
    rows = [
        (f"`{key}`", _written(s.value), "–" if s.unit == "1" else s.unit, s.source, s.why)
        for key, s in settings.items()
    ]
    frame = pd.DataFrame(rows, columns=["setting", "value", "unit", "source", "why"])
    caption = "Every number of the simulation, and where it comes from."
    show_table(frame.set_index("setting"), name=name, caption=caption)
    for source, count in Counter(s.source for s in settings.values()).items():
        record.say(f"settings.{source}", str(count))


class _Judging(Protocol):
    """A record whose chapter decides claims."""

    def judge(self) -> list[Judged]: ...

    def say(self, name: str, text: str) -> None: ...


def show_claims(record: _Judging, *, name: str, caption: str, but: Container[str] = ()) -> None:
    """Show the claims that a chapter decides, but those of some ids, and keep the score.

    The score: ``score.given``, the claims that are settings of the run; ``score.all`` and
    ``score.verdicts``, the count of all and of each verdict.
    """
    from inswsn_book.judge.verdicts import count_verdicts  # noqa: PLC0415  # the page has it not

    judged = record.judge()
    given = [entry for entry in judged if entry.quantity and entry.quantity.role == "input"]
    rows = [
        {
            "claim": row["claim"], "the paper says": row["the paper says"],
            "what was computed": entry.quantity.how if entry.quantity else "–", **row,
        }
        for entry in judged if entry not in given and entry.claim.id not in but
        for row in [entry.row()]
    ]  # fmt: skip
    show_table(pd.DataFrame(rows).set_index("claim"), name=name, caption=caption)
    record.say("score.given", ", ".join(entry.claim.id for entry in given))
    record.say("score.all", str(len(judged)))
    record.say("score.verdicts", ", ".join(f"{n} {v}" for v, n in count_verdicts(judged).items()))


def show_sentences(results: Results, *, name: str) -> None:
    """Show the sentences of a chapter that rest on results, and whether each holds."""
    held = {"holds in this run": [tick(held) for held in results.sentences.values()]}
    show_table(
        pd.DataFrame(held, index=pd.Index(results.sentences, name="sentence")),
        name=name,
        caption="Sentences of this page that rest on results, bound to the conditions that make "
        "them true.",
    )


def _written(value: object) -> str:
    if isinstance(value, list):
        nested = isinstance(value[0], list)
        parts = [f"({_written(part)})" if nested else _written(part) for part in value]
        return (" " if nested else ", ").join(parts)
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def show_table(frame: pd.DataFrame, *, name: str, caption: str, fold: str = "") -> None:
    """Show a table with a caption; the book numbers it, and ``{numref}`` refers to it by its label.

    The index names the rows. Cells are written with ``str`` and may hold MyST Markdown of one line,
    as the caption may. A long table is folded behind the words of ``fold``, which a click opens.
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
    if fold:
        lines = [f"````{{dropdown}} {fold}", *lines, "````"]
    display(
        {
            "text/markdown": "\n".join(lines),
            "text/html": _LINK.sub(r"\1", _CODE.sub(r"<code>\1</code>", frame.to_html())),
            "text/plain": f"{caption}\n\n{frame.to_string()}",
        },
        metadata={"table": {"name": name, "cells": cells}},  # for the results file
        raw=True,
    )


def svg_of(fig: Figure, **options: Any) -> str:
    """Return a figure, which is closed, as SVG, the same each time; options are of its saving."""
    stream = io.StringIO()
    fig.savefig(stream, format="svg", metadata={"Date": None, "Creator": None}, **options)
    plt.close(fig)
    return stream.getvalue()


def show_figure(fig: Figure, *, name: str, caption: str, alt: str) -> None:
    """Show a figure, which is closed, with its label, caption and alternative text.

    It is the last thing that a cell does. The caption says what to see in it, in MyST Markdown; the
    alternative text what a reader who cannot see it needs: the message and its numbers. Neither may
    be empty. What tests hold it to goes along: its legend, the texts that are in the way of
    something, and the size of the smallest in points.
    """
    for what, text in (("name", name), ("caption", caption), ("alt", alt)):
        if not text.strip():
            raise ParameterError(what, text, "text that is not blank")
    seen = {
        "legend": legend_of(fig),
        "in the way": texts_in_the_way(fig),
        "points": least_points(fig),
    }
    # a hundredth of a point is nothing to see, nor is an indent
    drawn = _PATH.sub(lambda path: _FINE.sub(r"\1", path[0]), svg_of(fig))
    drawn = _INDENT.sub("\n", drawn)
    # the build moves this metadata to the cell, where the book's renderer looks for it
    display(
        {"image/svg+xml": drawn, "text/plain": alt},
        metadata={"inswsn": {"name": name, "caption": caption, "alt": alt} | seen},
        raw=True,
    )
