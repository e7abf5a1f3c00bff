"""Chapters as notebooks: read from their sources, and as their runs are kept."""

from __future__ import annotations

import json

import nbformat
import pytest
from conftest import MiniProject
from inswsn_book.notebooks import read_source, strip_run

from inswsn_lib.errors import InswsnError


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
