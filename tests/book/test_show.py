"""How a lab gets into a page. Figures and tables are tested with the style of figures."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from bs4 import BeautifulSoup
from inswsn_book.show import Choice, Slider, show_lab

SLIDER = Slider("ratio", "ratio", -1.0, 1.0, 0.25, start=0.5, log=True)
CHOICE = Choice("axis", "axis", {"1": "y", "0": "x"}, start="0")


def shown(displayed: list, title: str = "A lab", **data: Any) -> Any:
    show_lab("gain", title=title, figure="fig-x", sliders=[SLIDER], choices=[CHOICE], data=data)
    data, metadata = displayed.pop()
    assert metadata == {}  # it is no figure
    (section,) = BeautifulSoup(data["text/html"], "html.parser").children
    return section


def test_it_is_hidden_names_its_figure_and_holds_its_numbers_to_the_last_digit(
    displayed: list,
) -> None:
    third = np.array([[1 / 3, 1e-300], [-0.1, 2**53 + 0.0]])
    section = shown(displayed, third=third, n=np.int64(3))
    assert (section.name, section.has_attr("hidden")) == ("section", True)
    assert (section["data-lab"], section["data-figure"]) == ("gain", "fig-x")
    assert section.script["type"] == "application/json"
    content = json.loads(section.script.string)
    assert content["data"] == {"third": third.tolist(), "n": 3}
    assert content["choices"][0]["options"] == [["1", "y"], ["0", "x"]]  # in their order
    assert content["sliders"][0]["start"] == 0.5


def test_the_places_of_a_slider() -> None:
    assert SLIDER.places.tolist() == [-1, -0.75, -0.5, -0.25, 0, 0.25, 0.5, 0.75, 1]
    np.testing.assert_allclose(SLIDER.values[[0, 4, 8]], [0.1, 1, 10], rtol=1e-15)
    plain = Slider("n", "n", 1.0, 3.0, 1.0, start=1.0)
    assert plain.values.tolist() == [1, 2, 3]


def test_no_text_ends_the_script_early(displayed: list) -> None:
    said = "</script><!--<script>"
    section = shown(displayed, title=said)
    assert json.loads(section.script.string)["title"] == said
    assert "<" not in section.script.string


@pytest.mark.parametrize("value", [float("nan"), np.array([np.inf])])
def test_what_is_not_finite_is_refused(displayed: list, value: object) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        shown(displayed, a=value)
    assert displayed == []
