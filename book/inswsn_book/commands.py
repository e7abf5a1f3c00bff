"""The commands of ``inswsn`` with their help, as a text that a page includes."""

from __future__ import annotations

import click

from inswsn_book.cli import cli

_WIDTH = 100  # of a line of help, whatever the terminal of the build


def commands_text() -> str:
    """Return a section for each command: the help that ``inswsn <command> --help`` prints.

    Returns
    -------
    str
        MyST Markdown. The options of ``inswsn`` itself come first, then the commands by name.
    """
    top = click.Context(cli, info_name="inswsn", terminal_width=_WIDTH)
    commands = ((name, cli.get_command(top, name)) for name in cli.list_commands(top))
    contexts = [
        click.Context(command, info_name=name, parent=top, terminal_width=_WIDTH)
        for name, command in commands
        if command is not None and not command.hidden
    ]
    return "\n".join(_section(context) for context in (top, *contexts))


def _section(context: click.Context) -> str:
    help_text = context.command.get_help(context)
    return f"### `{context.command_path}`\n\n```text\n{help_text}\n```\n"
