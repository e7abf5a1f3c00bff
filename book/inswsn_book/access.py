"""A Sphinx extension: what the theme leaves out for those who do not see a page, or have no mouse.

Sphinx, the theme and MyST-NB write pages in which a screen reader cannot tell what the header of a
table belongs to, two elements share an id, and a solution opens by a script alone. This goes over
every page when all are written. What depends on the reader's screen is in ``access.js``, and what
a style can do is in ``inswsn.css``.
"""

from __future__ import annotations

import os
import re
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from bs4 import BeautifulSoup, Tag

_CODE = re.compile(r"<pre>(.*?)</pre>", re.DOTALL)
_HEADINGS = ["h1", "h2", "h3", "h4", "h5", "h6"]


def accessible(page: str) -> str:
    """Return a page with what was left out.

    Headers of tables get their scope, tables without a caption a name, and tables that only lay out
    links (the index) the role that says so. Links to a heading are named by what they do. Solutions
    become native disclosures, which open without a script and by the keyboard. Of elements that
    share an id the first keeps it. The sidebar becomes a region with a name.

    Parameters
    ----------
    page : str
        A page of HTML, as Sphinx writes it.
    """
    code: list[str] = []

    def put_aside(match: re.Match[str]) -> str:
        code.append(match[0])
        return f"<pre>{len(code) - 1}</pre>"

    # coloured code is most of a page, and nothing in it is changed
    soup = BeautifulSoup(_CODE.sub(put_aside, page), "html.parser")
    for table in soup.find_all("table"):
        _table(table)
    for solution in soup.select("div.solution.dropdown"):
        _solution(soup, solution)
    _names(soup)
    _landmarks(soup)
    _ids(soup)
    return _CODE.sub(lambda match: code[int(match[1])], str(soup))


def _table(table: Tag) -> None:
    """Give the headers of a table their scope, and the table a name."""
    if {"genindextable", "indextable"} & set(table.get("class") or []):
        table["role"] = "presentation"  # an index lays out links
        for toggler in table.select("img.toggler"):
            toggler.decompose()  # it folds a list for the mouse alone
        return
    for header in table.find_all("th"):
        if not header.get_text(strip=True) and not header.find("img"):
            _not_a_header(header)
            continue
        if not header.get("scope"):
            header["scope"] = _scope(header)
    if table.find("caption") is None and not table.get("aria-label"):
        above = table.find_previous(_names_what_follows)
        if isinstance(above, Tag):
            table["aria-label"] = _words(above)


def _scope(header: Tag) -> str:
    """Tell what a header heads: a column or a row, or several of them."""
    kind, spans = ("col", "colspan") if header.find_parent("thead") else ("row", "rowspan")
    return kind + "group" if int(str(header.get(spans, "1"))) > 1 else kind


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


def _not_a_header(cell: Tag) -> None:
    # the empty corner of a table heads neither a column nor a row
    cell.name = "td"
    cell["class"] = " ".join([*(cell.get("class") or []), "corner"])


def _words(above: Tag) -> str:
    """Return the text of a name without the sign of its link."""
    signs = {id(text) for link in above.select("a.headerlink") for text in link.strings}
    return " ".join("".join(t for t in above.strings if id(t) not in signs).split())


def _solution(soup: BeautifulSoup, solution: Tag) -> None:
    """Make a folded solution a native disclosure; its title links nowhere, since it opens it."""
    solution.name = "details"
    solution["class"] = " ".join(word for word in solution["class"] if word != "dropdown")
    title = solution.find("p", class_="admonition-title")
    if isinstance(title, Tag):
        title.name = "summary"
        for link in title.find_all("a"):
            link.unwrap()
        body = soup.new_tag("div", attrs={"class": "solution-body"})
        for part in list(title.next_siblings):
            body.append(part)
        title.insert_after(body)


def _names(soup: BeautifulSoup) -> None:
    """Name links and buttons by what they do."""
    for link in soup.find_all("a"):
        _link(link)
    # the name must hold the text that is seen, of which a style shows one of two
    for summary in soup.find_all("summary"):
        if summary.parent is not None and "hide" in _classes(summary.parent):
            said = summary.find("p", class_="collapsed")
            summary["aria-label"] = (said or summary).get_text(strip=True)
    for entry in soup.find_all(role="doc-biblioentry"):
        entry["role"] = "listitem"  # the other is none for this element any more
    for button in soup.find_all("button"):
        if "sidebar-toggle" in _classes(button):
            button["aria-label"] = button.get("title") or "Toggle sidebar"


def _link(link: Tag) -> None:
    """Name a link to a heading; mark one whose text is its address, written once on paper."""
    classes = _classes(link)
    if "headerlink" in classes:
        link["aria-label"] = link.get("title") or "Link to this place"
    if {"reference", "external"} <= set(classes) and link.get_text(strip=True) == link.get("href"):
        link["class"] = " ".join([*classes, "bare"])


def _classes(tag: Tag) -> list[str]:
    """Return a tag's classes; a tag whose class was set to a text here has them in one string."""
    classes = tag.get("class", "")
    return classes.split() if isinstance(classes, str) else list(classes or [])


def _landmarks(soup: BeautifulSoup) -> None:
    """Give all that a page shows a place in a region with a name."""
    for sidebar in soup.select("#pst-primary-sidebar"):
        sidebar["role"] = "complementary"
        sidebar["aria-label"] = "Book"
    for printed in soup.select("#jb-print-docs-body"):
        if printed.h1 is not None and not printed.h1.get_text(strip=True):
            printed.decompose()  # an index has no title there


def _ids(soup: BeautifulSoup) -> None:
    """Leave an id to the first element that has it, which is where links lead in any case."""
    seen = set()
    for tag in soup.find_all(id=True):
        if tag["id"] in seen:
            del tag["id"]
        else:
            seen.add(tag["id"])


def make_accessible(app: Any, error: Exception | None) -> None:
    """Go over every page of a finished site; a handler of Sphinx's ``build-finished``."""
    if error is not None or app.builder.format != "html":
        return
    site = Path(app.outdir)
    pages = [p for p in site.rglob("*.html") if "_static" not in p.relative_to(site).parts]
    pages.sort(key=lambda page: page.stat().st_size, reverse=True)  # the long ones first
    with ProcessPoolExecutor(max_workers=min(4, os.cpu_count() or 1)) as pool:
        list(pool.map(_rewrite, pages))


def _rewrite(path: Path) -> None:
    page = accessible(path.read_text(encoding="utf-8"))
    path.write_text(page, encoding="utf-8", newline="\n")
