"""The core of p3-vehicle: what the chapter published, and methods whose errors are known."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inswsn_book.record.results import read_results

from inswsn_lib.errors import ParameterError
from inswsn_lib.navigation import VehicleOutages
from inswsn_lib.navigation.vehicle_outages import METHODS, OUTAGE, p3_settings
from inswsn_lib.scenario import with_values


def coarse(changes: dict[str, Any] | None = None, **values: Any) -> VehicleOutages:
    """Return drives of an IMU of 10 Hz, which are quick to compute."""
    published = with_values(p3_settings(), imu_period=0.1, **(changes or {}))
    return VehicleOutages(published, **{"routes": 2, "draws": 2, **values})


@cache
def outages() -> VehicleOutages:
    return coarse()


@pytest.mark.whole
def test_it_computes_what_the_chapter_published(root: Path) -> None:
    published = read_results(root / "data" / "published" / "p3-vehicle.json")
    found = VehicleOutages().scores()
    ratios = {f"methods.{method}": (method, "through") for method in found.methods}
    ratios["factor.through-never"] = ("through", "never")
    compared = [quantity for quantity in published.quantities if quantity.name in ratios]
    assert len(compared) > 2
    for quantity in compared:
        over, under = (found.of(method) for method in ratios[quantity.name])
        ratio = np.exp(np.log(over / under).mean())
        assert ratio == pytest.approx(quantity.value, abs=quantity.tolerance), quantity.name


def test_aids_that_say_nothing_are_no_aids() -> None:
    deaf = coarse({"filter_compass": 1e3}, routes=1, draws=1, lateral=1e6)
    for name in ("until", "through"):
        np.testing.assert_allclose(deaf.errors[name], deaf.errors["never"], rtol=1e-3, atol=1e-3)
    aided = outages()
    assert np.abs(aided.errors["through"] - aided.errors["never"])[OUTAGE].max() > 10


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
