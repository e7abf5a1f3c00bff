"""What the front page shows: the picture's numbers by hand, the verdicts, the chapters' heads."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest
from inswsn_book.front import Contest, chapter_head, contests, front_picture, front_texts
from inswsn_book.ledger import LEDGER, load_claims
from inswsn_book.project import Chapter, Project
from inswsn_book.results import Results, read_results
from inswsn_book.verdicts import verdicts

from inswsn_lib.errors import InswsnError


@pytest.fixture(scope="module")
def published(root: Path) -> dict[str, Results]:
    return {p.stem: read_results(p) for p in (root / "data/published").glob("*.json")}


def test_the_printed_side_of_the_picture_by_hand(root: Path, published: dict[str, Results]) -> None:
    printed = [row.printed for row in contests(root, published)]
    with (root / "data/papers/p1-table2.csv").open(encoding="utf-8") as file:
        table = {row.pop("method"): row for row in csv.DictReader(file)}
    positions = ("rx1", "rx2", "ry1", "ry2")
    kf, hf = (sum(float(table[method][c]) for c in positions) for method in ("KF", "HF"))
    assert printed[0] == pytest.approx(hf / kf)
    # P2, Section 3: 50 and 40 % in position, 90 and 83 % in velocity; P3: more than 56 %
    assert printed[2] == pytest.approx((0.5 * 0.6) ** 0.5)
    assert printed[3] == pytest.approx((0.1 * 0.17) ** 0.5)
    assert printed[4] == pytest.approx(0.44)
    assert printed[5] is None  # P3 prints no comparison of its filter with and without LS-SVM


def test_the_rebuilt_and_recorded_sides_by_hand(root: Path, published: dict[str, Results]) -> None:
    """The quantities that the picture should draw, read without the library."""

    def value(chapter: str, name: str) -> float:
        kept = json.loads((root / "data/published" / f"{chapter}.json").read_text(encoding="utf-8"))
        return float(next(q["value"] for q in kept["quantities"] if q["name"] == name))

    rows = contests(root, published)
    position = [value("02", f"fair.{n}.position") for n in ("hf-exact-lmi", "kalman")]
    learners = [value("03", f"fair.geometric.{n}-motion") for n in ("ls-svm", "bp")]
    assert [row.rebuilt for row in rows] == pytest.approx(
        [
            position[0] / position[1],
            learners[0] / learners[1],
            value("04", "fair.dhf-over-fkf.position"),
            value("04", "fair.dhf-over-fkf.velocity"),
            value("05", "factor.lssvm-never"),
            value("05", "methods.lssvm"),
        ]
    )
    # what is left of never aiding, and what the LS-SVM does to it
    recorded = value("05", "recorded.factor.lssvm")
    assert [row.recorded for row in rows[:4]] == [None] * 4
    assert rows[4].recorded == pytest.approx(recorded / value("05", "recorded.factor.never"))
    assert rows[5].recorded == pytest.approx(recorded)


def test_a_quantity_that_is_not_there_is_named(root: Path, published: dict[str, Results]) -> None:
    lean = published | {"02": published["02"].model_copy(update={"quantities": ()})}
    with pytest.raises(InswsnError, match=r"draws headline\.published-ratio of chapter 02"):
        contests(root, lean)


def test_the_picture_says_its_numbers_and_is_the_same_each_time() -> None:
    rows = [Contest("A over B,\nposition", 0.1, 1.25), Contest("C over D", None, 2.0, 3.0)]
    svg, alt = front_picture(rows)
    assert svg.startswith("<?xml")
    assert front_picture(rows) == (svg, alt)
    assert "A over B, position: 0.10 printed, 1.25 rebuilt;" in alt
    assert alt.endswith("C over D: 2.00 rebuilt, 3.00 recorded.")


def test_every_chapter_says_what_it_needs_and_how_long_it_takes(root: Path) -> None:
    silent = [c.name for c in Project(root).chapters() if not all(chapter_head(c))]
    assert silent == []


def test_the_head_of_a_chapter(tmp_path: Path) -> None:
    path = tmp_path / "00-a.md"
    path.write_text("**You need** means, and\nsums. **Reading time** 25 minutes. **Run time** 3 s.")
    assert chapter_head(Chapter("00-a", path)) == ("means, and sums", 25)
    path.write_text("# Nothing")
    assert chapter_head(Chapter("00-a", path)) == ("", None)


def test_the_counts_add_up(root: Path, published: dict[str, Results]) -> None:
    judged = verdicts(load_claims(root / LEDGER), list(published.values()))
    text = front_texts(Project(root), list(published.values()), judged)["front-verdicts.md"]
    total, tested = map(int, re.findall(r"\*\*(\d+) claims\*\*, of which (\d+) are", text)[0])
    first, rest = text.split(" The others: ")
    listed = [int(n) for n in re.findall(r"\*\*(\d+)\*\* ", first)]
    assert total == len(judged)
    assert sum(listed) == tested
    assert tested + sum(map(int, re.findall(r"\d+", rest))) == total
    assert "cannot be tested" in rest  # what cannot be tested is not put to the test


def test_without_the_chapters_there_is_no_picture(root: Path) -> None:
    texts = front_texts(Project(root), [], [])
    assert "front.svg" not in texts
    assert "front-picture.md" not in texts
    assert "front-chapters.md" in texts
