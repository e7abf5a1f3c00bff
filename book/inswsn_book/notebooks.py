"""The .ipynb twins of the chapters: made from the MyST sources, the same bytes every time."""

from __future__ import annotations

import re
import sys
from typing import Any

import jupytext
import nbformat

from inswsn_book.files import write_whole
from inswsn_book.parameters import notebook_schema
from inswsn_book.project import Chapter, Project, find_root
from inswsn_lib.errors import InswsnError

# as in "<object at 0x7fd54a263b90>"
_ADDRESS = re.compile(r"\bat 0x[0-9a-f]{6,}")
_KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


def read_source(chapter: Chapter) -> Any:
    """Read a chapter's source as a notebook without outputs; refuse one that is none.

    The id of a cell is the chapter's number and the cell's place, for example ``ch00-003``.
    """
    try:
        notebook = jupytext.read(chapter.source, fmt="md:myst")
    except Exception as error:  # jupytext has no error class of its own for a broken source
        said = (str(error).strip() or repr(error)).splitlines()[0]
        raise InswsnError(
            f"chapters/{chapter.source.name} is not a MyST notebook: {said}."
        ) from None
    for place, cell in enumerate(notebook.cells):
        cell["id"] = f"ch{chapter.number}-{place:03d}"
        if cell.cell_type == "code":
            cell.outputs = []
            cell.execution_count = None
    notebook_schema(notebook, chapter.source.name)
    notebook.metadata = nbformat.from_dict(
        {"kernelspec": dict(_KERNEL), "language_info": {"name": "python"}}
    )
    notebook.nbformat, notebook.nbformat_minor = 4, 5
    nbformat.validate(notebook)
    return notebook


def twin_text(chapter: Chapter) -> str:
    """Return the text of a chapter's .ipynb twin."""
    return notebook_text(read_source(chapter))


def notebook_text(notebook: Any) -> str:
    """Return a notebook as the text of an .ipynb file, with a line end at its end."""
    return str(nbformat.writes(notebook)) + "\n"


def stale_twins(chapters: list[Chapter]) -> list[Chapter]:
    """Return the chapters whose twin is absent or differs from what the source gives."""
    return [
        chapter
        for chapter in chapters
        if not chapter.twin.is_file()
        or chapter.twin.read_bytes() != twin_text(chapter).encode("utf-8")
    ]


def strip_run(notebook: Any) -> Any:
    """Remove what differs from one execution to the next: times, paths, counters.

    A kernel sends what a cell prints in pieces, whose number depends on how fast it prints: pieces
    that follow each other become one output.
    """
    notebook.metadata.pop("papermill", None)
    notebook.metadata.pop("widgets", None)
    notebook.metadata["language_info"] = {"name": "python"}
    for cell in notebook.cells:
        for key in ("papermill", "execution"):
            cell.metadata.pop(key, None)
        if cell.cell_type == "code":
            cell.outputs = _joined_streams(cell.outputs)
    return notebook


def _joined_streams(outputs: list[Any]) -> list[Any]:
    joined: list[Any] = []
    for output in outputs:
        before = joined[-1] if joined else {}
        if output.output_type == "stream" and before.get("name") == output.name:
            before["text"] += output.text
        else:
            joined.append(output)
    return joined


def unrepeatable_outputs(notebook: Any) -> list[str]:
    """Return a sentence for what does not belong on a page: warnings, and addresses in memory."""
    problems = []
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            if output.get("name") == "stderr":
                first = str(output["text"]).strip().splitlines()[-1:]
                problems.append(f"cell {cell['id']} writes to standard error: {''.join(first)}")
            shown = [output.get("text", ""), *output.get("data", {}).values()]
            if any(isinstance(text, str) and _ADDRESS.search(text) for text in shown):
                problems.append(f"cell {cell['id']} shows an address in memory.")
    return problems


def main(words: list[str]) -> int:
    """Write the twins that are stale, or with ``--check`` only tell which are."""
    project = Project(find_root())
    chapters = project.chapters()
    stale, twins = stale_twins(chapters), {chapter.twin for chapter in chapters}
    if words != ["--check"]:
        for chapter in stale:
            write_whole(chapter.twin, twin_text(chapter))
        return 0
    orphans = set((project.root / "chapters").glob("[!.]*.ipynb")) - twins
    for chapter in stale:
        print(f"chapters/{chapter.twin.name} differs from its source; write it: make notebooks.")
    for path in sorted(orphans):
        print(f"chapters/{path.name} has no source.")
    return 1 if stale or orphans else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
