"""Whether two renderings of the book show the same: the last step of `make sphinx`.

Held against each other are which pages there are, and of each page its elements that show
something, its links inside the book, and its words.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from html import unescape
from pathlib import Path

_ARTICLE = re.compile(r'<article class="bd-article".*</article>', re.DOTALL)
_SHOWN = re.compile(r'<(?:a class="reference internal|(?:details|figure|h\d|img|svg|table)\b)')
_TAG = re.compile(r"<[^>]*>")
#: Pages whose words are those of Sphinx and the theme, which may change them
_OTHERS_WORDS = {"api.html", "genindex.html", "py-modindex.html", "search.html"}


def pages(site: Path) -> dict[str, Path]:
    """Return the pages of a site by their names, without what a theme brings of its own."""
    found = {path.relative_to(site): path for path in site.rglob("*.html")}
    return {name.as_posix(): path for name, path in found.items() if name.parts[0] != "_static"}


def differences(one: Path, other: Path) -> list[str]:
    """Return in what two sites differ, a line each."""
    left, right = pages(one), pages(other)
    found = [f"{name}: in one of them alone" for name in sorted(left.keys() ^ right.keys())]
    for name in sorted(left.keys() & right.keys()):
        texts = [article(folder[name]) for folder in (left, right)]
        counts, more = (Counter(_SHOWN.findall(text)) for text in texts)
        for kind in sorted(counts.keys() | more.keys()):
            if counts[kind] != more[kind]:
                found.append(f"{name}: {counts[kind]} and {more[kind]} of {kind}")
        if name not in _OTHERS_WORDS and words(texts[0]) != words(texts[1]):
            found.append(f"{name}: {first_difference(*map(words, texts))}")
    return found


def article(page: Path) -> str:
    """Return what a page says itself, without what the theme puts around it."""
    text = page.read_text(encoding="utf-8")
    found = _ARTICLE.search(text)
    return found[0] if found else text  # a page that leads on to another has none


def words(text: str) -> str:
    """Return the words of a page, without the spaces, which depend on how it is written."""
    return "".join(unescape(_TAG.sub("", text)).split())


def first_difference(one: str, other: str) -> str:
    """Return where two texts begin to differ."""
    pairs = enumerate(zip(one, other, strict=False))
    at = next((i for i, (a, b) in pairs if a != b), min(len(one), len(other)))
    start = max(at - 30, 0)
    return f"…{one[start : at + 30]!r} and …{other[start : at + 30]!r}"


if __name__ == "__main__":
    sites = [Path(name) for name in sys.argv[1:]]
    print(f"{len(pages(sites[1]))} pages without Jupyter Book, {len(pages(sites[0]))} with it")
    sys.exit("\n".join(differences(*sites)) or None)
