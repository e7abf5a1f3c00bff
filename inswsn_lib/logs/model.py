"""What ranges or fixes should be if a reference is right, and how that changes with each unknown.

A range to anchor k that is stamped t is

    r = (1 + s_k) |R (p(t') + A(t') l - c) + c + h - a_k| + b_k,   t' = t - clock - rate (t - t_m),

with p and A position and attitude of the reference, c the middle of its track, and t_m that of the
stamps. A fix is the place between the bars, less the anchor.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.network_fixes import slope_velocity
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
)  # fmt: skip
from inswsn_lib.simulation.position_search import squares
from inswsn_lib.streams import Fixes, Ranges, Reference

#: Kinds of unknowns, in their order; "frame" asks for turn and shift
KINDS = ("clock", "rate", "turn", "shift", "lever arm", "bias", "scale")
_PPM = 1e-6
_GAP = 0.5  # s, or three periods: between stamps that are farther apart nothing is told
_HALF = 0.05  # s, of what velocities are differences over: stamps jitter by milliseconds


class ReferenceMotion:
    """A reference on straight lines between its stamps, in its first 2 or 3 coordinates."""

    def __init__(self, reference: Reference, dimensions: int) -> None:
        self.d = dimensions
        there = np.isfinite(reference.position).all(axis=1)
        if there.sum() < 2:
            raise InswsnError("The reference has fewer than two positions.")
        self.time = reference.time[there]
        self._track = self._point = reference.position[there, :dimensions]
        self.middle: Array = self._track.mean(axis=0)
        self.period = float(np.median(np.diff(self.time)))
        self.has_attitude = reference.attitude is not None
        matrices = np.broadcast_to(np.eye(3), (len(self.time), 3, 3))
        if reference.attitude is not None:
            matrices = Rotation.from_quat(reference.attitude[there]).as_matrix()
        self._turned: Array = matrices
        self._arm: Array = np.zeros(3)

    def covers(self, time: Array, margin: float = 0.0) -> Mask:
        """Tell which times are within it by a margin (s), and in no gap."""
        before = self._before(time)
        near = self.time[before + 1] - self.time[before] <= max(_GAP, 3 * self.period)
        inside = (time >= self.time[0] + margin) & (time <= self.time[-1] - margin)
        return np.asarray(near & inside)

    def position(self, time: Array) -> Array:
        """Return where the body was, (n, d)."""
        return self._between(self._track, time)

    def attitude(self, time: Array) -> Array:
        """Return the matrices (n, d, 3) that turn vectors of the body into the frame."""
        return self._between(self._turned[:, : self.d], time)

    def rotation(self, time: Array) -> Rotation:
        """Return the rotations from the axes of the body to the frame."""
        return Rotation.from_matrix(self._between(self._turned, time))

    def carried(self, time: Array, lever_arm: Array) -> Array:
        """Return where a point of the body was, (n, d); without an attitude, where that was."""
        if self.has_attitude and not np.array_equal(lever_arm, self._arm):
            self._arm = np.array(lever_arm, dtype=float)
            self._point = self._track + self._turned[:, : self.d] @ self._arm
        return self._between(self._point, time)

    def velocity(self, time: Array, lever_arm: Array) -> Array:
        """Return the velocity of a point of the body, (n, d), m/s, over some periods."""
        half = max(_HALF, 2 * self.period)
        late, early = np.clip([time + half, time - half], self.time[0], self.time[-1])
        ends = self.carried(late, lever_arm) - self.carried(early, lever_arm)
        return np.asarray(ends / np.maximum(late - early, 1e-9)[:, None])

    def _before(self, time: Array) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.time, time) - 1, 0, len(self.time) - 2)

    def _between(self, values: Array, time: Array) -> Array:
        i = self._before(time)
        share = np.clip((time - self.time[i]) / (self.time[i + 1] - self.time[i]), 0.0, 1.0)
        share = share.reshape(-1, *[1] * (values.ndim - 1))
        return np.asarray(values[i] + share * (values[i + 1] - values[i]))


@dataclass(frozen=True, eq=False)
class State:
    """Values of all unknowns, asked for or not."""

    clock: Array  # (1,), s
    rate: Array  # (1,), 1e-6
    turn: Array  # (d, d), R
    shift: Array  # (d,), h
    lever_arm: Array  # (3,)
    bias: Array  # (N,)
    scale: Array  # (N,)

    @classmethod
    def nothing(cls, rows: Rows, lever_arm: Array) -> State:
        """Return what a recording says of itself: a lever arm, and nothing else."""
        d, zero = rows.dimension, np.zeros(0 if rows.anchors is None else len(rows.anchors))
        return cls(np.zeros(1), np.zeros(1), np.eye(d), np.zeros(d), lever_arm, zero, zero)

    def late(self, time: Array, middle: float) -> Array:
        """Return how late stamps are, s."""
        return self.clock + _PPM * self.rate * (time - middle)


@dataclass(frozen=True, eq=False)
class Rows:
    """What was measured: each row a distance to an anchor, or a coordinate of a fix.

    Of coordinates, `which` is the axis and there are no anchors. Weights are relative.
    """

    time: Array
    which: NDArray[np.intp]
    value: Array
    weight: Array
    anchors: Array | None
    names: tuple[str, ...]
    dimension: int

    @classmethod
    def of(cls, source: Ranges | Fixes) -> Rows:
        """Return the rows of ranges or of fixes; a fix that is not there has none."""
        if isinstance(source, Ranges):
            r = source.kept(np.isfinite(source.distance))
            which, ones = r.anchor.astype(np.intp), np.ones(len(r))
            return cls(r.time, which, r.distance, ones, r.anchors, r.names, r.anchors.shape[1])
        kept: Mask = np.asarray(np.isfinite(source.position).all(axis=1))
        if source.good is not None:
            kept = kept & source.good
        d = source.position.shape[1]
        weight = np.ones((int(kept.sum()), d))
        if source.deviation is not None and kept.any():
            usual = float(np.nanmedian(source.deviation[kept]))
            told = np.nan_to_num(source.deviation[kept], nan=usual)
            # a receiver is not believed that one fix is ten times better than usual
            weight = usual / np.maximum(told, usual / 10) if usual > 0 else weight
        axes = np.tile(np.arange(d), len(weight))
        time, value = np.repeat(source.time[kept], d), source.position[kept].ravel()
        return cls(time, axes, value, weight.ravel(), None, (), d)

    def part(self, kept: Mask) -> Rows:
        """Return some of the rows."""
        rows = {name: getattr(self, name)[kept] for name in ("time", "which", "value", "weight")}
        return replace(self, **rows)

    def level(self, miss: Array) -> Array:
        """Return residuals less the median of their anchor or axis."""
        keys, own = np.unique(self.which, return_inverse=True)
        medians = np.array([np.median(miss[own == k]) for k in range(len(keys))])
        return np.asarray(miss - medians[own])


class Unknowns:
    """Which entries of a state are asked for, by kinds of `KINDS`, and their names."""

    def __init__(self, rows: Rows, kinds: Collection[str]) -> None:
        self.rows, self.d = rows, rows.dimension
        self.middle = float(rows.time.mean()) if len(rows.time) else 0.0
        one, axes = np.arange(1), np.arange(self.d)
        heard = np.arange(0) if rows.anchors is None else np.unique(rows.which)
        found = (one, one, axes if self.d == 3 else one, axes, axes, heard, heard)
        self.entries = {k: of for k, of in zip(KINDS, found, strict=True) if k in kinds}
        self.kinds = [kind for kind, of in self.entries.items() for _ in of]
        self.names = [
            f"{kind} {self._label(kind, k)}".strip()
            for kind, of in self.entries.items()
            for k in of.tolist()
        ]

    def _label(self, kind: str, k: int) -> str:
        if kind in {"bias", "scale"}:
            return self.rows.names[k]
        return "xyz"[k] if len(self.entries[kind]) > 1 else ""

    def moved(self, state: State, by: Array) -> State:
        """Return a state with the unknowns moved by a step."""
        new, first = dict(vars(state)), 0
        for kind, of in self.entries.items():
            name, part = kind.replace(" ", "_"), by[first : first + len(of)]
            if kind == "turn":
                new[name] = _rotation(part) @ state.turn
            else:
                new[name] = new[name].copy()
                new[name][of] += part
            first += len(of)
        return State(**new)

    def values(self, state: State) -> Array:
        """Return the unknowns of a state, of a turn the rotation vector."""
        parts = {kind: getattr(state, kind.replace(" ", "_")) for kind in self.entries}
        if "turn" in parts:
            turn = np.eye(3)
            turn[: self.d, : self.d] = state.turn
            parts["turn"] = Rotation.from_matrix(turn).as_rotvec()[3 - len(self.entries["turn"]) :]
        return np.concatenate([parts[kind][of] for kind, of in self.entries.items()])


class Model(Unknowns):
    """Residuals of rows by a reference, and their derivatives by the unknowns."""

    def __init__(self, motion: ReferenceMotion, rows: Rows, kinds: Collection[str]) -> None:
        super().__init__(rows, kinds)
        self.motion, self.centre = motion, motion.middle

    def times(self, state: State) -> Array:
        """Return when the rows were measured, by the reference's clock."""
        return self.rows.time - state.late(self.rows.time, self.middle)

    def residual(self, state: State) -> Array:
        """Return what the rows have more than they should, weighted."""
        return self._compared(state)[0]

    def _compared(self, state: State) -> tuple[Array, Array, Array, Array]:
        """Return residuals, their derivatives by place, distances, and places about the middle."""
        rows = self.rows
        there = self.motion.carried(self.times(state), state.lever_arm) - self.centre
        turned = there @ state.turn.T
        place = turned + self.centre + state.shift
        if rows.anchors is None:
            along = np.eye(self.d)[rows.which]
            distance = gain = np.ones(len(along))
            miss = rows.value - place[np.arange(len(place)), rows.which]
        else:
            apart = place - rows.anchors[rows.which]
            distance = np.maximum(np.linalg.norm(apart, axis=1), 1e-9)
            gain = 1 + state.scale[rows.which]
            miss = rows.value - gain * distance - state.bias[rows.which]
            along = apart / distance[:, None]
        return rows.weight * miss, gain[:, None] * along, distance, turned

    def jacobian(self, state: State) -> Array:
        """Return the derivatives of the residuals, (rows, unknowns)."""
        _, along, distance, turned = self._compared(state)
        time = self.times(state)
        back = along @ state.turn  # in the reference's frame
        columns: list[Array] = []
        for kind, of in self.entries.items():
            if kind in {"clock", "rate"}:
                by = np.sum(back * self.motion.velocity(time, state.lever_arm), axis=1)
                late = 1.0 if kind == "clock" else _PPM * (self.rows.time - self.middle)
                columns.append((late * by)[:, None])
            elif kind == "turn":
                columns.append(-_moment(turned, along))
            elif kind == "shift":
                columns.append(-along)
            elif kind == "lever arm":
                arms = np.einsum("nij,ni->nj", self.motion.attitude(time), back)
                columns.append(-arms[:, : self.d])
            else:
                own = (self.rows.which[:, None] == of).astype(float)
                columns.append(-own if kind == "bias" else -own * distance[:, None])
        return self.rows.weight[:, None] * np.hstack(columns)

    def why(self, state: State, kind: str, entries: NDArray[np.intp]) -> str:
        """Return what there is to tell some entries of a kind by."""
        time = self.times(state)
        if kind in {"clock", "rate"}:
            speed = _root_mean_square(self.motion.velocity(time, state.lever_arm))
            return f"it moves at {speed:.2g} m/s"
        if kind in {"turn", "shift"}:
            place = self.motion.position(time)
            spread = _root_mean_square(place - place.mean(axis=0))
            return f"its places are within {spread:.2g} m of one another"
        if kind == "lever arm":
            turns = self.motion.rotation(time)
            off = np.degrees((turns.mean().inv() * turns).as_rotvec())
            return f"the body turns by {_root_mean_square(off):.2g} deg"
        heard = min(int(np.sum(self.rows.which == k)) for k in entries)
        return f"an anchor is heard {heard} times"


class Meeting(Unknowns):
    """Ranges of intervals that should meet in points, but for a bias of each anchor.

    The positions are unknowns, too, and eliminated (variable projection, Golub and Pereyra 1973).
    What all anchors have too much is told by how ranges from all around cannot meet.
    """

    def __init__(self, ranges: Ranges) -> None:
        ranges = ranges.kept(np.isfinite(ranges.distance))
        d, period = ranges.anchors.shape[1], enough_ranges(ranges) if len(ranges) else None
        if period is None:
            raise InswsnError(
                f"The bias by anchor cannot be told without a reference: hardly an interval of "
                f"{PERIODS[-1]:g} s has ranges to {d + 1} anchors, so none is redundant."
            )
        windows = window_ranges(ranges, period)
        near = fit_windows(windows)
        self._windows = windows._replace(place=windows.place - _moved(windows, near))
        self._near, self._good = near, each_row(windows, ~near.bad)
        time = each_row(windows, mean_times(windows))
        ones = np.ones(len(time))
        rows = Rows(time, windows.anchor, windows.distance, ones, ranges.anchors, ranges.names, d)
        super().__init__(rows.part(self._good), ["bias"])
        self.centre = np.zeros(d)
        # residuals that are as large as if positions were known
        taken = d * int((~near.bad).sum()) / max(1, len(self.rows.time))
        self._size = 1 / np.sqrt(max(1 - taken, 1e-3))
        self._last: tuple[Array, WindowFit] | None = None

    def _fit(self, bias: Array) -> WindowFit:
        if self._last is None or not np.array_equal(self._last[0], bias):
            free = self._windows.distance - bias[self._windows.anchor]
            found = fit_windows(self._windows._replace(distance=free), near=self._near)
            self._last = (bias, found)
        return self._last[1]

    def residual(self, state: State) -> Array:
        """Return what ranges have more than the distances from the points where they meet best."""
        return np.asarray(self._size * self._fit(state.bias).miss[self._good])

    def jacobian(self, state: State) -> Array:
        """Return the derivatives of the residuals, (rows, anchors), as positions follow."""
        rows, fit = self._windows, self._fit(state.bias)
        own, bend = rows.anchor[:, None] == self.entries["bias"], fit.weight[:, None, None] ** 3
        H = by_window(rows, bend * squares(fit.direction))
        C = by_window(rows, bend * fit.direction[:, :, None] * own[:, None, :])
        follows = each_row(rows, np.linalg.pinv(H, hermitian=True) @ C)
        followed = np.einsum("nd,ndh->nh", fit.direction, follows)
        return np.asarray(self._size * (followed - own)[self._good])

    def why(self, state: State, kind: str, entries: NDArray[np.intp]) -> str:
        """Return what there is too little of."""
        return "the tag hears too few anchors, or too seldom, or hardly moves among them"


def _root_mean_square(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=1))))


def _rotation(part: Array) -> Array:
    """Return the rotation by a vector, or in the plane by an angle."""
    if len(part) == 3:
        return np.asarray(Rotation.from_rotvec(part).as_matrix())
    c, s = float(np.cos(part[0])), float(np.sin(part[0]))
    return np.array([[c, -s], [s, c]])


def _moment(place: Array, along: Array) -> Array:
    """Return the moments of unit forces at places: vectors, or in the plane one number."""
    if place.shape[1] == 3:
        return np.asarray(np.cross(place, along))
    return np.asarray(place[:, :1] * along[:, 1:] - place[:, 1:] * along[:, :1])


def _moved(rows: WindowRanges, fit: WindowFit) -> Array:
    """Return how far the tag is, at each range, from where it is at the mean of its interval.

    A range from a place that moves is one from the mean place to an anchor that moves the other
    way. The velocity is that from the interval before to the one after.
    """
    time = mean_times(rows)
    position = np.where(fit.bad[:, None], np.nan, fit.position)
    slope = slope_velocity(Fixes(time, position), count=3).velocity
    assert slope is not None
    velocity = np.nan_to_num(np.roll(slope, -1, axis=0))
    return np.asarray(each_row(rows, velocity) * (rows.time - each_row(rows, time))[:, None])
