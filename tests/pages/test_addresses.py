"""What another page, a paper or a bookmark names of this site leads to the same content.

``tests/data/addresses.txt`` has a line for each page of an earlier site: its address, and the
places in it that were linked to. A line is never taken away.
"""

from __future__ import annotations

import json
import posixpath
import re
from functools import cache
from pathlib import Path

import pytest
from playwright.sync_api import Browser

KEPT = Path(__file__).parents[1] / "data" / "addresses.txt"
LINES = KEPT.read_text(encoding="utf-8").splitlines()
_MOVED = re.compile(
    r'replace\("([^"]+)" \+ location\.search \+ \((location\.hash.* \|\| )?"#?(.*)"\)\)'
)
_RENAMED = re.compile(r'\.replace\(/(.+?)/, "([^"]*)"\)')
_CELLS = re.compile(r"\.replace\(/cell-\.\*\$/, c => \((\{.*?\})\)")


def place_behind(site: Path, address: str, name: str = "") -> tuple[str, str]:
    """Return the page that a reader of a place of an address ends on, and the place there."""
    moved = _MOVED.search((site / address).read_text(encoding="utf-8"))
    if moved is None:
        return address, name
    page, kept, place = moved.groups()
    for old, new in _RENAMED.findall(kept or ""):
        name = re.sub(old, new, name, count=1)
    for cells in _CELLS.findall(kept or ""):
        name = json.loads(cells).get(name, name)
    name = name if kept and name else place
    return place_behind(site, posixpath.normpath(posixpath.join(address, "..", page)), name)


@cache
def places(site: Path, page: str) -> frozenset[str]:
    """Return what a link may name in a page."""
    return frozenset(re.findall(r'\sid="([^"]+)"', (site / page).read_text(encoding="utf-8")))


@pytest.mark.parametrize("line", LINES, ids=[line.split()[0] for line in LINES])
def test_every_address_of_an_earlier_site_leads_to_its_place(built_site: Path, line: str) -> None:
    address, *named = line.split()
    found = [place_behind(built_site, address, name) for name in ["", *named]]
    assert [name for page, name in found if name and name not in places(built_site, page)] == []


@pytest.mark.parametrize("depth", ["", "chapters/", "no/such/folder/"])
def test_an_address_that_is_none_leads_on_from_any_depth(
    browser: Browser, served: str, built_site: Path, depth: str
) -> None:
    page = browser.new_page()
    sent = built_site / "404.html"
    page.route("**/none.html", lambda route: route.fulfill(status=404, path=sent))
    page.goto(f"{served}{depth}none.html")
    assert "bd-article" in page.content()
    assert page.evaluate("getComputedStyle(document.body).fontFamily") != "serif"
    links = page.locator("article a").evaluate_all("(all) => all.map((link) => link.href)")
    names = [link.removeprefix(served) for link in links]
    assert {"index.html", "claims.html"} < set(names)
    assert all((built_site / name).is_file() for name in names)
    assert any(name.startswith("chapters/") for name in names)
    page.locator("article input[name=q]").fill("LMI")
    page.keyboard.press("Enter")
    page.wait_for_url(f"{served}search.html?q=LMI")
    page.close()


@pytest.mark.parametrize(
    ("address", "place"),
    [
        ("chapters/00-the-published-numbers.html#chapter-00", "printed-numbers"),
        ("chapters/evidence/02-kalman-against-h-infinity.html#fig-02-map", "fig-p1-training-map"),
        ("chapters/05-the-vehicle.html#cell-ch05-079", ""),  # by what it recorded
        ("chapters/07-drift-and-fixes.html#chapter-07", "lesson-1"),
        ("chapters/71-two-filters-become-one.html#chapter-71", "more-drift-assumed"),
        ("status.html", "status"),  # a part of another page, in which places keep their names
        ("status.html#tbl-runs", "tbl-runs"),
    ],
)
def test_a_page_that_moved_takes_its_reader_to_the_same_place(
    browser: Browser, served: str, built_site: Path, address: str, place: str
) -> None:
    page = browser.new_page()
    page.goto(f"{served}{address}")
    there, found = place_behind(built_site, *address.split("#"))
    place = place or found
    page.wait_for_url(f"{served}{there}#{place}")
    assert page.locator(f"#{place}").count() == 1
    page.close()
