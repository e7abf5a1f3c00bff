"""How a lab gets into a page."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from bs4 import BeautifulSoup
from inswsn_book.show import Choice, Slider, show_lab

SLIDER = Slider("ratio", "ratio", -1.0, 1.0, 0.25, start=0.5, log=True)
CHOICE = Choice("axis", "axis", {"1": "y", "0": "x"}, start="0")


def shown(displayed: list, **changes: Any) -> Any:
    words: dict[str, Any] = {
        "title": "A lab", "figure": "fig-x", "sliders": [SLIDER], "choices": [CHOICE], "data": {},
    }  # fmt: skip
    show_lab(changes.pop("kind", "gain"), **(words | changes))
    data, metadata = displayed.pop()
    assert metadata == {}  # it is no figure
    (section,) = BeautifulSoup(data["text/html"], "html.parser").children
    return section


def test_it_is_hidden_and_names_its_figure(displayed: list) -> None:
    section = shown(displayed)
    assert section.name == "section"
    assert section.has_attr("hidden")
    assert section["data-lab"] == "gain"
    assert section["data-figure"] == "fig-x"
    assert section.script["type"] == "application/json"


def test_the_numbers_arrive_with_all_their_digits_and_the_options_in_order(displayed: list) -> None:
    third = np.array([[1 / 3, 1e-300], [-0.1, 2**53 + 0.0]])
    content = json.loads(shown(displayed, data={"third": third, "n": np.int64(3)}).script.string)
    assert content["data"] == {"third": third.tolist(), "n": 3}
    assert content["choices"][0]["options"] == [["1", "y"], ["0", "x"]]
    assert content["sliders"][0]["start"] == 0.5


def test_no_text_ends_the_script_early(displayed: list) -> None:
    said = "</script><!--<script>"
    section = shown(displayed, title=said)
    assert json.loads(section.script.string)["title"] == said
    assert "<" not in section.script.string


@pytest.mark.parametrize("data", [{"a": float("nan")}, {"a": np.array([np.inf])}])
def test_what_is_not_finite_is_refused(displayed: list, data: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        shown(displayed, data=data)
    assert displayed == []
