"""A method's estimates at the times of fixes, and how good they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array, Mask
from inswsn_lib.evaluation import block_ratio, colour, normalised_squares
from inswsn_lib.inertial import Solution
from inswsn_lib.inertial.error_state import antenna
from inswsn_lib.streams import Recording, Whole

#: A component so many deviations off is an outlier
OUTLIER = 4.0
#: Fewer fixes judge no estimate
FEWEST = 12
_HALF_WINDOW = 0.075  # s, of the line that makes a velocity of the reference; or longer, in rows
_HALF_ROWS, _FEWEST_ROWS = 2.5, 4
_PARTS = {"position": slice(0, 2), "velocity": slice(2, 4)}
#: The errors that `scores` returns
ERRORS = tuple(name + end for name in _PARTS for end in ("", "_ratio", "_low", "_high"))


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

    Outside of the solution it says nothing. Without the `rate` (times, 3) that gyroscopes say then,
    rad/s, the velocity is that of the IMU; the lever arm is in m.
    """
    state, P = np.full((len(times), 4), np.nan), np.full((len(times), 4, 4), np.nan)
    inside = np.flatnonzero((times >= solution.time[0]) & (times <= solution.time[-1]))
    if len(inside):
        at = solution.at(times[inside])
        states = [solution.states[j] for j in at]
        said = None if rate is None else rate[inside]
        state[inside], P[inside] = antenna(states, solution.covariances[at], lever_arm, said)
    return Estimate(state, P)


def scores(estimate: Estimate, truth: Array, others: Array) -> dict[str, float]:
    """Return the errors of an estimate, their ratios to those of another, and its consistency.

    What is true and the errors of the other, such as the network, are (n, 4 or 2) in the order of
    time, NaN where none is known. What fewer than twelve fixes tell is NaN.
    """
    errors, found = estimate.state - truth, dict.fromkeys((*ERRORS, "nees"), np.nan)
    for name, part in list(_PARTS.items())[: errors.shape[1] // 2]:
        squares, theirs = (np.square(each[:, part]).sum(axis=1) for each in (errors, others))
        there = np.isfinite(squares) & np.isfinite(theirs)
        if there.sum() >= FEWEST:
            told = np.sqrt(squares[there].mean()), *block_ratio(squares[there], theirs[there])
            names = [each for each in ERRORS if each.startswith(name)]
            found |= dict(zip(names, map(float, told), strict=True))
    P = estimate.covariance
    if P is not None:
        stated = errors[:, : P.shape[1]]
        there = np.isfinite(stated).all(axis=1)
        if there.any():
            found["nees"] = float(np.mean(normalised_squares(stated[there], P[there]))) / len(P[0])
    return found


def truth_at(recording: Recording, times: Array) -> Array:
    """Return horizontal position and velocity of the tag by the reference, (times, 4).

    Positions are interpolated, velocities are slopes of lines through the rows nearby; NaN is where
    the reference has too few of them.
    """
    time, track = tag_track(recording)
    found = np.full((len(times), 4), np.nan)
    if len(time) < _FEWEST_ROWS:
        return found
    half = max(_HALF_WINDOW, _HALF_ROWS * float(np.median(np.diff(time))))
    track = track[:, :2]
    for k, at in enumerate(times):
        near = slice(*np.searchsorted(time, [at - half, at + half]))
        enough = near.stop - near.start >= _FEWEST_ROWS
        if enough and time[near.start] <= at <= time[near.stop - 1]:
            found[k, :2] = [np.interp(at, time[near], x) for x in track[near].T]
            found[k, 2:] = np.polyfit(time[near] - at, track[near], 1)[0]
    return found


def tag_track(recording: Recording) -> tuple[Array, Array]:
    """Return the reference's times, s, and where the tag was, (rows, 2 or 3), m."""
    reference = recording.reference
    assert reference is not None
    arm = np.zeros_like(reference.position)
    if reference.attitude is not None:
        turned = Rotation.from_quat(reference.attitude).apply(recording.lever_arm)
        arm = turned[:, : arm.shape[1]]
    return reference.time, reference.position + arm


def largest_lag_one(
    solution: Solution, series: Sequence[tuple[Array, Whole]], begin: float
) -> dict[str, float]:
    """Return the mean NIS and the largest autocorrelation of neighbouring innovations.

    Of `series` as of `Rung`, from the time `begin` on, s.
    """
    told = innovations_of(solution, series)
    told = told[told["time"] > begin]
    every = [part["scaled"].to_numpy() for _, part in told.groupby("series")]
    nis = told.drop_duplicates("measurement")["squares"].mean()
    return {"nis": float(nis), "lag1": abs(colour(every).value) if every else np.nan}


def innovations_of(solution: Solution, series: Sequence[tuple[Array, Whole]]) -> pd.DataFrame:
    """Return the components of the innovations that a solution is judged by, `series` as of `Rung`.

    In the order of observations and time: ``time``, s; ``measurement``, which one each is of;
    ``scaled``, over the deviation that the filter expected; ``squares``, the NIS of the measurement
    over its number of components; ``series``, an axis or an anchor; ``near``, whether all
    components of the measurement lie within four deviations.
    """
    begin, end = solution.start.time, solution.end.time
    told, nothing = solution.innovations[: len(series)], np.zeros(0)
    sizes = np.array([len(value) for each in told for value in each.values], dtype=int)
    every = [value / sd for x in told for value, sd in zip(x.values, x.deviations, strict=True)]
    found = pd.DataFrame(
        {
            "time": np.repeat(np.concatenate([nothing, *(each.time for each in told)]), sizes),
            "measurement": np.repeat(np.arange(len(sizes)), sizes),
            "scaled": np.concatenate([nothing, *every]),
            "squares": np.repeat(np.concatenate([nothing, *(x.squares for x in told)]), sizes),
            "series": np.concatenate(
                [np.arange(0), *(name[(time > begin) & (time <= end)] for time, name in series)]
            ),
        }
    )
    far = found["scaled"].abs() > OUTLIER
    return found.assign(near=~far.groupby(found["measurement"]).transform("any"))
