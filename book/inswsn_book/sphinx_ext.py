"""The Sphinx extension of the book: pages as templates, titles, buttons, footer, accessibility."""

from __future__ import annotations

import os
from collections.abc import Iterator
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import click
from jinja2 import TemplateError
from sphinx.errors import ExtensionError
from sphinx.util import logging

from inswsn_book import pages
from inswsn_book.access import finish_site
from inswsn_book.cli import cli
from inswsn_book.project import Project
from inswsn_book.results import read_results
from inswsn_lib.errors import InswsnError

_LOG = logging.getLogger(__name__)
_HELP_WIDTH = 100  # of a line of a command's help, whatever the terminal of the build
# The hosts of repositories that the theme makes buttons for; Colab opens notebooks of the first.
_GITHUB, _GITLAB = "github.com", "gitlab.com"


def _configure(_app: Any, config: Any) -> None:
    """Set what `pages.about` knows: title, authors, year, and where notebooks can be opened."""
    # the renderer runs Sphinx in the checkout; the pages themselves lie in a copy
    about = pages.about(Project(Path.cwd()))
    config.project = config.html_title = about.title
    config.author = about.shown_authors
    config.copyright = about.year
    host = urlsplit(about.repository or "").netloc
    if host in (_GITHUB, _GITLAB):
        config.html_theme_options |= {
            "repository_url": about.repository,
            "repository_branch": f"v{about.version}",
            "launch_buttons": {
                "notebook_interface": "jupyterlab",
                "binderhub_url": "https://mybinder.org",
                "colab_url": "https://colab.research.google.com" if host == _GITHUB else "",
            },
        }


def _prepare(app: Any) -> None:
    """Compute what the templates are rendered with, once, from the staged results."""
    project = Project(Path.cwd())
    results = [read_results(path) for path in sorted(Path(app.srcdir).glob("results/*.json"))]
    app.inswsn_templates = pages.environment(project.root)
    app.inswsn_context = pages.context(project, results) | {"commands": list(commands())}


def _render(app: Any, page: str, source: list[str]) -> None:
    """Render a page; an executed chapter is none, whatever braces are in it."""
    if page.startswith("chapters/"):
        return
    try:
        source[0] = app.inswsn_templates.from_string(source[0]).render(app.inswsn_context)
    except (TemplateError, InswsnError) as error:
        raise ExtensionError(f"book/{page}.md: {error}") from None


def commands() -> Iterator[tuple[str, str]]:
    """Yield each command as it is typed, with the help that it prints; ``inswsn`` comes first."""
    top = click.Context(cli, info_name="inswsn", terminal_width=_HELP_WIDTH)
    yield "inswsn", cli.get_help(top)
    for name in cli.list_commands(top):
        command = cli.commands[name]
        own = click.Context(command, info_name=name, parent=top, terminal_width=_HELP_WIDTH)
        yield own.command_path, command.get_help(own)


def _add_footer(_app: Any, _page: str, _template: str, context: dict[str, Any], _: Any) -> None:
    context["theme_extra_footer"] = escape(os.environ.get(pages.FOOTER_VARIABLE, ""))


def _finish(app: Any, error: Exception | None) -> None:
    if error is None and app.builder.format == "html":
        for problem in finish_site(Path(app.outdir)):
            _LOG.warning(problem)


def setup(app: Any) -> dict[str, bool]:
    """Register the extension; called by Sphinx."""
    app.connect("config-inited", _configure, priority=100)  # before those who read what it sets
    app.connect("builder-inited", _prepare)
    app.connect("source-read", _render)
    app.connect("html-page-context", _add_footer)
    app.connect("build-finished", _finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
