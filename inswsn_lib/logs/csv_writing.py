"""A recording written as a folder of CSV files, a stream each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.logs.about import ABOUT, write_about
from inswsn_lib.logs.columns import TIME
from inswsn_lib.logs.csv_folder import ANCHORS, COLUMNS, LAYOUTS, PLACE
from inswsn_lib.logs.rows import check_twins
from inswsn_lib.streams import Recording, Stream


def write_csv(recording: Recording, folder: str | Path) -> None:
    """Write a recording as a folder that `load` reads as the kind ``csv``.

    Numbers are written so that they are read again to the last bit.

    Parameters
    ----------
    recording : Recording
    folder : str or Path
        Made if it is not there; it may not have any of the files that are written.

    Raises
    ------
    InswsnError
        If a file is there already or cannot be written, or an anchor has a name that a CSV file
        does not hold.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> from inswsn_lib import logs, streams
    >>> walk = streams.Odometry(time=np.arange(3.0), speed=np.ones(3), rate=np.zeros(3))
    >>> with TemporaryDirectory() as folder:
    ...     logs.write_csv(streams.Recording("walk", odometry=walk), folder)
    ...     logs.load("csv", folder).span
    (0.0, 2.0)
    """
    folder = Path(folder)
    tables: dict[str, dict[str, Any]] = {
        f"{what}.csv": _columns(what, stream) for what, stream in recording.streams.items()
    }
    if recording.ranges is not None:
        names = _names(recording.ranges.names)
        tables["ranges.csv"]["anchor"] = np.array(names, dtype=object)[recording.ranges.anchor]
        tables[ANCHORS] = {"anchor": names} | _spread(PLACE, recording.ranges.anchors)
    if taken := [name for name in (*LAYOUTS, ABOUT) if (folder / name).exists()]:
        raise InswsnError(f"{folder} has {', '.join(taken)} already; it must be a new folder.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, columns in tables.items():
            pd.DataFrame(columns).to_csv(folder / name, index=False, lineterminator="\n")
        write_about(recording, folder / ABOUT)
    except OSError as error:
        raise InswsnError(f"{folder} cannot be written to: {error.strerror}.") from None


def _columns(what: str, stream: Stream) -> dict[str, Array]:
    found = {TIME: stream.time}
    for attribute, names in COLUMNS[what].items():
        value = getattr(stream, attribute)
        if value is not None:
            found |= _spread(names, value * 1)  # bools become 0 and 1
    return found


def _spread(names: tuple[str, ...], value: Array) -> dict[str, Array]:
    """Return the columns of an array by their names; in a plane there are fewer of them."""
    return dict(zip(names, np.atleast_2d(value.T), strict=False))


def _names(names: tuple[str, ...]) -> list[str]:
    """Return the names of anchors; refuse those that would not be read again."""
    for name in names:
        if not name or name != name.strip() or not name.isprintable() or name.startswith("#"):
            raise ParameterError("an anchor's name", name, "a word without # or blanks around it")
    check_twins(names)
    return list(names)
