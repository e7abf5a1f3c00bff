"""What the papers leave unsaid: the list fits the checkout, and what does not fit it is found."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import yaml
from inswsn_book.record.project import Project
from inswsn_book.run.assumptions import ASSUMPTIONS, Assumptions, load_assumptions
from sensitivity import problems_of
from small import SMALL

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

#: What the draft of the ledger of claims listed as left out by the papers.
DRAFTED = {
    *("P1-M-B", "P1-M-D", "P1-M-L", "P1-M-KFQR", "P1-M-INS", "P1-M-path", "P1-M-wsnv", "P1-M-bp"),
    *("P1-M-seed", "P1-M-normal", "P2-M-K", "P2-M-M", "P2-M-g", "P2-M-BDL", "P2-M-path"),
    *("P2-M-fkf", "P2-M-abs", "P2-M-gyro", "P2-M-seed", "P3-M-lssvm", "P3-M-QR", "P3-M-data"),
    *("P3-M-imu", "P3-M-rate", "P3-M-base"),
}


@pytest.fixture(scope="module")
def assumptions(project: Project) -> Assumptions:
    return load_assumptions(project.root)


@pytest.fixture
def content(project: Project) -> dict[str, Any]:
    """The list as the file has it, to be changed."""
    found: dict[str, Any] = read_yaml(project.root / ASSUMPTIONS)
    return found


def test_the_list_fits_the_checkout_and_none_of_the_draft_was_dropped(
    project: Project, assumptions: Assumptions
) -> None:
    assert problems_of(project, assumptions) == []
    ids = [entry.id for entry in assumptions.assumptions]
    assert set(ids) >= DRAFTED
    assert len({name.lower() for name in ids}) == len(ids)


def test_the_entries_hold_together(assumptions: Assumptions) -> None:
    """What their form does not say of each entry and of all of them."""
    headlines = {(h.chapter, h.key) for h in assumptions.headlines}
    kinds = ({"scenario", "setting"}, {"chapter", "parameter"}, {"text"})
    for entry in assumptions.assumptions:
        others = entry.alternatives
        assert entry.paper == entry.id[:2]
        assert others or entry.seeds or entry.varied, entry.id
        assert len({other.id for other in others}) == len(others), entry.id
        reduced = {*entry.seeds, *(c for o in others for c in o.chapters)}
        assert reduced <= set(assumptions.reduced), entry.id
        for choice in entry.chosen:
            assert {name for name, value in choice if value is not None} in kinds, entry.id
            assert choice.text is None or entry.why, entry.id
        for other in others:  # each of its chapters is changed, and no other
            touched = {*other.parameters, *(edit.chapter for edit in other.edits)}
            everywhere = other.values or other.factors or other.files
            assert touched <= set(other.chapters), (entry.id, other.id)
            assert everywhere or touched == set(other.chapters), (entry.id, other.id)
        for within in entry.within:  # against a headline, or a quantity that is explained
            assert (within.headline is None) == (within.against is not None), entry.id
            assert (within.against is None) == (within.says is None), entry.id
            assert within.headline is None or (within.chapter, within.headline) in headlines


def entry(content: dict[str, Any], name: str) -> dict[str, Any]:
    (found,) = (entry for entry in content["assumptions"] if entry["id"] == name)
    return found


def problems(project: Project, content: dict[str, Any]) -> list[str]:
    return problems_of(project, Assumptions.model_validate(content))


@pytest.mark.parametrize("name", ["P1-M-path", "P3-M-gate", "P2-M-wsnr"])
def test_a_number_without_entry_is_found(
    project: Project, content: dict[str, Any], name: str
) -> None:
    """What an entry that is taken away has covered comes up."""
    gone = entry(content, name)
    content["assumptions"].remove(gone)
    assert sorted(problems(project, content)) == sorted(
        f"The setting {c['setting']} of the scenario {c['scenario']} has no entry."
        if "setting" in c
        else f"The parameter {c['parameter']} of chapter {c['chapter']} has no entry."
        for c in gone["chosen"]
        if "text" not in c
    )


def test_what_an_entry_names_in_vain_is_found(project: Project, content: dict[str, Any]) -> None:
    entry(content, "P1-M-path")["chosen"].append({"scenario": "p1", "setting": "sped"})
    entry(content, "P1-M-B")["chosen"].append({"chapter": "p1-lmi", "parameter": "noise"})
    entry(content, "P1-M-L")["alternatives"][0]["edits"][0]["old"] = "nobody wrote this passage"
    content["printed"]["p1-lmi"]["margin"] = "It is printed."
    assert sorted(problems(project, content)) == [
        "P1-M-B: chapter p1-lmi has no parameter noise.",
        "P1-M-L/positions: the passage that it replaces does not stand in chapter "
        "p1-lmi exactly once.",
        "P1-M-path: the scenario p1 has no setting sped.",
        "The parameter margin of chapter p1-lmi has an entry and a reason for having none.",
    ]


@pytest.mark.parametrize(
    ("place", "field", "value", "said"),
    [
        (0, "paper", "P4", "P1-M-scale: paper: Input should be 'P1'"),
        (0, "extra", 1, "P1-M-scale: extra: Extra inputs"),
        (1, "chosen", [], "P2-M-word: chosen: Tuple should have at least 1"),
    ],
)
def test_a_bad_list_is_one_sentence(
    tmp_path: Any, place: int, field: str, value: object, said: str
) -> None:
    content = copy.deepcopy(SMALL)
    content["assumptions"][place][field] = value
    path = tmp_path / ASSUMPTIONS
    path.parent.mkdir()
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InswsnError) as caught:
        load_assumptions(tmp_path)
    assert str(caught.value).startswith(f"{path} is not a list of assumptions: {said}")
    assert "\n" not in str(caught.value)
