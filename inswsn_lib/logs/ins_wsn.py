"""Reading a recording of an INS and a sensor network from a CSV file; faulty ones are refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.blocks import block_starts, interpolate
from inswsn_lib.logs.columns import INS, REFERENCE, TIME, WSN, check_clock, columns_of, reading

Rows = NDArray[np.intp]
_JITTER = 0.2  # a time stamp may be this share of a period away from the grid
_PATIENCE = 2.5  # an outage is longer than this many times the usual distance of fixes
_FARTHEST = 10.0  # km: an INS that has just begun to drift is not so far from its first fix
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
    time, period : ndarray, (steps,), and float
        Evenly spaced, and the spacing, s.
    ins, wsn, reference : ndarray, (steps, 4); or None without a reference
        x, y (m), v_x, v_y (m/s) of the INS, NaN in rows that the file lacks; of the network, NaN
        where there is no fix; of a reference.
    jitter : float
        Standard deviation of the time stamps from the grid, s.
    resampled : bool
        Whether the stamps were uneven, INS and reference are interpolated, and fixes carried.

    Examples
    --------
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
        fixed = np.flatnonzero(~np.isnan(self.wsn).all(axis=1)).tolist()
        usual = float(np.median(np.diff(fixed))) if len(fixed) > 1 else 1.0
        around = pairwise([-1, *fixed, len(self.wsn)])
        return [(a + 1, b) for a, b in around if b - a > _PATIENCE * usual]


def read_recording(path: str | Path, *, resample: bool = False) -> TrackPair:
    """Read a recording and put it on an even grid.

    The file is a CSV with a header and the columns `TIME`, `INS`, `WSN`; velocities of the network
    may be left out, and a `REFERENCE` may be there. Other columns are ignored. Lines that begin
    with ``#`` are comments, and do not count when a row is named; the header may stand behind ``#``
    or ``%``. Commas, semicolons or tabs separate columns; decimals have a point or, where it does
    not separate, a comma. ``time_s`` has seconds, or dates and times by ISO 8601, which become
    seconds since 1970 (UTC where no zone is named); it may be ``time_ms``, ``time_us`` or
    ``time_ns``. Rows may be missing, and cells of the network may be empty: both are gaps.

    Parameters
    ----------
    path : str or Path
    resample : bool
        Whether time stamps may be uneven. The INS is then interpolated onto an even grid of the
        median period, its positions by cubic polynomials that have its velocities (Hermite), the
        reference along straight lines. What the INS has more than the network at a fix is what it
        has more at the nearest instant: off by its drift over half a period, or less.

    Raises
    ------
    InswsnError
        In one sentence that names the column and the row (the header is row 1), if the file cannot
        be read, a row or column does not fit, time stamps are not even to a fifth of a period, or
        columns contradict one another as a wrong unit or another frame makes them.

    Examples
    --------
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
    for series in _comparable(time, sources):
        _refuse_other_units(path, *series)
    return _resampled(time, sources) if resample else _on_grid(path, time, sources)


def _check_positions(path: Path, ins: Array, wsn: Array) -> None:
    """Refuse a network without positions, and frames that are far apart."""
    for column, name in enumerate(WSN[:2]):
        if np.isnan(wsn[:, column]).all():
            raise InswsnError(f"{path} has no number at all in column {name}.")
    apart = np.linalg.norm((wsn - ins)[_complete(wsn[:, :2])[:1], :2]) / 1000
    if apart >= _FARTHEST:
        raise InswsnError(
            f"{path}: the first position of the network is {apart:.4g} km from that of the INS; "
            "both must be in one frame, that of the network."
        )


def _complete(values: Array) -> Rows:
    """Return the rows without a gap; a product is quicker than to look at each."""
    return np.flatnonzero(~np.isnan(values @ np.ones(values.shape[1])))


def _speeds(time: Array, place: Array) -> Array:
    """Return mean velocities over blocks of some seconds without a gap, (blocks, 2)."""
    if len(time) < 3:
        return np.empty((0, 2))
    starts = block_starts(time, _BLOCK)
    steps = np.diff(time[starts])
    whole = steps <= _PATIENCE * np.median(steps)
    return np.asarray(np.diff(place[starts], axis=0)[whole] / steps[whole, None])


def _comparable(
    time: Array, sources: dict[str, Array]
) -> Iterator[tuple[str, Array, str, Array, bool]]:
    """Yield two series that agree but for a wrong unit, and whether a known one alone is meant.

    Each source has its displacements and its velocities. Network and reference, and network and
    INS, are compared by their displacements where the network has fixes. Of the INS it is the
    changes from one block to the next: a drift that is steady, or grows slowly, is not in them.
    """
    along = {who: f"along {who}_x_m and {who}_y_m" for who in sources}
    for who, values in sources.items():
        t, there = time[rows := _complete(values)], values[rows]
        way = np.cumsum(there[:, 2:] * np.diff(t, prepend=t[:1])[:, None], axis=0)
        moved, told = _speeds(t, there[:, :2]), _speeds(t, way)
        yield (
            f"the speed {along[who]}",
            moved,
            f"that in {who}_vx_mps and {who}_vy_mps",
            told,
            False,
        )
    rows = _complete(sources["wsn"][:, :2])
    fixed = {who: _speeds(time[rows], values[rows, :2]) for who, values in sources.items()}
    network, inertial = np.diff(fixed["wsn"], axis=0), np.diff(fixed["ins"], axis=0)
    yield f"the change of speed {along['wsn']}", network, f"that {along['ins']}", inertial, True
    if "ref" in fixed:
        yield f"the speed {along['wsn']}", fixed["wsn"], f"that {along['ref']}", fixed["ref"], False


def _refuse_other_units(
    path: Path, what: str, one: Array, than: str, other: Array, known: bool
) -> None:
    """Refuse two series of one shape and two scales; if `known`, of two known units alone."""
    sizes = float(np.linalg.norm(one)), float(np.linalg.norm(other))
    # few and noisy changes may differ by much: only a gross factor between many tells a unit
    factor, fewest = (_GROSS, _FEW) if known else (_FACTOR, 1)
    if len(one) < fewest or min(sizes) == 0 or max(sizes) / np.sqrt(len(one)) < _SLOWEST:
        return
    # noise lowers the likeness before it changes the scale by as much as a unit does
    alike = float(np.sum(one * other)) > _LIKENESS * sizes[0] * sizes[1]
    ratio = sizes[0] / sizes[1]
    near = [u for u, size in _UNITS.items() if abs(abs(np.log(ratio)) - np.log(size)) < _NEAR]
    if not alike or 1 / factor <= ratio <= factor or (known and not near):
        return
    looks = f", as with {' or '.join(near)}" if near else ""
    raise InswsnError(
        f"{path}: {what} is {ratio:.3g} times {than}{looks}; lengths are in m, speeds in m/s, "
        f"{TIME} in s."
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
    grid, reference = start + period * np.arange(place[-1] + 1), grids.get("ref")
    return TrackPair(grid, period, grids["ins"], grids["wsn"], reference, float(np.std(offset)))


def _resampled(time: Array, sources: dict[str, Array]) -> TrackPair:
    """Return the sources on an even grid that the time stamps need not be near."""
    steps = np.diff(time)
    period = float(np.median(steps))
    grid = time[0] + period * np.arange(int((time[-1] - time[0]) / period + 0.5) + 1)
    inside = np.minimum(grid, time[-1])
    ins = sources["ins"]
    before = np.clip(np.searchsorted(time, inside, side="right") - 1, 0, len(steps) - 1)
    # positions by the cubic polynomials that have the velocities (Hermite)
    step, since = steps[before, None], (inside - time[before])[:, None]
    (begin, v), (end, w) = ((part[:, :2], part[:, 2:]) for part in (ins[before], ins[before + 1]))
    s, slope = since / step, (end - begin) / step
    way = begin + since * (v + s * (3 * slope - 2 * v - w + s * (v + w - 2 * slope)))
    ins_on_grid = np.hstack([way, interpolate(time, ins[:, 2:], inside)])
    ins_on_grid[steps[before] > _PATIENCE * period] = np.nan  # rows are missing
    place = np.clip(np.round((time - time[0]) / period).astype(int), 0, len(grid) - 1)
    offset = time - grid[place]
    wsn = np.full((len(grid), 4), np.nan)
    fixed = np.flatnonzero(~np.isnan(sources["wsn"]).all(axis=1))
    fixed = fixed[np.argsort(-np.abs(offset[fixed]), kind="stable")]  # the nearest comes last
    wsn[place[fixed]] = sources["wsn"][fixed] + ins_on_grid[place[fixed]] - ins[fixed]
    reference = interpolate(time, sources["ref"], inside) if "ref" in sources else None
    return TrackPair(grid, period, ins_on_grid, wsn, reference, float(np.std(offset)), True)
