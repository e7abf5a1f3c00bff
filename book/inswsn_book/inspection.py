"""Inspecting a rendered site: links, images, alternative text, and where its parts come from."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

# What a browser fetches by itself when it opens a page, as opposed to what a reader may follow.
_FETCHED = {"img": "src", "script": "src", "link": "href", "source": "src", "iframe": "src"}
_STYLE_URL = re.compile(r"url\(\s*['\"]?(https?:)?//|@import\s+['\"](https?:)?//")


def inspect_site(site: Path) -> list[str]:
    """Return all that is wrong with a site, one sentence each, empty if nothing is.

    Checked are: every link and image inside the site leads to a file, and to an element where it
    names one; every image has an alternative text that is not its path; no page or style sheet
    takes a part of itself from another host.

    Parameters
    ----------
    site : Path
        Folder of HTML pages.
    """
    problems = []
    for page in sorted(site.rglob("*.html")):
        if "_static" in page.relative_to(site).parts:
            continue
        problems += [f"{page.relative_to(site)}: {text}" for text in _inspect_page(site, page)]
    for sheet in sorted(site.rglob("*.css")):
        if _STYLE_URL.search(sheet.read_text(encoding="utf-8", errors="replace")):
            problems.append(f"{sheet.relative_to(site)}: takes a part of itself from another host.")
    return problems


def _inspect_page(site: Path, page: Path) -> list[str]:
    problems = []
    for tag in _parsed(page).tags:
        target = tag.attributes.get(_FETCHED.get(tag.name, "href"))
        if target is not None:
            problems += _inspect_target(site, page, tag, target)
        if tag.name == "img":
            alt = tag.attributes.get("alt") or ""
            if not alt.strip() or alt == target or re.search(r"\.(png|svg|jpe?g)$", alt):
                problems.append(f"the image {target} has no alternative text.")
    return problems


def _inspect_target(site: Path, page: Path, tag: _Tag, target: str) -> list[str]:
    parts = urlsplit(target)
    if parts.scheme in {"data", "mailto"}:
        return []
    if parts.scheme or parts.netloc:
        if tag.name in _FETCHED and (tag.attributes.get("rel") or "").split() != ["canonical"]:
            return [f"takes {target} from another host."]
        return []
    path = page if not parts.path else (page.parent / unquote(parts.path)).resolve()
    if path.is_dir():
        path /= "index.html"
    if not path.is_file() or not (path == page or path.is_relative_to(site.resolve())):
        return [f"{target} leads to no file of the site."]
    if (
        parts.fragment
        and path.suffix == ".html"
        and unquote(parts.fragment) not in _parsed(path).names
    ):
        return [f"{target} leads to no element of {path.name}."]
    return []


@dataclass(frozen=True)
class _Tag:
    name: str
    attributes: dict[str, str | None]


@dataclass(frozen=True)
class _Parsed:
    """What the inspection asks of a page: links and what is fetched, and what a link may name."""

    tags: list[_Tag] = field(default_factory=list)
    names: set[str] = field(default_factory=lambda: {""})


class _Parser(HTMLParser):
    """Notes tags as they begin; a tree of the whole page would take most of the time."""

    def __init__(self) -> None:
        super().__init__()
        self.found = _Parsed()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        if tag == "a" or tag in _FETCHED:
            self.found.tags.append(_Tag(tag, attributes))
        self.found.names.update(attributes.get(key) or "" for key in ("id", "name"))


@cache
def _parsed_at(page: Path, _changed: int) -> _Parsed:
    parser = _Parser()
    parser.feed(page.read_text(encoding="utf-8"))
    parser.close()
    return parser.found


def _parsed(page: Path) -> _Parsed:
    return _parsed_at(page, page.stat().st_mtime_ns)
