"""The .ipynb twins: deterministic, without outputs, and equal to their sources."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import nbformat
import pytest
from conftest import MiniProject
from inswsn_book.notebooks import notebook_text, read_source, stale_twins, strip_run
from inswsn_book.project import ROOT_VARIABLE, Project

from inswsn_lib.errors import InswsnError


def test_the_kept_twins_are_what_the_sources_give(project: Project) -> None:
    stale = [path.name for path in stale_twins(project)]
    assert not stale, "They are not what their sources give: make notebooks"


def test_a_twin_holds_no_output_and_is_written_where_it_is_stale(mini: MiniProject) -> None:
    (chapter,) = mini.chapters()
    text, lost = notebook_text(read_source(chapter)), mini.root / "chapters" / "07-lost.ipynb"
    cells = json.loads(text)["cells"]
    assert [cell["id"] for cell in cells] == [f"ch00-{i:03d}" for i in range(len(cells))]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all((cell["outputs"], cell["execution_count"]) == ([], None) for cell in code)
    assert code[0]["metadata"]["tags"] == ["parameters"]
    assert stale_twins(mini) == {chapter.twin: text}
    chapter.twin.write_text(text.replace("float = 2.0", "float = 3.0"))
    lost.write_text("{}")
    assert stale_twins(mini) == {chapter.twin: text, lost: None}
    write = [sys.executable, "-m", "inswsn_book.notebooks"]
    subprocess.run(write, env=os.environ | {ROOT_VARIABLE: str(mini.root)}, check=True)
    assert (stale_twins(mini), lost.exists()) == ({}, False)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (":tags: [parameters]", "", "has 0 cells tagged parameters"),
        ("record.write()", ":tags: [parameters]\n\n1", "has 2 cells tagged parameters"),
        ("{text_representation", "[", "is not a MyST notebook"),
    ],
)
def test_what_is_no_chapter_is_refused(mini: MiniProject, old: str, new: str, said: str) -> None:
    mini.source.write_text(mini.source.read_text().replace(old, new))
    with pytest.raises(InswsnError, match=said):
        read_source(mini.chapters()[0])


def test_a_stripped_run_has_no_time_and_no_path(mini: MiniProject) -> None:
    notebook = read_source(mini.chapters()[0])
    notebook.metadata["papermill"] = {"start_time": "now", "input_path": "/somewhere"}
    cell = next(cell for cell in notebook.cells if cell.cell_type == "code")
    cell.metadata |= {"papermill": {"duration": 1.0}, "execution": {"iopub.execute_input": "now"}}
    cell.outputs = [nbformat.v4.new_output("display_data", data={"text/plain": "kept"})]
    text = json.dumps(strip_run(notebook))
    words = ("papermill", "now", "/somewhere", "kept")
    assert [word in text for word in words] == [False, False, False, True]
