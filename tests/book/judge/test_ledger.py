"""The ledger: its form, what each claim stands for, and that it says what the papers print."""

from __future__ import annotations

import csv
import json
import math
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, strategies as st
from inswsn_book.judge.ledger import LEDGER, Claim, claims_of, data_digest, load_claims
from inswsn_book.record.project import Project

from inswsn_lib.errors import InswsnError

ENTRY: dict[str, Any] = {
    "id": "P1-T2-x", "paper": "P1", "place": "Table 2", "says": "It is 8 m.", "value": "8.0",
    "unit": "m", "kind": "numeric", "check": {"chapter": "02", "quantity": "x"},
    "tolerance": "digits", "why": "For a test.",
}  # fmt: skip


def write(path: Path, *entries: dict[str, Any], **missing: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"missing": missing, "claims": list(entries)}))  # JSON is YAML
    return path


# The ledger of the book --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def claims(project: Project) -> dict[str, Claim]:
    return {claim.id: claim for claim in load_claims(project.root / LEDGER)}


def test_no_id_that_has_been_published_goes(project: Project, claims: dict[str, Claim]) -> None:
    """A new one is added to the list by hand."""
    text = (project.root / "data/claim-ids.txt").read_text(encoding="utf-8")
    listed = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert len(listed) >= 384
    assert sorted(claims) == sorted(listed)


def test_a_cell_records_what_decides_a_claim(known: dict[str, Any]) -> None:
    without = [e.claim.id for e in known["judged"] if e.claim.chapter and e.cell is None]
    assert without == []


def test_printed_values_are_those_transcribed(project: Project, claims: dict[str, Claim]) -> None:
    papers = project.root / "data" / "papers"
    with (papers / "p1-table1.csv").open() as stream:
        for row in csv.DictReader(stream):
            for kind, column in (("mpos", "mean_position"), ("mvel", "mean_velocity")):
                assert claims[f"P1-T1-{int(row['no']):02d}-{kind}"].value == row[column]
    p1, p2, p3 = (yaml.safe_load((papers / f"p{i}.yaml").read_text()) for i in (1, 2, 3))
    better, learned = (list(p1["text"][k].values()) for k in ("hf_vs_kf", "lssvm_vs_bp"))
    last = p3["outage5_50s"]
    ranges = {
        f"P3-N-{short}{kind}{end}": value
        for short, who in (("pr", "proposed"), ("kf", "kf"))
        for kind in ("max", "rms")
        for end, value in zip(("-least", ""), p3["ranges"][f"{who}_{kind}"], strict=True)
    }
    for name, value in {
        "P1-P-T": p1["text"]["sampling_period"],
        **{f"P1-C-{n}": v for n, v in zip(("85", "80", "70v", "75v"), better, strict=True)},
        **{f"P1-C-{n}": v for n, v in zip(("80b", "70b", "40v", "70vb"), learned, strict=True)},
        "P2-A-45": p2["abstract"]["position_vs_fkf"],
        "P2-A-85": p2["abstract"]["velocity_vs_fkf"],
        "P3-N-d4": p3["outage4"]["difference_about"],
        "P3-N-imp1": p3["outage1"]["improvement_max"],
        "P3-N-i76": last["improvement_vs_rbf"],
        "P3-N-i78": last["improvement_vs_kf"],
        "P3-N-kf5": last["kf_max"],
        "P3-N-rbf5": last["rbf_max"],
        "P3-N-pr5": last["proposed_max"],
        "P3-N-kf4max": p3["outage4"]["kf_max"],
        "P3-N-pr4max": p3["outage4"]["proposed_max"],
        "P3-N-rms4": p3["outage4"]["improvement_rms"],
        "P3-N-kf1": p3["outage1"]["kf_max"],
        "P3-N-pr1": p3["outage1"]["proposed_max"],
        "P3-N-imp5": p3["outage5"]["improvement_about"],
        "P3-N-imp8": p3["outage8"]["improvement_about"],
        **dict.fromkeys(("P3-N-avg", "P3-N-avg-max"), p3["average_improvement_at_least"]),
        **ranges,
    }.items():
        assert claims[name].value == value, name
    # and the words of a claim hold the number as it is printed
    for claim in claims.values():
        assert not isinstance(claim.value, str) or claim.value in claim.says, claim.id


# Its form ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"verdict": "reproduced"}, "P1-T2-x: verdict: Extra inputs are not permitted"),
        ({"kind": "guess"}, "P1-T2-x: kind"),
        ({"paper": "P2"}, "the id P1-T2-x does not begin with P2-"),
        ({"id": "P1-T2 x"}, "P1-T2 x: id"),
        ({"tolerance": "about right"}, "'about right' is not a tolerance"),
        ({"tolerance": "within -1"}, "is not a tolerance"),
        ({"tolerance": "within 1e400"}, "is not a tolerance"),
        ({"tolerance": "within 8"}, "'within 8' is as wide as 8.0"),
        ({"tolerance": "within 900 %"}, "is as wide as 8.0"),
        ({"tolerance": "at most 7.9"}, "excludes 8.0 itself"),
        ({"tolerance": "at least 8.1"}, "excludes 8.0 itself"),
        ({"tolerance": "exactly 7"}, "excludes 8.0 itself"),
        ({"tolerance": None}, "a claim that is checked has a tolerance"),
        ({"value": None}, "the tolerance 'digits' needs one printed value"),
        ({"value": "1e400"}, "value"),
        ({"value": "eight"}, "value"),
        ({"value": "inf"}, "value"),
        ({"why": ""}, "P1-T2-x: why"),
        ({"says": "two\nlines"}, "P1-T2-x: says"),
        ({"check": {"chapter": "P 1", "quantity": "x"}}, "chapter"),
        ({"check": {"needs": ["lost"]}, "tolerance": None}, "needs lost, which is not listed"),
        ({"check": {"needs": ["here"]}}, "a claim that cannot be tested has no tolerance"),
        ({"over": {"a": [1, 2]}, "values": "3"}, "P1-T2-x has 1 values for 2 places"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    entry = {name: value for name, value in (ENTRY | changes).items() if value is not None}
    with pytest.raises(InswsnError) as caught:
        load_claims(write(tmp_path / "claims.yaml", entry, here="It is not here."))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        *("[", "3", "claims: 7", "claims: [7]", "other: 1", "claims: !!set {a, b}"),
        *("[" * 5000, "claims: 2024-13-45", f"claims: {'9' * 5000}", "claims: []\nclaims: []"),
    ],
    ids=lambda text: text[:20],
)
def test_what_is_no_ledger_is_refused_in_one_sentence(tmp_path: Path, text: str) -> None:
    (tmp_path / "claims.yaml").write_text(text)
    for path in (tmp_path / "claims.yaml", tmp_path):
        with pytest.raises(InswsnError) as caught:
            load_claims(path)
        assert "\n" not in str(caught.value)
    (tmp_path / "claims.yaml").unlink()
    with pytest.raises(InswsnError, match="There is no ledger of claims in"):
        load_claims(tmp_path)


def test_ids_whose_places_on_the_page_would_be_one_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InswsnError, match=r"P1-T2-x.* used twice or differ in signs alone"):
        load_claims(write(tmp_path / "claims.yaml", ENTRY, ENTRY | {"id": "P1-T2.X"}))
    assert Claim(**ENTRY | {"id": "P1-F-2.22-2.23"}).anchor == "claim-p1-f-2-22-2-23"


def test_a_family_is_written_out(tmp_path: Path) -> None:
    family = ENTRY | {
        "id": "P1-T2-{c}-{a}", "says": "In area {a} the {what} is {value} {unit}.",
        "over": {"c": {"rx": {"what": "path"}, "v": {"what": "speed"}}, "a": [1, 2]},
        "values": "7.5 40.25\n4.75 -", "check": {"chapter": "02", "quantity": "{c}{a}"},
    }  # fmt: skip
    found = load_claims(write(tmp_path / "claims.yaml", family))
    assert [(c.id, c.value, c.says, c.check.quantity) for c in found] == [
        ("P1-T2-rx-1", "7.5", "In area 1 the path is 7.5 {unit}.", "rx1"),
        ("P1-T2-rx-2", "40.25", "In area 2 the path is 40.25 {unit}.", "rx2"),
        ("P1-T2-v-1", "4.75", "In area 1 the speed is 4.75 {unit}.", "v1"),
    ]


# What a claim stands for -------------------------------------------------------------------------


@given(st.decimals(-1000, 1000, allow_nan=False, allow_infinity=False, places=3))
def test_digits_stand_for_what_rounds_to_them(number: Decimal) -> None:
    low, high = Claim(**(ENTRY | {"value": str(number)})).published({})
    # every number inside rounds to the printed one, every number well outside does not
    for inside in (low + 1e-7, float(number), high - 1e-7):
        assert round(inside, 3) == pytest.approx(float(number), abs=1e-12)
    for outside in (low - 1e-6, high + 1e-6):
        assert abs(round(outside, 3) - float(number)) > 5e-4


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"tolerance": "within 0.5"}, (7.5, 8.5)),
        ({"tolerance": "within 10 %"}, (7.2, 8.8)),
        ({"tolerance": "within 10 %", "value": "-8"}, (-8.8, -7.2)),
        ({"tolerance": "within width"}, (6.0, 10.0)),
        ({"tolerance": "at most 9"}, (-math.inf, 9.0)),
        ({"tolerance": "at least -2.5e-1"}, (-0.25, math.inf)),
        ({"tolerance": "exactly 8"}, (8.0, 8.0)),
        ({"tolerance": "at most 0.005", "value": [["1", "0"], ["0", "1"]]}, (-math.inf, 0.005)),
    ],
)
def test_what_a_tolerance_means(changes: dict[str, Any], expected: tuple[float, float]) -> None:
    claim = Claim(**(ENTRY | changes))
    assert claim.published({"width": 2}) == pytest.approx(expected, abs=1e-15)
    # widths are measured by the printed number; where there are several, by the bound
    printed = isinstance(claim.value, str)
    assert claim.reference == (float(claim.value) if printed else 0.005)


def test_the_digest_of_a_chapter_is_of_its_claims_alone(tmp_path: Path) -> None:
    path = tmp_path / LEDGER / "mini.yaml"
    other = ENTRY | {"id": "P1-T3-y", "check": {"chapter": "03", "quantity": "y"}}

    def digests(changed: dict[str, Any]) -> list[str | None]:
        write(path, ENTRY, changed)
        return [data_digest(tmp_path, f"{LEDGER}#{number}") for number in ("02", "03")]

    before, after = digests(other), digests(other | {"tolerance": "within 1"})
    assert [a == b for a, b in zip(before, after, strict=True)] == [True, False]
    assert [claim.id for claim in claims_of(load_claims(path), "03")] == ["P1-T3-y"]
    path.write_text("[")
    assert data_digest(tmp_path, f"{LEDGER}#02") is None
