"""P2's distributed filter by three rules of handover, and by three sources of velocity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from inswsn_book.evidence.fusion_percentages import FirstReading
from inswsn_book.evidence.fusion_search import SOURCES, VelocitySource
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, mean_absolute_error
from inswsn_lib.filters import patterns_of, run_distributed, run_federated
from inswsn_lib.lmi import FilterDesign, design_filter
from inswsn_lib.navigation.cluster_fusion import ClusterFusion, Pattern
from inswsn_lib.papers import AXES
from inswsn_lib.simulation import ClusterScene

RUNS = 64  # of the sources
_SMALL = slice(0, RUNS)


@dataclass(frozen=True, eq=False)
class Handover:
    """P2's filters in a scene, when clusters come into reach and drop out of it.

    Attributes
    ----------
    fusion : ClusterFusion
        The scene.
    fading_length : float
        Coverage beyond the third node that counts as full when weights fade, m.
    """

    fusion: ClusterFusion
    fading_length: float

    @property
    def everyone(self) -> Pattern:
        """All clusters in reach."""
        return (True,) * len(self.fusion.scene.clusters)

    @cached_property
    def patterns(self) -> list[Pattern]:
        """The clusters in reach at each step."""
        heard = ~np.isnan(self.fusion.scene.fix_covariance[:, :, 0, 0]).T
        return [tuple(bool(there) for there in row) for row in heard]

    @cached_property
    def changes(self) -> list[int]:
        """The first step, and every one at which the set in reach changes."""
        met = self.patterns
        return [0] + [k for k in range(1, len(met)) if met[k] != met[k - 1]]

    @property
    def nodes_in_reach(self) -> Array:
        """The number of nodes in reach of each cluster that takes part, at each step."""
        scene = self.fusion.scene
        near = [scene.heard[:, scene.labels == c].sum(axis=1) for c in range(len(scene.clusters))]
        return np.asarray(np.stack(near, axis=1)[np.array(self.patterns)])

    def by_rules(self, designs: Sequence[FilterDesign], y: Array) -> dict[str, Array]:
        """Return the errors of DHF by rule, (steps, 4, runs), weights from (9) with own noise."""
        sets = {*patterns_of(self.fusion.measurements), *self.fusion.sets, self.everyone}
        weights = self.fusion.fused_weights(designs, sets)
        fade = {"handover": "fading", "margins": self.fusion.scene.margins(self.fading_length)}
        rules: dict[str, dict[str, Any]] = {
            "restart": {"weights": weights},
            "fading": {"weights": weights} | fade,
            "constant": {"weights": weights[self.everyone], "handover": "constant"},
        }
        ins = self.fusion.drawn["ins"][..., : y.shape[-1]]
        return {
            rule: ins - run_distributed(designs, y, predicted=True, **told)
            for rule, told in rules.items()
        }

    def _from(self, source: VelocitySource) -> tuple[ClusterScene, Array]:
        """Return the scene with another source of velocity, and its network errors."""
        scene = replace(self.fusion.scene, velocity_source=source)
        fixes = self.fusion.drawn["fixes"]
        few = fixes[..., _SMALL]
        normal = np.random.default_rng(self.fusion.seed).standard_normal(few.shape)
        return scene, scene.with_velocities(few, normal)

    @cached_property
    def velocities(self) -> dict[str, tuple[float, float]]:
        """The RMS error of a velocity, and how like it is to that of the step before, by source.

        Of the first cluster, before the set in reach changes.
        """
        found: dict[str, tuple[float, float]] = {}
        for source in SOURCES:
            v = self._from(source)[1][0, : self.changes[1], 2:]
            rms = np.sqrt(np.nanmean(v**2))
            found[source] = float(rms), float(np.nanmean(v[1:] * v[:-1]) / rms**2)
        return found

    @cached_property
    def _by_run(self) -> dict[tuple[str, str], Array]:
        """The mean errors of source and method in the first reading, (4, runs)."""
        fusion = self.fusion
        found: dict[tuple[str, str], Array] = {}
        ins = fusion.drawn["ins"][..., _SMALL]
        for source in SOURCES:
            scene, network = self._from(source)
            R, y = scene.mean_covariance, ins[None] - network
            models = fusion.local_models(fusion.white, R)
            designs = [design_filter(m, solver=(fusion.solver, "clarabel")) for m in models]
            start = 0.1**2 * np.eye(4)
            federated = run_federated(
                models[0], y, measurement_covariance=R, initial_covariance=start, predicted=True
            )
            errors = {f"DHF, {rule}": e for rule, e in self.by_rules(designs, y).items()}
            for method, error in ({"FKF": ins - federated} | errors).items():
                found[source, method] = mean_absolute_error(error)
        return found

    @property
    def by_source(self) -> dict[tuple[str, str], Array]:
        """The mean errors of source and method in the first reading, medians of the runs, (4,)."""
        return {key: np.median(error, axis=1) for key, error in self._by_run.items()}

    @property
    def _drifts(self) -> Array:
        """The mean errors of the INS alone in the same runs, (4, runs)."""
        return np.asarray(mean_absolute_error(self.fusion.drawn["ins"][..., _SMALL]))

    @property
    def alone(self) -> Array:
        """Their medians, (4,)."""
        return np.median(self._drifts, axis=1)

    @property
    def remaining(self) -> dict[str, Array]:
        """What each rule leaves of INS-only and of FKF, velocities by a window, (2, 4)."""
        found = {m: errors for (s, m), errors in self.by_source.items() if s == "window"}
        rivals = np.stack([self.alone, found["FKF"]])
        rules = ("restart", "fading", "constant")
        return {rule: found[f"DHF, {rule}"] / rivals for rule in rules}

    @property
    def lowered(self) -> dict[str, Finding]:
        """``constant.AXIS``, how much constant weights lower INS-only, velocities by a window."""
        percent = 100 * (1 - self._by_run["window", "DHF, constant"] / self._drifts)
        how = (
            "Reduction of the mean absolute error of INS-only by DHF with constant weights, "
            "velocity from a window, {}: median and 95 % of the runs."
        )
        return {
            f"constant.{axis}": Finding.of_runs(found, "%", how.format(axis))
            for axis, found in zip(AXES, percent, strict=True)
        }

    def tabulate(self, printed: Mapping[str, Mapping[str, str]]) -> pd.DataFrame:
        """Return the table of sources and methods, with the percentages that are printed."""
        rows: dict[str, tuple[str, ...]] = {}
        for (source, method), errors in self.by_source.items():
            rivals = self.alone, self.by_source[source, "FKF"]
            ins, fkf = (_row(100 * (1 - errors / rival), 0) for rival in rivals)
            row = _row(errors, 2), ins, "–" if method == "FKF" else fkf
            rows[f"{source}: {method}"] = row
        rows["**as printed**"] = ("–", *printed_rows(printed))
        columns = [
            "mean error (m, m, m/s, m/s)",
            "by how much DHF lowers INS-only (%)",
            "and FKF (%)",
        ]
        table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
        return table.rename_axis("velocity from: method")

    def courses(self, first: FirstReading) -> dict[str, dict[str, Array]]:
        """Return RMS position errors at each step, in the first reading and tuned, by rule."""
        fusion = self.fusion
        y, tuned = fusion.measurements, fusion.local_designs(*fusion.chosen["dhf"])
        others = {"FKF": fusion.errors["fkf-reset"], "KF with bias": fusion.errors["kf-with-bias"]}
        errors = {
            "first reading": self.by_rules(first.designs, y),
            "tuned": self.by_rules(tuned, y) | others,
        }
        return {
            title: {
                rule: np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1), axis=1))
                for rule, error in each.items()
            }
            for title, each in errors.items()
        }

    def growth(self, courses: Mapping[str, Array]) -> dict[str, float]:
        """Return RMS errors in the 2 s after each change, over that before the first with restart.

        Before it one cluster is in reach; what is averaged is the second half of that time.
        """
        first, span = self.changes[1], int(2 / self.fusion.scene.period)
        after = np.zeros(len(self.patterns), dtype=bool)
        for k in self.changes[1:]:
            after[k : k + span] = True
        inside = courses["restart"][min(first // 2, first - 1) : first]
        before = np.mean(inside**2)
        return {
            rule: float(np.sqrt(np.mean(c[after] ** 2) / before)) for rule, c in courses.items()
        }


def printed_rows(printed: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Return the printed percentages against INS-only and FKF, each as a cell of a table."""
    return [", ".join(printed[axis][rival] for axis in AXES) for rival in ("vs_ins", "vs_fkf")]


def _row(values: Array, digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)
