"""axe-core, which looks at the pages: its script, and what it is asked."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

#: What the rules are taken from, as axe-core names it: WCAG 2.0 to 2.2, levels A and AA, and its
#: own advice.
AXE_TAGS = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice")
#: The screens on which each page is checked: theme, and width in px.
SCREENS = (("light", 1300), ("dark", 1300), ("light", 360))
#: Pages that Sphinx and its extensions add to those of the contents.
MADE_PAGES = ("genindex", "prf-prf", "py-modindex", "search")


def axe_script() -> str:
    """Return axe-core, a script that is run in a page; the lock has the package that carries it."""
    spec = find_spec("axe_playwright_python")
    assert spec is not None
    assert spec.origin is not None
    return (Path(spec.origin).parent / "axe.min.js").read_text(encoding="utf-8")
