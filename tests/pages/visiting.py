"""A page of the built book as a browser sees it; what the tests of pages share.

No ``conftest.py``: many tests import the one at the top of the tests by its name. The fixtures
``browser`` and ``served`` stand there.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from conftest import PATIENCE, ROOT
from playwright.sync_api import Browser, Locator, Page, Request

#: A page that has not changed for so long is at rest, ms: its scripts put off by 350 ms at most
#: what follows a change, and timers of a page end in order
REST = 400

# Waits until a page has its size, fonts and images, and nothing moves or fades; returns "", or what
# keeps it from rest. Frames are counted, too: on a busy machine one may last longer than the rest.
AT_REST = """async ([width, height, rest, patience]) => {
  const pause = (ms) => new Promise((done) => setTimeout(done, ms));
  const frame = () => new Promise((done) => requestAnimationFrame(() => done(true)));
  const runs = (change) => change.playState === "running"
    && change.effect.getComputedTiming().endTime !== Infinity;
  const places = () => JSON.stringify([document.body, ...document.querySelectorAll(
      "main, main :is(section, p, pre, figure, img, svg, text, table, details, input)")]
    .map((part) => part.getBoundingClientRect()));
  const lacks = () => {
    if (!matchMedia(`(width: ${width}px) and (height: ${height}px)`).matches)
      return `the window is ${innerWidth} px by ${innerHeight} px`;
    if (document.fonts.status !== "loaded") return "a font is on its way";
    const image = [...document.images].find((image) => !image.complete);
    if (image) return `${image.src} is on its way`;
    const change = document.getAnimations().find(runs);
    const name = change?.transitionProperty ?? change?.animationName;
    return change ? `${name} of ${change.effect.target.className} changes` : "";
  };
  let [before, same, since, why] = ["", 0, 0, ""];
  for (const end = performance.now() + patience; performance.now() < end; ) {
    if (!await Promise.race([frame(), pause(1000)])) { why = "nothing is painted"; continue; }
    await pause(20);
    const now = places();
    const lack = lacks() || (now === before ? "" : "boxes move");
    before = now;
    same = lack ? 0 : same + 1;
    why = lack || why;
    if (same < 3) since = performance.now();
    else if (performance.now() - since >= rest) {
      await Promise.allSettled([...document.images].map((image) => image.decode()));
      return "";
    }
  }
  return why;
}"""


def listed_pages() -> list[str]:
    """Return the pages of the table of contents, and those that Sphinx and extensions add."""
    toc = (ROOT / "book" / "_toc.yml").read_text(encoding="utf-8")
    names = re.findall(r"^\s*-?\s*(?:root|file): (\S+)", toc, re.MULTILINE)
    made = ("404", "genindex", "prf-prf", "py-modindex", "search")
    return sorted(f"{name}.html" for name in [*names, *made])


PAGES = listed_pages()
CHAPTER_00 = "chapters/evidence/printed-numbers.html"
SHORTEST = "chapters/evidence/recorded-data.html"
LESSON = "chapters/2-blend-two-bad-instruments.html"
OWN_DATA = "chapters/your-own-data.html"
WHICH = "chapters/which-filter.html"


@dataclass
class Visit:
    """A page as a browser saw it."""

    page: Page
    foreign: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    @property
    def wrong(self) -> list[str]:
        """What went wrong on the way."""
        return self.errors + self.foreign + self.failed


#: What the fixture ``open_page`` gives
Open = Callable[..., Visit]


def visit(browser: Browser, served: str, name: str, **options: Any) -> Visit:
    """Open a page, wait for its mathematics, and note what goes wrong on the way."""
    page = browser.new_page(**({"viewport": {"width": 1300, "height": 900}} | options))
    seen = Visit(page)
    under_way: set[Request] = set()

    def begun(request: Request) -> None:
        under_way.add(request)
        if not request.url.startswith((served, "data:", "blob:")):
            seen.foreign.append(request.url)

    def ended(request: Request) -> None:
        under_way.discard(request)

    page.on("request", begun)
    page.on("requestfinished", ended)
    page.on("requestfailed", ended)
    page.on("response", lambda r: seen.failed.append(r.url) if r.status >= 400 else None)
    page.on("console", lambda m: seen.errors.append(m.text) if m.type == "error" else None)
    page.on("pageerror", lambda error: seen.errors.append(str(error)))
    page.goto(served + name)
    # images that wait until they are near the window would keep tests waiting
    page.evaluate("for (const image of document.images) image.loading = 'eager'")
    page.evaluate("() => document.fonts.ready.then(() => window.MathJax?.startup?.promise)")
    # a network that is idle for half a second, as Playwright has it, takes that on each page
    end = time.monotonic() + PATIENCE / 1000
    while under_way:
        left = [request.url for request in under_way]
        assert time.monotonic() < end, f"{name} waits for {left}"
        page.wait_for_timeout(20)
    return seen


@contextmanager
def opening(browser: Browser, served: str) -> Iterator[Open]:
    """Give what opens pages; they are closed at the end."""
    seen: list[Visit] = []

    def opened(name: str, **options: Any) -> Visit:
        seen.append(visit(browser, served, name, **options))
        return seen[-1]

    yield opened
    for each in seen:
        each.page.close()


def settled(page: Page) -> Page:
    """Wait until nothing of a page moves, so that what is measured on it stays true; return it."""
    size = page.viewport_size
    why = page.evaluate(AT_REST, [size["width"], size["height"], REST, PATIENCE])
    assert why == "", f"{page.url} does not come to rest: {why}"
    return page


def boxes(found: Locator) -> list[dict[str, float]]:
    """Return the boxes of all that is found and takes room, read at one moment."""
    script = "(all) => all.map((each) => each.getBoundingClientRect().toJSON())"
    return [box for box in found.evaluate_all(script) if box["width"] > 0]


def unfold(page: Page) -> None:
    """Open all that is folded of a page of evidence, and its provenance."""
    page.evaluate("for (const box of document.querySelectorAll('details.fold')) box.open = true")


def it_is_whole(seen: Visit, name: str) -> None:
    """Check that a page comes without an error, all from the site, and says what made it."""
    page = seen.page
    unfold(page)
    page.evaluate("dispatchEvent(new Event('beforeprint'))")  # formulas that wait are typeset
    assert seen.wrong == [], name
    images = page.evaluate("[...document.images].map(i => [i.src, i.naturalWidth > 0, i.alt])")
    assert [source for source, loaded, alt in images if not (loaded and alt.strip())] == [], name
    assert page.locator("mjx-container").count() >= page.locator(".math").count(), name
    assert page.locator("mjx-merror, .merror").count() == 0, name
    assert "Built by inswsn" in page.locator(".extra_footer").inner_text(), name
    if name.startswith("chapters/"):
        words = page.locator("table.provenance").inner_text()
        for word in (
            *("parameters", "seed", "commit", "locks", "data", "solvers", "thread", "Python"),
            *("cores", " s, ended "),
        ):
            assert word in words, name


def luminance(css: str) -> float:
    """Return the relative luminance of WCAG 2.2 of an opaque colour, as CSS has it computed."""
    channels = [float(c) / 255 for c in re.findall(r"[\d.]+", css)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return sum(c * share for c, share in zip(linear, (0.2126, 0.7152, 0.0722), strict=True))


def contrast_of(one: str, other: str) -> float:
    """Return the contrast of two colours by WCAG 2.2."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def set_theme(page: Page, theme: str) -> None:
    """Ask for the light or the dark theme, as the reader's system does."""
    page.emulate_media(color_scheme=theme)
    page.wait_for_function(f"document.documentElement.dataset.theme === '{theme}'")
    settled(page)  # a change of theme fades
