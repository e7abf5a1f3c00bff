"""Outages in a drive, and every method through each of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.linear_model import LinearRegression

from inswsn_lib.checks import Array, one_of, unmasked, whole
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.learning import HoldRegressor, RBFNetworkRegressor, SelectedLSSVM
from inswsn_lib.navigation.vehicle_hybrid import Bridge, Ramps, VehicleHybrid
from inswsn_lib.simulation import Drive
from inswsn_lib.vehicle import (
    FilterSettings,
    VehicleRun,
    horizontal_error,
    replay,
    run_vehicle_filter,
)

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

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> p3 = iw.load_scenario(iw.data_file("scenarios/p3.yaml"))
    >>> list(iw.navigation.p3_hybrids(iw.FilterSettings.from_settings(p3), window=60))
    ['lssvm', 'rbf', 'no time', 'linear', 'hold']
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
        The filters with GPS at all times, without and with compass and lateral constraint; their
        covariances, six sevenths of what they take, are not kept and read NaN.
    branches : dict of str to VehicleRun
        The filters through the outages, outages x runs, likewise.
    ramps, bridges : dict of str to Ramps, and to Bridge
        What each hybrid learned from, and what it did.
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

    An outage does not touch the others: each is a replay of the drive with GPS up to its own start.

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

    Raises
    ------
    ParameterError
        If an outage leaves the drive, or a hybrid has the name of a filter or other settings.

    Examples
    --------
    Forty seconds without GPS in the first turn of P3's drive, with the aids and without:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive, told = iw.simulate_drive(p3, runs=4, seed=0), iw.FilterSettings.from_settings(p3)
    >>> errors = iw.navigation.run_outages(drive, told, [drive.places[0].start], 40).errors
    >>> bool(errors["through"].mean() < errors["never"].mean() / 2)
    True
    """
    hybrids, begin = hybrids or {}, as_starts(starts)
    for name, hybrid in hybrids.items():
        if name in FILTERS or hybrid.settings != settings:
            must_be = f"named other than {', '.join(FILTERS)} and have the filters' settings"
            raise ParameterError("hybrids", name, must_be)
    for name in filters:
        one_of("filters", name, FILTERS)
    needed = {name != "never" for name in filters} | {h.aiding for h in hybrids.values()}
    bases = {
        aiding: run_vehicle_filter(drive, settings, aiding=aiding, last=int(begin.max()))
        for aiding in needed
    }
    branches = {
        name: _lean(
            replay(drive, settings, bases[name != "never"], begin, steps, aiding=name == "through")
        )
        for name in filters
    }
    positions = {name: branch.position for name, branch in branches.items()}
    ramps: dict[str, Ramps] = {}
    bridges: dict[str, Bridge] = {}
    shared: dict[tuple[object, ...], Ramps] = {}
    for name, hybrid in hybrids.items():
        base, key = bases[hybrid.aiding], hybrid.pairs_key
        if key not in shared:
            shared[key] = hybrid.simulate_outages(drive, base, begin)
        ramps[name] = shared[key]
        branch = branches.get("through" if hybrid.aiding else "never")
        bridges[name] = hybrid.bridge(drive, base, begin, steps, ramps=ramps[name], branch=branch)
        positions[name] = bridges[name].position
    any_branch, shape = next(iter(branches.values())), (len(begin), drive.runs)
    return OutageTrials(
        starts=begin,
        errors={
            name: horizontal_error(any_branch, drive, x).reshape(steps + 1, *shape)
            for name, x in positions.items()
        },
        positions={name: x.reshape(steps + 1, 3, *shape) for name, x in positions.items()},
        bases={aiding: _lean(run) for aiding, run in bases.items()},
        branches=branches,
        ramps=ramps,
        bridges=bridges,
    )


def _lean(run: VehicleRun) -> VehicleRun:
    """Return a run without its covariances: they read NaN, and take no memory."""
    own, others = run.states.covariance, run.innovation_covariances
    states = replace(run.states, covariance=np.broadcast_to(np.nan, own.shape))
    nothing = np.broadcast_to(np.nan, others.shape)
    return replace(run, states=states, innovation_covariances=nothing)


def as_starts(starts: ArrayLike) -> NDArray[np.intp]:
    """Return epochs at which outages begin, (outages,); refuse what is no whole number."""
    begin = np.atleast_1d(np.asarray(unmasked(starts)))
    if begin.dtype.kind not in "iu" or begin.ndim != 1 or not begin.size:
        raise ParameterError(
            "starts",
            Described(f"{begin.dtype} of shape {begin.shape}"),
            "whole numbers of shape (outages,)",
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

    Examples
    --------
    >>> import numpy as np, inswsn_lib as iw
    >>> [float(size) for size in iw.navigation.outage_size(np.array([9.0, 1.0, 7.0]))]
    [5.0, 7.0]
    """
    steps = len(errors) - 1
    end = steps if last is None else whole("last", last, 1, steps)
    part = errors[whole("first", first, 1, end) : end + 1]
    return np.sqrt(np.mean(part**2, axis=0)), part.max(axis=0)
