"""The .ipynb twins: deterministic, without outputs, and equal to their sources."""

from __future__ import annotations

import json

import nbformat
import pytest
from inswsn_book.notebooks import (
    main,
    read_source,
    stale_twins,
    strip_run,
    twin_text,
    unrepeatable_outputs,
)
from inswsn_book.project import ROOT_VARIABLE, Project

from inswsn_lib.errors import InswsnError


def test_the_kept_twins_are_what_the_sources_give(project: Project) -> None:
    assert [chapter.name for chapter in stale_twins(project.chapters())] == []


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


def test_stale_twins_are_told_and_written(
    mini: Project, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(ROOT_VARIABLE, str(mini.root))
    (chapter,) = mini.chapters()
    assert stale_twins([chapter]) == [chapter]
    assert main([]) == 0
    assert stale_twins([chapter]) == []
    chapter.twin.write_text(chapter.twin.read_text().replace("float = 2.0", "float = 3.0"))
    (mini.root / "chapters" / "07-lost.ipynb").write_text("{}")
    assert main(["--check"]) == 1
    assert capsys.readouterr().out.splitlines() == [
        "chapters/00-mini.ipynb differs from its source; write it: make notebooks.",
        "chapters/07-lost.ipynb has no source.",
    ]


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
    assert "0xdeadbeef" in text  # a number is no address
    assert unrepeatable_outputs(notebook) == []


def test_strip_run_joins_the_pieces_of_what_a_cell_prints(mini: Project) -> None:
    (chapter,) = mini.chapters()
    notebook = read_source(chapter)
    cell = next(cell for cell in notebook.cells if cell.cell_type == "code")

    def printed(name: str, text: str) -> nbformat.NotebookNode:
        return nbformat.v4.new_output("stream", name=name, text=text)

    figure = nbformat.v4.new_output("display_data", data={"text/plain": "a figure"})
    cell.outputs = [
        printed("stdout", "one\n"),
        printed("stdout", "two\n"),
        printed("stderr", "careful\n"),
        printed("stdout", "three\n"),
        figure,
        printed("stdout", "four\n"),
    ]
    assert strip_run(notebook) is notebook
    assert cell.outputs == [
        printed("stdout", "one\ntwo\n"),
        printed("stderr", "careful\n"),
        printed("stdout", "three\n"),
        figure,
        printed("stdout", "four\n"),
    ]
    nbformat.validate(notebook)


def test_outputs_that_differ_from_run_to_run_are_told(mini: Project) -> None:
    (chapter,) = mini.chapters()
    notebook = read_source(chapter)
    cell = next(cell for cell in notebook.cells if cell.cell_type == "code")
    cell.outputs = [
        nbformat.v4.new_output("display_data", data={"text/plain": "<object at 0x7fd54a263b90>"}),
        nbformat.v4.new_output("stream", name="stderr", text="UserWarning: careful\n"),
        nbformat.v4.new_output("stream", name="stdout", text="fine\n"),
    ]
    assert unrepeatable_outputs(notebook) == [
        f"cell {cell['id']} shows an address in memory.",
        f"cell {cell['id']} writes to standard error: UserWarning: careful",
    ]
