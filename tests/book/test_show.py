"""How a lab gets into a page. Figures and tables are tested with the style of figures."""

from __future__ import annotations

import json

import numpy as np
import pytest
from bs4 import BeautifulSoup
from inswsn_book.show import Choice, Slider, show_lab

SLIDER = Slider("ratio", "ratio", -1.0, 1.0, 0.25, start=0.5, log=True)
CHOICE = Choice("axis", "axis", {"1": "y", "0": "x"}, start="0")
TITLE = "</script><!--<script>"  # which ends no script early


def test_a_lab_is_hidden_names_its_figure_and_holds_its_numbers(displayed: list) -> None:
    third = np.array([[1 / 3, 1e-300], [-0.1, 2**53 + 0.0]])
    shown = {"title": TITLE, "figure": "fig-x", "sliders": [SLIDER], "choices": [CHOICE]}
    show_lab("gain", **shown, data={"third": third, "n": np.int64(3)})
    ((data, metadata),) = displayed
    assert metadata == {}  # it is no figure
    (section,) = BeautifulSoup(data["text/html"], "html.parser").children
    assert (section.name, section.has_attr("hidden")) == ("section", True)
    assert (section["data-lab"], section["data-figure"]) == ("gain", "fig-x")
    assert section.script["type"] == "application/json"
    assert "<" not in section.script.string
    content = json.loads(section.script.string)
    assert content["title"] == TITLE
    assert content["data"] == {"third": third.tolist(), "n": 3}  # to the last digit
    assert content["choices"][0]["options"] == [["1", "y"], ["0", "x"]]  # in their order
    assert content["sliders"][0]["start"] == 0.5
    for value in (float("nan"), np.array([np.inf])):
        with pytest.raises(ValueError, match="not JSON compliant"):
            show_lab("gain", **shown, data={"a": value})


def test_the_places_of_a_slider() -> None:
    assert SLIDER.places.tolist() == [-1, -0.75, -0.5, -0.25, 0, 0.25, 0.5, 0.75, 1]
    np.testing.assert_allclose(SLIDER.values[[0, 4, 8]], [0.1, 1, 10], rtol=1e-15)
    assert Slider("n", "n", 1.0, 3.0, 1.0, start=1.0).values.tolist() == [1, 2, 3]
