"""The bias of each anchor's ranges, from ranges alone: they should meet in one point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import FEWEST, block_starts, jackknife
from inswsn_lib.logs.model import State
from inswsn_lib.logs.results import Calibration
from inswsn_lib.logs.window_fits import (
    PERIODS,
    WindowFit,
    WindowRanges,
    by_window,
    each_row,
    enough_ranges,
    fit_windows,
    mean_times,
    window_ranges,
)
from inswsn_lib.simulation.position_search import squares
from inswsn_lib.streams import Ranges

_ROUNDS, _NEAR = 30, 1e-4  # m
_LENGTH = 0.01  # m, the least limit
_NULL = 1e-6  # of the eigenvalues of the information


def bias_of_ranges(ranges: Ranges, block: float, limit: float | None) -> Calibration:
    """Return the bias by anchor with which the ranges of each interval meet in one point best.

    The positions of the intervals are unknowns, too; they are eliminated from the normal equations
    of each interval (Schur's complement), and the loss is soft-l1. Within an interval the tag moves
    with the velocity between the intervals before and after. What all anchors have too much is
    told by how ranges from all around cannot meet.
    """
    period, d = enough_ranges(ranges), ranges.anchors.shape[1]
    if period is None:
        raise InswsnError(
            f"The bias by anchor cannot be told without a reference: hardly an interval of "
            f"{PERIODS[-1]:g} s has ranges to {d + 1} anchors, so none is redundant."
        )
    heard = np.unique(ranges.anchor)
    problem = _Meeting(window_ranges(ranges, period), heard, len(ranges.anchors))
    bias = np.zeros(len(ranges.anchors))
    fit = fit_windows(problem.rows(bias))
    before = fit.noise
    for _ in range(_ROUNDS):
        fit = problem.settled(bias, fit)
        A, g = problem.equations(fit, fit.weight)
        step = np.linalg.lstsq(A.sum(axis=0), g.sum(axis=0), rcond=1e-9)[0]
        bias[heard] += step
        if np.abs(step).max() < _NEAR:
            break
    names = tuple(f"bias {ranges.names[k]}" for k in heard)
    covariance, blocks = problem.covariance(fit, block)
    limit = max(fit.noise, _LENGTH) if limit is None else limit
    _refuse(names, np.sqrt(np.diag(covariance)), limit)
    still = State(0.0, 0.0, np.eye(d), np.zeros(d), np.zeros(3), bias, np.zeros_like(bias))
    return Calibration(
        source="ranges",
        names=names,
        values=bias[heard],
        covariance=covariance,
        before=before,
        after=fit.noise,
        blocks=blocks,
        state=still,
        centre=np.zeros(d),
        middle=float(ranges.time.mean()),
    )


@dataclass(frozen=True, eq=False)
class _Meeting:
    """Intervals of ranges that should meet in points, but for a bias of each anchor."""

    ranges: WindowRanges
    heard: NDArray[np.intp]
    count: int  # of anchors

    def rows(self, bias: Array) -> WindowRanges:
        """Return the ranges of the intervals, free of a bias."""
        distance = self.ranges.distance - bias[self.ranges.anchor]
        return self.ranges._replace(distance=distance)

    def settled(self, bias: Array, fit: WindowFit) -> WindowFit:
        """Return the positions with a bias, and with the motion that they tell."""
        rows = self.rows(bias)
        return fit_windows(rows._replace(place=rows.place - _moved(rows, fit)), near=fit)

    def equations(self, fit: WindowFit, bend: Array) -> tuple[Array, Array]:
        """Return information (windows, h, h) and gradients (windows, h) of the biases.

        The positions are eliminated; an interval that tells none has no part. A range has the
        second derivative `bend` of half its loss by its length.
        """
        rows, push = self.ranges, fit.weight * fit.miss
        windows, count = len(rows.windows), self.count
        place = np.repeat(np.arange(windows), np.diff(np.append(rows.windows, len(rows.anchor))))
        own, g = np.zeros((windows, count)), np.zeros((windows, count))
        C = np.zeros((windows, count, rows.place.shape[1]))
        np.add.at(own, (place, rows.anchor), bend)
        np.add.at(g, (place, rows.anchor), push)
        np.add.at(C, (place, rows.anchor), bend[:, None] * fit.direction)
        H = by_window(rows, bend[:, None, None] * squares(fit.direction))
        pull = by_window(rows, push[:, None] * fit.direction)
        H[fit.bad], C[fit.bad], own[fit.bad], g[fit.bad] = np.eye(H.shape[1]), 0.0, 0.0, 0.0
        through = C @ np.linalg.inv(H)
        A = own[:, :, None] * np.eye(count) - through @ np.swapaxes(C, 1, 2)
        g -= (through @ pull[:, :, None])[:, :, 0]
        return A[:, self.heard][:, :, self.heard], g[:, self.heard]

    def covariance(self, fit: WindowFit, block: float) -> tuple[Array, int]:
        """Return the covariance of the biases by blocks of time, and how many blocks there are."""
        first = np.minimum.reduceat(self.ranges.time, self.ranges.windows)
        starts = block_starts(first, block)
        if len(starts) < FEWEST:
            raise InswsnError(
                f"The bias by anchor cannot be told: positions come from {len(starts)} blocks of "
                f"time, and {FEWEST} are needed."
            )
        equations = self.equations(fit, fit.weight**3)
        information, gradient = (np.add.reduceat(x, starts, axis=0) for x in equations)
        found, lost = jackknife(information, gradient)
        values, vectors = np.linalg.eigh(information.sum(axis=0))
        lost |= np.sum(vectors[:, values < _NULL * values[-1]] ** 2, axis=1) > 1e-3
        found[lost, lost] = np.inf
        return found, len(starts)


def _moved(rows: WindowRanges, fit: WindowFit) -> Array:
    """Return how far the tag is, at each range, from where it is at the mean of its interval.

    A range from a place that moves is one from the mean place to an anchor that moves the other
    way. The velocity is that between the intervals before and after, where both have a position.
    """
    time = mean_times(rows)
    velocity = np.zeros_like(fit.position)
    if len(time) > 2:
        lasted = (time[2:] - time[:-2])[:, None]
        near = (lasted[:, 0] <= 3 * np.median(lasted)) & ~fit.bad[2:] & ~fit.bad[:-2]
        velocity[1:-1] = np.where(near[:, None], (fit.position[2:] - fit.position[:-2]) / lasted, 0)
    after = rows.time - each_row(rows, time)
    return np.asarray(each_row(rows, velocity) * after[:, None])


def _refuse(names: tuple[str, ...], deviations: Array, limit: float) -> None:
    wrong = ~(deviations <= limit)
    if wrong.any():
        worst = float(np.max(np.where(np.isfinite(deviations), deviations, np.inf)[wrong]))
        many = f"its deviation would be {worst:.2g} m, above {limit:.2g} m"
        why = many if np.isfinite(worst) else "other values of all of them fit as well"
        raise InswsnError(
            f"The ranges alone cannot tell {', '.join(np.array(names)[wrong])} ({why}): the tag "
            "hears too few anchors, or too seldom, or hardly moves among them."
        )
