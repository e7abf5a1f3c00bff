"""Which unknowns a recording can determine, and why it cannot determine the others."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.model import KINDS, Model, State

#: The largest deviation of what counts as told; of lengths it is that of one measurement
LIMITS = {"clock": 0.05, "rate": 200.0, "turn": 0.05, "scale": 0.05}
UNITS = {
    "clock": "s", "rate": "ppm", "turn": "rad", "shift": "m", "lever arm": "m", "bias": "m",
    "scale": "",
}  # fmt: skip

_LENGTH = 0.01  # m: the least limit of lengths, where measurements are almost without noise


def limits_of(model: Model, noise: float, given: Mapping[str, float] | None = None) -> Array:
    """Return the largest deviation of each unknown that counts as told."""
    limits = dict.fromkeys(KINDS, max(noise, _LENGTH)) | LIMITS | dict(given or {})
    return np.array([limits[model.kind_of(column)] for column in range(len(model.names))])


def refuse(model: Model, state: State, deviations: Array, limits: Array) -> None:
    """Raise an error that names the unknowns whose deviation is above its limit, and why."""
    wrong = ~(deviations <= limits)
    if not wrong.any():
        return
    said = []
    for kind in model.kinds:
        mine = [i for i in np.flatnonzero(wrong).tolist() if model.kind_of(i) == kind]
        if mine:
            names = [model.names[i].removeprefix(kind).strip() for i in mine]
            worst = float(np.max(deviations[mine]))
            size = (
                f"its deviation would be {worst:.2g} {UNITS[kind]}, above {limits[mine[0]]:.2g}"
                if np.isfinite(worst)
                else "nothing, or one short time alone, tells it from the others"
            )
            which = f"{kind} {', '.join(names)}".strip()
            said.append(f"{which} ({size}; {_why(model, state, kind, mine)})")
    raise InswsnError(f"The recording cannot tell {'; '.join(said)}.")


def _why(model: Model, state: State, kind: str, columns: list[int]) -> str:
    time, motion = model.times(state), model.motion
    if kind in {"clock", "rate"}:
        speed = np.linalg.norm(motion.velocity(time, state.lever_arm), axis=1)
        return f"it moves at {float(np.sqrt(np.mean(speed**2))):.2g} m/s"
    if kind in {"turn", "shift"}:
        place = motion.position(time)
        spread = float(np.sqrt(np.mean(np.sum((place - place.mean(axis=0)) ** 2, axis=1))))
        return f"its places are within {spread:.2g} m of one another"
    if kind == "lever arm":
        return f"the body turns by {_turns(model, time):.2g} deg"
    rows = [int(np.sum(model.rows.which == k)) for k in model.heard]
    first = model.names.index(next(n for n in model.names if n.startswith(kind)))
    heard = min(rows[column - first] for column in columns)
    return f"an anchor is heard {heard} times"


def _turns(model: Model, time: Array) -> float:
    """Return how far attitudes are from their mean, root mean square, degrees."""
    matrices = model.motion.attitude(time)
    if model.d == 2:  # the rows that are there make a matrix of a level body
        angles = np.arctan2(matrices[:, 1, 0], matrices[:, 0, 0])
        yaw = Rotation.from_euler("z", angles[:, None])
    else:
        yaw = Rotation.from_matrix(matrices)
    off = (yaw.mean().inv() * yaw).magnitude()
    return float(np.degrees(np.sqrt(np.mean(off**2))))
