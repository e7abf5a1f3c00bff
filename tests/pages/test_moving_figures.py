"""The moving figures of lessons in a browser: the library's numbers, within reach, at once."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, weekly_but
from inswsn_book.show.moving import Moving, Slider
from playwright.sync_api import Browser, CDPSession, Locator, Page, expect
from visiting import PAGES, Visit, boxes, opening, settled

from inswsn_lib.navigation import VehicleOutages
from inswsn_lib.vehicle import horizontal_error, run_vehicle_filter

pytestmark = pytest.mark.page

LESSONS = [name for name in PAGES if re.match(r"chapters/\d-", name)]
BLEND = next(name for name in LESSONS if "/2-" in name)
CAR = next(name for name in LESSONS if "/6-" in name)
DESKTOP, PHONE = {"width": 1440, "height": 900}, {"width": 390, "height": 844}
lessons = pytest.mark.parametrize("name", weekly_but({BLEND}, LESSONS))
screens = pytest.mark.parametrize("screen", [DESKTOP, PHONE], ids=["desktop", "phone"])

# A slider is moved over many places, and all is drawn each time
PLACES = 15
PAINTS = f"""async (slider) => {{
  for (let i = 0; i < {PLACES}; i++) {{
    slider.value = Number(slider.min) + (i % (Number(slider.max) - Number(slider.min) + 1));
    slider.dispatchEvent(new Event("input"));
    await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
  }}
}}"""

# What a test may have changed of a page that the next one takes over
AS_OPENED = """() => {
  document.activeElement.blur();
  for (const root of document.querySelectorAll("section.moving")) {
    const { sliders } = inswsnMoving.read(root);
    root.moving.moveTo(Object.fromEntries(sliders.map(({ name, start }) => [name, start])));
  }
  scrollTo(0, 0);
}"""
Lesson = Callable[..., Page]


@pytest.fixture(scope="module")
def opened(browser: Browser, served: str) -> Iterator[Callable[[str], Page]]:
    """Open a lesson, once for all tests."""
    with opening(browser, served) as open_page:
        seen: dict[str, Visit] = {}

        def page_of(name: str) -> Page:
            if name not in seen:
                seen[name] = open_page(name, viewport=DESKTOP)
            return seen[name].page

        yield page_of
        assert {name: found.wrong for name, found in seen.items() if found.wrong} == {}


@pytest.fixture
def lesson(opened: Callable[[str], Page]) -> Lesson:
    """Open a lesson on a screen, from its top, as if no test had moved anything on it."""

    def as_opened(name: str, screen: Any = DESKTOP) -> Page:
        page = opened(name)
        page.set_viewport_size(screen)
        page.evaluate(AS_OPENED)
        return settled(page)

    return as_opened


def figures(page: Page) -> list[Locator]:
    return page.locator("section.moving").all()


def move(figure: Locator, name: str, place: int) -> None:
    figure.evaluate("(root, there) => root.moving.moveTo(there)", {name: place})


@lessons
def test_the_first_one_is_on_the_first_screen(lesson: Lesson, name: str) -> None:
    page = lesson(name)
    (box,) = boxes(figures(page)[0].locator("svg[role=img]").first)
    assert box["y"] + box["height"] / 2 < DESKTOP["height"]
    assert len(figures(page)) >= 3


@lessons
@screens
def test_a_slider_stays_under_the_pointer_and_in_one_window_with_its_charts(
    lesson: Lesson, name: str, screen: Any
) -> None:
    page = lesson(name, screen)
    for figure in figures(page):
        settled(page)  # a figure above says last what it shows, and may grow by a line
        for slider in figure.locator("input[type=range]").all():
            slider.scroll_into_view_if_needed()
            (before,) = boxes(slider)
            for end in ("Home", "End"):
                slider.press(end)
                assert boxes(slider) == [before]
            assert screen is PHONE or before["width"] >= 300
        whole, *charts = boxes(figure.locator(":scope, svg[role=img]"))
        assert charts[-1]["bottom"] - whole["y"] <= screen["height"]
        assert charts[-1]["width"] <= screen["width"]


@lessons
def test_a_move_is_seen_at_once(lesson: Lesson, name: str) -> None:
    """In a tenth of a second of the processor: by the clock, other processes would count, too."""
    page = lesson(name)
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    for figure in figures(page):
        for slider in figure.locator("input[type=range]").all():
            before = seconds_of(session)
            slider.evaluate(PAINTS)
            assert 0 < seconds_of(session) - before < 0.1 * PLACES
    session.detach()


def seconds_of(session: CDPSession) -> float:
    """Return how long the processor has been at work for a page: scripts, layout, painting."""
    found = session.send("Performance.getMetrics")["metrics"]
    return next(float(each["value"]) for each in found if each["name"] == "ThreadTime")


@lessons
def test_the_keyboard_moves_it_and_says_what_is_seen(lesson: Lesson, name: str) -> None:
    for figure in figures(lesson(name)):
        for slider in figure.locator("input[type=range]").all():
            slider.press("Home")
            first = figure.inner_text()
            slider.press("ArrowRight")
            assert figure.inner_text() != first
            said = slider.get_attribute("aria-valuetext")
            assert said == figure.locator(f"output[for={slider.get_attribute('id')}]").inner_text()


@lessons
def test_no_label_stands_on_another_or_outside(lesson: Lesson, name: str) -> None:
    for screen in (DESKTOP, PHONE):
        for chart in lesson(name, screen).locator("section.moving svg[role=img]").all():
            (outer,) = boxes(chart)
            found = boxes(chart.locator("text.moving-label"))
            for box in found:
                assert box["right"] <= outer["right"] + 1
            for i, one in enumerate(found):
                for other in found[:i]:
                    apart = abs(one["y"] - other["y"]) >= 10
                    aside = one["x"] >= other["right"]
                    assert apart or aside or other["x"] >= one["right"]


# the ends of the lines of a grid that lead across each chart that is not as wide as it is high
ACROSS = """(root) => {
  const { charts } = inswsnMoving.read(root);
  return [...root.querySelectorAll("svg[role=img]")].filter((_, i) => !charts[i].equal)
    .flatMap((svg) => [...svg.querySelectorAll(".moving-grid")])
    .map(({ x1, x2, y1, y2 }) => [x1, x2, y1, y2].map((end) => end.baseVal.value))
    .filter(([, , top, bottom]) => top === bottom).map((ends) => ends.slice(0, 2));
}"""


@lessons
@screens
def test_charts_of_a_figure_stand_below_one_another(lesson: Lesson, name: str, screen: Any) -> None:
    for figure in figures(lesson(name, screen)):
        ends = np.array(figure.evaluate(ACROSS))
        assert ends.size == 0 or np.ptp(ends, axis=0).max() < 1, figure.get_attribute("id")


def test_a_page_reads_what_was_written(browser: Browser, displayed: list[Any]) -> None:
    """To a ten-thousandth of the axes; what lies beyond them at their ends."""
    wave = 3 * np.sin(np.arange(50.0))
    made = Moving("Read", Slider("a", "A", [1, 2], 1))
    chart = made.chart("C", x="x", y="y", xlim=(-1, 49), ylim=(-7, 5))
    made.draw(chart, "ins", "", lambda a: (np.arange(50.0), a * wave))
    made.draw(chart, "ins", "", lambda a: (np.arange(a), -wave[:a], wave[:a]), style="band")
    made.draw(chart, "ins", "", ([], []), style="points")
    made.show("fig-read", "See.")
    page = browser.new_page()
    page.set_content(displayed[0][0]["text/html"])
    page.add_script_tag(path=ROOT / "book" / "_static" / "moving.js")
    read = page.evaluate("inswsnMoving.read(document.querySelector('section'))")["charts"][0]
    page.close()
    both, band, none = (series["values"] for series in read["series"])
    for a in (1, 2):
        np.testing.assert_allclose(both[a - 1][0], np.arange(50), atol=50 / 10_000)
        expected = (a * wave).clip(-7, 5)
        np.testing.assert_allclose(both[a - 1][1], expected, atol=12 / 10_000)
        np.testing.assert_allclose(band[a - 1][1:], [-wave[:a], wave[:a]], atol=12 / 10_000)
    assert none == [[[], []]]


@pytest.fixture
def primitives(browser: Browser, displayed: list[Any]) -> Iterator[Locator]:
    """A figure with all that a reader can do: choose, slide, play, drag, and reach a goal."""
    made = Moving("All", Slider("k", "kind", ["left", "right"], "left", "{}"),
                  Slider("t", "time", [*range(6)], 0, "t = {:d} s", plays=True))  # fmt: skip
    chart = made.chart("Map", x="x", y="y", xlim=(0, 10), ylim=(0, 10), equal=True)
    side = {"left": 2.0, "right": 8.0}
    made.draw(chart, "ins", "", lambda k, t: ([side[k]], [2.0 * t]), style="handle")
    made.draw(chart, "network", "", lambda t: ([5.0], [5.0], [1.0 + t]), style="circle")
    made.number("ins", "time", lambda t: f"{t} s")
    made.number("kalman", "other", lambda t: f"{-t} s")
    made.goal("three seconds on the right", lambda k, t: (k, t) == ("right", 3))
    made.sentence(lambda k, t: f"{t} s on the {k}.")
    made.show(name="fig-all", caption="See.")
    page = browser.new_page(viewport=DESKTOP)
    page.set_content(displayed[0][0]["text/html"])
    page.add_script_tag(path=ROOT / "book" / "_static" / "moving.js")
    page.add_style_tag(path=ROOT / "book" / "_static" / "moving.css")
    page.evaluate("inswsnMoving.build(document.querySelector('section'))")
    expect(page.locator(".moving-handle")).to_be_visible()
    yield page.locator("section")
    page.close()


def test_few_places_are_buttons_and_a_goal_says_where_it_is_reached(primitives: Locator) -> None:
    figure, goal = primitives, primitives.locator(".moving-goal")
    assert figure.get_by_role("radio").count() == 2
    assert goal.inner_text() == "Goal: three seconds on the right."
    figure.get_by_text("right", exact=True).click()
    figure.get_by_role("slider").press("End")
    assert figure.evaluate("(root) => root.moving.places") == {"k": 1, "t": 5}
    for _ in range(2):
        figure.get_by_role("slider").press("ArrowLeft")
    assert goal.inner_text().endswith(
        "Reached: three seconds on the right, at kind right, t = 3 s."
    )
    # a key for the number that is of a series, and none for the one that is of none
    assert [row.locator("svg").count() for row in figure.locator("dt").all()] == [1, 0]


def test_a_handle_is_dragged_to_the_nearest_place(primitives: Locator) -> None:
    (start,) = boxes(primitives.locator(".moving-handle"))
    (chart,) = boxes(primitives.locator("svg[role=img]"))
    mouse = primitives.page.mouse
    mouse.move(start["x"] + 7, start["y"] + 7)
    mouse.down()
    mouse.move(start["x"] + 0.6 * (chart["right"] - start["x"]), start["y"] - 60, steps=5)
    mouse.up()
    places = primitives.evaluate("(root) => root.moving.places")
    assert places["k"] == 1
    assert 0 < places["t"] < 5
    mouse.move(0, 0)  # let go: it stays
    assert primitives.evaluate("(root) => root.moving.places") == places


def test_time_plays_to_its_end_and_stops(primitives: Locator) -> None:
    button = primitives.get_by_role("button")
    button.click()
    primitives.page.wait_for_function("document.querySelector('section').moving.places.t === 5")
    primitives.page.wait_for_function(
        "document.querySelector('button').textContent.includes('Play')"
    )


# The numbers are those of the library; of filters by hand, cells of the lessons hold that ---------


def metres(text: str) -> float:
    number, unit = text.split()
    return float(number) * {"cm": 0.01, "m": 1.0}[unit]


def test_a_car_is_as_far_off_as_by_the_library(lesson: Lesson) -> None:
    p3 = VehicleOutages(seed=2012, routes=1, draws=1)
    drive, figure = p3.drives[0], lesson(CAR).locator("#fig-l6-drive-moving")
    move(figure, "a", 3)  # both aids
    for place, k in ((0, 100), (67, 1440)):
        lost = {"outages": [(k + 1, k + 41)], "last": k + 40}
        run = run_vehicle_filter(drive, p3.beliefs, **lost)
        move(figure, "k", place)
        shown = figure.locator("dl dd").last.inner_text()
        along, across = (metres(part) for part in shown.split(", "))
        off = horizontal_error(run, drive)[-1, 0]
        assert np.hypot(along, across) == pytest.approx(off, abs=0.71)  # of whole metres


def test_every_lesson_is_tried() -> None:
    assert len(LESSONS) == len(list((ROOT / "chapters").glob("[1-8]-*.md")))
