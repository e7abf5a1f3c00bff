"""What lessons draw, against closed forms, other filters and plain simulation."""

from __future__ import annotations

import numpy as np
import pytest
from inswsn_book.lessons import nodes, worst

from inswsn_lib.filters import federated_covariance, run_federated, run_hinfinity, run_kalman
from inswsn_lib.lmi import design_filter, design_fusion
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import example_clusters, example_run

GOLDEN = (5**0.5 - 1) / 2


def test_the_error_of_the_game_is_that_of_the_librarys_filter() -> None:
    w, v = np.random.default_rng(1).standard_normal((2, 50))
    x = np.concatenate([[0.0], np.cumsum(w)])
    model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)  # type: ignore[arg-type]
    predicted = run_hinfinity((model, [[GOLDEN]]), (x[:-1] + v)[:, None], predicted=True)[:, 0]
    found = worst.errors_of(GOLDEN, w, v)
    assert found[:50] == pytest.approx(x[:50] - predicted, abs=1e-12)


@pytest.mark.parametrize("share", [-100, -40, 0, 100])
def test_a_disturbance_has_the_energy_one(share: int) -> None:
    for cycles in range(13):
        assert np.sum(np.square(worst.disturbance(cycles, share))) == pytest.approx(1)


def test_no_disturbance_of_the_game_is_above_the_most_nor_the_most_above_the_peak() -> None:
    assert worst.most(1.0) == pytest.approx(2)
    assert 0.97 * (1 + 1 / GOLDEN**2) < worst.most(GOLDEN) < 1 + 1 / GOLDEN**2
    for g in (GOLDEN, 1.0):
        out = [
            np.sum(np.square(worst.errors_of(g, *worst.disturbance(cycles, share))))
            for cycles in range(13)
            for share in range(-100, 101, 20)
        ]
        assert max(out) <= worst.most(g) + 1e-9
        assert g == 1.0 or max(out) > 3.5  # what the reader is asked to reach


def test_without_memory_the_second_copy_is_nothing() -> None:
    B, P = np.array([[1.0], [0.0]]), 2 * np.eye(2)
    none = np.zeros((2, 2))
    for gamma, holds in ((1.5, True), (1.3, False)):  # B'PB = 2
        if holds:
            found = worst.largest_eigenvalues(none, B, P, gamma)
            assert all(value < 0 for value in found.values())
        else:
            assert worst.largest_eigenvalues(none, B, P, gamma)["2.18"] > 0
    # 0.8 of the error stays: 1 - P + 0.64 P < 0 for P = 3, and not with 0.64 P twice
    found = worst.largest_eigenvalues(0.8 * np.eye(2), 0.01 * B, 1.5 * P, 10.0)
    assert [name for name in worst.STEPS if found[name] >= 0] == ["2.19", "2.20", "2.21"]


def test_one_axis_of_the_vehicle_stands_for_both() -> None:
    both, (A, B, C, D) = worst.models_of(example_run(), 1)
    axis = ErrorModel(A=A, B=B, C=C, D=D, period=both.period)
    whole, one = (design_filter(m, margin=0.1) for m in (both, axis))
    assert one.gamma == pytest.approx(whole.gamma, rel=1e-5)
    assert np.kron(one.gain, np.eye(2)) == pytest.approx(whole.gain, abs=1e-3)


def walk(drift: float, noise: float = 1.0) -> ErrorModel:
    return ErrorModel(A=[[1]], B=[[drift**0.5]], C=[[1]], D=[[noise**0.5]], period=1)  # type: ignore[arg-type]


@pytest.mark.parametrize("drift", [0.1, 1.0, 10.0])
def test_two_clusters_of_a_walk_err_as_the_formula_says(drift: float) -> None:
    rng, runs = np.random.default_rng(5), 20000
    x = np.cumsum(drift**0.5 * rng.standard_normal((60, 1, runs)), axis=0)
    each = [
        x - run_kalman(walk(drift), x + rng.standard_normal(x.shape), initial_covariance=[[1]])
        for _ in range(2)
    ]
    _, P, C = nodes.settled(drift)
    found = np.cov(each[0][-1, 0], each[1][-1, 0])
    assert found[0, 0] == pytest.approx(P, rel=0.05)
    assert found[0, 1] == pytest.approx(C, abs=4 * P / runs**0.5)


def test_with_the_golden_ratio_it_is_what_the_page_says() -> None:
    K, P, C = nodes.settled(1.0)
    assert pytest.approx((5**0.5 - 1) / 2) == K
    assert pytest.approx(K) == P
    assert round(C, 3) == 0.171


@pytest.mark.parametrize("n", [2, 3, 8])
@pytest.mark.parametrize("reset", [False, True])
def test_the_factor_that_is_right_is_the_number(n: int, reset: bool) -> None:
    least = nodes.settled(0.1, 1 / n)[1] ** 0.5
    assert nodes.with_factor(n, n, 0.1, reset=reset) == pytest.approx((least, least))
    for other in (0.7 * n, 1.4 * n):
        says, true = nodes.with_factor(other, n, 0.1, reset=reset)
        assert true > least
        assert (says < true) == (other < n)


def test_without_reset_it_is_what_the_library_claims() -> None:
    claimed = federated_covariance(
        walk(0.1), np.ones((400, 3), bool), reset="none",
        measurement_covariance=np.ones((3, 1, 1)), initial_covariance=[[1]],
    )  # fmt: skip
    assert nodes.with_factor(3, 3, 0.1, reset=False)[0] ** 2 == pytest.approx(claimed[-1, 0, 0])


def test_sent_back_without_the_factor_it_errs_as_a_simulation_does() -> None:
    rng, runs, n, drift = np.random.default_rng(6), 4000, 3, 0.1
    x, found, P = np.zeros(runs), np.zeros(runs), 1.0
    for _ in range(150):
        x = x + drift**0.5 * rng.standard_normal(runs)
        y = x + rng.standard_normal(runs) / n**0.5
        P = 1 / (n / (P + drift) + n)
        found = found + n * P * (y - found)
    says, true = nodes.with_factor(1, n, drift, reset=True)
    assert says == pytest.approx(P**0.5)
    assert true == pytest.approx((x - found).std(), rel=0.05)


def test_the_interval_holds_most_means_of_an_honest_filter() -> None:
    run, _ = example_clusters(clusters=1)
    model, rng, runs = nodes.model_of(run), np.random.default_rng(7), 200
    x, y = np.zeros((100, 4, runs)), np.empty((100, 4, runs))
    x[0] = rng.standard_normal((4, runs))
    for k in range(100):
        if k:
            x[k] = model.A @ x[k - 1] + model.B @ rng.standard_normal((4, runs))
        y[k] = x[k] + model.D @ rng.standard_normal((4, runs))
    noise = {"initial_covariance": np.eye(4)}
    error = x - run_kalman(model, y, **noise)
    P = federated_covariance(
        model, np.ones((100, 1), bool), measurement_covariance=model.measurement_covariance[None],
        **noise,
    )  # fmt: skip
    means = np.einsum("kir,kij,kjr->kr", error, np.linalg.inv(P), error).mean(axis=0)
    low, high = nodes.nees_interval(run, 1)
    assert 0.9 < np.mean((low < means) & (means < high)) < 0.99


def test_the_fusion_of_all_clusters_by_the_number_is_the_federated_filter() -> None:
    run, fixes = example_clusters(clusters=3)
    found, own = nodes.locals_of(run, fixes, 3)
    model = nodes.model_of(run)
    federated = run_federated(
        model, run.ins - fixes, reset="none", initial_covariance=1e6 / 3 * np.eye(4),
        measurement_covariance=[model.measurement_covariance] * 3,
    )  # fmt: skip
    assert np.allclose(found.mean(axis=2), federated, rtol=0, atol=1e-9)
    assert own.shape == (100, 4, 4)


@pytest.mark.parametrize(
    ("noise", "gamma"), [("independent", (2 / 3) ** 0.5), ("common", (4 / 3) ** 0.5)]
)
def test_the_promise_and_the_truth_are_those_of_the_inequality(noise: str, gamma: float) -> None:
    """For three clusters of a walk, up to the margin of the local designs."""
    local = [design_filter(walk(1.0), margin=1e-4)] * 3
    assert design_fusion(local, noise).gamma == pytest.approx(gamma, rel=2e-3)  # type: ignore[arg-type]
