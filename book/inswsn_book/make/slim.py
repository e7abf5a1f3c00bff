"""The weight of a site: of the theme's styles and icons, what the pages use.

The theme brings 1.5 MB of icons that a script draws, and rules for all that Bootstrap knows.
"""

from __future__ import annotations

import re
from collections.abc import Set
from pathlib import Path

from fontTools.subset import Options, Subsetter, load_font, save_font

from inswsn_book.record.files import write_whole

_CLASSES = re.compile(r'class="([^"]*)"')
_WORD = re.compile(r"[\w-]+")
_REMARK = re.compile(r"/\*(!?).*?\*/", re.DOTALL)
_RULE = re.compile(r"([^{};]*)\{([^{}]*)\}")
_EMPTY = re.compile(r"@media[^{}]*\{\s*\}")
_COMMA = re.compile(r",(?![^(]*\))")
_ARGUMENT = re.compile(r"\([^()]*\)")
_CLASS = re.compile(r"\.(-?[A-Za-z_][\w-]*)")
_FACE = re.compile(r"@font-face\{[^}]*/(fa-[a-z]+-\d+)\.woff2[^}]*\}")
_ICON = re.compile(r"\\(f[0-9a-f]{3})\b")
_ICONS = "fa-solid-900"  # the only ones that have been used


def slim(site: Path, classes: Set[str]) -> None:
    """Take out of a site the rules of style sheets and the icons that no page has a use for.

    A rule is used if each class that it names is one of the pages, or a word of a script.
    """
    static, words = site / "_static", {*classes}
    for script in static.rglob("*.js"):
        if "mathjax" not in script.parts and script.name != "fontawesome.js":
            words |= set(_WORD.findall(script.read_text(encoding="utf-8")))
    used: set[int] = set()
    for sheet in static.rglob("*.css"):
        text = _needed(sheet.read_text(encoding="utf-8"), words)
        used |= {int(icon, 16) for icon in _ICON.findall(text)}
        write_whole(sheet, text)
    fonts = static / "vendor" / "fontawesome" / "webfonts"
    if (fonts / f"{_ICONS}.ttf").is_file():
        options = Options(flavor="woff", recalc_timestamp=False)
        font, icons = load_font(str(fonts / f"{_ICONS}.ttf"), options), Subsetter(options)
        icons.populate(unicodes=used)
        icons.subset(font)
        for path in [*fonts.iterdir(), *(static / "scripts").glob("fontawesome.js*")]:
            path.unlink()
        save_font(font, str(fonts / f"{_ICONS}.woff"), options)


def classes_of(page: str) -> set[str]:
    """Return the classes of the elements of a page."""
    return {word for words in set(_CLASSES.findall(page)) for word in words.split()}


def _needed(sheet: str, words: Set[str]) -> str:
    """Return the rules of a style sheet for classes that are among some words."""

    def rule(match: re.Match[str]) -> str:
        kept = [part for part in _COMMA.split(match[1]) if _is_known(part, words)]
        return f"{','.join(kept)}{{{match[2]}}}" if kept else ""

    def face(match: re.Match[str]) -> str:
        found = match[0].partition("src:")[0]
        source = f"src:url(../vendor/fontawesome/webfonts/{_ICONS}.woff)"
        return f'{found}{source} format("woff")}}' if match[1] == _ICONS else ""

    owners = "".join(match[0] for match in _REMARK.finditer(sheet) if match[1])
    return owners + _EMPTY.sub("", _FACE.sub(face, _RULE.sub(rule, _REMARK.sub("", sheet))))


def _is_known(selector: str, words: Set[str]) -> bool:
    """Tell whether all classes of a selector are known, but for those that are an argument."""
    return "\\" in selector or {*_CLASS.findall(_ARGUMENT.sub("", selector))} <= words
