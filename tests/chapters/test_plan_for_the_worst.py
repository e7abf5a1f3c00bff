"""What the lesson on the H-infinity filter draws, against closed forms and other filters."""

from __future__ import annotations

import numpy as np
import pytest
from inswsn_book.lessons import worst

from inswsn_lib.filters import run_hinfinity
from inswsn_lib.lmi import design_filter
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import example_run

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
    run = example_run()
    both = ErrorModel.p1(run.period).with_covariances(
        np.diag(np.repeat(run.process**2, 2)), np.diag(np.repeat(run.measurement**2, 2))
    )
    whole, one = (design_filter(m, margin=0.1) for m in (both, worst.axis_model(run, 1)))
    assert one.gamma == pytest.approx(whole.gamma, rel=1e-5)
    assert np.kron(one.gain, np.eye(2)) == pytest.approx(whole.gain, abs=1e-3)
