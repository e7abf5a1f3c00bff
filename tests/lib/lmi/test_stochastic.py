"""Gains with multiplicative noise: closed forms, one big matrix, all courses, and simulations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import (
    finite_horizon_gain,
    hinf_norm,
    mean_square_radius,
    stochastic,
    stochastic_gain,
    worst_disturbance,
)
from inswsn_lib.lmi.stochastic import riccati_gain_below

ONE = [[1.0]]
ZERO = np.zeros((3, 3))


def random_system(seed: int, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((3, 3))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    return A, rng.standard_normal((3, 2)), rng.standard_normal((2, 3))


def over_all_courses(A: np.ndarray, E: np.ndarray, B: np.ndarray, L: np.ndarray, N: int) -> float:
    """Return the gain over N steps: the norm of the map of the inputs of all courses of the jitter.

    The jitter is +-1. An input may depend on the course so far; inputs and outputs are weighted by
    the root of the probability of their course.
    """
    inputs, courses = B.shape[1], [tuple[int, ...]()]
    places: dict[tuple[int, ...], int] = {}
    for _ in range(N):
        places |= {course: len(places) + i for i, course in enumerate(courses)}
        courses = [(*course, sign) for course in courses for sign in (1, -1)]
    rows = []
    for course in courses:  # of all steps; a course so far has many of them
        state = np.zeros((len(A), inputs * len(places)))
        for k in range(N):
            state = (A + course[k] * E) @ state
            at = inputs * places[course[:k]]
            state[:, at : at + inputs] += 2 ** (k / 2) * B
            rows.append(L @ state / 2 ** (N / 2))
    return float(np.linalg.norm(np.vstack(rows), 2))


def test_the_radius_is_the_growth_of_the_second_moment() -> None:
    """X+ = A X A' + sum E X E' from the identity, step by step."""
    rng = np.random.default_rng(2)
    A, E = rng.normal(size=(3, 3)) / 2, rng.normal(size=(2, 3, 3)) / 4
    X = np.eye(3)
    for _ in range(300):
        before, X = X, A @ X @ A.T + sum(e @ X @ e.T for e in E)
    assert mean_square_radius(A, E) == pytest.approx(np.trace(X) / np.trace(before), rel=1e-9)
    assert mean_square_radius([[0.9]], [[0.5]]) == pytest.approx(0.81 + 0.25)


@pytest.mark.parametrize(
    ("a", "jumps"), [(0.0, []), (0.0, [0.8]), (0.5, [0.3]), (-0.2, [0.6]), (0.5, [0.2, 0.1])]
)
def test_a_scalar_by_hand(a: float, jumps: list[float]) -> None:
    """x+ = (a + sum e beta) x + s, z = x has the gain 1 / (sqrt(1 - sum e^2) - |a|)."""
    E = np.reshape(jumps or [0.0], (-1, 1, 1))
    expected = 1 / ((1 - np.sum(E**2)) ** 0.5 - abs(a))
    for b in (1.0, 1e-200):
        found = stochastic_gain([[a]], E, [[b]], ONE, relative=1e-3)
        assert expected <= found / b <= expected * (1 + 1.1e-3)
    system = np.array([[a]]), E, np.array([[2.0]]), np.array([[-3.0]])
    assert riccati_gain_below(*system, 6.001 * expected)
    assert not riccati_gain_below(*system, 5.999 * expected)


def test_a_plant_that_is_not_stable_has_no_gain() -> None:
    assert stochastic_gain([[0.9]], [[0.5]], ONE, ONE) == np.inf  # 0.81 + 0.25 > 1
    assert stochastic_gain([[1.0]], [[0.0]], ONE, ONE) == np.inf
    assert stochastic_gain([[0.5]], [[0.0]], [[0.0]], ONE) == 0
    # nor one of which L sees the unstable mode hardly or not at all
    for A, E in ((np.diag([0.5, 1.1]), 0.0), (np.diag([0.5, 0.9]), 0.6), (np.diag([0.5, 1]), 0.0)):
        for seen in (1e-9, 0.0):
            L = np.diag([1.0, seen])
            assert not riccati_gain_below(A, np.diag([0, E]), np.eye(2), L, 1e3)
            assert stochastic_gain(A, np.diag([0, E]), np.eye(2), L) == np.inf


def test_a_gain_is_told_at_its_edge() -> None:
    """However slowly the plain recursion goes there: 1 / (1 - a) for a of nearly 1."""
    for a in (0.5, 0.999):
        plant, zero, one = np.array([[a]]), np.zeros((1, 1)), np.eye(1)
        assert riccati_gain_below(plant, zero, one, one, (1 + 1e-6) / (1 - a))
        assert not riccati_gain_below(plant, zero, one, one, (1 - 1e-6) / (1 - a))


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_without_jitter_it_is_the_norm(seed: int) -> None:
    A, B, L = random_system(seed, 0.8)
    norm = hinf_norm(A, B, L)
    assert riccati_gain_below(A, ZERO, B, L, norm * 1.01)
    assert not riccati_gain_below(A, ZERO, B, L, norm * 0.999)
    assert norm <= stochastic_gain(A, ZERO, B, L, 1e-3) <= norm * (1 + 2e-3)


def test_near_instability_it_cannot_be_told(monkeypatch: pytest.MonkeyPatch) -> None:
    assert stochastic_gain([[0.5]], [[0.8]], ONE, ONE, 1e-2) == pytest.approx(10, rel=2e-2)
    monkeypatch.setattr(stochastic, "_DOUBLINGS", 1)  # to 2 and 4
    with pytest.raises(ParameterError) as caught:
        stochastic_gain([[0.5]], [[0.8]], ONE, ONE)
    assert str(caught.value) == "A and E must be farther from instability, not so near it."


@settings(max_examples=40)
@given(seed=st.integers(0, 10**6), radius=st.floats(0.1, 1.3), steps=st.integers(1, 12))
def test_over_a_horizon_it_is_a_singular_value(seed: int, radius: float, steps: int) -> None:
    """Stable or not: of the map from all disturbances to all outputs, of blocks L A^(k-j-1) B."""
    A, B, L = random_system(seed, radius)
    blocks = np.zeros((steps + 1, 2, steps, 2))
    for k in range(steps + 1):
        for j in range(k):
            blocks[k, :, j] = L @ np.linalg.matrix_power(A, k - j - 1) @ B
    exact = np.linalg.norm(blocks.reshape(2 * steps + 2, 2 * steps), 2)
    found = finite_horizon_gain(A, ZERO, B, L, steps)
    assert exact * (1 - 1e-12) <= found <= exact * (1 + 2e-9)


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), steps=st.integers(1, 5))
def test_with_jitter_it_is_a_singular_value_over_all_courses(seed: int, steps: int) -> None:
    A, B, L = random_system(seed, 0.8)
    E = 0.3 * np.random.default_rng(seed).standard_normal((3, 3))
    counted = over_all_courses(A, E, B, L, steps)
    assert finite_horizon_gain(A, E, B, L, steps) == pytest.approx(counted, rel=1e-8)


def test_two_steps_by_hand() -> None:
    """x_1 = s_0; E x_2^2 = (a^2 + e^2 + f^2) s_0^2 + 2 a s_0 s_1 + s_1^2: two noises."""
    a, e, f = 0.5, 0.7, 0.3
    energy = np.array([[1 + a**2 + e**2 + f**2, a], [a, 1.0]])
    expected = np.linalg.eigvalsh(energy).max() ** 0.5
    E = np.reshape([e, f], (2, 1, 1))
    assert finite_horizon_gain([[a]], E, ONE, ONE, 2) == pytest.approx(expected, rel=1e-8)
    assert finite_horizon_gain([[a]], E, ONE, ONE, 1) == pytest.approx(1)


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), steps=st.integers(1, 12), size=st.sampled_from([1, 1e-3, 50]))
def test_the_worst_disturbance_attains_the_gain(seed: int, steps: int, size: float) -> None:
    A, B, L = random_system(seed, 0.9)
    worst = worst_disturbance(A, ZERO, size * B, L, steps)
    x, s, spent, seen = np.zeros(3), worst.first, 0.0, 0.0
    assert worst.feedback.shape == (steps - 1, 2, 3)
    assert np.linalg.norm(s) == pytest.approx(1)
    for k in range(steps):
        s = s if k == 0 else worst.feedback[k - 1] @ x
        spent += s @ s
        x = A @ x + size * B @ s
        seen += np.sum((L @ x) ** 2)
    assert np.sqrt(seen / spent) == pytest.approx(worst.gain, rel=1e-4)
    assert worst.gain == finite_horizon_gain(A, ZERO, size * B, L, steps)


def test_with_jitter_the_mean_energy_attains_the_gain() -> None:
    """A scalar plant, all signs of beta of equal weight: 2^8 ways, so that the mean is exact."""
    steps = 8
    worst = worst_disturbance([[0.9]], [[0.4]], ONE, ONE, steps)
    signs = 1 - 2.0 * ((np.arange(2**steps)[:, None] >> np.arange(steps)) & 1)
    x, spent, seen = np.zeros(2**steps), 0.0, 0.0
    for k in range(steps):
        s = worst.first[0] * np.ones_like(x) if k == 0 else worst.feedback[k - 1, 0, 0] * x
        spent += np.mean(s**2)
        x = (0.9 + 0.4 * signs[:, k]) * x + s
        seen += np.mean(x**2)
    assert np.sqrt(seen / spent) == pytest.approx(worst.gain, rel=1e-4)


def test_it_rises_with_the_horizon_to_the_gain_over_all_time() -> None:
    A, B, L = random_system(5, 0.5)
    E = 0.1 * np.random.default_rng(5).standard_normal((3, 3))
    gains = [finite_horizon_gain(A, E, B, L, n, 1e-8) for n in (1, 2, 5, 20, 50)]
    assert gains == sorted(gains)
    assert gains[0] == pytest.approx(np.linalg.norm(L @ B, 2), rel=1e-7)
    assert 0.995 * stochastic_gain(A, E, B, L, 1e-4) < gains[-1] < stochastic_gain(A, E, B, L, 1e-4)


@pytest.mark.parametrize("tau", [3, 10, 30])
def test_a_state_that_is_not_seen_does_not_spoil_it(tau: float) -> None:
    """What a filter that does not know the jitter leaves of its own position: L sees none of it.

    It is the limit of the gains over a horizon, to whatever accuracy it is asked for.
    """
    forgets = np.exp(-0.2 / tau)
    A, E = forgets * np.array([[1.0, 0.2], [0.0, 1.0]]), np.array([[0.0, 0.0012], [0.0, 0.0]])
    gain, none, eye = 0.8 * A, np.zeros((2, 2)), np.eye(2)
    plant = (
        np.block([[A - gain, none], [none, A]]), np.block([[none, E], [none, E]]),
        np.block([[eye, -gain], [eye, none]]), np.hstack([eye, none]),
    )  # fmt: skip
    limit = finite_horizon_gain(*plant, 10_000, 1e-7)
    for relative in (1e-2, 1e-4, 1e-5):
        assert limit * (1 - 1e-6) <= stochastic_gain(*plant, relative) <= limit * (1 + 2 * relative)


def test_numbers_whose_squares_are_none() -> None:
    A, B, L = random_system(4, 0.9)
    gain = finite_horizon_gain(A, ZERO, B, L, 6)
    for b, c in ((1e-200, 1.0), (1e-150, 1e140), (1e200, 1e-100)):
        assert finite_horizon_gain(A, ZERO, b * B, c * L, 6) == pytest.approx(gain * b * c)
        # the state is b times larger, so the feedback is b times smaller
        worst, one = (worst_disturbance(A, ZERO, s * B, c * L, 6).feedback for s in (b, 1.0))
        assert b * worst == pytest.approx(one, abs=1e-3 * np.abs(one).max())
    # what is seen one step later, of whatever size
    late = finite_horizon_gain([[0, 1e-9], [0, 0]], np.zeros((2, 2)), [[0], [1]], [[1, 0]], 2)
    assert late == pytest.approx(1e-9, rel=1e-8)


def test_no_output_or_no_input_has_no_gain() -> None:
    A, B, L = random_system(2, 0.5)
    assert finite_horizon_gain(A, ZERO, B, 0 * L, 4) == 0
    assert finite_horizon_gain(A, ZERO, 0 * B, L, 4) == 0
    none = worst_disturbance(A, ZERO, B, 0 * L, 4)
    assert (none.gain, none.first.tolist(), none.feedback.shape) == (0, [1, 0], (3, 2, 3))
    assert not none.feedback.any()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"steps": 0}, "steps must be .* at least 1, not 0"),
        ({"relative": 0.0}, "relative must be .* at least 1e-14 and below 1, not 0.0"),
        ({"relative": 1.0}, "relative .* not 1.0"),
        ({"A": [[1.0, 2.0]]}, "A must be"),
        ({"B": np.eye(2)}, "B must be"),
        ({"L": np.eye(2)}, "L must be"),
        ({"E": np.eye(2)}, r"E must be .* \(1, 1\) or \(k, 1, 1\)"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict[str, Any], said: str) -> None:
    for function, options in (
        (finite_horizon_gain, {"steps": 3, "relative": 1e-3}),
        (worst_disturbance, {"steps": 3}),
        (stochastic_gain, {"relative": 1e-3}),
        (mean_square_radius, {}),
    ):
        known: dict[str, Any] = {"A": [[0.5]], "E": [[0.0]], "B": ONE, "L": ONE} | options
        known = {n: known[n] for n in "AE"} if function is mean_square_radius else known
        if {*changes} <= {*known}:
            with pytest.raises(ParameterError, match=f"^{said}"):
                function(**(known | changes))


def test_a_gain_that_is_no_number_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    assert finite_horizon_gain([[2.0]], [[0.0]], ONE, ONE, 30) > 2**29
    monkeypatch.setattr(stochastic, "_DOUBLINGS_FROM_NOTHING", 20)
    with pytest.raises(ParameterError) as caught:
        finite_horizon_gain([[2.0]], [[0.0]], ONE, ONE, 30)
    assert str(caught.value) == "steps must be few enough for the gain to be finite, not 30."
    with pytest.raises(ParameterError):  # its energy overflows on the way there
        finite_horizon_gain([[1e200]], [[0.0]], ONE, ONE, 3)
