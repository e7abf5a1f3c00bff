"""Whether the velocities of fixes are those with which their positions move."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.logs.findings import Finding
from inswsn_lib.logs.likeness import BLOCK
from inswsn_lib.logs.turn_rates import Felt, windows
from inswsn_lib.streams import Fixes, Recording

_FEWEST = 5  # blocks
_SLOWEST = 0.5  # m/s: what is slower tells little
_APART = 0.5  # of the speed, that is let pass


def check_velocities(recording: Recording) -> Iterator[Finding]:
    """Yield whether fixes move as their velocities say."""
    fixes = recording.fixes
    if fixes is None or fixes.velocity is None:
        return
    moved, told = _displacements(fixes)
    speed = np.linalg.norm(told, axis=1)
    fast = speed > _SLOWEST
    if fast.sum() < _FEWEST:
        says = "it moves too little to tell"
        yield Finding("itself", "fixes", np.nan, 0, _APART, None, says)
        return
    value = float(np.median(np.linalg.norm(moved - told, axis=1)[fast] / speed[fast]))
    fits = value <= _APART
    says = "positions move as velocities say" if fits else (
        f"by {value:.2g} of the speed positions do not move as velocities say: another unit, or "
        "axes exchanged or reversed, of one of them"
    )  # fmt: skip
    yield Finding("itself", "fixes", value, 0, _APART, fits, says)


def _displacements(fixes: Fixes) -> tuple[Array, Array]:
    """Return mean velocities of blocks, (blocks, 2): by positions, and by velocities."""
    assert fixes.velocity is not None
    state = np.hstack([fixes.position[:, :2], fixes.velocity[:, :2]])
    there = np.isfinite(state).all(axis=1)
    if fixes.good is not None:
        there &= fixes.good
    time, state = fixes.time[there], state[there]
    if len(time) < 2:
        return np.empty((0, 2)), np.empty((0, 2))
    middle, whole = windows(time, BLOCK)
    ends = [
        np.column_stack([np.interp(middle[whole] + side, time, x) for x in state[:, :2].T])
        for side in (-BLOCK / 2, BLOCK / 2)
    ]
    return (ends[1] - ends[0]) / BLOCK, Felt(time, state[:, 2:]).mean(middle[whole], BLOCK)
