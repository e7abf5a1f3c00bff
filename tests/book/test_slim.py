"""Style sheets and icons of a site hold what its pages use."""

from __future__ import annotations

from pathlib import Path

import pydata_sphinx_theme
from fontTools.ttLib import TTFont
from inswsn_book.slim import classes_of, slim

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
