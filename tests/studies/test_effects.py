"""What a change of an assumption does: bands of chance, effects, flips, and the page of them."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from typing import Any

import pytest
from assumptions import Assumptions, Headline
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
from hypothesis import given, strategies as st
from inswsn_book.parameters import Parameter
from inswsn_book.project import Project
from inswsn_book.results import Quantity, Results
from inswsn_book.review import Findings
from study import Made, Run, Study

from inswsn_lib.files import read_yaml

SMALL: dict[str, Any] = {
    "headlines": [
        {"chapter": "00", "quantity": "twice", "short": "twice", "says": "twice it", "turns": 50},
        {"chapter": "00", "quantity": "twice", "over": "half", "short": "four", "says": "ratio"},
    ],
    "reduced": {"00": {"parameters": {}, "seeds": [1, 2]}},
    "printed": {"00": {}},
    "assumptions": [
        {
            "id": "P1-M-scale",
            "paper": "P1",
            "unsaid": "The scale.",
            "place": "Section 1",
            "bounds": "Nothing.",
            "chosen": [{"chapter": "00", "parameter": "scale"}],
            "alternatives": [
                {"id": "three", "set": "3", "why": "One more.", "chapters": ["00"],
                 "parameters": {"00": {"scale": 3.0}}},
                {"id": "ten", "set": "10", "why": "Many more.", "chapters": ["00"],
                 "parameters": {"00": {"scale": 10.0}}},
            ],
            "within": [
                {"chapter": "00", "reading": "half of it", "headline": "twice", "quantity": "half"}
            ],
        },
        {
            "id": "P2-M-word",
            "paper": "P2",
            "unsaid": "A word.",
            "place": "Section 2",
            "bounds": "Nothing.",
            "chosen": [{"text": "This word."}],
            "why": "It is short.",
            "varied": "It cannot be.",
        },
        {
            "id": "P1-M-seed",
            "paper": "P1",
            "unsaid": "The seed.",
            "place": "Section 1",
            "bounds": "Nothing.",
            "chosen": [{"text": "Any."}],
            "why": "There is none.",
            "seeds": ["00"],
        },
    ],
}  # fmt: skip

ASSUMED = Assumptions.model_validate(SMALL)
SCALE = Parameter("scale", "float", 2.0, "1", "any", "How many times.")


def run_of(identity: str, twice: float | None, **fields: Any) -> Run:
    """Return a run of chapter 00 with a value of its headline."""
    found = {} if twice is None else {"twice": twice, "twice/half": 4.0}
    return Run(
        **({"id": identity, "chapter": "00", "parameters": {}, "headlines": found, "seconds": 1.0,
            "key": "0" * 64} | fields)
    )  # fmt: skip


def study_of(*runs: Run) -> Study:
    """Return a study of these runs."""
    made = Made(
        version="1.0.0", day="2026-11-22", commit=None, clean=None, sources={}, recorded=False,
        python="3.11", system="Linux", cpu="one", packages={},
    )  # fmt: skip
    return Study(made=made, runs=runs)


UNCHANGED = (
    run_of("baseline", 42.0, verdicts={"A": "reproduced", "B": "reproduced"}),
    run_of(
        "seed-1", 42.1, parameters={"seed": 1}, verdicts={"A": "reproduced", "B": "not decided"}
    ),
    run_of("seed-2", 41.9, parameters={"seed": 2}, verdicts={"A": "reproduced", "B": "reproduced"}),
)


def test_the_band_of_chance() -> None:
    """Student's t at 97.5 %: 12.7062 for 1 degree of freedom, 3.18245 for 3 (any table)."""
    assert band_of([7.0]) == 0
    assert band_of([7.0, 7.0, 7.0]) == 0
    # two values 2 apart: deviation root of 2
    assert band_of([0.0, 2.0]) == pytest.approx(12.7062 * 2, rel=1e-5)
    # 1, 1, -1, -1: deviation the root of 4/3
    assert band_of([1.0, 1.0, -1.0, -1.0]) == pytest.approx(3.18245 * math.sqrt(8 / 3), rel=1e-5)


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=6), st.floats(-1e3, 1e3),
       st.floats(0.01, 100))  # fmt: skip
def test_the_band_goes_with_the_scale_and_not_with_the_place(
    values: list[float], shift: float, scale: float
) -> None:
    band = band_of(values)
    assert band >= 0
    moved = band_of([scale * (value + shift) for value in values])
    assert moved == pytest.approx(scale * band, rel=1e-6, abs=1e-6 * scale)


def test_an_effect() -> None:
    headline = Headline(chapter="00", quantity="twice", short="twice", says="twice it", turns=50.0)
    effect = Effect(headline, 40.0, 60.0, 5.0)
    assert (effect.change, effect.beyond, effect.moves, effect.turns) == (0.5, True, True, True)
    effect = Effect(headline, 40.0, 44.0, 5.0)
    assert (effect.beyond, effect.moves, effect.turns) == (False, False, False)
    effect = Effect(headline, 40.0, 42.0, 1.0)
    assert (effect.beyond, effect.moves) == (True, False), "beyond chance, and small"
    assert Effect(headline, 0.0, -1.0, 0.0).change == -math.inf
    assert Effect(headline, 0.0, 0.0, 0.0).change == 0
    endless = headline.model_copy(update={"turns": None})
    assert not Effect(endless, 40.0, 60.0, 5.0).turns


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


def shown(render: Callable[..., str], study: Study, results: Results) -> str:
    """Return the page of assumptions of a small study."""
    found = Findings([results], [])
    study = study.model_copy(update={"page": page_of(ASSUMED, study, found)})
    page = render(
        "assumptions",
        assumptions=SMALL,
        findings=found,
        schemas={"00": {"scale": SCALE}},
        sensitivity=json.loads(study.model_dump_json()),
    )
    return page.replace("\N{NO-BREAK SPACE}", " ")


RESULTS = Results(
    chapter="00", parameters={}, data={},
    quantities=tuple(
        Quantity(name=name, value=value, unit="m", basis="printed", how="As it is printed.",
                 tolerance=0.0)
        for name, value in (("twice", 42.0), ("half", 10.5))
    ),
)  # fmt: skip
FLIPPED = run_of(
    "P1-M-scale/three", 63.0, headlines={"twice": 63.0, "twice/half": 5.0},
    verdicts={"A": "not reproduced", "B": "not decided"},
)  # fmt: skip
FAILED = run_of("P1-M-scale/ten", None, failed="It is too large.")


def test_the_rows_of_a_small_study() -> None:
    rows = rows_of(ASSUMED, study_of(*UNCHANGED, FLIPPED, FAILED), "00")
    assert rows[0].set == "3"
    assert rows[0].size == pytest.approx(0.5)
    assert rows[0].flipped == {"A": "not reproduced"}, "B is not decided with another seed, too"
    (reading,) = readings_of(ASSUMED, Findings([RESULTS], []))
    assert reading.change == pytest.approx(10.5 / 42 - 1)
    came = summarise(ASSUMED, {"00": rows}, [])
    assert (len(came["made"]), len(came["failed"])) == (2, 1)
    assert came["turning"] == came["moving"] == came["flipping"] == {"P1-M-scale"}
    assert came["untried"] == {"P2-M-word"}
    assert came["waiting"] == came["still"] == set()
    panels = panels_of({"00": rows})
    assert [name for name, _ in panels[0]] == ["P1-M-scale, 3"]
    svg = tornado_svg(panels)
    assert svg == tornado_svg(panels), "the same sources give the same pages"
    assert "<svg" in svg


def test_the_page_of_a_small_study(render: Callable[..., str]) -> None:
    page = shown(render, study_of(*UNCHANGED, FLIPPED, FAILED), RESULTS)
    table = page.split("{list-table} Chapter 00")[1].split(":::::")[0]
    assert "- **+50 %** ⇄\n  - **+25 %**\n" in table, "the second is beyond chance, too"
    assert "- seed 1\n  - +0.2 %\n" in table, "this is chance"
    assert "10: It is too large." in table
    # 41.9, 42 and 42.1: deviation 0.1, and Student's t for 2 degrees of freedom is 4.303
    assert f"- ± {100 * 4.303 * math.sqrt(2) * 0.1 / 42:.2g} %" in table
    assert "3 things unsaid that this book had to settle: 2 by P1, 1 by P2, 0 by P3. 2 re" in page
    assert "; 1 failed, which the tables tell, and 1 other" in page
    assert "- **A conclusion turns** with [P1-M-scale](#assumption-p1-m-scale)." in page
    assert "chapter 00: A not reproduced." in page
    assert ":alt: Bars, a panel a chapter;" in page
    assert "chapter 00, twice: P1-M-scale, 3 1.5." in page


def test_a_rerun_that_was_not_made_is_told(render: Callable[..., str]) -> None:
    page = shown(render, study_of(*UNCHANGED), RESULTS)
    assert "  - not run\n" in page
    assert " 0 reruns" in page
    assert "- **Not all reruns have been made yet** of [P1-M-scale]" in page
    assert "No rerun gives a verdict that no unchanged run gives." in page


def test_the_numbers_on_the_page_are_those_of_the_scenarios(
    project: Project, known: dict[str, Any], render: Callable[..., str]
) -> None:
    """Values are looked up again, from the files alone."""
    page = re.sub(r"\n\s*\n", "\n", render("assumptions"))
    told = read_yaml(project.root / "data/scenarios/p3.yaml")["gyro_correlation_time"]
    assert f"- `gyro_correlation_time` = {told['value']} {told['unit']}\n" in page
    told = read_yaml(project.root / "data/scenarios/p2.yaml")["speed"]
    row = f"- `speed` = {told['value']} {told['unit']}\n  - assumed\n  - {told['why']}\n"
    assert row in page
    for entry in known["assumptions"]["assumptions"]:
        assert page.count(f"(assumption-{entry['id'].lower()})=\n") == 1
    published = json.loads((project.published / "02.json").read_text())
    (share,) = (q for q in published["quantities"] if q["name"] == "headline.kf-share")
    assert f"  - {share['value']:.3g}\n  - 100\n" in page
