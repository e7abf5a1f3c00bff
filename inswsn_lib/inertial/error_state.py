r"""The error-state Kalman filter: a motion, observations with states of their own, and the events.

The motion goes on from the corrected state after each event (a closed loop), so that the errors are
zero before a measurement, whose innovation is :math:`z - h(\hat x)`. Covariances are updated in
Joseph's form,

.. math::
    K = P H' (H P H' + R)^{-1}, \qquad P^+ = (I - K H) P (I - K H)' + K R K' .
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from inswsn_lib.checks import Array, Mask, covariance
from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial.observations import Components, Observation
from inswsn_lib.inertial.plain import expected
from inswsn_lib.inertial.runs import AT_ONCE, BESIDE, Outcome, Table, run_table
from inswsn_lib.inertial.sensors import position, velocity
from inswsn_lib.inertial.steps import Steps
from inswsn_lib.streams import Whole

_NUMBERS = {15: 21, 5: 6}  # of a state, by how many errors it has


@dataclass(frozen=True, eq=False)
class Start:
    """Where a filter starts.

    Attributes
    ----------
    time : float
        s.
    state : InertialState or PlanarState
    covariance : ndarray, (errors, errors) or (n, n)
        Of its errors, or of those and of the observations' own states, with what they share.
    """

    time: float
    state: Any
    covariance: Array


@dataclass(frozen=True, eq=False)
class Innovations:
    """The innovations of one observation, a row for each of its measurements.

    Attributes
    ----------
    time : ndarray, (rows,)
        s.
    values : list of ndarray
        Innovations, as they were.
    deviations : list of ndarray
        What the filter expected of their sizes.
    used : list of ndarray of bool
        Which components passed the gate.
    squares : ndarray, (rows,)
        Normalised squares (NIS) over the number of components, of all components.
    """

    time: Array
    values: list[Array]
    deviations: list[Array]
    used: list[Mask]
    squares: Array


@dataclass(frozen=True, eq=False)
class Solution:
    """States at the times of events, after their measurements, with what a smoother needs.

    Attributes
    ----------
    time : ndarray, (events,)
        s.
    states : sequence of InertialState or PlanarState
    covariances : ndarray, (events, n, n)
        Of the errors of the motion and of the observations' own states.
    before : sequence of InertialState or PlanarState
        The states before the measurements of an event.
    priors, transitions : ndarray, (events, n, n)
        Covariances before the measurements, and the transition from the event before.
    innovations : list of Innovations
        One for each observation.
    log_likelihood : float
        Of all measurements, by the innovations; of a component that was left out, what it is at the
        gate.
    start, end : Start
        The first and the last, with the observations' own states.
    """

    time: Array
    states: Sequence[Any]
    covariances: Array
    before: Sequence[Any]
    priors: Array
    transitions: Array
    innovations: list[Innovations]
    log_likelihood: float
    start: Start
    end: Start

    @classmethod
    def of(
        cls, found: Outcome, time: Array, start: Start, innovations: list[Innovations], end: Start,
        run: int = 0,
    ) -> Solution:  # fmt: skip
        """Return that of a run of an outcome that kept what a smoother needs.

        :meta private:
        """
        states, before = (
            _States(type(start.state).of_row, x[:, run]) for x in (found.states, found.before)
        )
        filtered, priors, transitions = (
            x[:, run] for x in (found.filtered, found.priors, found.transitions)
        )
        return cls(
            time, states, filtered, before, priors, transitions, innovations,
            float(found.likelihoods[run]), start, end,
        )  # fmt: skip

    @property
    def position(self) -> Array:
        """(events, 2 or 3), m."""
        return np.array([state.position for state in self.states])

    @property
    def velocity(self) -> Array:
        """(events, 2 or 3), m/s."""
        return np.array([state.velocity for state in self.states])

    def at(self, times: Array) -> Whole:
        """Return the events at some times, which must be times of events, (times,)."""
        found = np.clip(np.searchsorted(self.time, times), 0, len(self.time) - 1)
        if (self.time[found] != times).any():
            raise InswsnError("The filter has no event at some of these times.")
        return np.asarray(found)


def run_error_state(
    motion: Any,
    start: Start,
    observations: Sequence[Observation],
    *,
    end: float = np.inf,
    gate: float = np.inf,
    about: Any = None,
    kept: bool = True,
) -> Solution:
    """Run an error-state Kalman filter over the events of all observations, in the order of time.

    Parameters
    ----------
    motion : InertialMotion or OdometryMotion
    start : Start
        Measurements up to its time are left out.
    observations : sequence of Observation
        Where two have a measurement at one time, the first comes first.
    end : float
        Measurements after it are left out, s.
    gate : float
        A component of a measurement is left out where the square of its innovation is more than
        this many times its variance.
    about : InertialState or PlanarState, optional
        A state at the time of the start from which the motion goes on without corrections: all is
        linearised about it, and its errors are estimated (feedforward). By default the motion goes
        on from each corrected state (feedback).
    kept : bool
        Whether states, covariances and innovations are kept. Else the solution has the likelihood,
        and of innovations the times and normalised squares: all that a search for numbers needs.

    Raises
    ------
    InswsnError
        If no measurement lies between start and end.

    Examples
    --------
    Wheels say 1 m/s, fixes 1.1 m/s: the scale of the odometer is found.

    >>> import numpy as np
    >>> from inswsn_lib import inertial as nav
    >>> from inswsn_lib.streams import Fixes, Odometry
    >>> t = np.arange(0, 20.1, 0.1)
    >>> wheels = Odometry(t, speed=np.full(201, 1.0), rate=np.zeros(201))
    >>> motion = nav.OdometryMotion(wheels, nav.OdometryNoise(0.01, 0.001, 1e-4, 1e-5))
    >>> start = nav.Start(0.0, nav.PlanarState(np.zeros(2), 0.0), np.eye(5) / 25)
    >>> fixes = Fixes(t[10::10], np.outer(1.1 * t[10::10], [1.0, 0.0]))
    >>> observed = [nav.PositionFixes(fixes, np.zeros(2), white=np.full(2, 0.1))]
    >>> solution = nav.run_error_state(motion, start, observed)
    >>> print(f"{solution.states[-1].scale:.2f} and {solution.innovations[0].squares.mean():.2f}")
    0.10 and 0.01
    """
    counts = [len(each.time) for each in observations]
    when = np.concatenate([[], *(each.time for each in observations)])
    kind = np.repeat(np.arange(len(counts)), np.array(counts, dtype=int))
    row = np.concatenate([np.arange(0), *(np.arange(count) for count in counts)])
    order = np.argsort(when, kind="stable")
    order = order[(when[order] > start.time) & (when[order] <= end)]
    if not order.size:
        raise InswsnError(
            f"There is no measurement after {start.time:.6g} s and up to {end:.6g} s."
        )
    times, first = np.unique(when[order], return_index=True)
    events = _Events(times, np.append(first, len(order)), kind[order], row[order])
    run = ErrorStateFilter(start, observations, gate, about)
    whole = Start(start.time, run.state, run.covariance)
    found, table = run._go(motion.between(start.time, times), events, observations, kept=kept)
    innovations = [
        _innovations(found, table, events, i, kept=kept) for i in range(len(observations))
    ]
    last = Start(run.time, run.state, run.covariance)
    return Solution.of(found, times if kept else times[:0], whole, innovations, last)


class _Events(NamedTuple):
    """When there are measurements, and which: a row of an observation each."""

    time: Array  # (events,)
    first: Whole  # (events + 1,), of the measurements of each
    kind: Whole  # (measurements,), the observation
    row: Whole  # (measurements,)


def _innovations(
    found: Outcome, table: Table, events: _Events, i: int, *, kept: bool
) -> Innovations:
    """Return those of an observation."""
    mine = np.flatnonzero(~np.isnan(found.squares[0]) & (events.kind == i))
    time, squares = np.repeat(events.time, np.diff(events.first))[mine], found.squares[0, mine]
    if not kept:
        return Innovations(time, [], [], [], squares)
    parts = [
        np.arange(a, b)[~np.isnan(found.values[0, a:b])]
        for a, b in zip(table.begins[mine], table.stops[mine], strict=True)
    ]
    values, deviations = ([of[0, p] for p in parts] for of in (found.values, found.deviations))
    return Innovations(time, values, deviations, [found.used[0, p] for p in parts], squares)


class ErrorStateFilter:
    """An error-state filter on its way, for data that come one after the other.

    `run_error_state` runs one over data that are all there.

    Parameters
    ----------
    start : Start
    observations : sequence of Observation
        Those that will come, for their own states.
    gate, about
        As in `run_error_state`.

    Attributes
    ----------
    time : float
        s, of the state.
    covariance : ndarray, (n, n)
        Of the errors of the motion and of the observations' own states.
    log_likelihood : float
        Of the measurements so far.

    Examples
    --------
    Wheels say 1 m/s; a fix says that the vehicle is a little ahead of that.

    >>> import numpy as np
    >>> from inswsn_lib import inertial as nav
    >>> from inswsn_lib.streams import Fixes, Odometry
    >>> wheels = Odometry(np.array([0.0, 1.0]), speed=np.ones(2), rate=np.zeros(2))
    >>> motion = nav.OdometryMotion(wheels, nav.OdometryNoise(0.1, 0.01, 1e-4, 1e-5))
    >>> fix = Fixes(np.ones(1), np.array([[1.2, 0.0]]))
    >>> seen = nav.PositionFixes(fix, np.zeros(2), white=np.full(2, 0.1))
    >>> start = nav.Start(0.0, nav.PlanarState(np.zeros(2), 0.0), np.eye(5) / 1e6)
    >>> running = nav.ErrorStateFilter(start, [seen])
    >>> running.predict(motion, 1.0)
    >>> running.measure(0, seen)
    >>> running.state.position.round(2).tolist()
    [1.1, 0.0]
    """

    def __init__(
        self, start: Start, observations: Sequence[Observation], gate: float = np.inf,
        about: Any = None,
    ) -> None:  # fmt: skip
        errors = start.state.errors
        variances = np.concatenate([each.initial for each in observations])
        whole = errors + len(variances)
        P0 = covariance("covariance", start.covariance, (errors, errors), (whole, whole))
        ends = np.cumsum([0, *(len(each.initial) for each in observations)])
        own = np.zeros(len(variances))
        first = replace(start.state, own=own)
        self.observations, self.gate = observations, gate
        self._own = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self._feedback = about is None
        self._nominal = first if about is None else replace(about, own=own)
        self._error: Array = first.minus(self._nominal)
        self.time = start.time
        self.covariance: Array = P0 if len(P0) == whole else block_diag(P0, np.diag(variances))
        self.log_likelihood = 0.0

    @property
    def state(self) -> Any:
        """InertialState or PlanarState, with the observations' own states."""
        return self._nominal if self._feedback else self._nominal.plus(self._error)

    def predict(self, motion: Any, time: float) -> None:
        """Go on to a time.

        Parameters
        ----------
        motion : InertialMotion or OdometryMotion
            With what its sensor said since the time of the state. What lies after its last sample
            is as what lies before it.
        time : float
            s.
        """
        nothing = np.zeros(0, dtype=int)
        events = _Events(np.array([time]), np.zeros(2, dtype=int), nothing, nothing)
        self._go(motion.between(self.time, events.time), events, self.observations)

    def measure(self, i: int, observation: Observation, k: int = 0) -> None:
        """Take a measurement at the time of the state.

        Parameters
        ----------
        i : int
            Of which of the observations that were announced.
        observation : Observation
            With the same own states, and the measurement.
        k : int
            Which of its measurements.
        """
        events = _Events(np.array([self.time]), np.array([0, 1]), np.array([i]), np.array([k]))
        known = [*self.observations]
        known[i] = observation
        self._go(None, events, known)

    def _go(
        self, steps: Steps | None, events: _Events, observations: Sequence[Observation], *,
        kept: bool = False,
    ) -> tuple[Outcome, Table]:  # fmt: skip
        """Take events; without steps no time passes."""
        parts = [each.components for each in observations]
        sensors = list(dict.fromkeys(part.sensor for part in parts)) or [position]
        table = _table(parts, self._own, sensors, self.gate, events)
        found = run_table(
            type(self.state), _still(self.state, len(events.time)) if steps is None else steps,
            (self._nominal.row[None], self.covariance[None], self._error[None]),
            self._coloured(steps, events.time, observations), sensors, table,
            mode=AT_ONCE if self._feedback else BESIDE, kept=2 * kept,
        )  # fmt: skip
        self._nominal = type(self._nominal).of_row(found.state[0])
        self.time, self.covariance = float(events.time[-1]), found.covariance[0]
        self._error = found.error[0]
        self.log_likelihood += float(found.likelihoods[0])
        return found, table

    def _coloured(
        self, steps: Steps | None, times: Array, observations: Sequence[Observation]
    ) -> tuple[Array, Array]:
        """Return factors and gained variances of all own states, (events, states)."""
        shape = len(times), len(self.covariance) - self._nominal.errors
        if steps is None or not shape[1]:
            return np.ones(shape), np.zeros(shape)
        passed = np.diff(times, prepend=self.time)[:, None]
        moved = [each.transition(passed) for each in observations]
        wide = [
            [np.broadcast_to(part, (len(times), len(each.initial))) for part in two]
            for two, each in zip(moved, observations, strict=True)
        ]
        factors, gained = (np.concatenate(parts, axis=1) for parts in zip(*wide, strict=True))
        return factors, gained


def _table(
    parts: Sequence[Components], own: Sequence[slice], sensors: list[Any], gate: float,
    events: _Events,
) -> Table:  # fmt: skip
    """Return the components of all observations; a gate is a sensor's own or that of the run."""
    # places of components, and of measurements, among those of all observations
    before = np.cumsum([0, *(len(part.told) for part in parts)])
    counts, zero = np.diff(before), np.zeros(0, dtype=int)
    begins, stops = (
        np.concatenate(
            [zero, *(p.first[s] + b for p, b in zip(parts, before, strict=False))]
        ).astype(np.int64)
        for s in (slice(-1), slice(1, None))
    )
    rows = np.cumsum([0, *(len(part.first) - 1 for part in parts)])[events.kind] + events.row
    data = np.zeros((before[-1], max((part.data.shape[1] for part in parts), default=0)))
    for part, b in zip(parts, before, strict=False):
        data[b : b + len(part.told), : part.data.shape[1]] = part.data
    noise = np.concatenate([np.zeros((0, 3)), *(part.noise for part in parts)])
    noise[:, 1] = np.minimum(noise[:, 1], gate)

    def spread(rows: list[Any], size: int) -> Array:
        return np.repeat(np.reshape(rows, (-1, size)).astype(float), counts, axis=0)

    kinds = np.repeat([sensors.index(part.sensor) for part in parts], counts).astype(np.int64)
    return Table(
        events.first, begins[rows], stops[rows], kinds, data,
        spread([part.arm for part in parts], 3), noise,
        spread([[s.start, s.stop - s.start] for s in own], 2),
        np.concatenate([np.zeros(0), *(part.told for part in parts)])[None],
    )  # fmt: skip


def _still(state: Any, events: int) -> Steps:
    """Return steps in which no time passes."""
    nothing = np.zeros((1, 0, 3 if state.errors > 5 else 2))
    return Steps(np.zeros(0), nothing, nothing, np.zeros(events, dtype=int), np.zeros(4))


def antenna(
    states: Sequence[Any], covariances: Array, lever_arm: Array, rate: Array | None = None
) -> tuple[Array, Array]:
    """Return horizontal position and velocity of an antenna, (k, 4), and covariances, (k, 4, 4).

    Parameters
    ----------
    states : sequence of InertialState or PlanarState
    covariances : ndarray, (k, n, n)
    lever_arm : ndarray, (3,) or (2,)
        m.
    rate : ndarray, (k, 3), optional
        What the gyroscopes say, rad/s; without it the velocity is that of the IMU.
    """
    errors = states[0].errors
    x = np.array([state.row for state in states])[:, : _NUMBERS[errors]]
    arm, nothing = np.append(lever_arm, 0.0)[:3], np.zeros(3)
    about = np.zeros((6, len(x)))
    if rate is not None:
        about[:3], about[3:] = np.cross(rate, arm).T, arm[:, None]
    axes = [*np.eye(4)[:2, :3]]
    data = [*(np.append(axis, -1.0) for axis in axes)]
    moved = [np.vstack([np.tile(axis[:, None], len(x)), about]) for axis in axes]
    found, H = expected(
        x, errors, errors, [position, position, velocity, velocity], [*data, *moved],
        np.array([arm, arm, nothing, nothing]), np.zeros((4, 2)),
    )  # fmt: skip
    return found, H @ covariances[:, :errors, :errors] @ np.swapaxes(H, 1, 2)


class _States(Sequence[Any]):
    """States that are made of their numbers when they are asked for."""

    def __init__(self, make: Any, rows: Array) -> None:
        self._make, self._rows = make, rows

    def __len__(self) -> int:
        return len(self._rows)

    def __getitem__(self, k: Any) -> Any:
        """Return one, or a list of some."""
        if isinstance(k, slice):
            return [self._make(row) for row in self._rows[k]]
        return self._make(self._rows[k])
