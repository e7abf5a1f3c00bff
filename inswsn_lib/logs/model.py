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
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.streams import Fixes, Ranges

#: Kinds of unknowns, in their order; "frame" asks for turn and shift
KINDS = ("clock", "rate", "turn", "shift", "lever arm", "bias", "scale")
_PPM = 1e-6


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
    """Which entries of a state are asked for, and their names.

    Parameters
    ----------
    rows : Rows
    kinds : collection of str
        Of `KINDS`.
    """

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
