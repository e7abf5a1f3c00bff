"""What the crossed study varies: each alternative is a factor, or has a reason why it is none."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from factors import CROSSED, LEFT_OUT, Crossing, load_crossing, reasons
from inswsn_book.record.project import Project
from inswsn_book.run.assumptions import Assumptions, load_assumptions, load_schemas, load_settings
from points import RUNS, core_at

from inswsn_lib.navigation import BridgedOutages, ClusterFusion, LMIDesigns, TrainingAreas

CORES = {"p1-training": TrainingAreas, "p1-outages": BridgedOutages, "p2-fusion": ClusterFusion}


@pytest.fixture(scope="module")
def crossing(project: Project) -> Crossing:
    return load_crossing(project)


@pytest.fixture(scope="module")
def assumptions(project: Project) -> Assumptions:
    return load_assumptions(project.root)


def test_every_alternative_is_a_factor_or_is_left_out_with_a_reason(
    assumptions: Assumptions, crossing: Crossing
) -> None:
    given = {
        f"{e.id}/{other.id}": other for e in assumptions.assumptions for other in e.alternatives
    }
    out = reasons(assumptions)
    assert all(reason.endswith(".") for reason in out.values())
    for name, other in given.items():
        entry = name.split("/")[0]
        varied = [
            factor
            for factor in crossing.factors
            if factor.name.split("/")[0] == entry and other.set in factor.says
        ]
        assert len(varied) == (name not in out), name
        for factor in varied:
            assert set(factor.chapters) == set(other.chapters) & set(CROSSED)
    entries = {entry.id for entry in assumptions.assumptions}
    assert {name.split("/")[0] for name in LEFT_OUT} <= entries
    names = [factor.name for factor in crossing.factors]
    assert len(set(names)) == len(names)


def test_what_was_chosen_is_a_point_without_changes(project: Project, crossing: Crossing) -> None:
    settings, schemas = load_settings(project.root), load_schemas(project)
    for chapter in CROSSED:
        for key, value in crossing.changes(chapter, crossing.chosen()).items():
            home, name = key.split(".", 1)
            if home == "file":
                assert value == name
            elif home in settings:
                assert np.asarray(value).tolist() == settings[home][name].value
            else:
                assert value == schemas[home].defaults[name]


@pytest.mark.parametrize("chapter", CORES)
def test_a_core_at_the_chosen_point_is_the_chapters(crossing: Crossing, chapter: str) -> None:
    plain = CORES[chapter](**RUNS[chapter])
    core = core_at(crossing, plain, chapter, crossing.changes(chapter, crossing.chosen()))
    assert core.settings == plain.settings
    own = {f.name for f in fields(plain)} - {"published"}
    assert {name: getattr(core, name) for name in own} == {n: getattr(plain, n) for n in own}


def test_every_parameter_that_is_varied_is_one_of_the_core(crossing: Crossing) -> None:
    cores = CORES | {"p1-lmi": LMIDesigns}
    known = {chapter: {f.name for f in fields(core)} for chapter, core in cores.items()}
    for factor in crossing.factors:
        for key in factor.levels[0]:
            home, name = key.split(".", 1)
            assert home not in factor.chapters or name in known[home], key


def test_an_end_is_the_alternative_and_two_shifts_add(crossing: Crossing) -> None:
    """The values of data/assumptions.yaml; the number of samples stays whole."""
    at = dict(crossing.chosen())
    early = crossing.changes("p1-outages", at | {"P1-M-place": 1.0})
    assert (early["p1.lead"], early["p1.between"]) == pytest.approx((8.0, 23.3))
    both = crossing.changes("p1-outages", at | {"P1-M-place": 1.0, "P1-M-outage": 1.0})
    assert both["p1.between"] == pytest.approx(23.3 + 18.86 - 13.86)
    assert both["p1.outage_samples"] == 25
    assert crossing.changes("p1-outages", at | {"P1-M-outage": 0.51})["p1.outage_samples"] == 37
    ends = [crossing.changes("p1-lmi", at | {"P1-M-B": place}) for place in (0.0, 1.0)]
    assert [end["p1-lmi.process_noise"] for end in ends] == pytest.approx([0.3, 3.0])


def test_words_have_equal_parts(crossing: Crossing) -> None:
    places = (0.0, 0.33, 0.333333, 0.66, 0.666667, 1.0)
    found = [
        crossing.changes("p2-fusion", crossing.chosen() | {"P2-M-wsnv": place})[
            "p2-fusion.velocity_source"
        ]
        for place in places
    ]
    assert found == ["window"] * 2 + ["sensor"] * 2 + ["difference"] * 2


def test_a_setting_that_a_core_has_as_a_field_is_set_there(crossing: Crossing) -> None:
    """The core would else put the value of its field in the place of it."""
    changes = crossing.changes("p1-training", crossing.chosen() | {"P1-M-wsnr/outliers": 1.0})
    core = core_at(crossing, TrainingAreas(**RUNS["p1-training"]), "p1-training", changes)
    assert core.settings["outlier"].value == 0.02
