"""What each anchor's ranges have too much, told by ranges alone: they should meet in one point."""

from __future__ import annotations

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.recordings.blocks import FEWEST, block_starts, jackknife
from inswsn_lib.recordings.calibration import Calibration
from inswsn_lib.recordings.calibration_model import State
from inswsn_lib.recordings.recording import Ranges
from inswsn_lib.recordings.window_fits import (
    WindowFit,
    WindowRanges,
    by_window,
    fit_windows,
    squares,
    window_ranges,
    window_rows,
)

_PERIODS = (0.2, 0.5, 1.0, 2.0)  # s
_ENOUGH = 0.7  # of the intervals with a position
_ROUNDS, _NEAR = 30, 1e-4  # m
_LENGTH = 0.01  # m, the least limit
_NULL = 1e-6  # of the eigenvalues of the information


def bias_of_ranges(ranges: Ranges, block: float, limit: float | None) -> Calibration:
    """Return the bias by anchor with which the ranges of each interval meet in one point best.

    The positions of the intervals are unknowns, too; they are eliminated from the normal equations
    of each interval (Schur's complement), and the loss is soft-l1. What all anchors have too much
    is told by how ranges from all around cannot meet, and worse than differences.
    """
    period = _period(ranges)
    which, first = window_rows(ranges.time, period, period)
    count = len(ranges.anchors)
    bias = np.zeros(count)
    heard = np.unique(ranges.anchor)
    before = 0.0
    for trial in range(_ROUNDS):
        rows = window_ranges(ranges, which, first, bias, ranges.anchors.shape[1], None)
        fit = fit_windows(rows)
        before = before if trial else fit.noise
        A, g = _reduced(rows, fit, count, fit.weight)
        step = np.linalg.lstsq(
            A.sum(axis=0)[np.ix_(heard, heard)], g.sum(axis=0)[heard], rcond=1e-9
        )[0]
        bias[heard] += step
        if np.abs(step).max() < _NEAR:
            break
    A, g = _reduced(rows, fit, count, fit.weight**3)
    names = tuple(f"bias {ranges.names[k]}" for k in heard)
    covariance, blocks = _covariance(
        A[:, heard][:, :, heard], g[:, heard], ranges.time[which[first]][~fit.bad], block
    )
    limit = max(fit.noise, _LENGTH) if limit is None else limit
    _refuse(names, np.sqrt(np.diag(covariance)), limit)
    d = ranges.anchors.shape[1]
    state = State(0.0, 0.0, np.eye(d), np.zeros(d), np.zeros(3), bias, np.zeros(count))
    return Calibration(
        source="ranges",
        names=names,
        values=bias[heard],
        covariance=covariance,
        before=before,
        after=fit.noise,
        blocks=blocks,
        state=state,
        centre=np.zeros(d),
        middle=float(ranges.time.mean()),
    )


def _period(ranges: Ranges) -> float:
    """Return the shortest interval with enough ranges for a position and more; or refuse."""
    d = ranges.anchors.shape[1]
    for period in _PERIODS:
        which, first = window_rows(ranges.time, period, period)
        rows = window_ranges(ranges, which, first, np.zeros(len(ranges.anchors)), d, None)
        anchors = np.diff(np.append(rows.in_window, len(rows.groups)))
        if np.mean(anchors > d) >= _ENOUGH:
            return period
    raise InswsnError(
        f"The bias by anchor cannot be told without a reference: hardly an interval of "
        f"{_PERIODS[-1]:g} s has ranges to {d + 1} anchors, so none is redundant."
    )


def _reduced(rows: WindowRanges, fit: WindowFit, count: int, weight: Array) -> tuple[Array, Array]:
    """Return information (windows, N, N) and gradient of the biases, positions eliminated."""
    windows, d = len(rows.windows), rows.place.shape[1]
    place = np.repeat(np.arange(windows), np.diff(np.append(rows.windows, len(rows.anchor))))
    D, g = np.zeros((windows, count)), np.zeros((windows, count))
    C = np.zeros((windows, count, d))
    np.add.at(D, (place, rows.anchor), weight)
    np.add.at(g, (place, rows.anchor), fit.weight * fit.miss)
    np.add.at(C, (place, rows.anchor), weight[:, None] * fit.direction)
    H = by_window(rows, weight[:, None, None] * squares(fit.direction))
    pull = by_window(rows, (fit.weight * fit.miss)[:, None] * fit.direction)
    good = ~fit.bad
    D, g, C, H, pull = D[good], g[good], C[good], H[good], pull[good]
    through = C @ np.linalg.inv(H)
    A = D[:, :, None] * np.eye(count) - through @ np.swapaxes(C, 1, 2)
    return A, g - (through @ pull[:, :, None])[:, :, 0]


def _covariance(A: Array, g: Array, time: Array, block: float) -> tuple[Array, int]:
    starts = block_starts(time, block) if len(time) else np.zeros(0, dtype=np.intp)
    if len(starts) < FEWEST:
        raise InswsnError(
            f"The bias by anchor cannot be told: positions come from {len(starts)} blocks of time, "
            f"and {FEWEST} are the least."
        )
    information, gradient = (np.add.reduceat(x, starts, axis=0) for x in (A, g))
    covariance, lost = jackknife(information, gradient)
    values, vectors = np.linalg.eigh(information.sum(axis=0))
    gone = values < _NULL * values[-1]
    lost |= np.sum(vectors[:, gone] ** 2, axis=1) > 1e-3
    covariance[lost, lost] = np.inf
    return covariance, len(starts)


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
