"""Covariance intersection: its bound, its limits, and local filters fused by it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import design_kalman, intersect, run_fused_locals, run_kalman
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2, process_noise=(0.1, 0.3), measurement_noise=(0.4, 0.2))
P0 = np.diag([1.0, 1.0, 0.25, 0.25])


def random_covariances(rng: np.random.Generator, size: int, *shape: int) -> np.ndarray:
    root = rng.normal(size=(*shape, size, size))
    return root @ np.swapaxes(root, -1, -2) + 0.05 * np.eye(size)


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
    claimed = claimed + excess
    omega: Any = rng.dirichlet(np.ones(clusters)) if weights == "own" else weights
    F, P = fusing_matrices(claimed, omega)
    assert F @ np.tile(np.eye(n), (clusters, 1)) == pytest.approx(np.eye(n), abs=1e-7)
    least = np.linalg.eigvalsh(P - F @ joint @ F.T).min()
    assert least > -1e-7 * np.trace(P)


def test_the_bound_test_would_notice_the_sum_of_informations() -> None:
    """Two estimates with the same error: adding informations claims half of its variance."""
    F, claimed = fusing_matrices(np.ones((2, 1, 1)), "fast")
    joint = np.ones((2, 2))
    assert claimed == pytest.approx(F @ joint @ F.T)
    assert claimed / 2 < F @ joint @ F.T


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.sampled_from(["fast", "trace", None]))
def test_equal_estimates_return_themselves(seed: int, clusters: int, weights: Any) -> None:
    rng = np.random.default_rng(seed)
    x, P = rng.normal(size=(3, 5)), random_covariances(rng, 3)
    fused, covariance = intersect(np.stack([x] * clusters), np.stack([P] * clusters), weights)
    assert fused == pytest.approx(x, abs=1e-8)
    assert covariance == pytest.approx(P, rel=1e-8, abs=1e-8)


def test_all_weight_for_the_first_returns_the_first() -> None:
    rng = np.random.default_rng(1)
    x, P = rng.normal(size=(2, 3, 4)), random_covariances(rng, 3, 2)
    fused, covariance = intersect(x, P, (1, 0))
    assert fused == pytest.approx(x[0])
    assert covariance == pytest.approx(P[0])
    chosen = np.array([[1, 0, 1, 0], [0, 1, 0, 1]])
    fused, covariance = intersect(x, P, chosen)
    for run in range(4):
        assert fused[:, run] == pytest.approx(x[run % 2, :, run])
        assert covariance[run] == pytest.approx(P[run % 2])


def test_two_numbers_by_hand() -> None:
    """Variances 1 and 3: fast weights 3/4 and 1/4, information 3/4 + 1/12 = 5/6."""
    x, claimed = intersect(np.array([[[0.0]], [[1.0]]]), np.array([[[1.0]], [[3.0]]]))
    assert claimed == pytest.approx(6 / 5)
    assert x == pytest.approx(6 / 5 / 12)


def test_the_least_trace_by_hand() -> None:
    """Each is good where the other is not: diag(1, a) and diag(a, 1) have equal weights.

    With diag(1, 4) and diag(4, 4) the second adds nothing, and has no weight.
    """
    x = np.zeros((2, 2, 1))
    pair = np.array([np.diag([1.0, 4.0]), np.diag([4.0, 1.0])])
    _, claimed = intersect(x, pair, "trace")
    assert claimed == pytest.approx(1.6 * np.eye(2), rel=1e-6)
    worse = np.array([np.diag([1.0, 4.0]), np.diag([4.0, 4.0])])
    _, claimed = intersect(x, worse, "trace")
    assert claimed == pytest.approx(worse[0], rel=1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(2, 4), st.integers(1, 4))
def test_the_least_trace_is_least(seed: int, clusters: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    P = random_covariances(rng, n, clusters) * rng.uniform(0.1, 10, (clusters, 1, 1))
    x = np.zeros((clusters, n, 1))
    found = np.trace(intersect(x, P, "trace")[1])
    for weights in ("fast", *rng.dirichlet(np.ones(clusters), 20), *np.eye(clusters)):
        assert found <= np.trace(intersect(x, P, weights)[1]) * (1 + 1e-6)


def test_runs_with_covariances_of_their_own() -> None:
    rng = np.random.default_rng(2)
    x, P = rng.normal(size=(3, 2, 6)), random_covariances(rng, 2, 3, 6)
    fused, covariance = intersect(x, P)
    assert covariance.shape == (6, 2, 2)
    for run in range(6):
        one, its = intersect(x[..., [run]], P[:, run])
        assert fused[:, [run]] == pytest.approx(one)
        assert covariance[run] == pytest.approx(its)
    # with one run the two shapes of covariances are still told apart
    assert intersect(x[..., :1], P[:, :1])[1].shape == (1, 2, 2)


@pytest.mark.parametrize("rule", ["intersection", "best"])
@pytest.mark.parametrize("predicted", [True, False])
def test_one_cluster_is_a_kalman_filter(rule: Any, predicted: bool) -> None:
    rng = np.random.default_rng(3)
    y = rng.normal(size=(1, 25, 4, 5))
    y[rng.random(y.shape) < 0.3] = np.nan
    y[:, 9:13] = np.nan
    options: dict[str, Any] = {"initial_covariance": P0, "initial_state": rng.normal(size=(4, 5)),
                               "predicted": predicted}  # fmt: skip
    R = MODEL.measurement_covariance
    found = run_fused_locals(MODEL, y, measurement_covariance=R[None], rule=rule, **options)
    assert found == pytest.approx(run_kalman(MODEL, y[0], **options), abs=1e-9)


@pytest.mark.parametrize("predicted", [True, False])
def test_the_best_is_the_kalman_filter_of_a_cluster_that_is_always_better(predicted: bool) -> None:
    rng = np.random.default_rng(4)
    y = rng.normal(size=(3, 25, 4, 5))
    y[[0, 2]] = np.where(rng.random((2, 25, 1, 5)) < 0.4, np.nan, y[[0, 2]])
    R = MODEL.measurement_covariance * np.array([4.0, 1.0, 9.0])[:, None, None]
    found = run_fused_locals(MODEL, y, measurement_covariance=R, initial_covariance=P0,
                             rule="best", predicted=predicted)  # fmt: skip
    expected = run_kalman(MODEL, y[1], initial_covariance=P0, predicted=predicted)
    assert found == pytest.approx(expected, abs=1e-9)


def test_equal_data_and_noise_are_those_of_one_cluster() -> None:
    """Covariance intersection counts nothing twice."""
    rng = np.random.default_rng(5)
    y = np.repeat(rng.normal(size=(1, 25, 4, 5)), 3, axis=0)
    y[:, 9:13, :, 2] = np.nan
    R = np.stack([MODEL.measurement_covariance] * 3)
    found = run_fused_locals(MODEL, y, measurement_covariance=R, initial_covariance=P0)
    assert found == pytest.approx(run_kalman(MODEL, y[0], initial_covariance=P0), abs=1e-9)


def by_hand(y: np.ndarray, R: np.ndarray, Q: np.ndarray, rule: str) -> tuple[list, list]:
    """Return predicted and filtered results of one run: y (N, steps, m), in covariance form."""
    A, clusters = MODEL.A, len(y)
    local = [(np.zeros(4), P0) for _ in range(clusters)]
    fused = (np.zeros(4), P0)
    predicted, filtered = [], []
    for k in range(y.shape[1]):
        if k:
            local = [(A @ x, A @ P @ A.T + Q[k - 1]) for x, P in local]
            fused = (A @ fused[0], A @ fused[1] @ A.T + Q[k - 1])
        predicted.append(fused[0])
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
        filtered.append(fused[0])
    return predicted, filtered


@pytest.mark.parametrize("rule", ["intersection", "best"])
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.filterwarnings("error")
def test_it_is_the_recursion_written_out(rule: Any, shared: bool) -> None:
    rng = np.random.default_rng(6)
    steps, runs = 40, 4
    y = rng.normal(size=(3, steps, 4, runs))
    gaps = rng.random((3, steps // 4, 1, 1 if shared else runs)) < 0.5
    y[np.broadcast_to(gaps.repeat(4, axis=1), y.shape)] = np.nan
    y[rng.random((3, steps, 4, 1 if shared else runs)).repeat(runs if shared else 1, 3)
      < 0.1] = np.nan  # fmt: skip
    y[:, 20:24, :, :1] = np.nan
    R = random_covariances(rng, 4, 3, steps)
    Q = random_covariances(rng, 4, steps)
    options: dict[str, Any] = {"measurement_covariance": R, "initial_covariance": P0,
                               "process_covariance": Q, "rule": rule}  # fmt: skip
    filtered = run_fused_locals(MODEL, y, **options)
    predicted = run_fused_locals(MODEL, y, predicted=True, **options)
    for run in range(runs):
        expected = by_hand(y[..., run], R, Q, rule)
        assert predicted[:, :, run] == pytest.approx(np.array(expected[0]), rel=1e-7, abs=1e-7)
        assert filtered[:, :, run] == pytest.approx(np.array(expected[1]), rel=1e-7, abs=1e-7)


def test_runs_do_not_depend_on_one_another() -> None:
    rng = np.random.default_rng(7)
    y = rng.normal(size=(2, 15, 4, 4))
    y[rng.random(y.shape) < 0.3] = np.nan
    R = np.stack([np.eye(4), 2 * np.eye(4)])
    together = run_fused_locals(MODEL, y, measurement_covariance=R, initial_covariance=P0)
    for run in range(4):
        alone = run_fused_locals(MODEL, y[..., [run]], measurement_covariance=R,
                                 initial_covariance=P0)  # fmt: skip
        assert together[:, :, [run]] == pytest.approx(alone, abs=1e-11)


def test_in_the_mean_the_errors_are_no_larger_than_a_cluster_alone_says() -> None:
    """Equal clusters: each claims P_k, the intersection as well, and the mean is better than that.

    Its true variance at the last step, over 3000 runs, lies between the Kalman filter of all data
    and the filter of one cluster.
    """
    rng = np.random.default_rng(8)
    runs, steps = 3000, 30
    x = np.sqrt(P0) @ rng.standard_normal((4, runs))
    y = np.empty((3, steps, 4, runs))
    for k in range(steps):
        y[:, k] = x + MODEL.D @ rng.standard_normal((3, 4, runs))
        last, x = x, MODEL.A @ x + MODEL.B @ rng.standard_normal((4, runs))
    R = MODEL.measurement_covariance
    found = run_fused_locals(MODEL, y, measurement_covariance=np.stack([R] * 3),
                             initial_covariance=P0)[-1]  # fmt: skip
    everything = np.ones((steps, 4), bool)
    one = design_kalman(MODEL, everything, initial_covariance=P0).filtered[-1]
    all_three = design_kalman(MODEL, everything, initial_covariance=P0,
                              measurement_covariance=R / 3).filtered[-1]  # fmt: skip
    spread = np.trace((found - last) @ (found - last).T / runs)
    assert np.trace(all_three) < spread < 0.9 * np.trace(one)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"estimates": np.zeros((2, 3))}, "estimates is 'of shape"),
        ({"estimates": np.full((2, 3, 4), np.nan)}, "estimates is 'of shape"),
        ({"estimates": np.zeros((0, 3, 4))}, "estimates is 'of shape"),
        ({"covariances": np.eye(3)}, "covariances is 'of shape"),
        ({"covariances": np.zeros((2, 3, 3))}, "covariances is 'singular"),
        ({"covariances": np.full((2, 3, 3), np.inf)}, "covariances is 'not finite"),
        ({"covariances": np.triu(np.ones((2, 3, 3)))}, "covariances is 'not finite or not symm"),
        ({"weights": "slow"}, "weights is 'slow'"),
        ({"weights": (0.5, 0.6)}, "weights is 'negative or of another sum"),
        ({"weights": (1.5, -0.5)}, "weights is 'negative or of another sum"),
        ({"weights": (np.nan, 1.0)}, "weights is 'of shape"),
        ({"weights": (0.5, 0.3, 0.2)}, "weights is 'of shape"),
        ({"weights": "trace", "covariances": np.stack([[np.eye(3)] * 4] * 2)}, "weights is 'trace"),
    ],
)
def test_what_cannot_be_fused_is_refused(changed: dict[str, Any], said: str) -> None:
    fine: dict[str, Any] = {
        "estimates": np.zeros((2, 3, 4)),
        "covariances": np.stack([np.eye(3)] * 2),
    }
    intersect(**fine)
    with pytest.raises(ParameterError, match=said):
        intersect(**(fine | changed))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"measurements": np.zeros((5, 4, 1))}, "measurements is 'of shape"),
        ({"measurements": np.full((2, 5, 4, 1), np.inf)}, "measurements is 'infinite"),
        ({"measurement_covariance": np.eye(4)}, "measurement_covariance is 'of shape"),
        ({"measurement_covariance": np.zeros((2, 4, 4))}, "measurement_covariance is 'singular"),
        ({"initial_covariance": np.zeros((4, 4))}, "initial_covariance is 'singular"),
        ({"process_covariance": np.eye(3)}, "process_covariance"),
        ({"rule": "worst"}, "rule is 'worst'"),
        ({"initial_state": np.zeros(3)}, "initial_state"),
    ],
)
def test_what_does_not_fit_is_refused(changed: dict[str, Any], said: str) -> None:
    fine: dict[str, Any] = {
        "measurements": np.zeros((2, 5, 4, 1)),
        "measurement_covariance": np.stack([np.eye(4)] * 2),
        "initial_covariance": np.eye(4),
    }
    run_fused_locals(MODEL, **fine)
    with pytest.raises(ParameterError, match=said):
        run_fused_locals(MODEL, **(fine | changed))


NO_NUMBERS = ["1", "word", ["1", "2"], {"a": 1.0}, [[1.0], [1.0, 2.0]], 1j * np.eye(4), [None]]


@pytest.mark.parametrize("value", NO_NUMBERS)
@pytest.mark.parametrize("name", ["estimates", "covariances", "weights"])
@pytest.mark.filterwarnings("error")
def test_what_is_no_array_of_numbers_is_not_fused(name: str, value: Any) -> None:
    fine: dict[str, Any] = {
        "estimates": np.zeros((2, 3, 4)),
        "covariances": np.stack([np.eye(3)] * 2),
    }
    with pytest.raises(ParameterError) as caught:
        intersect(**(fine | {name: value}))
    assert caught.value.name == name


@pytest.mark.parametrize("value", NO_NUMBERS)
@pytest.mark.parametrize(
    "name",
    [
        "measurements", "measurement_covariance", "initial_covariance", "process_covariance",
        "initial_state", "rule",
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("error")
def test_what_is_no_array_of_numbers_is_refused(name: str, value: Any) -> None:
    fine: dict[str, Any] = {
        "measurements": np.zeros((2, 5, 4, 1)),
        "measurement_covariance": np.stack([np.eye(4)] * 2),
        "initial_covariance": np.eye(4),
    }
    with pytest.raises(ParameterError) as caught:
        run_fused_locals(MODEL, **(fine | {name: value}))
    assert caught.value.name == name
