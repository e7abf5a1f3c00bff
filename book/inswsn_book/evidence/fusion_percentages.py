"""P2's percentages: rebuilt from the noise that it prints, and on equal terms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from inswsn_book.evidence import slug
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, Scores, mean_absolute_error
from inswsn_lib.filters import patterns_of, run_distributed, run_federated
from inswsn_lib.lmi import FilterDesign
from inswsn_lib.navigation.cluster_fusion import ClusterFusion, Pattern
from inswsn_lib.papers import AXES

#: The methods of P2
PRINTED = ("INS-only", "FKF", "DHF")
_RIVALS = {"vs-ins": "INS-only", "vs-fkf": "FKF"}
_MEANS = {"position": slice(0, 2), "velocity": slice(2, 4)}  # of the abstract


@dataclass(frozen=True, eq=False)
class FirstReading:
    """P2's filters with the two figures that it prints: white accelerometers, accuracy of fixes.

    Attributes
    ----------
    fusion : ClusterFusion
        The scene.
    """

    fusion: ClusterFusion

    @cached_property
    def designs(self) -> list[FilterDesign]:
        """The local H-infinity filters; L is the identity."""
        return self.fusion.local_designs(self.fusion.white, 1.0, 1.0)

    @cached_property
    def weights(self) -> dict[Pattern, Array]:
        """Those of P2 (9) for each set of clusters in reach."""
        return self.fusion.fused_weights(self.designs, patterns_of(self.fusion.measurements))

    @cached_property
    def errors(self) -> dict[str, Array]:
        """The errors of each of `PRINTED`, before the measurement of the step, (steps, 4, runs)."""
        fusion, model = self.fusion, self.designs[0].model
        ins, y = fusion.drawn["ins"], fusion.measurements
        federated = run_federated(
            model, y, predicted=True,
            measurement_covariance=np.stack([d.model.measurement_covariance for d in self.designs]),
            initial_covariance=0.1**2 * np.eye(4),  # P2 does not say; 0.1 m and 0.1 m/s
        )  # fmt: skip
        distributed = run_distributed(self.designs, y, weights=self.weights, predicted=True)
        return dict(zip(PRINTED, (ins, ins - federated, ins - distributed), strict=True))


def rebuild_percentages(first: FirstReading) -> dict[str, Finding]:
    """Return P2's reductions of mean errors by DHF: medians of the runs, the ends of 95 % of them.

    ``percent.PART.vs-RIVAL`` in the first reading, and ``fair.cells.PART.vs-RIVAL`` with both
    filters tuned alike, where the rival FKF has a reset; a part is one of P2's four components, or
    position or velocity, the mean of two, against FKF.

    Parameters
    ----------
    first : FirstReading
        In a scene of 40 runs or more.
    """
    fusion = first.fusion
    tuned = [fusion.drawn["ins"], fusion.errors["fkf-reset"], fusion.errors["dhf"]]
    return {
        **dict(_reductions("percent", first.errors, "first reading")),
        **dict(_reductions("fair.cells", dict(zip(PRINTED, tuned, strict=True)), "both tuned")),
    }


def _reductions(
    prefix: str, errors: Mapping[str, Array], words: str
) -> Iterator[tuple[str, Finding]]:
    cells = {name: mean_absolute_error(error) for name, error in errors.items()}
    found = {key: 100 * (1 - cells["DHF"] / cells[rival]) for key, rival in _RIVALS.items()}
    ends = f"{words}: median and 95 % of the runs."
    for i, axis in enumerate(AXES):
        for key, rival in _RIVALS.items():
            said = "Reduction (below zero an increase) of the mean absolute error of"
            how = f"{said} {rival} by DHF, {axis}, {ends}"
            yield f"{prefix}.{axis}.{key}", Finding.of_runs(found[key][i], "%", how)
    for part, rows in _MEANS.items():
        how = f"Mean over x and y of the reductions of the {part} error of FKF by DHF, {ends}"
        yield (
            f"{prefix}.{part}.vs-fkf",
            Finding.of_runs(found["vs-fkf"][rows].mean(axis=0), "%", how),
        )


def errors_of_first(first: FirstReading) -> dict[str, Finding]:
    """Return ``first.METHOD.AXIS``, mean absolute errors of the first reading, over the runs."""
    found = {}
    for method, errors in first.errors.items():
        for axis, error in zip(AXES, mean_absolute_error(errors), strict=True):
            how = (
                f"Mean absolute error of {method}, {axis}, first reading: median and 95 % of the"
                " runs."
            )
            unit = "m" if axis.startswith("r") else "m/s"
            found[f"first.{method.lower()}.{axis}"] = Finding.of_runs(error, unit, how)
    return found


def errors_of_methods(scores: Scores) -> dict[str, Finding]:
    """Return ``METHOD.PART``, RMS errors of the tuned methods, over the runs."""
    found = {}
    for key, name in scores.methods.items():
        for part, unit in scores.columns.items():
            how = f"RMS {part} error of {name}, tuned: median and 95 % of the runs."
            error = scores.of(key, part)
            found[f"{slug(name)}.{part}"] = Finding.of_runs(error, unit, how)
    return found
