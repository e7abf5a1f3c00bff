"""The Kalman filter against filterpy, least squares, the Riccati equation and closed forms."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import mpmath
import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from hypothesis import given, strategies as st
from random_filters import random_covariances, random_model
from scipy.linalg import block_diag, solve_discrete_are, solve_discrete_lyapunov

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import (
    deadbeat_gain,
    design_kalman,
    kalman,
    predictor_gain,
    run_kalman,
    steady_error,
    stream_kalman,
)
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))


def walk(a: float = 1.0, b: float = 1.0, c: float = 1.0, d: float = 1.0) -> ErrorModel:
    return ErrorModel(A=[[a]], B=[[b]], C=[[c]], D=[[d]], period=1.0)


def least_squares(
    A: np.ndarray,
    C: np.ndarray,
    y: np.ndarray,
    start: np.ndarray,
    P0: np.ndarray,
    Q: np.ndarray,
    R: Any,
    control: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the last state that fits all measurements best, by one big regression, and its P.

    Unknowns are all states. Rows: the first state, each transition, each measurement.
    """
    steps, n = len(y), len(start)

    def at(k: int, block: np.ndarray) -> np.ndarray:
        row = np.zeros((len(block), n * steps))
        row[:, n * k : n * (k + 1)] = block
        return row

    rows, right, weights = [at(0, np.eye(n))], [start], [np.linalg.inv(P0)]
    for k in range(1, steps):
        rows.append(at(k, np.eye(n)) - at(k - 1, A[k - 1]))
        right.append(control[k - 1])
        weights.append(np.linalg.inv(Q[k - 1]))
    for k, measured in enumerate(y):
        seen = ~np.isnan(measured)
        rows.append(at(k, C[k][seen]))
        right.append(measured[seen])
        weights.append(np.linalg.inv(R[k][np.ix_(seen, seen)]))
    H, W = np.vstack(rows), block_diag(*weights)
    P = np.linalg.inv(H.T @ W @ H)
    return (P @ H.T @ W @ np.concatenate(right))[-n:], P[-n:, -n:]


@given(
    st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 3), st.floats(0, 0.9),
    st.booleans(),
)  # fmt: skip
def test_it_is_least_squares_whatever_is_missing_and_changes(
    seed: int, n: int, m: int, missing: float, moving: bool
) -> None:
    rng = np.random.default_rng(seed)
    model, steps, runs = random_model(rng, n, m), 6, 3
    y, start = rng.normal(size=(steps, m, runs)), rng.normal(size=(n, runs))
    y[rng.random(y.shape) < missing] = np.nan  # another pattern in each run
    P0, Q = random_covariances(rng, n), random_covariances(rng, n, steps)
    R = random_covariances(rng, m, steps)
    noise: dict[str, Any] = {"initial_covariance": P0, "process_covariance": Q,
                             "measurement_covariance": R}  # fmt: skip
    A, C, control = np.array([model.A] * steps), np.array([model.C] * steps), np.zeros((6, n, runs))
    if moving:
        others = [random_model(rng, n, m) for _ in range(steps)]
        A, C = np.array([each.A for each in others]), np.array([each.C for each in others])
        control = rng.normal(size=control.shape)
        noise |= {"A": A, "C": C}
    added = {"control": control} if moving else {}
    filtered = run_kalman(model, y, initial_state=start, **noise, **added)
    ahead = run_kalman(model, y, initial_state=start, predicted=True, **noise, **added)
    assert ahead[0] == pytest.approx(start)
    assert ahead[1:] == pytest.approx((A @ filtered + control)[:-1], rel=1e-9, abs=1e-9)
    for run in range(runs):
        own = {"control": control[:, :, run]} if moving else {}
        expected, P = least_squares(A, C, y[:, :, run], start[:, run], P0, Q, R, control[:, :, run])
        assert filtered[-1, :, run] == pytest.approx(expected, rel=1e-6, abs=1e-7)
        design = design_kalman(model, ~np.isnan(y[:, :, run]), **noise)
        assert design.filtered[-1] == pytest.approx(P, rel=1e-6, abs=1e-9)
        alone = run_kalman(model, y[:, :, [run]], initial_state=start[:, run], **noise, **own)
        assert filtered[:, :, [run]] == pytest.approx(alone, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("predicted", [False, True])
@pytest.mark.parametrize("far", [1.0, 1e8])  # with square roots of covariances, too
def test_matrices_of_each_step_and_a_control_compiled_and_plain(
    monkeypatch: pytest.MonkeyPatch, far: float, predicted: bool
) -> None:
    """Of sines of each step; repeated, they are the model's own; B is its covariance B B'."""
    rng, steps, runs = np.random.default_rng(5), 40, 5
    y = rng.normal(size=(steps, 4, runs))
    y[rng.random(y.shape) < 0.4] = np.nan
    turns = 1 + 0.3 * np.sin(np.arange(steps))[:, None, None]
    moving = {"A": turns * MODEL.A, "B": turns * MODEL.B, "C": MODEL.C / turns}
    same = {name: np.array([getattr(MODEL, name)] * steps) for name in moving}
    words: dict[str, Any] = {"initial_covariance": far * np.eye(4), "predicted": predicted}
    control, found = rng.normal(size=(steps, 4)), []
    for plain in "01":
        monkeypatch.setenv("INSWSN_PLAIN", plain)
        found += [
            run_kalman(MODEL, y, control=control, **moving, **words),
            run_kalman(MODEL, y, **same, **words) - run_kalman(MODEL, y, **words),
        ]
    B = moving.pop("B")
    given = run_kalman(
        MODEL, y, control=control, process_covariance=B @ np.swapaxes(B, 1, 2), **moving, **words
    )
    assert found[2] == pytest.approx(found[0], rel=1e-6, abs=1e-7)
    assert given == pytest.approx(found[0], rel=1e-6, abs=1e-7)
    assert np.abs(found[1::2]).max() < 1e-7


def test_matrices_that_do_not_fit_the_steps_are_refused() -> None:
    for name in "ABC":
        wrong = np.array([getattr(MODEL, name)] * 3)
        with pytest.raises(ParameterError, match=rf"^{name} must be"):
            run_kalman(MODEL, np.zeros((4, 4)), initial_covariance=np.eye(4), **{name: wrong})
    with pytest.raises(ParameterError, match=r"^control must be"):
        run_kalman(MODEL, np.zeros((4, 4)), initial_covariance=np.eye(4), control=np.zeros((4, 1)))


def test_gains_and_covariances_of_a_walk_are_ratios_of_fibonacci_numbers() -> None:
    design = design_kalman(walk(), np.full((4, 1), True), initial_covariance=[[1.0]])
    before = np.array([1 / 1, 3 / 2, 8 / 5, 21 / 13])
    after = np.array([1 / 2, 3 / 5, 8 / 13, 21 / 34])
    assert design.predicted.ravel() == pytest.approx(before)
    assert design.filtered.ravel() == pytest.approx(after)
    assert design.gains.ravel() == pytest.approx(after)
    assert design.innovation.ravel() == pytest.approx(before + 1)


def test_a_component_that_is_missing_has_no_gain_and_an_innovation_all_the_same() -> None:
    there = np.ones((3, 4), bool)
    there[1, 2] = there[2] = False
    design = design_kalman(MODEL, there, initial_covariance=np.eye(4))
    assert not design.gains[1, :, 2].any()
    assert not design.gains[2].any()
    assert design.filtered[2] == pytest.approx(design.predicted[2])
    for P, S in zip(design.predicted, design.innovation, strict=True):
        assert pytest.approx(P + MODEL.measurement_covariance) == S


def test_the_steady_state_is_that_of_the_riccati_equation() -> None:
    model = random_model(np.random.default_rng(5), 3, 2)
    Q, R = model.process_covariance, model.measurement_covariance
    P = solve_discrete_are(model.A.T, model.C.T, Q, R)
    design = design_kalman(model, np.ones((400, 2), bool), initial_covariance=np.eye(3))
    assert design.predicted[-1] == pytest.approx(P, rel=1e-9, abs=1e-12)
    assert predictor_gain(model) == pytest.approx(model.A @ design.gains[-1], abs=1e-9)
    assert predictor_gain(walk()).item() == pytest.approx((5**0.5 - 1) / 2)


def gain_by_50_digits(model: ErrorModel) -> np.ndarray:
    """Return the steady gain by doubling: each turn takes twice the steps of the recursion of P."""
    with mpmath.workdps(50):
        A, B, C, D = (mpmath.matrix(X.tolist()) for X in (model.A, model.B, model.C, model.D))
        F, G, P, R = A.T, C.T * (D * D.T) ** -1 * C, B * B.T, D * D.T
        for _ in range(40):
            W = (mpmath.eye(P.rows) + G * P) ** -1
            F, G, P = F * W * F, G + F * W * G * F.T, P + F.T * P * W * F
        S = C * P * C.T + R
        gain = A * P * C.T * S**-1
        assert mpmath.norm(A * P * A.T + B * B.T - gain * S * gain.T - P) < 1e-30 * mpmath.norm(P)
        return np.array(gain.tolist(), float)


@pytest.mark.parametrize("size", [1.0, 10.0])
@pytest.mark.parametrize("seen", [[1, 1, 1], [1, 2, 3]])
def test_the_steady_gain_where_one_output_hardly_tells_two_modes_apart(
    size: float, seen: list[int]
) -> None:
    """Unscaled it was up to 3.6 times its size off, or said to be none."""
    T = np.array([[1, 1, 0], [0, 1, 1], [1, 0, 2]])
    A = T @ np.diag([1, -1, -1.00000008]) @ np.linalg.inv(T)
    model = ErrorModel(A=A, B=size * np.eye(3), C=[seen], D=[[1]], period=1.0)
    exact = gain_by_50_digits(model)
    assert predictor_gain(model) == pytest.approx(exact, abs=1e-4 * np.abs(exact).max())


def test_without_noise_in_the_measurement_it_follows_the_measurement() -> None:
    model = ErrorModel.p1(0.2, measurement_noise=(0.0, 0.0))
    y = np.random.default_rng(1).normal(size=(5, 4, 2))
    assert run_kalman(model, y, initial_covariance=np.eye(4)) == pytest.approx(y, abs=1e-9)


def test_a_design_of_no_steps_and_sums_that_overflow() -> None:
    two = replace(MODEL, C=np.eye(2, 4), D=np.eye(2))
    design = design_kalman(two, np.ones((0, 2), bool), initial_covariance=np.eye(4))
    assert design.gains.shape == (0, 4, 2)
    assert design.predicted.shape == design.filtered.shape == (0, 4, 4)
    assert design.innovation.shape == (0, 2, 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        large = np.full((2, 4, 3), 1e308)
        found = run_kalman(ErrorModel.p1(1.0), large, initial_covariance=np.eye(4))
    assert found[0] == pytest.approx(0.5e308)


@pytest.mark.parametrize("k", [0.2, 0.6, 1.0, 1.4])
def test_the_error_of_a_scalar_gain_by_hand(k: float) -> None:
    """(b^2 + k^2 d^2) / (2 k - k^2)."""
    expected = ((0.7**2 + k**2 * 0.3**2) / (2 * k - k**2)) ** 0.5
    assert steady_error(walk(b=0.7, d=0.3), [[k]]) == pytest.approx(expected)


def test_a_deadbeat_error_is_two_noises_of_what_l_sees() -> None:
    model = ErrorModel.p1(0.2, process_noise=(2.0, 1.0), measurement_noise=(0.5, 0.4))
    # x axis: position b^2 + d^2 + T^2 dv^2, velocity bv^2 + dv^2; twice for two axes
    position, velocity = 2**2 + 0.5**2 + 0.2**2 * 0.4**2, 1 + 0.4**2
    gain = deadbeat_gain(model)
    assert steady_error(model, gain) == pytest.approx((2 * (position + velocity)) ** 0.5)
    seen = replace(model, L=np.eye(2, 4))
    assert steady_error(seen, gain) == pytest.approx((2 * position) ** 0.5)


def test_no_gain_has_a_smaller_error_than_the_predictor() -> None:
    best = predictor_gain(MODEL)
    closed, driven = MODEL.A - best @ MODEL.C, np.hstack([MODEL.B, -best @ MODEL.D])
    least = np.sqrt(np.trace(solve_discrete_lyapunov(closed, driven @ driven.T)))
    assert steady_error(MODEL, best) == pytest.approx(least)
    rng = np.random.default_rng(1)
    for _ in range(20):
        assert steady_error(MODEL, best + 0.05 * rng.standard_normal((4, 4))) > least


@pytest.mark.parametrize(
    "model",
    [
        walk(1.2, c=0.0),  # not measured
        walk(b=0.0),  # on the unit circle, not driven
        walk(c=0.0, d=0.0),
        ErrorModel.p1(0.2, process_noise=(1.0, 0.0)),
    ],
)
def test_without_a_steady_state_there_is_no_gain(model: ErrorModel) -> None:
    with pytest.raises(ParameterError) as caught:
        predictor_gain(model)
    may_be = "one whose Riccati equation has a stable solution"
    assert str(caught.value) == f"model must be {may_be}, not one without a steady state."
    assert steady_error(model, np.zeros_like(model.C.T)) == np.inf


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("initial_covariance", np.eye(3)),
        ("process_covariance", np.triu(np.ones((4, 4)))),
        ("measurement_covariance", np.zeros((9, 4, 4))),
        ("measurement_covariance", np.zeros((4, 4))),  # with P_0 = 0 an innovation is certain
    ],
)
def test_what_does_not_fit_is_refused(name: str, value: np.ndarray) -> None:
    given = {"measurements": np.zeros((5, 4, 1)), "initial_covariance": np.zeros((4, 4))}
    with pytest.raises(ParameterError) as caught:
        run_kalman(MODEL, **(given | {name: value}))
    assert caught.value.name == name
    if value.shape == (4, 4) and not value.any():
        assert str(caught.value).endswith("not such that an innovation has no variance.")


def test_masks_and_gains_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ParameterError, match="available"):
        design_kalman(MODEL, np.ones((3, 4)), initial_covariance=np.eye(4))
    with pytest.raises(ParameterError, match="gain"):
        steady_error(MODEL, np.eye(2))


def test_pieces_of_other_runs_are_refused() -> None:
    pieces = stream_kalman(MODEL, map(np.ones, [(2, 4, 3), (2, 4)]), initial_covariance=np.eye(4))
    next(pieces)
    with pytest.raises(ParameterError, match=r"measurements .* not of shape"):
        next(pieces)


def test_states_that_have_nothing_to_do_with_one_another_are_filtered_apart() -> None:
    """Two axes and a constant that nobody measures, in any order, are three filters."""
    rng = np.random.default_rng(4)
    order = np.array([2, 0, 4, 3, 1])
    A, B = np.eye(5), np.diag([0.1, 0.2, 0.1, 0.2, 0.0])
    A[0, 1] = A[2, 3] = 0.2
    C = np.eye(5)[[0, 2, 1]]
    plain = ErrorModel(A=A, B=B, C=C, D=np.eye(3), period=0.2)
    mixed = ErrorModel(
        A=A[np.ix_(order, order)], B=B[order], C=C[:, order], D=np.eye(3), period=0.2
    )
    y = np.where(rng.random((30, 3, 40)) < 0.3, np.nan, rng.normal(size=(30, 3, 40)))
    told = kalman._Steps.of(mixed, None, None)
    parts = kalman._parts(kalman._Covariances.start(mixed, np.eye(5)), told)
    assert sorted((len(states), len(outputs)) for states, outputs in parts) == [
        (1, 0),
        (2, 1),
        (2, 2),
    ]
    found = run_kalman(mixed, y, initial_covariance=np.eye(5))
    one = np.eye(5) + 1e-30 * np.ones((5, 5))  # ties them all
    assert found == pytest.approx(run_kalman(plain, y, initial_covariance=one)[:, order], abs=1e-9)


def test_it_is_filterpys_filter_with_gaps_and_all() -> None:
    y = np.random.default_rng(13).normal(size=(40, 4, 3))
    y[10:15] = np.nan
    P0 = np.diag([1.0, 2.0, 0.25, 0.5])
    ours = run_kalman(MODEL, y, initial_covariance=P0)
    for run in range(3):
        theirs = KalmanFilter(dim_x=4, dim_z=4)
        theirs.F, theirs.H, theirs.P = MODEL.A, MODEL.C, P0.copy()
        theirs.Q, theirs.R = MODEL.process_covariance, MODEL.measurement_covariance
        for k in range(40):
            theirs.update(None if np.isnan(y[k, 0, run]) else y[k, :, run])
            assert ours[k, :, run] == pytest.approx(theirs.x.ravel(), abs=1e-9)
            theirs.predict()


def test_square_roots_are_the_same_filter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where they are not needed, with noise that is correlated and components that are missing."""
    rng = np.random.default_rng(8)
    model, Q, R = random_model(rng, 3, 2), random_covariances(rng, 3), random_covariances(rng, 2)
    y = rng.normal(size=(15, len(model.C), 6))
    y[rng.random(y.shape) < 0.4] = np.nan
    told = {
        "process_covariance": Q, "measurement_covariance": R, "initial_covariance": np.eye(3),
    }  # fmt: skip
    plain = run_kalman(model, y, **told)
    monkeypatch.setattr(kalman, "_FAR", 0.0)
    assert run_kalman(model, y, **told) == pytest.approx(plain, rel=1e-9, abs=1e-12)
