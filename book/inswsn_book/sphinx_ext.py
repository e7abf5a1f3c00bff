"""The Sphinx extension of the book: pages are templates, and every page says whose book it is."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any

from inswsn_book.access import make_accessible
from inswsn_book.pages import context, environment, footer
from inswsn_book.project import Project, find_root
from inswsn_book.results import read_results


def _configure(_app: Any, config: Any) -> None:
    about = Project(find_root()).about()
    config.project = config.html_title = about.title
    config.author = about.shown_authors
    config.copyright = about.released[:4]
    if about.repository:  # the theme's own buttons: chapters lie here where they do in it
        config.html_theme_options |= {
            "repository_url": about.repository,
            "repository_branch": f"v{about.version}",
            "path_to_docs": "",
            "launch_buttons": {
                "binderhub_url": "https://mybinder.org",
                "colab_url": "https://colab.research.google.com",
                "notebook_interface": "jupyterlab",
            },
        }


def _prepare(app: Any) -> None:
    project = Project(find_root())
    found = [read_results(path) for path in sorted(Path(app.srcdir, "generated").glob("*.json"))]
    app.inswsn_footer = escape(footer(project))
    app.inswsn_templates = environment(project.root)
    app.inswsn_context = context(project, found)


def _render(app: Any, page: str, source: list[str]) -> None:
    if not page.startswith("chapters/"):  # an executed notebook is no template
        source[0] = app.inswsn_templates.from_string(source[0]).render(app.inswsn_context)


def _add_footer(
    app: Any, _page: str, _template: str, page_context: dict[str, Any], _tree: Any
) -> None:
    page_context["theme_extra_footer"] = app.inswsn_footer


def setup(app: Any) -> dict[str, bool]:
    """Register the extension; called by Sphinx."""
    # before the handlers that work on what is set here
    app.connect("config-inited", _configure, priority=100)
    app.connect("builder-inited", _prepare)
    app.connect("source-read", _render)
    app.connect("html-page-context", _add_footer)
    app.connect("build-finished", make_accessible)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
