"""A Sphinx extension: the title, the authors and the year of every page, from data/about.yaml."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from inswsn_book.about import load_about


def _set(_app: Any, config: Any) -> None:
    # the renderer runs Sphinx in the checkout; the pages themselves may lie in a copy
    about = load_about(Path.cwd())
    config.project = config.html_title = about.title
    config.author = about.shown_authors
    config.copyright = about.year


def setup(app: Any) -> dict[str, bool]:
    """Register the extension; called by Sphinx."""
    # before the handlers that work on what is set here
    app.connect("config-inited", _set, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
