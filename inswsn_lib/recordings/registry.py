"""The recordings known by name, and the kinds whose files are read from any folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from inswsn_lib.checks import one_of
from inswsn_lib.errors import ParameterError
from inswsn_lib.recordings.csv_folder import read_csv_folder
from inswsn_lib.recordings.files import Place, Source, locate
from inswsn_lib.recordings.inrol import read_inrol
from inswsn_lib.recordings.labyrinth import read_labyrinth
from inswsn_lib.recordings.plaza import read_plaza
from inswsn_lib.recordings.rtklib import read_rtklib
from inswsn_lib.streams import Recording

#: What reads the files of a kind
READERS: dict[str, Callable[[Place], Recording]] = {
    "inrol": read_inrol,
    "plaza": read_plaza,
    "labyrinth": read_labyrinth,
    "rtklib": read_rtklib,
    "csv": read_csv_folder,
}


@dataclass(frozen=True)
class Known:
    """A known recording: where it is, its licence, and how many coordinates it has."""

    source: Source
    licence: str
    dimension: int


_GNSS_IMU = "rtklibexplorer/GNSS_IMU", "8235ee6c5f349db529bf43ad556a3769b346b5a1"
_OF_ITS_REPOSITORY = "stated by the repository that holds it, whose words speak of software"
#: By name; what stands before the slash is the kind
KNOWN = {
    "inrol/1": Known(
        Source(
            "INRoL/inrol_uwb_localization",
            "40562b6fee3c72920b6f6972524990612a7f58b9",
            "example/filtering_state_estimation1/parsed_dataset",
            {
                "anchor.txt": "0dfac95032f40fc66835c7b483df773693c3b992ee81401bba00bb8d8d3aad54",
                "imu.txt": "c75d54e8a00ac6d4c19343615a8526a818387021cd4b366e351a8f2440917550",
                "imu_pose.txt": "58b123ccf5a46b140c3e8b2d30b4d1210ad52ff0f7b8deb8c1398b14418330e4",
                "uwb.txt": "25ffd69f5c330ef5b619941e338f8f46bc83e146923a9ce368db798b3d36030c",
            },
        ),
        f"GPL-3.0-only, {_OF_ITS_REPOSITORY}",
        3,
    ),
    "plaza/2": Known(
        Source(
            "borglab/gtsam",
            "0ffe6c930302ebd297484e65e6e8d467c91d26b0",
            "examples/Data",
            {"Plaza2_.mat": "72f0abe0fea2050eb5ee1cffc8c43823266a35785b7cdecac4ec5eae727561a2"},
        ),
        "none stated for the recording",
        2,
    ),
    "labyrinth/1": Known(
        Source(
            "TUC-ProAut/libRSF",
            "d54801a232af02c0cda6012dabd3dea6c5fd77c5",
            "datasets/Indoor_UWB",
            {
                "Indoor_UWB_Input.txt": (
                    "d0a1ac1e96f508a8fe7a0f40d4152d005ecd3e708403a521da93d4377e3c3b77"
                ),
                "Indoor_UWB_GT.txt": (
                    "49057cc9fdf14e464bca8cfab9894dddc1668c53e08878e30d6d1040e3f9f2a2"
                ),
            },
        ),
        "CC-BY-SA-4.0",
        2,
    ),
    "rtklib/drive-0708": Known(
        Source(
            *_GNSS_IMU,
            "data/drive_0708",
            {
                "imu_1934.csv": "f1126bf3b36efc4bef2dd2c7d93bb2a0e1b4ce714005cbea00a9218ad0b3b7a9",
                "imu_1934.csv.tag": (
                    "d30d13d5641df367559472b91b48325601a87c986bf2bb6af368684a36b5ec96"
                ),
                "gnss_1934_sf.pos": (
                    "618fba5c7193e8eb448faf95c79c0d198233d5f4e5ad8ffec652893911ff7133"
                ),
            },
        ),
        f"BSD-3-Clause, {_OF_ITS_REPOSITORY}",
        3,
    ),
    "rtklib/walk-0827": Known(
        Source(
            *_GNSS_IMU,
            "data/walk_0827",
            {
                "imu_1730.csv": "d2626cd6dfcf27a7ceaf6c1e50a4bdcd3f39dfd8b051e5326c47865f4e99a46a",
                "imu_1730.csv.tag": (
                    "c7a890f2fa56595166ea9e4e2011d20a6b939565c8e123a83d4973118be95a90"
                ),
                "gnss_1730_sf.pos": (
                    "5f2e17184047fb9e35c0d8fe8c317524d92bf490cd7fc66c41ae53df027eedf8"
                ),
            },
        ),
        f"BSD-3-Clause, {_OF_ITS_REPOSITORY}",
        3,
    ),
}


def names() -> tuple[str, ...]:
    """Return the names of the known recordings.

    Examples
    --------
    >>> from inswsn_lib import recordings
    >>> recordings.names()
    ('inrol/1', 'plaza/2', 'labyrinth/1', 'rtklib/drive-0708', 'rtklib/walk-0827')
    """
    return tuple(KNOWN)


def load(name: str, folder: str | Path | None = None, cache: Path | None = None) -> Recording:
    r"""Return a known recording, or one of the same kind from a folder.

    The files of one that is known are fetched once, or come from a local mirror, and are held
    against their digests. A folder is read as it is; digests of what was read are kept. The latency
    of a log is an argument of `rtklib.read_rtklib` alone.

    Parameters
    ----------
    name : str
        One of `names`; with a folder, also a kind alone: ``"inrol"``, ``"plaza"``,
        ``"labyrinth"``, ``"rtklib"``, or ``"csv"``, which is for files of your own.
    folder : str or Path, optional
        With other files of the kind.
    cache : Path, optional
        Folder for what is fetched; the user's cache by default.

    Raises
    ------
    InswsnError
        If the name is not known, a file cannot be fetched (`RecordingUnavailableError`), is not
        there, is another than it should be, or is spoilt.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib import recordings
    >>> with TemporaryDirectory() as folder:
    ...     _ = Path(folder, "fixes.csv").write_text("time_s,x_m,y_m\n0,1,2\n0.5,1,3\n")
    ...     recordings.load("csv", folder).fixes.position.tolist()
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
    found = READERS[kind](locate(known.source, cache))
    return replace(found, name=name, licence=known.licence, source=known.source.address)


def load_drive(cache: Path | None = None) -> Recording:
    """Return ``"rtklib/drive-0708"`` with the axes of the IMU forward, right, down.

    A car with an IMU of a phone's class at 100 Hz, which lies with x back, y right, z up, and RTK
    positions and velocities at 4 Hz. Its files are fetched once, or come from a local mirror.

    Parameters
    ----------
    cache : Path, optional
        Folder for what is fetched; the user's cache by default.

    Raises
    ------
    InswsnError
        If the files cannot be fetched (`RecordingUnavailableError`), or the mirror that
        ``INSWSN_DATA`` names lacks one or has another in its place.

    Examples
    --------
    >>> from unittest.mock import patch
    >>> import inswsn_lib as iw
    >>> with patch.dict("os.environ", INSWSN_DATA="nowhere"):
    ...     iw.load_drive()  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    inswsn_lib.recordings.files.RecordingUnavailableError: There is no file nowhere...
    """
    found, axes = load("rtklib/drive-0708", cache=cache), np.array([-1.0, 1.0, -1.0])
    assert found.imu is not None
    imu = replace(found.imu, rate=found.imu.rate * axes, force=found.imu.force * axes)
    return replace(found, imu=imu)
