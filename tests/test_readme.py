"""Each command of the README is one; the short ones run as they are written, weekly all do."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
from conftest import weekly_but
from inswsn_book.make.chapters import chapter_with, gather_parameters
from inswsn_book.make.cli import cli
from inswsn_book.make.sweep import read_sweep
from inswsn_book.record.project import Project
from inswsn_book.run.cores import asked_schema

README = Path(__file__).resolve().parents[1] / "README.md"
COMMANDS = re.findall(
    r"^\.venv/bin/((?:inswsn|papermill) .*)$", README.read_text(encoding="utf-8"), re.M
)
# what makes a command short, and puts what it writes into the folder of the test
SHORT = {
    "inswsn run printed-numbers": "--out out",
    "inswsn run 2": "--out out",
    "inswsn run p1-training": "--out out",
    "inswsn run p1-outages": "-p runs=40 -p tuning_runs=4 -p networks=40 --out out",
    "inswsn sweep p1-training": "-p runs=40 -p other_runs=40 --out out",
}
# they take a quarter of a minute and more, even so
LONG = ("inswsn run 2", "inswsn run p1-", "inswsn sweep", "papermill chapters")


def started(command: str, starts: tuple[str, ...]) -> str | None:
    return next((start for start in starts if command.startswith(start)), None)


def test_there_are_commands() -> None:
    words = {command.split()[1] for command in COMMANDS}
    assert {"chapters", "run", "sweep", "claims", "--help-notebook"} <= words
    assert all(any(c.startswith(start) for c in COMMANDS) for start in (*SHORT, *LONG))


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md"])
def test_each_make_that_is_named_is_a_target(name: str, root: Path) -> None:
    named = re.findall(r"^make ([a-z]+)|`make ([a-z]+)`", (root / name).read_text(), re.MULTILINE)
    makefile = (root / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z]+):(?!=)", makefile, re.MULTILINE))
    assert {"book", "test"} <= {one or other for one, other in named} <= targets


@pytest.mark.parametrize("command", [c for c in COMMANDS if c.startswith("inswsn")])
def test_the_words_of_a_command_are_taken(command: str, project: Project) -> None:
    """By the command line, and as parameters by the chapter that they name."""
    _, name, *words = shlex.split(command)
    given = cli.commands[name].make_context(name, words).params
    if name in ("run", "sweep"):
        chapter, settings = project.find(given["name"]), given["settings"]
        names = [setting.partition("=")[0] for setting in settings]
        schema = asked_schema(project.root, chapter_with(project, chapter, names), names)
        assert gather_parameters(schema, settings, None, project.root / "data")
        assert name == "run" or read_sweep(project, chapter, given["axes"], settings).places
    with pytest.raises(click.UsageError):
        cli.commands[name].make_context(name, [*words, "--no-such-option"])


@pytest.mark.long
@pytest.mark.parametrize(
    "command", weekly_but((c for c in COMMANDS if not started(c, LONG)), COMMANDS)
)
def test_a_command_runs_as_written(command: str, root: Path, tmp_path: Path) -> None:
    more = SHORT.get(started(command, tuple(SHORT)) or "", "")
    program, *words = shlex.split(f"{command.replace(' -p runs=400', '')} {more}")
    words = [str(root / word) if word.startswith("chapters/") else word for word in words]
    module = {"inswsn": ["inswsn_book", "--root", str(root)], "papermill": ["papermill"]}[program]
    done = subprocess.run(
        [sys.executable, "-m", *module, *words],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        env=os.environ | {"INSWSN_ROOT": str(root), "INSWSN_RESULTS": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout or (tmp_path / "out.ipynb").is_file()
