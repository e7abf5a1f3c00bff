"""Reading a recording of an INS and a sensor network from a CSV file, and refusing a wrong one."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from inswsn_lib.errors import InswsnError

Array = NDArray[np.float64]

#: The column of time stamps, s
TIME = "time_s"
#: The columns of the INS: position (m) and velocity (m/s) in the horizontal frame of the network
INS = ("ins_x_m", "ins_y_m", "ins_vx_mps", "ins_vy_mps")
#: The columns of the network, in the same frame; empty where there is no fix. A network without
#: velocities may leave out the last two.
WSN = ("wsn_x_m", "wsn_y_m", "wsn_vx_mps", "wsn_vy_mps")
#: The columns of a reference, if there is one
REFERENCE = ("ref_x_m", "ref_y_m", "ref_vx_mps", "ref_vy_mps")

_KNOWN = {TIME, *INS, *WSN, *REFERENCE}

# A time stamp may be this share of a period away from the grid.
_JITTER = 0.2
# The grid may have this many times as many steps as there are rows, or this many.
_SPARSEST, _ALWAYS = 10, 1000
# An outage is longer than this many times the usual distance of fixes.
_PATIENCE = 2.5
# An INS that has just begun to drift is not this far from its first fix (m).
_FARTHEST = 10_000.0
# Series that are alike to this cosine may be compared in scale, and differ by a unit beyond this.
_LIKENESS, _FACTOR = 0.8, 1.6
# Changes of speed tell a unit by this factor, and if there are this many.
_GROSS, _FEW = 2.5, 4
# A ratio is that of two units if it is this near.
_NEAR = 1.15
# Displacements are compared over blocks of this length (s); slower than this (m/s) tells nothing.
_BLOCK, _SLOWEST = 5.0, 0.05
_UNITS = {
    "km/h": 3.6, "knots": 1.9438, "feet": 3.2808, "cm": 100.0, "mm, km or ms": 1000.0,
    "degrees of latitude": 111_200.0,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Recording:
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

    Examples
    --------
    A network that is heard every second step is not silent; for seven steps it is.

    >>> import numpy as np
    >>> from inswsn_lib.navigation import Recording
    >>> wsn = np.ones((16, 4))
    >>> wsn[1::2] = wsn[8:13] = np.nan
    >>> recording = Recording(0.1 * np.arange(16), 0.1, np.full((16, 4), 3.0), wsn, None, 0.0)
    >>> recording.outages
    [(7, 14)]
    >>> recording.measurements.shape, recording.measurements[:3, 0, 0].tolist()
    ((16, 4, 1), [2.0, nan, 2.0])
    """

    time: Array
    period: float
    ins: Array
    wsn: Array
    reference: Array | None
    jitter: float

    @property
    def measurements(self) -> Array:
        """INS less WSN, (steps, 4, 1): what the filters of P1 (2.5) take; NaN where missing."""
        return (self.ins - self.wsn)[:, :, None]

    @property
    def outages(self) -> list[tuple[int, int]]:
        """The outages: first step, and the step after the last.

        An outage is a run of steps without any measurement around which measurements are more than
        2.5 times their median distance apart: a network that is slower than the INS is not silent.
        """
        missing = np.isnan(self.wsn).all(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(int)))
        usual = float(np.median(np.diff(np.flatnonzero(~missing)))) if (~missing).sum() > 1 else 1.0
        return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a + 1 > _PATIENCE * usual]


def read_recording(path: Path) -> Recording:
    """Read a recording and put it on an even grid.

    The file is a CSV with commas, a header and the columns `TIME`, `INS` and `WSN`; those of
    `REFERENCE` are taken if all of them are there, and others are ignored. Lines that begin with
    ``#`` are comments, and do not count when a row is named. The period comes from the time stamps.
    Rows may be missing, and WSN cells may be empty: both are gaps.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    Recording
        On an even grid, with NaN in its gaps.

    Raises
    ------
    InswsnError
        In one sentence that names the column and the row (the header is row 1), if the file cannot
        be read; a row has too many or too few cells; a column is missing, is there twice, or has
        something that is no number; an INS cell is empty; time stamps repeat, go back, jump, or
        are not even to a fifth of a period; there is no position fix at all, or the first is 10 km
        or more from the INS; or columns contradict one another as a wrong unit makes them.

    Examples
    --------
    The recording that comes with the book, in which two rows are missing and the network is silent
    for 12 s and for 8 s; and one that says nothing of the network:

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.errors import InswsnError
    >>> from inswsn_lib.navigation import INS, TIME, read_recording
    >>> recording = read_recording(data_file("examples/ins-wsn.csv"))
    >>> recording.measurements.shape, round(recording.period, 2), recording.outages
    ((301, 4, 1), 0.2, [(37, 39), (100, 160), (230, 270)])
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder, "ins.csv")
    ...     _ = path.write_text(",".join([TIME, *INS]))
    ...     try:
    ...         read_recording(path)
    ...     except InswsnError as error:
    ...         print(str(error).split("ins.csv ")[1])
    has no column wsn_x_m; it has time_s, ins_x_m, ins_y_m, ins_vx_mps, ins_vy_mps.
    """
    table = _read_table(path)
    time = _check_time(path, table[TIME].to_numpy())
    ins, wsn = table[list(INS)].to_numpy(), table[list(WSN)].to_numpy()
    reference = table[list(REFERENCE)].to_numpy() if REFERENCE[0] in table else None
    _check_values(path, ins, wsn)
    _check_frame(path, ins, wsn)
    _check_units(path, time, ins, wsn, reference)
    return _on_grid(path, time, ins, wsn, reference)


def _read_table(path: Path) -> pd.DataFrame:
    rows = _read_rows(path)
    header = [name.strip() for name in rows[0]]
    if len(header) == 1 and any(sign in header[0] for sign in ";\t"):
        raise InswsnError(f"{path} has no commas; columns may be separated by commas.")
    twice = sorted({name for name in header if header.count(name) > 1} & _KNOWN)
    if twice:
        raise InswsnError(f"{path} has the column {twice[0]} more than once.")
    for name in (TIME, *INS, *WSN[:2]):
        if name not in header:
            raise InswsnError(f"{path} has no column {name}; it has {', '.join(header)[:200]}.")
    if (WSN[2] in header) != (WSN[3] in header):
        raise InswsnError(f"{path} has one of the columns {WSN[2]} and {WSN[3]}; both or neither.")
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(header):
            raise InswsnError(
                f"{path} has {len(row)} cells in row {number}; it may have {len(header)}, as the "
                "header has."
            )
    wanted = [TIME, *INS, *WSN]
    if set(REFERENCE) <= set(header):
        wanted += REFERENCE
    columns = {
        name: _numbers(path, name, [row[header.index(name)] for row in rows[1:]])
        if name in header
        else np.full(len(rows) - 1, np.nan)
        for name in wanted
    }
    return pd.DataFrame(columns)


def _read_rows(path: Path) -> list[list[str]]:
    """Return the header and the rows, without comments and empty lines."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InswsnError(f"There is no file {path}.") from None
    except IsADirectoryError:
        raise InswsnError(f"{path} is a folder; it may be a CSV file.") from None
    except UnicodeDecodeError:
        raise InswsnError(f"{path} is not a CSV file: it is not UTF-8.") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    try:
        rows = list(csv.reader(lines, skipinitialspace=True, strict=True))
    except csv.Error as error:
        raise InswsnError(f"{path} is not a CSV file: {error}.") from None
    if not rows:
        raise InswsnError(f"{path} is empty; it may be a CSV file with a header.")
    return rows


def _numbers(path: Path, name: str, cells: list[str]) -> Array:
    texts = pd.Series(cells, dtype="str").str.strip()
    numbers = pd.to_numeric(texts, errors="coerce").astype(float)
    empty = texts.str.lower().isin(["", "nan"])
    wrong = (numbers.isna() & ~empty) | np.isinf(numbers)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise InswsnError(
            f"{path} has {cells[row][:40]!r} in column {name}, row {row + 2}; it may be a finite "
            "number, or empty where there is no fix."
        )
    return np.asarray(numbers.to_numpy(), dtype=np.float64)


def _check_time(path: Path, time: Array) -> Array:
    if time.size < 3:
        raise InswsnError(f"{path} has {time.size} rows; it may have 3 or more.")
    if np.isnan(time).any():
        row = int(np.flatnonzero(np.isnan(time))[0]) + 2
        raise InswsnError(f"{path} has no time stamp in row {row}.")
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.flatnonzero(steps <= 0)[0]) + 1
        what = "repeats" if steps[row - 1] == 0 else "goes back from"
        raise InswsnError(
            f"{path}: {TIME} {what} {time[row - 1]:.12g} s in row {row + 2}; time stamps may only "
            "increase. Sort the file, or drop the row."
        )
    if time[-1] - time[0] > np.median(steps) * max(_ALWAYS, _SPARSEST * time.size):
        row = int(np.argmax(steps)) + 1
        raise InswsnError(
            f"{path}: {TIME} jumps by {steps[row - 1]:.6g} s in row {row + 2}, where "
            f"{np.median(steps):.4g} s are usual; a clock may not have been set in between."
        )
    return time


def _check_values(path: Path, ins: Array, wsn: Array) -> None:
    missing = np.isnan(ins)
    if missing.any():
        row, column = (int(i[0]) for i in np.nonzero(missing))
        length = int(np.argmin(np.append(missing[row:, column], False)))
        raise InswsnError(
            f"{path} has no number in column {INS[column]} for {length} row"
            f"{'s' if length > 1 else ''} from row {row + 2}; an INS has no gaps. Leave such rows "
            "out, and the filters predict over them."
        )
    for column, name in enumerate(WSN[:2]):
        if np.isnan(wsn[:, column]).all():
            raise InswsnError(f"{path} has no number at all in column {name}.")


def _check_frame(path: Path, ins: Array, wsn: Array) -> None:
    fixed = np.flatnonzero(~np.isnan(wsn[:, :2]).any(axis=1))
    if fixed.size == 0:
        return
    apart = float(np.hypot(*(wsn[fixed[0], :2] - ins[fixed[0], :2])))
    if apart >= _FARTHEST:
        raise InswsnError(
            f"{path}: the first position of the network is {apart / 1000:.4g} km from that of the "
            "INS; both may be in one frame, that of the network."
        )


class _Series(NamedTuple):
    name: str
    values: Array


def _check_units(path: Path, time: Array, ins: Array, wsn: Array, reference: Array | None) -> None:
    """Refuse columns that have one shape and two scales, as a wrong unit makes them."""
    _agree_with_themselves(path, "ins", time, ins)
    _agree_with_themselves(path, "wsn", time, wsn)
    network, inertial = (_block_velocities(time, x[:, :2], wsn[:, :2]) for x in (wsn, ins))
    # a drift that is steady, or grows slowly, is not in the changes from one block to the next
    changes = [np.diff(velocities, axis=0) for velocities in (network, inertial)]
    names = ("the change of speed along wsn_x_m and wsn_y_m", "that along ins_x_m and ins_y_m")
    _same_scale(path, _Series(names[0], changes[0]), _Series(names[1], changes[1]), known=True)
    if reference is not None:
        _agree_with_themselves(path, "ref", time, reference)
        true = _block_velocities(time, reference[:, :2], wsn[:, :2])
        names = ("the speed along wsn_x_m and wsn_y_m", "that along ref_x_m and ref_y_m")
        _same_scale(path, _Series(names[0], network), _Series(names[1], true))


def _agree_with_themselves(path: Path, who: str, time: Array, values: Array) -> None:
    """Compare the velocities of one source with the displacements between its positions."""
    whole = np.flatnonzero(~np.isnan(values).any(axis=1))
    if whole.size < 2:
        return
    velocities = _block_velocities(time, values[:, :2], values)
    told = _block_means(time, values[:, 2:], values)
    _same_scale(
        path,
        _Series(f"the speed along {who}_x_m and {who}_y_m", velocities),
        _Series(f"that in {who}_vx_mps and {who}_vy_mps", told),
    )


def _blocks(time: Array, needed: Array) -> list[NDArray[np.intp]]:
    """Return the rows with all that is needed, in blocks of some seconds that share their ends."""
    rows = np.flatnonzero(~np.isnan(needed).any(axis=1))
    if rows.size < 2:
        return []
    steps = np.diff(time[rows])
    stretches = np.split(rows, np.flatnonzero(steps > _PATIENCE * np.median(steps)) + 1)
    blocks = []
    for stretch in stretches:
        first = 0
        for last in range(1, stretch.size):
            if time[stretch[last]] - time[stretch[first]] >= _BLOCK:
                blocks.append(stretch[first : last + 1])
                first = last
    longest = max(stretches, key=len)
    return blocks or ([longest] if longest.size > 1 else [])


def _block_velocities(time: Array, positions: Array, needed: Array) -> Array:
    return np.array(
        [
            (positions[rows[-1]] - positions[rows[0]]) / (time[rows[-1]] - time[rows[0]])
            for rows in _blocks(time, needed)
        ]
    ).reshape(-1, 2)


def _block_means(time: Array, values: Array, needed: Array) -> Array:
    return np.array(
        [
            np.trapezoid(values[rows], time[rows], axis=0) / (time[rows[-1]] - time[rows[0]])
            for rows in _blocks(time, needed)
        ]
    ).reshape(-1, 2)


def _same_scale(path: Path, one: _Series, other: _Series, known: bool = False) -> None:
    """Refuse two series of one shape and two scales; if `known`, of two known units alone."""
    count = len(one.values)
    sizes = float(np.linalg.norm(one.values)), float(np.linalg.norm(other.values))
    if count == 0 or min(sizes) == 0 or max(sizes) / np.sqrt(count) < _SLOWEST:
        return
    # noise lowers the likeness before it changes the scale by as much as a unit does
    likeness = float(np.sum(one.values * other.values)) / (sizes[0] * sizes[1])
    ratio = sizes[0] / sizes[1]
    # few and noisy changes may differ by much: only a gross factor between many tells a unit
    factor = _GROSS if known else _FACTOR
    if likeness < _LIKENESS or 1 / factor <= ratio <= factor or (known and count < _FEW):
        return
    near = [
        name
        for name, size in _UNITS.items()
        if min(abs(np.log(ratio / size)), abs(np.log(ratio * size))) < np.log(_NEAR)
    ]
    if known and not near:
        return
    looks = f", as with {' or '.join(near)}" if near else ""
    raise InswsnError(
        f"{path}: {one.name} is {ratio:.3g} times {other.name}{looks}; lengths are in m, speeds "
        f"in m/s, {TIME} in s."
    )


def _on_grid(path: Path, time: Array, ins: Array, wsn: Array, reference: Array | None) -> Recording:
    place = _places(time)
    slope, late = np.polyfit(place, time - time[0], 1)
    period, start = float(slope), float(time[0] + late)
    offset = time - start - place * period
    if (np.diff(place) <= 0).any() or np.abs(offset).max() > _JITTER * period:
        row = int(np.argmax(np.abs(offset)))
        raise InswsnError(
            f"{path}: the time stamp {time[row]:.12g} s in row {row + 2} is {offset[row]:+.3g} s "
            f"off an even grid of {period:.4g} s; a fifth of a period is allowed. Resample the "
            "recording."
        )

    def spread(values: Array) -> Array:
        grid = np.full((place[-1] + 1, values.shape[1]), np.nan)
        grid[place] = values
        return grid

    return Recording(
        time=start + period * np.arange(place[-1] + 1),
        period=period,
        ins=spread(ins),
        wsn=spread(wsn),
        reference=None if reference is None else spread(reference),
        jitter=float(np.std(offset)),
    )


def _places(time: Array) -> NDArray[np.intp]:
    """Return the step of the grid that each time stamp belongs to.

    The median of the steps carries the rounding of the time stamps. So the period is fitted to the
    stretches without gaps first, and then tells how many steps each gap has.
    """
    steps = np.diff(time)
    usual = float(np.median(steps))
    stretch = np.concatenate([[0], np.cumsum(steps > 1.5 * usual)])
    index = np.arange(time.size, dtype=float)
    count = np.bincount(stretch)
    moved, counted = (
        x - (np.bincount(stretch, weights=x) / count)[stretch] for x in (time - time[0], index)
    )
    spread = float(np.sum(counted**2))
    period = float(np.sum(moved * counted)) / spread if spread > 0 else usual
    return np.concatenate([[0], np.cumsum(np.round(steps / period).astype(int))])
