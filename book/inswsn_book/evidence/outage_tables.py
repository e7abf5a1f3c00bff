"""P1's Tables 1 and 3 cell by cell: rebuilt, and Table 3 with both learners tuned alike."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product, starmap
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from sklearn.dummy import DummyRegressor
from sklearn.linear_model import LinearRegression

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, Score, mean_absolute_error, score_hypothesis, tune
from inswsn_lib.learning import LSSVMRegressor
from inswsn_lib.navigation.bridged_outages import (
    HEADLINES,
    BridgedOutages,
    Judged,
    Passage,
    judge_best,
    share_findings,
)
from inswsn_lib.papers import AXES, COLUMNS

#: The methods of Table 3 by the names of its findings
METHODS = {"ins": "INS-only", "bp": "BP", "lssvm": "LS-SVM"}
#: The learners that stand for BP and LS-SVM on equal terms, on the motion
EQUAL = {"bp": "BP", "ls-svm": "LS-SVM"}
#: Remaining errors in the outages by area, each (steps, 4, runs)
Left = Mapping[str, Array]


def rebuild_table3(outages: BridgedOutages) -> dict[str, Finding]:
    """Return the cells of P1's Table 3: medians of the runs with the ends of 95 % of them.

    ``table3.METHOD.CELL`` for `METHODS`, the learners with their settings of then, fed with the
    true error of the INS; ``fair.cells.LEARNER.CELL`` for `EQUAL`, tuned alike by rehearsal, fed
    with the indicated motion. Then what is left of the error of the INS, `share_findings`.
    """
    passages, methods = [*outages.judged.values()], outages.methods(("motion",))
    compared = {
        key: judge_best(key[0], methods[key], passages, outages.rehearsals) for key in HEADLINES
    }
    left = bridge_as_printed(outages, outages.passages(outages.drawn))
    cells = {method: table3_cells(errors) for method, errors in left.items()}
    equal = equal_findings(passages, compared)
    return table3_findings(cells) | equal | share_findings(compared)


def bridge_as_printed(
    outages: BridgedOutages, passages: Mapping[str, Passage]
) -> dict[str, dict[str, Array]]:
    """Return the remaining errors of `METHODS` in the outages: by method, then as `Left`.

    Parameters
    ----------
    outages : BridgedOutages
    passages : mapping of str to Passage
        By area.
    """
    machines = {"bp": outages.toolbox, "lssvm": outages.printed}
    return {"ins": {a: p.error[p.heard :] for a, p in passages.items()}} | {
        name: {a: outages.bridge(p, machine, "oracle", scaled=False) for a, p in passages.items()}
        for name, machine in machines.items()
    }


def table3_cells(left: Left) -> dict[str, Array]:
    """Return the mean absolute errors of every run by column of Table 3, each (runs,)."""
    means = {a: mean_absolute_error(errors) for a, errors in left.items()}
    return {c: means[c[2]][AXES.index(c[:2])] for c in COLUMNS}


def medians(cells: Mapping[str, ArrayLike]) -> Array:
    """Return the medians of cells over their runs."""
    return np.array([np.median(np.asarray(values)) for values in cells.values()])


def table3_findings(
    cells: Mapping[str, Mapping[str, ArrayLike]], reading: str = ""
) -> dict[str, Finding]:
    """Return the medians of the cells by method and column, with the ends of 95 % of runs.

    What was read otherwise is told behind the method.
    """
    end = f", {reading}" if reading else ""
    each = (_outage(f"table3.{m}", columns, METHODS[m] + end) for m, columns in cells.items())
    return {name: finding for found in each for name, finding in found}


def equal_findings(
    passages: Sequence[Passage], compared: Mapping[tuple[str, str], Judged]
) -> dict[str, Finding]:
    """Return the cells of Table 3 of the learners of `EQUAL`, tuned alike, fed with the motion.

    Parameters
    ----------
    passages : sequence of Passage
        Those in which the learners were judged.
    compared : mapping of tuple to Judged
        Methods by name and input, as `BridgedOutages.compare` gives them.
    """
    alone = np.concatenate([mean_absolute_error(p.error[p.heard :]) for p in passages])
    names = [axis + p.area for p in passages for axis in AXES]
    found: dict[str, Finding] = {}
    for slug, name in EQUAL.items():
        drawn = np.moveaxis(compared[name, "motion"].drawn * alone, 1, 0)
        errors = dict(zip(names, drawn, strict=True))
        found |= _outage(f"fair.cells.{slug}", errors, f"{name} on the motion, tuned")
    return found


def rebuild_table1(
    outages: BridgedOutages, pairs: Mapping[int, tuple[float, float]]
) -> dict[str, Finding]:
    """Return the cells of P1's Table 1, read to the letter: medians with the ends of 95 % of runs.

    ``table1.rowNN.AXIS`` is the mean absolute error on the first half of area 1, which trained the
    machine, nothing scaled, and ``table1.rowNN.mean-position`` and ``-velocity`` the mean of two.

    Parameters
    ----------
    outages : BridgedOutages
    pairs : mapping of int to tuple of two floats
        Kernel width and regularisation by the number of the row.
    """
    passage = outages.passage(outages.drawn, "1")
    first = np.arange(passage.heard // 2)
    return table1_findings(pairs, table1_cells(passage, pairs.values(), first, first))


def table1_cells(
    passage: Passage,
    pairs: Iterable[tuple[float, float]],
    train: ArrayLike,
    score: ArrayLike,
    *,
    scaled: bool = False,
    runs: int | None = None,
    width: Callable[[float], float] = float,
) -> Array:
    """Return mean absolute errors of an LS-SVM fed with the true error, (pairs, 4, runs).

    Parameters
    ----------
    passage : Passage
    pairs : iterable of tuple of two floats
        Kernel width and regularisation.
    train, score : array_like of int
        The samples that train the machine, and those on which it is judged.
    scaled : bool
        Whether inputs and targets have mean 0 and deviation 1 on the samples that train.
    runs : int, optional
        How many of the runs; all if not given.
    width : callable
        Makes the width of the kernel of a printed one.
    """
    train, score = np.asarray(train), np.asarray(score)

    def in_units(values: Array) -> tuple[Array, Array]:
        if not scaled:
            return values, np.ones(1)
        size = values[train].std(axis=0)
        return (values - values[train].mean(axis=0)) / size, size

    pairs = [*pairs]
    cells = np.empty((len(pairs), len(AXES), runs or passage.error.shape[2]))
    for r in range(cells.shape[2]):
        X, _ = in_units(passage.error[: passage.heard, :, r])
        Y, size = in_units(passage.y[: passage.heard, :, r])
        for i, (sigma, eta) in enumerate(pairs):
            machine = LSSVMRegressor(width(sigma), eta).fit(X[train], Y[train])
            cells[i, :, r] = np.abs(machine.predict(X[score]) - Y[score]).mean(axis=0) * size
    return cells


def table1_findings(rows: Iterable[int], cells: Array, reading: str = "") -> dict[str, Finding]:
    """Return the medians of the cells of Table 1, and of their means, by row.

    Parameters
    ----------
    rows : iterable of int
        The numbers of the rows.
    cells : ndarray, (rows, 4, runs)
        From `table1_cells`.
    reading : str
        What was read otherwise.
    """
    how = "Mean absolute error on the 50 points that trained"
    end = f", {reading}: median over runs." if reading else ": median over runs."
    found: dict[str, Finding] = {}
    for row, errors in zip(rows, cells, strict=True):
        both = {"mean-position": errors[:2].mean(axis=0), "mean-velocity": errors[2:].mean(axis=0)}
        for name, values in (dict(zip(AXES, errors, strict=True)) | both).items():
            unit = "m" if name.startswith(("r", "mean-p")) else "m/s"
            words = f"{how}, {name}, row {row}{end}"
            found[f"table1.row{row:02d}.{name}"] = Finding.of_runs(values, unit, words)
    return found


def _outage(
    prefix: str, cells: Mapping[str, ArrayLike], words: str
) -> Iterator[tuple[str, Finding]]:
    for c, values in cells.items():
        how = f"Mean absolute error over outage {c[2]}, {c[:2]}, {words}: median over runs."
        unit = "m" if c[0] == "r" else "m/s"
        yield f"{prefix}.{c}", Finding.of_runs(values, unit, how)


class Reading(NamedTuple):
    """A reading of Table 1: by which points, in which units, and what sigma is the width of."""

    area: str
    points: str
    scaled: bool
    width: str

    def __str__(self) -> str:
        scaled = ", scaled" if self.scaled else ""
        return f"area {self.area}, {self.points}{scaled}{self.width}"


#: What reads the printed sigma, and the factor and power that make the width of it
WIDTHS = {"": (1.0, 1.0), ", kernel exp(-d²/2σ)": (1.0, 0.5), ", kernel exp(-d²/σ)": (0.5, 0.5)}
SQUARE = ", kernel exp(-d²/2σ)"
LETTER = "trained and scored on the first 50"
#: Readings of sigma and of the scaling, by the prefix of their findings
OTHERS = {
    "scaled.": ("scaled", True, ""),
    "square.": ("sigma the square of the width", False, SQUARE),
    "square-scaled.": ("scaled, sigma the square of the width", True, SQUARE),
}


def table1_readings(
    passages: Mapping[str, Passage], pairs: Sequence[tuple[float, float]], runs: int
) -> dict[Reading, Array]:
    """Return the cells of Table 1 by all readings, each (pairs, 4, runs).

    Parameters
    ----------
    passages : mapping of str to Passage
        By area.
    pairs : sequence of tuple of two floats
        Kernel width and regularisation.
    runs : int
    """
    every = np.arange(passages["1"].heard)
    first, rest = np.split(every, 2)
    points = {
        LETTER: (first, first),
        "trained on the first 50, scored on the other 50": (first, rest),
        "trained and scored on all 100": (every, every),
        "trained on every second point, scored on the others": (every[::2], every[1::2]),
    }
    found = {}
    for reading in starmap(Reading, product(passages, points, (False, True), WIDTHS)):
        factor, power = WIDTHS[reading.width]
        found[reading] = table1_cells(
            passages[reading.area], [((factor * s) ** power, eta) for s, eta in pairs],
            *points[reading.points], scaled=reading.scaled, runs=runs,
        )  # fmt: skip
    return found


def median_findings(
    start: str, names: Iterable[str], runs: Iterable[ArrayLike]
) -> dict[str, Finding]:
    """Return medians of runs with 95 % intervals of the medians: for a mean of many runs."""
    medians = {}
    for name, values in zip(names, runs, strict=True):
        ordered = np.sort(np.asarray(values))
        low, high = stats.binom.ppf([0.025, 0.975], len(ordered), 0.5).astype(int)
        ends = ordered[low], ordered[min(high, len(ordered) - 1)]
        how = f"Median over runs of {start}.{name}, with an interval of the median."
        unit = "m" if name[0] == "r" else "m/s"
        medians[f"median.{start}.{name}"] = Finding(float(np.median(ordered)), *ends, unit, how)
    return medians


def bridge_otherwise(
    outages: BridgedOutages, passages: Mapping[str, Passage]
) -> dict[str, dict[str, Array]]:
    """Return the remaining errors of the LS-SVM by the readings of `OTHERS`, as `Left`."""
    found = {}
    for prefix, (_, scaled, width) in OTHERS.items():
        machine = LSSVMRegressor(outages.sigma ** WIDTHS[width][1], outages.eta)
        found[prefix] = {
            a: outages.bridge(p, machine, "oracle", scaled=scaled) for a, p in passages.items()
        }
    return found


def claims_counted(cells: Mapping[str, Mapping[str, ArrayLike]]) -> dict[str, int]:
    """Return in how many columns the medians are as P1's sentences say, by name.

    Parameters
    ----------
    cells : mapping of str to mapping
        Those of `METHODS`, as `table3_cells` gives them.
    """
    ins, bp, own = (dict(zip(COLUMNS, medians(cells[method]), strict=True)) for method in METHODS)
    ordered = [c for c in COLUMNS if own[c] < bp[c] < ins[c] and c[2] == "1"]
    return {
        "lssvm-smallest": sum(bool(own[c] < min(ins[c], bp[c])) for c in COLUMNS),
        "lssvm-below-ins": sum(bool(own[c] < ins[c]) for c in COLUMNS),
        "lssvm-below-bp": sum(bool(own[c] < bp[c]) for c in COLUMNS),
        "second-outage-halved": sum(bool(own[c] <= bp[c] / 2) for c in COLUMNS if c[2] == "2"),
        "first-outage.position-smallest": sum(c[0] == "r" for c in ordered),
        "first-outage.velocity-smallest": sum(c[0] == "v" for c in ordered),
    }


def reduction_findings(lssvm: Left, bp: Left, words: str) -> dict[str, Finding]:
    """Return by how much the LS-SVM lowers the errors of BP, and how much more BP fluctuates."""
    own, rival = table3_cells(lssvm), table3_cells(bp)
    found = {
        f"table3.reduction.{c}": Finding.of_runs(
            100 * (1 - own[c] / rival[c]), "%",
            f"Reduction of the mean error of BP, {c}, {words}: median over runs.",
        )
        for c in ("rx1", "ry1", "vx2", "vy2")
    }  # fmt: skip
    how = "RMS of the velocity error in outage 1 about a straight line in time, BP over LS-SVM"
    ratio = _wiggle(bp["1"]) / _wiggle(lssvm["1"])
    return found | {"table3.fluctuation": Finding.of_runs(ratio, "1", f"{how}, {words}: median.")}


def _wiggle(error: Array) -> Array:
    """Return the RMS of the velocity error about a straight line in time, by run."""
    e, t = error[:, 2:], np.arange(len(error)) - (len(error) - 1) / 2
    line = e.mean(axis=0) + t[:, None, None] * np.tensordot(t, e, 1) / (t @ t)
    return np.asarray(np.sqrt(((e - line) ** 2).mean(axis=0)).mean(axis=0))


#: Numbers that are tried where a hypothesis has a free one
_FREE = {
    "a share of INS-only": np.geomspace(0.01, 1, 41),
    "ridge on the four errors, scaled, its strength fitted": np.geomspace(1e-3, 1e3, 19),
}
SHARE, RIDGE = _FREE
LEAST_SQUARES, PLAIN = "least squares on the four errors", "as printed, nothing scaled"
_ROOT = r"kernel $\exp(-d^2/\sigma^2)$ with $\sigma^2 = 1000$"
#: The readings of the LS-SVM of which there are both scaled and unscaled ones, and no ridge
FIVE = (PLAIN, "as printed, scaled to deviation 1", f"{_ROOT}, nothing scaled", f"{_ROOT}, scaled",
        LEAST_SQUARES)  # fmt: skip


class Hypothesis(NamedTuple):
    """What a row of Table 3 may be: its cells, how near they are, and the number fitted to it."""

    cells: dict[str, Array]
    score: Score
    number: float | None


def score_rows(
    outages: BridgedOutages, passages: Mapping[str, Passage], printed: Mapping[str, ArrayLike]
) -> dict[tuple[str, str], Hypothesis]:
    """Return hypotheses on the rows of BP and of LS-SVM in Table 3, by row and name: nearest first.

    Parameters
    ----------
    outages : BridgedOutages
    passages : mapping of str to Passage
        By area.
    printed : mapping of str to array_like, (8,)
        The printed cells by row.
    """

    def scored(row: str, left: Left, number: float | None = None) -> Hypothesis:
        cells = table3_cells(left)
        free = int(number is not None)
        return Hypothesis(cells, score_hypothesis(medians(cells), printed[row], free), number)

    def fitted(row: str, name: str, bridged: Callable[[float], Left]) -> Hypothesis:
        best = tune(name, [*_FREE[name]], lambda v: scored(row, bridged(v)).score.spread).best
        return scored(row, bridged(best), best)

    def bridged(machine: Any, kind: str = "oracle", **options: Any) -> Left:
        return {a: outages.bridge(p, machine, kind, **options) for a, p in passages.items()}

    def share(number: float) -> Left:
        return {a: number * p.error[p.heard :] for a, p in passages.items()}

    def ridge(strength: float) -> Left:
        return bridged(LSSVMRegressor(1.0, 1 / strength, "linear"))

    def one_by_one() -> Left:
        """Return the errors of the printed machine, each output from its own input alone."""
        left = {}
        for a, p in passages.items():
            hybrid = outages.navigator(a, outages.printed, "oracle", scaled=False)
            ran = [hybrid.run(p.y, p.error[:, [i]]).estimates[:, i] for i in range(4)]
            left[a] = (p.error - np.stack(ran, axis=1))[p.heard :]
        return left

    def fixes() -> Left:
        shapes = {a: p.error[p.heard :].shape for a, p in passages.items()}
        return {
            a: outages.drawn[f"wsn.area{a}"][:steps, :, :runs]
            for a, (steps, _, runs) in shapes.items()
        }

    found = {("BP", name): scored("BP", bridged(*what, scaled=False))
             for name, what in _networks(outages).items()}  # fmt: skip
    found |= {("LS-SVM", name): scored("LS-SVM", bridged(machine, kind, scaled=scaled))
              for name, (machine, kind, scaled) in _machines(outages).items()}  # fmt: skip
    means: dict[str, dict[str, Any]] = {
        "the mean of the training targets": {},
        "the last correction, held": _LAST,
    }
    found |= {("BP", name): scored("BP", bridged(DummyRegressor(), **options))
              for name, options in means.items()}  # fmt: skip
    own = "as printed, each output from its own input, nothing scaled"
    found |= {
        ("LS-SVM", own): scored("LS-SVM", one_by_one()),
        ("LS-SVM", "no outage: the network itself"): scored("LS-SVM", fixes()),
        ("LS-SVM", RIDGE): fitted("LS-SVM", RIDGE, ridge),
        ("LS-SVM", SHARE): fitted("LS-SVM", SHARE, share),
        ("BP", SHARE): fitted("BP", SHARE, share),
    }
    return dict(sorted(found.items(), key=lambda item: item[1].score.spread))


_LAST = {"window": 1, "least": 1}
#: Plain gradient descent, in place of what a toolbox of 2011 does
DESCENT: dict[str, Any] = {
    "trainer": "gradient-descent", "learning_rate": 0.01, "epochs": 1000, "validation_share": 0.0,
}  # fmt: skip


def network(outages: BridgedOutages, **options: Any) -> Any:
    """Return the network of the toolbox with other options."""
    return type(outages.toolbox)(**outages.toolbox.get_params() | options)


def _networks(outages: BridgedOutages) -> dict[str, tuple[Any, str]]:
    toolbox, descent = "toolbox of 2011", "gradient descent, rate 0.01, 1,000 steps"
    changed: dict[str, dict[str, Any]] = {
        f"{toolbox}: Levenberg-Marquardt, scaled, early stopping": {},
        f"{toolbox} without early stopping": {"validation_share": 0.0},
        f"{toolbox}, nothing scaled": {"scaling": "none"},
        f"{toolbox}, 5 neurons": {"hidden": 5},
        f"{toolbox}, 20 neurons": {"hidden": 20},
        f"{descent}, scaled": DESCENT,
        f"{descent}, nothing scaled": DESCENT | {"scaling": "none"},
    }
    kinds = {"time": "time", "motion": "motion", "last state": "state"}
    return {name: (network(outages, **options), "oracle") for name, options in changed.items()} | {
        f"{toolbox}, input: {words}": (outages.toolbox, kind) for words, kind in kinds.items()
    }


def _machines(outages: BridgedOutages) -> dict[str, tuple[Any, str, bool]]:
    printed, root = outages.printed, LSSVMRegressor((1000 / 2) ** 0.5, outages.eta)
    five = product((printed, root), (False, True))
    best = r"$\sigma = 1$, $\eta = 1000$, best of Table 1, nothing scaled"
    found: dict[str, tuple[Any, str, bool]] = {
        name: (m, "oracle", s) for name, (m, s) in zip(FIVE[:4], five, strict=True)
    }
    return found | {
        best: (LSSVMRegressor(1.0, 1000.0), "oracle", False),
        "as printed, input: time in s": (printed, "time", False),
        "as printed, input: motion, nothing scaled": (printed, "motion", False),
        "as printed, input: last state, nothing scaled": (printed, "state", False),
        LEAST_SQUARES: (LinearRegression(), "oracle", True),
    }
