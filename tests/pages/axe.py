"""What the pages are checked for, as the tests do it and as the book says it."""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path

from inswsn_book.project import Project
from inswsn_lib.errors import InswsnError

#: What the rules are taken from, as axe-core names it: WCAG 2.0 to 2.2, levels A and AA, and its
#: own advice.
AXE_TAGS = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice")
#: Rules with one of these are not run unless they are named one by one.
_NOT_RUN = frozenset({"deprecated", "experimental"})
#: The screens on which each page is checked: theme, and width in px.
SCREENS = (("light", 1300), ("dark", 1300), ("light", 360))
#: Pages that Sphinx and its extensions add to those of the contents.
MADE_PAGES = ("genindex", "prf-prf", "py-modindex", "search")
_RULE = re.compile(r'tags:\[("cat\.[^\]]*)\]')
_VERSION = re.compile(r"axe v(\d+\.\d+\.\d+)")


def axe_script() -> str:
    """Return axe-core, a script that is run in a page.

    Raises
    ------
    InswsnError
        If the package that carries it is not installed.
    """
    spec = find_spec("axe_playwright_python")
    if spec is None or spec.origin is None:
        raise InswsnError(
            "axe-playwright-python is not installed; environment.lock has it: make env."
        )
    return (Path(spec.origin).parent / "axe.min.js").read_text(encoding="utf-8")


def axe_version(script: str) -> str:
    """Return the version that axe-core says it has."""
    match = _VERSION.search(script)
    if match is None:
        raise InswsnError("axe.min.js does not say which version of axe-core it is.")
    return match[1]


def count_rules(script: str) -> int:
    """Return how many of axe-core's rules have one of `AXE_TAGS` and are run."""
    of_each = (set(re.findall(r'"([^"]+)"', match[1])) for match in _RULE.finditer(script))
    return sum(bool(tags & set(AXE_TAGS)) and not tags & _NOT_RUN for tags in of_each)


def count_pages(project: Project) -> int:
    """Return how many pages the book has, with those that Sphinx adds."""
    toc = (project.root / "book" / "_toc.yml").read_text(encoding="utf-8")
    return len(re.findall(r"^\s*-?\s*(?:root|file): ", toc, re.MULTILINE)) + len(MADE_PAGES)


def accessibility_text(project: Project) -> str:
    """Return what the pages are checked for by axe-core, as MyST Markdown.

    Parameters
    ----------
    project : Project
        The checkout.

    Raises
    ------
    InswsnError
        If axe-core is not installed.
    """
    script = axe_script()
    return (
        f"axe-core {axe_version(script)} is run in Chromium on each of the {count_pages(project)} "
        f"pages: all rules in the {SCREENS[0][0]} theme, {SCREENS[0][1]} px wide, those on colours "
        f"in the {SCREENS[1][0]} theme as well, those on sizes also {SCREENS[2][1]} px wide. "
        f"{count_rules(script)} of its rules are in force: those for WCAG 2.0, 2.1 and 2.2, levels "
        "A and AA, and its advice beyond them. A page on which one is broken fails the test.\n"
    )
