"""The commands on the page of reference: those that there are, with the help that they print."""

from __future__ import annotations

import re

import pytest
from click.testing import CliRunner
from inswsn_book.cli import cli
from inswsn_book.commands import commands_text
from inswsn_book.generated import generated_texts
from inswsn_book.project import Project

NAMES = sorted(cli.commands)


def sections() -> dict[str, str]:
    """Return the help on the page by command."""
    found = re.findall(r"^### `([^`]+)`\n\n```text\n(.*?)\n```$", commands_text(), re.M | re.S)
    return dict(found)


def test_there_is_a_section_for_each_command_and_one_for_all() -> None:
    assert list(sections()) == ["inswsn", *(f"inswsn {name}" for name in NAMES)]
    assert commands_text().count("```") == 2 * (1 + len(NAMES))


@pytest.mark.parametrize("name", [None, *NAMES])
def test_the_help_is_what_the_command_prints(name: str | None) -> None:
    words = [name, "--help"] if name else ["--help"]
    printed = CliRunner().invoke(cli, words, prog_name="inswsn", terminal_width=100)
    assert printed.exit_code == 0
    assert sections()[f"inswsn {name}" if name else "inswsn"] == printed.output.rstrip("\n")


@pytest.mark.parametrize("name", NAMES)
def test_every_command_and_every_option_says_what_it_is(name: str) -> None:
    command = cli.commands[name]
    assert command.help
    silent = [
        parameter.name
        for parameter in command.params
        if parameter.param_type_name == "option" and not getattr(parameter, "help", None)
    ]
    assert silent == []


def test_the_terminal_of_the_build_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    wide = commands_text()
    monkeypatch.setenv("COLUMNS", "40")
    assert commands_text() == wide


def test_it_is_among_the_texts_that_pages_include(project: Project) -> None:
    from inswsn_book.publishing import reference_results

    results = [
        found
        for chapter in project.chapters()
        if (found := reference_results(project, chapter)) is not None
    ]
    assert generated_texts(project, results)["commands.md"] == commands_text()
    page = (project.root / "book" / "api.md").read_text(encoding="utf-8")
    assert "```{include} generated/commands.md\n```" in page
