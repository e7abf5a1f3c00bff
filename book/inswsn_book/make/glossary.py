"""The first use of a term on a page links to the glossary, in the text that is rendered."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

_GLOSSARY = re.compile(r"^```\{glossary\}\n(.*?)^```", re.MULTILINE | re.DOTALL)
_FENCE = re.compile(r" *(`{3,}|:{3,}|\$\$)")
# what is no prose of a line: roles, code, formulas, links, tags
_KEPT = re.compile(r"(\{[^}`]*\}`[^`]*`|`+[^`]*`+|\$[^$]*\$|\[[^\]]*\]\([^)]*\)|<[^>]*>)")
_VERBS = {"gain"}  # names that prose uses otherwise
_NO_PROSE = re.compile(r"#|\(\S+\)=|:\w[\w-]*:|\||\* - |  - |: |\+\+\+|%")


def terms_of(page: str) -> dict[str, str]:
    """Return what the glossary of a page explains: each name, and the entry that it stands in."""
    glossary = _GLOSSARY.search(page)
    entries = re.findall(r"^(\S.*)$", glossary[1], re.MULTILINE) if glossary else []
    return {name: entry for entry in entries for name in entry.split(", ") if name not in _VERBS}


class FirstUses:
    """What of the terms a page has not used yet, and the entries that it has used."""

    def __init__(self, terms: Mapping[str, str]) -> None:
        self._left, self.used = dict(terms), list[str]()

    def link(self, text: str) -> str:
        """Return a cell of Markdown in which the first use of each term is a link."""
        return "\n".join(self._lines(text.split("\n")))

    def _lines(self, lines: list[str]) -> Iterator[str]:
        closing = ""
        for line in lines:
            fence = _FENCE.match(line)
            if fence and not closing:
                closing = fence[1] if line.count("$$") < 2 else ""
            elif fence and closing and line.strip() == closing:
                closing = ""
            elif not closing and not _NO_PROSE.match(line):
                parts = _KEPT.split(line)
                parts[::2] = map(self._linked, parts[::2])
                line = "".join(parts)  # noqa: PLW2901
            yield line

    def _linked(self, prose: str) -> str:
        """Link the terms of a piece of prose, each once on the page."""
        names = sorted(self._left, key=len, reverse=True)
        if not names:
            return prose
        found = re.compile(r"(?<![\w-])(" + "|".join(map(_form, names)) + r")(?![\w-])")

        def link(match: re.Match[str]) -> str:
            name = self._name(match[1])
            if name is None:
                return match[1]  # a second use in the same piece
            entry = self._left[name]
            self._left = {n: e for n, e in self._left.items() if e != entry}
            self.used.append(entry)
            return f"{{term}}`{match[1]} <{entry}>`"

        return found.sub(link, prose)

    def _name(self, used: str) -> str | None:
        return next((name for name in self._left if re.fullmatch(_form(name), used)), None)


def _form(name: str) -> str:
    """Return the pattern of a name as it is used: in the plural, or at the start of a sentence."""
    first = f"[{name[0]}{name[0].upper()}]" if name[0].islower() else re.escape(name[0])
    return f"{first}{re.escape(name[1:])}s?"
