"""Each command of the README runs as it is written, with fewer runs."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

README = Path(__file__).resolve().parents[1] / "README.md"
COMMANDS = re.findall(
    r"^\.venv/bin/((?:inswsn|papermill) .*)$", README.read_text(encoding="utf-8"), re.M
)
# what makes a command short, and puts what it writes into the folder of the test
SHORT = {
    "inswsn run 00": "--out out",
    "inswsn run 02": "-p runs=40 -p other_runs=40 --out out",
    "inswsn run 03": "-p runs=40 -p tuning_runs=4 -p networks=40 --out out",
    "inswsn sweep 02": "-p runs=40 -p other_runs=40 --out out",
}


def shortened(command: str) -> list[str]:
    for start, more in SHORT.items():
        if command.startswith(start):
            return shlex.split(f"{command.replace(' -p runs=1000', '')} {more}")
    return shlex.split(command)


def test_there_are_commands() -> None:
    words = {command.split()[1] for command in COMMANDS}
    assert {"chapters", "run", "sweep", "claims", "--help-notebook"} <= words
    assert all(any(c.startswith(start) for c in COMMANDS) for start in SHORT)


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md"])
def test_each_make_that_is_named_is_a_target(name: str, root: Path) -> None:
    named = re.findall(r"^make ([a-z]+)|`make ([a-z]+)`", (root / name).read_text(), re.MULTILINE)
    makefile = (root / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z]+):(?!=)", makefile, re.MULTILINE))
    assert {"book", "test"} <= {one or other for one, other in named} <= targets


@pytest.mark.long
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_runs_as_written(command: str, root: Path, tmp_path: Path) -> None:
    program, *words = shortened(command)
    words = [str(root / word) if word.startswith("chapters/") else word for word in words]
    module = {"inswsn": ["inswsn_book", "--root", str(root)], "papermill": ["papermill"]}[program]
    done = subprocess.run(
        [sys.executable, "-m", *module, *words],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        env=os.environ | {"INSWSN_ROOT": str(root), "INSWSN_RESULTS": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout or (tmp_path / "out.ipynb").is_file()
