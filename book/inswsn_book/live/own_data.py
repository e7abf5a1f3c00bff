"""Chapter 90 on a reader's own file, in the page: what is read, filtered, drawn and told.

It needs numpy alone and computes by the functions of the library that the chapter calls. What asks
for more, `inswsn_lib.recordings.check_recording`, is left to ``inswsn run 90``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inswsn_book.live.chi_square import bounds
from inswsn_lib.checks import Array, number
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation.consistency import normalised_squares
from inswsn_lib.filters.kalman import design_kalman, run_design
from inswsn_lib.models import ErrorModel
from inswsn_lib.recordings.columns import INS, TIME, columns_of
from inswsn_lib.recordings.ins_wsn import TrackPair, track_pair

#: The figures of the filter: what chapter 90 assumes, and what each may be below; all are above 0
FIGURES = {
    "wsn_position_noise": (0.2, 1000),  # m
    "wsn_velocity_noise": (0.1, 1000),  # m/s
    "acceleration_noise": (0.05, 100),  # m/s^2
    "initial_position_error": (1.0, 1_000_000),  # m
    "initial_velocity_error": (0.1, 1000),  # m/s
}
#: Lines of a file, and steps of its grid, that a browser filters in seconds
MOST = 50_000
_POINTS = 1500  # of a series that is drawn
_BARS = 400  # of the chart of the NIS, each the mean of some fixes
_LAGS = 20
_CHANCE = 3.3  # deviations that a normal variable exceeds once in a thousand times
_COMPONENTS = ("x", "y", "v_x", "v_y")
_OUTAGES = 100  # that are listed


@dataclass(frozen=True, eq=False)
class _Filtered:
    """What the filter found of a recording, over its steps.

    `corrected` and `innovations` are (steps, 4), NaN where missing, `deviations` (steps, 4) those
    of the innovations, `nis` and `sigma` (steps,): the deviation of the position, m.
    """

    corrected: Array
    errors: Array
    innovations: Array
    deviations: Array
    nis: Array
    sigma: Array


def look(text: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page shows of a recording: sentences, numbers, series and a file.

    Parameters
    ----------
    text : str
        What is in the CSV file, of the form of chapter 90.
    options : mapping
        ``name``, of the file, and figures of the filter, as in `FIGURES`.

    Returns
    -------
    dict
        Of what JSON has: lengths in m, times in s since the first row, None where a value is
        missing.

    Raises
    ------
    InswsnError
        If the file or an option does not fit, as `inswsn_lib.recordings.read_recording` says it.

    Examples
    --------
    >>> from inswsn_book.live.own_data import look
    >>> from inswsn_lib.files import data_file
    >>> found = look(data_file("examples/ins-wsn.csv").read_text(), {"name": "my.csv"})
    >>> found["sentences"][0]
    'my.csv has 301 steps of 0.2000 s; its time stamps are off the grid by 2.1 ms (1 sigma).'
    """
    name = str(options.get("name", "my-recording.csv"))
    figures = {
        figure: number(figure, options.get(figure, usual), above=0, below=below)
        for figure, (usual, below) in FIGURES.items()
    }
    data = _read(name, text)
    found = _filtered(name, data, figures)
    nis, white, errors = _nis(found), _whiteness(data, found), _errors(data, found)
    clock = data.time - data.time[0]
    return {
        "name": name,
        "figures": figures,
        "sentences": [
            f"{name} has {len(data.time)} steps of {data.period:.4f} s; its time stamps are off "
            f"the grid by {1000 * data.jitter:.1f} ms (1 sigma).",
            _outages_told(data),
            *_fit_told(nis, white),
            *([] if errors else ["The file has no reference, so that the errors are unknown."]),
        ],
        "steps": len(data.time),
        "period": data.period,
        "outages": [
            {"begins": float(clock[first]), "lasts": (end - first) * data.period}
            for first, end in data.outages[:_OUTAGES]
        ],
        "mean_nis": nis,
        "nis": _nis_over_time(clock, found),
        "white": white,
        "errors": errors,
        "track": _tracks(data, found),
        "size": _thinned(clock, np.linalg.norm(found.errors[:, :2], axis=1), found.sigma),
        "csv": _corrected(data.time, found.corrected),
    }


def _read(name: str, text: str) -> TrackPair:
    """Return the recording in a text; refuse one that would keep the page busy for minutes."""
    instead = f"this page takes {MOST} at most, and inswsn run 90 -p recording={name} any number"
    lines = 1 + max(text.count("\n"), text.count("\r"))
    if lines > MOST:
        raise InswsnError(f"{name} has {lines} lines; {instead}.")
    path = Path(name)
    table = columns_of(path, text.encode("utf-8", "surrogatepass"))
    data = track_pair(path, table, resample=True)
    if len(data.time) > MOST:
        raise InswsnError(f"{name} spans {len(data.time)} steps; {instead}.")
    return data


def _filtered(name: str, data: TrackPair, figures: Mapping[str, float]) -> _Filtered:
    """Run the filter as chapter 90 does."""
    driven = figures["acceleration_noise"] * data.period
    model = ErrorModel.p1(
        data.period,
        process_noise=(driven * data.period / 2, driven),
        measurement_noise=(figures["wsn_position_noise"], figures["wsn_velocity_noise"]),
    )
    first = figures["initial_position_error"], figures["initial_velocity_error"]
    there = ~np.isnan(data.measurements[:, :, 0])
    if not there.any():
        raise InswsnError(f"{name} has no fix where the INS has a row.")
    design = design_kalman(model, there, initial_covariance=np.diag(np.repeat(first, 2) ** 2))
    errors = run_design(model, design, data.measurements)[:, :, 0]
    before = run_design(model, design, data.measurements, predicted=True)
    innovations = data.measurements - model.C @ before
    return _Filtered(
        corrected=data.ins - errors,
        errors=errors,
        innovations=innovations[:, :, 0],
        deviations=np.sqrt(np.diagonal(design.innovation, axis1=1, axis2=2)),
        nis=normalised_squares(innovations, design.innovation)[:, 0],
        sigma=np.sqrt(design.filtered[:, [0, 1], [0, 1]].sum(axis=1)),
    )


def _nis(found: _Filtered) -> dict[str, Any]:
    """Return the mean NIS of a measured component, and between what it is if the figures fit."""
    measured = int(np.isfinite(found.innovations).sum())
    low, high = bounds(measured)
    mean = float(np.nansum(found.nis)) / measured
    return {"measured": measured, "mean": mean, "low": float(low), "high": float(high)}


def _nis_over_time(clock: Array, found: _Filtered) -> dict[str, Any]:
    """Return the NIS of a component of each fix, or the mean of some fixes, and its bounds."""
    counts = np.isfinite(found.innovations).sum(axis=1)
    fixes = np.flatnonzero(counts)
    group = -(-len(fixes) // _BARS)
    begins = np.arange(0, len(fixes), group)
    degrees = np.add.reduceat(counts[fixes], begins)
    value = np.add.reduceat(found.nis[fixes], begins) / degrees
    low, high = bounds(degrees)
    inside = float(np.mean((low <= value) & (value <= high)))
    columns = {"time": clock[fixes[begins]], "value": value, "low": low, "high": high}
    return {"group": group, "inside": inside, **{k: _plain(v) for k, v in columns.items()}}


def _whiteness(data: TrackPair, found: _Filtered) -> dict[str, Any]:
    """Return the autocorrelation of the innovations of each component, by lags of a usual fix.

    ``bound`` is what one of neighbours exceeds once in a thousand times by chance.
    """
    whitened = found.innovations / found.deviations
    there = np.isfinite(whitened)
    fixes = np.flatnonzero(there.any(axis=1))
    usual = int(np.median(np.diff(fixes))) if len(fixes) > 1 else 1
    pairs = there[usual:] & there[:-usual]
    seen = [k for k in range(len(_COMPONENTS)) if pairs[:, k].any()]
    lags = [lag for lag in range(1, _LAGS + 1) if lag * usual < len(whitened)]
    series = {
        _COMPONENTS[k]: [_correlation(whitened[:, k], lag * usual) for lag in lags] for k in seen
    }
    first = [abs(values[0]) for values in series.values() if values]
    return {
        "interval": usual * data.period,
        "lags": lags,
        "components": {name: _plain(np.array(values)) for name, values in series.items()},
        "largest": max(first, default=None),
        "bound": _CHANCE / float(np.sqrt(pairs[:, seen].sum(axis=0).min())) if seen else None,
    }


def _correlation(values: Array, lag: int) -> float:
    """Return the mean product of values that are a lag apart over the mean square; NaN of none."""
    both = values[lag:] * values[:-lag]
    return float(np.nanmean(both) / np.nanmean(values**2)) if np.isfinite(both).any() else np.nan


def _fit_told(nis: Mapping[str, Any], white: Mapping[str, Any]) -> list[str]:
    """Return what the innovations say of the figures, in the words of chapter 90."""
    mean, low, high = nis["mean"], nis["low"], nis["high"]
    largest, bound = white["largest"], white["bound"]
    said = [
        f"The mean NIS of {nis['measured']} measured components is {mean:.2f}; 95 % of filters "
        f"that fit have it between {low:.2f} and {high:.2f}."
    ]
    if largest is not None:
        said.append(
            f"The largest autocorrelation of neighbouring innovations is {largest:.2f}, up to "
            f"{bound:.2f} by chance."
        )
    if mean > high:
        verdict = "they are too small, or the model is wrong"
    elif mean < low:
        verdict = "they are too large"
    elif largest is None:
        verdict = "they fit in size; fixes are too few to tell whether innovations are white"
    elif largest > bound:
        verdict = (
            "they do not fit: their size does, but neighbouring innovations are correlated, so "
            "that the filter believes itself too much"
        )
    else:
        verdict = "they fit, in size and in whiteness"
    return [*said, f"The verdict on the noise figures: {verdict}."]


def _outages_told(data: TrackPair) -> str:
    lengths = [(end - first) * data.period for first, end in data.outages]
    if not lengths:
        return "The network has no outage."
    if len(lengths) == 1:
        return f"The network has one outage, of {lengths[0]:.1f} s."
    return f"The network has {len(lengths)} outages, the longest of {max(lengths):.1f} s."


def _errors(data: TrackPair, found: _Filtered) -> list[dict[str, Any]]:
    """Return the root mean square errors of each track, if there is a reference."""
    if data.reference is None:
        return []
    silent = np.zeros(len(data.time), dtype=bool)
    for first, end in data.outages:
        silent[first:end] = True
    there = ~np.isnan(data.ins).any(axis=1)
    parts = {"position": slice(0, 2), "velocity": slice(2, 4)}
    told = []
    for track, values in (
        ("INS alone", data.ins), ("network", data.wsn), ("INS corrected", found.corrected),
    ):  # fmt: skip
        for when, rows in (("with fixes", there & ~silent), ("in outages", there & silent)):
            error = (values - data.reference)[rows]
            sizes = {what: _root_mean_square(error[:, part]) for what, part in parts.items()}
            if any(size is not None for size in sizes.values()):
                told.append({"track": track, "when": when, **sizes})
    return told


def _root_mean_square(error: Array) -> float | None:
    """Return that of errors (steps, 2), over the steps that have both; None if none has."""
    squares = np.sum(error**2, axis=1)
    return float(np.sqrt(np.nanmean(squares))) if np.isfinite(squares).any() else None


def _tracks(data: TrackPair, found: _Filtered) -> dict[str, list[list[float | None]]]:
    """Return x and y of each track."""
    fixed = np.isfinite(data.wsn[:, :2]).all(axis=1)
    tracks = {"ins": data.ins, "network": data.wsn[fixed], "corrected": found.corrected}
    return {name: _thinned(*values[:, :2].T) for name, values in tracks.items()}


def _thinned(*columns: Array) -> list[list[float | None]]:
    """Return columns of one length at some even places, the first and the last among them."""
    steps = len(columns[0])
    kept: NDArray[np.intp] = np.linspace(0, steps - 1, min(steps, _POINTS)).astype(int)
    return [_plain(column[kept]) for column in columns]


def _plain(values: Array) -> list[float | None]:
    """Return numbers as JSON has them: it has no NaN."""
    return [None if np.isnan(value) else value for value in values.round(6).tolist()]


def _corrected(time: Array, corrected: Array) -> str:
    """Return the corrected track as the CSV file that chapter 90 writes."""
    header = [TIME, *(name.replace("ins_", "corrected_") for name in INS)]
    table = np.column_stack([time, corrected]).round(6).tolist()
    rows = [",".join("" if x != x else repr(x) for x in row) for row in table]  # noqa: PLR0124
    return "\n".join([",".join(header), *rows, ""])
