"""One or many runs over a table of events, compiled or by numpy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from inswsn_lib.checks import Array, Mask
from inswsn_lib.inertial.plain import error_state
from inswsn_lib.inertial.steps import Steps
from inswsn_lib.kernels import choose, compiled
from inswsn_lib.kernels.choice import quiet
from inswsn_lib.streams import Whole

#: How many kinds of sensors the compiled filter takes
_MOST = 8
#: What is done with a correction: it is kept beside the state, fed back after each measurement, or
#: after all of an event; then own states stay beside, and the covariance of the attitude is kept
#: about axes of the frame, which differs in second order
BESIDE, AT_ONCE, AFTER = 0, 1, 2


class Table(NamedTuple):
    """The measurements of some events, and their components.

    Attributes
    ----------
    taken : ndarray, (events + 1,)
        The first measurement of each event.
    begins, stops : ndarray, (measurements,)
        The components of each.
    kinds : ndarray, (components,)
        The sensor of each.
    data : ndarray, (components, numbers)
        For the sensor.
    arms : ndarray, (components, 3)
        Lever arms, m.
    noise : ndarray, (components, 3)
        Variance, gate, and after what a value repeats or 0.
    owns : ndarray, (components, 2)
        The first of the sensor's own states, and how many there are.
    told : ndarray, (runs, components)
        What was measured; NaN where missing.
    """

    taken: Whole
    begins: Whole
    stops: Whole
    kinds: Whole
    data: Array
    arms: Array
    noise: Array
    owns: Array
    told: Array


class Outcome(NamedTuple):
    """What runs over events leave; those of events are empty unless they are to be kept.

    Attributes
    ----------
    states, before : ndarray, (events, runs, numbers)
        After and before the measurements.
    filtered, priors, transitions : ndarray, (events, runs, n, n)
    errors : ndarray, (events, runs, n)
        What is kept beside the states.
    firsts : ndarray, (events, runs, 3)
        Positions after the first measurement of each event.
    values, deviations, used : ndarray, (runs, components)
        Innovations, NaN where nothing was measured.
    squares : ndarray, (runs, measurements)
        Normalised squares over the number of components.
    spreads : ndarray, (measurements, runs, m, m)
        Covariances of innovations.
    likelihoods : ndarray, (runs,)
    state, covariance, error : ndarray
        At the end.
    """

    states: Array
    before: Array
    filtered: Array
    priors: Array
    transitions: Array
    errors: Array
    firsts: Array
    values: Array
    deviations: Array
    used: Mask
    squares: Array
    spreads: Array
    likelihoods: Array
    state: Array
    covariance: Array
    error: Array


def run_table(
    make: Any, steps: Steps, start: tuple[Array, Array, Array], own: tuple[Array, Array],
    sensors: Sequence[Callable[..., Any]], table: Table, *, mode: int, kept: int,
) -> Outcome:  # fmt: skip
    """Run the filter.

    Parameters
    ----------
    make : type
        Of the states.
    steps : Steps
    start : tuple of ndarray
        States (runs, numbers), covariances (runs, n, n) and errors beside the states (runs, n).
    own : tuple of ndarray, (events, states) each
        By what own states are multiplied up to each event, and the variance they gain.
    sensors : sequence of callable
    table : Table
    mode : int
        `BESIDE`, `AT_ONCE` or `AFTER`.
    kept : int
        0 for the end alone; 1 for states, covariances, first positions and covariances of
        innovations; 2 for what a smoother needs.
    """
    plain: Callable[..., Any] = partial(error_state, make=make)
    run = plain if len(sensors) > _MOST else choose("error_state", plain)
    if run is not plain:
        sensors = [compiled(sensor, 4) for sensor in sensors]
        sensors = sensors + sensors[:1] * (_MOST - len(sensors))
    begun = [np.ascontiguousarray(x, dtype=float) for x in (*start, *own)]
    with quiet():
        return Outcome(*run(tuple(sensors), *steps.numbers, *begun, *table, mode, kept))
