"""Whether a command finds the same in other surroundings: locale, paths, settings of Python.

Whatever they are, it ends right, or with one sentence and a status of 1 or 2; never by a traceback.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click import unstyle
from inswsn_book.record.files import damages
from inswsn_book.record.project import Project
from inswsn_book.record.results import read_results

FOREIGN = "raise SystemExit('a module of the reader was loaded')\n"
# A variable and what it may be; {own} is a folder with modules of the reader, and a kernel
VARIABLES = {
    "LC_ALL": ["C", "POSIX", "tr_TR.UTF-8", "nonsense"],
    "LANG": ["C", "de_DE.ISO-8859-1"],
    "TZ": ["Asia/Kathmandu", "nonsense"],
    "HOME": ["/dev/null/home", "", None],
    "TMPDIR": ["/nowhere", "{own}/tmp dir"],
    "PATH": ["", None],
    "COLUMNS": ["12"],
    "TERM": ["dumb"],
    "FORCE_COLOR": ["1"],
    "OMP_NUM_THREADS": ["7"],
    "PYTHONPATH": ["{own}"],
    "PYTHONHASHSEED": ["1", "random"],
    "PYTHONWARNINGS": ["error", "error::DeprecationWarning"],
    "PYTHONOPTIMIZE": ["2"],
    "PYTHONUTF8": ["0"],
    "PYTHONIOENCODING": ["ascii"],
    "PYTHONSTARTUP": ["{own}/numpy.py"],
    "JUPYTER_PATH": ["{own}"],
    "JUPYTER_RUNTIME_DIR": ["/dev/null/runtime"],
    "JUPYTER_CONFIG_DIR": ["{own}"],
    "IPYTHONDIR": ["{own}"],
    "MPLBACKEND": ["nonsense"],
    "MPLCONFIGDIR": ["{own}"],
    "MATPLOTLIBRC": ["{own}/matplotlibrc"],
}
PLACES = ["here", "with spaces", "ä ö 日本", "a#b%41", "it's", "x" * 90]


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A folder with modules called as those of others, and a kernel called as that of the book."""
    folder = tmp_path / "own"
    kernel = folder / "kernels" / "python3" / "kernel.json"
    kernel.parent.mkdir(parents=True)
    said = {"argv": ["/nowhere/python"], "display_name": "Another", "language": "python"}
    kernel.write_text(json.dumps(said))
    for name in ("numpy", "click", "yaml", "rich", "papermill"):
        (folder / f"{name}.py").write_text(FOREIGN)
    for name in ("jupyter_config.py", "matplotlibrc", "profile_default/startup/00-own.py"):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(FOREIGN)
    (folder / "tmp dir").mkdir()
    return folder


@pytest.mark.long
def test_other_surroundings(
    built_mini: Path,
    own: Path,
    tmp_path: Path,
    size: Callable[[int, int], int],
    seed: int,
    tell: Callable[[str], None],
    what_stays: Callable[[Project], list[object]],
) -> None:
    chance, began, ends = random.Random(seed), time.monotonic(), Counter[str]()
    stays, wrong = what_stays(Project(built_mini)), []
    for case in range(number := size(1, 50)):
        place = tmp_path / f"{case}" / chance.choice(PLACES)
        project = Project(shutil.copytree(built_mini, place))
        if blocked := chance.random() < 0.1:  # where results should go lies a file
            shutil.rmtree(project.results)
            project.results.write_text("in the way")
        words = chance.choice([["book", "--fresh"], ["run", "00", "--fresh"]])
        environment: dict[str, Any] = dict(os.environ)
        changed = {
            name: value and value.format(own=own)
            for name in chance.sample(sorted(VARIABLES), chance.randint(1, 4))
            for value in [chance.choice(VARIABLES[name])]
        }
        environment |= changed
        done = subprocess.run(
            [sys.executable, "-m", "inswsn_book", "--root", str(place), *words], check=False,
            env={name: value for name, value in environment.items() if value is not None},
            cwd=chance.choice([place, own]), umask=chance.choice([0o22, 0o77, 0]),
            capture_output=True, timeout=300,
        )  # fmt: skip
        said = unstyle((done.stdout + done.stderr).decode(errors="replace"))
        ends[f"{done.returncode}"] += 1
        right = "Traceback" not in said and "a module of the reader" not in said
        if blocked and words[0] == "book":
            right &= done.returncode == 2 and "\ninswsn: cannot read or write" in said
        elif words[0] == "book":
            right &= done.returncode == 0 and what_stays(project) == stays
        else:
            right &= done.returncode == 0
            right &= [*map(_as_it_should_be, project.root.glob("runs/*"))] == [True]
        if not right:
            wrong.append(f"{words} at {place.name}, {changed}: {done.returncode}, {said[-600:]}")
    assert wrong == []
    tell(
        f"{number} of {number} surroundings: {ends['0']} ended as at home, {ends['2']} with one "
        f"sentence, none by a traceback, in {time.monotonic() - began:.0f} s"
    )


def _as_it_should_be(folder: Path) -> bool:
    return not damages(folder) and read_results(folder / "00.json")["twice"].value == 42
