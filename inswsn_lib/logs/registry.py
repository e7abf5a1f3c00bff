"""The recordings known by name, and the kinds whose files are read from any folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from inswsn_lib.checks import one_of
from inswsn_lib.errors import ParameterError
from inswsn_lib.files import read_yaml
from inswsn_lib.logs.csv_folder import read_csv_folder
from inswsn_lib.logs.files import Known, Place, locate
from inswsn_lib.logs.radio_kinds import read_inrol, read_labyrinth, read_plaza
from inswsn_lib.logs.rtklib import read_rtklib
from inswsn_lib.streams import Recording

#: What reads the files of a kind
READERS: dict[str, Callable[[Place], Recording]] = {
    "inrol": read_inrol, "plaza": read_plaza, "labyrinth": read_labyrinth, "rtklib": read_rtklib,
    "csv": read_csv_folder,
}  # fmt: skip


#: By name; what stands before the slash is the kind
KNOWN = {
    name: Known(**said) for name, said in read_yaml(Path(__file__).with_name("known.yaml")).items()
}


def names() -> tuple[str, ...]:
    """Return the names of the known recordings.

    Examples
    --------
    >>> from inswsn_lib import logs
    >>> logs.names()[:4]
    ('inrol/1', 'inrol/2', 'plaza/1', 'plaza/2')
    """
    return tuple(KNOWN)


def load(name: str, folder: str | Path | None = None, cache: Path | None = None) -> Recording:
    r"""Return a known recording, or one of the same kind from a folder.

    Parameters
    ----------
    name : str
        One of `names`; with a folder, also a kind alone: ``"inrol"``, ``"plaza"``,
        ``"labyrinth"``, ``"rtklib"``, or ``"csv"``, which is for files of your own.
    folder : str or Path, optional
        With other files of the kind. The latency of a log is an argument of `rtklib.read_rtklib`.
    cache : Path, optional
        Folder for what is fetched once; the user's cache by default.

    Raises
    ------
    InswsnError
        If the name is not known, a file cannot be fetched (`RecordingUnavailableError`), is not
        there, is another than it should be by its digest, or is spoilt.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib import logs
    >>> with TemporaryDirectory() as folder:
    ...     _ = Path(folder, "fixes.csv").write_text("time_s,x_m,y_m\n0,1,2\n0.5,1,3\n")
    ...     logs.load("csv", folder).fixes.position.tolist()
    [[1.0, 2.0], [1.0, 3.0]]
    """
    if folder is None and name in tuple(READERS):
        raise ParameterError("folder", None, f"a folder with files of the kind {name}")
    one_of("name", name, (*KNOWN, *([] if folder is None else READERS)))
    kind = name.partition("/")[0]
    if folder is not None:
        found = READERS[kind](folder)
        own = found.name if kind == "csv" else f"{kind}/{Path(folder).absolute().name}"
        return replace(found, name=own, source=found.source or str(folder))
    known = KNOWN[name]
    found = READERS[kind](locate(known, cache))
    address = f"https://github.com/{known.repository}/tree/{known.commit}/{known.folder}"
    return replace(found, name=name, licence=known.licence, source=address)


def load_drive(cache: Path | None = None) -> Recording:
    """Return ``"rtklib/drive-0708"`` with the axes of the IMU forward, right, down.

    A car with an IMU of a phone's class at 100 Hz, which lies with x back, y right, z up, and RTK
    positions and velocities at 4 Hz. The cache and errors are those of `load`.

    Examples
    --------
    >>> from unittest.mock import patch
    >>> import inswsn_lib as iw
    >>> with patch.dict("os.environ", INSWSN_DATA="nowhere"):
    ...     iw.load_drive()  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    inswsn_lib.logs.files.RecordingUnavailableError: There is no file nowhere...
    """
    found, axes = load("rtklib/drive-0708", cache=cache), np.array([-1.0, 1.0, -1.0])
    assert found.imu is not None
    imu = replace(found.imu, rate=found.imu.rate * axes, force=found.imu.force * axes)
    return replace(found, imu=imu)
