"""A Sphinx extension: below the title of each chapter, links to the services that run it.

The theme has buttons for this. They name the notebook by where the page's source stands, which is
``book/chapters/``, made by the build and in no repository; so the links are made here.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from html import escape
from typing import Any

from inswsn_book.about import About, load_about
from inswsn_book.launching import launch_addresses
from inswsn_book.project import Project

#: Set by the renderer: the services of each page, by name, as JSON.
LAUNCH_VARIABLE = "INSWSN_LAUNCH"


def launch_setting(project: Project) -> str:
    """Return the services of each chapter's page as JSON; ``{}`` while no repository is set.

    Parameters
    ----------
    project : Project
        The checkout, whose ``data/about.yaml`` may name the repository's address.

    Raises
    ------
    InswsnError
        If ``data/about.yaml`` cannot be read.
    """
    about: About = load_about(project.root)
    pages = {
        f"chapters/{chapter.name}": launch_addresses(about, f"chapters/{chapter.twin.name}")
        for chapter in project.chapters()
    }
    return json.dumps({page: found for page, found in pages.items() if found})


def with_links(body: str, services: Mapping[str, str], how: str) -> str:
    """Return the body of a page with a line of links below its title.

    Parameters
    ----------
    body : str
        HTML.
    services : mapping of str to str
        Addresses by the names of the services.
    how : str
        Address of the page that says more.
    """
    links = [f'<a href="{escape(to)}">{escape(name)}</a>' for name, to in services.items()]
    line = (
        f'<p class="launch">Run this chapter: {" · ".join(links)} · '
        f'<a href="{escape(how)}">on your own machine</a></p>'
    )
    return body.replace("</h1>", f"</h1>\n{line}", 1)


def _add(app: Any, page: str, _template: str, context: dict[str, Any], _tree: Any) -> None:
    services = json.loads(os.environ.get(LAUNCH_VARIABLE) or "{}").get(page)
    if services and "body" in context:
        how = app.builder.get_relative_uri(page, "launch")
        context["body"] = with_links(context["body"], services, how)


def setup(app: Any) -> dict[str, bool]:
    """Register the extension; called by Sphinx."""
    app.connect("html-page-context", _add)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
