"""The federated filter against the Kalman filter of all data, exact covariances, closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_filters import gappy, random_covariances, random_model
from scipy.linalg import block_diag

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import design_kalman, federated_covariance, run_federated, run_kalman
from inswsn_lib.models import ErrorModel


def random_shares(rng: np.random.Generator, clusters: int) -> np.ndarray:
    """Shares, of which about a third are zero."""
    shares = rng.uniform(0.1, 1, clusters + 1) * (rng.random(clusters + 1) < 0.7)
    shares[rng.integers(clusters + 1)] += 0.1
    return shares / shares.sum()


def of_all_data(model: ErrorModel, y: np.ndarray, R: np.ndarray, **options: Any) -> np.ndarray:
    """Return the Kalman filter of the measurements of all clusters, stacked."""
    clusters, steps, m, runs = y.shape
    stacked = ErrorModel(A=model.A, B=model.B, C=np.vstack([model.C] * clusters),
                         D=np.eye(clusters * m), period=1.0)  # fmt: skip
    every = np.broadcast_to(R if R.ndim == 4 else R[:, None], (clusters, steps, m, m))
    blocks = np.stack([block_diag(*every[:, k]) for k in range(steps)])
    together = np.moveaxis(y, 0, 1).reshape(steps, -1, runs)
    return run_kalman(stacked, together, measurement_covariance=blocks, **options)


@given(
    st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 3), st.integers(1, 3),
    st.booleans(), st.sampled_from(["fusion", "zero"]), st.booleans(), st.booleans(),
)  # fmt: skip
@settings(max_examples=40)
def test_with_a_reset_each_step_it_is_the_kalman_filter_of_all_data(
    seed: int, clusters: int, n: int, m: int, shared: bool, reset: Any, losing: bool, ahead: bool
) -> None:
    """A message that is lost before a reset is no measurement."""
    rng = np.random.default_rng(seed)
    model, steps, runs = random_model(rng, n, m), 9, 3
    y = 3 * gappy(rng, (clusters, steps, m, runs), shared=shared)
    R = random_covariances(rng, m, clusters, steps)
    R = R if seed % 2 else R[:, 0]
    lost = rng.random((clusters, steps, 1 if shared else runs)) < 0.4
    lost = np.broadcast_to(lost, (clusters, steps, runs))
    options = {
        "initial_covariance": random_covariances(rng, n),
        "process_covariance": random_covariances(rng, n, steps),
        "initial_state": rng.normal(size=(n, runs)),
        "predicted": ahead,
    }
    found = run_federated(
        model, y, measurement_covariance=R, reset=reset, lost=lost if losing else None,
        sharing=random_shares(rng, clusters) if reset == "fusion" else None, **options,
    )  # fmt: skip
    heard = np.where(lost[:, :, None] & losing, np.nan, y)
    expected = of_all_data(model, heard, R, **options)
    assert found == pytest.approx(expected, rel=1e-6, abs=1e-6)


def exact_errors(
    model: ErrorModel, available: np.ndarray, R: np.ndarray, P0: np.ndarray, options: dict[str, Any]
) -> np.ndarray:
    """Return the covariance of the error (steps, n, n), whatever the filter does, if it is linear.

    One run for each measured number, which is 1 there and 0 elsewhere, gives the matrix G of the
    filter. The error x_k - G_k y is then linear in the first state and all noises, of known
    covariances.
    """
    steps, clusters = available.shape
    m, n = model.C.shape
    places = [(c, k, i) for k in range(steps) for c in range(clusters) for i in range(m)
              if available[k, c]]  # fmt: skip
    y = np.where(available.T[:, :, None, None], np.zeros((m, len(places))), np.nan)
    for run, place in enumerate(places):
        y[(*place, run)] = 1.0
    lost = options.get("lost")
    if lost is not None:
        options = options | {"lost": np.repeat(lost.T[:, :, None], len(places), axis=2)}
    G = run_federated(model, y, measurement_covariance=R, initial_covariance=P0, **options)
    # columns: the first state, the process noise of each step, the noise of each number
    states = np.zeros((steps, n, n * steps + len(places)))
    states[0, :, :n] = np.eye(n)
    for k in range(1, steps):
        states[k] = model.A @ states[k - 1]
        states[k, :, n * k : n * (k + 1)] = np.eye(n)
    rows = np.zeros((len(places), states.shape[2]))
    noises = np.zeros((len(places), len(places)))
    for row, (c, k, i) in enumerate(places):
        rows[row] = model.C[i] @ states[k]
        rows[row, n * steps + row] = 1.0
        for other, (c2, k2, i2) in enumerate(places):
            noises[row, other] = R[c][i, i2] * ((c2, k2) == (c, k))
    sources = block_diag(P0, *[model.process_covariance] * (steps - 1), noises)
    errors = states - G @ rows
    return errors @ sources @ np.swapaxes(errors, 1, 2)


def surplus(claimed: np.ndarray, actual: np.ndarray) -> np.ndarray:
    """Return the least eigenvalue of claimed less actual, relative to the largest of claimed."""
    return np.linalg.eigvalsh(claimed - actual)[:, 0] / np.linalg.eigvalsh(claimed)[:, -1]


@settings(max_examples=50)
@given(
    st.integers(0, 2**32 - 1), st.integers(1, 3), st.sampled_from(["fusion", "zero", "none"]),
    st.integers(1, 4), st.booleans(), st.booleans(),
)  # fmt: skip
def test_the_claimed_covariance_bounds_the_true_one(
    seed: int, clusters: int, reset: Any, interval: int, losing: bool, predicted: bool
) -> None:
    rng = np.random.default_rng(seed)
    model, steps = random_model(rng, 2, 2), 7
    available = rng.random((steps, clusters)) < 0.8
    available[0, 0] = True
    R, P0 = random_covariances(rng, 2, clusters), random_covariances(rng, 2)
    options: dict[str, Any] = {"reset": reset, "interval": interval, "predicted": predicted}
    if reset != "zero":
        options["sharing"] = random_shares(rng, clusters)
    if losing:
        options["lost"] = rng.random((steps, clusters)) < 0.4
    claimed = federated_covariance(model, available, measurement_covariance=R,
                                   initial_covariance=P0, **options)  # fmt: skip
    actual = exact_errors(model, available, R, P0, options)
    assert (surplus(claimed, actual) > -1e-9).all()
    if interval == 1 and reset != "none":  # the filter is then the optimal one, and knows it
        assert claimed == pytest.approx(actual, rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("noises", [(1.3, 1.3), (0.3, 6.0)])
def test_without_reset_two_clusters_have_the_closed_form(noises: tuple[float, float]) -> None:
    """x+ = x + w, y_c = x + v_c, variances q and r_c, shares 1/2.

    Local filter c works with 2q: its predicted variance solves p^2 - 2qp - 2q r_c = 0, its gain is
    K_c = p_c/(p_c + r_c), and it claims P_c = p_c - 2q. True covariances of the local errors:
    J_cd = f_c f_d (J_cd + q) + K_c^2 r_c [c = d], with f_c = 1 - K_c. The Kalman filter of both has
    one sensor of variance r, 1/r = 1/r_1 + 1/r_2.
    """
    one, q, r = np.eye(1), 0.7, np.array(noises)
    model = ErrorModel(A=one, B=np.sqrt(q) * one, C=one, D=one, period=1.0)
    p = q + np.sqrt(q * q + 2 * q * r)
    K = p / (p + r)
    f = np.outer(1 - K, 1 - K)
    J = (f * q + np.diag(K**2 * r)) / (1 - f)
    P = 1 / np.sum(1 / (p - 2 * q))
    weights = P / (p - 2 * q)
    V = weights @ J @ weights
    R, available = r[:, None, None], np.ones((60, 2), bool)
    claimed = federated_covariance(
        model, available, measurement_covariance=R, initial_covariance=one, reset="none"
    )
    actual = exact_errors(model, available, R, one, {"reset": "none"})
    assert claimed[-1, 0, 0] == pytest.approx(P, rel=1e-9)
    assert actual[-1, 0, 0] == pytest.approx(V, rel=1e-9)
    best = -q / 2 + np.sqrt(q * q / 4 + q / np.sum(1 / r))
    if noises[0] == noises[1]:  # filters of the same gain: their mean is the filter of the mean
        assert best == pytest.approx(V) == pytest.approx(P)
    else:
        assert best * 1.01 < V < P / 1.01
    # the bound test would notice an optimistic filter: shares of sum 2
    optimistic = federated_covariance(
        model, available, measurement_covariance=R, initial_covariance=one / 2,
        process_covariance=q * one / 2, reset="none",
    )  # fmt: skip
    assert surplus(optimistic, actual)[-1] < -1e-3


def test_without_reset_the_last_message_is_aged_by_the_centre() -> None:
    """Local filters from run_kalman, the centre in plain loops; the master has a share too."""
    rng = np.random.default_rng(11)
    model, steps, shares = random_model(rng, 2, 2), 15, (0.5, 0.3, 0.2)
    y, R, P0 = rng.normal(size=(2, steps, 2, 1)), random_covariances(rng, 2, 2), np.eye(2)
    y[1, 4:9] = np.nan
    lost = rng.random((2, steps, 1)) < 0.5
    options: dict[str, Any] = {"measurement_covariance": R, "initial_covariance": P0,
                               "sharing": shares, "reset": "none"}  # fmt: skip
    found = run_federated(model, y, lost=lost, **options)
    available = ~np.isnan(y[:, :, 0, 0]).T
    claimed = federated_covariance(model, available, lost=lost[:, :, 0].T, **options)
    Q = model.process_covariance
    held = [(np.zeros(2), P0 / share) for share in shares]
    noise = [{"initial_covariance": P0 / share, "measurement_covariance": R[c],
              "process_covariance": Q / share} for c, share in enumerate(shares[:2])]  # fmt: skip
    local = [run_kalman(model, y[c], **noise[c])[:, :, 0] for c in range(2)]
    designs = [design_kalman(model, ~np.isnan(y[c, :, :, 0]), **noise[c]) for c in range(2)]
    for k in range(steps):
        if k:
            held = [(model.A @ x, model.A @ P @ model.A.T + Q / share)
                    for (x, P), share in zip(held, shares, strict=True)]  # fmt: skip
        for c in range(2):
            if not lost[c, k, 0]:
                held[c] = local[c][k], designs[c].filtered[k]
        P = np.linalg.inv(sum(np.linalg.inv(P) for _, P in held))
        x = P @ sum(np.linalg.solve(P, x) for x, P in held)
        assert found[k, :, 0] == pytest.approx(x, rel=1e-9, abs=1e-9)
        assert claimed[k] == pytest.approx(P, rel=1e-9)


def test_zero_reset_uses_a_step_inside_an_interval_for_itself_only() -> None:
    rng = np.random.default_rng(13)
    model, interval = random_model(rng, 2, 2), 3
    y, R, P0 = rng.normal(size=(2, 10, 2, 3)), random_covariances(rng, 2, 2), np.eye(2)
    found = run_federated(model, y, measurement_covariance=R, initial_covariance=P0, reset="zero",
                          interval=interval)  # fmt: skip
    for k in range(10):
        seen = y[:, : k + 1].copy()
        seen[:, [j for j in range(k) if (j + 1) % interval]] = np.nan
        expected = of_all_data(model, seen, R, initial_covariance=P0)[-1]
        assert found[k] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_thousand_steps_of_a_marginal_model_stay_the_kalman_filter() -> None:
    rng = np.random.default_rng(15)
    model = ErrorModel.p1(0.02, process_noise=(1e-4, 1e-3), measurement_noise=(2.0, 0.5))
    y = rng.normal(size=(3, 1000, 4, 2))
    y[:, 300:600] = np.nan
    R = np.stack([model.measurement_covariance * scale for scale in (1, 4, 0.5)])
    P0 = np.diag([100.0, 100.0, 1.0, 1.0])
    found = run_federated(model, y, measurement_covariance=R, initial_covariance=P0)
    assert found == pytest.approx(of_all_data(model, y, R, initial_covariance=P0), abs=1e-8)


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("sharing", {"sharing": (0.5, 0.5)}),
        ("sharing", {"sharing": (0.5, 0.6, 0.0)}),
        ("sharing", {"sharing": (0.7, 0.5, -0.2)}),
        ("sharing", {"sharing": (0.0, 1.0, 0.0), "reset": "zero"}),
        ("reset", {"reset": "both"}),
        ("interval", {"interval": 0}),
        ("lost", {"lost": np.zeros((2, 5), bool)}),
    ],
)
def test_what_does_not_fit_is_refused(name: str, changed: dict[str, Any]) -> None:
    fine: dict[str, Any] = {
        "measurement_covariance": np.stack([np.eye(4)] * 2),
        "initial_covariance": np.eye(4),
    }
    with pytest.raises(ParameterError) as caught:
        run_federated(ErrorModel.p1(0.2), np.zeros((2, 5, 4, 1)), **(fine | changed))
    assert caught.value.name == name


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"available": np.ones((5, 2))}, "(steps, N), not float64 of shape (5, 2)."),
        ({"available": np.ones(5, bool)}, "(steps, N), not of shape (5,)."),
        ({"lost": np.zeros(5, bool)}, "(5, 2), not of shape (5,)."),
    ],
)  # fmt: skip
def test_masks_that_do_not_fit_are_refused(changed: dict[str, Any], said: str) -> None:
    given: dict[str, Any] = {"available": np.ones((5, 2), bool)} | changed
    with pytest.raises(ParameterError) as caught:
        federated_covariance(ErrorModel.p1(0.2), measurement_covariance=np.stack([np.eye(4)] * 2),
                             initial_covariance=np.eye(4), **given)  # fmt: skip
    assert str(caught.value) == f"{next(iter(changed))} must be booleans of shape {said}"
