"""Covariance intersection: its bound, its limits, and local filters fused by it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from random_filters import gappy, random_covariances

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import intersect, run_fused_locals, run_kalman
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2, process_noise=(0.1, 0.3), measurement_noise=(0.4, 0.2))
P0 = np.diag([1.0, 1.0, 0.25, 0.25])


def fusing_matrices(covariances: np.ndarray, weights: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return F (n, N n), with which the fused estimate is F times the estimates, and P.

    One run for each number of each estimate, which is 1 there and 0 elsewhere.
    """
    clusters, n, _ = covariances.shape
    return intersect(np.eye(clusters * n).reshape(clusters, n, -1), covariances, weights)


@given(
    st.integers(0, 2**32 - 1), st.integers(1, 4), st.integers(1, 4),
    st.sampled_from(["fast", "trace", "own"]),
)  # fmt: skip
def test_it_bounds_the_true_covariance_whatever_the_correlations(
    seed: int, clusters: int, n: int, weights: str
) -> None:
    rng = np.random.default_rng(seed)
    # few columns: errors that are almost or wholly dependent on one another
    root = rng.normal(size=(clusters * n, rng.integers(1, clusters * n + 1)))
    joint = root @ root.T
    excess = random_covariances(rng, n, clusters) * rng.choice([1e-3, 1.0], (clusters, 1, 1))
    claimed = np.stack([joint[c * n : (c + 1) * n, c * n : (c + 1) * n] for c in range(clusters)])
    omega: Any = rng.dirichlet(np.ones(clusters)) if weights == "own" else weights
    F, P = fusing_matrices(claimed + excess, omega)
    assert F @ np.tile(np.eye(n), (clusters, 1)) == pytest.approx(np.eye(n), abs=1e-7)
    assert np.linalg.eigvalsh(P - F @ joint @ F.T).min() > -1e-7 * np.trace(P)


def test_the_bound_test_would_notice_the_sum_of_informations() -> None:
    """Two estimates with the same error: adding informations claims half of its variance."""
    F, claimed = fusing_matrices(np.ones((2, 1, 1)), "fast")
    assert claimed == pytest.approx(F @ np.ones((2, 2)) @ F.T)
    assert claimed.item() == pytest.approx(1)


def test_two_numbers_by_hand() -> None:
    """Variances 1 and 3: fast weights 3/4 and 1/4, information 3/4 + 1/12 = 5/6."""
    x, claimed = intersect(np.array([[[0.0]], [[1.0]]]), np.array([[[1.0]], [[3.0]]]))
    assert claimed == pytest.approx(6 / 5)
    assert x == pytest.approx(6 / 5 / 12)
    x, claimed = intersect([[[0.0]], [[1.0]]], [[[1.0]], [[3.0]]], (0.25, 0.75))
    assert claimed == pytest.approx(2)
    assert x == pytest.approx(1 / 2)


def test_the_least_trace_by_hand() -> None:
    """Each is good where the other is not: diag(1, a) and diag(a, 1) have equal weights.

    With diag(1, 4) and diag(4, 4) the second adds nothing, and has no weight.
    """
    x = np.zeros((2, 2, 1))
    pair = np.array([np.diag([1.0, 4.0]), np.diag([4.0, 1.0])])
    assert intersect(x, pair, "trace")[1] == pytest.approx(1.6 * np.eye(2), rel=1e-6)
    worse = np.array([np.diag([1.0, 4.0]), np.diag([4.0, 4.0])])
    assert intersect(x, worse, "trace")[1] == pytest.approx(worse[0], rel=1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(2, 4), st.integers(1, 4))
def test_the_least_trace_is_least(seed: int, clusters: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    P = random_covariances(rng, n, clusters) * rng.uniform(0.1, 10, (clusters, 1, 1))
    x = np.zeros((clusters, n, 1))
    found = np.trace(intersect(x, P, "trace")[1])
    for weights in ("fast", *rng.dirichlet(np.ones(clusters), 20), *np.eye(clusters)):
        assert found <= np.trace(intersect(x, P, weights)[1]) * (1 + 1e-6)


def test_runs_with_covariances_and_weights_of_their_own() -> None:
    rng = np.random.default_rng(2)
    x, P = rng.normal(size=(3, 2, 6)), random_covariances(rng, 2, 3, 6)
    chosen = rng.dirichlet(np.ones(3), 6).T
    for weights in ("fast", chosen, chosen[:, 0]):
        fused, covariance = intersect(x, P, weights)
        for run in range(6):
            own = weights[:, run] if np.ndim(weights) == 2 else weights
            one, its = intersect(x[..., [run]], P[:, run], own)
            assert fused[:, [run]] == pytest.approx(one)
            assert covariance[run] == pytest.approx(its)
    fused, covariance = intersect(x, P[:, 0], chosen)
    assert covariance[3] == pytest.approx(intersect(x, P[:, 0], chosen[:, 3])[1])
    # with one run the two shapes of covariances are still told apart
    assert intersect(x[..., :1], P[:, :1])[1].shape == (1, 2, 2)
    assert intersect(x[..., :1], P[:, 0])[1].shape == (2, 2)


def by_hand(y: np.ndarray, R: np.ndarray, Q: np.ndarray, x0: np.ndarray, rule: str) -> list:
    """Return predicted and filtered results of one run: y (N, steps, m), in covariance form."""
    A, clusters = MODEL.A, len(y)
    local, fused = [(x0, P0) for _ in range(clusters)], (x0, P0)
    results = []
    for k in range(y.shape[1]):
        if k:
            local = [(A @ x, A @ P @ A.T + Q[k - 1]) for x, P in local]
            fused = (A @ fused[0], A @ fused[1] @ A.T + Q[k - 1])
        before = fused[0]
        heard = [c for c in range(clusters) if not np.isnan(y[c, k]).all()]
        for c in heard:
            x, P = local[c]
            seen = ~np.isnan(y[c, k])
            C, noise = MODEL.C[seen], R[c, k][np.ix_(seen, seen)]
            K = P @ C.T @ np.linalg.inv(C @ P @ C.T + noise)
            local[c] = x + K @ (y[c, k][seen] - C @ x), P - K @ C @ P
        if heard and rule == "best":
            fused = min((local[c] for c in heard), key=lambda pair: np.trace(pair[1]))
        elif heard:
            traces = np.array([np.trace(local[c][1]) for c in heard])
            omega = (1 / traces) / np.sum(1 / traces)
            terms = [w * np.linalg.inv(local[c][1]) for w, c in zip(omega, heard, strict=True)]
            P = np.linalg.inv(sum(terms))
            fused = P @ sum(Y @ local[c][0] for Y, c in zip(terms, heard, strict=True)), P
        local = [local[c] if c in heard else fused for c in range(clusters)]
        results.append((before, fused[0]))
    return results


@pytest.mark.parametrize("rule", ["intersection", "best"])
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.filterwarnings("error")
def test_it_is_the_recursion_written_out(rule: Any, shared: bool) -> None:
    rng = np.random.default_rng(6)
    steps, runs = 40, 4
    y, start = gappy(rng, (3, steps, 4, runs), shared=shared), rng.normal(size=(4, runs))
    R, Q = random_covariances(rng, 4, 3, steps), random_covariances(rng, 4, steps)
    options: dict[str, Any] = {"measurement_covariance": R, "initial_covariance": P0,
                               "process_covariance": Q, "initial_state": start,
                               "rule": rule}  # fmt: skip
    filtered = run_fused_locals(MODEL, y, **options)
    predicted = run_fused_locals(MODEL, y, predicted=True, **options)
    for run in range(runs):
        before, after = zip(*by_hand(y[..., run], R, Q, start[:, run], rule), strict=True)
        assert predicted[:, :, run] == pytest.approx(np.array(before), rel=1e-7, abs=1e-7)
        assert filtered[:, :, run] == pytest.approx(np.array(after), rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("rule", ["intersection", "best"])
def test_equal_data_and_noise_are_those_of_one_cluster(rule: Any) -> None:
    """Covariance intersection counts nothing twice."""
    y = np.repeat(gappy(np.random.default_rng(5), (1, 25, 4, 5)), 3, axis=0)
    R = np.stack([MODEL.measurement_covariance] * 3)
    found = run_fused_locals(MODEL, y, measurement_covariance=R, initial_covariance=P0, rule=rule)
    assert found == pytest.approx(run_kalman(MODEL, y[0], initial_covariance=P0), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("estimates", {"estimates": np.zeros(2)}),
        ("covariances", {"covariances": np.eye(3)}),
        ("covariances", {"covariances": np.zeros((2, 3, 3))}),
        ("weights", {"weights": "slow"}),
        ("weights", {"weights": (0.5, 0.6)}),
        ("weights", {"weights": (1.5, -0.5)}),
        ("weights", {"weights": (0.5, 0.3, 0.2)}),
        ("weights", {"weights": "trace", "covariances": np.stack([[np.eye(3)] * 4] * 2)}),
    ],
)
def test_what_cannot_be_fused_is_refused(name: str, changed: dict[str, Any]) -> None:
    fine = {"estimates": np.zeros((2, 3, 4)), "covariances": np.stack([np.eye(3)] * 2)}
    with pytest.raises(ParameterError) as caught:
        intersect(**(fine | changed))
    assert caught.value.name == name
    if changed.get("weights") == (0.5, 0.6):
        assert str(caught.value) == "weights must be non-negative and of sum 1, not (0.5, 0.6)."


def test_an_unknown_rule_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"rule .* not 'worst'"):
        run_fused_locals(MODEL, np.zeros((2, 5, 4, 1)), measurement_covariance=[np.eye(4)] * 2,
                         initial_covariance=P0, rule="worst")  # type: ignore[arg-type]  # fmt: skip
