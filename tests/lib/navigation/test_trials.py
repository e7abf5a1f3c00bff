"""Outages against full replays, what they may not know, and regressors that prove themselves."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from lib.vehicle.made_drive import KNOWN, changed, make_drive
from pyins import transform
from sklearn.linear_model import LinearRegression

from inswsn_lib import papers
from inswsn_lib.errors import ParameterError
from inswsn_lib.inertial import metres
from inswsn_lib.learning import HoldRegressor, RBFNetworkRegressor, SelectedLSSVM
from inswsn_lib.navigation import OutageTrials, VehicleHybrid, outage_size, p3_hybrids, run_outages
from inswsn_lib.simulation import Drive
from inswsn_lib.vehicle import run_vehicle_filter

STARTS, STEPS = (40, 60), 15
SHORT: dict[str, Any] = {"tau": 10, "window": 20}


@cache
def driven() -> Drive:
    return make_drive(90, 2, seed=5)


def hybrids() -> dict[str, VehicleHybrid]:
    return {
        "linear": VehicleHybrid(KNOWN, LinearRegression(), **SHORT),
        "on never": VehicleHybrid(KNOWN, HoldRegressor(), aiding=False, **SHORT),
    }


def taken(drive: Drive) -> OutageTrials:
    return run_outages(drive, KNOWN, STARTS, STEPS, hybrids())


@cache
def trials() -> OutageTrials:
    return taken(driven())


# --- the filters ---


@pytest.mark.parametrize(
    ("name", "options"),
    [("never", {"aiding": False}), ("until", {"aided_outages": False}), ("through", {})],
)
@pytest.mark.parametrize("number", [0, 1])
def test_an_outage_is_a_run_of_the_whole_drive_with_that_outage(
    name: str, options: dict[str, bool], number: int
) -> None:
    """To a micrometre: GPS is there at the start, and gone from the next epoch on."""
    drive, start = driven(), STARTS[number]
    span = slice(start, start + STEPS + 1)
    outage = (start + 1, start + STEPS + 1)
    whole = run_vehicle_filter(drive, KNOWN, outages=[outage], last=start + STEPS, **options)
    found = trials().positions[name][:, :, number]
    size = metres(np.moveaxis(found, 1, 2)).swapaxes(1, 2)
    assert np.abs((found - whole.position[span]) * size).max() < 1e-6
    # the distance, by pyins
    for run in range(drive.runs):
        degrees = np.array([np.rad2deg(1), np.rad2deg(1), 1.0])
        away = transform.compute_lla_difference(
            found[:, :, run] * degrees, drive.reference.position[span] * degrees
        )
        distance = np.hypot(away[:, 0], away[:, 1])
        assert trials().errors[name][:, number, run] == pytest.approx(distance, rel=1e-4, abs=1e-4)
    # it can be told from a run without the outage
    heard = run_vehicle_filter(drive, KNOWN, aiding=name != "never", last=start + STEPS)
    assert np.abs(found[2:] - heard.position[span][2:]).max() > 1e-9


def test_when_an_outage_begins_those_with_the_same_aids_know_the_same() -> None:
    found = trials()
    assert found.starts.tolist() == list(STARTS)
    for group in (("until", "through", "linear"), ("never", "on never")):
        first = found.positions[group[0]][0]
        assert all(np.array_equal(found.positions[name][0], first) for name in group)
    assert np.array_equal(first, found.bases[False].position[list(STARTS)].transpose(1, 0, 2))


def garbage(drive: Drive, name: str, after: int) -> Drive:
    """Return the drive with other numbers from an epoch's successor on."""
    values = getattr(drive, name).copy()
    first = after * drive.samples_per_epoch if "increments" in name else after + 1
    rng = np.random.default_rng(8)
    size = {"gps_position": 1e-4, "gps_velocity": 20.0, "compass": 1.0}.get(name, 0.05)
    values[first:] += size * rng.normal(size=values[first:].shape)
    return changed(drive, **{name: values})


METHODS = ("never", "until", "through", "linear", "on never")


@pytest.mark.parametrize(
    ("sensor", "after", "deaf", "outage", "steps"),
    [
        # who is never aided looks at the compass to be aligned alone
        ("compass", 0, ("never", "on never"), 0, STEPS + 1),
        ("compass", 0, ("never", "on never"), 1, STEPS + 1),
        ("compass", STARTS[0], ("until",), 0, STEPS + 1),
        # nothing of GPS after the start: neither by filters, nor by what hybrids learn from
        ("gps_position", STARTS[0], METHODS, 0, STEPS + 1),
        ("gps_velocity", STARTS[0], METHODS, 0, STEPS + 1),
        ("gps_position", STARTS[1], METHODS, 1, STEPS + 1),
        ("gps_velocity", STARTS[1], METHODS, 1, STEPS + 1),
        # nothing before it is measured
        ("compass", STARTS[1] + 7, METHODS, 1, 8),
        ("rotation_increments", STARTS[1] + 7, METHODS, 1, 8),
        ("velocity_increments", STARTS[1] + 7, METHODS, 1, 8),
    ],
)
def test_what_is_not_known_changes_nothing(
    sensor: str, after: int, deaf: tuple[str, ...], outage: int, steps: int
) -> None:
    other = taken(garbage(driven(), sensor, after)).positions
    for name in deaf:
        same = other[name][:steps, :, outage] == trials().positions[name][:steps, :, outage]
        assert same.all(), name
    if after < STARTS[1]:  # the second outage has what came in between
        assert not np.array_equal(other["until"][..., 1], trials().positions["until"][..., 1])
    elif "gps" not in sensor:
        assert not np.array_equal(other["through"], trials().positions["through"])


def test_never_is_aligned_by_the_compass() -> None:
    turned = driven().compass.copy()
    turned[0] += 0.1
    other = taken(changed(driven(), compass=turned)).positions["never"]
    assert not np.array_equal(other, trials().positions["never"])


# --- who takes part ---


def test_who_may_not_take_part() -> None:
    """Simulated outages of a hybrid with other settings would begin with what another knew."""
    other = VehicleHybrid(replace(KNOWN, lateral=1.0), LinearRegression(), **SHORT)
    for named in ({"never": hybrids()["linear"]}, {"linear": other}):
        with pytest.raises(ParameterError, match="hybrids must be"):
            run_outages(driven(), KNOWN, [40], 5, named)
    wrong: list[Any] = [[40.0], [], [[40, 50]], ["40"], [True]]
    for starts in wrong:
        with pytest.raises(ParameterError, match=r"starts.*whole numbers"):
            run_outages(driven(), KNOWN, starts, 5)
    with pytest.raises(ParameterError, match=r"filters .* not 'sometimes'"):
        run_outages(driven(), KNOWN, [40], 5, filters=("never", "sometimes"))
    for starts, steps in (([80], 11), ([-1], 5), ([40, 91], 1)):
        with pytest.raises(ParameterError):
            run_outages(driven(), KNOWN, starts, steps)


@pytest.mark.parametrize(
    ("filters", "bases"),
    [
        (("never",), {False}),
        (("through",), {True}),
        (("until", "through"), {True}),
        (("never", "until"), {False, True}),
    ],
)
def test_some_of_the_filters(filters: tuple[str, ...], bases: set[bool]) -> None:
    """Hybrids are the same whichever take part."""
    some = run_outages(driven(), KNOWN, STARTS, STEPS, filters=filters)
    assert set(some.errors) == set(some.branches) == set(filters)
    assert set(some.bases) == bases
    both = run_outages(driven(), KNOWN, STARTS, STEPS, hybrids(), filters=filters)
    for name in (*filters, *hybrids()):
        assert np.array_equal(both.positions[name], trials().positions[name])


# --- the size of an error ---


@given(st.floats(1e-3, 1e3), st.data())
def test_an_error_that_grows_by_a_line(slope: float, data: st.DataObject) -> None:
    """The sum of squares from a to b is S(b) - S(a - 1), S(n) = n (n + 1) (2 n + 1) / 6."""
    steps = data.draw(st.integers(1, 60))
    last = data.draw(st.integers(1, steps))
    first = data.draw(st.integers(1, last))
    errors = slope * np.arange(steps + 1.0)[:, None]
    errors[0] = 1e9  # the last epoch with GPS does not count
    rms, largest = outage_size(errors, first, last)
    a = first - 1
    squares = (last * (last + 1) * (2 * last + 1) - a * (a + 1) * (2 * a + 1)) / 6
    assert rms[0] == pytest.approx(slope * np.sqrt(squares / (last - a)))
    assert largest[0] == pytest.approx(slope * last)


@pytest.mark.parametrize(("first", "last"), [(0, 3), (3, 2), (1, 11), (11, None), (-1, 5), (2, 0)])
def test_a_part_that_is_none(first: int, last: int | None) -> None:
    with pytest.raises(ParameterError, match=r"first|last"):
        outage_size(np.zeros((11, 2)), first, last)


# --- P3's methods ---


def test_the_settings_of_the_methods_are_those_that_p3_prints(root: Path) -> None:
    printed = papers.read_numbers(root / "data" / "papers" / "p3.yaml")["settings"]
    methods = p3_hybrids(KNOWN)
    assert list(methods) == ["lssvm", "rbf", "no time", "linear", "hold"]
    assert all(m.window == float(printed["window_s"]) for m in methods.values())
    assert all(m.settings is KNOWN and m.aiding and m.motion for m in methods.values())
    network = methods["rbf"].regressor
    assert isinstance(network, RBFNetworkRegressor)
    newrb = printed["newrb"]
    assert network.spread == float(newrb["spread"])
    assert network.goal == float(newrb["goal"])
    assert network.max_neurons == float(newrb["max_neurons"])
    assert [name for name, m in methods.items() if not m.scaled] == ["rbf"]
    assert [name for name, m in methods.items() if not m.timed] == ["no time"]
    kinds = [SelectedLSSVM, RBFNetworkRegressor, SelectedLSSVM, LinearRegression, HoldRegressor]
    assert [type(m.regressor) for m in methods.values()] == kinds
    # options are for all of them
    assert all(m.tau == 7 and m.scaled for m in p3_hybrids(KNOWN, tau=7, scaled=True).values())
