"""The command line: help, examples, and mistakes that are told in one sentence with status 2."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
from conftest import Command, MiniProject, files_of, run_command
from inswsn_book.make.cli import cli
from made_results import results

import inswsn_lib
from inswsn_lib.errors import BuildError

COMMANDS = [
    *("book", "chapters", "claims", "compare", "judge"),
    *("publish", "run", "suggest", "sweep", "verify"),
]


def test_help_and_version_need_no_checkout(tmp_path: Path) -> None:
    module = [sys.executable, "-m", "inswsn_book"]
    for word, said in (("--help", COMMANDS), ("--version", [inswsn_lib.__version__])):
        done = subprocess.run(
            [*module, word], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        assert all(each in done.stdout for each in said)
    assert sorted(cli.commands) == COMMANDS


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_says_what_it_is_and_its_example_is_one(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The words of the example are read as the command reads them; its files are there."""
    monkeypatch.chdir(tmp_path)
    command = cli.commands[name]
    options = [each for each in command.params if isinstance(each, click.Option)]
    assert [each.name for each in options if not each.help] == []
    example = re.search(r"^ *For example: inswsn (.*)$", command.help or "", re.MULTILINE)
    first, *words = shlex.split(example[1])
    assert first == name
    for word in words:
        if word.endswith(".json"):
            (tmp_path / word).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / word).touch()
    command.make_context(name, words)


MISTAKES = {
    "boook": "No such command 'boook'",
    "--root nowhere book": "--root must be the folder of a checkout of inswsn, not 'nowhere'.",
    "book --jobs 0": "--jobs",
    "judge nowhere.py:Mine somewhere": "name must be ",
    "publish": "Chapter 00 has not been built as it is now; build it first: make book.",
    "claims --verdict maybe": "--verdict must be one of reproduced, ",
    "claims --kind x": "--kind must be one of numeric, parameter, ",
    "claims --paper P4": "--paper must be one of P1, P2, P3, not 'P4'.",
    "claims --results nowhere": "nowhere",
    "claims --results chapters": "by chapter 00, of which there are no results.",
    "claims --against other.json --json": "without an ID, --paper, --kind, --verdict and --json",
    "run 00 -f /dev/zero": "/dev/zero is not a regular file.",
    "compare /dev/zero empty.json": "/dev/zero is not a regular file.",
    "compare empty.json other.json": "two runs of one chapter can be compared",
    "compare empty.json newer.json": "is not a results file of this version: schema_version",
    "run 00 -p seed=7": "parameter must be one of scale, not 'seed'.",
    "run 00 -p scale=two": "scale must be a number in (0, 100], not 'two'.",
    "run 00 -p scale": "-p must be of the form name=value, not 'scale'.",
    "run 00 -p scale=1 -p scale=2": "-p must be given only once for scale, not twice.",
    "run 07": "NAME must be one of 00, not '07'.",
    "run 00 --out data": "--out must be a new or empty folder, or one that holds only an",
    "run 00 -f own/parameters.yml --out own": "only an unchanged earlier run",
    "sweep 00": "Missing option '--grid'.",
    "sweep 00 --runs 100": "No such option",
    "sweep 00 --grid scale=1 --out data": "--out must be a new or empty folder, or",
    "sweep 00 --grid scale=1 --dask tcp://127.0.0.1:1": "of a Dask scheduler that answers, not ",
    "sweep 00 --grid scale=1 --dask nowhere --jobs 2": "--jobs must be left out",
    "sweep 00 --grid scale=1 --jobs 0": "--jobs",
}


@pytest.fixture
def checkout(mini: MiniProject) -> MiniProject:
    """The small project, with some files that a user may name."""
    empty = results()
    for name, text in {
        "empty": empty.model_dump_json(),
        "other": empty.model_copy(update={"chapter": "01"}).model_dump_json(),
        "newer": empty.model_dump_json().replace('"schema_version":5', '"schema_version":99'),
    }.items():
        (mini.root / f"{name}.json").write_text(text, encoding="utf-8")
    (mini.root / "own").mkdir()
    (mini.root / "own" / "parameters.yml").write_text("scale: 3\n", encoding="utf-8")
    return mini


def test_a_mistake_is_one_sentence_and_nothing_runs(checkout: MiniProject, inswsn: Command) -> None:
    before = files_of(checkout.root)
    for words, said in MISTAKES.items():
        done = inswsn(checkout.root, *words.split())
        assert done.returncode == 2, words
        assert done.stdout == "", words
        sentence = done.stderr.splitlines()[-1]
        assert said in sentence, words
        assert sentence.startswith(("inswsn: ", "Error: ")), words  # by click, below how it is used
    assert files_of(checkout.root) == before


def test_a_checkout_is_found_and_has_no_library_itself(mini: MiniProject, tmp_path: Path) -> None:
    """As processes: where the command is called counts."""
    module = [sys.executable, "-m", "inswsn_book", "chapters"]
    done = subprocess.run(module, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        f"inswsn: {tmp_path} is not in a checkout of inswsn: go into one, or name it with --root.\n"
    )
    (mini.root / "inswsn_lib").mkdir()
    done = run_command(mini.root, "book")
    assert done.returncode == 2
    assert "has a library of its own" in done.stderr


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (BuildError("It broke."), 1, "It broke."),
        (PermissionError(13, "Permission denied", "a/b"), 2, "cannot read or write a/b: Permission "
         "denied."),
        (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"), 2,
         "a text file of the checkout is not UTF-8: invalid start byte."),
        (KeyboardInterrupt(15), 143, "stopped."),
        (KeyboardInterrupt(), 130, "stopped."),
    ],
)  # fmt: skip
def test_how_a_command_ends(
    mini: MiniProject,
    inswsn: Command,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    status: int,
    said: str,
) -> None:
    def fail(_: object) -> None:
        raise error

    monkeypatch.setattr("inswsn_book.run.compare.changes_to_publish", fail)
    done = inswsn(mini.root, "publish")
    assert (done.returncode, done.stdout, done.stderr.strip()) == (status, "", f"inswsn: {said}")


def test_chapters_lists_their_parameters(mini: MiniProject, inswsn: Command) -> None:
    assert inswsn(mini.root, "chapters").stdout.splitlines() == [
        "00-mini", "    scale = 2.0; a number in (0, 100]",
        "        What the number is multiplied by.",
    ]  # fmt: skip
