"""What is asked of a chapter, and what it answers."""

from __future__ import annotations

from pathlib import Path

import pytest
from inswsn_book.judge.claims import plain
from inswsn_book.make.answer import MOST, WIDTH, differences, findings, of_core
from inswsn_book.make.chapters import chapter_with
from inswsn_book.record.project import Project
from inswsn_book.record.results import Results
from inswsn_book.run.assumptions import Headline, load_assumptions, quick_request
from inswsn_book.run.cores import asked_schema, changed_scenarios, evidence_of
from made_results import quantity, results

from inswsn_lib.errors import ParameterError
from inswsn_lib.scenario import load_scenario


def made(sentences: dict[str, bool] | None = None, **values: float) -> Results:
    """Return results with one quantity of each name, with an interval of a tenth about it."""
    about = {"interval_kind": "runs 95 %", "how": "A length that is made here.", "tolerance": 0.01}
    found = (quantity(n, v, interval=(v - 0.1, v + 0.1), **about) for n, v in values.items())
    return results(*found, chapter="p1-training", sentences=sentences or {})


def headline(**fields: str | float) -> Headline:
    return Headline.model_validate({"chapter": "p1-training", "short": "one", **fields})


def test_findings_are_told_then_and_now() -> None:
    told = findings(
        [
            headline(quantity="a", says="error of the $H_\\infty$ filter"),
            headline(quantity="a", over="b", says="one over the other, %", turns=0.7),
            headline(quantity="b", says="another error", turns=2.05),
            headline(quantity="c", says="what another section finds"),
        ],
        made(a=1.0, b=2.0, c=1.0),
        made(a=2.0, b=2.0),
    )
    assert told == [
        "- error of the H∞ filter: 1 m (0.9 to 1.1) -> 2 m (1.9 to 2.1)",
        "- one over the other: 0.5 -> 1; the conclusion turns at 0.7",
        "- another error: 2 m (1.9 to 2.1) -> 2 m (1.9 to 2.1); undecided, 2.05 is in the interval",
        "- what another section finds: not computed in this run",
    ]


def test_a_chapter_without_headlines_tells_what_moved_most_a_few() -> None:
    many = {f"q{i}": float(i) for i in range(20)}
    told = findings([], made(None, **many), made(None, **{name: v + 1 for name, v in many.items()}))
    assert len(told) == MOST + 1
    assert told[-1] == f"- and {20 - MOST} more numbers, which comparison.txt has"
    assert findings([], made(a=1.0), made(a=1.001)) == [
        "- No number of this chapter moves by more than its tolerance."
    ]


def test_sentences_that_are_no_longer_true_fit_a_line() -> None:
    said = {f"Sentence {i} on the filters of this page is true.": True for i in range(9)}
    lines = differences(made(said), made(dict.fromkeys(said, False)), [])
    assert lines[0].startswith("9 of 9 sentences are no longer true: Sentence 0 on")
    assert lines[0].endswith(" more.")
    assert len(lines[0]) < WIDTH + 20


def test_formulas_are_told_in_plain_signs(project: Project) -> None:
    assert plain(r"the least $\gamma$ with $Q = R = I$") == "the least γ with Q = R = I"
    for each in load_assumptions(project.root).headlines:
        assert not {*plain(each.says)} & {*"$\\{}"}


# What can be asked --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "names", "found"),
    [
        ("2", ["seed"], "lesson-2"),
        ("2", ["range_noise"], "lesson-2"),
        ("2", ["node_bias"], "p1-training"),
        ("2", ["range_noise", "heading"], "p1-training"),
        ("4", ["heading"], "p1-outages"),
        ("5", ["dropout"], "p2-fusion"),
        ("6", ["compass_outliers"], "p3-vehicle"),
    ],
)
def test_a_lesson_passes_on_what_it_does_not_have(
    project: Project, asked: str, names: list[str], found: str
) -> None:
    assert chapter_with(project, project.find(asked), names).id == found


def test_a_name_that_is_nowhere_is_refused_with_the_nearest(project: Project) -> None:
    with pytest.raises(ParameterError, match=r"the nearest is range_noise\), not 'range_nois'"):
        chapter_with(project, project.find("2"), ["range_nois"])


def test_each_lesson_has_evidence(project: Project) -> None:
    lessons = [chapter for chapter in project.chapters() if chapter.lesson]
    assert all(evidence_of(project, lesson) for lesson in lessons)


def test_what_a_parameter_stands_for_is_no_setting_of_the_scene(project: Project) -> None:
    schema = asked_schema(project.root, project.find("p1-training"), ["heading"])
    names = {parameter.name for parameter in schema.parameters}
    assert {"heading", "spacing", "lost_every"} < names
    assert not {"noise", "periods"} & names  # range_noise and period_area1 set them


def test_a_setting_of_the_scene_changes_its_file_alone(project: Project, tmp_path: Path) -> None:
    schema = asked_schema(project.root, project.find("p1-training"), ["heading"])
    ((path, text),) = changed_scenarios(project.root, schema, {"heading": 0.05}).items()
    (tmp_path / "changed.yaml").write_text(text)
    before, after = (load_scenario(f) for f in (project.root / path, tmp_path / "changed.yaml"))
    assert [n for n in before if before[n].value != after[n].value] == ["heading"]
    assert after["heading"].value == 0.05


@pytest.mark.parametrize("text", ["3", "[1, 2, 3]", "x", "[1", "[1, true]", "[[1, 2]]", "{}"])
def test_a_list_of_another_form_is_refused(project: Project, text: str) -> None:
    schema = asked_schema(project.root, project.find("p1-training"), ["position"])
    with pytest.raises(ParameterError, match=r"position must be a list of the form \[2.63"):
        schema["position"].read(text)
    assert schema["position"].read("[1, 2]") == [1, 2]


def test_a_speed_that_is_refused_names_what_sets_it(project: Project) -> None:
    schema = asked_schema(project.root, project.find("p1-training"), [])
    with pytest.raises(ParameterError, match="For another pace set time_scale"):
        schema["speed"].read("15")


def test_a_quick_request_is_one_of_the_core_with_fewer_runs(project: Project) -> None:
    chapter = project.find("p1-training")
    quick = quick_request(project.root, chapter, {"runs": 50, "heading": 0.05})
    assert quick.core
    assert quick.parameters == {"runs": 50, "other_runs": 40, "heading": 0.05}
    fusion = project.find("p2-fusion")  # whose core does not know of this parameter
    whole = quick_request(project.root, fusion, {"most_clusters": 4})
    assert (whole.core, whole.parameters["runs"]) == (False, 64)
    outside = quick_request(project.root, project.find("lesson-2"), {"seed": 7})
    assert (outside.parameters, outside.overlay) == ({"seed": 7}, {})  # no chapter of the study


def test_a_quick_answer_has_what_the_core_found_and_no_more() -> None:
    asked = [headline(quantity="a", says="error"), headline(quantity="c", says="elsewhere")]
    assert of_core(asked, made(a=1.0, b=2.0, c=1.0), made(a=2.0, b=3.0, d=1.0)) == [
        "- error: 1 m (0.9 to 1.1) -> 2 m (1.9 to 2.1)",
        "- A length that is made here: 2 m (1.9 to 2.1) -> 3 m (2.9 to 3.1)",
    ]
