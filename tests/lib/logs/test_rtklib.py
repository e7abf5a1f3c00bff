"""A logged IMU and fixes of RTKLIB: made files, spoilt ones, and the two originals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from made_folders import MOMENT, make_rtklib, needs

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.rtklib import LATENCY, read_rtklib
from inswsn_lib.streams import Fixes, Recording

G0 = 9.80665
#: Lengths of a degree of latitude and of longitude at 40 degrees on the ellipsoid of WGS 84 (m)
NORTH, EAST = 111_034.6, 85_393.8


def test_the_log_is_on_the_clock_of_its_time_tag(tmp_path: Path) -> None:
    """The first row and the last are parts of rows; row i arrives 0.5 s + 10 i ms after 40 s."""
    make_rtklib(tmp_path)
    imu = read_rtklib(tmp_path).imu
    i = np.arange(1, 39)
    assert imu.time == pytest.approx(MOMENT + 0.5 + 0.01 * i - LATENCY, abs=1e-6)
    assert imu.force == pytest.approx(
        G0 * np.column_stack([0.01 + 0 * i, -0.02 + 0 * i, 1 + 1e-3 * i])
    )
    assert np.rad2deg(imu.rate) == pytest.approx(np.column_stack([1 + 0 * i, 2 + 0 * i, -0.5 * i]))
    later = read_rtklib(tmp_path, latency=0.2).imu
    assert later.time == pytest.approx(MOMENT + 0.3 + 0.01 * i, abs=1e-6)
    # where each second record of the tag is missing, every other row seems to arrive 10 ms late
    data = (tmp_path / "imu_1.csv.tag").read_bytes()
    records = np.frombuffer(data, "<u8", offset=76)[1::2].tobytes()
    (tmp_path / "imu_1.csv.tag").write_bytes(data[:76] + records)
    late = read_rtklib(tmp_path).imu
    assert late.time == pytest.approx(imu.time + 0.005, abs=5e-4)


def test_fixes_are_east_north_up_of_the_first_good_one(tmp_path: Path) -> None:
    make_rtklib(tmp_path)
    fixes = (read := read_rtklib(tmp_path)).fixes
    assert fixes.good.tolist() == [False, True, True, True]
    assert read.origin == pytest.approx([*np.deg2rad([40.00001, -104.99999]), 1.0])
    assert fixes.time == pytest.approx(MOMENT + np.array([0.0, 0.25, 0.5, 0.75]), abs=1e-6)
    step = 1e-5 * np.array([EAST, NORTH, 1e5])
    assert fixes.position == pytest.approx(np.outer([-1, 0, 1, 2], step), rel=1e-4, abs=1e-6)
    assert fixes.velocity == pytest.approx(np.tile([0.5, 1.5, -0.25], (4, 1)))
    assert fixes.deviation == pytest.approx(np.tile([0.01, 0.02, 0.03], (4, 1)))


def test_without_a_good_fix_the_first_is_the_origin_and_velocities_may_lack(tmp_path: Path) -> None:
    make_rtklib(tmp_path)
    lines = (tmp_path / "gnss_1.pos").read_text().splitlines()
    rows = [" ".join(line.split()[:15]).replace(" 1 9 ", " 5 9 ") for line in lines[1:]]
    (tmp_path / "gnss_1.pos").write_text("\n".join(rows))
    fixes = read_rtklib(tmp_path).fixes
    assert not fixes.good.any()
    assert fixes.position[0] == pytest.approx([0, 0, 0], abs=1e-9)
    assert fixes.velocity is None


def test_columns_are_found_by_the_head_and_weeks_are_time(tmp_path: Path) -> None:
    make_rtklib(tmp_path)
    path = tmp_path / "gnss_1.pos"
    expected = read_rtklib(tmp_path).fixes
    head, *rows = [line.split() for line in path.read_text().splitlines()]
    # 2025-08-28 is a Thursday: it begins 4 days after the week does
    weeks = [["2381", f"{408640 + 0.25 * k:.2f}", *row[2:]] for k, row in enumerate(rows)]

    def written(*lines: list[str]) -> Fixes:
        path.write_text("% program : RTKLIB\n" + "".join(" ".join(each) + "\n" for each in lines))
        return read_rtklib(tmp_path).fixes

    other = [row[:5] + row[15:] + row[5:15] for row in rows]  # velocities come first
    names = head[:5] + head[15:] + head[5:15]
    for lines in ([*weeks], [head, *weeks], [names, *other], [*rows]):
        found = written(*lines)
        for name, value in vars(expected).items():
            assert getattr(found, name) == pytest.approx(value, abs=1e-9), name


def test_baselines_are_positions(tmp_path: Path) -> None:
    make_rtklib(tmp_path)
    path = tmp_path / "gnss_1.pos"
    rows = [
        f"2025/08/28 17:30:4{k}.000 {5 + k}.0000 -2.5000 0.5000 1 9 0.02 0.01 0.03 0 0 0 0 9.9\n"
        for k in range(4)
    ]
    head = "%  GPST e-baseline(m) n-baseline(m) u-baseline(m) Q ns sde(m) sdn(m) sdu(m) sden(m) "
    path.write_text(f"{head} sdnu(m) sdue(m) age(s) ratio\n{''.join(rows)}")
    fixes = (read := read_rtklib(tmp_path)).fixes
    assert read.origin is None
    assert fixes.position.tolist() == [[5.0 + k, -2.5, 0.5] for k in range(4)]
    assert fixes.deviation[0].tolist() == [0.02, 0.01, 0.03]
    path.write_text("".join(rows))  # metres by their decimals
    with pytest.raises(InswsnError, match=r"has no head, and its columns may not be latitude"):
        read_rtklib(tmp_path)


# --- the originals ---


def turns(recording: Recording, slowest: float) -> tuple[float, float]:
    """Return likeness and slope of the gyroscope's turns against those of the course."""
    imu, fixes = recording.imu, recording.fixes
    course = np.unwrap(np.arctan2(fixes.velocity[:, 1], fixes.velocity[:, 0]))
    sums = np.concatenate([[0.0], np.cumsum(imu.rate[:-1, 2] * np.diff(imu.time))])
    moving = np.linalg.norm(fixes.velocity[:, :2], axis=1) > slowest
    inside = moving & (fixes.time > imu.time[0]) & (fixes.time < imu.time[-1])
    both = inside[1:] & inside[:-1]
    told = np.diff(course)[both]
    felt = np.diff(np.interp(fixes.time, imu.time, sums))[both]
    return float(np.corrcoef(told, felt)[0, 1]), float(told @ felt / (told @ told))


def check(recording: Recording) -> None:
    imu, fixes = recording.imu, recording.fixes
    # they overlap but for seconds, and gravity is upwards
    assert abs(imu.time[0] - fixes.time[0]) < 4
    assert abs(imu.time[-1] - fixes.time[-1]) < 4
    size = np.median(np.linalg.norm(imu.force, axis=1))
    assert size == pytest.approx(G0, rel=0.02)
    assert imu.force[:, 2].mean() > 0.98 * size
    # positions go where velocities say; a unit of the last digit is 1 cm, 4 times a second
    gone = np.gradient(fixes.position, fixes.time, axis=0)
    assert np.median(np.abs(gone - fixes.velocity), axis=0).max() < 0.05
    assert fixes.deviation.min() == pytest.approx(0.0098995)
    assert fixes.position[0] == pytest.approx([0, 0, 0], abs=1e-8)


@needs("rtklib/drive-0708")
def test_the_drive() -> None:
    check(drive := logs.load("rtklib/drive-0708"))
    assert drive.fixes.good.sum() == 2189
    assert np.rad2deg(drive.origin[:2]) == pytest.approx([40.0966268, -105.1474483])
    likeness, slope = turns(drive, 3.0)
    assert likeness > 0.98
    assert slope == pytest.approx(1.0, abs=0.05)


@needs("rtklib/walk-0827")
def test_the_walk() -> None:
    check(walk := logs.load("rtklib/walk-0827"))
    assert walk.fixes.good.sum() == 349
    steps = np.diff(walk.imu.time)
    assert 1 / steps.mean() == pytest.approx(152.36, abs=0.01)
    assert [steps.min(), steps.max()] == pytest.approx([6e-3, 9e-3], rel=1e-3)
    held = (np.diff(walk.imu.force, axis=0) == 0).all(axis=1)
    assert held.mean() == pytest.approx(0.35, abs=0.01)
    likeness, slope = turns(walk, 0.5)
    assert likeness > 0.85
    assert slope == pytest.approx(0.9, abs=0.15)
