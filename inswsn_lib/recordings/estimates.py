"""A method's estimates at the times of fixes, and how good they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array, Mask
from inswsn_lib.evaluation import autocorrelation, block_ratio
from inswsn_lib.inertial import Solution
from inswsn_lib.inertial.error_state import antenna
from inswsn_lib.streams import Recording, Whole

#: Blocks of the bootstrap, s
BLOCK = 10.0
_HALF_WINDOW = 0.075  # s, of the line that makes a velocity of the reference; or longer, in rows
_HALF_ROWS = 2.5
_FEWEST = 4  # rows of it
_INTERVAL = ("ratio", "low", "high")
_PARTS = {"position": slice(0, 2), "velocity": slice(2, 4)}


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a method says.

    Attributes
    ----------
    state : ndarray, (fixes, 4 or 2)
        Horizontal position (m) and velocity (m/s), if it has one; NaN where it says nothing.
    covariance : ndarray, (fixes, 4, 4) or (fixes, 2, 2), or None
        Of them, if it says so.
    """

    state: Array
    covariance: Array | None = None

    def part(self, rows: Mask) -> Estimate:
        """Return what it says at some fixes."""
        P = self.covariance
        return Estimate(self.state[rows], None if P is None else P[rows])

    def places(self) -> Estimate:
        """Return what it says of positions alone."""
        P = self.covariance
        return Estimate(self.state[:, :2], None if P is None else P[:, :2, :2])


def of_solution(
    solution: Solution, lever_arm: Array, times: Array, rate: Array | None = None
) -> Estimate:
    """Return what a solution says of the tag at some times, which must be times of its events.

    Before the first event it says nothing.

    Parameters
    ----------
    solution : Solution
    lever_arm : ndarray, (3,)
        m.
    times : ndarray, (fixes,)
        s.
    rate : ndarray, (fixes, 3), optional
        What the gyroscopes say then, rad/s; without it the velocity is that of the IMU.
    """
    state, P = np.full((len(times), 4), np.nan), np.full((len(times), 4, 4), np.nan)
    inside = np.flatnonzero((times >= solution.time[0]) & (times <= solution.time[-1]))
    if len(inside):
        at = solution.at(times[inside])
        states = [solution.states[j] for j in at]
        said = None if rate is None else rate[inside]
        state[inside], P[inside] = antenna(states, solution.covariances[at], lever_arm, said)
    return Estimate(state, P)


def scores(estimate: Estimate, truth: Array, others: Array, period: float) -> dict[str, float]:
    """Return the errors of an estimate, their ratios to those of another, and its consistency.

    Parameters
    ----------
    estimate : Estimate
        Of n fixes in the order of time.
    truth, others : ndarray, (n, 4 or 2)
        What is true, and the errors of the other, such as the network.
    period : float
        Of fixes, s.
    """
    errors = estimate.state - truth
    found: dict[str, float] = {}
    for name, part in list(_PARTS.items())[: errors.shape[1] // 2]:
        squares = np.square(errors[:, part]).sum(axis=1)
        if not np.isfinite(squares).all():
            found |= dict.fromkeys([name, *(f"{name}_{end}" for end in _INTERVAL)], np.nan)
            continue
        found[name] = float(np.sqrt(squares.mean()))
        theirs = np.square(others[:, part]).sum(axis=1)
        ratio, low, high = block_ratio(squares, theirs, _rows(period, len(truth)))
        found |= {f"{name}_ratio": ratio, f"{name}_low": low, f"{name}_high": high}
    found["nees"] = np.nan
    if estimate.covariance is not None:
        found["nees"] = float(np.mean(normalised(errors, estimate.covariance)))
    return found | {"nis": np.nan, "lag1": np.nan}


def normalised(errors: Array, covariance: Array) -> Array:
    """Return normalised squares over the number of components, (n,).

    Parameters
    ----------
    errors : ndarray, (n, d)
    covariance : ndarray, (n, d, d)
    """
    solved = np.linalg.solve(covariance, errors[..., None])[..., 0]
    return np.asarray(np.sum(errors * solved, axis=1) / errors.shape[1])


def unlikely(run: Callable[..., Solution], end: float) -> Callable[..., float]:
    """Return the loss of a filter: the geometric mean of how unlikely its innovations were.

    Parameters
    ----------
    run : callable
        Takes the filter's numbers, the time at which the data end, s, and what is kept.
    end : float
        That time.
    """

    def loss(*numbers: float) -> float:
        solution = run(*numbers, end=end, kept=False)
        count = sum(len(each.squares) for each in solution.innovations)
        return float(np.exp(-solution.log_likelihood / count))

    return loss


def truth_at(recording: Recording, times: Array) -> Array:
    """Return horizontal position and velocity of the tag by the reference, (times, 4).

    Parameters
    ----------
    recording : Recording
        With a reference.
    times : ndarray, (times,)
        s; NaN is returned where the reference has no rows nearby.
    """
    time, track = tag_track(recording)
    if len(time) < _FEWEST:
        return np.full((len(times), 4), np.nan)
    half = max(_HALF_WINDOW, _HALF_ROWS * float(np.median(np.diff(time))))
    return line_through(time, track[:, :2], times, half)


def tag_track(recording: Recording) -> tuple[Array, Array]:
    """Return the reference's times, and where the tag was, (rows, 2 or 3), m.

    Parameters
    ----------
    recording : Recording
        With a reference.
    """
    reference = recording.reference
    assert reference is not None
    arm = np.zeros_like(reference.position)
    if reference.attitude is not None:
        turned = Rotation.from_quat(reference.attitude).apply(recording.lever_arm)
        arm = turned[:, : arm.shape[1]]
    return reference.time, reference.position + arm


def lag_one(solution: Solution, labels: Whole, begin: float) -> dict[str, float]:
    """Return the mean NIS and the largest autocorrelation of neighbouring innovations.

    Parameters
    ----------
    solution : Solution
        Its first observation is asked.
    labels : ndarray of int, (components,)
        Of which series each component of its innovations is, one after the other.
    begin : float
        From when, s.
    """
    told = solution.innovations[0]
    values = np.concatenate(told.values) / np.concatenate(told.deviations)
    times = np.repeat(told.time, [len(value) for value in told.values])
    largest = 0.0
    for label in np.unique(labels):
        series = values[(labels == label) & (times > begin)]
        largest = max(largest, abs(float(autocorrelation(series, [1])[0])))
    return {"nis": float(told.squares[told.time > begin].mean()), "lag1": largest}


def line_through(time: Array, track: Array, at: Array, half: float) -> Array:
    """Return position and velocity of a track at some times, (times, 4).

    Positions are interpolated, velocities are slopes of lines through the rows nearby.

    Parameters
    ----------
    time : ndarray, (rows,)
        s.
    track : ndarray, (rows, 2)
        m.
    at : ndarray, (times,)
        s; NaN is returned where there is no row nearby.
    half : float
        How far away rows may be, s.
    """
    found = np.full((len(at), 4), np.nan)
    for k, moment in enumerate(at):
        near = slice(*np.searchsorted(time, [moment - half, moment + half]))
        if near.stop - near.start >= _FEWEST and time[near.start] <= moment <= time[near.stop - 1]:
            found[k, :2] = [np.interp(moment, time[near], x) for x in track[near].T]
            found[k, 2:] = np.polyfit(time[near] - moment, track[near], 1)[0]
    return found


def _rows(period: float, count: int) -> int:
    """Return how many fixes a block of the bootstrap has."""
    return min(max(round(BLOCK / period), 1), count // 3)
