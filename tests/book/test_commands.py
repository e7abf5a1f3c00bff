"""The commands say what they are: what the reference of the book prints of each."""

from __future__ import annotations

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
