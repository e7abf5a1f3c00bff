"""The network's positions: of ranges, on a side of anchors in a plane, or with a height held."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs import multilaterate_track
from inswsn_lib.logs.findings import FALSE_ALARM, Finding
from inswsn_lib.logs.window_fits import PERIODS, in_a_plane
from inswsn_lib.streams import Fixes, Ranges


class _Assuming(Protocol):
    @property
    def assumed(self) -> list[Finding]: ...


Kind = TypeVar("Kind", bound=_Assuming)

#: The deviation of a height that is held, m
HELD = 1.0
_MOST_FIXES = 0.5  # of the intervals, that must have one
_VERTICAL = 0.9  # the cosine of a normal, of a plane such as a ceiling


def fixes_of(
    ranges: Ranges, periods: tuple[float, ...] = PERIODS, height: float | None = None,
    side: float = 0.0,
) -> Fixes:  # fmt: skip
    """Return fixes of the shortest intervals of which most have one.

    Parameters
    ----------
    ranges : Ranges
    periods : tuple of float
        That are tried, s.
    height, side : float
        As of `multilaterate_track`.

    Raises
    ------
    InswsnError
        If too few anchors are heard, or they are in a plane and no side is given.
    """
    if (fixes := _shortest(ranges, periods, height, side)) is not None:
        return fixes
    normal = in_a_plane(ranges) if height is None else None
    if normal is None or side:
        raise InswsnError(
            f"Too few anchors are heard at a time: most intervals of {periods[-1]:g} s have no fix."
        )
    if not _level(normal):
        raise InswsnError(_refusal(ranges, normal))
    return fixes_of(ranges, periods, side=-1.0)  # to the side the mirror image is the same


def _shortest(
    ranges: Ranges, periods: tuple[float, ...], height: float | None, side: float
) -> Fixes | None:
    for period in periods:
        fixes = multilaterate_track(ranges, period, height=height, side=side)
        if np.isfinite(fixes.position).all(axis=1).mean() > _MOST_FIXES:
            return fixes
    return None


def on_a_side(
    ranges: Ranges, periods: tuple[float, ...], build: Callable[[Fixes], Kind],
    fit: Callable[[Kind], tuple[float, float]],
) -> Kind:  # fmt: skip
    """Return what is built of fixes on that side of the anchors' plane which fits the motion.

    Parameters
    ----------
    ranges : Ranges
    periods : tuple of float
        As of `fixes_of`.
    build : callable
        Takes fixes, and returns a filter, with a list ``assumed`` of findings.
    fit : callable
        Returns the time at which a filter starts, s, and the logarithm of its likelihood.

    Raises
    ------
    InswsnError
        If a filter starts on neither side, or both fit, and differ in more than their heights.
    """
    normal = in_a_plane(ranges)
    if normal is None:
        return build(fixes_of(ranges, periods))
    if (fixes := _shortest(ranges, periods, None, 0.0)) is not None:
        return build(fixes)
    found: dict[float, tuple[Kind, float, float]] = {}
    said = ""
    for side in (-1.0, 1.0):
        try:
            built = build(fixes_of(ranges, periods, side=side))
            found[side] = built, *fit(built)
        except InswsnError as error:
            said = said or str(error)
    if not found:
        raise InswsnError(f"The anchors lie in a plane, and on neither side of it: {said}")
    if len(found) == 1:
        gain = np.inf if -1.0 in found else -np.inf
    else:
        (_, start, below), (_, other, above) = found.values()
        # one that starts later could not be trusted before
        gain = below - above if start == other else np.inf * (other - start)
    bound = float(-np.log(FALSE_ALARM))
    level, told = _level(normal), abs(gain) >= bound
    if not told and not level:
        raise InswsnError(_refusal(ranges, normal))
    side = 1.0 if gain <= -bound else -1.0
    where = ("below" if side < 0 else "above") if level else "on the side that fits the motion"
    says = f"the anchors lie in a plane, {_named(ranges, normal)}; the tag is taken to be {where}"
    if not told:
        says += ", which the motion does not tell and matters to heights alone"
    chosen, *_ = found[side]
    chosen.assumed.append(
        Finding("side", "anchors", float(-side * gain), bound, np.inf, told or None, says)
    )
    return chosen


def _level(normal: Array) -> bool:
    return len(normal) == 3 and float(abs(normal[2])) > _VERTICAL


def _named(ranges: Ranges, normal: Array) -> str:
    middle = float(ranges.anchors.mean(axis=0) @ normal)
    parts = [f"{a:+.2g} {name}" for a, name in zip(normal, "xyz", strict=False) if abs(a) > 0.01]
    return f"{' '.join(parts).lstrip('+').replace('1 ', '')} = {middle:.3g} m"


def _refusal(ranges: Ranges, normal: Array) -> str:
    return (
        f"The anchors lie in a plane, {_named(ranges, normal)}, and neither ranges nor motion tell "
        "on which side of it the tag is: give its height, height_m in recording.yaml, or put an "
        "anchor out of the plane."
    )


def with_height(fixes: Fixes, height: float) -> tuple[Fixes, list[Finding]]:
    """Return fixes on a plane with a height that is held, and what to say of it.

    Parameters
    ----------
    fixes : Fixes
        In two dimensions.
    height : float
        m.
    """
    heights = np.where(np.isfinite(fixes.position).all(axis=1), height, np.nan)
    velocity, deviation = fixes.velocity, fixes.deviation
    nothing = np.full((len(fixes), 1), np.nan)
    if velocity is not None:
        velocity = np.hstack([velocity, nothing])
    if deviation is not None:
        deviation = np.hstack([deviation, nothing])
    position = np.column_stack([fixes.position, heights])
    says = (
        f"positions are on a plane, and the IMU moves in space: the height is held at {height:g} m "
        f"within {HELD:g} m, and how it moves up and down is not told"
    )
    found = replace(fixes, position=position, velocity=velocity, deviation=deviation)
    return found, [Finding("height", "network", height, -np.inf, np.inf, None, says)]
