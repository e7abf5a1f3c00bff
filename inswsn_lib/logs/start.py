"""Where a calibration begins: a clock by trial, and a frame in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.model import Model, Rows, State
from inswsn_lib.logs.range_fixes import multilaterate_track
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.logs.window_fits import PERIODS, enough_ranges
from inswsn_lib.streams import Fixes, Ranges

_STEP = 0.1  # s, of the clocks that are tried
_MOST = 500  # rows and fixes that a trial looks at
_SHARED = 0.25  # of them, that a clock must leave


def start_at(
    motion: ReferenceMotion, rows: Rows, fixes: Fixes | None, first: State, reach: float
) -> State:
    """Return a state near which the best one is, a clock and, where there are fixes, a frame.

    The best of a grid of clocks leaves the least median of the residuals, free of each anchor's
    median. With each, the frame is that which takes the track to fixes.
    """
    rows = rows.part(np.random.default_rng(0).permutation(len(rows.time)) < _MOST)
    if fixes is not None:
        there = np.flatnonzero(np.isfinite(fixes.position).all(axis=1))
        there = there[:: max(1, len(there) // _MOST)]
        fixes = Fixes(fixes.time[there], fixes.position[there])
    count, tried = round(reach / _STEP), []
    for clock in sorted((_STEP * np.arange(-count, count + 1)).tolist(), key=abs):
        state = replace(first, clock=first.clock + clock)
        covered = rows.part(motion.covers(rows.time - state.clock))
        placed = state if fixes is None else _in_frame(motion, fixes, state)
        if placed and len(covered.time) >= _SHARED * len(rows.time):
            miss = covered.level(Model(motion, covered, []).residual(placed))
            tried.append((float(np.median(np.abs(miss))), placed))
    if not tried and fixes is not None:
        raise InswsnError(
            f"The frame cannot be told: there are {len(fixes)} fixes, and too few of them are "
            "while the reference is there."
        )
    return min(tried, key=lambda each: each[0], default=(0.0, first))[1]


def fixes_of(ranges: Ranges) -> Fixes:
    """Return fixes of the shortest intervals of which most have one, or of the longest."""
    period = enough_ranges(ranges) if len(ranges) else None
    return multilaterate_track(ranges, period or PERIODS[-1])


def _in_frame(motion: ReferenceMotion, fixes: Fixes, state: State) -> State | None:
    """Return a state with the rotation and shift that take the track to fixes; None by too few.

    They leave the least squares (Umeyama 1991); the second time without what is far off.
    """
    used = motion.covers(fixes.time - state.clock)
    if used.sum() < max(motion.d + 1, _SHARED * len(fixes)):
        return None
    track = motion.carried(fixes.time[used] - state.clock, state.lever_arm) - motion.middle
    place = fixes.position[used] - motion.middle
    kept = np.ones(len(track), dtype=bool)
    for _ in range(2):
        middle, other = track[kept].mean(axis=0), place[kept].mean(axis=0)
        left, _, right = np.linalg.svd((place[kept] - other).T @ (track[kept] - middle))
        left[:, -1] *= np.linalg.det(left @ right)
        turn: Array = left @ right
        shift = other - turn @ middle
        off = np.linalg.norm(place - track @ turn.T - shift, axis=1)
        kept = off <= 3 * np.median(off) + 1e-12
    return replace(state, turn=turn, shift=shift)
