"""What a change of an assumption does: bands of chance, effects, flips, and the page of them."""

from __future__ import annotations

import json
import math

import pytest
from conftest import Render
from effects import (
    Effect,
    band_of,
    change_text,
    page_of,
    panels_of,
    readings_of,
    rows_of,
    summarise,
    tornado_svg,
)
from inswsn_book.judge.review import Findings
from inswsn_book.record.parameters import Parameter
from inswsn_book.run.assumptions import Assumptions
from made_results import quantity, results
from small import SMALL, run, study
from study import Run

ASSUMED = Assumptions.model_validate(SMALL)
SCALE = Parameter("scale", "float", 2.0, "1", "any", "How many times.")
AS_IT_WAS = {"A": "reproduced", "B": "reproduced"}
UNCHANGED = (
    run("baseline", 42.0, verdicts=AS_IT_WAS),
    run("seed-1", 42.1, parameters={"seed": 1}, verdicts=AS_IT_WAS | {"B": "not decided"}),
    run("seed-2", 41.9, parameters={"seed": 2}, verdicts=AS_IT_WAS),
)
FLIPPED = run(
    "P1-M-scale/three", headlines={"twice": 63.0, "twice/half": 5.0},
    verdicts={"A": "not reproduced", "B": "not decided"},
)  # fmt: skip
FAILED = run("P1-M-scale/ten", failed="It is too large.")
FOUND = Findings([results(quantity("twice", 42.0), quantity("half", 10.5))], [])


def test_the_band_of_chance() -> None:
    """Student's t at 97.5 %: 12.7062 for 1 degree of freedom, 3.18245 for 3 (any table)."""
    assert band_of([7.0]) == band_of([7.0, 7.0, 7.0]) == 0
    # two values 2 apart: deviation root of 2
    assert band_of([0.0, 2.0]) == pytest.approx(12.7062 * 2, rel=1e-5)
    # 1, 1, -1, -1: deviation the root of 4/3
    assert band_of([1.0, 1.0, -1.0, -1.0]) == pytest.approx(3.18245 * math.sqrt(8 / 3), rel=1e-5)


@pytest.mark.parametrize(
    ("before", "after", "band", "change", "beyond", "moves", "turns"),
    [
        (40.0, 60.0, 5.0, 0.5, True, True, True),  # the conclusion turns at 50
        (40.0, 44.0, 5.0, 0.1, False, False, False),
        (40.0, 42.0, 1.0, 0.05, True, False, False),  # beyond chance, and small
        (60.0, 49.0, 20.0, -11 / 60, False, False, True),
        (0.0, -1.0, 0.0, -math.inf, True, True, False),
        (0.0, 0.0, 0.0, 0.0, False, False, False),
    ],
)
def test_an_effect(
    before: float, after: float, band: float, change: float, beyond: bool, moves: bool, turns: bool
) -> None:
    effect = Effect(ASSUMED.headlines[0], before, after, band)
    assert effect.change == pytest.approx(change)
    assert (effect.beyond, effect.moves, effect.turns) == (beyond, moves, turns)
    assert effect.turned == (turns and beyond)
    assert not Effect(ASSUMED.headlines[1], before, after, band).turns  # it has no edge


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (40.0, 44.0, "+10 %"),
        (40.0, 41.0, "+2.5 %"),
        (40.0, 10.0, "\N{MINUS SIGN}75 %"),
        (40.0, 100.0, "× 2.5"),
        (0.002, 46.0, "× 2.3e+04"),
        (40.0, 40.0, "0"),
        (0.0, 2.0, "0 → 2"),
        (-1.0, 2.0, "-1 → 2"),
    ],
)
def test_a_change_in_words(before: float, after: float, said: str) -> None:
    assert change_text(before, after) == said


def test_the_rows_of_a_small_study() -> None:
    rows = rows_of(ASSUMED, study(*UNCHANGED, FLIPPED, FAILED), "00")
    assert rows[0].set == "3"
    assert rows[0].size == pytest.approx(0.5)
    assert rows[0].flipped == {"A": "not reproduced"}, "B is not decided with another seed, too"
    (reading,) = readings_of(ASSUMED, FOUND)
    assert reading.change == pytest.approx(10.5 / 42 - 1)
    came = summarise(ASSUMED, {"00": rows}, [])
    assert (len(came["made"]), len(came["failed"])) == (2, 1)
    assert came["turning"] == came["moving"] == came["flipping"] == {"P1-M-scale"}
    assert came["untried"] == {"P2-M-word"}
    assert came["waiting"] == came["still"] == set()
    panels = panels_of({"00": rows})
    assert [name for name, _ in panels[0]] == ["P1-M-scale, 3"]
    svg = tornado_svg(panels)
    assert "<svg" in svg
    assert svg == tornado_svg(panels), "the same sources give the same pages"


@pytest.fixture
def page(render: Render) -> Render:
    """The page of assumptions of a small study."""

    def shown(*runs: Run) -> str:
        small = study(*runs)
        small = small.model_copy(update={"page": page_of(ASSUMED, small, FOUND)})
        text = render(
            "assumptions", assumptions=SMALL, findings=FOUND, schemas={"00": {"scale": SCALE}},
            sensitivity=json.loads(small.model_dump_json()), crossed=None,
        )  # fmt: skip
        return text.replace("\N{NO-BREAK SPACE}", " ")

    return shown


def test_the_page_of_a_small_study(page: Render) -> None:
    text = page(*UNCHANGED, FLIPPED, FAILED)
    table = text.split("{list-table} Chapter 00")[1].split(":::::")[0]
    assert "- **+50 %** ⇄\n  - **+25 %**\n" in table, "the second is beyond chance, too"
    assert "- seed 1\n  - +0.2 %\n" in table, "this is chance"
    assert "10: It is too large." in table
    # 41.9, 42 and 42.1: deviation 0.1, and Student's t for 2 degrees of freedom is 4.303
    assert f"- ± {100 * 4.303 * math.sqrt(2) * 0.1 / 42:.2g} %" in table
    for said in (
        "3 things unsaid that this book had to settle: 2 by P1, 1 by P2, 0 by P3. 2 re",
        "; 1 failed, which the tables tell, and 1 other",
        "- **A conclusion turns** with [P1-M-scale](#assumption-p1-m-scale).",
        "chapter 00: A not reproduced.", "chapter 00, twice: P1-M-scale, 3 1.5.",
    ):  # fmt: skip
        assert said in text, said
    text = page(*UNCHANGED)
    assert "  - not run\n" in text
    assert " 0 reruns" in text
    assert "- **Not all reruns have been made yet** of [P1-M-scale]" in text
    assert "No rerun gives a verdict that no unchanged run gives." in text
