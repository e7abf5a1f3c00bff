"""Every pairing of a DHF and an FKF in a plain scene, against the percentages that P2 prints.

Three identical clusters are in reach all the time; the node walks straight on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Literal, get_args

import numpy as np
import pandas as pd

from inswsn_lib.checks import Array
from inswsn_lib.filters import run_hinfinity, run_kalman
from inswsn_lib.lmi import InfeasibleDesignError, design_filter
from inswsn_lib.lmi.designs import Solver
from inswsn_lib.models import ErrorModel
from inswsn_lib.simulation import velocity_slopes

VelocitySource = Literal["difference", "window", "sensor"]
SOURCES: tuple[VelocitySource, ...] = get_args(VelocitySource)
_T, _FIX, _RUNS = 0.02, 0.2 / 2**0.5, 32  # s, m of a component: P2, Section 3
DURATIONS = (2, 5, 10, 20)  # s
HEADINGS = (0, 15, 27, 35, 45)  # degrees
#: The process noise of a filter in a step, of a position and of a velocity, by its name
PROCESS = {f"{a:g} m/s²": (a * _T**2 / 2, a * _T) for a in (0.017, 0.15, 1.2, 6.5)} | {
    "B = I": (1.0, 1.0), "B = 0.2 I": (0.2, 0.2),
}  # fmt: skip
#: The measurement noise that it assumes; None is the true one
NOISE = {"D true": None, "D = I": (1.0, 1.0), "D = 0.2 I": (0.2, 0.2)}
FILTERS = [f"{process}, {noise}" for process, noise in product(PROCESS, NOISE)]
_WINDOW = 25
#: True errors of a velocity of each source, m/s
_SPEEDS = {
    "sensor": 0.126,
    "difference": 0.2 / _T,
    "window": _FIX * np.sqrt(12 / (_WINDOW * (_WINDOW**2 - 1))) / _T,
}
#: Errors by the noise, (steps, 4, runs), and of an axis by a bias of 1 m/s^2, (steps, 2)
Response = tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Bench:
    """The plain scene, with random numbers of a seed, and the solver of the designs."""

    seed: int
    solver: Solver | tuple[Solver, ...]

    @cached_property
    def _drawn(self) -> tuple[Array, Array, Array]:
        rng = np.random.default_rng(self.seed)
        steps = int(max(DURATIONS) / _T)
        fixes = _FIX * rng.standard_normal((3, steps, 2, _RUNS))
        pure = rng.standard_normal(fixes.shape)
        shaken = 0.017 * _T * np.cumsum(rng.standard_normal((steps, 2, _RUNS)), axis=0)
        return fixes, pure, np.concatenate([_T * np.cumsum(shaken, axis=0), shaken], axis=1)

    @cached_property
    def ins(self) -> Response:
        """The errors of the INS alone."""
        time = _T * np.arange(len(self._drawn[2]))
        return self._drawn[2], np.stack([time**2 / 2, time], axis=1)

    def respond(self, kind: str, name: str, source: str) -> Response:
        """Return the errors of "DHF" or "FKF", a name of `FILTERS`; NaN if there is no design."""
        process, noise = name.split(", ")
        sizes = NOISE[noise] or (_FIX, _SPEEDS[source])
        model = ErrorModel.p2(_T, process_noise=PROCESS[process], measurement_noise=sizes)
        (drift, push), pushed = self.ins, np.zeros((len(self.ins[1]), 4, 1))
        pushed[:, [0, 2], 0] = push
        if kind == "FKF":
            R = model.measurement_covariance
            known = {"initial_covariance": R, "measurement_covariance": R / 3}

            def run(y: Array) -> Array:
                return run_kalman(model, y, predicted=True, **known)
        else:
            try:
                design = design_filter(model, solver=self.solver)
            except InfeasibleDesignError:  # numbers too far apart for the solver
                return np.full_like(drift, np.nan), np.full_like(push, np.nan)

            def run(y: Array) -> Array:
                return run_hinfinity(design, y, predicted=True)

        left = drift - run(drift - self._noise(source))
        return left, (pushed - run(pushed))[:, [0, 2], 0]

    def _noise(self, source: str) -> Array:
        """Return the mean measurement error of the three clusters."""
        fixes, pure, _ = self._drawn
        if source == "sensor":
            velocity = _SPEEDS["sensor"] * pure
        else:
            length = 2 if source == "difference" else _WINDOW
            velocity = np.stack([velocity_slopes(f, _T, length) for f in fixes])
        return np.asarray(np.concatenate([fixes, velocity], axis=2).mean(axis=0))


def mean_errors(response: Response, heading: float) -> Array:
    """Return mean absolute errors, (durations, 4, runs), in a direction in degrees."""
    c, s = np.cos(np.deg2rad(heading)), np.sin(np.deg2rad(heading))
    noise, push = (part[::2] for part in response)  # every second step will do
    bias = np.tile(0.15 * np.array([c - s, c + s]), 2)
    error = np.abs(noise + np.repeat(push, 2, axis=1)[:, :, None] * bias[:, None])
    total = np.cumsum(error, axis=0)
    steps = [int(d / _T / 2) for d in DURATIONS]
    return np.stack([total[n - 1] / n for n in steps])


#: A pairing: places of source, direction, DHF, FKF and duration
Pairing = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Pairings:
    """All pairings. ``misses`` are logarithms of remaining errors over the printed ones."""

    bench: Bench
    target: Array
    misses: Array

    @cached_property
    def spreads(self) -> Array:
        """The root mean square of the eight misses."""
        return np.asarray(np.sqrt(np.mean(self.misses**2, axis=-1)))

    @cached_property
    def worst(self) -> Array:
        """The factor of the worst of eight."""
        return np.asarray(np.exp(np.abs(self.misses).max(axis=-1)))

    @cached_property
    def ratios(self) -> Array:
        """Velocity errors of FKF over those of INS-only, (..., 2)."""
        cells = np.exp(self.misses) * self.target
        return np.asarray(cells[..., 2:4] / cells[..., 6:8])

    @property
    def close(self) -> Array:
        """Where both ratios are within 20 % of what the percentages imply."""
        aim = self.target[2:4] / self.target[6:8]
        return np.asarray((np.abs(np.log(self.ratios / aim)) < np.log(1.2)).all(axis=-1))

    def nearest(self, measure: Array, inside: Array | bool = True) -> Pairing:
        """Return where a measure is least."""
        least = np.nanargmin(np.where(inside, measure, np.inf))
        return tuple(int(i) for i in np.unravel_index(least, measure.shape))

    def choices(self) -> dict[str, Pairing]:
        """Return the nearest pairings in four respects; the third meets the implied ratios."""
        close, true = self.close, np.array([name.endswith("D true") for name in FILTERS])
        met = "met within 20 %" if close.any() else "met by none; least spread"
        plain = (true[:, None] & true)[None, None, :, :, None]
        return {
            "least spread": self.nearest(self.spreads),
            "least worst cell": self.nearest(self.worst),
            f"6.0 and 1.18 {met}": self.nearest(self.spreads, close if close.any() else True),
            "least spread, true D and R": self.nearest(self.spreads, plain),
        }

    def describe(self, pairing: Pairing) -> tuple[str, ...]:
        """Return a row of the table: words, percentages, ratios, spread and worst factor."""
        s, h, i, j, k = pairing
        lowered = [f"{x:.0f}" for x in 100 * (1 - np.exp(self.misses[pairing]) * self.target)]
        x, y = self.ratios[pairing]
        return (
            f"{SOURCES[s]}, {HEADINGS[h]}°, {DURATIONS[k]} s; DHF {FILTERS[i]}; FKF {FILTERS[j]}",
            ", ".join(lowered[:4]), ", ".join(lowered[4:]), f"{x:.1f}, {y:.2f}",
            f"{self.spreads[pairing]:.2f}", f"{self.worst[pairing]:.1f}",
        )  # fmt: skip

    @property
    def above(self) -> dict[str, int]:
        """The number of pairings whose FKF is worse than INS-only in both velocities, by source."""
        worse = np.asarray((self.ratios > 1).all(axis=-1))
        return {source: int(worse[i].sum()) for i, source in enumerate(SOURCES)}

    def tabulate(self, printed: Sequence[str]) -> pd.DataFrame:
        """Return the nearest pairings, with the percentages that are printed below them."""
        rows = {what: self.describe(pairing) for what, pairing in self.choices().items()}
        x, y = self.target[2:4] / self.target[6:8]
        rows["as printed"] = ("–", *printed, f"{x:.1f}, {y:.2f}", "–", "–")
        columns = [
            "what it is", "reduction of INS-only (%)", "reduction of FKF (%)",
            "FKF over INS-only, $v_x$ and $v_y$", "spread", "worst factor",
        ]  # fmt: skip
        table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
        return table.rename_axis("pairing")

    def single_runs(self, pairing: Pairing) -> Array:
        """Return the worst factor of a pairing in each of its runs."""
        s, h, i, j, k = pairing
        d, f = (
            mean_errors(self.bench.respond(kind, FILTERS[n], SOURCES[s]), HEADINGS[h])[k]
            for kind, n in (("DHF", i), ("FKF", j))
        )
        ins = mean_errors(self.bench.ins, HEADINGS[h])[k]
        misses = np.log(np.concatenate([d / ins, d / f]) / self.target[:, None])
        return np.asarray(np.exp(np.abs(misses).max(axis=0)))


def search_pairings(
    seed: int, left: Mapping[str, Mapping[str, float]], solver: Solver | tuple[Solver, ...]
) -> Pairings:
    """Score all pairings against the remaining errors that P2 prints, by axis and rival."""
    bench, misses = Bench(seed, solver), []
    target = np.array([axis[rival] for rival in ("vs_ins", "vs_fkf") for axis in left.values()])
    for source in SOURCES:
        answers = {
            kind: [bench.respond(kind, name, source) for name in FILTERS] for kind in ("DHF", "FKF")
        }
        for heading in HEADINGS:
            ins = np.median(mean_errors(bench.ins, heading), axis=2)
            d, f = (
                np.stack([np.median(mean_errors(r, heading), axis=2) for r in answers[kind]])
                for kind in ("DHF", "FKF")
            )
            both = np.broadcast_arrays(d[:, None] / ins, d[:, None] / f[None])
            misses.append(np.log(np.concatenate(both, axis=-1) / target))
    shape = (len(SOURCES), len(HEADINGS), *misses[0].shape)
    return Pairings(bench, target, np.stack(misses).reshape(shape))
