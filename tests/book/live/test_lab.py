"""Chapters in JupyterLab: the widget that draws their figures, what records again, the copies."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from conftest import MiniProject
from inswsn_book import record
from inswsn_book.lab.__main__ import copy_chapters
from inswsn_book.lab.kernel import begin
from inswsn_book.record.notebooks import notebook_text, read_source
from inswsn_book.record.project import ROOT_VARIABLE
from inswsn_book.show import moving
from inswsn_book.show.moving import Moving, Slider
from traitlets import HasTraits

WIDGET = "inswsn_book.lab.widget"


@pytest.fixture
def _kernel(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Take back what the beginning of a kernel has changed."""
    monkeypatch.setattr(moving, "_TAKERS", [])
    monkeypatch.setattr(record, "ChapterRecord", record.ChapterRecord)
    sys.modules.pop(WIDGET, None)
    yield
    sys.modules.pop(WIDGET, None)


def figure() -> Moving:
    made = Moving("<b>", Slider("a", "A", [1, 2], 1))
    chart = made.chart("Chart", x="x", y="y", xlim=(0, 1), ylim=(0, 2))
    made.draw(chart, "ins", "", lambda a: ([0, 1], [0, a]))
    return made


@pytest.mark.usefixtures("_kernel")
def test_a_figure_is_a_widget_with_the_script_and_the_tables_of_the_page(
    monkeypatch: pytest.MonkeyPatch, displayed: list[Any], root: Any
) -> None:
    figure().show("fig-x", "See.")
    monkeypatch.setitem(sys.modules, "anywidget", SimpleNamespace(AnyWidget=HasTraits))
    begin()
    shown: list[Any] = []
    monkeypatch.setattr(f"{WIDGET}.display", shown.append)
    figure().show("fig-x", "See.")
    (page, _), _still = displayed  # of the first alone
    (widget,) = shown
    assert widget.name == "fig-x"
    assert widget.content.replace("<", "\\u003c") in page["text/html"]
    assert json.loads(widget.content)["title"] == "<b>"
    assert all(widget.traits()[name].metadata["sync"] for name in ("name", "content"))
    static = root / "book" / "_static"
    assert widget._esm.startswith((static / "moving.js").read_text(encoding="utf-8"))
    assert widget._css.startswith((static / "moving.css").read_text(encoding="utf-8"))


@pytest.mark.usefixtures("_kernel")
def test_without_anywidget_it_is_a_still_picture(
    monkeypatch: pytest.MonkeyPatch, displayed: list[Any]
) -> None:
    monkeypatch.setitem(sys.modules, "anywidget", None)
    begin()
    figure().show("fig-x", "See.")
    assert "image/svg+xml" in displayed[1][0]


@pytest.mark.usefixtures("_kernel", "displayed")
def test_a_cell_that_records_runs_again_and_says_what_is_untrue(
    mini: MiniProject, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "anywidget", None)
    monkeypatch.setenv(ROOT_VARIABLE, str(mini.root))
    begin()
    made = record.ChapterRecord("00", {"scale": 2.0})
    for value in (1, 2):
        made.note("length", value, "m", "The length, as it was said.")
        made.holds("It is so.", value == 2)
    assert made.results()["length"].value == 2
    assert made.results().sentences == {"It is so.": True}
    assert capsys.readouterr().out == "No longer true: It is so.\n"


def test_a_copy_that_is_there_stays(mini: MiniProject) -> None:
    (chapter,) = mini.chapters()
    chapter.twin.write_text(notebook_text(read_source(chapter)), encoding="utf-8")
    copy = mini.root / "runs" / "lab" / "00-mini.ipynb"
    for text in (chapter.twin.read_text(encoding="utf-8"), "of the reader"):
        copy_chapters(mini, copy.parent)
        assert copy.read_text(encoding="utf-8") == text
        copy.write_text("of the reader", encoding="utf-8")
