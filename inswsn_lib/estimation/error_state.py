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
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.linalg import block_diag

from inswsn_lib.checks import Array, Mask, covariance
from inswsn_lib.errors import InswsnError
from inswsn_lib.kernels import choose
from inswsn_lib.streams import Whole


class Innovation(NamedTuple):
    """A measurement less what was expected of it.

    Attributes
    ----------
    value : ndarray, (m,)
    rows : ndarray, (m, errors)
        Derivatives of what is expected by the errors of the motion.
    own : ndarray, (m, states)
        The same by the observation's own states.
    noise : ndarray, (m, m)
        Covariance of the measurement.
    """

    value: Array
    rows: Array
    own: Array
    noise: Array


class Components(NamedTuple):
    """Measurements as a table of their components, which the compiled filter reads.

    Of a component u are expected, by `kind`: 0 the antenna's place along an axis; 1 its distance
    from an anchor; 2 the velocity along an axis; 3 the same along an axis of the body.
    """

    first: Whole  # (measurements + 1,), of the components of each
    kind: int
    vector: Array  # (components, d), the axis, or the anchor's place
    arm: Array  # (d,), the lever arm
    told: Array  # (components,)
    variance: Array  # (components,)
    own: Whole  # (components, 3), own states, or -1: the scale, and two that are added


class Observation(Protocol):
    """Measurements of one kind, and the states that they need for themselves."""

    @property
    def time(self) -> Array:
        """When there is one, s, increasing."""

    @property
    def initial(self) -> Array:
        """Variances of its own states at the start, (states,)."""

    def transition(self, dt: float) -> tuple[Array, Array]:
        """Return by what its own states are multiplied, and the variance they gain, in a time."""

    def innovation(self, k: int, state: Any, own: Array) -> Innovation | None:
        """Return the innovation of its measurement k, or None if nothing was measured."""


@dataclass(frozen=True, eq=False)
class Start:
    """Where a filter starts.

    Attributes
    ----------
    time : float
        s.
    state : InertialState or PlanarState
    covariance : ndarray, (errors, errors) or (n, n)
        Of its errors, or of these and of the observations' own states.
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
    states : list of InertialState or PlanarState
    covariances : ndarray, (events, n, n)
        Of the errors of the motion and of the observations' own states.
    before : list of InertialState or PlanarState
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
    states: list[Any]
    covariances: Array
    before: list[Any]
    priors: Array
    transitions: Array
    innovations: list[Innovations]
    log_likelihood: float
    start: Start
    end: Start

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
    iterations: int = 1,
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
    iterations : int
        How often a measurement is linearised anew about the state that it leads to: above 1 the
        update is that of the iterated filter (Bell and Cathey, IEEE Trans. AC 38(2), 1993).
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
    >>> from inswsn_lib import estimation as est
    >>> from inswsn_lib.streams import Fixes, Odometry
    >>> t = np.arange(0, 20.1, 0.1)
    >>> wheels = Odometry(t, speed=np.full(201, 1.0), rate=np.zeros(201))
    >>> motion = est.OdometryMotion(wheels, est.OdometryNoise(0.01, 0.001, 1e-4, 1e-5))
    >>> start = est.Start(0.0, est.PlanarState(np.zeros(2), 0.0), np.eye(5) / 25)
    >>> fixes = Fixes(t[10::10], np.outer(1.1 * t[10::10], [1.0, 0.0]))
    >>> observed = [est.PositionFixes(fixes, np.zeros(2), white=np.full(2, 0.1))]
    >>> solution = est.run_error_state(motion, start, observed)
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
    run = ErrorStateFilter(start, observations, gate, iterations, about)
    whole = Start(start.time, run.state, run.covariance)
    found = run._go(motion.between(start.time, times), events, observations, kept=kept)
    make = type(start.state).of_row
    return Solution(
        times if kept else times[:0], [make(x) for x in found.states], found.filtered,
        [make(x) for x in found.before], found.priors, found.transitions,
        [found.innovations(events, i, kept=kept) for i in range(len(observations))],
        run.log_likelihood, whole, Start(run.time, run.state, run.covariance),
    )  # fmt: skip


class _Events(NamedTuple):
    """When there are measurements, and which: a row of an observation each."""

    time: Array  # (events,)
    first: Whole  # (events + 1,), of the measurements of each
    kind: Whole  # (measurements,), the observation
    row: Whole  # (measurements,)


class _Found(NamedTuple):
    """What a run over events leaves; the first five are empty unless they are to be kept."""

    states: Array  # (events, numbers)
    before: Array
    filtered: Array  # (events, n, n)
    priors: Array
    transitions: Array
    sizes: Whole  # (measurements,), how many components there were
    values: Array  # (components,), of all measurements
    deviations: Array
    used: Mask
    squares: Array  # (measurements,)
    likelihood: float
    state: Array  # (numbers,), at the end
    covariance: Array
    error: Array

    def innovations(self, events: _Events, i: int, *, kept: bool) -> Innovations:
        """Return those of an observation."""
        there = self.sizes > 0
        mine = there & (events.kind == i)
        time = np.repeat(events.time, np.diff(events.first))[mine]
        if not kept:
            return Innovations(time, [], [], [], self.squares[mine])
        ends = np.cumsum(self.sizes)
        parts = [slice(a, b) for a, b in zip((ends - self.sizes)[mine], ends[mine], strict=True)]
        values, deviations = ([of[p] for p in parts] for of in (self.values, self.deviations))
        used = [self.used[p] for p in parts]
        return Innovations(time, values, deviations, used, self.squares[mine])


class ErrorStateFilter:
    """An error-state filter on its way, for data that come one after the other.

    `run_error_state` runs one over data that are all there.

    Parameters
    ----------
    start : Start
    observations : sequence of Observation
        Those that will come, for their own states.
    gate, iterations, about
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
    >>> from inswsn_lib import estimation as est
    >>> from inswsn_lib.streams import Fixes, Odometry
    >>> wheels = Odometry(np.array([0.0, 1.0]), speed=np.ones(2), rate=np.zeros(2))
    >>> motion = est.OdometryMotion(wheels, est.OdometryNoise(0.1, 0.01, 1e-4, 1e-5))
    >>> fix = Fixes(np.ones(1), np.array([[1.2, 0.0]]))
    >>> seen = est.PositionFixes(fix, np.zeros(2), white=np.full(2, 0.1))
    >>> start = est.Start(0.0, est.PlanarState(np.zeros(2), 0.0), np.eye(5) / 1e6)
    >>> running = est.ErrorStateFilter(start, [seen])
    >>> running.predict(motion, 1.0)
    >>> running.measure(0, seen)
    >>> running.state.position.round(2).tolist()
    [1.1, 0.0]
    """

    def __init__(
        self, start: Start, observations: Sequence[Observation], gate: float = np.inf,
        iterations: int = 1, about: Any = None,
    ) -> None:  # fmt: skip
        errors = start.state.errors
        variances = np.concatenate([each.initial for each in observations])
        whole = len(start.covariance) > errors
        n = errors + len(variances) * whole
        P0 = covariance("covariance", start.covariance, (n, n))
        ends = np.cumsum([0, *(len(each.initial) for each in observations)])
        own = np.zeros(len(variances))
        first = replace(start.state, own=own)
        self.observations, self.gate, self.iterations = observations, gate, iterations
        self._own = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self._feedback = about is None
        self._nominal = first if about is None else replace(about, own=own)
        self._error: Array = first.minus(self._nominal)
        self.time = start.time
        self.covariance: Array = P0 if whole else block_diag(P0, np.diag(variances))
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
        self, steps: Any, events: _Events, observations: Sequence[Any], *, kept: bool = False
    ) -> _Found:
        """Take events; without steps no time passes."""

        def by_hand(*_: Any) -> tuple[Any, ...]:
            return self._by_hand(steps, events, observations, kept)

        # an iterated filter has no table, nor have observations of a kind of its user's
        table = self._table(steps, events, observations)
        run = by_hand if table is None else choose("error_state", by_hand)
        found = _Found(*run(*(table or ()), kept))
        self._nominal = type(self._nominal).of_row(found.state)
        self.time, self.covariance, self._error = float(events.time[-1]), *found[-2:]
        self.log_likelihood += found.likelihood
        return found

    def _table(
        self, steps: Any, events: _Events, observations: Sequence[Any]
    ) -> tuple[Any, ...] | None:
        """Return what the compiled filter takes, or None."""
        parts: list[Any] = [getattr(each, "components", None) for each in observations]
        d = len(self._nominal.position)
        iterated = self._feedback and self.iterations > 1
        if iterated or any(part is None or len(part.arm) != d for part in parts):
            return None
        # places of components, and of measurements, among those of all observations
        before = np.cumsum([0, *(len(part.told) for part in parts)])
        begins, stops = (
            np.concatenate([p.first[s] + b for p, b in zip(parts, before, strict=False)])
            for s in (slice(-1), slice(1, None))
        )
        rows = np.cumsum([0, *(len(part.first) - 1 for part in parts)])[events.kind] + events.row
        counts = np.diff(before)
        vectors = np.concatenate([part.vector for part in parts])
        arms = np.repeat([part.arm for part in parts], counts, axis=0)
        own = np.concatenate([
            np.where(part.own < 0, -1, part.own + own.start)
            for part, own in zip(parts, self._own, strict=True)
        ])  # fmt: skip
        factors, gained = self._coloured(steps, events.time, observations)
        nothing = np.zeros(1, dtype=int)
        motion = (
            (np.zeros((0, 7 if d > 2 else 3)), nothing, np.zeros(4))
            if steps is None
            else (np.ascontiguousarray(steps.pieces), steps.ends, steps.densities)
        )
        return (
            *motion, self._nominal.row, self.covariance, self._error, factors, gained,
            events.first, begins[rows], stops[rows],
            np.repeat([part.kind for part in parts], counts), _wide(vectors), _wide(arms),
            np.concatenate([part.told for part in parts]),
            np.concatenate([part.variance for part in parts]), own,
            float(self.gate), self._feedback,
        )  # fmt: skip

    def _coloured(
        self, steps: Any, times: Array, observations: Sequence[Any]
    ) -> tuple[Array, Array]:
        """Return factors and gained variances of all own states, (events, states)."""
        shape = len(times), len(self.covariance) - self._nominal.errors
        if steps is None:
            return np.ones(shape), np.zeros(shape)
        passed = np.diff(times, prepend=self.time)[:, None]
        moved = [each.transition(passed) for each in observations]
        wide = [
            [np.broadcast_to(part, (len(times), len(each.initial))) for part in two]
            for two, each in zip(moved, observations, strict=True)
        ]
        factors, gained = (np.concatenate(parts, axis=1) for parts in zip(*wide, strict=True))
        return factors, gained

    def _by_hand(
        self, steps: Any, events: _Events, observations: Sequence[Any], kept: bool
    ) -> tuple[Any, ...]:
        """Return what `_Found` holds, by numpy, an event at a time."""
        states, before, filtered, priors, transitions = ([] for _ in range(5))
        taken: list[tuple[Array, Array, Mask, float] | None] = []
        begin = self.log_likelihood
        for k, time in enumerate(events.time.tolist()):
            if steps is not None:
                transition = self._ahead(steps, k, time)
            if kept:
                before.append(self.state.row)
                priors.append(self.covariance)
                transitions.append(transition)
            for j in range(events.first[k], events.first[k + 1]):
                i = events.kind[j]
                taken.append(self._measure(i, observations[i], int(events.row[j])))
            if kept:
                states.append(self.state.row)
                filtered.append(self.covariance)
        n, numbers = len(self.covariance), len(self._nominal.row)
        there = [each for each in taken if each is not None]
        values, deviations, used = (
            (
                np.concatenate([np.zeros(0), *column])
                for column in list(zip(*there, strict=True))[:3]
            )
            if there
            else np.zeros((3, 0))
        )
        likelihood, self.log_likelihood = self.log_likelihood - begin, begin
        return (
            np.reshape(states, (-1, numbers)), np.reshape(before, (-1, numbers)),
            *(np.reshape(each, (-1, n, n)) for each in (filtered, priors, transitions)),
            np.array([0 if each is None else len(each[0]) for each in taken], dtype=int),
            values, deviations, used.astype(bool),
            np.array([np.nan if each is None else each[3] for each in taken]),
            likelihood, self._nominal.row, self.covariance, self._error,
        )  # fmt: skip

    def _ahead(self, steps: Any, k: int, time: float) -> Array:
        """Go to the end of step k, and return the transition."""
        ahead, Phi, Q = steps.ahead(k, self._nominal)
        moved = [each.transition(time - self.time) for each in self.observations]
        factor, gained = (np.concatenate(parts) for parts in zip(*moved, strict=True))
        n, errors = len(self.covariance), len(Phi)
        whole = np.zeros((n, n))
        whole[:errors, :errors] = Phi
        whole.flat[errors * (n + 1) :: n + 1] = factor
        P = whole @ self.covariance @ whole.T
        P[:errors, :errors] += Q
        P.flat[errors * (n + 1) :: n + 1] += gained
        self._nominal = replace(ahead, own=factor * self._nominal.own)
        self._error = whole @ self._error
        self.time, self.covariance = time, P
        return whole

    def _measure(
        self, i: int, observation: Observation, k: int
    ) -> tuple[Array, Array, Mask, float] | None:
        """Take a measurement; return its innovation, deviations, what is used, and NIS."""
        got, rows = self._expected(i, observation, k, self._nominal)
        if got is None:
            return None
        value = got.value - rows @ self._error
        S = rows @ self.covariance @ rows.T + got.noise
        variances = np.diag(S)
        used = value**2 <= self.gate * variances
        size = float(value @ np.linalg.solve(S, value))
        self.log_likelihood += self._log_likelihood(value, S, used, size)
        if used.any():
            self._update(i, observation, k, used, got, rows)
        return value, np.sqrt(variances), used, size / len(value)

    def _log_likelihood(self, value: Array, S: Array, used: Mask, size: float) -> float:
        """Return that of an innovation; a component beyond the gate counts as one at the gate."""
        beyond = 0.0
        if not used.all():
            out = np.diag(S)[~used]
            beyond = float(np.sum(self.gate + np.log(2 * np.pi * out)))
            value, S = value[used], S[np.ix_(used, used)]
            size = float(value @ np.linalg.solve(S, value))
        return -0.5 * (size + float(np.linalg.slogdet(2 * np.pi * S)[1]) + beyond)

    def _update(
        self, i: int, observation: Observation, k: int, used: Mask, got: Innovation, rows: Array
    ) -> None:
        """Correct the state; in each iteration but the first all is linearised anew."""
        P, begin, nominal, correction = self.covariance, self._nominal, self._nominal, self._error
        for iteration in range(self.iterations if self._feedback else 1):
            if iteration:
                nominal = begin.plus(correction)
                got, rows = self._expected(i, observation, k, nominal)
            H, R = (rows, got.noise) if used.all() else (rows[used], got.noise[np.ix_(used, used)])
            gain = np.linalg.solve(H @ P @ H.T + R, H @ P).T
            before = begin.minus(nominal) if iteration else self._error
            value = got.value[used] - H @ before
            correction = gain @ value if self._feedback else self._error + gain @ value
        left = np.eye(len(P)) - gain @ H
        P = left @ P @ left.T + gain @ R @ gain.T
        self.covariance = 0.5 * (P + P.T)
        if self._feedback:
            self._nominal = begin.plus(correction)
        else:
            self._error = correction

    def _expected(self, i: int, observation: Observation, k: int, state: Any) -> tuple[Any, Array]:
        own = self._own[i]
        got = observation.innovation(k, state, state.own[own])
        if got is None:
            return None, np.empty(0)
        rows = np.zeros((len(got.value), len(self.covariance)))
        rows[:, : state.errors] = got.rows
        rows[:, state.errors + own.start : state.errors + own.stop] = got.own
        return got, rows


def _wide(vectors: Array) -> Array:
    """Return vectors (rows, 2 or 3) with three coordinates, of which the third may be zero."""
    wide = np.zeros((len(vectors), 3))
    wide[:, : vectors.shape[1]] = vectors
    return wide
