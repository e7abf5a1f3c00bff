"""The claims of P1 and P2 where errors of fixes last: every simulated one is judged there."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from inswsn_book.judge.review import RERUNS
from inswsn_book.record.project import Project
from inswsn_book.record.results import Results, read_results
from lasting import CHAPTERS, TIMES, prefix, unread, without_lasting

#: What no fix has a part in: the error of the INS alone, and what is sent
UNTOUCHED = {
    "p1-training": ("table2.ins.vx2", "model.step-residual"),
    "p2-fusion": ("traffic.measures-larger",),
}


def test_no_simulated_claim_of_p1_and_p2_is_without_the_reading(known: dict[str, Any]) -> None:
    assert without_lasting(known["judged"]) == []
    assert unread(known["judged"]) == []


@pytest.mark.parametrize("left", [0, 3])
def test_a_claim_without_it_is_found(known: dict[str, Any], left: int) -> None:
    """One that no reading judges, and one for which the last of the times is missing."""
    bare = [
        replace(e, readings=e.readings[:left]) if e.claim.id == "P1-Z-01" else e
        for e in known["judged"]
    ]
    assert without_lasting(bare) == ["P1-Z-01"]
    assert ("P1-Z-01" in unread(bare)) == (left == 0)


def test_hf_passes_the_kalman_filter_between_the_times(
    project: Project, published: dict[str, Results]
) -> None:
    """The chapter's own search for the time, against the reruns before and after it."""
    kept = read_results(project.root / RERUNS / "p1-outages.json")
    turns = published["p1-outages"]["overall.turns"].value
    for time in TIMES:
        assert (kept[f"{prefix(time)}.overall.hf-over-kf"].value > 1) == (time < turns)


@pytest.mark.parametrize("chapter", UNTOUCHED)
def test_what_no_fix_has_a_part_in_is_as_published(
    project: Project, published: dict[str, Results], chapter: str
) -> None:
    """So the reruns are of the chapters as they are; each holds all times."""
    kept = read_results(project.root / RERUNS / f"{chapter}.json")
    for name in UNTOUCHED[chapter]:
        now = published[chapter][name]
        for time in TIMES:
            again = kept[f"{prefix(time)}.{name}"]
            assert again.value == pytest.approx(now.value, abs=now.slack)


def test_every_chapter_has_its_reruns(project: Project) -> None:
    kept = {path.stem for path in (project.root / RERUNS).glob("*.json")}
    assert kept == set(CHAPTERS)
