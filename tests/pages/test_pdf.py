"""The volumes that are printed: each beside the pages that it is made of.

Every test looks at a few pages in two volumes; the weekly run prints the whole book as well.
"""

from __future__ import annotations

import posixpath
import re
import unicodedata
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from bs4 import BeautifulSoup, Tag
from inswsn_book.make.volumes import Volume, volumes, write_volumes
from inswsn_book.record.project import Project
from pypdf import PageObject, PdfReader

pytestmark = pytest.mark.page

# pictures that move, a table, numbers, formulas, what is folded, and a page that others name
FEW = [
    Volume("few.pdf", "Few", [
        ("Front page", ["index"]),
        ("Lessons", ["chapters/1-drift-and-fixes"]),
        ("Evidence", ["chapters/evidence/61-the-column-that-slipped"]),
    ]),
    Volume("few-reference.pdf", "Reference", [("Reference", ["notation"])]),
]  # fmt: skip
# what is not printed, or is none of the page's own words
LEFT_OUT = "section.moving, a.headerlink, a.full-size, form, #provenance:has(table.provenance)"


def plain(text: str) -> str:
    """Return a text without what a printer changes: spaces, ligatures, hyphens at ends of lines."""
    text = re.sub("[\\s­‐-]", "", text)
    return re.sub("\\s", "", unicodedata.normalize("NFKC", text))


@dataclass
class Printed:
    """A volume as it was printed, and its pages as they are in the site."""

    volume: Volume
    path: Path
    site: Path

    @cached_property
    def reader(self) -> PdfReader:
        return PdfReader(self.path)

    @cached_property
    def articles(self) -> dict[str, Tag]:
        found = {}
        for page in self.volume.pages:
            soup = BeautifulSoup((self.site / f"{page}.html").read_text("utf-8"), "html.parser")
            article = soup.select_one("article.bd-article")
            for tag in article.select(LEFT_OUT):
                tag.decompose()
            found[page] = article
        return found

    @cached_property
    def sheets(self) -> list[str]:
        return [sheet.extract_text() for sheet in self.reader.pages]

    @cached_property
    def places(self) -> dict[str, int]:
        """The sheet of each place that has a name."""
        found = self.reader.named_destinations.items()
        return {name.removeprefix("/"): self.sheet_of[place.page.idnum] for name, place in found}

    @cached_property
    def sheet_of(self) -> dict[int, int]:
        """The sheet of each page object."""
        return {page.indirect_reference.idnum: n for n, page in enumerate(self.reader.pages)}

    @cached_property
    def links(self) -> list[dict[str, Any]]:
        annotations = [a.get_object() for p in self.reader.pages for a in p.get("/Annots", [])]
        return [a for a in annotations if a["/Subtype"] == "/Link"]

    @cached_property
    def outline(self) -> list[tuple[int, str, int]]:
        """Level, title and sheet of each entry."""
        return list(self._entries(self.reader.outline, 0))

    def _entries(self, entries: Any, level: int) -> Iterator[tuple[int, str, int]]:
        for entry in entries:
            if isinstance(entry, list):
                yield from self._entries(entry, level + 1)
            else:
                yield level, entry.title, self.sheet_of[entry.page.idnum]


@pytest.fixture(scope="module", params=["few", pytest.param("all", marks=pytest.mark.whole)])
def printed(
    request: pytest.FixtureRequest,
    project: Project,
    built_site: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> list[Printed]:
    if request.param == "few":  # the whole book does not go without Chromium
        request.getfixturevalue("chromium")
    held = FEW if request.param == "few" else volumes(project)
    folder = tmp_path_factory.mktemp("pdf")
    with ThreadPoolExecutor(1) as pool:  # in this thread other tests have a browser
        paths = pool.submit(write_volumes, project, held, folder).result()
    return [Printed(v, path, built_site) for v, path in zip(held, paths, strict=True)]


def test_the_volumes_hold_every_page_once(project: Project) -> None:
    toc = (project.root / "book" / "_toc.yml").read_text(encoding="utf-8")
    listed = re.findall(r"(?:root|file): (\S+)", toc)
    held = volumes(project)
    assert sorted(page for volume in held for page in volume.pages) == sorted(listed)
    for volume in held:
        assert volume.pages == [page for page in listed if page in volume.pages]
    first, claims, reference, article = held
    assert {page.partition("/")[0] for page in first.pages} == {"index", "chapters"}
    assert ("claims" in claims.pages, article.pages) == (True, ["article"])
    assert {"api", "notation", "bibliography"} <= {*reference.pages}


def test_every_figure_is_printed_with_its_words(printed: list[Printed]) -> None:
    for one in printed:
        told = [str(i["alt"]) for a in one.articles.values() for i in a.select("img")]
        assert pictures(one.reader) == told
        # and is numbered as on its page, as tables are, also those that are folded there
        numbers = [plain(c.get_text()) for a in one.articles.values()
                   for c in a.select(":is(figcaption, caption) .caption-number")]  # fmt: skip
        text = plain("".join(one.sheets))
        assert [number for number in numbers if number not in text] == []
    assert sum(len(pictures(one.reader)) for one in printed) > 3


def pictures(reader: PdfReader) -> list[str]:
    """Return what is told of each picture of a PDF to a reader that cannot see it, in order."""
    found, due = [], [reader.root_object["/StructTreeRoot"]]
    while due:
        element = due.pop()
        element = element.get_object() if element is not None else None
        if not isinstance(element, dict):  # it is the number of what is drawn
            continue
        if element.get("/S") == "/Figure" and "/Alt" in element:
            found.append(str(element["/Alt"]))
        below = element.get("/K")
        due += reversed(below if isinstance(below, list) else [below])
    return found


def test_every_link_leads_somewhere(printed: list[Printed]) -> None:
    by_file = {one.volume.file: one for one in printed}
    where = {page: one for one in printed for page in one.volume.pages}
    for one in printed:
        inside, outside = set[str](), set[str]()
        told = {str(a["href"]).rstrip("/") for each in one.articles.values() for a in each("a")
                if a.has_attr("href")}  # fmt: skip
        for link in one.links:
            action = link.get("/A", {})
            if "/Dest" in link:
                inside.add(str(link["/Dest"]).removeprefix("/"))
            elif action["/S"] == "/GoToR":
                place = str(action["/D"]).removeprefix("/")
                assert place in by_file[action["/F"]].places
                outside.add(place)
            else:
                address = urlsplit(action["/URI"])
                assert address.scheme in ("http", "https", "mailto"), address
                # what a page itself tells its reader to open is such an address, too
                assert address.hostname not in ("localhost", "127.0.0.1") or (
                    address.geturl().rstrip("/") in told
                ), address
        assert inside <= one.places.keys()
        assert {*one.places.values()} <= {*range(len(one.sheets))}
        # those of the pages are all there
        for page, article in one.articles.items():
            for place in led_to(page, article):
                other = where.get(place.partition("@")[2])
                if other is not None:
                    assert place in (inside if other is one else outside), (page, place)


def led_to(page: str, article: Tag) -> Iterator[str]:
    """Return the places to which links of a page lead that have words."""
    for link in article.find_all("a", href=True):
        parts = urlsplit(str(link["href"]))
        path = posixpath.normpath(posixpath.join(posixpath.dirname(page), parts.path))
        if not parts.scheme and link.get_text(strip=True):
            to = path.removesuffix(".html") if parts.path else page
            yield f"{parts.fragment}@{to}"


def test_the_outline_is_the_table_of_contents(printed: list[Printed]) -> None:
    for one in printed:
        titles = [plain(a.h1.get_text()) for a in one.articles.values() if a.h1]
        assert [plain(title) for level, title, _ in one.outline if level == 1] == titles
        parts = [part for part, _ in one.volume.parts]
        assert [title for level, title, _ in one.outline if level == 0] == parts
        assert {level for level, _, _ in one.outline} == {0, 1, 2}
        sheets = [sheet for _, _, sheet in one.outline]
        assert sheets == sorted(sheets)
        for _, title, sheet in one.outline:
            for word in re.findall("[A-Za-z]{4,}", title):
                assert word in plain(one.sheets[sheet]), (title, sheet)


def test_the_table_of_contents_tells_the_sheet_of_each_page(printed: list[Printed]) -> None:
    several = [one for one in printed if len(one.volume.pages) > 1]
    assert several
    for one in several:
        begins = {page: one.places[f"@{page}"] for page in one.volume.pages}
        contents = plain("".join(one.sheets[: min(begins.values())]))
        for page, article in one.articles.items():
            title = plain(article.h1.get_text())
            assert f"{title}{begins[page] + 1}" in contents, page
            assert title in plain(one.sheets[begins[page]]), page


def test_sheets_are_numbered_and_none_is_half_empty_before_a_part_ends(
    printed: list[Printed],
) -> None:
    for one in printed:
        ends = {sheet for level, _, sheet in one.outline if level == 0} | {len(one.sheets)}
        for number, sheet in enumerate(one.reader.pages, start=1):
            assert one.sheets[number - 1].partition("\n")[0] == str(number)
            _, lowest, *_ = sorted(heights(sheet))  # below the words stands the number
            assert lowest < float(sheet.mediabox.height) / 2 or number in ends, number


def heights(sheet: PageObject) -> list[float]:
    """Return how high each piece of text stands on a sheet, in points."""
    found: list[float] = []

    def see(text: str, to_page: list[float], to_text: list[float], *_: Any) -> None:
        if text.strip():
            found.append(to_page[3] * to_text[5] + to_page[5])

    sheet.extract_text(visitor_text=see)
    return found


def stands_on(sheets: list[str], words: str) -> bool:
    """Whether words stand on a sheet, or begin on one and end on the next."""
    return any(words in sheet for sheet in sheets) or any(
        words[:cut] in one and words[cut:] in other
        for one, other in pairwise(sheets)
        if words[:8] in one
        for cut in range(8, len(words))
    )


def test_numbers_are_those_of_the_pages(printed: list[Printed]) -> None:
    count = 0
    for one in printed:
        sheets = [plain(sheet.partition("\n")[2]) for sheet in one.sheets]
        for page, article in one.articles.items():
            for paragraph in article.select("p:has(.pasted-text)"):
                # a formula is drawn, and an address is written behind its link
                if not paragraph.select(".math, a.external"):
                    count += len(paragraph.select(".pasted-text"))
                    words = plain(paragraph.get_text())
                    assert stands_on(sheets, words), (page, paragraph.get_text())
    assert count > 5
