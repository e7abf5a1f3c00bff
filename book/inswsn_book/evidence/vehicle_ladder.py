"""P3's car with one aid after the other: the rungs, and whose share of the gain is what."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from inswsn_book.evidence.outage_cells import ByDrive
from inswsn_book.evidence.vehicle_tables import Ratios, rows_table, written
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, cluster_share
from inswsn_lib.navigation import RecordedTrials, VehicleOutages, outage_size
from inswsn_lib.navigation.vehicle_outages import AFTER, LAG, OUTAGE, WHEEL_NOISE, WHEEL_SCALE

#: The rungs from below, by the names that they have in the outages
LADDER = {
    "never": "INS alone",
    "compass": "compass alone",
    "lateral": "lateral constraint alone",
    "through": "constraint and compass (P3's aids)",
    "standstill": "+ zero velocity at standstill",
    "wheels": "+ wheel speed",
    "lssvm": "P3's aids + LS-SVM (P3's method)",
    "rbf": "P3's aids + RBF network",
    "lagged": f"P3's aids, fixed-lag smoother, {LAG} s late: not causal",
    "smoothed": "P3's aids, smoother with GPS after the outage: not causal",
}
#: Of smoothers, s, and of simulated wheels, m/s and %
NUMBERS = {"lag": LAG, "after": AFTER, "wheel-noise": WHEEL_NOISE, "wheel-scale": 100 * WHEEL_SCALE}
# What is put against what; the first over the second
_STEPS = (("standstill", "through"), ("wheels", "standstill"), ("lagged", "through"))
_OVER = (*((name, "never") for name in LADDER if name != "never"), *_STEPS)
# Parts of a gain over the INS alone: from which rung to which, and up to which the gain goes
_SHARES = {
    "constraint": ("never", "lateral", "lssvm"),
    "compass": ("lateral", "through", "lssvm"),
    "learner": ("through", "lssvm", "lssvm"),
    "constraint-of-aids": ("never", "lateral", "through"),
    "constraint-metres": ("never", "lateral", "lssvm"),
}


class Climb(NamedTuple):
    """RMS and largest errors in 40 s by rung, (outages, runs), m, and clusters of the outages.

    A rung that was run with some draws alone has fewer runs, spread evenly over those of others.
    """

    rms: dict[str, Array]
    largest: dict[str, Array]
    clusters: NDArray[Any]
    where: str

    @classmethod
    def of(cls, errors: Mapping[str, Array], clusters: ArrayLike, where: str) -> Climb:
        """Return that of errors, (steps, outages, runs), as far as they have the rungs."""
        there = [name for name in LADDER if name in errors]
        sizes = {name: outage_size(errors[name][: OUTAGE + 1]) for name in there}
        rms, largest = ({name: size[i] for name, size in sizes.items()} for i in (0, 1))
        return cls(rms, largest, np.broadcast_to(np.asarray(clusters), rms["never"].shape), where)

    def factors(self, ratios: Ratios) -> dict[str, Finding]:
        """Return the factors over the INS alone and between rungs, by clusters."""
        found = {}
        for one, other in _OVER:
            if one in self.rms:
                every = self.rms[other].shape[1] // self.rms[one].shape[1]
                below, clusters = (x[:, ::every] for x in (self.rms[other], self.clusters))
                how = f"RMS error in 40 s {self.where}, {LADDER[one]}, over {LADDER[other]}"
                found[f"{one}-{other}"] = ratios.factor(self.rms[one], below, clusters, how)
        return found

    def shares(self) -> dict[str, Finding]:
        """Return what parts of a gain are of it, by mean logarithms of errors or in metres."""
        found = {}
        for name, (first, last, top) in _SHARES.items():
            metres = name.endswith("metres")
            size = {rung: x if metres else np.log(x) for rung, x in self.rms.items()}
            part, gain = (size[a] - size[b] for a, b in ((first, last), ("never", top)))
            how = (
                f"RMS error in 40 s {self.where}: the step from {LADDER[first]} to {LADDER[last]} "
                f"as a share of that from {LADDER['never']} to {LADDER[top]}; means of "
                f"{'errors' if metres else 'logarithms'} over the outages, interval by clusters."
            )
            share = cluster_share(part.ravel(), gain.ravel(), self.clusters.ravel())
            found[name] = Finding(*share, "1", how)
        return found


def climbs(outages: VehicleOutages, trials: RecordedTrials) -> tuple[Climb, Climb]:
    """Return the ladder in the simulated outages, and in those of the recorded drive."""
    blocks = np.arange(len(trials.starts))[:, None] // 2
    return (
        Climb.of(outages.errors | outages.ladder, outages.clusters, "in the simulation"),
        Climb.of(trials.errors | trials.ladder, blocks, "on the recorded drive"),
    )


def seven_gain(climb: Climb, method: str) -> ByDrive:
    """Return the reduction as P3 counts it: the mean of the percentages but that of place 4."""
    less = np.delete(100 * (1 - climb.rms[method] / climb.rms["never"]), 3, axis=0)
    how = f"Reduction of the RMS error by {LADDER[method]} against {LADDER['never']}, mean over the"
    return ByDrive(less.mean(axis=0), "%", f"{how} seven places other than the fourth.")


def ladder_table(climbed: Mapping[str, tuple[Climb, Mapping[str, Finding]]]) -> pd.DataFrame:
    """Return medians of RMS and largest errors, and factors over the INS alone, by words."""
    rows, columns = {}, [f"{w}: {what}" for w in climbed for what in ("RMS / largest (m)", "÷ INS")]
    for name, label in LADDER.items():
        cells = []
        for climb, factors in climbed.values():
            if name not in climb.rms:
                cells += ["no wheels in the log", "–"]
                continue
            middles = (np.median(size[name]) for size in (climb.rms, climb.largest))
            over = factors.get(f"{name}-never")
            cells += [" / ".join(f"{x:.1f}" for x in middles), written(over) if over else "–"]
        rows[label] = tuple(cells)
    return rows_table(rows, columns, "filter")
