"""What a kernel says while it runs a cell, as the page takes it."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass, field
from html import unescape
from typing import Any

#: How many characters of text are kept of a cell: a loop that prints has no end
MOST = 1_000_000
_LEFT_OUT = "\n… the rest is left out.\n"
_COLOUR = re.compile(r"\x1b\[[\d;]*m")
_MOVING = re.compile(
    r'<section class="moving"[^>]* data-figure="([^"]*)"[^>]*>'
    r'<script type="application/json">(.*?)</script>',
    re.DOTALL,
)


@dataclass
class Said:
    """What a cell has said by now.

    Of a figure that moves there are its name and content; of a picture its type, its content in
    base64, and what it shows in words. Other rich output is its plain text: HTML that a reader's
    code makes is never put into a page.
    """

    text: str = ""
    figures: list[tuple[str, str]] = field(default_factory=list)
    images: list[tuple[str, str, str]] = field(default_factory=list)
    needs: str = ""
    error: str = ""

    def take(self, message: dict[str, Any]) -> None:
        """Take a message of the kernel."""
        kind, content = message["header"]["msg_type"], message["content"]
        if kind == "stream":
            self._print(content["text"])
        elif kind == "error":
            self.error = _COLOUR.sub("", "\n".join(map(str.rstrip, content["traceback"]))) + "\n"
        elif kind in ("display_data", "execute_result"):
            self._show(content["data"], content["metadata"].get("inswsn", {}))

    def _print(self, text: str) -> None:
        if len(self.text) < MOST:
            self.text += text
            if len(self.text) >= MOST:
                self.text = self.text[:MOST] + _LEFT_OUT

    def _show(self, data: dict[str, str], about: dict[str, str]) -> None:
        if moving := _MOVING.search(data.get("text/html", "")):
            self.figures.append((unescape(moving[1]), moving[2]))
        elif about.get("name") in dict(self.figures):
            return  # the still picture of a figure that moves
        elif "image/svg+xml" in data:
            drawn = base64.b64encode(data["image/svg+xml"].encode()).decode()
            self.images.append(("image/svg+xml", drawn, about.get("alt", "")))
        elif "image/png" in data:
            self.images.append(("image/png", "".join(data["image/png"].split()), ""))
        elif "text/plain" in data:
            self._print(data["text/plain"] + "\n")
