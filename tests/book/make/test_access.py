"""What is added to a page for readers who do not see it, off its styles, and looked for in it."""

from __future__ import annotations

from pathlib import Path

import pydata_sphinx_theme
import pytest
from bs4 import BeautifulSoup
from fontTools.ttLib import TTFont
from inswsn_book.make.access import finish_site, improve
from inswsn_book.make.slim import classes_of, slim

TABLE = "<table><thead><tr><th>m</th></tr></thead><tbody><tr><th>HF</th></tr></tbody></table>"


def improved(body: str) -> BeautifulSoup:
    return BeautifulSoup(improve(body)[0], "html.parser")


def test_headers_of_a_table_say_what_they_head() -> None:
    soup = improved(
        "<table><thead><tr><th></th><th rowspan='2'>method</th><th colspan='2'>m</th></tr><tr>"
        "<th>x</th></tr></thead><tbody><tr><th rowspan='2'>HF</th><td>1</td></tr><tr><td>3</td>"
        "</tr><tr><th rowspan='1'>KF</th><td>5</td></tr></tbody></table>"
    )
    # an empty corner heads neither a column nor a row
    assert {th.get_text(): th["scope"] for th in soup.find_all("th")} == {
        "method": "col", "m": "colgroup", "x": "col", "HF": "rowgroup", "KF": "row",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("before", "name"),
    [
        ("<h2>Errors<a class='headerlink' href='#x'>#</a></h2>", "Errors"),
        ("<h1>Title</h1><p><strong>A-1</strong> is unsaid.</p>", "A-1"),
        ("<h1>Title</h1><p>It is <strong>not</strong> said.</p>", "Title"),
    ],
)
def test_a_table_is_named_by_the_words_above_it(before: str, name: str) -> None:
    assert improved(before + TABLE).find("table")["aria-label"] == name
    captioned = TABLE.replace("<thead>", "<caption>Errors</caption><thead>")
    assert "aria-label" not in str(improved(before + captioned).find("table"))


def test_an_index_is_no_table_of_data() -> None:
    soup = improved(f"<h1>Index</h1>{TABLE.replace('<table', '<table class=indextable')}")
    assert str(soup.find("table")).startswith('<table class="indextable" role="presentation">')
    assert "scope" not in str(soup)


def test_a_solution_is_a_native_disclosure() -> None:
    soup = improved(
        "<div class='solution dropdown admonition' id='s'><p class='admonition-title'>Solution to "
        "<a href='#e'>Exercise 1</a></p><section><p>It is 2.</p></section></div>"
    )
    assert str(soup) == (
        '<details class="solution admonition" id="s"><summary class="admonition-title">Solution to '
        'Exercise 1</summary><div class="solution-body"><section><p>It is 2.</p></section></div>'
        "</details>"
    )


def test_links_and_folds_are_named_by_what_they_do() -> None:
    soup = improved(
        "<a class='headerlink' href='#x' title='Link to this heading'>#</a>"
        "<a class='reference external' href='https://a.org'>https://a.org</a>"
        "<a class='reference external' href='https://doi.org/10.1/a'>doi:10.1/a</a>"
        "<details class='hide'><summary><p class='collapsed'>Show code</p><p>Hide</p></summary>"
        "</details>"
    )
    heading, address, identifier = soup.find_all("a")
    assert heading["aria-label"] == "Link to this heading"
    assert address["class"] == identifier["class"] == ["reference", "external", "bare"]
    assert soup.find("summary")["aria-label"] == "Show code"


def test_an_id_stays_with_the_first_element_and_code_as_it_is() -> None:
    soup = improved("<p id='a'>1</p><p id='a'>2</p><p id='b'>3</p>")
    assert [p.get("id") for p in soup.find_all("p")] == ["a", None, "b"]
    page = "<p>x</p><pre><span>a &lt; 3\n</span></pre><pre>1</pre><pre></pre>"
    assert improve(page)[0] == page


IN_ORDER = """\
<a href="sub/page%20two.html#here">a</a> <a href="#">top</a> <a href="">self</a>
<a href="https://example.org/anything">out, when the reader wants to</a>
<a href="mailto:someone@example.org">mail</a> <img src="a.png" alt="A picture">
<img src="data:image/png;base64,AA==" alt="A picture">
<link rel="canonical" href="https://example.org/">"""
FAULTS = {
    '<a href="nothing.html">a</a>': "nothing.html leads to no file",
    '<a href="sub/page%20two.html#there">a</a>': "leads to no element of page two.html",
    '<a href="#there">a</a>': "leads to no element",
    '<a href="../outside.html">a</a>': "leads to no file",
    '<img src="a.png">': "no alternative text",
    '<img src="a.png" alt=" ">': "no alternative text",
    '<img src="a.png" alt="a.png">': "no alternative text",
    '<img src="a.png" alt="another.png">': "no alternative text",
    '<img src="b.png" alt="A picture">': "b.png leads to no file",
    '<script src="https://example.org/x.js"></script>': "from another host",
    '<link rel="stylesheet" href="//example.org/x.css">': "from another host",
    '<iframe src="http://example.org/"></iframe>': "from another host",
}


def test_each_fault_of_a_site_is_told_by_its_page(tmp_path: Path) -> None:
    site = tmp_path / "site"
    (site / "sub").mkdir(parents=True)
    (site / "a.png").touch()
    (tmp_path / "outside.html").touch()
    (site / "sub" / "page two.html").write_text('<p id="here">x</p>', encoding="utf-8")
    (site / "index.html").write_text(IN_ORDER, encoding="utf-8")
    (site / "own.css").write_text("p { background: url(a.png) }", encoding="utf-8")
    assert finish_site(site, tmp_path / "kept") == []
    for i, fault in enumerate(FAULTS):
        (site / f"fault-{i:02d}.html").write_text(fault, encoding="utf-8")
    (site / "x.css").write_text("@import url('https://example.org/font.css');", encoding="utf-8")
    *told, sheet = finish_site(site, tmp_path / "kept")
    assert sheet == "x.css: takes a part of itself from another host."
    for i, (said, problem) in enumerate(zip(FAULTS.values(), told, strict=True)):
        assert problem.startswith(f"fault-{i:02d}.html: ")
        assert said in problem


THEME = Path(pydata_sphinx_theme.__file__).parent / "theme" / "pydata_sphinx_theme" / "static"


def slimmed(tmp_path: Path, sheet: str, page: str, script: str = "") -> str:
    (tmp_path / "_static").mkdir(exist_ok=True)
    (tmp_path / "_static" / "a.css").write_text(sheet)
    (tmp_path / "_static" / "a.js").write_text(script)
    slim(tmp_path, classes_of(page))
    return (tmp_path / "_static" / "a.css").read_text()


def test_a_rule_stays_for_what_is_in_a_page_or_a_script(tmp_path: Path) -> None:
    sheet = (
        "/*! by x.org, MIT */@charset 'a';p{a:b}.in,.out{a:b}.out>p{a:b}.moved{a:b}/* .out{} */"
        "@media print{.out{a:b}.in{a:b}}@media screen{.out{a:b}}p:not(.out){a:b}.a\\:b{a:b}"
    )
    assert slimmed(tmp_path, sheet, '<p class="in x">', 'add("moved")') == (
        "/*! by x.org, MIT */@charset 'a';p{a:b}.in{a:b}.moved{a:b}"
        "@media print{.in{a:b}}p:not(.out){a:b}.a\\:b{a:b}"
    )


def test_icons_are_those_that_the_styles_name(tmp_path: Path) -> None:
    fonts = tmp_path / "_static" / "vendor" / "fontawesome" / "webfonts"
    fonts.mkdir(parents=True)
    for name in ("fa-solid-900.ttf", "fa-brands-400.woff2"):
        source = THEME / "vendor" / "fontawesome" / "webfonts" / name
        (fonts / name).write_bytes(source.read_bytes())
    face = "@font-face{font-family:X;src:url(../vendor/fontawesome/webfonts/fa-solid-900.woff2)}"
    sheet = face + face.replace("solid-9", "brands-4")
    sheet += '.used{content:"\\f0c9"}.no{content:"\\f001"}'
    text = slimmed(tmp_path, sheet, '<p class="used">')
    assert text.count("@font-face") == 1
    assert 'fa-solid-900.woff) format("woff")' in text
    assert [path.name for path in fonts.iterdir()] == ["fa-solid-900.woff"]
    assert set(TTFont(fonts / "fa-solid-900.woff").getBestCmap()) == {0xF0C9}
