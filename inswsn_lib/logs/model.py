"""What ranges or fixes should be if a reference is right, and how that changes with each unknown.

A range to anchor k that is stamped t is

    r = (1 + s_k) |R (p(t') + A(t') l - c) + c + h - a_k| + b_k,   t' = t - clock - rate (t - t_m),

with p and A position and attitude of the reference, c the middle of its track, and t_m that of the
stamps. A fix is the place between the bars, less the anchor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array, Mask
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.streams import Fixes, Ranges

#: Kinds of unknowns, in their order; "frame" asks for turn and shift
KINDS = ("clock", "rate", "turn", "shift", "lever arm", "bias", "scale")
_PPM = 1e-6


@dataclass(frozen=True, eq=False)
class State:
    """Values of all unknowns, asked for or not."""

    clock: float  # s
    rate: float  # 1e-6
    turn: Array  # (d, d), R
    shift: Array  # (d,), h
    lever_arm: Array  # (3,)
    bias: Array  # (N,)
    scale: Array  # (N,)

    @classmethod
    def nothing(cls, rows: Rows, lever_arm: Array) -> State:
        """Return what a recording says of itself: a lever arm, and nothing else."""
        d, zero = rows.dimension, np.zeros(0 if rows.anchors is None else len(rows.anchors))
        return cls(0.0, 0.0, np.eye(d), np.zeros(d), lever_arm, zero, zero.copy())


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
            sound = np.isfinite(source.distance)
            which = source.anchor[sound].astype(np.intp)
            return cls(
                source.time[sound],
                which,
                source.distance[sound],
                np.ones(len(which)),
                source.anchors,
                source.names,
                source.anchors.shape[1],
            )
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
        return replace(
            self,
            time=self.time[kept],
            which=self.which[kept],
            value=self.value[kept],
            weight=self.weight[kept],
        )


class Model:
    """Residuals of rows and their derivatives by the unknowns that are asked for.

    Parameters
    ----------
    motion : ReferenceMotion
    rows : Rows
    kinds : sequence of str
        Of `KINDS`.
    """

    def __init__(self, motion: ReferenceMotion, rows: Rows, kinds: Sequence[str]) -> None:
        self.motion, self.rows, self.d = motion, rows, motion.d
        self.kinds = [kind for kind in KINDS if kind in kinds]
        self.heard = np.unique(rows.which) if rows.anchors is not None else np.arange(0)
        self.middle = float(rows.time.mean()) if len(rows.time) else 0.0
        self._first: dict[str, int] = {}
        self.names: list[str] = []
        for kind in self.kinds:
            self._first[kind] = len(self.names)
            self.names += [f"{kind} {label}".strip() for label in self._labels(kind)]

    def _labels(self, kind: str) -> list[str]:
        if kind in {"clock", "rate"}:
            return [""]
        if kind in {"bias", "scale"}:
            return [self.rows.names[k] for k in self.heard]
        if kind == "turn" and self.d == 2:
            return [""]
        return list("xyz"[: self.d])

    def kind_of(self, column: int) -> str:
        """Return the kind of an unknown."""
        return max((k for k in self.kinds if self._first[k] <= column), key=self._first.__getitem__)

    def moved(self, state: State, by: Array) -> State:
        """Return a state with the unknowns moved by what a step says."""
        new = dict(vars(state))
        for kind in self.kinds:
            part = by[self._first[kind] : self._first[kind] + len(self._labels(kind))]
            name = kind.replace(" ", "_")
            if kind in {"clock", "rate"}:
                new[name] = getattr(state, name) + float(part[0])
            elif kind == "turn":
                new[name] = _rotation(part) @ state.turn
            else:
                value = getattr(state, name).copy()
                value[self.heard if kind in {"bias", "scale"} else slice(len(part))] += part
                new[name] = value
        return State(**new)

    def times(self, state: State) -> Array:
        """Return when the rows were measured, by the reference's clock."""
        late = state.clock + _PPM * state.rate * (self.rows.time - self.middle)
        return np.asarray(self.rows.time - late)

    def residual(self, state: State) -> Array:
        """Return what the rows have more than they should, weighted."""
        return self._compared(state)[0]

    def _compared(self, state: State) -> tuple[Array, Array, Array, Array, Array]:
        """Return residuals, directions, gains, distances, and places turned about the middle."""
        rows = self.rows
        there = self.motion.carried(self.times(state), state.lever_arm) - self.motion.middle
        turned = there @ state.turn.T
        place = turned + self.motion.middle + state.shift
        if rows.anchors is None:
            direction = np.eye(self.d)[rows.which]
            each = place[np.arange(len(place)), rows.which]
            one = np.ones(len(each))
            return rows.weight * (rows.value - each), direction, one, one, turned
        apart = place - rows.anchors[rows.which]
        distance = np.maximum(np.linalg.norm(apart, axis=1), 1e-9)
        gain = 1 + state.scale[rows.which]
        miss = rows.weight * (rows.value - gain * distance - state.bias[rows.which])
        return miss, apart / distance[:, None], gain, distance, turned

    def jacobian(self, state: State) -> Array:
        """Return the derivatives of the residuals, (rows, unknowns)."""
        _, direction, gain, distance, turned = self._compared(state)
        time = self.times(state)
        along = gain[:, None] * direction
        back = along @ state.turn  # in the reference's frame
        columns: list[Array] = []
        for kind in self.kinds:
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
                own = (self.rows.which[:, None] == self.heard).astype(float)
                columns.append(-own if kind == "bias" else -own * distance[:, None])
        return self.rows.weight[:, None] * np.hstack(columns)


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
