"""How figures and tables get into a page, and figures that move."""

from __future__ import annotations

import json
import re
from itertools import combinations

import numpy as np
import pandas as pd
import pytest
from bs4 import BeautifulSoup
from inswsn_book.show import show_figure, show_table, tick
from inswsn_book.show.moving import Chart, Moving, Slider
from markdown_it import MarkdownIt
from matplotlib import pyplot as plt

from inswsn_lib.errors import ParameterError
from inswsn_lib.plotting import STROKES, figure, percent_axis


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


X = np.linspace(0, 10, 5)
TITLE = "</script><!--<script>"  # which ends no script early


@pytest.fixture
def moving() -> Moving:
    """Two sliders of two and three places, and a line that follows both."""
    made = Moving(TITLE, Slider("a", "A", [1, 2], 2), Slider("b", "B", [10, 20, 30], 20, "{:d} m"))
    chart = made.chart("Chart", x="x (s)", y="y (m)", xlim=(0, 10), ylim=(0, 100))
    made.draw(chart, "ins", "fixed", (X, X))
    made.draw(chart, "kalman", "both", lambda a, b: (X, a * b + X))
    made.draw(chart, "kalman", "", lambda b: (X, b - X, b + X), style="band")
    made.number("kalman", "product", lambda b, a: f"{a * b}")
    return made


def test_what_moves_is_a_table_over_its_own_sliders(moving: Moving) -> None:
    content = moving.content()
    fixed, both, band = content["charts"][0]["series"]
    assert (fixed["by"], len(fixed["values"])) == ((), 1)
    assert (both["by"], band["by"]) == (("a", "b"), ("b",))
    # the last slider goes fastest
    assert [values[1][0] for values in both["values"]] == [10, 20, 30, 20, 40, 60]
    assert [[v[1][1], v[2][1]] for v in band["values"]] == [[7.5, 12.5], [17.5, 22.5], [27.5, 32.5]]
    # by the order of the function's own arguments
    assert content["numbers"][0]["values"] == ["10", "20", "20", "40", "30", "60"]
    assert [slider["start"] for slider in content["sliders"]] == [1, 1]
    assert content["sliders"][1]["texts"] == ["10 m", "20 m", "30 m"]


def test_the_still_is_where_the_sliders_begin(moving: Moving) -> None:
    fig = moving.still()
    _, both = fig.axes[0].lines
    assert both.get_ydata().tolist() == (2 * 20 + X).tolist()
    assert both.get_color() == STROKES["kalman"].colour
    plt.close(fig)


def test_it_is_a_hidden_section_and_a_figure(moving: Moving, displayed: list) -> None:
    assert moving.number_each({"ins": "INS", "kalman": "KF"}, lambda m, a: f"{m} {a}")(1) == (
        "INS ins 1; KF kalman 1"
    )
    moving.sentence(lambda a: f"A product of {a}.")
    moving.show("fig-x", "See.")
    (page, _), (_, picture) = displayed
    (section,) = BeautifulSoup(page["text/html"], "html.parser").children
    assert (section.name, section["class"], section.has_attr("hidden")) == (
        "section", ["moving"], True
    )  # fmt: skip
    assert section["data-figure"] == picture["inswsn"]["name"] == "fig-x"
    assert picture["inswsn"]["alt"] == f"{TITLE}. A product of 2."
    assert "<" not in section.script.string
    assert json.loads(section.script.string)["title"] == TITLE


def test_what_may_not_be_is_refused(moving: Moving) -> None:
    chart: Chart = moving.charts[0]
    for method, style, what, said in (
        ("other", "line", (X, X), "method must be one of truth, ins"),
        ("ins", "pie", (X, X), "style must be one of line, points"),
        ("ins", "line", lambda c: (X, c), "slider must be one of a, b"),
    ):
        with pytest.raises(ParameterError, match=said):
            moving.draw(chart, method, "", what, style=style)


def luminance(colour: str) -> float:
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))


def test_every_method_has_a_stroke_of_its_own_that_is_seen() -> None:
    for one, other in combinations(STROKES, 2):
        assert STROKES[one] != STROKES[other]
    for stroke in STROKES.values():  # WCAG's contrast of text, on white
        assert 1.05 / (luminance(stroke.colour) + 0.05) >= 4.5
