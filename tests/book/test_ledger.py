"""The ledger: its schema, what each claim stands for, and that every check resolves."""

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
from inswsn_book.ledger import (
    Claim,
    MissingCheck,
    QuantityCheck,
    claims_of,
    data_digest,
    load_claims,
)
from inswsn_book.project import Project
from inswsn_book.results import read_results
from inswsn_book.verdicts import Verdict, verdicts

from inswsn_lib.errors import InswsnError

ENTRY: dict[str, Any] = {
    "id": "P1-T2-x",
    "paper": "P1",
    "place": "Table 2",
    "says": "It is 8 m.",
    "value": "8.0",
    "unit": "m",
    "kind": "numeric",
    "check": {"chapter": "02", "quantity": "x"},
    "tolerance": "digits",
    "why": "For a test.",
}


def write(path: Path, *entries: dict[str, Any], **missing: str) -> Path:
    content = {"missing": missing, "claims": list(entries)}
    path.write_text(json.dumps(content), encoding="utf-8")  # JSON is YAML
    return path


def test_every_check_of_the_ledger_resolves(project: Project) -> None:
    claims = load_claims(project.root / "data" / "claims")
    results = [read_results(path) for path in project.published.glob("*.json")]
    judged = verdicts(claims, results)
    assert len(judged) == len(claims) > 0
    for entry in judged:
        assert entry.verdict is Verdict.UNTESTABLE or entry.cell is not None, entry.claim.id


def test_the_ledger_says_what_the_second_transcription_says(project: Project) -> None:
    """Printed values in the ledger, against the transcriptions of the papers."""
    claims = {c.id: c for c in load_claims(project.root / "data" / "claims")}
    with (project.root / "data" / "papers" / "p1-table1.csv").open() as stream:
        for row in csv.DictReader(stream):
            for kind, column in (("mpos", "mean_position"), ("mvel", "mean_velocity")):
                assert claims[f"P1-T1-{int(row['no']):02d}-{kind}"].value == row[column]
    read = {
        name: yaml.safe_load((project.root / "data" / "papers" / f"{name}.yaml").read_text())
        for name in ("p1", "p2", "p3")
    }
    text, abstract = read["p1"]["text"], read["p2"]["abstract"]
    pairs = {
        "P1-P-T": text["sampling_period"],
        **dict(zip(("P1-C-85", "P1-C-80", "P1-C-70v", "P1-C-75v"), text["hf_vs_kf"].values(),
                   strict=True)),
        **dict(zip(("P1-C-80b", "P1-C-70b", "P1-C-40v", "P1-C-70vb"),
                   text["lssvm_vs_bp"].values(), strict=True)),
        "P2-A-45": abstract["position_vs_fkf"],
        "P2-A-85": abstract["velocity_vs_fkf"],
        "P3-N-d4": read["p3"]["outage4"]["difference_about"],
        "P3-N-imp1": read["p3"]["outage1"]["improvement_max"],
        "P3-N-i76": read["p3"]["outage5_50s"]["improvement_vs_rbf"],
        "P3-N-i78": read["p3"]["outage5_50s"]["improvement_vs_kf"],
    }  # fmt: skip
    assert {name: claims[name].value for name in pairs} == pairs
    # and the words of a claim hold the number as it is printed
    for claim in claims.values():
        assert not isinstance(claim.value, str) or claim.value in claim.says, claim.id


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"verdict": "reproduced"}, "P1-T2-x: verdict: Extra inputs are not permitted"),
        ({"kind": "guess"}, "P1-T2-x: kind"),
        ({"paper": "P4"}, "P1-T2-x: paper"),
        ({"paper": "P2"}, "the id P1-T2-x does not begin with P2-"),
        ({"id": "T2"}, "T2: id"),
        ({"id": "P1-T2 x"}, "P1-T2 x: id"),
        ({"tolerance": "about right"}, "'about right' is no tolerance"),
        ({"tolerance": "within -1"}, "is no tolerance"),
        ({"tolerance": "within 8"}, "'within 8' is as wide as 8.0"),
        ({"tolerance": "within 1e400"}, "is no tolerance"),
        ({"tolerance": "within 900 %"}, "is as wide as 8.0"),
        ({"tolerance": "at most 7.9"}, "excludes 8.0 itself"),
        ({"tolerance": "at least 8.1"}, "excludes 8.0 itself"),
        ({"tolerance": "exactly 7"}, "excludes 8.0 itself"),
        ({"tolerance": "exactly 8.5"}, "excludes 8.0 itself"),
        ({"value": "1e400"}, "value"),
        ({"tolerance": None}, "a claim that is checked has a tolerance"),
        ({"value": None}, "the tolerance 'digits' needs one printed value"),
        ({"value": "eight"}, "value"),
        ({"value": "inf"}, "value"),
        ({"why": ""}, "P1-T2-x: why"),
        ({"says": "two\nlines"}, "P1-T2-x: says"),
        ({"check": {"chapter": "2", "quantity": "x"}}, "chapter"),
        ({"check": {"verdict": "reproduced"}}, "check"),
        ({"check": {"needs": ["lost"]}, "tolerance": None}, "needs lost, which is not listed"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    entry = {name: value for name, value in (ENTRY | changes).items() if value is not None}
    with pytest.raises(InswsnError) as caught:
        load_claims(write(tmp_path / "claims.yaml", entry, here="It is not here."))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_id_twice_is_refused(tmp_path: Path) -> None:
    other = ENTRY | {"id": "P1-T2.X"}  # its label on the page would be the same
    with pytest.raises(InswsnError, match=r"P1-T2-x.* used twice or differ in signs alone"):
        load_claims(write(tmp_path / "claims.yaml", ENTRY, other))


@pytest.mark.parametrize(
    "text",
    [
        *("[", "3", "claims: 7", "claims: [7]", "other: 1", "claims: !!set {a, b}"),
        *("[" * 5000, "claims: 2024-13-45", f"claims: {'9' * 5000}", "claims: []\nclaims: []"),
    ],
    ids=lambda text: text[:20],
)
def test_what_is_no_ledger_is_refused_in_one_sentence(tmp_path: Path, text: str) -> None:
    path = tmp_path / "claims.yaml"
    path.write_text(text)
    with pytest.raises(InswsnError) as caught:
        load_claims(path)
    assert "\n" not in str(caught.value)


@given(st.decimals(-1000, 1000, allow_nan=False, allow_infinity=False, places=3))
def test_digits_stand_for_what_rounds_to_them(number: Decimal) -> None:
    low, high = Claim(**(ENTRY | {"value": str(number)})).published({})
    # every number inside rounds to the printed one, every number well outside does not
    for inside in (low + 1e-7, float(number), high - 1e-7):
        assert round(inside, 3) == pytest.approx(float(number), abs=1e-12)
    for outside in (low - 1e-6, high + 1e-6):
        assert abs(round(outside, 3) - float(number)) > 5e-4


@pytest.mark.parametrize(
    ("tolerance", "expected"),
    [
        ("within 0.5", (7.5, 8.5)),
        ("within 10 %", (7.2, 8.8)),
        ("within width", (6.0, 10.0)),
        ("at most 9", (-math.inf, 9.0)),
        ("at least -2.5e-1", (-0.25, math.inf)),
        ("exactly 8", (8.0, 8.0)),
    ],
)
def test_what_a_tolerance_stands_for(tolerance: str, expected: tuple[float, float]) -> None:
    claim = Claim(**(ENTRY | {"tolerance": tolerance}))
    assert claim.published({"width": 2}) == pytest.approx(expected, abs=1e-15)


def test_a_share_of_a_negative_number_is_no_negative_width() -> None:
    claim = Claim(**(ENTRY | {"value": "-8", "tolerance": "within 10 %"}))
    assert claim.published({}) == pytest.approx((-8.8, -7.2))


def test_the_digest_of_a_chapter_is_of_its_claims_alone(tmp_path: Path) -> None:
    (tmp_path / "data" / "claims").mkdir(parents=True)
    path = tmp_path / "data" / "claims" / "mini.yaml"
    other = ENTRY | {"id": "P1-T3-y", "check": {"chapter": "03", "quantity": "y"}}
    write(path, ENTRY, other)
    before = {n: data_digest(tmp_path, f"data/claims#{n}") for n in ("02", "03")}
    write(path, ENTRY, other | {"tolerance": "within 1"})
    after = {n: data_digest(tmp_path, f"data/claims#{n}") for n in ("02", "03")}
    assert before["02"] == after["02"]
    assert before["03"] != after["03"]
    assert [claim.id for claim in claims_of(load_claims(path), "03")] == ["P1-T3-y"]
    path.unlink()
    assert data_digest(tmp_path, "data/claims#02") is None
    path.write_text("[")
    assert data_digest(tmp_path, "data/claims#02") is None


def test_a_ledger_of_all_shapes_of_ids(tmp_path: Path) -> None:
    """The machinery carries as many claims as the three papers make, with ids as they are."""
    ids = ["P1-F-2.22-2.23", "P1-F-Lemma2.2", "P1-C-70vb", "P3-F-A", "P2-N-px-ins", "P1-T1-01-mpos"]
    ids += [f"P{1 + i % 3}-N-{i:03d}.{i % 7}" for i in range(400)]
    entries = [ENTRY | {"id": name, "paper": name[:2]} for name in ids]
    claims = load_claims(write(tmp_path / "claims.yaml", *entries))
    assert [claim.id for claim in claims] == ids
    assert len({claim.anchor for claim in claims}) == len(ids)
    assert claims[0].anchor == "claim-p1-f-2-22-2-23"
    matrix = ENTRY | {"value": [["1", "0"], ["0", "1"]], "tolerance": "at most 0.005"}
    (claim,) = load_claims(write(tmp_path / "claims.yaml", matrix))
    assert claim.value == [["1", "0"], ["0", "1"]]
    assert claim.check == QuantityCheck(chapter="02", quantity="x")


def test_a_claim_that_cannot_be_tested_has_no_tolerance() -> None:
    with pytest.raises(ValueError, match="cannot be tested has no tolerance"):
        Claim(
            id="P1-T2-x", paper="P1", place="Table 2", says="It is one.", value="1",
            kind="numeric", check=MissingCheck(needs=("lost",), reasons=("It is lost.",)),
            tolerance="digits", why="For a test.",
        )  # fmt: skip
