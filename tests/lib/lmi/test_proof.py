"""P1's proof step by step: which steps are equivalences, and the one that is not."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import (
    certify,
    design_filter,
    negative_definite,
    printed_steps,
)
from inswsn_lib.models import ErrorModel

STEPS = ("2.16", "2.18", "2.19", "2.20", "2.21")


def draw(seed: int) -> dict[str, object]:
    """Return a random system with a P that is drawn so that the steps are true about half the time.

    P is the solution of the recursion of the lemma, a little wide, or not wide enough.
    """
    rng = np.random.default_rng(seed)
    A = rng.uniform(0.2, 0.9) * np.linalg.qr(rng.standard_normal((3, 3)))[0]
    E, B, L = 0.2 * rng.standard_normal((3, 3)), rng.standard_normal((3, 2)), np.eye(3)
    P = np.eye(3)
    for _ in range(200):
        P = A.T @ P @ A + E.T @ P @ E + rng.uniform(1.0, 1.5) * L.T @ L
        if not np.isfinite(P).all():
            break
    P *= rng.uniform(0.9, 2.0)
    return {"A": A, "B": B, "E": E, "L": L, "P": (P + P.T) / 2, "gamma": rng.uniform(2.0, 40.0)}


def test_each_step_is_an_equivalence_but_one() -> None:
    agree, seen = Counter[str](), Counter[bool]()
    for seed in range(400):
        truth = {name: negative_definite(m) for name, m in printed_steps(**draw(seed)).items()}  # type: ignore[arg-type]
        assert tuple(truth) == STEPS
        seen[truth["2.16"]] += 1
        for before, after in pairwise(STEPS):
            agree[after] += truth[before] == truth[after]
        assert truth["2.18"] or not truth["2.19"]  # (2.19) asks for more
    assert min(seen.values()) > 40  # both cases occur
    assert agree["2.18"] == agree["2.20"] == agree["2.21"] == 400
    assert agree["2.19"] < 380


def test_the_step_that_fails_adds_the_term_that_is_there() -> None:
    given = draw(3)
    steps = printed_steps(**given)  # type: ignore[arg-type]
    A, P = given["A"], given["P"]
    assert isinstance(A, np.ndarray)
    difference = steps["2.19"] - steps["2.18"]
    assert difference[:3, :3] == pytest.approx(A.T @ P @ A)
    difference[:3, :3] = 0
    assert np.abs(difference).max() < 1e-9


def test_a_scalar_by_hand() -> None:
    """a = 0.8, b = l = 1, no jitter, P = 3, gamma = 5: -3 + 1.92 + 1 + 2.4^2 / 22 = 0.18."""
    steps = printed_steps([[0.8]], [[1.0]], [[0.0]], [[1.0]], [[3.0]], 5.0)
    assert steps["2.16"][0, 0] == pytest.approx(-3 + 1.92 + 1 + 5.76 / 22)
    wide = printed_steps([[0.8]], [[1.0]], [[0.0]], [[1.0]], [[6.0]], 10.0)
    assert negative_definite(wide["2.18"])  # -6 + 3.84 + 1 + 4.8^2 / 94 < 0
    assert not negative_definite(wide["2.19"])  # -6 + 7.68 + 1 > 0: no P whatever does it
    for P in np.linspace(0.1, 1000, 50):
        assert not negative_definite(
            printed_steps([[0.8]], [[1.0]], [[0.0]], [[1.0]], [[P]], 1e6)["2.19"]
        )


def test_the_last_step_is_what_the_printed_design_solves() -> None:
    model = ErrorModel.p1(0.2)
    for form in ("exact", "printed"):
        design = design_filter(model, form)  # type: ignore[arg-type]
        B = np.hstack([model.B, -design.gain @ model.D])
        steps = printed_steps(design.A_f, B, model.E, model.L, design.P, 1.001 * design.level)
        assert negative_definite(steps["2.16"])
        assert certify(model, design.P, design.gain, design.level, form)  # type: ignore[arg-type]
        if form == "printed":
            assert negative_definite(steps["2.21"])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"P": np.eye(2)}, "P is"),
        ({"P": np.triu(np.ones((3, 3)))}, "P is 'not symmetric'"),
        ({"E": np.full((3, 3), np.nan)}, "E is"),
        ({"B": np.eye(2)}, "A, B, C is"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict[str, object], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        printed_steps(**(draw(1) | changes))  # type: ignore[arg-type]
