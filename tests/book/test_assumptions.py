"""What the papers leave unsaid: the entries, what holds them together, and the page."""

from __future__ import annotations

import copy
import json
import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from inswsn_book.assumption_pages import (
    assumption_texts,
    change_text,
    figure_svg,
    rerun_table,
    summary,
)
from inswsn_book.assumptions import (
    ASSUMPTIONS,
    Assumptions,
    Headline,
    load_assumptions,
    problems_of,
)
from inswsn_book.effects import Effect, band_of, readings_of, rows_of
from inswsn_book.generated import generated_texts
from inswsn_book.project import Project
from inswsn_book.results import Quantity, Results, read_results
from inswsn_book.study import Made, Run, Study

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml
from tests.conftest import MiniProject

#: What the draft of the ledger of claims listed as left out by the papers.
DRAFTED = (
    *("P1-M-B", "P1-M-D", "P1-M-L", "P1-M-KFQR", "P1-M-INS", "P1-M-path", "P1-M-wsnv", "P1-M-bp"),
    *("P1-M-seed", "P1-M-normal", "P2-M-K", "P2-M-M", "P2-M-g", "P2-M-BDL", "P2-M-path"),
    *("P2-M-fkf", "P2-M-abs", "P2-M-gyro", "P2-M-seed", "P3-M-lssvm", "P3-M-QR", "P3-M-data"),
    *("P3-M-imu", "P3-M-rate", "P3-M-base"),
)

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


def small(**changes: Any) -> Assumptions:
    """Return the small list of assumptions, with other parts."""
    return Assumptions.model_validate(copy.deepcopy(SMALL) | changes)


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


# The list of the checkout


def test_the_list_fits_the_checkout(project: Project) -> None:
    assert problems_of(project, load_assumptions(project.root)) == []


def test_no_entry_of_the_draft_was_dropped(project: Project) -> None:
    ids = [entry.id for entry in load_assumptions(project.root).assumptions]
    assert set(DRAFTED) <= set(ids)
    assert len({name.lower() for name in ids}) == len(ids)


def test_a_number_without_an_entry_is_found(project: Project) -> None:
    """Each entry that covers something is taken away in turn; what it covered comes up."""
    content = read_yaml(project.root / ASSUMPTIONS)
    for taken in ("P1-M-path", "P3-M-gate", "P2-M-wsnr"):
        left = [entry for entry in content["assumptions"] if entry["id"] != taken]
        (gone,) = (entry for entry in content["assumptions"] if entry["id"] == taken)
        said = "\n".join(
            problems_of(project, Assumptions.model_validate(content | {"assumptions": left}))
        )
        for choice in gone["chosen"]:
            if "setting" in choice:
                assert f"{choice['setting']} of the scenario {choice['scenario']} has no" in said
            if "parameter" in choice:
                assert f"{choice['parameter']} of chapter {choice['chapter']} has no entry" in said


@pytest.mark.parametrize(
    ("entry", "change", "said"),
    [
        ("P1-M-path", {"chosen": [{"scenario": "p1", "setting": "sped"}]}, "no setting sped"),
        ("P1-M-B", {"chosen": [{"chapter": "01", "parameter": "noise"}]}, "no parameter noise"),
    ],
)
def test_a_name_that_is_nowhere_is_found(
    project: Project, entry: str, change: dict[str, Any], said: str
) -> None:
    content = read_yaml(project.root / ASSUMPTIONS)
    entries = [e | change if e["id"] == entry else e for e in content["assumptions"]]
    problems = problems_of(project, Assumptions.model_validate(content | {"assumptions": entries}))
    assert any(entry in problem and said in problem for problem in problems)


def test_a_parameter_cannot_be_both(project: Project) -> None:
    content = read_yaml(project.root / ASSUMPTIONS)
    content["printed"]["01"]["margin"] = "It is printed."
    problems = problems_of(project, Assumptions.model_validate(content))
    assert problems == [
        "The parameter margin of chapter 01 has an entry and a reason for having none."
    ]


def test_a_passage_that_is_not_there_is_found(project: Project) -> None:
    content = read_yaml(project.root / ASSUMPTIONS)
    (entry,) = (e for e in content["assumptions"] if e["id"] == "P1-M-L")
    entry["alternatives"][0]["edits"][0]["old"] = "nobody wrote this passage"
    problems = problems_of(project, Assumptions.model_validate(content))
    assert problems == [
        "P1-M-L/positions: the passage that it replaces does not stand in chapter 01 exactly once."
    ]


# Bad files


def bad(path: tuple[int | str, ...], value: object) -> dict[str, Any]:
    """Return the small list with one place changed."""
    content: Any = copy.deepcopy(SMALL)
    place = content
    for part in path[:-1]:
        place = place[part]
    place[path[-1]] = value
    return dict(content)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ([], "holds no assumptions"),
        (bad(("assumptions", 0, "paper"), "P4"), "P1-M-scale.paper: input should be 'P1'"),
        (bad(("assumptions", 0, "paper"), "P2"), "P1-M-scale is not of P2"),
        (bad(("assumptions", 0, "extra"), 1), "P1-M-scale.extra: extra inputs"),
        (bad(("assumptions", 0, "alternatives"), []), "it has no alternatives"),
        (bad(("assumptions", 0, "alternatives", 1, "id"), "three"), "two alternatives have one id"),
        (bad(("assumptions", 0, "alternatives", 0, "parameters"), {}), "runs chapter 00 unchanged"),
        (bad(("assumptions", 0, "alternatives", 0, "chapters"), ["01"]), "changes chapter 00"),
        (bad(("assumptions", 1, "why"), None), "a choice in words needs a reason"),
        (bad(("assumptions", 1, "chosen"), [{"scenario": "p1"}]), "a scenario with a setting"),
        (bad(("assumptions", 1, "chosen"), []), "at least 1 item"),
        (bad(("assumptions", 1, "id"), "P1-M-Scale"), "P1-M-Scale is not of P2"),
        (bad(("assumptions", 2, "id"), "P1-M-Scale"), "the id p1-m-scale is used twice"),
        (bad(("assumptions", 2, "seeds"), ["03"]), "reduced has no chapter 03"),
        (bad(("assumptions", 0, "within", 0, "headline"), "thrice"), "no headline thrice"),
        (bad(("assumptions", 0, "within", 0, "against"), "half"), "against a headline, or"),
        (bad(("headlines",), []), "headlines: "),
    ],
)
def test_a_bad_list_gives_one_sentence(tmp_path: Path, content: object, said: str) -> None:
    (tmp_path / "data").mkdir()
    path = tmp_path / ASSUMPTIONS
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InswsnError) as refused:
        load_assumptions(tmp_path)
    sentence = str(refused.value)
    assert said in sentence
    assert sentence.startswith(str(path))
    assert sentence.endswith(".")
    assert "\n" not in sentence


@given(st.dictionaries(st.sampled_from(["headlines", "reduced", "assumptions", "x"]),
                       st.recursive(st.none() | st.integers() | st.text(max_size=5),
                                    lambda inner: st.lists(inner, max_size=3)
                                    | st.dictionaries(st.text(max_size=5), inner, max_size=3),
                                    max_leaves=6)))  # fmt: skip
def test_what_is_no_list_is_refused(tmp_path_factory: pytest.TempPathFactory, content: Any) -> None:
    folder = tmp_path_factory.mktemp("any")
    (folder / "data").mkdir()
    (folder / ASSUMPTIONS).write_text(yaml.safe_dump(content))
    with pytest.raises(InswsnError):
        load_assumptions(folder)


# What a change does


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


def test_the_tables_of_a_small_study() -> None:
    changed = run_of("P1-M-scale/three", 63.0, verdicts={"A": "not reproduced", "B": "not decided"})
    failed = run_of("P1-M-scale/ten", None, failed="It is too large.")
    study = study_of(*UNCHANGED, changed, failed)
    rows = rows_of(small(), study, "00")
    assert rows[0].set == "3"
    assert rows[0].size == pytest.approx(0.5)
    assert rows[0].flipped == {"A": "not reproduced"}, "B is not decided with another seed, too"
    table = rerun_table(small(), study, "00", rows).replace("\N{NO-BREAK SPACE}", " ")
    assert "- **+50 %** ⇄" in table
    assert "10: It is too large." in table
    assert "seed 1" in table
    # 41.9, 42 and 42.1: deviation 0.1, and Student's t for 2 degrees of freedom is 4.303
    assert f"- ± {100 * 4.303 * math.sqrt(2) * 0.1 / 42:.2g} %" in table
    results = Results(
        chapter="00", parameters={}, data={},
        quantities=tuple(
            Quantity(name=name, value=value, unit="m", basis="printed", how="As it is printed.",
                     tolerance=0.0)
            for name, value in (("twice", 42.0), ("half", 10.5))
        ),
    )  # fmt: skip
    readings = readings_of(small(), {"00": results})
    assert readings[0].change == pytest.approx(10.5 / 42 - 1)
    told = summary(small(), {"00": rows}, readings)
    assert "3 things unsaid" in told
    assert "2 by P1, 1 by P2, 0 by P3" in told
    assert "2 reruns" in told
    assert "1 failed" in told
    turns = next(line for line in told.splitlines() if "A conclusion turns" in line)
    assert "P1-M-scale" in turns
    svg = figure_svg({"00": rows})
    assert svg == figure_svg({"00": rows}), "the same sources give the same pages"
    assert "<svg" in svg


def test_a_rerun_that_was_not_made_is_told() -> None:
    study = study_of(*UNCHANGED)
    rows = rows_of(small(), study, "00")
    assert "not run" in rerun_table(small(), study, "00", rows)
    told = summary(small(), {"00": rows}, [])
    assert "0 reruns" in told
    waiting = next(line for line in told.splitlines() if "have been made yet" in line)
    assert "P1-M-scale" in waiting


def test_a_checkout_without_the_list_has_no_texts(built: MiniProject) -> None:
    texts = generated_texts(built, [read_results(built.results / "00.json")])
    assert "claims-list.md" in texts
    assert not [name for name in texts if name.startswith("assumptions")]


def test_the_numbers_on_the_page_are_those_of_the_scenarios(project: Project) -> None:
    """Values are looked up again, from the files alone."""
    results = [
        Results.model_validate_json(path.read_text())
        for path in sorted(project.published.glob("*.json"))
    ]
    texts = assumption_texts(project, results)
    told = read_yaml(project.root / "data/scenarios/p3.yaml")["gyro_correlation_time"]
    assert (
        f"- `gyro_correlation_time` = {told['value']} {told['unit']}" in texts["assumptions-p3.md"]
    )
    told = read_yaml(project.root / "data/scenarios/p2.yaml")["speed"]
    row = f"- `speed` = {told['value']} {told['unit']}\n  - assumed\n  - {told['why']}\n"
    assert row in texts["assumptions-p2.md"]
    for entry in load_assumptions(project.root).assumptions:
        table = texts[f"assumptions-{entry.paper.lower()}.md"]
        assert table.count(f"({entry.anchor})=\n") == 1
    published = json.loads((project.published / "02.json").read_text())
    (share,) = (q for q in published["quantities"] if q["name"] == "headline.kf-share")
    assert f"  - {share['value']:.3g}\n  - 100\n" in texts["assumptions-headlines.md"]
