"""What the crossed study computes at one point: headline results of a chapter, with few runs.

Each is a pure function of a point, the places of the factors that the chapter has, see `factors`.
They are named as in data/assumptions.yaml, and are computed as the chapters compute them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from factors import Crossing, Level, Point
from inswsn_book.evidence.fusion_percentages import FirstReading
from inswsn_book.evidence.fusion_theorem import TheoremReading

from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import search_pattern
from inswsn_lib.lmi import InfeasibleDesignError
from inswsn_lib.navigation import (
    BridgedOutages,
    ClusterFusion,
    FilterContest,
    LMIDesigns,
    TrainingAreas,
    VehicleOutages,
    planar_rms,
    relative_loss,
    table2_cells,
)
from inswsn_lib.navigation.bridged_outages import COASTING, judge_best
from inswsn_lib.navigation.filter_contest import PARTS, root_mean_square
from inswsn_lib.navigation.vehicle_outages import OUTAGE, outage_size
from inswsn_lib.scenario import Setting, with_values

#: Headlines of a chapter by their keys in data/assumptions.yaml
Outputs = dict[str, float]
#: Numbers from which the search for those of a filter begins, by its name
Starts = Mapping[str, Sequence[float]]
#: Numbers of a filter to what they cost
Loss = Callable[..., float]

#: Runs of a point. In p1-training and p1-outages a draw takes its time whatever their number is.
RUNS: dict[str, dict[str, int]] = {
    "p1-training": {"runs": 40, "other_runs": 40},
    "p1-outages": {"runs": 40, "tuning_runs": 4},
    "p2-fusion": {"runs": 8, "other_runs": 8},
    "p3-vehicle": {"routes": 2, "draws": 1},
}
#: The most trials that a filter has at a point, and in the published scene
TRIALS, TRIALS_AT_START = 5, 48
#: Numbers of each filter that are searched at a point, the same for all
SEARCHED = 2
# Where the searches in the published scene begin and the ratios of their steps, as in the chapters
_AREAS: dict[str, tuple[float, ...]] = {"Kalman": (1.0, 1.0), "HF, exact LMI": (1.0, 1.0)}
_AREA_STEPS = (10**0.5, 3.0)
_CLUSTERS: dict[str, tuple[float, ...]] = {
    "fkf": (1.0, 1.0),
    "bias": (0.03, 1.0),
    "dhf": (1.0, 1.0, 1.0, 1.0),
}
_CLUSTER_STEPS = (2.5, 10.0, 3.0, 3.0)


def outputs_at(crossing: Crossing, starts: Starts, chapter: str, point: Point) -> Outputs:
    """Return the headlines of a chapter at a point; none where it cannot be had."""
    changes = crossing.changes(chapter, point)
    compute: dict[str, Callable[[], Outputs]] = {
        "p1-lmi": lambda: {
            name: found.value
            for name, found in LMIDesigns(**_parameters("p1-lmi", changes)).findings().items()
        },
        "p1-training": lambda: areas(
            core_at(crossing, TrainingAreas(**RUNS["p1-training"]), "p1-training", changes), starts
        ),
        "p1-outages": lambda: outages(
            core_at(crossing, BridgedOutages(**RUNS["p1-outages"]), "p1-outages", changes)
        ),
        "p2-fusion": lambda: clusters(
            core_at(crossing, ClusterFusion(**RUNS["p2-fusion"]), "p2-fusion", changes), starts
        ),
        "p3-vehicle": lambda: drives(
            core_at(crossing, VehicleOutages(**RUNS["p3-vehicle"]), "p3-vehicle", changes)
        ),
    }
    try:
        return compute[chapter]()
    except InswsnError:  # as a design that is not feasible
        return {}


def core_at(crossing: Crossing, core: Any, chapter: str, changes: Level) -> Any:
    """Return a core with what a point sets."""
    settings: dict[str, Setting] = dict(core.published)
    for key, value in changes.items():
        scenario, name = key.split(".", 1)
        if scenario == "file":
            settings |= crossing.settings[value]
    named = {f.name for f in fields(core)}
    values = {}
    for key, value in changes.items():
        scenario, name = key.split(".", 1)
        if scenario in crossing.settings:
            values[name] = value
    # a parameter of a core stands in the place of the setting of its name
    shadowed = {name: value for name, value in values.items() if name in named}
    given = shadowed | _parameters(chapter, changes)
    return replace(core, published=with_values(settings, **values), **given)


def _parameters(chapter: str, changes: Level) -> dict[str, Any]:
    start = f"{chapter}."
    return {k.removeprefix(start): v for k, v in changes.items() if k.startswith(start)}


# p1-training --------------------------------------------------------------------------------------


def areas(core: TrainingAreas, starts: Starts) -> Outputs:
    """Return what Kalman filters have of the error of the published filter, and tuned HF over KF.

    The tuned ones are searched as in evidence p2-fusion, see `clusters`.
    """

    def cells(method: str) -> float:
        found = table2_cells(core.errors(method))
        return sum(float(np.median(cell)) for name, cell in found.items() if name[0] == "r")

    contest = FilterContest(core)

    def tuned(name: str) -> float:
        numbers = tune_filter(area_loss(contest, name), starts[name], _AREA_STEPS)
        errors = contest.errors(contest.build(name, *numbers), core.drawn)
        return float(np.mean([root_mean_square(e[:, PARTS["position"]]) for e in errors.values()]))

    published = cells("hf-printed-filtered")
    return {
        "headline.kf-share": 100 * cells("kf-matched-filtered") / published,
        "headline.identity-share": 100 * cells("kf-identity-filtered") / published,
        "fair.hf-exact-lmi.position/fair.kalman.position": tuned("HF, exact LMI") / tuned("Kalman"),
    }


def area_loss(contest: FilterContest, name: str) -> Loss:
    """Return what evidence p1-training tunes a filter by."""
    drawn = contest.areas.others

    def loss(*numbers: float) -> float:
        try:
            errors = contest.errors(contest.build(name, *numbers), drawn)
        except InfeasibleDesignError:  # numbers too far apart for the solver
            return np.inf
        return relative_loss(errors, drawn["wsn"])

    return loss


# p1-outages ---------------------------------------------------------------------------------------


def outages(core: BridgedOutages) -> Outputs:
    """Return what a coasting Kalman filter leaves, and the LS-SVM on the motion over it."""
    methods, passages = core.methods(("motion",)), list(core.judged.values())

    def left(name: str, kind: str) -> float:
        judged = judge_best(name, methods[name, kind], passages, core.rehearsals)
        return 100 * float(np.median(judged.shares.mean(axis=0)))

    coasting, machine = left(COASTING, "state"), left("LS-SVM", "motion")
    return {
        "fair.kalman-filter-coasting.state": coasting,
        "fair.ls-svm.motion": machine,
        "fair.ls-svm.motion/fair.kalman-filter-coasting.state": machine / coasting,
    }


# p2-fusion ----------------------------------------------------------------------------------------


def clusters(core: ClusterFusion, starts: Starts) -> Outputs:
    """Return P2's filter and a filter that knows of the bias over the federated filter, all tuned.

    Each filter begins with its numbers in the published scene, and has the same few trials for the
    first two of them. The weight and the margin of P2's filter stay: one trial of it costs as much
    as three of the others. And the true gain of the weights of (9) over the one that it promises.
    """
    promised, sizes = TheoremReading(FirstReading(core).designs), {}
    for name in _CLUSTERS:
        numbers = tune_filter(cluster_loss(core, name), starts[name], _CLUSTER_STEPS)
        error = core.drawn["ins"] - _made(core, name)(*numbers)(core.measurements)
        sizes[name] = np.median(planar_rms(error), axis=1)
    return {
        "fair.dhf-over-fkf.position": float(sizes["dhf"][0] / sizes["fkf"][0]),
        "fair.dhf-over-fkf.velocity": float(sizes["dhf"][1] / sizes["fkf"][1]),
        "fair.bias-over-fkf.position": float(sizes["bias"][0] / sizes["fkf"][0]),
        "theorem.true-scene/theorem.free-scene": promised.true / promised.own.gamma,
    }


def cluster_loss(core: ClusterFusion, name: str) -> Loss:
    """Return what evidence p2-fusion tunes a filter by: the geometric mean of both RMS errors."""
    ins = core.tuning["ins"]
    y = np.asarray(ins[None] - core.tuning["wsn"])

    def loss(*numbers: float) -> float:
        try:
            error = ins - _made(core, name)(*numbers)(y)
        except InfeasibleDesignError:
            return np.inf
        return float(np.prod(np.sqrt(np.nanmean(planar_rms(error) ** 2, axis=1))) ** 0.5)

    return loss


def _made(core: ClusterFusion, name: str) -> Callable[..., Any]:
    return {"fkf": core.federated, "bias": core.with_bias, "dhf": core.distributed}[name]


# p3-vehicle ---------------------------------------------------------------------------------------


def drives(core: VehicleOutages) -> Outputs:
    """Return what aids and the LS-SVM make of the error in 40 s, geometric means of outages."""
    found = core.errors_of(("never", "through", "lssvm", "rbf"))
    size = {name: np.log(outage_size(e[: OUTAGE + 1])[0]).mean() for name, e in found.items()}
    pairs = {
        "factor.through-never": ("through", "never"),
        "methods.lssvm": ("lssvm", "through"),
        "methods.lssvm/methods.rbf": ("lssvm", "rbf"),
    }
    return {key: float(np.exp(size[one] - size[other])) for key, (one, other) in pairs.items()}


# Tuning ------------------------------------------------------------------------------------------


def published_starts() -> dict[str, list[float]]:
    """Return all numbers of the filters tuned in the published scenes."""
    contest = FilterContest(TrainingAreas(**RUNS["p1-training"]))
    fusion = ClusterFusion(**RUNS["p2-fusion"])
    searches = [(area_loss(contest, n), n, b, _AREA_STEPS) for n, b in _AREAS.items()]
    searches += [(cluster_loss(fusion, n), n, b, _CLUSTER_STEPS) for n, b in _CLUSTERS.items()]
    return {
        name: list(tune_filter(loss, begin, steps, len(begin), TRIALS_AT_START))
        for loss, name, begin, steps in searches
    }


def tune_filter(
    loss: Loss,
    start: Sequence[float],
    steps: Sequence[float],
    searched: int = SEARCHED,
    most: int = TRIALS,
) -> tuple[float, ...]:
    """Return the numbers of a filter, the first of which are tuned; the others stay."""
    fixed = tuple(start[searched:])
    search = search_pattern(
        "filter", start[:searched], steps[:searched], lambda *found: loss(*found, *fixed), most=most
    )
    return (*search.best, *fixed)
