"""What is added to a page for readers who do not see it, and what is looked for in a site."""

from __future__ import annotations

from pathlib import Path

import pytest
from bs4 import BeautifulSoup
from inswsn_book.access import finish_site, improve


def parsed(body: str) -> BeautifulSoup:
    return BeautifulSoup(improve(body)[0], "html.parser")


def test_headers_of_a_table_say_what_they_head() -> None:
    soup = parsed(
        "<h2>Errors<a class='headerlink' href='#x'>#</a></h2><table><thead><tr><th></th><th>m</th>"
        "</tr></thead><tbody><tr><th>HF</th><td>1</td></tr></tbody></table>"
    )
    assert [(th.get_text(), th["scope"]) for th in soup.find_all("th")] == [
        ("m", "col"),
        ("HF", "row"),
    ]
    assert soup.table is not None
    assert soup.table["aria-label"] == "Errors"


def test_a_header_of_several_columns_or_rows_heads_their_group() -> None:
    soup = parsed(
        "<h2>Errors</h2><table><thead><tr><th rowspan='2'>method</th><th colspan='2'>m</th></tr>"
        "<tr><th>x</th><th>y</th></tr></thead><tbody><tr><th rowspan='2'>HF</th><td>1</td><td>2"
        "</td></tr><tr><td>3</td><td>4</td></tr><tr><th rowspan='1'>KF</th><td>5</td><td>6</td>"
        "</tr></tbody></table>"
    )
    assert {th.get_text(): th["scope"] for th in soup.find_all("th")} == {
        "method": "col",
        "m": "colgroup",
        "x": "col",
        "y": "col",
        "HF": "rowgroup",
        "KF": "row",
    }


def test_bold_words_that_begin_a_paragraph_name_a_table_and_others_do_not() -> None:
    table = "<table><tr><th>a</th></tr></table>"
    for before, name in (
        ("<p><strong>A-1</strong> is unsaid.</p>", "A-1"),
        ("<p>It is <strong>not</strong> said.</p>", "Title"),
    ):
        soup = parsed(f"<h1>Title</h1>{before}{table}")
        assert soup.table is not None
        assert soup.table["aria-label"] == name


def test_a_caption_is_name_enough() -> None:
    soup = parsed("<h1>x</h1><table><caption>Errors</caption><tr><th>a</th></tr></table>")
    assert soup.table is not None
    assert soup.table.get("aria-label") is None


def test_a_solution_is_a_native_disclosure() -> None:
    soup = parsed(
        "<div class='solution dropdown admonition' id='s'><p class='admonition-title'>Solution to "
        "<a href='#e'>Exercise 1</a></p><section><p>It is 2.</p></section></div>"
    )
    assert soup.details is not None
    assert soup.details["id"] == "s"
    assert soup.details["class"] == ["solution", "admonition"]
    assert soup.summary is not None
    assert soup.summary.get_text() == "Solution to Exercise 1"
    assert soup.summary.find("a") is None
    assert soup.select_one("details > .solution-body > section > p") is not None


def test_an_id_stays_with_the_first_element() -> None:
    soup = parsed("<p id='a'>1</p><p id='a'>2</p><p id='b'>3</p>")
    assert [p.get("id") for p in soup.find_all("p")] == ["a", None, "b"]


def test_code_is_left_as_it_is() -> None:
    page = "<p>x</p><pre><span>a &lt; 3\n</span></pre><pre>1</pre><pre></pre>"
    assert improve(page)[0] == page


def inspect(site: Path, body: str) -> list[str]:
    (site / "index.html").write_text(f"<html><body>{body}</body></html>", encoding="utf-8")
    return finish_site(site)


@pytest.fixture
def site(tmp_path: Path) -> Path:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "page two.html").write_text('<p id="here">x</p>', encoding="utf-8")
    (tmp_path / "a.png").write_bytes(b"")
    return tmp_path


@pytest.mark.parametrize(
    "body",
    [
        '<a href="sub/page%20two.html#here">a</a>',
        '<a href="#">top</a><a href="">self</a>',
        '<a href="https://example.org/anything">out, when the reader wants to</a>',
        '<a href="mailto:someone@example.org">mail</a>',
        '<img src="a.png" alt="A picture">',
        '<img src="data:image/png;base64,AA==" alt="A picture">',
        '<link rel="canonical" href="https://example.org/">',
    ],
)
def test_what_is_in_order(site: Path, body: str) -> None:
    assert inspect(site, body) == []


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ('<a href="nothing.html">a</a>', "nothing.html leads to no file"),
        ('<a href="sub/page%20two.html#there">a</a>', "leads to no element of page two.html"),
        ('<a href="#there">a</a>', "leads to no element"),
        ('<a href="../outside.html">a</a>', "leads to no file"),
        ('<img src="a.png">', "no alternative text"),
        ('<img src="a.png" alt=" ">', "no alternative text"),
        ('<img src="a.png" alt="a.png">', "no alternative text"),
        ('<img src="a.png" alt="another.png">', "no alternative text"),
        ('<img src="b.png" alt="A picture">', "b.png leads to no file"),
        ('<script src="https://example.org/x.js"></script>', "from another host"),
        ('<link rel="stylesheet" href="//example.org/x.css">', "from another host"),
        ('<iframe src="http://example.org/"></iframe>', "from another host"),
    ],
)
def test_what_is_not(site: Path, body: str, said: str) -> None:
    (problem,) = inspect(site, body)
    assert problem.startswith("index.html: ")
    assert said in problem


def test_a_style_sheet_from_elsewhere(site: Path) -> None:
    (site / "x.css").write_text("@import url('https://example.org/font.css');", encoding="utf-8")
    assert inspect(site, "") == ["x.css: takes a part of itself from another host."]
