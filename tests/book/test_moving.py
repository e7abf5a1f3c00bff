"""Figures that move: their tables, their stills, what is refused."""

from __future__ import annotations

import json
from itertools import combinations

import numpy as np
import pytest
from bs4 import BeautifulSoup
from inswsn_book.moving import Chart, Moving, Slider
from matplotlib import pyplot as plt

from inswsn_lib.errors import ParameterError
from inswsn_lib.plotting import STROKES

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
    moving.show(name="fig-x", caption="See.", alt="What it shows: 3 m.")
    (page, _), (_, picture) = displayed
    (section,) = BeautifulSoup(page["text/html"], "html.parser").children
    assert (section.name, section["class"], section.has_attr("hidden")) == (
        "section", ["moving"], True
    )  # fmt: skip
    assert section["data-figure"] == picture["inswsn"]["name"] == "fig-x"
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


def test_what_is_drawn_is_kept_to_a_ten_thousandth_of_its_axis() -> None:
    made = Moving("Digits")
    chart = made.chart("C", x="", y="", xlim=(0, 1000), ylim=(0, 0.01))
    made.draw(chart, "ins", "", ([1 / 3], [1 / 300]))
    assert made.content()["charts"][0]["series"][0]["values"] == [[[0.3], [0.003333]]]
    assert made.content()["charts"][0]["x"]["ticks"][1] == (200.0, "200")


def luminance(colour: str) -> float:
    channels = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return float(np.dot(linear, (0.2126, 0.7152, 0.0722)))


def test_every_method_has_a_stroke_of_its_own_that_is_seen() -> None:
    for one, other in combinations(STROKES, 2):
        assert STROKES[one] != STROKES[other]
    for stroke in STROKES.values():  # WCAG's contrast of text, on white
        assert 1.05 / (luminance(stroke.colour) + 0.05) >= 4.5
