"""P1's Tables 1 and 3 cell by cell: rebuilt, and Table 3 with both learners tuned alike."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, mean_absolute_error
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


def table3_findings(cells: Mapping[str, Mapping[str, ArrayLike]]) -> dict[str, Finding]:
    """Return the medians of the cells by method and column, with the ends of 95 % of runs."""
    each = (_outage(f"table3.{m}", columns, METHODS[m]) for m, columns in cells.items())
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
        errors = dict(zip(names, compared[name, "motion"].shares * alone, strict=True))
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


def table1_findings(rows: Iterable[int], cells: Array) -> dict[str, Finding]:
    """Return the medians of the cells of Table 1, and of their means, by row.

    Parameters
    ----------
    rows : iterable of int
        The numbers of the rows.
    cells : ndarray, (rows, 4, runs)
        From `table1_cells`.
    """
    how = "Mean absolute error on the 50 points that trained"
    found: dict[str, Finding] = {}
    for row, errors in zip(rows, cells, strict=True):
        both = {"mean-position": errors[:2].mean(axis=0), "mean-velocity": errors[2:].mean(axis=0)}
        for name, values in (dict(zip(AXES, errors, strict=True)) | both).items():
            unit = "m" if name.startswith(("r", "mean-p")) else "m/s"
            words = f"{how}, {name}, row {row}: median over runs."
            found[f"table1.row{row:02d}.{name}"] = Finding.of_runs(values, unit, words)
    return found


def _outage(
    prefix: str, cells: Mapping[str, ArrayLike], words: str
) -> Iterator[tuple[str, Finding]]:
    for c, values in cells.items():
        how = f"Mean absolute error over outage {c[2]}, {c[:2]}, {words}: median over runs."
        unit = "m" if c[0] == "r" else "m/s"
        yield f"{prefix}.{c}", Finding.of_runs(values, unit, how)
