"""What a masked array of numpy hides is missing, or refused; one run needs no axis of runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import inswsn_lib as iw
from inswsn_lib.evaluation import cluster_mean
from inswsn_lib.navigation.vehicle_outages import as_starts
from inswsn_lib.simulation import coloured
from inswsn_lib.streams import Fixes, Imu, Ranges

MODEL = iw.ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))
EYE, RNG = np.eye(4), np.random.default_rng(7)
GAIN = (MODEL, 0.4 * EYE)
HEARD = [(True, False), (False, True), (True, True)]
HALVES = {each: EYE * np.reshape(each, (2, 1, 1)) / sum(each) for each in HEARD}
SWITCHED = {
    each: (
        iw.ErrorModel(A=MODEL.A, B=EYE, C=np.vstack([EYE] * sum(each)), D=np.eye(4 * sum(each)),
                      period=0.2),
        np.hstack([0.4 * EYE] * sum(each)),
    )
    for each in HEARD
}  # fmt: skip
VALUES = RNG.integers(-9, 9, size=(2, 12, 4, 3))
HIDDEN = RNG.random((2, 12, 1, 3)) < 0.3
HIDDEN = HIDDEN | (RNG.random(VALUES.shape) < 0.1)
NOISE: dict[str, Any] = {"initial_covariance": EYE}
CLUSTERS: dict[str, Any] = NOISE | {"measurement_covariance": [EYE, 2 * EYE]}


def lost(y: Any) -> np.ndarray:
    return np.asarray(np.indices((2, 12, *np.shape(y)[3:]))[1] % 5 == 3)


#: Of two clusters
FILTERS: dict[str, Callable[[Any], Any]] = {
    "kalman": lambda y: iw.run_kalman(MODEL, y[0], **NOISE),
    "stream": lambda y: np.concatenate(
        list(iw.stream_kalman(MODEL, [y[0][:5], y[0][5:]], **NOISE))
    ),
    "hinfinity": lambda y: iw.run_hinfinity(GAIN, y[0]),
    "robust": lambda y: iw.run_robust(MODEL, y[0], policy=iw.huber(1.5), **NOISE),
    "schmidt": lambda y: iw.run_schmidt(MODEL, y[0], considered=1, **NOISE),
    "federated": lambda y: iw.run_federated(MODEL, y, lost=lost(y), **CLUSTERS),
    "fused locals": lambda y: iw.run_fused_locals(MODEL, y, **CLUSTERS),
    "distributed": lambda y: iw.run_distributed([GAIN] * 2, y, weights=HALVES, lost=lost(y)),
    "switched": lambda y: iw.run_switched(SWITCHED, y),
    "hybrid": lambda y: iw.HybridNavigator(
        lambda z: iw.run_kalman(MODEL, z, **NOISE), iw.HoldRegressor(), feedback=True, least=1
    ).run(y[0]).estimates,
    "noise": lambda y: np.stack(iw.fit_noise(EYE, np.ones((12, 4, 3)), y[0])),
    "squares": lambda y: iw.normalised_squares(y[0], EYE),
    "mean": lambda y: iw.mean_absolute_error(y[0]),
    "spread": lambda y: iw.spread(np.ma.reshape(y[0][:10], (2, -1))),
    "patterns": lambda y: np.array(sorted(iw.patterns_of(y)), float),
    "coloured": lambda y: coloured(y[0], 0.2, 1.0),
    "slope": lambda y: iw.slope_velocity(Fixes(np.arange(12.0), y[0][:, :2, 0] * 1.0)).velocity,
}  # fmt: skip


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("kind", [int, float])
def test_what_is_masked_is_missing(name: str, kind: type) -> None:
    missing = np.where(HIDDEN, np.nan, VALUES)
    given = VALUES.astype(kind) if kind is int else np.where(HIDDEN, 1e9, VALUES)
    masked = np.ma.masked_array(given, HIDDEN)
    run = FILTERS[name]
    expected = run(missing)
    np.testing.assert_array_equal(run(masked), expected)
    np.testing.assert_array_equal(run([*masked]), expected)  # a list of the clusters
    shown = run(np.ma.masked_array(VALUES, False))
    np.testing.assert_array_equal(shown, run(VALUES))
    assert not np.array_equal(shown, expected, equal_nan=True)


RUNS = [name[4:].replace("_", " ") for name in dir(iw.filters) if name.startswith("run_")]


@pytest.mark.parametrize("name", [*RUNS, "stream", "hybrid", "squares"])
def test_one_run_needs_no_axis_of_runs(name: str) -> None:
    run, missing = FILTERS[name], np.where(HIDDEN, np.nan, VALUES)[..., 0]
    expected = run(missing[..., None])[..., 0]
    np.testing.assert_array_equal(run(missing), expected)
    np.testing.assert_array_equal(run(np.ma.masked_array(VALUES, HIDDEN)[..., 0]), expected)
    np.testing.assert_array_equal(run([*missing]), expected)
    with pytest.raises(iw.ParameterError, match=r"\(.*steps, \w+\) or \(.*steps, \w+, runs\)"):
        run(missing[..., 0])


def test_what_is_masked_of_a_drive_is_missing() -> None:
    time, v, zero = np.arange(-1.0, 4.0), np.array([[0.0, 10.0, 0.0]] * 5), np.zeros((5, 3))
    imu, fixes = Imu(time, zero, zero), Fixes(time, zero, v)
    recording = iw.Recording("north", imu=imu, fixes=fixes, origin=np.zeros(3))
    drive = iw.emulate_sensors(recording, runs=2, seed=0)
    hidden = np.array([[False, False], [True, False], [False, False]])
    held = replace(drive, compass=np.ma.masked_array(drive.compass, hidden))
    assert np.array_equal(np.isnan(held.measurements[:, :, 0]), hidden)


THIRD = np.ma.masked_array([0, 1, 2], [False, False, True])
FEW = np.ma.masked_array(EYE, EYE == 1)
REFUSED: dict[str, tuple[str, Callable[[], Any]]] = {
    "available": (
        "available must be booleans of shape (steps, 4), not partly masked.",
        lambda: iw.design_kalman(MODEL, FEW == 1, **NOISE),
    ),
    "lost": (
        "lost must be booleans of shape (2, 12, 3), not partly masked.",
        lambda: iw.run_federated(
            MODEL, 1.0 * VALUES, lost=np.ma.masked_array(HIDDEN[:, :, 0], True), **CLUSTERS
        ),
    ),
    "initial_covariance": (
        "initial_covariance must be finite numbers of shape (4, 4), not NaN or infinite.",
        lambda: iw.run_kalman(MODEL, VALUES[0], initial_covariance=FEW),
    ),
    "A": (
        "A must be finite numbers of shape (n, n), not NaN or infinite.",
        lambda: iw.ErrorModel(A=FEW, B=EYE, C=EYE, D=EYE, period=1.0),
    ),
    "anchor": (
        "anchor must be complete, not partly masked.",
        lambda: Ranges(np.arange(3.0), THIRD, np.ones(3), np.zeros((3, 2)), tuple("abc")),
    ),
    "starts": ("starts must be whole numbers of shape (outages,)", lambda: as_starts(THIRD)),
    "clusters": (
        "clusters must be given for each value, not partly masked.",
        lambda: cluster_mean([1, 2, 3], THIRD),
    ),
    "inputs": ("Input X contains NaN", lambda: iw.HoldRegressor().fit(FEW, EYE)),
    "targets": ("Input y contains NaN", lambda: iw.HoldRegressor().fit(EYE, FEW)),
    "asked": ("Input X contains NaN", lambda: iw.HoldRegressor().fit(EYE, EYE).predict(FEW)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_must_be_complete_may_not_be_masked(name: str) -> None:
    said, call = REFUSED[name]
    with pytest.raises(ValueError, match=r"contains NaN|masked|finite|float64") as raised:
        call()
    assert str(raised.value).startswith(said)
