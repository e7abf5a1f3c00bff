"""Outages in a drive, and every method through each of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.linear_model import LinearRegression

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import HoldRegressor, RBFNetworkRegressor, SelectedLSSVM
from inswsn_lib.navigation.vehicle_hybrid import Bridge, Ramps, VehicleHybrid
from inswsn_lib.vehicle import (
    Drive,
    FilterSettings,
    VehicleRun,
    horizontal_error,
    replay,
    run_vehicle_filter,
)

Array = NDArray[np.float64]

#: The three filters without learning: no compass and lateral constraint at any time; both until the
#: outage begins; both through the outage as well
FILTERS = ("never", "until", "through")


def p3_hybrids(settings: FilterSettings, **options: Any) -> dict[str, VehicleHybrid]:
    """Return P3's hybrid and what it is compared with, by name.

    ``lssvm``, P3's proposed method, with kernel width and regularisation of least leave-one-out
    error; ``rbf``, the network with the numbers that P3 prints for newrb (Section 5.2), on inputs
    and targets as they are, since its spread and goal are in their units; ``no time``, the LS-SVM
    without the time since the outage; ``linear``, a linear fit; ``hold``, the last difference held.

    Parameters
    ----------
    settings : FilterSettings
    **options
        Of `VehicleHybrid`, for all of them.

    Returns
    -------
    dict of str to VehicleHybrid

    Examples
    --------
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.navigation import p3_hybrids
    >>> from inswsn_lib.scenario import load_scenario
    >>> from inswsn_lib.vehicle import FilterSettings
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> hybrids = p3_hybrids(FilterSettings.from_settings(scenario), window=60)
    >>> list(hybrids)
    ['lssvm', 'rbf', 'no time', 'linear', 'hold']
    >>> hybrids["rbf"].scaled, hybrids["no time"].timed, hybrids["hold"].window
    (False, False, 60)
    """
    network = RBFNetworkRegressor(spread=3.0, goal=0.01, max_neurons=40)
    return {
        "lssvm": VehicleHybrid(settings, SelectedLSSVM(), **options),
        "rbf": VehicleHybrid(settings, network, **({"scaled": False} | options)),
        "no time": VehicleHybrid(settings, SelectedLSSVM(), **({"timed": False} | options)),
        "linear": VehicleHybrid(settings, LinearRegression(), **options),
        "hold": VehicleHybrid(settings, HoldRegressor(), **options),
    }


@dataclass(frozen=True, eq=False)
class OutageTrials:
    """What each method did in each outage.

    Attributes
    ----------
    starts : ndarray of int, (outages,)
        The last epoch with GPS.
    errors : dict of str to ndarray, (steps + 1, outages, runs)
        Horizontal distance from the reference (m), by method; at step 0 the outage begins.
    positions : dict of str to ndarray, (steps + 1, 3, outages, runs)
        Latitude, longitude (rad), height (m), by method.
    bases : dict of bool to VehicleRun
        The filters with GPS at all times, without and with compass and lateral constraint.
    branches : dict of str to VehicleRun
        The filters through the outages, outages x runs.
    ramps : dict of str to Ramps
        What each hybrid learned from.
    bridges : dict of str to Bridge
        What each hybrid did.

    Examples
    --------
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.navigation import run_outages
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import FilterSettings, simulate_drive
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=2, seed=0)
    >>> trials = run_outages(drive, FilterSettings.from_settings(scenario), [30, 50, 70], 5)
    >>> trials.errors["until"].shape, trials.positions["until"].shape
    ((6, 3, 2), (6, 3, 3, 2))
    >>> bool((trials.errors["until"][0] == trials.errors["through"][0]).all())  # it has not begun
    True
    """

    starts: NDArray[np.intp]
    errors: dict[str, Array]
    positions: dict[str, Array]
    bases: dict[bool, VehicleRun]
    branches: dict[str, VehicleRun]
    ramps: dict[str, Ramps]
    bridges: dict[str, Bridge]


def run_outages(
    drive: Drive,
    settings: FilterSettings,
    starts: ArrayLike,
    steps: int,
    hybrids: Mapping[str, VehicleHybrid] | None = None,
    *,
    filters: Sequence[str] = FILTERS,
) -> OutageTrials:
    """Take GPS away at several places, one at a time, and navigate on by every method.

    The filters of `FILTERS` always take part. An outage does not touch the others: each is a replay
    of the drive with GPS up to its own start.

    Parameters
    ----------
    drive : Drive
    settings : FilterSettings
        Of the filters of `FILTERS`.
    starts : array_like of int, (outages,)
        The last epochs with GPS.
    steps : int
        Length of the outages (epochs).
    hybrids : mapping of str to VehicleHybrid, optional
        By name. Those with equal settings share what they learn from.
    filters : sequence of str
        Which of `FILTERS` take part.

    Returns
    -------
    OutageTrials

    Raises
    ------
    ParameterError
        If an outage leaves the drive, or a hybrid has the name of a filter or other settings.

    Examples
    --------
    Forty seconds without GPS in the first turn of P3's drive: compass and lateral velocity bound
    the error, and the hybrid learns on top of them.

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.learning import HoldRegressor
    >>> from inswsn_lib.navigation import VehicleHybrid, outage_size, run_outages
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import FilterSettings, simulate_drive
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> settings = FilterSettings.from_settings(scenario)
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=4, seed=0)
    >>> hybrids = {"hold": VehicleHybrid(settings, HoldRegressor())}
    >>> trials = run_outages(drive, settings, [drive.places[0].start], 40, hybrids)
    >>> mean = {name: outage_size(error)[0].mean() for name, error in trials.errors.items()}
    >>> list(mean), bool(mean["through"] < mean["never"] / 2)
    (['never', 'until', 'through', 'hold'], True)
    """
    begin = as_starts(starts)
    hybrids = hybrids or {}
    for name, hybrid in hybrids.items():
        if name in FILTERS:
            raise ParameterError("hybrids", name, f"not one of {', '.join(FILTERS)}")
        if hybrid.settings != settings:
            raise ParameterError("hybrids", name, "of the same settings as the filters")
    last = int(begin.max())
    if not filters or not set(filters) <= set(FILTERS):
        raise ParameterError("filters", list(filters), f"some of {', '.join(FILTERS)}")
    needed = {name != "never" for name in filters} | {h.aiding for h in hybrids.values()}
    bases = {
        aiding: run_vehicle_filter(drive, settings, aiding=aiding, last=last) for aiding in needed
    }
    branches = {
        name: replay(
            drive, settings, bases[name != "never"], begin, steps, aiding=name == "through"
        )
        for name in filters
    }
    positions = {name: branch.position for name, branch in branches.items()}
    shared: dict[tuple[object, ...], Ramps] = {}
    learned, bridges = {}, {}
    for name, hybrid in hybrids.items():
        base = bases[hybrid.aiding]
        branch = branches.get("through" if hybrid.aiding else "never")
        key = hybrid.pairs_key
        if key not in shared:
            shared[key] = hybrid.simulate_outages(drive, base, begin)
        learned[name] = shared[key]
        bridges[name] = hybrid.bridge(drive, base, begin, steps, ramps=shared[key], branch=branch)
        positions[name] = bridges[name].position
    any_branch = next(iter(branches.values()))
    errors = {
        name: horizontal_error(any_branch, drive, position) for name, position in positions.items()
    }
    shape = (steps + 1, len(begin), drive.runs)
    return OutageTrials(
        starts=begin,
        errors={name: error.reshape(shape) for name, error in errors.items()},
        positions={
            name: position.reshape(steps + 1, 3, *shape[1:]) for name, position in positions.items()
        },
        bases=bases,
        branches=branches,
        ramps=learned,
        bridges=bridges,
    )


def as_starts(starts: ArrayLike) -> NDArray[np.intp]:
    """Return epochs at which outages begin, (outages,); refuse what is no whole number."""
    begin = np.atleast_1d(np.asarray(starts))
    if begin.dtype.kind not in "iu" or begin.ndim != 1 or not begin.size:
        raise ParameterError(
            "starts", f"{begin.dtype} of shape {begin.shape}", "one or more whole numbers"
        )
    return begin.astype(np.intp)


def outage_size(errors: Array, first: int = 1, last: int | None = None) -> tuple[Array, Array]:
    """Return RMS and maximum of errors over a part of the outages, each (...).

    Parameters
    ----------
    errors : ndarray, (steps + 1, ...)
        Horizontal errors (m); step 0 is the last with GPS and does not count.
    first, last : int
        The steps, both included. Default: the whole outage.

    Returns
    -------
    rms, largest : ndarray, (...)
        m.

    Raises
    ------
    ParameterError
        If a step is not within the outage.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import outage_size
    >>> rms, largest = outage_size(np.array([9.0, 1.0, 7.0]))  # step 0 still has GPS
    >>> float(rms), float(largest)
    (5.0, 7.0)
    """
    end = len(errors) - 1 if last is None else last
    if not 1 <= first < len(errors):
        raise ParameterError("first", first, f"from 1 to {len(errors) - 1}")
    if not first <= end < len(errors):
        raise ParameterError("last", last, f"from {first} to {len(errors) - 1}")
    part = errors[first : end + 1]
    return np.sqrt(np.mean(part**2, axis=0)), part.max(axis=0)
