"""P1's Table 2 cell by cell: rebuilt, on equal terms, and with the errors of recorded fixes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import pandas as pd
from scipy.optimize import curve_fit

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, autocorrelation, quotient
from inswsn_lib.navigation.filter_contest import FilterContest
from inswsn_lib.navigation.training_areas import AREAS, ByArea, table2_cells, table2_findings
from inswsn_lib.papers import AXES, COLUMNS

if TYPE_CHECKING:  # in a page that runs its cells there are no verdicts
    from inswsn_book.judge.verdicts import Judged

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
#: Cells to which the simulation was fitted, or which were in view when a number was chosen
CALIBRATED = {
    "ins": set(COLUMNS) - {"vx2", "vy2"},
    "hf-printed-predicted": {c for c in COLUMNS if c[0] == "v"},
}
_ACCURACY = 0.2  # m, of P1's fixes, to which recorded errors are scaled


def cells_by_role(
    cells: Mapping[str, ByArea], methods: Mapping[str, str]
) -> dict[Literal["found", "calibrated"], dict[str, Finding]]:
    """Return the medians of the cells of methods, ``table2.METHOD.CELL``, by what they are."""
    every = {
        (method, name.rpartition(".")[2]): (name, finding)
        for method, words in methods.items()
        for name, finding in _cells(f"table2.{method}", cells[method], words.replace("$", ""))
    }
    fitted = {key for key in every if key[1] in CALIBRATED.get(key[0], ())}
    return {
        "found": dict(every[key] for key in every if key not in fitted),
        "calibrated": dict(every[key] for key in every if key in fitted),
    }


def table_of_verdicts(judged: Iterable[Judged]) -> pd.DataFrame:
    """Return the claims on Table 2, printed and rebuilt."""
    rows = {}
    for entry in judged:
        claim, q = entry.claim, entry.quantity
        if q is None or q.interval is None:
            continue
        low, high = q.interval
        rows[f"[{claim.id.removeprefix('P1-T2-')}](#{claim.anchor})"] = {
            "printed": claim.value,
            "rebuilt, median": f"{q.value:.3f}",
            "95 % of runs": f"{low:.3f} to {high:.3f}",
            "rebuilt over printed": f"{q.value / float(str(claim.value)):.2f}",
            "verdict": str(entry.verdict),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("cell")


def table_of_methods(
    middle: Mapping[str, Mapping[str, float]], methods: Mapping[str, str]
) -> pd.DataFrame:
    """Return the medians of every method in the columns of Table 2."""
    rows = {
        methods[key]: {f"${c[0]}_{c[1]}$, No. {c[2]}": f"{cells[c]:.3f}" for c in COLUMNS}
        for key, cells in middle.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("method")


def table_of_reductions(
    stated: Mapping[str, str],
    printed: Mapping[str, Mapping[str, float]],
    reductions: Mapping[str, Finding],
) -> pd.DataFrame:
    """Return the reductions from KF to HF in area 1 as stated, as printed, and as rebuilt."""
    shares = [1 - printed["HF"][c + "1"] / printed["KF"][c + "1"] for c in AXES]
    rows = {
        "stated in the text": [f"{stated[c]} %" for c in AXES],
        "from the printed Table 2": [f"{100 * share:.1f} %" for share in shares],
    } | {
        f"rebuilt, {label}": [f"{reductions[f'{prefix}percent.{c}'].value:.0f} %" for c in AXES]
        for prefix, (label, *_) in RIVALS.items()
    }
    columns = [f"${c[0]}_{c[1]}$" for c in AXES]
    table = pd.DataFrame.from_dict(rows, orient="index", columns=columns)
    return table.rename_axis("reduction from KF to HF, area 1")


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
    """Return by how much HF lowers the errors of KF in area 1, for each of `RIVALS`.

    Parameters
    ----------
    cells : mapping
        Of the methods of `RIVALS`, from `table2_cells`.
    """
    found = {}
    for prefix, (label, kf, hf) in RIVALS.items():
        words = label.replace("$", "")
        for axis in AXES:
            share = 100 * (1 - cells[hf][f"{axis}1"] / cells[kf][f"{axis}1"])
            how = f"Reduction of the mean error {axis} of area 1 from KF to HF, {words}: median."
            found[f"{prefix}percent.{axis}"] = Finding.of_runs(share, "%", how)
    return found


def count_orderings(cells: Mapping[str, ByArea]) -> dict[tuple[str, str], int]:
    """Return in how many columns the orderings of Section 5.3 come out, by rival and ordering.

    Parameters
    ----------
    cells : mapping
        As in `reduce_errors`, and of ``ins``.
    """
    found: dict[tuple[str, str], int] = {}
    middle = {m: {c: float(np.median(v)) for c, v in of.items()} for m, of in cells.items()}
    i, second = middle["ins"], [c for c in COLUMNS if c[2] == "2"]
    for prefix, (_, kf, hf) in RIVALS.items():
        k, h = middle[kf], middle[hf]
        found |= {
            (prefix, "first-area.position-ordered"): sum(
                h[c] < k[c] < i[c] for c in ("rx1", "ry1")
            ),
            (prefix, "first-area.velocity-smallest"): sum(
                h[c] < min(k[c], i[c]) for c in ("vx1", "vy1")
            ),
            (prefix, "second-area.halved"): sum(h[c] <= k[c] / 2 for c in second),
        }
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


def fit_correlation(recorded: Array) -> tuple[Array, list[tuple[float, float]]]:
    """Return the autocorrelation of recorded errors up to 5 s, and the share and time of each axis.

    The share of the variance lasts as a Gauss-Markov process of this time, s, does; the rest is
    white.
    """
    lags = np.arange(1, 26)
    found = autocorrelation(recorded, lags)

    def lasting(time: Array, share: float, tau: float) -> Array:
        return np.asarray(share * np.exp(-time / tau))

    fits = [curve_fit(lasting, 0.2 * lags, column, p0=(0.8, 2.0))[0] for column in found.T]
    return found, [(float(share), float(tau)) for share, tau in fits]


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
