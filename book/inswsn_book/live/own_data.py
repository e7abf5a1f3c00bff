"""The page on your own data on a reader's own file, in the page: what is read, filtered and found.

It needs numpy alone and computes by the functions of the library that the chapter calls. What the
page shows of it is in ``own_page.py``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from inswsn_lib.checks import Array, number
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation.consistency import autocorrelation
from inswsn_lib.filters.expected_ratio import ErrorStatistics
from inswsn_lib.logs.columns import columns_of
from inswsn_lib.logs.filter_checks import FilterRun, usual_spacing
from inswsn_lib.logs.findings import Finding
from inswsn_lib.logs.ins_wsn import TrackPair, track_pair
from inswsn_lib.logs.track_checks import check_recording
from inswsn_lib.models import ErrorModel


class Figure(NamedTuple):
    """A figure of the filter: what the page assumes, what it may be below, all above 0."""

    usual: float
    below: float
    label: str
    unit: str


#: The figures of the filter, standard deviations
FIGURES = {
    "wsn_position_noise": Figure(0.2, 1000, "Noise of network positions", "m"),
    "wsn_velocity_noise": Figure(0.1, 1000, "Noise of network velocities", "m/s"),
    "acceleration_noise": Figure(0.05, 100, "Error of INS acceleration", "m/s²"),
    "initial_position_error": Figure(1.0, 1_000_000, "First error of INS position", "m"),
    "initial_velocity_error": Figure(0.1, 1000, "First error of INS velocity", "m/s"),
}
#: Lines of a file, and steps of its grid, that a browser filters in seconds
MOST = 50_000
_LAGS = 20
_COMPONENTS = ("x", "y", "v_x", "v_y")
_TRACKS = ("INS", "reference", "network and reference")  # of which checks are, not of figures


@dataclass(frozen=True, eq=False)
class Examined:
    """A recording, what the filter makes of it, and how the two fit.

    `findings` are those of `check_recording`, `white` is of `_whiteness`. `errors` has a row for
    each track and situation, if there is a reference; `expected` are then the ratios of
    `ErrorStatistics`, or why there are none: nothing where the tracks do not fit.
    """

    name: str
    data: TrackPair
    filtered: FilterRun
    findings: list[Finding]
    white: dict[str, Any]
    errors: list[dict[str, Any]]
    expected: tuple[float, float] | str

    @property
    def corrected(self) -> Array:
        """The track of the INS less what the filter finds of its errors, (steps, 4)."""
        return self.data.ins - self.filtered.states

    @property
    def sigma(self) -> Array:
        """The deviation of the corrected position, (steps,), m."""
        return np.asarray(np.sqrt(self.filtered.design.filtered[:, [0, 1], [0, 1]].sum(axis=1)))

    @property
    def of_filter(self) -> dict[str, Finding]:
        """What `check_filter` found in the innovations, by name."""
        return {each.name: each for each in self.findings if each.subject == "innovations"}


def examine(text: str, options: Mapping[str, Any]) -> Examined:
    """Filter a recording as the page on your own data does.

    Parameters
    ----------
    text : str
        What is in the CSV file, of the form of the page on your own data.
    options : mapping
        ``name``, of the file, and figures of the filter, as in `FIGURES`.

    Raises
    ------
    InswsnError
        If the file or an option does not fit, as `inswsn_lib.logs.read_recording` says it.

    Examples
    --------
    >>> from inswsn_book.live.own_data import examine
    >>> from inswsn_lib.files import data_file
    >>> found = examine(data_file("examples/ins-wsn.csv").read_text(), {})
    >>> len(found.data.time), all(each.fits for each in found.findings)
    (301, True)
    """
    name = str(options.get("name", "my-recording.csv"))
    figures = {
        figure: number(figure, options.get(figure, known.usual), above=0, below=known.below)
        for figure, known in FIGURES.items()
    }
    data = read(name, text)
    if not np.isfinite(data.ins - data.wsn).any():
        raise InswsnError(f"{name} has no fix where the INS has a row.")
    model, initial = _assumed(data.period, figures)
    filtered = FilterRun.of(model, data.ins - data.wsn, initial)
    findings = check_recording(data, model, initial_covariance=initial)
    white, errors = _whiteness(data, filtered), _errors(data, filtered)
    # differences of tracks that are late, or in other axes or units, are not errors of fixes
    wrong = {each.name for each in findings if each.subject in _TRACKS and each.fits is False}
    expected = "" if wrong - {"size"} else _expected(data)
    return Examined(name, data, filtered, findings, white, errors, expected)


def read(name: str, text: str) -> TrackPair:
    """Return the recording in a text; refuse one that would keep the page busy for minutes."""
    instead = (
        f"this page takes at most {MOST}, inswsn run your-own-data -p recording={name} any number"
    )
    lines = 1 + max(text.count("\n"), text.count("\r"))
    if lines > MOST:
        raise InswsnError(f"{name} has {lines} lines; {instead}.")
    path = Path(name)
    table = columns_of(path, text.encode("utf-8", "surrogatepass"))
    data = track_pair(path, table, resample=True)
    if len(data.time) > MOST:
        raise InswsnError(f"{name} spans {len(data.time)} steps; {instead}.")
    return data


def _assumed(period: float, figures: Mapping[str, float]) -> tuple[ErrorModel, Array]:
    """Return the model of the page on your own data, and its first covariance."""
    driven = figures["acceleration_noise"] * period
    model = ErrorModel.p1(
        period,
        process_noise=(driven * period / 2, driven),
        measurement_noise=(figures["wsn_position_noise"], figures["wsn_velocity_noise"]),
    )
    first = figures["initial_position_error"], figures["initial_velocity_error"]
    return model, np.diag(np.repeat(first, 2) ** 2)


def _whiteness(data: TrackPair, found: FilterRun) -> dict[str, Any]:
    """Return the autocorrelation of the innovations of each component, by ``lags`` of a usual fix.

    ``interval`` is a lag, s.
    """
    deviations = np.sqrt(np.diagonal(found.design.innovation, axis1=1, axis2=2))
    scaled = found.innovations / deviations
    usual = usual_spacing(np.asarray(np.isfinite(scaled).any(axis=1)))
    lags = [lag for lag in range(1, _LAGS + 1) if lag * usual < len(scaled)]
    values = autocorrelation(scaled, usual * np.array(lags, dtype=int))
    series = {
        name: column.tolist()
        for name, column in zip(_COMPONENTS, values.T, strict=True)
        if np.isfinite(column[:1]).any()
    }
    return {"interval": usual * data.period, "lags": lags, "components": series}


def _expected(data: TrackPair) -> tuple[float, float] | str:
    """Return what a filter is expected to leave of the errors of fixes, or why that is unknown."""
    if data.reference is None:
        return "The file has no reference, so that the errors are unknown."
    there = np.asarray(np.isfinite(data.wsn).any(axis=1))
    usual = usual_spacing(there)
    rows = slice(int(np.argmax(there)), None, usual)
    ins, network = ((each - data.reference)[rows] for each in (data.ins, data.wsn))
    try:
        return ErrorStatistics.of(ins, network, usual * data.period).ratios()
    except InswsnError as error:
        return str(error)


def _errors(data: TrackPair, found: FilterRun) -> list[dict[str, Any]]:
    """Return the root mean square errors of each track, if there is a reference."""
    if data.reference is None:
        return []
    silent = np.zeros(len(data.time), dtype=bool)
    for first, end in data.outages:
        silent[first:end] = True
    there = ~np.isnan(data.ins).any(axis=1)
    told = []
    for track, values in (
        ("INS alone", data.ins), ("network", data.wsn), ("INS corrected", data.ins - found.states),
    ):  # fmt: skip
        squares = np.sum((values - data.reference).reshape(-1, 2, 2) ** 2, axis=2)
        for when, rows in (("with fixes", there & ~silent), ("in outages", there & silent)):
            known = [column[np.isfinite(column)] for column in squares[rows].T]
            far, fast = (float(np.sqrt(x.mean())) if x.size else None for x in known)
            if any(x.size for x in known):
                told.append({"track": track, "when": when, "position": far, "velocity": fast})
    return told
