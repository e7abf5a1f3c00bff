"""The Sphinx extension of the book: pages are templates, and every page says whose book it is."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from jinja2 import TemplateError
from sphinx.util import logging

from inswsn_book.access import finish_site
from inswsn_book.pages import context, environment, footer
from inswsn_book.project import Project, find_root
from inswsn_book.results import read_results
from inswsn_lib.errors import InswsnError

_LOG = logging.getLogger(__name__)
# The hosts that the theme makes buttons for; Colab opens notebooks of the first alone.
_GITHUB, _GITLAB = "github.com", "gitlab.com"


def _configure(_app: Any, config: Any) -> None:
    about = Project(find_root()).about()
    config.project = config.html_title = about.title
    config.author = about.shown_authors
    config.copyright = about.released[:4]
    host = urlsplit(about.repository or "").netloc
    if host in (_GITHUB, _GITLAB):  # chapters lie here where they do in the repository
        config.html_theme_options |= {
            "repository_url": about.repository,
            "repository_branch": f"v{about.version}",
            "path_to_docs": "",
            "launch_buttons": {
                "binderhub_url": "https://mybinder.org",
                "colab_url": "https://colab.research.google.com" if host == _GITHUB else "",
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
    if page.startswith("chapters/"):  # an executed notebook is no template
        return
    try:
        source[0] = app.inswsn_templates.from_string(source[0]).render(app.inswsn_context)
    except (TemplateError, InswsnError) as error:
        _LOG.warning("%s", error, location=page)  # which ends the build once all pages are read
        source[0] = f"# {page}\n"


def _add_footer(
    app: Any, _page: str, _template: str, page_context: dict[str, Any], _tree: Any
) -> None:
    page_context["theme_extra_footer"] = app.inswsn_footer


def _finish(app: Any, error: Exception | None) -> None:
    if error is None and app.builder.format == "html":
        for problem in finish_site(Path(app.outdir)):
            _LOG.warning("%s", problem)


def setup(app: Any) -> dict[str, bool]:
    """Register the extension; called by Sphinx."""
    # before the handlers that work on what is set here
    app.connect("config-inited", _configure, priority=100)
    app.connect("builder-inited", _prepare)
    app.connect("source-read", _render)
    app.connect("html-page-context", _add_footer)
    app.connect("build-finished", _finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
