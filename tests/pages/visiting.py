"""A page of the built book as a browser sees it; what the tests of pages share.

No ``conftest.py``: many tests import the one at the top of the tests by its name. The fixtures
``browser`` and ``served`` stand there.
"""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, Page, Request

_SECONDS = 60


@dataclass
class Visit:
    """A page as a browser saw it."""

    page: Page
    foreign: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)


def visit(browser: Browser, served: str, name: str, **options: Any) -> Visit:
    """Open a page, wait for its mathematics, and note what goes wrong on the way."""
    page = browser.new_page(**({"viewport": {"width": 1300, "height": 900}} | options))
    seen = Visit(page)
    page.on(
        "request",
        lambda r: (
            None if r.url.startswith((served, "data:", "blob:")) else seen.foreign.append(r.url)
        ),
    )
    page.on("response", lambda r: seen.failed.append(r.url) if r.status >= 400 else None)
    page.on("console", lambda m: seen.errors.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: seen.errors.append(str(error)))
    under_way: set[Request] = set()

    def begun(request: Request) -> None:
        under_way.add(request)

    def ended(request: Request) -> None:
        under_way.discard(request)

    page.on("request", begun)
    page.on("requestfinished", ended)
    page.on("requestfailed", ended)
    page.goto(served + name)
    page.evaluate("() => document.fonts.ready.then(() => window.MathJax?.startup?.promise)")
    # a network that is idle for half a second, as Playwright has it, takes that on each page
    end = time.monotonic() + _SECONDS
    while under_way:
        left = [request.url for request in under_way]
        assert time.monotonic() < end, f"{name} waits for {left}"
        page.wait_for_timeout(20)
    return seen


def it_is_whole(seen: Visit, name: str) -> None:
    """Check that a page comes without an error, all from the site, and says what made it."""
    _no_error_no_foreign_request_no_broken_image(seen, name)
    _mathematics_is_rendered(seen.page, name)
    _it_says_what_it_was_built_from(seen.page, name)


def _no_error_no_foreign_request_no_broken_image(seen: Visit, name: str) -> None:
    assert seen.errors == [], name
    assert seen.foreign == [], name
    assert seen.failed == [], name
    images = seen.page.evaluate(
        "Array.from(document.images, i => [i.currentSrc, i.naturalWidth > 0, i.alt])"
    )
    for source, loaded, alt in images:
        assert loaded, f"{name}: {source}"
        assert alt.strip(), f"{name}: {source}"


def _mathematics_is_rendered(page: Page, name: str) -> None:
    asked = page.locator(".math").count()
    assert page.locator("mjx-container").count() >= asked, name
    assert page.locator("mjx-merror, .merror").count() == 0, name


def _it_says_what_it_was_built_from(page: Page, name: str) -> None:
    assert "Built by inswsn" in page.locator(".extra_footer").inner_text(), name
    if name.startswith("chapters/"):
        words = page.locator("table.provenance").inner_text()
        for word in ("parameters", "seed", "commit", "locks", "data", "solvers", "thread"):
            assert word in words, name
        for word in ("Python", "cores", " s, ended "):
            assert word in words, name


def page_names(site: Path) -> list[str]:
    """Return the pages of a site, as paths below it."""
    return [
        path.relative_to(site).as_posix()
        for path in sorted(site.rglob("*.html"))
        if "_static" not in path.parts
    ]


def luminance(css: str) -> float:
    """Return the relative luminance of WCAG 2.2 of an opaque colour, as CSS has it computed."""
    channels = [float(c) / 255 for c in re.findall(r"[\d.]+", css)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return sum(c * share for c, share in zip(linear, (0.2126, 0.7152, 0.0722), strict=True))


def contrast_of(one: str, other: str) -> float:
    """Return the contrast of two colours by WCAG 2.2."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def contrast(page: Page, selector: str) -> float:
    """Return the contrast of an element's text with what is behind it."""
    return contrast_of(
        *page.evaluate(
            """selector => {
              const alpha = css => Number(css.match(/[\\d.]+/g)[3] ?? 1);
              const element = document.querySelector(selector);
              let ground = element;
              while (ground && alpha(getComputedStyle(ground).backgroundColor) === 0)
                ground = ground.parentElement;
              const behind = ground ? getComputedStyle(ground).backgroundColor : "rgb(255,255,255)";
              return [getComputedStyle(element).color, behind];
            }""",
            selector,
        )
    )
