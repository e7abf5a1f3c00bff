"""Reading a recording of an INS and a sensor network from a CSV file, and refusing a wrong one."""

from __future__ import annotations

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
#: The columns of the network, in the same frame; empty where there is no fix
WSN = ("wsn_x_m", "wsn_y_m", "wsn_vx_mps", "wsn_vy_mps")
#: The columns of a reference, if there is one
REFERENCE = ("ref_x_m", "ref_y_m", "ref_vx_mps", "ref_vy_mps")

# A time stamp may be this share of a period away from the grid.
_JITTER = 0.2
# Columns that are alike to this cosine may be compared in scale.
_LIKENESS = 0.8
# Below this speed (m/s) and this distance (m) units cannot be told.
_SLOWEST, _SHORTEST = 0.05, 1.0
_LENGTHS = {"feet": 3.2808, "cm": 100.0, "mm or km": 1000.0, "degrees of latitude": 111_200.0}
_SPEEDS = {"km/h": 3.6, "knots": 1.9438, "feet/s": 3.2808, "cm/s": 100.0, "mm/s": 1000.0}


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
        """The runs of steps without a whole fix: first step, and the step after the last."""
        missing = np.isnan(self.wsn).any(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(int)))
        return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def read_recording(path: Path) -> Recording:
    """Read a recording and put it on an even grid.

    The file is a CSV with a header and the columns `TIME`, `INS` and `WSN`; those of `REFERENCE`
    are taken if all of them are there, and others are ignored. Lines that begin with ``#`` are
    comments, and do not count when a row is named. The period is the median distance
    of the time stamps. Rows may be missing, and WSN cells may be empty: both are gaps.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InswsnError
        In one sentence that names the column and the row (the header is row 1), if the file cannot
        be read; a column is missing or has something that is no number; an INS cell is empty; time
        stamps repeat, go back, or are not even to a fifth of a period; there is no fix at all; or
        the columns contradict one another in a way that a wrong unit does.
    """
    table = _read_table(path)
    time = table[TIME].to_numpy()
    period = _check_time(path, time)
    ins, wsn = table[list(INS)].to_numpy(), table[list(WSN)].to_numpy()
    _check_values(path, ins, wsn)
    _check_units(path, time, ins, wsn)
    reference = None
    if set(REFERENCE) <= set(table.columns):
        reference = table[list(REFERENCE)].to_numpy()
    return _on_grid(path, time, period, ins, wsn, reference)


def _read_table(path: Path) -> pd.DataFrame:
    try:
        table = pd.read_csv(path, dtype=str, skipinitialspace=True, comment="#")
    except FileNotFoundError:
        raise InswsnError(f"There is no file {path}.") from None
    except IsADirectoryError:
        raise InswsnError(f"{path} is a folder; it may be a CSV file.") from None
    except (UnicodeDecodeError, pd.errors.ParserError, pd.errors.EmptyDataError) as error:
        raise InswsnError(f"{path} is not a CSV file: {' '.join(str(error).split())}.") from None
    table.columns = [str(name).strip() for name in table.columns]
    for name in (TIME, *INS, *WSN):
        if name not in table.columns:
            raise InswsnError(f"{path} has no column {name}; it has {', '.join(table.columns)}.")
    known = [name for name in (TIME, *INS, *WSN, *REFERENCE) if name in table.columns]
    return pd.DataFrame({name: _numbers(path, name, table[name]) for name in known})


def _numbers(path: Path, name: str, cells: pd.Series[str]) -> pd.Series[float]:
    numbers = pd.to_numeric(cells, errors="coerce")
    empty = cells.isna() | cells.str.strip().str.lower().isin(["", "nan"])
    wrong = (numbers.isna() & ~empty) | np.isinf(numbers)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise InswsnError(
            f"{path} has {cells.iloc[row]!r} in column {name}, row {row + 2}; it may be a finite "
            "number, or empty where there is no fix."
        )
    return numbers.astype(float)


def _check_time(path: Path, time: Array) -> float:
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
            f"{path}: {TIME} {what} {time[row - 1]:g} s in row {row + 2}; time stamps may only "
            "increase. Sort the file, or drop the row."
        )
    return float(np.median(steps))


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
    for column, name in enumerate(WSN):
        if np.isnan(wsn[:, column]).all():
            raise InswsnError(f"{path} has no number at all in column {name}.")


def _check_units(path: Path, time: Array, ins: Array, wsn: Array) -> None:
    """Refuse columns that have one shape and two scales, as a wrong unit makes them."""
    moved = np.diff(ins[:, :2], axis=0) / np.diff(time)[:, None]
    speed = (ins[1:, 2:] + ins[:-1, 2:]) / 2
    ins_speed = _Series("the speed in ins_vx_mps and ins_vy_mps", speed)
    moving = _Series("the speed at which ins_x_m and ins_y_m move", moved)
    _same_scale(path, moving, ins_speed, _SLOWEST, 1.6, _SPEEDS | _LENGTHS | {"ms": 1000.0})
    fixed = np.flatnonzero(~np.isnan(wsn).any(axis=1))
    early = fixed[: max(5, fixed.size // 4)]  # later the INS has drifted, perhaps along its way
    if early.size == 0:
        return
    a = _Series("the speed in wsn_vx_mps and wsn_vy_mps", wsn[early, 2:])
    b = _Series(ins_speed.name, ins[early, 2:])
    _same_scale(path, a, b, _SLOWEST, 2.5, _SPEEDS)
    a, b = (
        _Series(f"the way along {name}_x_m and {name}_y_m", x[early, :2] - x[early[0], :2])
        for name, x in (("wsn", wsn), ("ins", ins))
    )
    _same_scale(path, a, b, _SHORTEST, 2.5, _LENGTHS)


class _Series(NamedTuple):
    name: str
    values: Array


def _same_scale(
    path: Path, one: _Series, other: _Series, least: float, factor: float, units: dict[str, float]
) -> None:
    sizes = float(np.linalg.norm(one.values)), float(np.linalg.norm(other.values))
    if min(sizes) == 0 or max(sizes) / np.sqrt(len(one.values)) < least:
        return
    # noise lowers the likeness before it changes the scale by as much as a unit does
    likeness = float(np.sum(one.values * other.values)) / (sizes[0] * sizes[1])
    ratio = sizes[0] / sizes[1]
    if likeness < _LIKENESS or 1 / factor <= ratio <= factor:
        return
    near = [
        name
        for name, size in units.items()
        if min(abs(np.log(ratio / size)), abs(np.log(ratio * size))) < np.log(1.3)
    ]
    looks = f", as with {' or '.join(near)}" if near else ""
    raise InswsnError(
        f"{path}: {one.name} is {ratio:.3g} times {other.name}{looks}; lengths are in m, speeds "
        f"in m/s, {TIME} in s."
    )


def _on_grid(
    path: Path, time: Array, period: float, ins: Array, wsn: Array, reference: Array | None
) -> Recording:
    # step by step, since the median may be off by more than a whole step over a long recording
    place = np.concatenate([[0], np.cumsum(np.round(np.diff(time) / period).astype(int))])
    slope, late = np.polyfit(place, time - time[0], 1)
    period, start = float(slope), float(time[0] + late)
    offset = time - start - place * period
    if (np.diff(place) <= 0).any() or np.abs(offset).max() > _JITTER * period:
        row = int(np.argmax(np.abs(offset)))
        raise InswsnError(
            f"{path}: the time stamp {time[row]:g} s in row {row + 2} is {offset[row]:+.3g} s off "
            f"an even grid of {period:.4g} s; a fifth of a period is allowed. Resample the "
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
