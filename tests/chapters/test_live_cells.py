"""The cells of lessons with numpy alone, as in the page: they say what the built page says."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path
from typing import Any

import nbformat
import pytest
from conftest import same, weekly_but
from inswsn_book.live.measured import Measured, measure
from inswsn_book.record.project import Project
from test_lessons import LESSONS, executed

from inswsn_lib.errors import BuildError

#: How many cells of each lesson run: one that no longer does is a loss to the reader
RUN = dict(zip(LESSONS, (11, 18, 21, 21, 19, 19, 14, 17), strict=True))
#: How many of all lessons' do; ``python -m inswsn_book.make.live --count`` tells
LEAST = 125
_FIGURE = re.compile(r'data-figure="([^"]+)".*?<script type="application/json">(.*?)</script>')


def said(outputs: list[Any]) -> tuple[str, dict[str, Any]]:
    """Return the text of a cell of the built book, and the contents of its figures."""
    text = "".join(o.text for o in outputs if o.output_type == "stream")
    pages = [o.data.get("text/html", "") for o in outputs if o.output_type == "display_data"]
    found = [match for page in pages for match in _FIGURE.findall(page)]
    return text, {unescape(name): json.loads(content) for name, content in found}


@pytest.mark.parametrize("number", weekly_but({"lesson-1", "lesson-2", "lesson-3"}, LESSONS))
def test_live_cells_say_what_the_page_says(number: str, built_site: Path, project: Project) -> None:
    run = executed(project, LESSONS[number])
    cells = [c for c in nbformat.reads(run.notebook, 4).cells if c.cell_type == "code"]
    found = measure(project, LESSONS[number].stem)
    assert len(cells) == len(found)
    for place, (cell, live) in enumerate(zip(cells, found, strict=True), 1):
        if not live.needs:
            text, figures = said(cell.outputs)
            assert live.text == text, f"cell {place}"
            drawn = {name: json.loads(content) for name, content in live.figures}
            assert same(drawn, figures), f"the figure of cell {place}"
    assert sum(not live.needs for live in found) == RUN[number]


def test_most_cells_of_lessons_run_in_the_page() -> None:
    assert sum(RUN.values()) >= LEAST


@pytest.mark.parametrize(("name", "count"), [("which-filter", 5), ("your-own-data", 7)])
def test_pages_that_take_a_file_run_cells_too(name: str, count: int, project: Project) -> None:
    found = [cell.needs for cell in measure(project, name)]
    assert found.count("") == count


def test_what_is_missing_is_named(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    sources = ["import scipy.linalg", "x = scipy.linalg.inv([[1.0]])", "print(x)", "print(1)"]
    monkeypatch.setattr("inswsn_book.live.measured.sources_of", lambda *_: sources)
    needs = [each.needs for each in measure(project, "none")]
    assert needs == ["", "scipy", "scipy", ""]


def test_what_is_installed_is_not_there(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("inswsn_book.live.measured.sources_of", lambda *_: ["import pytest"])
    with pytest.raises(BuildError, match=r"(?s)Cell 1 of none fails .*No module named 'pytest'"):
        measure(project, "none")


def test_a_measured_cell_has_its_text(project: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("inswsn_book.live.measured.sources_of", lambda *_: ["1 + 1", "1 + 1;"])
    first, second = measure(project, "none")
    assert isinstance(first, Measured)
    assert (first.text, second.text) == ("2\n", "")
