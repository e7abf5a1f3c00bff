"""The commands say what they are: what the reference of the book prints of each."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from inswsn_book.cli import cli


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_every_command_and_every_option_says_what_it_is(name: str) -> None:
    command = cli.commands[name]
    assert command.help
    silent = [
        parameter.name
        for parameter in command.params
        if parameter.param_type_name == "option" and not getattr(parameter, "help", None)
    ]
    assert silent == []


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_the_example_in_the_help_of_a_command_is_one(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its words are read as the command reads them; the files that it names are there."""
    monkeypatch.chdir(tmp_path)
    example = re.search(
        r"^ *For example: inswsn (.*)$", cli.commands[name].help or "", re.MULTILINE
    )
    assert example is not None
    first, *words = shlex.split(example[1])
    assert first == name
    for word in words:
        if word.endswith(".json"):
            (tmp_path / word).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / word).touch()
    cli.commands[name].make_context(name, words)


def test_there_are_seven() -> None:
    assert sorted(cli.commands) == sorted(
        ["book", "chapters", "run", "sweep", "compare", "claims", "publish"]
    )
