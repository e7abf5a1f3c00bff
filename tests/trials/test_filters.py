"""Filters against runs of 50 digits, in decimals and by other formulas, over many noise ratios.

The run of reference takes one component after the other and subtracts, P - P h h' P / s, which 50
digits forgive. What it is given are the floats that the library is given.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Collection
from decimal import Context, Decimal, localcontext
from itertools import product
from typing import NamedTuple

import mpmath
import numpy as np

import inswsn_lib as iw
from inswsn_lib import ErrorModel

RATIOS = [10.0**e for e in (-12, -6, 0, 6, 9, 12)]
EARLY = 1000  # steps after which nothing is left of a start that was uncertain
DIGITS = Context(prec=50, Emax=10**9, Emin=-(10**9))


class Exact(NamedTuple):
    """P before and after the measurement of a step, and the state after it."""

    predicted: np.ndarray
    filtered: np.ndarray
    state: np.ndarray


def decimals(matrix: np.ndarray) -> np.ndarray:
    return np.vectorize(Decimal, otypes=[object])(matrix)


def reference(
    model: ErrorModel, Q: np.ndarray, P0: np.ndarray, y: np.ndarray, shown: Collection[int]
) -> dict[int, Exact]:
    """Return what a Kalman filter of 50 digits has at some steps; R is diagonal."""
    A, C, noise, P = map(decimals, (model.A, model.C, Q, P0))
    r = decimals(np.diag(model.measurement_covariance))
    x, found = decimals(np.zeros(len(A))), {}
    with localcontext(DIGITS):
        for k, row in enumerate(y):
            before = P
            for h, variance, value in zip(C, r, row.tolist(), strict=True):
                if not math.isnan(value):
                    Ph = P @ h
                    gain = Ph / (h @ Ph + variance)
                    x = x + gain * (Decimal(value) - h @ x)
                    P = P - np.outer(gain, Ph)
            if k in shown:
                found[k] = Exact(*(v.astype(float) for v in (before, P, x)))
            x, P = A @ x, A @ P @ A.T + noise
    return found


def constant(model: ErrorModel, gain: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the predictions of a filter of constant gain, in 50 digits, before each step."""
    A, C, B_f = map(decimals, (model.A, model.C, gain))
    x, found = decimals(np.zeros(len(A))), []
    with localcontext(DIGITS):
        for row in decimals(y):
            found.append(x.astype(float))
            x = A @ x + B_f @ (row - C @ x)
    return np.array(found)


def models(ratio: float) -> list[ErrorModel]:
    """Return a position and a velocity, driven by one noise or two, one or both measured."""
    A, size = np.array([[1.0, 1.0], [0.0, 1.0]]), np.sqrt(ratio)
    return [
        ErrorModel(A=A, B=size * B, C=np.eye(2)[:m], D=np.eye(m), period=1.0)
        for B, m in product((np.array([[0.5], [1.0]]), np.diag([0.5, 1.0])), (1, 2))
    ]


def measured(model: ErrorModel, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Return measurements of a run."""
    pushed = rng.standard_normal((steps, model.B.shape[1])) @ model.B.T
    velocity = np.cumsum(pushed[:, 1])
    position = np.cumsum(pushed[:, 0]) + np.append(0, np.cumsum(velocity)[:-1])
    y = np.column_stack([position, velocity])[:, : len(model.C)]
    return y + rng.standard_normal(y.shape)


def missing(y: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return measurements with a gap, and with components that are missing."""
    y, steps = y.copy(), len(y)
    y[steps // 3 : steps // 3 + steps // 20] = np.nan
    y[rng.random(y.shape) < 0.1] = np.nan
    return y


def sizes(covariance: np.ndarray) -> np.ndarray:
    return np.sqrt(np.diag(covariance))


def off(covariance: np.ndarray, exact: np.ndarray) -> float:
    """Return the largest error of an entry, as a share of the product of its two deviations."""
    return float(np.max(np.abs(covariance - exact) / np.outer(sizes(exact), sizes(exact))))


def estimates_off(states: np.ndarray, exact: dict[int, Exact]) -> float:
    return max(
        float(np.max(np.abs(states[k] - e.state) / np.maximum(np.abs(e.state), sizes(e.filtered))))
        for k, e in exact.items()
    )


def constant_gain_off(model: ErrorModel, y: np.ndarray) -> float:
    """Return the largest error of a filter with the steady gain, as a share of the largest.

    Where measurements are missing such a filter may diverge: these are complete.
    """
    gain = iw.predictor_gain(model)
    exact = constant(model, gain, y)
    found = iw.run_hinfinity((model, gain), y, predicted=True)
    return float(np.max(np.abs(found - exact) / np.abs(exact).max(axis=0)))


def test_filters(size: Callable[[int, int], int], seed: int, tell: Callable[[str], None]) -> None:
    rng, steps = np.random.default_rng(seed), size(150, 100_000)
    worst: defaultdict[str, float] = defaultdict(float)
    refused = 0
    for ratio, start in product(RATIOS, (1.0, 1e8)):
        for model in models(ratio):
            many = steps if start == 1 else min(steps, EARLY)
            shown = {*range(60), *np.linspace(0, many - 1, 200).astype(int).tolist()}
            complete, P0 = measured(model, many, rng), start * np.eye(2)
            y = missing(complete, rng)
            exact = reference(model, model.process_covariance, P0, y, shown)
            design = iw.design_kalman(model, ~np.isnan(y), initial_covariance=P0)
            states = iw.run_kalman(model, y, initial_covariance=P0)
            for k, e in exact.items():
                assert np.allclose(design.filtered[k], design.filtered[k].T, rtol=1e-15)
                np.linalg.cholesky(design.filtered[k])  # refuses what is not positive definite
                worst["P"] = max(worst["P"], off(design.predicted[k], e.predicted))
                worst["P+"] = max(worst["P+"], off(design.filtered[k], e.filtered))
            worst["estimate"] = max(worst["estimate"], estimates_off(states, exact))
            if start == 1:
                which = "constant gain beyond 1" if ratio > 1 else "constant gain"
                worst[which] = max(worst[which], constant_gain_off(model, complete))
            # two clusters of twice the variance that hear the same are one
            R = [2 * model.measurement_covariance] * 2
            both = np.stack([y, y])[:, :EARLY]
            early = {k: e for k, e in exact.items() if k < EARLY}
            which = "federated" if start == 1 else "federated from 1e8"
            which = "federated beyond 1e6" if ratio > 1e6 else which
            try:
                fused = iw.run_federated(
                    model, both, measurement_covariance=R, initial_covariance=P0
                )
            except iw.ParameterError:
                refused += 1
                assert ratio > 1e6
                continue
            worst[which] = max(worst[which], estimates_off(fused, early))
    told = ", ".join(f"{name} {value:.0e}" for name, value in worst.items())
    tell(
        f"{4 * len(RATIOS)} runs of {steps} steps, ratios 1e-12 to 1e12, furthest off: {told}; "
        f"{refused} federated ones refused"
    )
    assert worst["P"] < 1e-11
    assert worst["estimate"] < 1e-7  # a velocity near zero, beside a position of 1e13
    assert worst["P+"] < 1e-8
    assert worst["constant gain"] < 1e-10
    # a velocity, beside a position of 10^5 times its size
    assert worst["constant gain beyond 1"] < 1e-8
    assert worst["federated"] < 1e-7
    assert worst["federated from 1e8"] < 1e-6
    assert worst["federated beyond 1e6"] < 1e-3
    assert refused <= 4  # of those with one noise alone, at 1e12


def test_steady_states_by_their_closed_forms() -> None:
    """Kalata's (1984) of the alpha-beta tracker, and the root of P^2 = q P + q of a random walk."""
    with mpmath.workdps(50):
        for ratio in (10.0**e for e in range(-12, 13)):
            q = mpmath.mpf(ratio)
            r = (4 + mpmath.sqrt(q) - mpmath.sqrt(8 * mpmath.sqrt(q) + q)) / 4
            alpha = 1 - r**2
            beta = 2 * (2 - alpha) - 4 * mpmath.sqrt(1 - alpha)
            tracker = models(ratio)[0]
            gain = [float(alpha + beta), float(beta)]
            np.testing.assert_allclose(iw.predictor_gain(tracker).ravel(), gain, rtol=1e-9)
            P = (q + mpmath.sqrt(q**2 + 4 * q)) / 2
            walk = ErrorModel(A=[[1]], B=[[np.sqrt(ratio)]], C=[[1]], D=[[1]], period=1.0)
            np.testing.assert_allclose(iw.predictor_gain(walk), float(P / (P + 1)), rtol=1e-9)
            found = iw.steady_error(walk, [[float(P / (P + 1))]])
            np.testing.assert_allclose(found, float(mpmath.sqrt(P)), rtol=1e-9)
