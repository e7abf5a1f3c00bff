"""The core of p3-vehicle: methods whose errors are known."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.navigation import VehicleOutages, run_outages, with_aids, with_wheels
from inswsn_lib.navigation.vehicle_outages import METHODS, OUTAGE, RUNGS, p3_settings
from inswsn_lib.scenario import with_values


def coarse(changes: dict[str, Any] | None = None, **values: Any) -> VehicleOutages:
    """Return drives of an IMU of 10 Hz, which are quick to compute."""
    published = with_values(p3_settings(), imu_period=0.1, **(changes or {}))
    return VehicleOutages(published, **{"routes": 2, "draws": 2, **values})


@cache
def outages() -> VehicleOutages:
    return coarse()


def test_aids_that_say_nothing_are_no_aids() -> None:
    deaf = coarse({"filter_compass": 1e3}, routes=1, draws=1, lateral=1e6)
    for name in ("until", "through"):
        np.testing.assert_allclose(deaf.errors[name], deaf.errors["never"], rtol=1e-3, atol=1e-3)
    aided = outages()
    assert np.abs(aided.errors["through"] - aided.errors["never"])[OUTAGE].max() > 10


def test_wheels_tell_the_true_speed_and_a_standstill_all_three() -> None:
    drive = outages().drives[0]
    told = with_wheels(drive, seed=3).body_velocity
    assert told is not None
    speed = np.hypot(*drive.reference.velocity[:, :2].T)
    standing = speed < 1e-3
    assert 20 < standing.sum() < 400
    assert not told[standing].any()
    assert np.isnan(told[~standing, 1:]).all()
    fast = speed > 5
    ratio = told[fast, 0] / np.linalg.norm(drive.reference.velocity[fast], axis=1)[:, None]
    # 0.5 % of scale, and 0.05 m/s of noise on each
    assert np.abs(ratio.mean(axis=0) - 1).max() < 4 * 0.005
    off = (ratio / ratio.mean(axis=0) - 1) * speed[fast, None]
    assert off.std() == pytest.approx(0.05, rel=0.1)


def test_a_drive_has_the_aids_that_are_asked_for() -> None:
    drive, told = with_wheels(outages().drives[0], seed=3), outages().beliefs
    whole = with_aids(drive, told, RUNGS["wheels"])[0]
    assert np.array_equal(whole.body_velocity, drive.body_velocity, equal_nan=True)
    still = with_aids(drive, told, RUNGS["standstill"])[0].body_velocity
    assert still is not None
    assert np.isfinite(still).any()
    assert not still[np.isfinite(still)].any()
    bare, settings = with_aids(drive, told, ())
    assert bare.body_velocity is None
    assert np.isfinite(bare.compass).sum() == bare.runs
    assert settings.lateral > 1e5


def test_each_rung_is_run_outages_with_its_aids() -> None:
    """Of a drive that hears no more; and what has more to hear, or more time, is nearer."""
    found, there = outages().ladder, outages()
    heard, told = with_aids(there.drives[0], there.beliefs, ["constraint"])
    alone = run_outages(heard, told, there.starts[0], OUTAGE, filters=("through",))
    assert np.array_equal(found["lateral"][:, :, :2], alone.errors["through"])
    whole = {name: np.sqrt((x[1:] ** 2).mean()) for name, x in found.items()}
    whole["through"] = np.sqrt((there.errors["through"][1 : OUTAGE + 1] ** 2).mean())
    for rungs in (("wheels", "standstill", "through"), ("smoothed", "lagged", "through")):
        sizes = [whole[name] for name in rungs]
        assert sizes == sorted(sizes)
    assert found["lagged"].shape == found["smoothed"].shape == (OUTAGE + 1, 8, 2)


def test_an_lssvm_that_has_not_proven_itself_is_silent() -> None:
    there = outages()
    silent = np.concatenate(
        [
            np.reshape([m.regressor is None for m in t.bridges["proven"].machines], (8, 2))
            for t in there.trials
        ],
        axis=1,
    )
    same = (there.errors["proven"] == there.errors["through"]).all(axis=0)
    assert 0 < silent.sum() < silent.size
    np.testing.assert_array_equal(same, silent)


@pytest.mark.parametrize("tau", [5, 40])
def test_both_learners_learn_from_shorter_outages_whatever_tau_is(tau: int) -> None:
    hybrids = coarse(tau=tau, window=30).hybrids
    taus = {name: hybrid.tau for name, hybrid in hybrids.items()}
    assert (taus["lssvm"], taus["rbf"]) == (tau, tau)
    assert (taus["short"], taus["short rbf"]) == (10, 10)
    assert (taus["half"], taus["half rbf"]) == (20, 20)
    assert {hybrid.window for hybrid in hybrids.values()} == {30}
    assert not hybrids["half rbf"].scaled
    assert {"short rbf", "half", "half rbf"} < set(METHODS)


def test_scores_are_those_of_the_outages() -> None:
    there = outages()
    found = there.scores()
    assert (found.runs, found.headline) == (8 * 4, "rms-40")
    assert list(found.methods.values()) == list(METHODS.values())
    # place 3, the second draw of the second route
    error = there.trials[1].errors["no time"][:, 2, 1]
    run = 2 * 4 + 3
    expected = {
        "rms-40": np.sqrt(np.mean(error[1:41] ** 2)),
        "max-40": error[1:41].max(),
        "rms-late": np.sqrt(np.mean(error[41:51] ** 2)),
        "max-50": error[1:51].max(),
    }
    assert {c: found.of("no-time", c)[run] for c in found.columns} == pytest.approx(expected)


def test_parameters_of_the_chapter_are_in_its_units() -> None:
    there = VehicleOutages(slip=1.0, compass_bias=-2.0, lateral=0.3, compass_outliers=0.1)
    values = {name: setting.value for name, setting in there.settings.items()}
    assert values["slip"] == pytest.approx(np.pi / 180, abs=1e-8)
    assert values["compass_bias"] == pytest.approx(-np.pi / 90)
    assert (there.beliefs.lateral, values["compass_outlier"]) == (0.3, 0.1)


@pytest.mark.parametrize("values", [{"window": 0}, {"lateral": -1.0}, {"tau": 0}])
def test_what_may_not_be_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(ParameterError):
        VehicleOutages(**{"routes": 1, **values}).scores()
