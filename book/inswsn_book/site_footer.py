"""A Sphinx extension: the line at the foot of every page that says what the site was built from."""

from __future__ import annotations

import os
from html import escape
from typing import Any

from inswsn_book.files import file_digest
from inswsn_book.project import Project
from inswsn_book.provenance import repository_state
from inswsn_lib import __version__

#: Set by the renderer: the line, in plain text.
FOOTER_VARIABLE = "INSWSN_FOOTER"


def footer_text(project: Project) -> str:
    """Return the line: version, commit, whether the tree was clean, and the lock's digest."""
    commit, clean = repository_state(project.root)
    state = "" if clean is None or clean else " with changes that were not committed"
    lock = file_digest(project.locks[0])
    return (
        f"Built by inswsn {__version__} from "
        + (f"commit {commit[:12]}{state}" if commit else "files that are not a git checkout")
        + f", environment.lock SHA-256 {lock[:12]}…"
    )


def _add(_app: Any, _page: str, _template: str, context: dict[str, Any], _tree: Any) -> None:
    context["theme_extra_footer"] = escape(os.environ.get(FOOTER_VARIABLE, ""))


def setup(app: Any) -> dict[str, bool]:
    """Register the extension; called by Sphinx."""
    app.connect("html-page-context", _add)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
