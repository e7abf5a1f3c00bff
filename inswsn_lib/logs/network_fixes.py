"""The network's positions: of ranges, on a side of anchors in a plane, or with a height held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.findings import Finding
from inswsn_lib.logs.range_fixes import multilaterate_track, slope_velocity
from inswsn_lib.logs.window_fits import PERIODS, in_a_plane
from inswsn_lib.streams import Fixes, Ranges, Recording

#: The deviation of a height that is held, m
HELD = 1.0
#: What the errors of fixes upwards are taken for, times those to the side
UP = np.array([1.0, 1.0, 2.0])
_MOST_FIXES = 0.5  # of the intervals, that must have one
_VERTICAL = 0.9  # the cosine of a normal, of a plane such as a ceiling
_OF_SECOND_DIFFERENCES = 1.4826 / np.sqrt(6)  # from their median size to a deviation
_LEAST, _LEAST_SHARE = 1e-3, 0.1  # m, of a deviation, and of one over the median


def network_of(recording: Recording, periods: Sequence[float] = PERIODS) -> Fixes:
    """Return what the network alone says: fixes as they are, or of ranges, with velocities.

    Parameters
    ----------
    recording : Recording
    periods : sequence of float
        Of fixes by ranges, s: the shortest in which most have one is taken.

    Raises
    ------
    InswsnError
        If there is no network, or too few ranges at a time.
    """
    ranges, fixes = recording.ranges, recording.fixes
    if ranges is not None and len(ranges):
        return fixes_of(ranges, periods, recording.height)
    if fixes is None or not np.isfinite(fixes.position).all(axis=1).any():
        raise InswsnError(
            f"The recording {recording.name} has neither ranges nor fixes while it moves: there is "
            "nothing to correct by."
        )
    return slope_velocity(fixes) if fixes.velocity is None else fixes


def fixes_of(
    ranges: Ranges, periods: Sequence[float], height: float | None = None, side: float = 0.0
) -> Fixes:
    """Return fixes of the shortest intervals of which most have one, with velocities.

    Height and side are as of `multilaterate_track`. Anchors in a level plane are taken to be above.

    Raises
    ------
    InswsnError
        If too few anchors are heard, or they are in a plane and no side is given.
    """
    if (fixes := shortest(ranges, periods, height, side)) is not None:
        return fixes
    normal = in_a_plane(ranges) if height is None else None
    if normal is None or side:
        raise InswsnError(
            f"Too few anchors are heard at a time: most intervals of {periods[-1]:g} s have no fix."
        )
    if not is_level(normal):
        raise refusal(ranges, normal)
    return fixes_of(ranges, periods, side=-1.0)  # to the side the mirror image is the same


def shortest(
    ranges: Ranges, periods: Sequence[float], height: float | None = None, side: float = 0.0
) -> Fixes | None:
    """Return what `fixes_of` does, or None where most intervals have no fix."""
    for period in periods:
        fixes = multilaterate_track(ranges, period, height=height, side=side)
        if np.isfinite(fixes.position).all(axis=1).mean() > _MOST_FIXES:
            return slope_velocity(fixes)
    return None


def is_level(normal: Array) -> bool:
    """Tell whether a plane with a normal is one such as a ceiling."""
    return len(normal) == 3 and float(abs(normal[2])) > _VERTICAL


def named_plane(ranges: Ranges, normal: Array) -> str:
    """Return the equation of the plane of anchors, such as z = 2.5 m."""
    middle = float(ranges.anchors.mean(axis=0) @ normal)
    parts = [f"{a:+.2g} {name}" for a, name in zip(normal, "xyz", strict=False) if abs(a) > 0.01]
    return f"{' '.join(parts).lstrip('+').replace('1 ', '')} = {middle:.3g} m"


def refusal(ranges: Ranges, normal: Array) -> InswsnError:
    """Return the error of anchors in a plane, where nothing tells the side of it."""
    return InswsnError(
        f"The anchors lie in a plane, {named_plane(ranges, normal)}, and neither ranges nor motion "
        "tell on which side of it the tag is: give its height, height_m in recording.yaml, or put "
        "an anchor out of the plane."
    )


def with_height(fixes: Fixes, height: float) -> tuple[Fixes, Finding]:
    """Return fixes on a plane with a height, m, that is held, and what to say of it."""
    heights = np.where(np.isfinite(fixes.position).all(axis=1), height, np.nan)
    more = {
        name: np.column_stack([value, np.full(len(fixes), np.nan)])
        for name in ("velocity", "deviation")
        if (value := getattr(fixes, name)) is not None
    }
    says = (
        f"positions are on a plane, and the IMU moves in space: the height is held at {height:g} m "
        f"within {HELD:g} m, and how it moves up and down is not told"
    )
    found = replace(fixes, position=np.column_stack([fixes.position, heights]), **more)
    return found, Finding("height", "network", height, -np.inf, np.inf, None, says)


def deviation_of(fixes: Fixes) -> float:
    """Return about how large the errors of fixes are, m: as they say of themselves, or look."""
    if fixes.deviation is not None and np.isfinite(fixes.deviation).any():
        return max(float(np.nanmedian(fixes.deviation[:, :2])), _LEAST)
    return roughness(fixes.position[:, :2])


def roughness(values: Array) -> float:
    """Return how large errors of values (rows, 2) that change steadily are.

    That is told by their second differences.
    """
    second = np.diff(values[np.isfinite(values).all(axis=1)], 2, axis=0)
    if not len(second):
        return 1.0
    return max(float(_OF_SECOND_DIFFERENCES * np.median(np.abs(second))), _LEAST)


def shares_of(fixes: Fixes) -> Array:
    """Return deviations of fixes by axis over the median one to the side, (rows, 3).

    Those that a fix does not say are as in the median, and twice as large upwards.
    """
    found = np.tile(UP, (len(fixes), 1))
    if fixes.deviation is not None and np.isfinite(fixes.deviation).any():
        said = fixes.deviation / deviation_of(fixes)
        part = found[:, : said.shape[1]]
        part[:] = np.where(np.isfinite(said), np.maximum(said, _LEAST_SHARE), part)
    return found
