"""Small folders of each kind of recording, whose values are known, and where the originals are."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from inswsn_lib.files import DATA_VARIABLE
from inswsn_lib.logs.registry import KNOWN
from inswsn_lib.streams import Recording

HALF = np.sqrt(0.5)
#: 2025-08-28 17:30:40 in the calendar of UTC, from `date -u -d ... +%s`
MOMENT = 1756402240


def needs(*names: str) -> pytest.MarkDecorator:
    """Return the mark of a test that asks for recorded data: `pytest -m recorded` runs these.

    It is skipped where the files are not.
    """
    return pytest.mark.recorded(*names)


def is_at_hand(name: str) -> bool:
    """Tell whether the mirror that is named has the files of a recording."""
    known, mirror = KNOWN[name], os.environ.get(DATA_VARIABLE)
    place = Path(known.repository.replace("/", "__"), known.commit, known.folder)
    return bool(mirror) and (Path(str(mirror)) / place).is_dir()


def write(path: Path, rows: Iterable[object], head: str = "") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{row}\n" for row in ([head] if head else []) + list(rows)))


def make_inrol(folder: Path) -> None:
    """Write 5 rows of an IMU that lies still, turned left by a quarter, and 5 ranges."""
    write(
        folder / "anchor.txt",
        ["7 1.0 2.0 0.5 0 0 0 1", "2 -1.0 2.0 2.5 0 0 0 1", "4 0.0 -2.0 1.5 0 0 0 1"],
        "# anchor_id tx ty tz qx qy qz qw",
    )
    write(
        folder / "imu.txt",
        [f"{i} {0.01 * i:.2f} 0.1 0.2 0.3 0.0 0.0 9.8" for i in range(5)],
        "# index timestamp wx wy wz ax ay az",
    )
    write(folder / "imu_pose.txt", [f"{0.008 * i:.3f} 1 2 {i} 0 0 {HALF} {HALF}" for i in range(6)])
    ranges = ["0.001 7 3.0", "0.001 4 2.0", "0.020 2 1.0", "0.019 7 3.5", "0.030 4 2.5"]
    write(folder / "uwb.txt", [f"{i} {row}" for i, row in enumerate(ranges)])


def make_plaza(folder: Path) -> None:
    """Write a robot that goes along y and turns to the left; GT tells where its rear points."""
    folder.mkdir(parents=True, exist_ok=True)
    times = np.array([0.9, 1.0, 1.1, 1.3])
    heading = np.array([0.0, 0.05, 0.1, 0.3]) - np.pi / 2
    variables = {
        "GT": np.column_stack([times, 5 + 0 * times, times, heading]),
        "DR": np.column_stack([times[1:], [0.2, 0.1, 0.6], [0.05, 0.05, 0.2]]),
        "DRp": np.zeros((4, 4)),
        "TD": np.array([[0.95, 2, 5, 7.5], [1.05, 2, 1, 2.5], [1.25, 2, 5, 7.0]]),
        "TL": np.array([[1.0, 10.0, 20.0], [5.0, 30.0, 40.0]]),
    }
    savemat(folder / "Some_.mat", variables)


def make_labyrinth(folder: Path) -> None:
    """Write 3 steps; the wheels are 0.2 m apart, and the second one is quicker, then slower."""
    wheels = ["0.2 0.4", "0.4 0.2", "0.3 0.3"]
    where = ["0 0 9", "2 0 5", "0 0 9"]
    write(
        folder / "Some_Input.txt",
        [f"range2 {i}.5 {i + 1} 0.01 {where[i]} 0 " for i in range(3)]
        + [f"odom2diff {i}.5 {wheels[i]} 0 0.1 1e-4 1e-4 1e-4 " for i in range(3)],
    )
    write(folder / "Some_GT.txt", [f"point2 {i}.5 {i} {2 * i} 0 0 0 0 " for i in range(3)])


def make_rtklib(folder: Path) -> None:
    """Write 40 rows of a log, each of which arrives 0.2 s after it was taken, and 4 fixes.

    Row i was taken 0.3 s + 10 i ms after 17:30:40; the latitude grows by 1e-5 degrees a fix, and
    the first is no good one.
    """
    rows = [f"0.01,-0.02,{1 + 1e-3 * i:.3f},1.0,2.0,{-0.5 * i},{5000 + 10 * i}" for i in range(40)]
    rows[0], rows[-1] = "13,5000", "0.01,-0.02"
    write(folder / "imu_1.csv", rows)
    tag = b"TIMETAG RTKLIB EX".ljust(60, b"\0") + struct.pack("<IId", 77, MOMENT, 0.25)
    length = 0
    for i, row in enumerate(rows):
        length += len(row) + 2
        tag += struct.pack("<II", 10 * i + 250, length)
    (folder / "imu_1.csv.tag").write_bytes(tag)
    write(
        folder / "gnss_1.pos",
        [
            f"2025/08/28 17:30:40.{250 * i:03d} {40 + 1e-5 * i:.7f} {-105 + 1e-5 * i:.7f} {i} "
            f"{2 - (i > 0)} 9 0.02 0.01 0.03 0 0 0 0 0 1.5 0.5 -0.25 0 0 0 0 0 0"
            for i in range(4)
        ],
        "%  GPST            latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) "
        "sdne(m) sdeu(m) sdun(m) age(s) ratio vn(m/s) ve(m/s) vu(m/s) sdvn sdve sdvu sdvne sdveu "
        "sdvun",
    )


def make_csv(folder: Path) -> None:
    """Write all files that a folder may have."""
    write(
        folder / "imu.csv",
        ["0.0,0.1,0.2,0.3,0.0,0.0,9.8", "0.01,0.1,0.2,0.3,0.5,-0.5,9.9"],
        "time_s,rate_x_radps,rate_y_radps,rate_z_radps,force_x_mps2,force_y_mps2,force_z_mps2",
    )
    write(folder / "odometry.csv", ["0.1,1.5,-0.2", "0.2,1.25,0"], "time_s,speed_mps,rate_radps")
    write(
        folder / "ranges.csv",
        ["0.1,A 1,2.5", "0.1,007,3.5", "0.2,A 1,2.25"],
        "time_s,anchor,range_m",
    )
    write(folder / "anchors.csv", ["007,1,2,3", "A 1,4,5,6"], "anchor,x_m,y_m,z_m")
    write(
        folder / "fixes.csv",
        ["0.0,1,2,3,0.1,0.2,0.01,0.02,1", "1.0,,,,,,,,0"],
        "time_s,x_m,y_m,z_m,vx_mps,vy_mps,sd_x_m,sd_y_m,good",
    )
    write(
        folder / "reference.csv",
        ["0.0,1,2,3,0,0,0,1", f"0.5,1,2,3,0,0,{HALF},{HALF}"],
        "time_s,x_m,y_m,z_m,qx,qy,qz,qw",
    )
    write(
        folder / "recording.yaml",
        [
            "name: a walk",
            "licence: mine",
            "lever_arm_m: [0, 0.5, 1]",
            "origin_rad_m: [0.7, -1.8, 9]",
        ],
    )


MADE: dict[str, Callable[[Path], None]] = {
    "inrol": make_inrol,
    "plaza": make_plaza,
    "labyrinth": make_labyrinth,
    "rtklib": make_rtklib,
    "csv": make_csv,
}


def values_of(recording: Recording) -> dict[str, object]:
    """Return all numbers of a recording by their names, for a comparison."""
    found: dict[str, object] = {"lever_arm": recording.lever_arm, "origin": recording.origin}
    for name, stream in recording.streams.items():
        found |= {f"{name}.{key}": value for key, value in vars(stream).items()}
    return found
