"""The Sphinx extension of the book: pages are templates, and every page says whose book it is."""

from __future__ import annotations

import os
import re
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from jinja2 import TemplateError
from sphinx.util import docname_join, logging

from inswsn_book.access import finish_site
from inswsn_book.pages import ALONE, context, environment, footer
from inswsn_book.project import Project, find_root
from inswsn_book.results import read_results
from inswsn_lib.errors import InswsnError

_LOG = logging.getLogger(__name__)


def _configure(app: Any, config: Any) -> None:
    project = Project(find_root())
    about = project.about()
    config.project = config.html_title = about["title"]
    config.author = "; ".join(about["names"])
    config.copyright = about["date-released"][:4]
    config.html_theme_options["extra_footer"] = escape(footer(project))
    host = urlsplit(about["repository-code"] or "").netloc
    if host in ("github.com", "gitlab.com"):  # chapters lie here where they do in the repository
        config.html_theme_options |= {
            "repository_url": about["repository-code"],
            "repository_branch": f"v{about['version']}",
            "path_to_docs": "",
            "launch_buttons": {
                "binderhub_url": "https://mybinder.org",
                "colab_url": "https://colab.research.google.com" if host == "github.com" else "",
                "notebook_interface": "jupyterlab",
            },
        }
    site = project.site
    if os.environ.get(ALONE) and (site / "objects.inv").is_file():
        config.intersphinx_mapping = {"book": (site.as_uri(), str(site / "objects.inv"))}
        config.intersphinx_disabled_reftypes = []
    found = [read_results(path) for path in sorted(Path(app.srcdir, "generated").glob("*.json"))]
    app.inswsn_templates = environment(project.root)
    app.inswsn_context = context(project, found)


def _whole_name(app: Any, env: Any, node: Any, words: Any) -> None:
    """Give a page that is looked for in the built book its name from the root of the book."""
    if node.get("reftype") == "doc":
        node["reftarget"] = docname_join(node["refdoc"], node["reftarget"])


def _render(app: Any, page: str, source: list[str]) -> None:
    if page.startswith("chapters/"):  # an executed notebook is no template
        return
    try:
        source[0] = app.inswsn_templates.from_string(source[0]).render(app.inswsn_context)
    except (TemplateError, InswsnError) as error:
        _LOG.warning("%s", error, location=page)  # which ends the build once all pages are read
        source[0] = f"# {page}\n"


def _finish(app: Any, error: Exception | None) -> None:
    if error is None and app.builder.format == "html":
        for problem in finish_site(Path(app.outdir)):
            _LOG.warning("%s", problem)


def _skip(app: Any, what: str, name: str, member: Any, skip: bool, options: Any) -> bool | None:
    """Leave out what a class does not say of itself: fields of tuples, routing of metadata."""
    generated = type(member).__name__ == "_tuplegetter" or re.fullmatch("set_.*_request", name)
    return True if generated else None


def setup(app: Any) -> dict[str, bool]:
    """Register the extension; called by Sphinx."""
    if os.environ.get(ALONE):
        app.setup_extension("sphinx.ext.intersphinx")
        app.connect("missing-reference", _whole_name, priority=100)
    # before the handlers that work on what is set here
    app.connect("config-inited", _configure, priority=100)
    app.connect("source-read", _render)
    app.connect("autodoc-skip-member", _skip)
    app.connect("build-finished", _finish)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
