"""P1's Table 2 cell by cell: rebuilt, on equal terms, and with the errors of recorded fixes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, quotient
from inswsn_lib.navigation.filter_contest import FilterContest
from inswsn_lib.navigation.training_areas import (
    AREAS,
    ByArea,
    table2_cells,
    table2_findings,
)
from inswsn_lib.papers import AXES, COLUMNS

#: The methods of Table 2 as rebuilt, by the names of `TrainingAreas.estimate`
REBUILT = {
    "ins": "INS-only",
    "kf-matched-filtered": "KF with matched noise, filtered",
    "hf-printed-predicted": "HF with the printed matrices, predicted",
}
#: The filters that stand for KF and HF on equal terms, by the names of `FilterContest`
EQUAL = {"kalman": "Kalman", "hf-exact-lmi": "HF, exact LMI"}
#: What P1's reductions from KF to HF are held against: words, and the methods that are KF and HF,
#: by what stands before the names; the first decides the claims
RIVALS = {
    "": ("KF, matched, filtered", "kf-matched-filtered", "hf-printed-filtered"),
    "predicted.": ("KF, matched, predicted", "kf-matched-predicted", "hf-printed-predicted"),
    "identity.": ("KF, $Q = R = I$, filtered", "kf-identity-filtered", "hf-printed-filtered"),
    "zero.": ("KF, state set to zero", "kf-zero", "hf-printed-predicted"),
}
_ACCURACY = 0.2  # m, of P1's fixes, to which recorded errors are scaled


def rebuild_table2(contest: FilterContest, recorded: Array) -> dict[str, Finding]:
    """Return the cells of P1's Table 2: medians of the runs with the ends of 95 % of them.

    ``table2.METHOD.CELL`` for the methods of `REBUILT`; ``fair.cells.FILTER.CELL`` for those of
    `EQUAL`, tuned alike, filtered; ``recorded.cells.FILTER.CELL``, the same filters where the fixes
    have recorded errors, for positions alone. And what they amount to: `table2_findings`, and, as
    ``fair.cells.hf-over-kalman``, ``-network`` and ``recorded.…``, ratios of sums of medians.

    Parameters
    ----------
    contest : FilterContest
        The scene, its filters and their searches.
    recorded : ndarray, (fixes, 2)
        Errors of recorded fixes, from `recorded_errors`.
    """
    areas = contest.areas
    methods = [*REBUILT, "kf-identity-filtered", "hf-printed-filtered", "hf-exact-matched-filtered"]
    cells = {method: table2_cells(areas.errors(method)) for method in methods}
    found = {
        name: finding
        for method, words in REBUILT.items()
        for name, finding in _cells(f"table2.{method}", cells[method], words)
    }
    drawn = areas.drawn
    emulated = with_recorded(drawn, recorded, np.random.default_rng([areas.seed, 14]))
    ratios = {}
    for source, runs, words in (
        ("fair", drawn, "tuned, filtered"),
        ("recorded", emulated, "tuned for white errors, filtered, fixes with recorded errors"),
    ):
        positions = {"network": _positions(table2_cells(runs["wsn"]))}
        for slug, name in EQUAL.items():
            tuned = contest.build(name, *contest.tuning(name).best)
            errors = table2_cells(contest.errors(tuned, runs))
            positions[slug] = _positions(errors)
            kept = errors if source == "fair" else positions[slug]
            found |= dict(_cells(f"{source}.cells.{slug}", kept, f"{name}, {words}"))
        for rival, its in (("kalman", "those of a Kalman filter"), ("network", "the network's")):
            ratios[f"{source}.cells.hf-over-{rival}"] = quotient(
                [*positions["hf-exact-lmi"].values()], [*positions[rival].values()], "1",
                f"Position cells of HF, exact LMI, over {its}, {words}, sums of medians.",
            )  # fmt: skip
    return table2_findings(cells) | ratios | found


def reduce_errors(cells: Mapping[str, ByArea]) -> dict[str, Finding]:
    """Return by how much HF lowers the errors of KF, and which orderings of Section 5.3 come out.

    Parameters
    ----------
    cells : mapping
        Of the methods of `RIVALS` and of ``ins``, from `table2_cells`.
    """
    found = {}
    middle = {m: {c: float(np.median(v)) for c, v in of.items()} for m, of in cells.items()}
    for prefix, (label, kf, hf) in RIVALS.items():
        words = label.replace("$", "")
        for axis in AXES:
            column = f"{axis}1"
            share = 100 * (1 - cells[hf][column] / cells[kf][column])
            low, value, high = (float(x) for x in np.quantile(share, [0.025, 0.5, 0.975]))
            how = f"Reduction of the mean error {axis} of area 1 from KF to HF, {words}: median."
            found[f"{prefix}percent.{axis}"] = Finding(value, low, high, "%", how)
        k, h, i = middle[kf], middle[hf], middle["ins"]
        for name, count, how in (
            (
                "first-area.position-ordered",
                sum(h[c] < k[c] < i[c] for c in ("rx1", "ry1")),
                "Position columns of area 1 in which HF is below KF, and KF below INS-only",
            ),
            (
                "first-area.velocity-smallest",
                sum(h[c] < min(k[c], i[c]) for c in ("vx1", "vy1")),
                "Velocity columns of area 1 in which HF is below KF and INS-only",
            ),
            (
                "second-area.halved",
                sum(h[c] <= k[c] / 2 for c in COLUMNS if c[2] == "2"),
                "Columns of area 2 in which HF has at most half of the error of KF",
            ),
        ):
            told = f"{how}, medians, {words}."
            found[f"{prefix}percent.{name}"] = Finding(count, count, count, "columns", told)
    return found


def recorded_errors(path: Path) -> Array:
    """Return the errors of recorded fixes by radio, (fixes, 2), m, as accurate as P1's.

    Parameters
    ----------
    path : Path
        The kept study of recorded fixes, ``recorded/uwb-fixes.json`` of the data.
    """
    kept = json.loads(path.read_text(encoding="utf-8"))["horizontal_errors"]
    series = np.array([each for each in kept if each is not None], dtype=float)
    return np.asarray(series * _ACCURACY / np.sqrt((series**2).sum(axis=1).mean()))


def with_recorded(
    drawn: Mapping[str, ByArea], recorded: Array, rng: np.random.Generator
) -> dict[str, ByArea]:
    """Return drawn errors whose fixes have those of a recording, windows from random starts.

    Parameters
    ----------
    drawn : mapping
        As `TrainingAreas.drawn`.
    recorded : ndarray, (fixes, 2)
        In the order of the recording, or in another one.
    rng : numpy.random.Generator
    """
    network = {a: drawn["wsn"][a].copy() for a in AREAS}
    for errors in network.values():
        for run in range(errors.shape[2]):
            first = rng.integers(len(recorded) - len(errors))
            errors[:, :2, run] = recorded[first : first + len(errors)]
    return {**drawn, "wsn": network}


def _positions(cells: ByArea) -> ByArea:
    return {column: cell for column, cell in cells.items() if column[0] == "r"}


def _cells(prefix: str, cells: ByArea, words: str) -> Iterator[tuple[str, Finding]]:
    for column in COLUMNS:
        if column in cells:
            how = f"Mean absolute error over area {column[2]}, {column[:2]}, {words}: median."
            unit = "m" if column[0] == "r" else "m/s"
            yield f"{prefix}.{column}", Finding.of_runs(cells[column], unit, how)
