"""The picture of the front page: its numbers by hand, and what is kept of it."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import asdict
from pathlib import Path

import pytest
from conftest import Render
from front_picture import DATA, PICTURE, Contest, contests, front_svg
from inswsn_book.judge.review import Findings


@pytest.fixture(scope="module")
def drawn(root: Path, findings: Findings) -> list[Contest]:
    """What the reference results give."""
    return contests(root, findings)


def test_the_printed_side_of_the_picture_by_hand(root: Path, drawn: list[Contest]) -> None:
    printed = [row.printed for row in drawn]
    with (root / "data/papers/p1-table2.csv").open(encoding="utf-8") as file:
        table = {row.pop("method"): row for row in csv.DictReader(file)}
    positions = ("rx1", "rx2", "ry1", "ry2")
    kf, hf = (sum(float(table[method][c]) for c in positions) for method in ("KF", "HF"))
    assert printed[0] == pytest.approx(hf / kf)
    # P2, Section 3: 50 and 40 % in position, 90 and 83 % in velocity; P3: more than 56 %
    assert printed[2:5] == pytest.approx([(0.5 * 0.6) ** 0.5, (0.1 * 0.17) ** 0.5, 0.44])
    assert printed[5] is None  # P3 prints no comparison of its filter with and without LS-SVM


def test_what_is_kept_is_of_the_reference(root: Path, drawn: list[Contest]) -> None:
    """Otherwise: make publish."""
    kept = json.loads((root / DATA).read_text(encoding="utf-8"))
    for row, one in zip(drawn, kept, strict=True):
        assert row.label == one["label"]
        for side in ("printed", "rebuilt", "recorded"):
            assert getattr(row, side) == (one[side] and pytest.approx(one[side], rel=1e-9))
    assert (root / PICTURE).is_file()


def test_the_picture_is_the_same_each_time_and_its_text_says_its_numbers(render: Render) -> None:
    drawn = [Contest("A over B,\nposition", 0.1, 1.25), Contest("C over D", None, 2.0, 3.0)]
    assert front_svg(drawn) == front_svg(drawn)
    page = render("index", front=[asdict(row) for row in drawn])
    (alt,) = re.findall(r"^:alt: (.*)$", page, re.M)
    assert (
        "A over B, position: 0.10 printed, 1.25 on equal terms; C over D: 2.00 on equal terms, 3.00"
        in alt
    )
    assert alt.endswith("3.00 recorded.")
