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
_MOST = 500  # rows or fixes that a trial looks at


def start_at(
    motion: ReferenceMotion,
    rows: Rows,
    source: Ranges | Fixes,
    first: State,
    kinds: list[str],
    reach: float,
) -> State:
    """Return a state near which the best one is.

    Clocks of a grid are tried. With each the frame is that which takes the track to fixes with the
    least squares (Umeyama 1991, without scale); the best leaves the least median. Without a frame
    to find, the residuals themselves are judged, free of each anchor's median.
    """
    clocks: Array = np.zeros(1)
    if "clock" in kinds:
        count = round(reach / _STEP)
        clocks = np.asarray(_STEP * np.arange(-count, count + 1))
    if "turn" in kinds:
        fixes = source if isinstance(source, Fixes) else fixes_of(source)
        return _by_fixes(motion, fixes, first, clocks)
    if len(clocks) == 1:
        return first
    chosen = np.zeros(len(rows.time), dtype=bool)
    chosen[:: max(1, len(rows.time) // _MOST)] = True
    some = rows.part(chosen)
    tried = [
        (_misfit(motion, some, replace(first, clock=first.clock + c)), abs(c), c) for c in clocks
    ]
    return replace(first, clock=first.clock + min(tried)[2])


def fixes_of(ranges: Ranges) -> Fixes:
    """Return fixes of the shortest intervals of which most have one, or of the longest."""
    period = enough_ranges(ranges) if len(ranges) else None
    return multilaterate_track(ranges, period or PERIODS[-1])


def _misfit(motion: ReferenceMotion, rows: Rows, state: State) -> float:
    """Return the median absolute residual, each anchor's or axis's median taken off."""
    covered = rows.part(motion.covers(rows.time - state.clock))
    if len(covered.time) < len(rows.time) / 4:
        return np.inf
    miss = Model(motion, covered, []).residual(state)
    for k in np.unique(covered.which):
        mine = covered.which == k
        miss[mine] -= np.median(miss[mine])
    return float(np.median(np.abs(miss)))


def _by_fixes(motion: ReferenceMotion, fixes: Fixes, first: State, clocks: Array) -> State:
    there = np.flatnonzero(np.isfinite(fixes.position).all(axis=1))
    if len(clocks) > 1:
        there = there[:: max(1, len(there) // _MOST)]
    time, place = fixes.time[there], fixes.position[there]
    best: tuple[float, State] = (np.inf, first)
    for clock in clocks:
        at = time - first.clock - clock
        used = motion.covers(at)
        if used.sum() < max(motion.d + 1, len(time) / 4):
            continue
        track = motion.carried(at[used], first.lever_arm) - motion.middle
        turn, shift = aligned(track, place[used] - motion.middle)
        off = np.linalg.norm(place[used] - motion.middle - track @ turn.T - shift, axis=1)
        misfit = float(np.median(off))
        if misfit < best[0]:
            state = replace(first, clock=first.clock + float(clock), turn=turn, shift=shift)
            best = (misfit, state)
    if np.isinf(best[0]):
        raise InswsnError(
            f"The frame cannot be told: there are {len(time)} fixes, and too few of them are while "
            "the reference is there."
        )
    return best[1]


def aligned(track: Array, place: Array) -> tuple[Array, Array]:
    """Return rotation and shift that take a track to places with the least squares.

    In closed form (Umeyama 1991); what is far from the first solution is left out of the second.
    """
    kept = np.ones(len(track), dtype=bool)
    turn, shift = np.eye(track.shape[1]), np.zeros(track.shape[1])
    for _ in range(2):
        middle, other = track[kept].mean(axis=0), place[kept].mean(axis=0)
        left, _, right = np.linalg.svd((place[kept] - other).T @ (track[kept] - middle))
        proper = np.ones(len(middle))
        proper[-1] = np.copysign(1.0, np.linalg.det(left @ right))
        turn = left @ np.diag(proper) @ right
        shift = other - turn @ middle
        off = np.linalg.norm(place - track @ turn.T - shift, axis=1)
        kept = off <= 3 * np.median(off) + 1e-12
    return turn, shift
