"""Reading a recording of an INS and a sensor network from a CSV file; faulty ones are refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import block_starts
from inswsn_lib.logs.columns import INS, REFERENCE, TIME, WSN, columns_of
from inswsn_lib.logs.rows import check_clock, reading

Rows = NDArray[np.intp]
_JITTER = 0.2  # a time stamp may be this share of a period away from the grid
_PATIENCE = 2.5  # an outage is longer than this many times the usual distance of fixes
_FARTHEST = 10_000.0  # m: an INS that has just begun to drift is not so far from its first fix
# Series that are alike to this cosine may be compared in scale, and differ by a unit beyond this
_LIKENESS, _FACTOR = 0.8, 1.6
# Changes of speed tell a unit by this factor, and if there are this many
_GROSS, _FEW = 2.5, 4
_NEAR = np.log(1.15)  # a ratio is that of two units if it is this near
# Displacements are compared over blocks of this length (s); slower than this (m/s) tells nothing
_BLOCK, _SLOWEST = 5.0, 0.05
_UNITS = {
    "km/h": 3.6, "knots": 1.9438, "feet": 3.2808, "cm": 100.0, "mm, km or ms": 1000.0,
    "degrees of latitude": 111_200.0,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class TrackPair:
    """A recording on an even grid of time.

    Attributes
    ----------
    time : ndarray, (steps,)
        Seconds, evenly spaced.
    period : float
        The spacing, s.
    ins : ndarray, (steps, 4)
        x, y (m), v_x, v_y (m/s) of the INS; NaN in rows that the file lacks.
    wsn : ndarray, (steps, 4)
        The same of the network; NaN where there is no fix.
    reference : ndarray, (steps, 4), or None
        The same of a reference, if the file has one.
    jitter : float
        Standard deviation of the time stamps from the grid, s.
    resampled : bool
        Whether the stamps were uneven: the INS and the reference are interpolated, and fixes were
        carried to the nearest instant.

    Examples
    --------
    The network of the recording that comes with the book is silent for 12 s and for 8 s; two rows
    are missing:

    >>> import inswsn_lib as iw
    >>> recording = iw.read_recording(iw.data_file("examples/ins-wsn.csv"))
    >>> round(recording.period, 2), recording.outages
    (0.2, [(37, 39), (100, 160), (230, 270)])
    """

    time: Array
    period: float
    ins: Array
    wsn: Array
    reference: Array | None
    jitter: float
    resampled: bool = False

    @property
    def measurements(self) -> Array:
        """INS less WSN (P1 2.5) as one run, (steps, 4, 1); filters take ``ins - wsn``, too."""
        return (self.ins - self.wsn)[:, :, None]

    @property
    def outages(self) -> list[tuple[int, int]]:
        """The outages, as the first step and the step after the last.

        An outage is a run of steps without any measurement around which measurements are more than
        2.5 times their median distance apart: a network that is slower than the INS is not silent.
        """
        missing = np.isnan(self.wsn).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(int)))
        usual = float(np.median(np.diff(np.flatnonzero(~missing)))) if (~missing).sum() > 1 else 1.0
        return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a + 1 > _PATIENCE * usual]


def read_recording(path: str | Path, *, resample: bool = False) -> TrackPair:
    """Read a recording and put it on an even grid.

    The file is a CSV with a header and the columns ``time_s``, ``ins_x_m``, ``ins_y_m``,
    ``ins_vx_mps``, ``ins_vy_mps``, ``wsn_x_m``, ``wsn_y_m``; of the network there may be
    ``wsn_vx_mps`` and ``wsn_vy_mps``, of a reference ``ref_x_m``, ``ref_y_m``, ``ref_vx_mps`` and
    ``ref_vy_mps``. Other columns are ignored. Lines that begin with ``#`` are comments, and do not
    count when a row is named; the header may stand behind ``#`` or ``%``. Commas, semicolons or
    tabs separate columns; decimals have a point or, where it does not separate, a comma. ``time_s``
    has seconds, or dates and times by ISO 8601, which become seconds since 1970 (UTC where no zone
    is named); it may be ``time_ms``, ``time_us`` or ``time_ns``. The period comes from the time
    stamps. Rows may be missing, and cells of the network may be empty: both are gaps.

    Parameters
    ----------
    path : str or Path
    resample : bool
        Whether time stamps may be uneven. The INS is then interpolated onto an even grid of the
        median period, its positions by cubic polynomials that have its velocities (Hermite), and so
        is the reference, along straight lines. A fix stays at its own stamp in this sense: what the
        INS has more than the network there is what it has more at the nearest instant. That is off
        by the drift of the INS over half a period, or less.

    Raises
    ------
    InswsnError
        In one sentence that names the column and the row (the header is row 1), if the file cannot
        be read, a row or column does not fit, time stamps are not even to a fifth of a period, or
        columns contradict one another as a wrong unit or another frame makes them.

    Examples
    --------
    Four components of 301 steps, of one run, for the filters:

    >>> import inswsn_lib as iw
    >>> iw.read_recording(iw.data_file("examples/ins-wsn.csv")).measurements.shape
    (301, 4, 1)
    """
    path = Path(path)
    return track_pair(path, columns_of(path), resample=resample)


def track_pair(path: Path, table: dict[str, Array], *, resample: bool = False) -> TrackPair:
    """Return what `read_recording` does, of the columns of a file; needs numpy alone."""
    time = table[TIME]
    if time.size < 3:
        raise InswsnError(f"{path} has {time.size} rows; it must have at least 3.")
    with reading(path):
        check_clock(TIME, time, first=2)
    columns = {"ins": INS, "wsn": WSN} | ({"ref": REFERENCE} if REFERENCE[0] in table else {})
    sources = {who: np.column_stack([table[n] for n in names]) for who, names in columns.items()}
    _check_positions(path, sources["ins"], sources["wsn"])
    for one, other, known in _comparable(time, sources):
        _refuse_other_units(path, one, other, known)
    return _resampled(time, sources) if resample else _on_grid(path, time, sources)


def _check_positions(path: Path, ins: Array, wsn: Array) -> None:
    """Refuse a network without positions, and frames that are far apart."""
    for column, name in enumerate(WSN[:2]):
        if np.isnan(wsn[:, column]).all():
            raise InswsnError(f"{path} has no number at all in column {name}.")
    fixed = _complete(wsn[:, :2])[:1]
    apart = float(np.hypot(*(wsn[fixed, :2] - ins[fixed, :2]).T).max(initial=0.0))
    if apart >= _FARTHEST:
        raise InswsnError(
            f"{path}: the first position of the network is {apart / 1000:.4g} km from that of the "
            "INS; both must be in one frame, that of the network."
        )


def _complete(values: Array) -> Rows:
    """Return the rows without a gap; a product is quicker than to look at each."""
    return np.flatnonzero(~np.isnan(values @ np.ones(values.shape[1])))


def _whole(starts: Array) -> NDArray[np.bool_]:
    """Return which blocks have no gap in them, by when they start."""
    steps = np.diff(starts)
    return steps <= _PATIENCE * np.median(steps) if steps.size else steps > 0


#: What a series of speeds (blocks, 2) is, in words, and the series
_Named = tuple[str, Array]


def _comparable(time: Array, sources: dict[str, Array]) -> Iterator[tuple[_Named, _Named, bool]]:
    """Yield series that agree but for a wrong unit, and whether a known unit alone is meant.

    Each source has its displacements and its velocities. Network and reference, and network and
    INS, are compared by their displacements where the network has fixes. Of the INS it is the
    changes from one block to the next: a drift that is steady, or grows slowly, is not in them.
    """

    def moved(who: str, rows: Rows) -> _Named:
        starts = rows[block_starts(time[rows], _BLOCK)] if rows.size else rows
        begin, end = starts[:-1][(whole := _whole(time[starts]))], starts[1:][whole]
        way = sources[who][end, :2] - sources[who][begin, :2]
        return f"along {who}_x_m and {who}_y_m", way / (time[end] - time[begin])[:, None]

    for who, values in sources.items():
        if (rows := _complete(values)).size:
            along, speeds = moved(who, rows)
            starts = block_starts(time[rows], _BLOCK)
            means = np.add.reduceat(values[rows, 2:], starts)[:-1] / np.diff(starts)[:, None]
            told = f"that in {who}_vx_mps and {who}_vy_mps", means[_whole(time[rows[starts]])]
            yield (f"the speed {along}", speeds), told, False
    fixed = _complete(sources["wsn"][:, :2])
    (along, network), (other, inertial) = moved("wsn", fixed), moved("ins", fixed)
    changes = f"that {other}", np.diff(inertial, axis=0)
    yield (f"the change of speed {along}", np.diff(network, axis=0)), changes, True
    if "ref" in sources:
        fixed = fixed[np.isin(fixed, _complete(sources["ref"][:, :2]))]
        (along, network), (other, true) = moved("wsn", fixed), moved("ref", fixed)
        yield (f"the speed {along}", network), (f"that {other}", true), False


def _refuse_other_units(path: Path, one: _Named, other: _Named, known: bool) -> None:
    """Refuse two series of one shape and two scales; if `known`, of two known units alone."""
    count = len(one[1])
    sizes = float(np.linalg.norm(one[1])), float(np.linalg.norm(other[1]))
    # few and noisy changes may differ by much: only a gross factor between many tells a unit
    factor, fewest = (_GROSS, _FEW) if known else (_FACTOR, 1)
    if count < fewest or min(sizes) == 0 or max(sizes) / np.sqrt(count) < _SLOWEST:
        return
    # noise lowers the likeness before it changes the scale by as much as a unit does
    likeness = float(np.sum(one[1] * other[1])) / (sizes[0] * sizes[1])
    ratio = sizes[0] / sizes[1]
    near = [u for u, size in _UNITS.items() if abs(abs(np.log(ratio)) - np.log(size)) < _NEAR]
    if likeness < _LIKENESS or 1 / factor <= ratio <= factor or (known and not near):
        return
    looks = f", as with {' or '.join(near)}" if near else ""
    raise InswsnError(
        f"{path}: {one[0]} is {ratio:.3g} times {other[0]}{looks}; lengths are in m, speeds "
        f"in m/s, {TIME} in s."
    )


def _on_grid(path: Path, time: Array, sources: dict[str, Array]) -> TrackPair:
    steps = np.diff(time)
    # the mean of the steps of rows that follow one another tells how many steps a gap has
    usual = steps[steps <= 1.5 * np.median(steps)].mean()
    place = np.concatenate([[0], np.cumsum(np.round(steps / usual).astype(int))])
    period, late = np.polyfit(place, time - time[0], 1).tolist()
    start = float(time[0]) + late
    offset = time - start - place * period
    if (np.diff(place) <= 0).any() or np.abs(offset).max() > _JITTER * period:
        row = int(np.argmax(np.abs(offset)))
        raise InswsnError(
            f"{path}: the time stamp {time[row]:.12g} s in row {row + 2} is {offset[row]:+.3g} s "
            f"off an even grid of {period:.4g} s; a fifth of a period is allowed. Read it with "
            "resample=True, or resample it."
        )
    grids = {who: np.full((place[-1] + 1, 4), np.nan) for who in sources}
    for who, values in sources.items():
        grids[who][place] = values
    return TrackPair(
        time=start + period * np.arange(place[-1] + 1),
        period=period,
        ins=grids["ins"],
        wsn=grids["wsn"],
        reference=grids.get("ref"),
        jitter=float(np.std(offset)),
    )


def _resampled(time: Array, sources: dict[str, Array]) -> TrackPair:
    """Return the sources on an even grid that the time stamps need not be near."""
    steps = np.diff(time)
    period = float(np.median(steps))
    grid = time[0] + period * np.arange(int((time[-1] - time[0]) / period + 0.5) + 1)
    inside = np.minimum(grid, time[-1])
    ins = sources["ins"]
    before = np.clip(np.searchsorted(time, inside, side="right") - 1, 0, len(steps) - 1)
    way = _cubics(time, ins, inside, before)
    ins_on_grid = np.hstack([way, _lines(time, ins[:, 2:], inside)])
    ins_on_grid[steps[before] > _PATIENCE * period] = np.nan  # rows are missing
    place = np.clip(np.round((time - time[0]) / period).astype(int), 0, len(grid) - 1)
    offset = time - grid[place]
    wsn = np.full((len(grid), 4), np.nan)
    fixed = np.flatnonzero(~np.isnan(sources["wsn"]).all(axis=1))
    for k in fixed[np.argsort(-np.abs(offset[fixed]), kind="stable")]:  # the nearest comes last
        wsn[place[k]] = sources["wsn"][k] + ins_on_grid[place[k]] - ins[k]
    reference = _lines(time, sources["ref"], inside) if "ref" in sources else None
    return TrackPair(grid, period, ins_on_grid, wsn, reference, float(np.std(offset)), True)


def _cubics(time: Array, values: Array, at: Array, before: Rows) -> Array:
    """Return positions (instants, 2) by the cubic polynomials that have the velocities (Hermite).

    Each instant has the row before it.
    """
    step = np.diff(time)[before, None]
    since = (at - time[before])[:, None]
    s = since / step
    (begin, end), (v, w) = (
        (part[before], part[before + 1]) for part in (values[:, :2], values[:, 2:])
    )
    slope = (end - begin) / step
    bent = (3 * slope - 2 * v - w) + s * (v + w - 2 * slope)
    return np.asarray(begin + since * (v + s * bent))


def _lines(time: Array, values: Array, at: Array) -> Array:
    return np.column_stack([np.interp(at, time, x) for x in values.T])
