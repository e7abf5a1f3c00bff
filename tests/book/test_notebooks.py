"""The .ipynb twins: deterministic, without outputs, and equal to their sources."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import nbformat
import pytest
from inswsn_book.notebooks import (
    read_source,
    stale_twins,
    strip_run,
    twin_text,
)
from inswsn_book.project import ROOT_VARIABLE, Project

from inswsn_lib.errors import InswsnError


def test_the_kept_twins_are_what_the_sources_give(project: Project) -> None:
    """Otherwise: make notebooks."""
    assert [path.name for path in stale_twins(project)] == []


def test_a_twin_is_the_same_every_time_and_holds_no_output(mini: Project) -> None:
    (chapter,) = mini.chapters()
    text = twin_text(chapter)
    assert text == twin_text(chapter)
    cells = json.loads(text)["cells"]
    assert [cell["id"] for cell in cells] == [f"ch00-{i:03d}" for i in range(len(cells))]
    for cell in cells:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None
    first = next(cell for cell in cells if cell["cell_type"] == "code")
    assert first["metadata"]["tags"] == ["parameters"]


def test_stale_twins_are_told_and_written(mini: Project) -> None:
    (chapter,) = mini.chapters()
    assert stale_twins(mini) == {chapter.twin: twin_text(chapter)}
    environment = os.environ | {ROOT_VARIABLE: str(mini.root)}
    write = [sys.executable, "-m", "inswsn_book.notebooks"]
    subprocess.run(write, env=environment, check=True)
    assert stale_twins(mini) == {}
    chapter.twin.write_text(chapter.twin.read_text().replace("float = 2.0", "float = 3.0"))
    lost = mini.root / "chapters" / "07-lost.ipynb"
    lost.write_text("{}")
    assert stale_twins(mini) == {chapter.twin: twin_text(chapter), lost: None}
    subprocess.run(write, env=environment, check=True)
    assert (stale_twins(mini), lost.exists()) == ({}, False)


@pytest.mark.parametrize("change", ["no tag", "two tags"])
def test_a_chapter_has_one_parameters_cell(mini: Project, change: str) -> None:
    (chapter,) = mini.chapters()
    text = chapter.source.read_text()
    tag = ":tags: [parameters]"
    chapter.source.write_text(
        text.replace(tag, "")
        if change == "no tag"
        else text.replace("record.write()", f"{tag}\n\n1")
    )
    count = 0 if change == "no tag" else 2
    with pytest.raises(InswsnError, match=f"has {count} cells tagged parameters"):
        read_source(chapter)


def test_strip_run_leaves_no_time_and_no_path(mini: Project) -> None:
    (chapter,) = mini.chapters()
    notebook = read_source(chapter)
    notebook.metadata["papermill"] = {"start_time": "now", "input_path": "/somewhere"}
    cell = next(cell for cell in notebook.cells if cell.cell_type == "code")
    cell.metadata["papermill"] = {"duration": 1.0}
    cell.metadata["execution"] = {"iopub.execute_input": "now"}
    cell.outputs = [nbformat.v4.new_output("display_data", data={"text/plain": "0xdeadbeef"})]
    text = json.dumps(strip_run(notebook))
    for trace in ("papermill", "now", "/somewhere"):
        assert trace not in text
    assert "0xdeadbeef" in text
