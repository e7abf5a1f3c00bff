"""The finished pages: what the theme leaves out for some readers is added, and all is checked.

Sphinx, the theme and MyST-NB write pages in which a screen reader cannot tell what the header of a
table belongs to, two elements share an id, and a solution opens by a script alone. What depends on
the reader's screen is in ``access.js``, and what a style can do in ``inswsn.css``.
"""

from __future__ import annotations

import json
import os
import posixpath
import re
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from bs4 import BeautifulSoup, Tag
from bs4.element import AttributeValueList

from inswsn_book.record.files import file_digest, write_whole

# What a link may name in a page, its links, and what is wrong in it
_Facts = tuple[list[str], list[str], list[str]]

_CODE = re.compile(r"<pre>(.*?)</pre>", re.DOTALL)
_HEADINGS = ["h1", "h2", "h3", "h4", "h5", "h6"]
# What a browser fetches by itself when it opens a page, as opposed to what a reader may follow.
_FETCHED = {"img": "src", "script": "src", "link": "href", "source": "src", "iframe": "src"}
_VERSION = re.compile(r"(?<=\.css)\?v=[0-9a-f]+|(?<=\.js)\?v=[0-9a-f]+")
_FOREIGN_STYLE = re.compile(r"url\(\s*['\"]?(https?:)?//|@import\s+['\"](https?:)?//")


def finish_site(site: Path, kept: Path) -> list[str]:
    """Make the pages of a site accessible, and return what is wrong with it, a sentence each.

    Checked are: every link and image inside the site leads to a file, and to an element where it
    names one; every image has an alternative text that is not its path; no page or style sheet
    takes a part of itself from another host. Images that no page shows go.

    The file `kept` has what is known of the pages that are finished already.
    """
    pages = [p for p in site.rglob("*.html") if "_static" not in p.relative_to(site).parts]
    known: dict[str, Any] = {}
    with suppress(OSError, ValueError):
        known = json.loads(kept.read_bytes())
    digests = {page: file_digest(page) for page in pages}
    due = [page for page in pages if digests[page] not in known]
    due.sort(key=lambda page: page.stat().st_size, reverse=True)  # the long ones first
    found: dict[Path, _Facts] = {p: known[d] for p, d in digests.items() if d in known}
    found |= zip(due, _rewritten(due), strict=True)
    write_whole(kept, json.dumps({file_digest(page): facts for page, facts in found.items()}))
    names: dict[str, frozenset[str] | None] = {
        path.relative_to(site).as_posix(): None for path in site.rglob("*") if path.is_file()
    }
    names |= {page.relative_to(site).as_posix(): frozenset(f[0]) for page, f in found.items()}
    problems = []
    for page, (_, links, wrong) in sorted(found.items()):
        name = page.relative_to(site).as_posix()
        own = [*wrong, *(said for link in links for said in _broken(names, name, link))]
        problems += [f"{name}: {said}" for said in own]
    for sheet in sorted(site.rglob("*.css")):
        if _FOREIGN_STYLE.search(sheet.read_text(encoding="utf-8", errors="replace")):
            problems.append(f"{sheet.relative_to(site)}: takes a part of itself from another host.")
    shown = {unquote(link.rpartition("/")[2]) for _, links, _ in found.values() for link in links}
    for image in (site / "_images").glob("*"):
        if image.name not in shown:
            image.unlink()
    return problems


def _rewritten(pages: Sequence[Path]) -> list[_Facts]:
    """Rewrite pages, many side by side."""
    if len(pages) < 4:
        return [_rewrite(page) for page in pages]
    with ProcessPoolExecutor(max_workers=min(4, os.cpu_count() or 1)) as pool:
        return list(pool.map(_rewrite, pages))


def _rewrite(path: Path) -> _Facts:
    """Rewrite a page; return what a link may name in it, its links, and what is wrong in it."""
    # Sphinx adds the digest of a file that happens to lie there already
    text = _VERSION.sub("", path.read_text(encoding="utf-8"))
    page, soup = improve(text, evidence=path.parent.name == "evidence")
    path.write_text(page, encoding="utf-8", newline="\n")
    tags = soup.find_all()
    names = {str(tag[key]) for key in ("id", "name") for tag in tags if tag.has_attr(key)}
    links, problems = [], []
    for tag in soup.find_all(["a", *_FETCHED]):
        target = tag.get(_FETCHED.get(tag.name, "href"))
        if target is None:
            continue
        parts = urlsplit(str(target))
        if not parts.scheme and not parts.netloc:
            links.append(str(target))
        elif tag.name in _FETCHED and parts.scheme != "data" and tag.get("rel") != ["canonical"]:
            problems.append(f"takes {target} from another host.")
        if tag.name == "img":
            alt = str(tag.get("alt") or "").strip()
            if not alt or alt == target or re.search(r"\.(png|svg|jpe?g)$", alt):
                problems.append(f"the image {target} has no alternative text.")
    return sorted(names), links, problems


def _broken(names: Mapping[str, frozenset[str] | None], page: str, link: str) -> Iterator[str]:
    """Tell what is wrong with a link of a page, by what may be named in each file of the site."""
    parts = urlsplit(link)
    path = posixpath.normpath(posixpath.join(posixpath.dirname(page), unquote(parts.path)))
    path = path if parts.path else page
    if path not in names:
        path = posixpath.normpath(f"{path}/index.html")
    inside = names.get(path)
    if path not in names:
        yield f"{link} leads to no file of the site."
    elif parts.fragment and inside is not None and unquote(parts.fragment) not in inside:
        yield f"{link} leads to no element of {posixpath.basename(path)}."


def improve(page: str, *, evidence: bool = False) -> tuple[str, BeautifulSoup]:
    """Return a page with what was left out, and its tree.

    Headers of tables get their scope, tables a name. Links to a heading are named by what they do.
    Solutions become native disclosures, and so do the provenance and the sections of evidence:
    what it found stands before them. Images wait until they are near the window. Of elements that
    share an id the first keeps it.
    """
    # coloured code is most of a page, and nothing in it is changed
    code = _CODE.findall(page)
    numbers = iter(range(len(code)))
    soup = BeautifulSoup(_CODE.sub(lambda _: f"<pre>{next(numbers)}</pre>", page), "html.parser")
    for table in soup.find_all("table"):
        _table(table)
    for caption in soup.select("figure:has(img[src$='.svg']) > figcaption"):
        _full_size(soup, caption)
    for solution in soup.select("div.solution.dropdown"):
        _solution(soup, solution)
    folded = "article.bd-article > section > section" if evidence else "section#provenance"
    for section in soup.select(folded):
        _fold(soup, section)
    _names(soup)
    for script in soup.select("script[src*='fontawesome.js']"):
        script.decompose()  # 1.5 MB that draw the icons that are in a font, too
    for image in soup.select("article img"):
        image["loading"] = "lazy"
    for sidebar in soup.select("#pst-primary-sidebar"):
        sidebar["role"] = "complementary"
        sidebar["aria-label"] = "Book"
    for printed in soup.select("#jb-print-docs-body"):
        if printed.h1 is not None and not printed.h1.get_text(strip=True):
            printed.decompose()  # an index has no title there
    seen: set[str] = set()
    for tag in soup.find_all(id=True):  # links lead to the first that has an id in any case
        if tag["id"] in seen:
            del tag["id"]
        else:
            seen.add(str(tag["id"]))
    return _CODE.sub(lambda match: f"<pre>{code[int(match[1])]}</pre>", str(soup)), soup


def _table(table: Tag) -> None:
    """Give the headers of a table their scope, and the table a name."""
    if {"genindextable", "indextable"} & set(table.get("class") or []):
        table["role"] = "presentation"  # an index lays out links
        for toggler in table.select("img.toggler"):
            toggler.decompose()  # it folds a list for the mouse alone
        return
    for header in table.find_all("th"):
        if not header.get_text(strip=True) and not header.find("img"):
            header.name = "td"  # an empty corner heads neither a column nor a row
            header["class"] = AttributeValueList([*(header.get("class") or []), "corner"])
        elif not header.get("scope"):
            kind, spans = ("col", "colspan") if header.find_parent("thead") else ("row", "rowspan")
            header["scope"] = kind + ("group" if int(str(header.get(spans, "1"))) > 1 else "")
    if table.find("caption") is None and not table.get("aria-label"):
        above = table.find_previous(_names_what_follows)
        if isinstance(above, Tag):
            signs = {id(text) for link in above.select("a.headerlink") for text in link.strings}
            words = "".join(text for text in above.strings if id(text) not in signs)
            table["aria-label"] = " ".join(words.split())


def _names_what_follows(tag: Tag) -> bool:
    """Tell a heading, or bold words that begin a paragraph as one would."""
    if tag.name != "strong":
        return tag.name in _HEADINGS
    block = tag.parent
    return (
        block is not None
        and block.name == "p"
        and block.find_parent("table") is None
        and (next(block.stripped_strings, "") == next(tag.stripped_strings, ""))
    )


def _full_size(soup: BeautifulSoup, caption: Tag) -> None:
    """Give a figure a link to its picture, for small screens."""
    image = caption.parent.find("img") if caption.parent is not None else None
    if isinstance(image, Tag):
        link = soup.new_tag("a", attrs={"class": "full-size", "href": str(image["src"])})
        link.string = "Full size"
        caption.append(link)


def _solution(soup: BeautifulSoup, solution: Tag) -> None:
    """Make a folded solution a native disclosure; its title links nowhere, since it opens it."""
    solution.name = "details"
    kept = [word for word in solution["class"] if word != "dropdown"]
    solution["class"] = AttributeValueList(kept)
    title = solution.find("p", class_="admonition-title")
    if isinstance(title, Tag):
        title.name = "summary"
        for link in title.find_all("a"):
            link.unwrap()
        _gather(soup, title, "solution-body")


def _gather(soup: BeautifulSoup, title: Tag, name: str) -> Tag:
    """Put all that follows a title beside it into one box of that class, and return it."""
    body = soup.new_tag("div", attrs={"class": name})
    for part in list(title.next_siblings):
        body.append(part)
    title.insert_after(body)
    return body


def _fold(soup: BeautifulSoup, section: Tag) -> None:
    """Make a section a native disclosure below its heading; links to what is in it open it."""
    heading = section.find(_HEADINGS, recursive=False)
    if not isinstance(heading, Tag):
        return
    for link in heading.find_all("a"):
        link.decompose()  # it would close the section that it leads to
    body = _gather(soup, heading, "fold-body")
    summary = heading.wrap(soup.new_tag("summary"))
    summary.wrap(soup.new_tag("details", attrs={"class": "fold"})).append(body)


def _names(soup: BeautifulSoup) -> None:
    """Name links and buttons by what they do."""
    for link in soup.find_all("a"):
        classes = list(link.get("class") or [])
        if "headerlink" in classes:
            link["aria-label"] = link.get("title") or "Link to this place"
        words = link.get_text(strip=True)
        address = link.get("href") in (words, words.replace("doi:", "https://doi.org/"))
        if address and {"reference", "external"} <= set(classes):
            # a style writes such a link once on paper
            link["class"] = AttributeValueList([*classes, "bare"])
    for summary in soup.select(".hide > summary"):
        # the name must hold the text that is seen, of which a style shows one of two
        said = summary.find("p", class_="collapsed")
        summary["aria-label"] = (said or summary).get_text(strip=True)
    for entry in soup.find_all(role="doc-biblioentry"):
        entry["role"] = "listitem"  # the other is none for this element any more
    for button in soup.select("button.sidebar-toggle"):
        button["aria-label"] = button.get("title") or "Toggle sidebar"
