"""Drift bounds: closed forms, a theorem, another solver, and motions drawn at random."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from highspy import Highs
from hypothesis import given, settings, strategies as st
from scipy.optimize import linprog, minimize

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.evaluation import MOTIONS, Motion, drift, drift_bound, longest_period
from inswsn_lib.evaluation.drift import DriftBound

SAMPLES = 24
coefficients = st.floats(-10, 10).map(lambda c: round(c, 6))


@cache
def bound_of(motion: Motion) -> DriftBound:
    return drift_bound(motion, SAMPLES)


def walk(coefficient: np.ndarray, start: float, samples: int, period: float) -> tuple:
    """Run P1 (2.1) step by step, in the plainest way: mean |p| and mean |v|."""
    p, total_p, total_v = start, 0.0, 0.0
    for k in range(samples):
        v = sum(c * (k * period) ** j for j, c in enumerate(coefficient))
        total_p += abs(p)
        total_v += abs(v)
        p += period * v
    return total_p / samples, total_v / samples


def test_linear_of_one_sign_is_a_binomial_sum() -> None:
    # the least is at v = k, p = k (k - 1) / 2:
    # mean p / (n mean v) = C(n, 3) / n / (n (n - 1) / 2) = (n - 2) / 3n
    for samples in (4, 7, 50, 100):
        expected = (samples - 2) / (3 * samples)
        assert drift_bound(MOTIONS[0], samples).ratio == pytest.approx(expected)


def test_one_sign_tends_to_the_integrals() -> None:
    # the least mean of 1 - t over non-negative polynomials: 1/2, 1/3, and the smaller node of the
    # two-point Gauss rule on [0, 1], since the best quadratic is a square
    assert drift_bound(Motion("constant", 0, True), 1000).ratio == pytest.approx(1 / 2, abs=1e-3)
    assert drift_bound(MOTIONS[0], 1000).ratio == pytest.approx(1 / 3, abs=1e-3)
    node = (3 - np.sqrt(3)) / 6
    assert drift_bound(MOTIONS[1], 1000).ratio == pytest.approx(node, abs=1e-3)


def test_constant_velocity_from_anywhere_tends_to_a_quarter() -> None:
    # the best start is the middle of the way: mean |t - tau/2| = tau / 4
    assert drift_bound(Motion("constant", 0, False), 400).ratio == pytest.approx(1 / 4, abs=1e-5)


def test_any_linear_velocity_tends_to_an_eighth() -> None:
    errors = [abs(drift_bound(MOTIONS[2], n).ratio - 1 / 8) for n in (20, 40, 80)]
    assert errors[0] > 3.5 * errors[1] > 12 * errors[2]  # second order in 1/n


@settings(max_examples=200)
@given(coefficients, coefficients, coefficients)
def test_the_theorem_of_an_eighth(c0: float, c1: float, c2: float) -> None:
    # a grid of midpoints; the means are exact up to the cells in which p or v changes sign
    x = (np.arange(4000) + 0.5) / 4000
    p, v = c0 + c1 * x + c2 * x**2, c1 + 2 * c2 * x
    scale = abs(c0) + abs(c1) + abs(c2)
    assert np.abs(p).mean() >= np.abs(v).mean() / 8 - 1e-6 * scale


def test_the_theorem_is_tight() -> None:
    x = (np.arange(4000) + 0.5) / 4000 * 2 - 1
    assert np.abs(x**2 - 0.25).mean() / np.abs(2 * x).mean() == pytest.approx(1 / 4, rel=1e-5)


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: motion.name)
@settings(max_examples=60, deadline=None)
@given(values=st.lists(coefficients, min_size=4, max_size=4))
def test_no_motion_of_the_class_is_below_its_bound(motion: Motion, values: list[float]) -> None:
    start, *coefficient = values
    coefficient = coefficient[: motion.degree + 1]
    period = 0.2
    if motion.one_sign:
        # lift the polynomial until it keeps its sign, and start with that sign
        t = np.arange(SAMPLES) * period
        coefficient[0] -= min(0.0, float(np.polynomial.polynomial.polyval(t, coefficient).min()))
        start = abs(start)
    position, velocity = walk(coefficient, start, SAMPLES, period)
    bound = bound_of(motion)
    slack = 1e-9 * (1 + position)
    assert position + slack >= bound.ratio * SAMPLES * period * velocity


@pytest.mark.parametrize("motion", MOTIONS[2:], ids=lambda motion: motion.name)
def test_another_solver_comes_to_the_bound_from_above(motion: Motion) -> None:
    bound = drift_bound(motion, SAMPLES)
    rng = np.random.default_rng(8)

    def ratio(values: np.ndarray) -> float:
        position, velocity = walk(values[1:], values[0], SAMPLES, 1 / SAMPLES)
        return position / velocity

    found = min(
        minimize(
            ratio,
            rng.normal(size=motion.degree + 2),
            method="Nelder-Mead",
            options={"maxiter": 4000, "xatol": 1e-10, "fatol": 1e-13},
        ).fun
        for _ in range(12)
    )
    assert found >= bound.ratio * (1 - 1e-9)
    assert found == pytest.approx(bound.ratio, rel=1e-3)


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: motion.name)
def test_the_attaining_motion_obeys_the_model_and_attains(motion: Motion) -> None:
    bound = drift_bound(motion, SAMPLES)
    position, velocity = bound.position, bound.velocity
    np.testing.assert_allclose(np.diff(position), velocity[:-1], atol=1e-9)
    assert np.abs(position).mean() / (SAMPLES * np.abs(velocity).mean()) == pytest.approx(
        bound.ratio
    )
    assert bound.residual < 1e-12


def test_longest_period_gives_back_the_period_of_the_attaining_motion() -> None:
    bound, period = drift_bound(MOTIONS[2], SAMPLES), 0.2
    # positions scale with the period, velocities do not
    position, velocity = period * np.abs(bound.position).mean(), np.abs(bound.velocity).mean()
    assert longest_period(position, velocity, bound) == pytest.approx(period)


@pytest.mark.parametrize("motion", MOTIONS[1:3], ids=lambda motion: motion.name)
def test_a_solver_that_is_wrong_is_found_out(
    motion: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    honest = drift._largest_multipliers

    def wrong(*problems: Any) -> Any:
        for value, weights, multipliers in honest(*problems):
            yield value * (1.0 + 1e-6), weights, multipliers  # a bound that is a little too good

    monkeypatch.setattr(drift, "_largest_multipliers", wrong)
    with pytest.raises(InswsnError, match="misses its certificate"):
        drift_bound(motion, SAMPLES)


def test_a_solver_that_fails_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    class Stopped(Highs):
        def run(self) -> Any:
            self.setOptionValue("presolve", "off")
            self.setOptionValue("simplex_iteration_limit", 0)
            return super().run()

    monkeypatch.setattr(drift, "Highs", Stopped)
    with pytest.raises(InswsnError, match="drift bound failed: Iteration limit reached"):
        drift_bound(MOTIONS[2], SAMPLES)


def test_each_pattern_has_the_bound_that_another_solver_finds() -> None:
    """One program serves all patterns, from answer to answer: each as if it were alone."""
    rng = np.random.default_rng(4)
    basis, targets = rng.normal(size=(12, 3)), rng.normal(size=(20, 3))
    found = drift._largest_multipliers(basis, np.zeros(3), targets, (-1.0, 1.0))
    for target, (value, weights, multipliers) in zip(targets, found, strict=True):
        alone = linprog(
            [*np.zeros(12), -1.0], A_eq=np.column_stack([basis.T, target]), b_eq=np.zeros(3),
            bounds=[(-1.0, 1.0)] * 12 + [(None, None)],
        )  # fmt: skip
        assert value == pytest.approx(-alone.fun, rel=1e-9)
        assert np.abs(weights @ basis + value * target).max() < 1e-9
        assert np.abs(basis @ multipliers).sum() == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: Motion("cubic", 3, True), "degree"),
        (lambda: drift_bound(MOTIONS[0], 3), "samples"),
        (lambda: longest_period(0.0, 1.0, drift_bound(MOTIONS[0], 4)), "position"),
        (lambda: longest_period(1.0, float("nan"), drift_bound(MOTIONS[0], 4)), "velocity"),
    ],
)
def test_refusals(call: Callable[[], object], name: str) -> None:
    with pytest.raises(ParameterError, match=f"^{name} must be"):
        call()
