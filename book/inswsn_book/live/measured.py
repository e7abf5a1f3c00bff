"""What the cells of a lesson do with numpy alone: run here as they will run in the page."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from inswsn_book.live.bundle import archive
from inswsn_book.live.cells import before
from inswsn_book.record.parameters import read_myst
from inswsn_book.record.project import Project
from inswsn_lib.errors import BuildError

# in a process that sees the files of the page, numpy and the standard library
_SCRIPT = """
import json, sys
asked = json.load(sys.stdin)
sys.path[:0] = asked["path"]
from inswsn_book.live import absent
absent.block()
from inswsn_book.live import cells
lesson = cells.lesson_in_the_page()
for cell, source in enumerate(asked["sources"]):
    print(json.dumps(cells.timed(lesson, cell, source)))
"""


@dataclass(frozen=True)
class Measured:
    """What a cell did: what it needs that the page has not, how long it took, and what it said."""

    needs: str
    seconds: float
    text: str
    figures: list[tuple[str, str]]


def sources_of(project: Project, name: str) -> list[str]:
    """Return the sources of the code cells of a chapter that its page shows, by its name."""
    path = project.root / "chapters" / f"{name}.md"
    notebook = read_myst(path.read_text(encoding="utf-8"), name)
    cells = (cell for cell in notebook.cells if cell.cell_type == "code")
    return [cell.source for cell in cells if "remove-cell" not in cell.metadata.get("tags", [])]


def measure(project: Project, name: str) -> list[Measured]:
    """Run the cells of a lesson one after the other with numpy alone.

    One that needs what is not there is of no use, nor is one that needs such a cell.

    Raises
    ------
    BuildError
        If a cell fails in any other way.
    """
    sources = sources_of(project, name)
    found: list[Measured] = []
    for cell, said in enumerate(_run(project, sources)):
        needs = said["needs"]
        needs = next((found[i].needs for i in before(sources, cell) if found[i].needs), needs)
        if said["error"] and not needs:
            raise BuildError(f"Cell {cell + 1} of {name} fails with numpy alone:\n{said['error']}")
        found.append(Measured(needs, said["seconds"], said["text"], said["figures"]))
    return found


def _run(project: Project, sources: Sequence[str]) -> list[dict[str, Any]]:
    numpy = find_spec("numpy")
    assert numpy is not None
    assert numpy.origin is not None
    with TemporaryDirectory() as folder:
        zipfile.ZipFile(BytesIO(archive(project))).extractall(folder)
        for path in Path(numpy.origin).parents[1].glob("numpy*"):  # and nothing that is beside it
            Path(folder, path.name).symlink_to(path)
        asked = {"path": [folder], "sources": sources}
        threads = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS")}
        ran = subprocess.run(
            [sys.executable, "-I", "-S", "-X", "utf8", "-c", _SCRIPT],
            input=json.dumps(asked), capture_output=True, text=True, encoding="utf-8",
            env=os.environ | threads, cwd=folder, check=False,
        )  # fmt: skip
    if ran.returncode:
        raise BuildError(f"The cells could not be run with numpy alone:\n{ran.stderr}")
    return [json.loads(line) for line in ran.stdout.splitlines()]
