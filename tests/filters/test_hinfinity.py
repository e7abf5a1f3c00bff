"""The constant-gain filter: its recursion, its deadbeat case, and gaps."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import deadbeat_gain, run_hinfinity
from inswsn_lib.lmi import design_filter
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2)
Y = np.random.default_rng(7).normal(size=(12, 4, 3))


def test_it_is_the_recursion_of_p1() -> None:
    design = design_filter(MODEL)
    x = np.zeros((4, 3))
    for measured, estimate in zip(Y, run_hinfinity(design, Y), strict=True):
        assert estimate == pytest.approx(x)
        x = design.A_f @ x + design.gain @ measured


def test_deadbeat_carries_the_last_measurement_one_step() -> None:
    gain = deadbeat_gain(MODEL)
    assert gain == pytest.approx(MODEL.A)
    predicted = run_hinfinity((MODEL, gain), Y)
    assert predicted[1:] == pytest.approx(np.einsum("ij,kjr->kir", MODEL.A, Y[:-1]))
    assert run_hinfinity((MODEL, gain), Y, predicted=False) == pytest.approx(Y)


def test_a_gap_is_dead_reckoning() -> None:
    y = Y.copy()
    y[5:] = np.nan
    estimates = run_hinfinity((MODEL, deadbeat_gain(MODEL)), y, predicted=False)
    for k in range(5, 12):
        assert estimates[k] == pytest.approx(np.linalg.matrix_power(MODEL.A, k - 4) @ Y[4])


def test_runs_do_not_depend_on_one_another() -> None:
    design = design_filter(MODEL)
    together = run_hinfinity(design, Y)
    for run in range(3):
        alone = run_hinfinity(design, Y[:, :, [run]])
        assert together[:, :, [run]] == pytest.approx(alone, abs=1e-12)


def test_a_measurement_that_cannot_be_inverted() -> None:
    half = ErrorModel(A=MODEL.A, B=MODEL.B, C=np.eye(2, 4), D=np.eye(2), L=MODEL.L, E=MODEL.E,
                      period=0.2)  # fmt: skip
    with pytest.raises(ParameterError, match="square and invertible"):
        deadbeat_gain(half)
