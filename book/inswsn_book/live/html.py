"""What `make live` writes into a page so that its cells run, and what a browser may load for it."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

#: Scripts and styles, which stand in ``_static`` of a site whose cells run; Jupyter Book would load
#: what lies in ``book/_static`` on every page
SCRIPTS = Path(__file__).with_name("page")
#: Types of script elements that are run; others hold data
_SCRIPTS = ("", "text/javascript", "application/javascript", "module")
#: What the theme's button for print does; the page of the search reads the pages that have one
_PRINT = "window.print()"


def with_cells(html: str, prefix: str, about: dict[str, Any]) -> str:
    """Return a page with the script that runs cells, and what that knows of them.

    The prefix leads from the page to the root of the site, such as ``"../"``.
    """
    # no "<" in a script element: it could end it, or begin a comment
    text = json.dumps(about, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    known = f'<script type="application/json" id="live">{text}</script>'
    parts = ["live"]
    if 'id="own-data"' in html:  # it asks what the other script offers
        parts.append("own-data")
    style = "".join(f'<link rel="stylesheet" href="{prefix}_static/{p}.css"/>\n' for p in parts)
    script = known + "".join(f'\n<script src="{prefix}_static/{p}.js"></script>' for p in parts)
    return html.replace("</head>", f"{style}</head>", 1).replace("</body>", f"{script}</body>", 1)


def with_policy(html: str, policy: str) -> str:
    """Return a page with a policy in it, since a static server sends none."""
    meta = f'<meta http-equiv="Content-Security-Policy" content="{policy}"/>'
    return html.replace("<head>", f"<head>{meta}", 1)


def policy_of(html: str) -> str:
    """Return the Content-Security-Policy of a page: it loads from its own site alone.

    Of scripts that stand in it those run that stand there now, told by their digests.
    """
    page = _Inline()
    page.feed(html)
    page.close()
    scripts = ["'self'", "'wasm-unsafe-eval'", *_digests(page.scripts)]
    scripts += ["'unsafe-hashes'", *_digests([_PRINT, *page.handlers])]
    return "; ".join([
        "default-src 'none'",
        f"script-src {' '.join(scripts)}",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data:",
        *(f"{what}-src 'self'" for what in ("font", "connect", "worker")),
        "form-action 'self'",
        *(f"{what} 'none'" for what in ("object-src", "base-uri")),
    ])  # fmt: skip


def _digests(texts: list[str]) -> Iterator[str]:
    for text in dict.fromkeys(texts):
        digest = hashlib.sha256(text.encode()).digest()
        yield f"'sha256-{base64.b64encode(digest).decode()}'"


class _Inline(HTMLParser):
    """Finds the scripts that stand in a page: in elements, and in attributes such as onclick."""

    def __init__(self) -> None:
        super().__init__()
        self.scripts: list[str] = []
        self.handlers: list[str] = []
        self._inside = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take what an element does on events, and see whether a script follows."""
        self.handlers += [value for name, value in attrs if name.startswith("on") and value]
        given = dict(attrs)
        self._inside = tag == "script" and "src" not in given
        self._inside &= (given.get("type") or "").lower() in _SCRIPTS
        if self._inside:
            self.scripts.append("")

    def handle_data(self, data: str) -> None:
        """Take what stands in a script; it may come in pieces."""
        if self._inside:
            self.scripts[-1] += data

    def handle_endtag(self, tag: str) -> None:
        """See the end of a script."""
        self._inside = False
