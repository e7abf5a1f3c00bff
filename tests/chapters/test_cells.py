"""Cells of evidence are read: short, narrow, in order for the linter and for the type checker."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from inswsn_book.record.parameters import read_myst

LINES, COLUMNS = 25, 88
EVIDENCE = sorted(Path(__file__).parents[2].glob("chapters/evidence/[a-z]*.md"))
_OURS = "lint.isort.known-first-party=['inswsn_lib', 'inswsn_book']"
# a script has what a module has not: names at its top that change, and imports where they are used
_OF_SCRIPTS = "D,E402,I001,N816,B018"
_ONE_OF = re.compile(r"^(\w+): str = (.*?)  # 1; one of (.+)$")


def _literal(found: re.Match[str]) -> str:
    name, rest, words = found.groups()
    return f"{name}: Literal{words.split(', ')} = {rest}"


def scripts(folder: Path) -> list[Path]:
    """Write each chapter's cells as a module, whose lines have the numbers of the chapter's."""
    (folder / "chapter_cells").mkdir()
    for path in EVIDENCE:
        lines, code = [], False
        for line in path.read_text(encoding="utf-8").split("\n"):
            fence = line.startswith("```")
            code = line.startswith("```{code-cell}") or (code and not fence)
            lines.append(line if code and not fence and not line.startswith(":tags:") else "")
        name = path.stem.replace("-", "_")
        # what a parameter may be stands in its comment
        lines = [_ONE_OF.sub(_literal, line) for line in lines]
        if any(": Literal[" in line for line in lines):
            lines[0] = "from typing import Literal"  # in front of the chapter's title
        (folder / "chapter_cells" / f"{name}.py").write_text("\n".join(lines), encoding="utf-8")
    return sorted((folder / "chapter_cells").iterdir())


@pytest.mark.parametrize("path", EVIDENCE, ids=lambda path: path.stem)
def test_a_cell_is_short_and_narrow(path: Path) -> None:
    notebook = read_myst(path.read_text(encoding="utf-8"), path.stem)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    cells = [cell for cell in cells if "parameters" not in cell.metadata.get("tags", [])]
    lines = [cell.source.splitlines() for cell in cells]
    assert {len(each): each[0] for each in lines if len(each) > LINES} == {}
    assert [line for each in lines for line in each if len(line) > COLUMNS] == []


def test_the_linter_has_nothing_to_say_of_cells(root: Path, tmp_path: Path) -> None:
    words = ["--config", str(root / "pyproject.toml"), "--config", _OURS]
    words += ["--line-length", str(COLUMNS), "--ignore", _OF_SCRIPTS, "--no-cache"]
    command = [sys.executable, "-m", "ruff", "check", *words, *map(str, scripts(tmp_path))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_mypy_has_nothing_to_say_of_cells(root: Path, tmp_path: Path) -> None:
    """Functions of cells have no types of their own; what they and the cells call has."""
    scripts(tmp_path)
    looked_for = {"MYPYPATH": os.pathsep.join([str(tmp_path), str(root / "book")])}
    words = ["--allow-untyped-defs", "--allow-untyped-calls", "-p", "chapter_cells"]
    command = [sys.executable, "-m", "mypy", *words]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=root, env=os.environ | looked_for
    )
    assert done.returncode == 0, done.stdout + done.stderr
