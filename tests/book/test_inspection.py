"""The inspection of a rendered site, on pages made for it."""

from __future__ import annotations

from pathlib import Path

import pytest
from inswsn_book.inspection import inspect_site


def inspect(site: Path, body: str) -> list[str]:
    (site / "index.html").write_text(f"<html><body>{body}</body></html>", encoding="utf-8")
    return inspect_site(site)


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
