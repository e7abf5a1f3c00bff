"""Evidence p1-lmi: its results against closed forms and numbers worked out with other programs."""

from __future__ import annotations

import numpy as np
import pytest
from inswsn_book.judge.verdicts import Judged, Verdict
from inswsn_book.record.results import Results
from scipy.linalg import solve_discrete_are

CHAPTER = "p1-lmi"
TRANSITION = np.eye(4)
TRANSITION[0, 2] = TRANSITION[1, 3] = 0.2


BY_HAND = {
    "design.exact.level": 1.01 * 1.489671439,  # the margin; gamma with jitter by SCS
    "cost.unseen": 1 / (1 - 0.8),
    "buildable.minutes": 10.0,
    "proof.2.19.extra": 1.0,
    "printed.largest-entry": 1.602,  # 0.1602e-11, area 2
    # deadbeat, with the jitter of the area: gamma^2 = b^2 (1 + dt^2)
    "printed.h1.gamma1": 4 * (1 + 0.0012**2) ** 0.5,
    "printed.h2.gamma2": 4.0055 * (1 + 0.0008409**2) ** 0.5,
    "printed.h4.gamma1": (4**2 + 0.21**2) ** 0.5,
}


@pytest.mark.parametrize(("name", "expected"), BY_HAND.items())
def test_a_number_worked_out_by_hand(results: Results, name: str, expected: float) -> None:
    assert results[name].value == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "expected", "digits"),
    [
        # with two other solvers, to the digits given
        ("cost.full.exact", 1.48967, 5e-6),
        ("cost.full.printed", 1.48970, 5e-6),
        ("cost.position.exact", 5.635, 5e-4),
        ("cost.position.printed", 8.455, 5e-4),
    ],
)
def test_a_gamma_found_with_another_program(
    results: Results, name: str, expected: float, digits: float
) -> None:
    assert results[name].value == pytest.approx(expected, abs=digits)


def test_the_kalman_end_of_the_curve(results: Results) -> None:
    P = solve_discrete_are(TRANSITION.T, np.eye(4), np.eye(4), np.eye(4))
    assert results["curve.equal.kalman.rms"].value == pytest.approx(np.trace(P) ** 0.5)


def test_the_verdicts_are_those_of_the_proof(judged: dict[str, Judged]) -> None:
    """One step contradicts itself; the theorem and two of its uses fail; the lemma stands."""
    by_id = {name: entry.verdict for name, entry in judged.items()}
    assert by_id.pop("P1-F-2.19") is Verdict.CONTRADICTED
    failed = {name for name, verdict in by_id.items() if verdict is Verdict.NOT_REPRODUCED}
    assert failed == {"P1-Th-2.3", "P1-F-2.25", "P2-F-8"}
    assert len(by_id) == 26
    assert by_id["P1-F-2.14"] is by_id["P2-F-10"] is Verdict.IDENTITY
    # the worst disturbance was simulated
    reproduced = {name for name, verdict in by_id.items() if verdict is Verdict.REPRODUCED}
    assert reproduced == {"P1-F-2.24"}
