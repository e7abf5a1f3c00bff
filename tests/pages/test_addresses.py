"""What another page, a paper or a bookmark names of this site leads to the same content.

``tests/data/addresses.txt`` has a line for each page of an earlier site: its address, and the
places in it that were linked to. A line is never taken away.
"""

from __future__ import annotations

import posixpath
import re
from functools import cache
from pathlib import Path

import pytest
from bs4 import BeautifulSoup
from playwright.sync_api import Browser

KEPT = Path(__file__).parents[1] / "data" / "addresses.txt"
LINES = KEPT.read_text(encoding="utf-8").splitlines()
_MOVED = re.compile(r'replace\("([^"]+)" \+ location\.search \+ \((location\.hash)?.*"#?(.*)"\)\)')


@cache
def page_behind(site: Path, address: str) -> tuple[str, str, bool]:
    """Return the page that a reader of an address ends on, where, and whether always there."""
    moved = _MOVED.search((site / address).read_text(encoding="utf-8"))
    if moved is None:
        return address, "", False
    page, *further = page_behind(site, posixpath.normpath(posixpath.join(address, "..", moved[1])))
    return page, further[0] or moved[3], further[1] or not moved[2]


@cache
def places(site: Path, page: str) -> frozenset[str]:
    """Return what a link may name in a page."""
    soup = BeautifulSoup((site / page).read_text(encoding="utf-8"), "html.parser")
    return frozenset(str(tag["id"]) for tag in soup.find_all(id=True))


@pytest.mark.parametrize("line", LINES, ids=[line.split()[0] for line in LINES])
def test_every_address_of_an_earlier_site_leads_to_its_place(built_site: Path, line: str) -> None:
    address, *named = line.split()
    page, place, always = page_behind(built_site, address)
    asked = {place} - {""} | set([] if always else named)
    assert sorted(asked - places(built_site, page)) == []


@pytest.mark.parametrize(
    ("address", "place"),
    [
        ("chapters/00-the-published-numbers.html#chapter-00", "chapter-00"),
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
    target, *_ = page_behind(built_site, address.partition("#")[0])
    page.wait_for_url(f"{served}{target}#{place}")
    assert page.locator(f"#{place}").count() == 1
    page.close()
