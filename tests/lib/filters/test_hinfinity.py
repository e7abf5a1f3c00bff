"""Filters of constant gain: recursions written out, the deadbeat case, gaps, patterns."""

from __future__ import annotations

import numpy as np
import pytest
from random_filters import PATTERNS, gappy, random_model

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import deadbeat_gain, run_hinfinity, run_switched
from inswsn_lib.lmi import design_filter
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2)
Y = np.random.default_rng(7).normal(size=(12, 4, 3))
Filter = tuple[ErrorModel, np.ndarray]


def recursion(A: np.ndarray, filters: list[Filter | None], y: np.ndarray, x: np.ndarray) -> list:
    """Return the predictions of one run, of the start and after each step, with gaps."""
    states = [x]
    for measured, each in zip(y, filters, strict=True):
        ahead = A @ x
        if each is not None:
            model, gain = each
            innovation = measured - model.C @ x
            ahead = ahead + gain @ np.where(np.isnan(innovation), 0.0, innovation)
        states.append(x := ahead)
    return states


def test_it_is_the_recursion_of_p1_with_gaps() -> None:
    rng = np.random.default_rng(8)
    model, gain = random_model(rng, 3, 2), 0.3 * rng.normal(size=(3, 2))
    y, start = rng.normal(size=(12, 2, 4)), rng.normal(size=(3, 4))
    y[rng.random(y.shape) < 0.3] = np.nan
    predicted = run_hinfinity((model, gain), y, initial_state=start, predicted=True)
    filtered = run_hinfinity((model, gain), y, initial_state=start)
    for run in range(4):
        states = recursion(model.A, [(model, gain)] * 12, y[:, :, run], start[:, run])
        assert predicted[:, :, run] == pytest.approx(np.array(states[:-1]), abs=1e-10)
        undone = np.linalg.solve(model.A, np.array(states[1:]).T).T
        assert filtered[:, :, run] == pytest.approx(undone, abs=1e-9)


def test_a_design_is_its_model_and_gain() -> None:
    design = design_filter(MODEL)
    found = run_hinfinity(design, Y, predicted=True)
    assert not found[0].any()
    for k in range(11):
        ahead = design.A_f @ found[k] + design.gain @ Y[k]
        assert found[k + 1] == pytest.approx(ahead, abs=1e-12)
    pair = run_hinfinity((MODEL, design.gain), Y)
    assert run_hinfinity(design, Y) == pytest.approx(pair, abs=1e-12)


def test_deadbeat_carries_the_last_measurement_on() -> None:
    doubled = ErrorModel(A=MODEL.A, B=MODEL.B, C=2 * np.eye(4), D=MODEL.D, period=0.2)
    assert deadbeat_gain(doubled) == pytest.approx(MODEL.A / 2)
    y = Y.copy()
    y[5:] = np.nan
    assert run_hinfinity((doubled, deadbeat_gain(doubled)), 2 * Y) == pytest.approx(Y)
    estimates = run_hinfinity((MODEL, deadbeat_gain(MODEL)), y)
    for k in range(5, 12):  # a gap is dead reckoning
        assert estimates[k] == pytest.approx(np.linalg.matrix_power(MODEL.A, k - 4) @ Y[4])


def switched(rng: np.random.Generator) -> dict[tuple[bool, ...], Filter]:
    found = {}
    for pattern in PATTERNS:
        model = random_model(rng, 3, 2 * sum(pattern))
        model = ErrorModel(A=0.9 * np.eye(3), B=model.B, C=model.C, D=model.D, period=1.0)
        found[pattern] = model, 0.1 * rng.normal(size=(3, 2 * sum(pattern)))
    return found


@pytest.mark.parametrize("shared", [False, True])
def test_the_switched_filter_is_its_recursion(shared: bool) -> None:
    rng = np.random.default_rng(30)
    designs, start = switched(rng), rng.normal(size=(3, 4))
    y = gappy(rng, (3, 40, 2, 4), shared=shared)
    predicted = run_switched(designs, y, initial_state=start, predicted=True)
    filtered = run_switched(designs, y, initial_state=start)
    for run in range(4):
        heard = ~np.isnan(y[..., run]).all(axis=2)
        filters = [designs.get(tuple(row)) for row in heard.T.tolist()]
        stacked = [y[row, k, :, run].ravel() for k, row in enumerate(heard.T)]
        states = np.array(recursion(0.9 * np.eye(3), filters, stacked, start[:, run]))
        assert predicted[:, :, run] == pytest.approx(states[:-1], abs=1e-10)
        assert filtered[:, :, run] == pytest.approx(states[1:] / 0.9, abs=1e-10)


def test_a_transition_that_cannot_be_inverted() -> None:
    flat = ErrorModel(A=np.diag([1.0, 0.0]), B=np.eye(2), C=np.eye(2), D=np.eye(2), period=1.0)
    y = np.ones((1, 3, 2, 1))
    assert run_hinfinity((flat, np.eye(2)), y[0], predicted=True)[1, 1] == pytest.approx(1)
    with pytest.raises(ParameterError, match=r"predicted .* not False"):
        run_hinfinity((flat, np.eye(2)), y[0])
    with pytest.raises(ParameterError, match=r"predicted .* not False"):
        run_switched({(True,): (flat, np.eye(2))}, y)


@pytest.mark.parametrize(
    ("designs", "said"),
    [
        ({(True, True): (MODEL, np.eye(4))}, "designs .* not of shape"),
        ({(True, False): (MODEL, np.eye(4))}, r"designs .* not without \(True, True\)"),
        ({(True,): (MODEL, np.eye(4))}, "designs .* not of shape"),
        ({(1, 1): (MODEL, np.eye(4))}, "designs .* not int64"),
        ({(True, True): MODEL}, "designs .* not of ErrorModel"),
        ({(True, True): (MODEL, np.eye(3))}, "gain .* not of shape"),
        (
            {(True, False): (MODEL, np.eye(4)), (False, True): (ErrorModel.p1(0.3), np.eye(4))},
            "designs .* not of different ones",
        ),
    ],
)
def test_switched_designs_that_do_not_fit_are_refused(designs: dict, said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        run_switched(designs, np.zeros((2, 3, 4, 1)))


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"C .* not of shape"):
        deadbeat_gain(ErrorModel(A=np.eye(4), B=np.eye(4), C=np.eye(2, 4), D=np.eye(2), period=1))
    with pytest.raises(ParameterError, match=r"design .* not of ErrorModel"):
        run_hinfinity(MODEL, Y)  # type: ignore[arg-type]
