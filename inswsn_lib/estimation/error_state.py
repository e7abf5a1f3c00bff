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
    covariance : ndarray, (errors, errors)
        Of its errors.
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
    start : Start
        With the observations' own states.
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
    events, first = np.unique(when[order], return_index=True)
    run = _Run(start, observations, len(events), gate, iterations, about)
    whole = Start(start.time, run.state, run.P)
    steps = motion.between(start.time, events)
    for k, at in enumerate(np.split(order, first[1:])):
        run.predict(k, steps, events[k] - (events[k - 1] if k else start.time))
        for i, j in zip(kind[at], row[at], strict=True):
            run.measure(int(i), int(j), events[k])
        run.keep(k)
    return run.solution(events, whole)


class _Run:
    """A filter on its way: a nominal state, and its error, which stays zero with feedback."""

    def __init__(
        self, start: Start, observations: Sequence[Observation], events: int, gate: float,
        iterations: int, about: Any,
    ) -> None:  # fmt: skip
        errors = start.state.errors
        P0 = covariance("covariance", start.covariance, (errors, errors))
        variances = np.concatenate([each.initial for each in observations])
        ends = np.cumsum([0, *(len(each.initial) for each in observations)])
        n, own = errors + len(variances), np.zeros(len(variances))
        first = replace(start.state, own=own)
        self.observations, self.gate, self.iterations = observations, gate, iterations
        self.own = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self.feedback = about is None
        self.nominal = first if about is None else replace(about, own=own)
        self.error: Array = first.minus(self.nominal)
        self.P: Array = block_diag(P0, np.diag(variances))
        self.states: list[Any] = []
        self.before: list[Any] = []
        self.filtered, self.priors, self.transitions = np.empty((3, events, n, n))
        self.found: list[list[tuple[float, Array, Array, Mask, float]]] = [[] for _ in observations]
        self.log_likelihood = 0.0

    @property
    def state(self) -> Any:
        return self.nominal if self.feedback else self.nominal.plus(self.error)

    def predict(self, k: int, steps: Any, dt: float) -> None:
        """Go to the next event."""
        ahead, Phi, Q = steps.ahead(k, self.nominal)
        moved = [each.transition(dt) for each in self.observations]
        factor, gained = (np.concatenate(parts) for parts in zip(*moved, strict=True))
        n, errors = len(self.P), len(Phi)
        whole = np.zeros((n, n))
        whole[:errors, :errors] = Phi
        whole.flat[errors * (n + 1) :: n + 1] = factor
        self.P = whole @ self.P @ whole.T
        self.P[:errors, :errors] += Q
        self.P.flat[errors * (n + 1) :: n + 1] += gained
        self.nominal = replace(ahead, own=factor * self.nominal.own)
        self.error = whole @ self.error
        self.before.append(self.state)
        self.priors[k], self.transitions[k] = self.P, whole

    def measure(self, i: int, j: int, time: float) -> None:
        """Take measurement j of observation i."""
        got, rows = self._expected(i, j, self.nominal)
        if got is None:
            return
        value = got.value - rows @ self.error
        S = rows @ self.P @ rows.T + got.noise
        variances = np.diag(S)
        used = value**2 <= self.gate * variances
        size = float(value @ np.linalg.solve(S, value))
        self.log_likelihood += self._log_likelihood(value, S, used, size)
        self.found[i].append((time, value, np.sqrt(variances), used, size / len(value)))
        if used.any():
            self._update(i, j, used, got, rows)

    def _log_likelihood(self, value: Array, S: Array, used: Mask, size: float) -> float:
        """Return that of an innovation; a component beyond the gate counts as one at the gate."""
        beyond = 0.0
        if not used.all():
            out = np.diag(S)[~used]
            beyond = float(np.sum(self.gate + np.log(2 * np.pi * out)))
            value, S = value[used], S[np.ix_(used, used)]
            size = float(value @ np.linalg.solve(S, value))
        return -0.5 * (size + float(np.linalg.slogdet(2 * np.pi * S)[1]) + beyond)

    def _update(self, i: int, j: int, used: Mask, got: Innovation, rows: Array) -> None:
        """Correct the state; in each iteration but the first all is linearised anew."""
        begin, nominal, correction = self.nominal, self.nominal, self.error
        for iteration in range(self.iterations if self.feedback else 1):
            if iteration:
                nominal = begin.plus(correction)
                got, rows = self._expected(i, j, nominal)
            H, R = rows[used], got.noise[np.ix_(used, used)]
            gain = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
            before = begin.minus(nominal) if iteration else self.error
            value = got.value[used] - H @ before
            correction = gain @ value if self.feedback else self.error + gain @ value
        left = np.eye(len(self.P)) - gain @ H
        P = left @ self.P @ left.T + gain @ R @ gain.T
        self.P = 0.5 * (P + P.T)
        if self.feedback:
            self.nominal = begin.plus(correction)
        else:
            self.error = correction

    def _expected(self, i: int, j: int, state: Any) -> tuple[Any, Array]:
        got = self.observations[i].innovation(j, state, state.own[self.own[i]])
        if got is None:
            return None, np.empty(0)
        rows = np.zeros((len(got.value), len(self.P)))
        rows[:, : state.errors] = got.rows
        own = self.own[i]
        rows[:, state.errors + own.start : state.errors + own.stop] = got.own
        return got, rows

    def keep(self, k: int) -> None:
        self.states.append(self.state)
        self.filtered[k] = self.P

    def solution(self, events: Array, start: Start) -> Solution:
        innovations = []
        for each in self.found:
            columns = list(zip(*each, strict=True)) or [()] * 5
            time, values, deviations, used, squares = columns
            innovations.append(
                Innovations(
                    np.array(time), list(values), list(deviations), list(used), np.array(squares)
                )
            )
        return Solution(
            events, self.states, self.filtered, self.before, self.priors, self.transitions,
            innovations, self.log_likelihood, start,
        )  # fmt: skip
