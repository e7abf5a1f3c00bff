"""What P3 prints of its outages, against errors whose sizes are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from inswsn_book.evidence.outage_cells import outages_by_drive, rebuild_outages, rebuild_recorded

from inswsn_lib.navigation import VehicleOutages, read_trials
from inswsn_lib.navigation.vehicle_outages import p3_settings
from inswsn_lib.scenario import with_values

#: Errors grow so fast, m/s; at place 4 three times that, in the second drive twice
SPEED = {"never": 1.0, "through": 0.25, "lssvm": 0.5, "rbf": 2.0}


def test_cells_are_those_of_the_errors() -> None:
    time = np.arange(51.0)[:, None, None] * [1, 2] * np.array([1, 1, 1, 3, 1, 1, 1, 1])[:, None]
    found = outages_by_drive({name: speed * time for name, speed in SPEED.items()})
    rms = np.sqrt(np.mean(np.arange(1, 41.0) ** 2))
    for name, expected in {
        "sim.40.never.place1.max": [40, 80],
        "sim.40.never.place4.rms": [3 * rms, 6 * rms],
        "sim.40.lssvm.max.most": [60, 120],
        "sim.40.through.rms.least": [rms / 4, rms / 2],
        "sim.50.rbf.place5.max": [100, 200],
        "sim.40.gain.seven.rms": [50, 50],
        "sim.40.difference.place4.max": [-60, -120],
        "sim.50.gain.place5.over-rbf": [75, 75],
        "fair.cells.40.gain.place8.max": [-100, -100],
        "fair.cells.40.difference.place4.max": [30, 60],
        "fair.cells.50.gain.place5.over-kf": [-100, -100],
    }.items():
        np.testing.assert_allclose(found[name].values, expected, err_msg=name)
    assert not [name for name in found if "until" in name]


def test_some_methods_alone_have_the_errors_that_they_have_among_all() -> None:
    published = with_values(p3_settings(), imu_period=0.1)
    there = VehicleOutages(published, routes=1, draws=2)
    some = there.errors_of(("never", "through", "lssvm", "rbf"))
    assert [*some] == ["never", "through", "lssvm", "rbf"]
    for name, error in some.items():
        np.testing.assert_array_equal(error, there.errors[name])
    found = rebuild_outages(some)["sim.40.lssvm.place1.max"]
    assert found.value == pytest.approx(some["lssvm"][1:41, 0].max(axis=0).mean())


def test_recorded_cells_are_those_of_the_kept_trials(root: Path) -> None:
    trials, _ = read_trials(root / "data" / "recorded" / "p3-drive.json")
    found = rebuild_recorded(trials)
    largest = trials.errors["lssvm"][1:41].max(axis=0)
    assert found["recorded.cells.40.lssvm.max"].value == pytest.approx(np.median(largest))
    least = found["recorded.cells.40.lssvm.max.least"]
    assert least.value == pytest.approx(np.median(largest.min(axis=0)))
    gains = 100 * (1 - largest / trials.errors["never"][1:41].max(axis=0))
    mean = found["recorded.cells.40.gain.all.max"].value
    assert mean == pytest.approx(np.median(gains.mean(axis=0)))
