"""How figures and tables get into a page."""

from __future__ import annotations

import re

import pandas as pd
import pytest
from inswsn_book.show import show_figure, show_table, tick
from markdown_it import MarkdownIt

from inswsn_lib.errors import ParameterError
from inswsn_lib.plotting import figure, percent_axis


def shown_svg(displayed: list) -> tuple[str, dict]:
    fig, ax = figure(height=2)
    ax.plot([0, 1], [0, 50])
    percent_axis(ax, "y")
    show_figure(fig, name="fig-x", caption="A line.", alt="A line from 0 to 50 per cent.")
    data, metadata = displayed.pop()
    return data["image/svg+xml"], metadata["inswsn"]


def test_a_figure_carries_its_words_and_is_the_same_every_time(displayed: list) -> None:
    svg, words = shown_svg(displayed)
    said = {"name": "fig-x", "caption": "A line.", "alt": "A line from 0 to 50 per cent."}
    assert words == said | {"legend": {}, "in the way": [], "points": 10.5}
    assert svg == shown_svg(displayed)[0]


def test_a_figure_has_no_ground_of_its_own(displayed: list) -> None:
    svg, _ = shown_svg(displayed)
    patch = re.search(r'<g id="patch_1">\s*<path d="[^"]*" style="([^"]*)"', svg)
    assert patch is not None
    assert "fill: none" in patch[1]


@pytest.mark.parametrize("empty", ["name", "caption", "alt"])
def test_a_figure_without_words_is_refused(empty: str) -> None:
    words = {"name": "n", "caption": "c", "alt": "a"} | {empty: " "}
    with pytest.raises(ParameterError) as refusal:
        show_figure(figure()[0], **words)
    assert refusal.value.name == empty


def test_a_table_is_a_numbered_one_in_the_book_and_html_in_a_notebook(displayed: list) -> None:
    frame = pd.DataFrame(
        {"a": ["1.0", ""], "b": [tick(True), tick(False)]}, index=pd.Index(["x", "y"], name="row")
    )
    show_table(frame, name="tbl-x", caption="Two rows.")
    data, _ = displayed.pop()
    assert data["text/markdown"].splitlines() == [
        "```{list-table} Two rows.",
        ":name: tbl-x",
        ":header-rows: 1",
        ":stub-columns: 1",
        "",
        "* - row",
        "  - a",
        "  - b",
        "* - x",
        "  - 1.0",
        "  - yes",
        "* - y",
        "  -",
        "  - no",
        "```",
    ]
    assert "<th>x</th>" in data["text/html"]


def test_a_caption_with_code_in_it_is_a_caption(displayed: list) -> None:
    """Markdown allows no backtick on the line of a fence of backticks."""
    show_table(pd.DataFrame({"a": ["[P1](#p1) `b`"]}), name="tbl-x", caption="Of `this`.")
    data, _ = displayed.pop()
    assert "<td>P1 <code>b</code></td>" in data["text/html"]
    lines = data["text/markdown"].splitlines()
    assert (lines[0], lines[-1]) == ("~~~{list-table} Of `this`.", "~~~")
    html = MarkdownIt().render(data["text/markdown"])
    assert html.startswith('<pre><code class="language-{list-table}"')
