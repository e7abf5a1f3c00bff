"""The book as PDF: lessons and evidence in one volume, the claims and the reference in two more.

The pages of a volume are put into one document, and Chromium prints it at once. So links from page
to page lead to places inside it, and its sheets are numbered through. The outline and the links to
other volumes are added to what it prints. What a page looks like on paper is in ``print.css``, what
concerns volumes alone in ``volume.css``.
"""

from __future__ import annotations

import os
import posixpath
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import click
from bs4 import BeautifulSoup, Tag
from playwright.sync_api import Browser, sync_playwright
from pypdf import PdfReader, PdfWriter
from pypdf.generic import (
    DictionaryObject,
    Fit,
    IndirectObject,
    NameObject,
    TextStringObject,
)

from inswsn_book.make.cli import run_command
from inswsn_book.make.site import footer, require_current_site
from inswsn_book.record.files import temporary_folder
from inswsn_book.record.project import Project, find_root
from inswsn_book.run.store import book_runs
from inswsn_lib.errors import BuildError, InswsnError
from inswsn_lib.files import read_yaml

#: What the volumes are called, by what the names of their files end in
TITLES = {
    "": "Lessons and evidence", "claims": "Claims", "reference": "Reference", "article": "Article",
}  # fmt: skip
# What is of use on a screen alone, or draws there: on paper a moving figure is its still picture.
# What a chapter was run with stands for all of them in the state of the build, on the page to cite.
_ON_SCREEN = (
    "script, section.moving, a.headerlink, a.full-size, .launch, form, "
    "section#provenance:has(table.provenance)"
)
# What the outline is made of: level, title, and the place that has a name. Glyphs of a formula are
# no text; what a screen reader is told of it is.
_OUTLINE = """[...document.querySelectorAll(".part, .page h1, .page section > h2[id]")].map((h) => [
  h.matches(".part") ? 0 : Number(h.localName[1]),
  h.textContent.trim().replace(/\\s+/g, " "),
  h.id])"""
# Makes a formula smaller that is wider than its paragraph: else the whole volume is printed smaller
_FIT = """() => {
  const blocks = "p, li, dd, dt, td, th, figcaption, caption, div";
  const shares = [...document.querySelectorAll("mjx-container")].map((formula) => [formula,
    formula.closest(blocks).clientWidth / formula.firstElementChild.getBoundingClientRect().width]);
  for (const [formula, share] of shares)
    if (share < 1) formula.style.fontSize = `calc(${formula.style.fontSize || "1em"} * ${share})`;
}"""
# Says in the table of contents on which sheet a page begins
_NUMBERS = """(sheets) => {
  for (const entry of document.querySelectorAll(".volume nav a"))
    entry.nextSibling.textContent = sheets[decodeURIComponent(entry.hash.slice(1))];
}"""
# The width of an A4 sheet between its margins, at 96 px to the inch
_WIDTH = round(180 / 25.4 * 96)
# Begins the address of a place in another volume until the volume is printed: no browser knows it
_OTHER = "volume:"


@dataclass(frozen=True)
class Volume:
    """A volume: its file, its title, and the pages of each part in their order."""

    file: str
    title: str
    parts: Sequence[tuple[str, Sequence[str]]]

    @property
    def pages(self) -> list[str]:
        """The names of all its pages."""
        return [page for _, pages in self.parts for page in pages]


def volumes(project: Project) -> list[Volume]:
    """Return the volumes of the book, as its table of contents has parts and pages.

    Chapters are in the first, the part with the page of claims is the second. The article is alone.
    """
    toc, version = read_yaml(project.root / "book" / "_toc.yml"), project.about()["version"]
    held: dict[str, list[tuple[str, list[str]]]] = {name: [] for name in TITLES}
    held[""].append(("Front page", [toc["root"]]))
    for part in toc.get("parts") or [{"caption": "Pages", "chapters": toc["chapters"]}]:
        pages = list(_listed(part["chapters"]))
        kind = "claims" if "claims" in pages else "reference"
        chapters = all(page.startswith("chapters/") for page in pages)
        held["article"] += [("Article", [page]) for page in pages if page == "article"]
        rest = [page for page in pages if page != "article"]
        held["" if chapters else kind].append((part["caption"], rest))
    return [
        Volume("-".join(filter(None, ["inswsn", version, name])) + ".pdf", TITLES[name], parts)
        for name, parts in held.items()
        if parts
    ]


def _listed(entries: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    for entry in entries:
        yield entry["file"]
        yield from _listed(entry.get("sections", []))


def write_volumes(project: Project, held: Sequence[Volume], target: Path) -> list[Path]:
    """Print volumes of the built book into a folder."""
    where = {page: volume for volume in held for page in volume.pages}
    articles = {page: _article(project.site, page) for page in where}
    # a place gets a name in a PDF if a link of the document leads to it
    named: dict[str, set[str]] = {volume.file: set() for volume in held}
    for page, article in articles.items():
        for volume, place in _lead_inside(article, page, where):
            named[volume.file].add(place)
    target.mkdir(parents=True, exist_ok=True)
    with temporary_folder(project.build) as folder, _browser() as browser:
        for volume in held:
            source, printed = folder / "volume.html", folder / volume.file
            text = _document(project, volume, articles, sorted(named[volume.file]))
            source.write_text(text, encoding="utf-8")
            _finish(printed, _print(browser, source, printed), project.about())
            printed.replace(target / volume.file)
    return [target / volume.file for volume in held]


def _article(site: Path, page: str) -> Tag:
    """Return what a page says, with names for its places that no other page has."""
    path = site / f"{page}.html"
    soup = BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser")
    article = soup.select_one("article.bd-article")
    if article is None:
        raise InswsnError(f"{path} is not a page of the book.")
    for tag in article.select(_ON_SCREEN):
        tag.decompose()
    for image in article.find_all("img"):
        del image["loading"]  # paper shows all
    for name in article.select("th code .pre"):
        name.replace_with(BeautifulSoup(str(name).replace("_", "_<wbr>"), "html.parser"))
    for tag in article.find_all(id=True):
        tag["id"] = f"{tag['id']}@{page}"
    for section in article.select("section[id]"):  # which may begin at the foot of the sheet before
        heading = section.find(["h1", "h2", "h3"], recursive=False)
        if isinstance(heading, Tag) and not heading.has_attr("id"):
            heading["id"] = str(section["id"])
            del section["id"]
    start = soup.new_tag("span", id=f"@{page}")  # in the heading: both may go on to the next sheet
    (article.select_one("h1") or article).insert(0, start)
    for folded in article.select("details:has(.cell_output)"):
        folded["open"] = ""  # what is folded is printed, but for code alone
    for image in article.find_all("img"):
        image["src"] = (path.parent / unquote(str(image["src"]))).resolve().as_uri()
    return article


def _lead_inside(
    article: Tag, page: str, where: Mapping[str, Volume]
) -> Iterator[tuple[Volume, str]]:
    """Let the links of a page lead to places of the volumes; tell those that are in another one.

    What leads to a file that is no page, such as a notebook, is plain words on paper.
    """
    for link in article.find_all("a", href=True):
        parts = urlsplit(str(link["href"]))
        if parts.scheme or parts.netloc:
            continue
        path = posixpath.normpath(posixpath.join(posixpath.dirname(page), unquote(parts.path)))
        to = path.removesuffix(".html") if parts.path else page
        if to not in where:
            link.unwrap()
            continue
        volume, place = where[to], f"{unquote(parts.fragment)}@{to}"
        if volume is where[page]:
            link["href"] = f"#{place}"
        else:
            link["href"] = f"{_OTHER}{volume.file}#{place}"
            yield volume, place


def _document(
    project: Project, volume: Volume, articles: Mapping[str, Tag], named: Sequence[str]
) -> str:
    """Return a volume as one page, with a title, its contents and all of its articles."""
    about = project.about()
    shell = BeautifulSoup((project.site / "index.html").read_text(encoding="utf-8"), "html.parser")
    head = []
    for tag in shell.select("link[rel=stylesheet], script"):
        place = "src" if tag.name == "script" else "href"
        if tag.name == "script" and "mathjax" not in f"{tag.get('src')} {tag.string}".lower():
            continue
        if tag.has_attr(place):
            tag[place] = (project.site / str(tag[place]).partition("?")[0]).as_uri()
        head.append(str(tag))
    head.append(f'<link rel="stylesheet" href="{Path(__file__).with_name("volume.css").as_uri()}">')
    contents, body, places = [], [], list(named)
    for number, (caption, pages) in enumerate(volume.parts):
        entries = "".join(
            f'<li><a href="#@{p}">{_title(articles[p])}</a><span></span></li>' for p in pages
        )
        contents.append(f"<p>{escape(caption)}</p><ul>{entries}</ul>")
        part = f'<p class="part" id="part-{number}">{escape(caption)}</p>'
        places.append(f"part-{number}")
        for page in pages:
            body.append(f'<div class="page">{part}{articles[page]}</div>')
            part = ""
            places += [str(h["id"]) for h in articles[page].select("h1[id], h2[id]")]
    links = "".join(f'<a href="#{escape(place)}"></a>' for place in places)
    alone = len(volume.pages) == 1
    return f"""<!doctype html>
<html lang="en" data-theme="light" data-mode="light">
<head><meta charset="utf-8"><title>{escape(about["title"])}: {escape(volume.title)}</title>
{"".join(head)}</head>
<body><main class="bd-main"><div class="bd-content"><div class="bd-article-container">
<header class="volume{" alone" if alone else ""}"><p class="title">{escape(about["title"])}</p>
<p class="subtitle">{escape(volume.title)}</p>
<p>{escape("; ".join(about["names"]))}</p>
<p>Version {escape(about["version"])}, {about["date-released"]}. {escape(footer(project))}
{"" if alone else "Folded code is in the notebooks."}</p>
<nav>{"" if alone else "".join(contents)}</nav><div hidden>{links}</div></header>
{"".join(body)}
</div></div></main></body></html>
"""


def _title(article: Tag) -> str:
    heading = article.find("h1")
    return escape(heading.get_text().strip()) if isinstance(heading, Tag) else ""


@contextmanager
def _browser() -> Iterator[Browser]:
    """Give Chromium without a network, as long as it is used."""
    path = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    if path is None:
        raise InswsnError("A PDF needs Chromium: apt-get install chromium-headless-shell.")
    flags = ["--disable-gpu", "--host-resolver-rules=MAP * ~NOTFOUND"]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        flags.append("--no-sandbox")  # Chromium has no sandbox for root
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=flags)
        yield browser
        browser.close()


def _print(browser: Browser, source: Path, target: Path) -> list[tuple[int, str, str]]:
    """Print a document; return its outline: the level, the title and the place of each entry."""
    sheets: dict[str, int] = {}
    failed: list[str] = []
    for _ in range(2):  # once to know the sheets; what was printed before is laid out otherwise
        page = browser.new_page(viewport={"width": _WIDTH, "height": 1000})
        page.emulate_media(media="print")
        page.set_default_timeout(0)
        page.on("requestfailed", lambda request: failed.append(request.url))
        page.goto(source.as_uri())
        page.evaluate("() => document.fonts.ready.then(() => window.MathJax.startup.promise)")
        failed.extend(
            page.evaluate("[...document.images].filter(i => !i.naturalWidth).map(i => i.src)")
        )
        if failed:
            raise BuildError(f"A PDF lacks {failed[0]}, which could not be loaded.")
        page.evaluate(_FIT)
        outline: list[tuple[int, str, str]] = page.evaluate(_OUTLINE)
        page.evaluate(_NUMBERS, sheets)
        page.pdf(path=target, format="A4", tagged=True, print_background=True)
        page.close()
        sheets = _sheets(PdfReader(target))
    return outline


def _sheets(reader: PdfReader) -> dict[str, int]:
    """Return the number of the sheet on which each place is that has a name."""
    numbers = {page.indirect_reference: n for n, page in enumerate(reader.pages, start=1)}
    places = reader.named_destinations.items()
    return {name.removeprefix("/"): numbers[place.page] for name, place in places}


def _finish(path: Path, outline: Sequence[tuple[int, str, str]], about: Mapping[str, Any]) -> None:
    """Add the outline to a volume, and let links to other volumes lead into their files."""
    writer = PdfWriter(path, incremental=True)
    above: list[IndirectObject] = []
    reader = PdfReader(path)
    places, sheets = reader.named_destinations, _sheets(reader)
    for level, title, name in outline:
        place = places[f"/{name}"]
        del above[level:]
        above.append(writer.add_outline_item(
            title=title, page_number=sheets[name] - 1, parent=above[-1] if above else None,
            fit=Fit.xyz(place.left, place.top), is_open=level == 0,
        ))  # fmt: skip
    for page in writer.pages:
        for entry in page.get("/Annots", []):
            _lead_out(entry.get_object())
    day = about["date-released"].replace("-", "")
    writer.add_metadata({
        "/Author": "; ".join(about["names"]),
        "/CreationDate": f"D:{day}",  # so that the same pages give the same file
        "/ModDate": f"D:{day}",
    })  # fmt: skip
    writer.write(path)


def _lead_out(link: DictionaryObject) -> None:
    """Let a link to another volume lead into its file, which lies beside this one."""
    address = str(link.get("/A", {}).get("/URI", ""))
    if not address.startswith(_OTHER):
        return
    file, _, name = unquote(address.removeprefix(_OTHER)).partition("#")
    link[NameObject("/A")] = DictionaryObject(
        {
            NameObject("/S"): NameObject("/GoToR"),
            NameObject("/F"): TextStringObject(file),
            NameObject("/D"): NameObject(f"/{name}"),
        }
    )


@click.command()
def main() -> None:
    """Print the built book: one PDF of lessons and evidence, one of claims, one of reference."""
    project = Project(find_root())
    with project.build_lock():
        require_current_site(project, book_runs(project))
        for path in write_volumes(project, volumes(project), project.build / "pdf"):
            click.echo(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB)")


if __name__ == "__main__":
    run_command(main)
