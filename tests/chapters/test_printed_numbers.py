"""Evidence printed-numbers: its results against numbers worked out by hand, and what it reads."""

from __future__ import annotations

import math

import pytest
from inswsn_book.record.project import Project
from inswsn_book.record.results import Results

from inswsn_lib.papers import read_table

CHAPTER = "printed-numbers"
BY_HAND = {
    # Table 1, counted with a pencil: rows 3, 5 and 6 are right, all ten are off by one row
    "table1.position.rows-own": 3,
    "table1.position.rows-shifted": 10,
    "table1.velocity.rows-own": 10,
    "table1.selected.position-mean": (0.2903 + 0.1063) / 2,
    "table1.selected.position-rank": 8,
    "table1.best-position.row": 3,
    "table1.best-position.mean": (0.2331 + 0.1067) / 2,
    "table1.velocity.margin": 0.0002,
    # Tables 2 and 3
    "table2.reduction.rx1": 100 * (1 - 0.3881 / 2.9170),
    "table2.reduction.vy2": 100 * (1 - 0.0932 / 0.8856),
    "table2.percentages.met": 1,
    "table3.percentages.met": 0,
    "table3.least-reduction": 100 * (1 - 5.2938 / 36.4784),
    "table2.smallest": 8,
    "table3.smallest": 8,
    "table3.fragment-orders": 1,
    "table3.caption.mismatch": 2,
    "table2.ins-ratio.2": 1,
    "teacher.ratio.vx2": 0.0092 / 0.1041,
    "teacher.columns-below": 5,
    "table3.slip.reduction": 100 * (1 - 0.092 / 1.1008),
    "table3.growth.ls-svm.rx": 5.2938 / 0.5916,
    "table3.growth.ins-only.vy": 6.0012 / 2.0265,
    "table1.wide.share-most": 0.1085 / 0.5338,
    "table1.wide.planar-least": 0.1063 * math.pi**0.5,
    "table1.wide.white-left": 0.5338 * 0.9**0.5,
    "table1.wide.other-half": 2 * 0.5338 - 0.1085,
    # P2: (1 - 0.40) / (1 - 0.90) and (1 - 0.80) / (1 - 0.83)
    "p2.fkf-over-ins.vx": 6,
    "p2.fkf-over-ins.vy": 0.20 / 0.17,
    "p2.abstract.position": 45,
    "p2.abstract.velocity": 86.5,
    # P3
    "p3.outage1.gain-kf": 100 * (1 - 14.77 / 28.54),
    "p3.outage5-50s.gain-rbf": 100 * (1 - 12.36 / 51.42),
    "p3.outage5-50s.gain-kf": 100 * (1 - 12.36 / 55.40),
    "p3.outage4.difference": 3.21,
    "p3.outage4.kf-rms.high": 11 / (1 - 0.3815),  # the widest rounding of 38.1 %
    # P1's period
    "period.area1": 0.2,
    "period.area2": 0.21,
    "period.area1.a-f-at-1s": 0.8,
}


@pytest.mark.parametrize(("name", "expected"), BY_HAND.items())
def test_a_number_worked_out_by_hand(results: Results, name: str, expected: float) -> None:
    assert results[name].value == pytest.approx(expected, rel=1e-9)


def test_the_odds_of_table_1_in_whole_numbers(results: Results, project: Project) -> None:
    """Rows that fit by |x + y - 2 m| in units of the last digit; each ways of choosing tried."""
    table = read_table(project.root / "data/papers/p1-table1.csv", index="no")
    x, y, m = (
        [round(1e4 * float(cell)) for cell in table[name]]
        for name in ("drx", "dry", "mean_position")
    )
    # half a unit each for x and y and two halves for 2 m; a blank is exactly zero
    blank = len(y)
    fits = [
        {j for j, cell in enumerate(y) if abs(a + cell - 2 * mean) <= 2}
        | ({blank} if abs(a - 2 * mean) <= 1 else set())
        for a, mean in zip(x, m, strict=True)
    ]
    found: list[tuple[int, ...]] = [()]
    for row in fits:
        found = [(*chosen, j) for chosen in found for j in row if j not in chosen]
    assert results["table1.chance.odds"].value == math.perm(11, 10) / len(found)
    own = [abs(a + b - 2 * mean) <= 2 for a, b, mean in zip(x, y, m, strict=True)]
    shown = {reading: met for reading, met, _ in results.tables["tbl-printed-numbers-readings"][1:]}
    assert int(shown["mean of the row's own x and y"]) == sum(own)


def test_the_score_by_hand(results: Results) -> None:
    # contradicted: seven position means; three reductions by HF and four by the LS-SVM; P2's
    # conclusion; the period. Adding up: three position and ten velocity means; one reduction by
    # HF; P3's three gains and its difference. With an assumption: what is said of figures, twice
    # for the first area and twice for the first outage, and of the second area; P2's two abstract
    # means.
    assert results["score.contradicted"].value == 7 + 3 + 4 + 1 + 1
    assert results["score.adds-up"].value == 3 + 10 + 1 + 3 + 1 + 2 + 2 + 1 + 2
    assert results["score.assumed"].value == 2 + 2 + 1 + 2
    assert results["score.claims"].value == 41
    assert len(results.sentences) >= 15
