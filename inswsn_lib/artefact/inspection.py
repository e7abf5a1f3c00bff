"""Inspecting a rendered site: links, images, alternative text, and where its parts come from."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from urllib.parse import unquote, urlsplit

from bs4 import BeautifulSoup, Tag

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
    soup = _parsed(page)
    problems = []
    for tag in soup.find_all(["a", *_FETCHED]):
        assert isinstance(tag, Tag)
        target = tag.get(_FETCHED.get(tag.name, "href"))
        if isinstance(target, str):
            problems += _inspect_target(site, page, tag, target)
        if tag.name == "img":
            alt = str(tag.get("alt") or "")
            if not alt.strip() or alt == target or re.search(r"\.(png|svg|jpe?g)$", alt):
                problems.append(f"the image {target} has no alternative text.")
    return problems


def _inspect_target(site: Path, page: Path, tag: Tag, target: str) -> list[str]:
    parts = urlsplit(target)
    if parts.scheme in {"data", "mailto"}:
        return []
    if parts.scheme or parts.netloc:
        if tag.name in _FETCHED and tag.get("rel") != ["canonical"]:
            return [f"takes {target} from another host."]
        return []
    path = page if not parts.path else (page.parent / unquote(parts.path)).resolve()
    if path.is_dir():
        path /= "index.html"
    if not path.is_file() or not (path == page or path.is_relative_to(site.resolve())):
        return [f"{target} leads to no file of the site."]
    if parts.fragment and path.suffix == ".html" and unquote(parts.fragment) not in _names(path):
        return [f"{target} leads to no element of {path.name}."]
    return []


@cache
def _parsed_at(page: Path, _changed: int) -> BeautifulSoup:
    return BeautifulSoup(page.read_text(encoding="utf-8"), "html.parser")


def _parsed(page: Path) -> BeautifulSoup:
    return _parsed_at(page, page.stat().st_mtime_ns)


def _names(page: Path) -> frozenset[str]:
    """Return all that a fragment may name on a page."""
    return _names_at(page, page.stat().st_mtime_ns)


@cache
def _names_at(page: Path, changed: int) -> frozenset[str]:
    found = {""}
    for tag in _parsed_at(page, changed).find_all(True):
        assert isinstance(tag, Tag)
        for attribute in ("id", "name"):
            if isinstance(value := tag.get(attribute), str):
                found.add(value)
    return frozenset(found)
