"""The recorded drive: what is read and made of it, and every way to be refused."""

from __future__ import annotations

import logging
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pooch
import pytest
import requests
from hypothesis import given, strategies as st
from inswsn_book.files import file_digest
from numpy.typing import NDArray

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import DATA_VARIABLE
from inswsn_lib.vehicle import recorded
from inswsn_lib.vehicle.drive import Place
from inswsn_lib.vehicle.recorded import (
    LATENCY,
    DriveUnavailableError,
    ImuRecording,
    RecordedDrive,
    Track,
    emulate_sensors,
    fetch_drive,
    integrate_to_grid,
    load_drive,
    read_imu,
    read_positions,
    resample,
)

Array = NDArray[np.float64]
G0 = 9.80665
MIRROR = (
    "rtklibexplorer__GNSS_IMU/8235ee6c5f349db529bf43ad556a3769b346b5a1/data/drive_0708"  # as asked
)
NAMES = ("imu_1934.csv", "imu_1934.csv.tag", "gnss_1934_sf.pos")
HEADER = (
    "%  GPST            latitude(deg) longitude(deg) height(m) Q         ns        sdn(m)    "
    "sde(m)    sdu(m)    sdne(m)   sdeu(m)   sdun(m)  age(s)     ratio     vn(m/s)   ve(m/s)    "
    "vu(m/s)    sdvn      sdve     sdvu       sdvne    sdveu      sdvun"
)
# 2025-07-08 19:34:18 in the calendar of UTC, from `date -u -d ... +%s`
WHOLE = 1752003258


def one_sentence(error: pytest.ExceptionInfo[InswsnError]) -> str:
    message = str(error.value)
    assert message.endswith(".")
    assert "\n" not in message
    return message


# ------------------------------------------------------------------------------ the IMU's log


def imu_rows(count: int = 40) -> list[str]:
    """Return rows of 10 ms with one rate and one force, in the axes of the file."""
    return [f"0.100,0.200,0.970,-10.0,20.0,30.0,{261906 + 10 * i}" for i in range(count)]


def write_imu(
    folder: Path,
    rows: list[str],
    *,
    ending: str = "\n",
    tag_ending: int = 1,
    seconds: int = WHOLE,
    fraction: float = 0.5,
    period: float = 10.0,
) -> tuple[Path, Path]:
    """Write a log and a tag that lets row i arrive i periods (ms) after the start."""
    path, tag = folder / "imu.csv", folder / "imu.csv.tag"
    path.write_bytes("".join(row + ending for row in rows).encode())
    data = b"TIMETAG RTKLIB demo5".ljust(60, b"\0") + struct.pack("<IId", 77, seconds, fraction)
    length = 0
    for i, row in enumerate(rows):
        length += len(row) + tag_ending
        data += struct.pack("<II", round(i * period), length)
    tag.write_bytes(data)
    return path, tag


def test_the_log_is_in_si_units_along_forward_right_down(tmp_path: Path) -> None:
    imu = read_imu(*write_imu(tmp_path, imu_rows()))
    assert imu.specific_force.shape == imu.rate.shape == (38, 3)
    np.testing.assert_allclose(imu.specific_force[5], [-0.980665, 1.96133, -9.5124505], rtol=1e-9)
    np.testing.assert_allclose(np.rad2deg(imu.rate[7]), [10.0, 20.0, -30.0], rtol=1e-9)


def test_the_first_and_the_last_row_are_dropped_and_no_other(tmp_path: Path) -> None:
    rows = imu_rows()
    rows[0], rows[-1] = "906", "0.1,0.2,0.9"
    rows[1] = "0.500" + rows[1][5:]
    rows[-2] = "0.600" + rows[-2][5:]
    imu = read_imu(*write_imu(tmp_path, rows))
    assert len(imu.time) == 38
    np.testing.assert_allclose(imu.specific_force[[0, -1], 0], [-0.5 * G0, -0.6 * G0])


def test_a_last_row_without_an_end_is_dropped(tmp_path: Path) -> None:
    path, tag = write_imu(tmp_path, imu_rows())
    path.write_bytes(path.read_bytes()[:-1])
    tag.write_bytes(tag.read_bytes()[:-4] + struct.pack("<I", path.stat().st_size))
    assert len(read_imu(path, tag).time) == 38


@pytest.mark.parametrize(("ending", "tag_ending"), [("\n", 1), ("\n", 2), ("\r\n", 1), ("\r\n", 2)])
def test_time_is_that_of_arrival_less_the_latency(
    tmp_path: Path, ending: str, tag_ending: int
) -> None:
    imu = read_imu(*write_imu(tmp_path, imu_rows(), ending=ending, tag_ending=tag_ending))
    # row 1 is the first that is kept; 2 us is what a double holds of seconds since 1970
    expected = WHOLE + 0.5 + 0.010 * np.arange(1, 39) - LATENCY
    np.testing.assert_allclose(imu.time, expected, rtol=0, atol=2e-6)


def test_a_device_whose_clock_is_slow_is_put_on_the_clock_of_the_log(tmp_path: Path) -> None:
    imu = read_imu(*write_imu(tmp_path, imu_rows(400), period=10.02))
    expected = 0.01002 * np.arange(1, 399)
    np.testing.assert_allclose(imu.time - WHOLE - 0.5 + LATENCY, expected, rtol=0, atol=1e-3)
    assert imu.time[-1] - imu.time[0] == pytest.approx(3.97 * 1.002, abs=3e-4)


def test_delays_of_single_arrivals_do_not_reach_the_time(tmp_path: Path) -> None:
    rows = imu_rows(300)
    path, tag = write_imu(tmp_path, rows)
    # every third row only is told of: the two before it arrive with it
    data = tag.read_bytes()
    tag.write_bytes(data[:76] + b"".join(data[76 + 24 * i + 16 :][:8] for i in range(100)))
    imu = read_imu(path, tag)
    np.testing.assert_allclose(np.diff(imu.time), 0.01, rtol=0, atol=2e-6)


Change = Callable[[list[str]], list[str]]


def cell(row: int, column: int, text: str) -> Change:
    """Return what changes one cell; rows and columns count from 1."""

    def change(rows: list[str]) -> list[str]:
        cells = rows[row - 1].split(",")
        cells[column - 1] = text
        return [*rows[: row - 1], ",".join(cells), *rows[row:]]

    return change


def scaled(columns: range, factor: float) -> Change:
    def change(rows: list[str]) -> list[str]:
        table = [row.split(",") for row in rows]
        for cells in table:
            for column in columns:
                cells[column] = f"{float(cells[column]) * factor:.6f}"
        return [",".join(cells) for cells in table]

    return change


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (cell(7, 5, "abc"), r"'abc' in column rate y \(deg/s\), row 7"),
        (cell(9, 1, "nan"), r"'nan' in column specific force x \(g\), row 9"),
        (cell(9, 6, "-inf"), r"'-inf' in column rate z \(deg/s\), row 9"),
        (cell(2, 3, ""), r"'' in column specific force z \(g\), row 2"),
        (cell(4, 2, "0.2,0.2"), "8 cells in row 4; it may have 7"),
        (lambda rows: [*rows[:4], "0.1,0.2", *rows[5:]], "2 cells in row 5; it may have 7"),
        (lambda rows: [row + ",0" for row in rows], "8 cells in row 2; it may have 7"),
        (lambda rows: [*rows[:4], "", *rows[4:]], "1 cells in row 5; it may have 7"),
        (lambda rows: [*rows[:6], rows[5], *rows[6:]], r"device time \(ms\) repeats in row 7"),
        (
            lambda rows: [*rows[:9], rows[10], rows[9], *rows[11:]],
            r"device time \(ms\) goes back in row 11",
        ),
        (lambda rows: rows[:10] + rows[25:], r"device time \(ms\) jumps by 0.16 s in row 11"),
        (lambda rows: rows[:5], "has 5 rows; it may have 12 or more"),
        (scaled(range(3), G0), r"specific force of 9.762 in the median, as with m/s\^2"),
        (scaled(range(3), 1000.0), "specific force of 995.4 in the median, as with mg"),
        (scaled(range(3), 0.5), "force of 0.4977 in the median; on a road it may be near 1"),
        (scaled(range(3, 6), np.pi / 180), "rates of at most 0.5236, as with rad/s"),
        (scaled(range(3, 6), 1000.0), "rates of at most 3e.04; those of a drive"),
        (scaled(range(6, 7), 0.001), r"device time \(ms\) goes 0.001 times as fast"),
        (scaled(range(6, 7), 0.5), "goes 0.5 times as fast"),
    ],
)
def test_a_bad_log_is_refused(tmp_path: Path, change: Change, told: str) -> None:
    path, tag = write_imu(tmp_path, change(imu_rows()))
    with pytest.raises(InswsnError, match=told) as error:
        read_imu(path, tag)
    assert one_sentence(error).startswith(f"{path}")


def test_a_cell_of_a_million_characters_is_not_repeated(tmp_path: Path) -> None:
    with pytest.raises(InswsnError) as error:
        read_imu(*write_imu(tmp_path, cell(7, 5, "x" * 10**6)(imu_rows())))
    assert len(one_sentence(error)) < 500


@pytest.mark.parametrize("part", [0.4, 0.99])
def test_a_log_that_is_cut_is_refused(tmp_path: Path, part: float) -> None:
    path, tag = write_imu(tmp_path, imu_rows(100))
    path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])
    with pytest.raises(InswsnError, match=r"imu.csv.tag tells of \d+; one of them is cut") as error:
        read_imu(path, tag)
    one_sentence(error)


def test_an_arrival_that_is_far_off_is_refused(tmp_path: Path) -> None:
    path, tag = write_imu(tmp_path, imu_rows(10000))
    ticks = np.frombuffer(tag.read_bytes()[76:], "<u4").reshape(-1, 2).copy()
    ticks[9990:, 0] += 600
    tag.write_bytes(tag.read_bytes()[:76] + ticks.tobytes())
    with pytest.raises(InswsnError, match=r"is 0\.6 s off in row 999\d, by the arrivals"):
        read_imu(path, tag)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda data: b"", "is empty"),
        (lambda data: b"X" + data, "is not a time tag of RTKLIB"),
        (lambda data: data[:60], "is cut: it has 60 bytes"),
        (lambda data: data[:-3], "is cut: it has 393 bytes"),
        (lambda data: data[:84], "is cut: it has 84 bytes"),
        (lambda data: data[:84] + data[92:100] + data[84:92] + data[100:], "back in record 3"),
        (lambda data: data[:-8], "one of them is cut"),
    ],
)
def test_a_bad_time_tag_is_refused(
    tmp_path: Path, change: Callable[[bytes], bytes], told: str
) -> None:
    path, tag = write_imu(tmp_path, imu_rows())
    tag.write_bytes(change(tag.read_bytes()))
    with pytest.raises(InswsnError, match=told) as error:
        read_imu(path, tag)
    assert str(tag) in one_sentence(error)


@pytest.mark.parametrize("reader", [read_positions, lambda path: read_imu(path, path)])
def test_files_that_are_no_text_files_are_refused(
    tmp_path: Path, reader: Callable[[Path], object]
) -> None:
    path = tmp_path / "none"
    with pytest.raises(InswsnError, match=r"There is no file .*none"):
        reader(path)
    with pytest.raises(InswsnError, match="is a folder"):
        reader(tmp_path)
    path.write_bytes(b"")
    with pytest.raises(InswsnError, match="is empty"):
        reader(path)
    path.write_bytes(b"ab\xff")
    with pytest.raises(InswsnError, match="is not text: byte 3 is not ASCII"):
        reader(path)


# ------------------------------------------------------------------------- the RTK solution

# degrees for a metre east and north at 40 degrees north, from WGS84's radii there:
# a (1 - e^2) / w^3 = 6361815.8 and a / w = 6387001.9 m, and 1600 m of height
NORTHWARDS = 180 / np.pi / (6361815.8 + 1600)
EASTWARDS = 180 / np.pi / ((6387001.9 + 1600) * np.cos(np.deg2rad(40.0)))


def position_rows(count: int = 40, rate: int = 4) -> list[str]:
    """Return rows of a car that goes 3 m/s north, 4 m/s east and 0.5 m/s up from 40 north."""
    rows = []
    for i in range(count):
        # the first is at 18.499
        ms = 18499 + 1000 * i // rate
        t = i / rate
        rows.append(
            f"2025/07/08 19:34:{ms // 1000:02d}.{ms % 1000:03d} {40 + 3 * t * NORTHWARDS:.9f} "
            f"{-105 + 4 * t * EASTWARDS:.9f} {1600 + 0.5 * t:.4f} {1 + (i > 30)}.0000000 21.0000000"
            " 0.01 0.01 0.01 0.0 0.0 0.0 0.0 0.0 3.0000 4.0000 0.5000 0.05 0.05 0.05 0.0 0.0 0.0"
        )
    return rows


def write_positions(folder: Path, rows: list[str], header: str = HEADER) -> Path:
    path = folder / "made.pos"
    path.write_text("".join(f"{row}\n" for row in [header, *rows] if row is not None))
    return path


def test_a_solution_is_read_as_east_north_up_in_rad(tmp_path: Path) -> None:
    track = read_positions(write_positions(tmp_path, position_rows()))
    np.testing.assert_allclose(track.time, WHOLE + 0.499 + 0.25 * np.arange(40), atol=1e-6, rtol=0)
    np.testing.assert_allclose(track.velocity, np.tile([4.0, 3.0, 0.5], (40, 1)))
    np.testing.assert_allclose(
        track.position[0], [40 * np.pi / 180, -105 * np.pi / 180, 1600.0], rtol=1e-12
    )
    assert track.position[-1, 2] == pytest.approx(1600 + 0.5 * 39 / 4, abs=1e-3)
    assert track.quality.tolist() == [1] * 31 + [2] * 9
    np.testing.assert_allclose(track.speed, 5.0)
    np.testing.assert_allclose(np.rad2deg(track.course), 53.130102354)


def test_comments_before_the_header_are_passed_over(tmp_path: Path) -> None:
    path = write_positions(tmp_path, position_rows(), header=f"% program   : RTKPOST\n{HEADER}")
    assert len(read_positions(path).time) == 40


def word(row: int, column: int, text: str) -> Change:
    """Return what changes one word of a row of positions; both count from 1."""

    def change(rows: list[str]) -> list[str]:
        words = rows[row - 1].split()
        words[column - 1] = text
        return [*rows[: row - 1], " ".join(words), *rows[row:]]

    return change


def each(row_change: Callable[[list[str]], list[str]]) -> Change:
    return lambda rows: [" ".join(row_change(row.split())) for row in rows]


def times(words: list[str], first: int, last: int, factor: float) -> list[str]:
    numbers = [f"{float(x) * factor:.9f}" for x in words[first:last]]
    return [*words[:first], *numbers, *words[last:]]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        # the header is line 1
        (word(3, 3, "north"), r"'north' in column latitude\(deg\), row 4"),
        (word(5, 17, "nan"), r"'nan' in column ve\(m/s\), row 6"),
        (word(5, 24, "-"), "'-' in column sdvun, row 6"),
        (word(6, 2, "19:34:61.000"), "'2025/07/08 19:34:61.000' in column GPST, row 7"),
        (word(6, 1, "2374"), "'2374 .*' in column GPST, row 7"),
        (lambda rows: [*rows[:4], rows[4][:90], *rows[5:]], "9 cells in row 6; it may have 24"),
        (lambda rows: [row + " 0.0" for row in rows], "25 cells in row 2; it may have 24"),
        (lambda rows: [*rows[:4], "", *rows[4:]], "0 cells in row 6; it may have 24"),
        (lambda rows: [*rows[:5], rows[4], *rows[5:]], "GPST repeats in row 7"),
        (lambda rows: [*rows[:5], rows[6], rows[5], *rows[7:]], "GPST goes back in row 8"),
        (lambda rows: rows[:8] + rows[9:], "leaves its even steps of 0.25 s in row 10"),
        (lambda rows: rows[::3], "leaves its even steps of 1 s in row 3"),
        (lambda rows: rows[:3], "has 3 rows of positions; it may have 10"),
        (word(4, 3, "90.5"), r"90.5 in column latitude\(deg\), row 5; there is no such value"),
        (word(4, 4, "-180.5"), r"-180.5 in column longitude\(deg\), row 5"),
        (word(4, 6, "0"), "0 in column Q, row 5"),
        (word(4, 6, "1.5"), "1.5 in column Q, row 5"),
        (each(lambda x: times(x, 15, 18, 3.6)), "are 18 m and 5 m a second, and 13 m apart"),
        (each(lambda x: [*x[:15], x[16], x[15], *x[17:]]), "velocities and changes of position"),
        (each(lambda x: times(x, 2, 4, np.pi / 180)), "latitude and longitude in degrees"),
        (each(lambda x: [*x[:2], x[3], x[2], *x[4:]]), r"-105 in column latitude\(deg\), row 2"),
    ],
)
def test_a_bad_solution_is_refused(tmp_path: Path, change: Change, told: str) -> None:
    path = write_positions(tmp_path, change(position_rows()))
    with pytest.raises(InswsnError, match=told) as error:
        read_positions(path)
    assert one_sentence(error).startswith(f"{path}")


@pytest.mark.parametrize(
    ("header", "told"),
    [
        (HEADER.replace("GPST", "UTC "), "has the column 'UTC' as number 1, not GPST"),
        (HEADER.replace("vn(m/s)   ve(m/s)", "ve(m/s)   vn(m/s)"), "'ve.m/s.' as number 15"),
        (HEADER[: HEADER.index("vn(m/s)")], "'none' as number 15, not vn"),
        ("% nothing", "has no line that begins with % and names its columns"),
    ],
)
def test_other_columns_are_refused(tmp_path: Path, header: str, told: str) -> None:
    path = write_positions(tmp_path, position_rows(), header=header)
    with pytest.raises(InswsnError, match=told) as error:
        read_positions(path)
    assert one_sentence(error).startswith(f"{path}")


def test_a_solution_without_its_end_is_refused(tmp_path: Path) -> None:
    path = write_positions(tmp_path, position_rows())
    path.write_text(path.read_text()[:-3])
    with pytest.raises(InswsnError, match="is cut: its last row has no end"):
        read_positions(path)


def test_a_car_that_stands_is_not_refused_for_its_noise(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)

    def stand(words: list[str]) -> list[str]:
        north, east = 0.01 * rng.normal(size=2)
        speeds = [f"{x:.4f}" for x in 0.01 * rng.normal(size=3)]
        place = [f"{40 + north * NORTHWARDS:.9f}", f"{-105 + east * EASTWARDS:.9f}"]
        return [*words[:2], *place, *words[4:15], *speeds, *words[18:]]

    track = read_positions(write_positions(tmp_path, each(stand)(position_rows())))
    assert track.speed.max() < 0.1


# --------------------------------------------------------------------------------- resampling


@given(
    steps=st.lists(st.floats(0.001, 0.1), min_size=3, max_size=30),
    shares=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30, unique=True),
    seed=st.integers(0, 1000),
)
def test_resampling_keeps_the_integral(steps: list[float], shares: list[float], seed: int) -> None:
    time = np.concatenate([[5.0], 5.0 + np.cumsum(steps)])
    values = np.random.default_rng(seed).normal(size=(time.size, 3))
    inner = 5.0 + np.array(shares) * (time[-1] - 5.0)
    grid = np.unique(np.concatenate([time[[0, -1]], np.minimum(inner, time[-1])]))
    total = integrate_to_grid(time, values, grid).sum(axis=0)
    expected = sum(
        (time[i + 1] - time[i]) * (values[i] + values[i + 1]) / 2 for i in range(len(steps))
    )
    np.testing.assert_allclose(total, expected, rtol=0, atol=1e-12)


@given(rate=st.floats(-5, 5), seed=st.integers(0, 1000))
def test_a_steady_rate_fills_every_sample_alike(rate: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.concatenate([[0.0], np.cumsum(rng.uniform(0.008, 0.011, 200))])
    grid = np.arange(0.003, 1.5, 0.01)
    increments = integrate_to_grid(time, np.full((201, 1), rate), grid)
    np.testing.assert_allclose(increments, 0.01 * rate, rtol=0, atol=1e-12)


def test_between_two_samples_the_integral_grows_evenly() -> None:
    # the integral of 0, 2, 2 at 0, 1, 2 s is 0, 1, 3
    increments = integrate_to_grid(
        np.array([0.0, 1.0, 2.0]), np.array([[0.0], [2.0], [2.0]]), np.array([0.5, 1.0, 1.5])
    )
    np.testing.assert_allclose(increments[:, 0], [0.5, 1.0])


@pytest.mark.parametrize("grid", [[-0.1, 0.5], [0.5, 2.1]])
def test_a_grid_beyond_the_samples_is_refused(grid: list[float]) -> None:
    with pytest.raises(ParameterError, match="grid is"):
        integrate_to_grid(np.array([0.0, 2.0]), np.zeros((2, 1)), np.array(grid))


# the made drive: its course (rad) and speed (m/s) at time t (s)
SPEED = 8.0


def course(t: Array) -> Array:
    return np.asarray(0.4 + 0.25 * t + 0.3 * np.sin(0.7 * t))


def yaw_rate(t: Array) -> Array:
    return np.asarray(0.25 + 0.21 * np.cos(0.7 * t))


def made_imu(first: float = -0.3, last: float = 20.4) -> ImuRecording:
    """Return an IMU on a flat road, sampled at uneven times."""
    rng = np.random.default_rng(3)
    t = first + np.cumsum(rng.uniform(0.008, 0.011, int((last - first) / 0.0095)))
    force = np.column_stack([0 * t, SPEED * yaw_rate(t), 0 * t - 9.8])
    rate = np.column_stack([0 * t, 0 * t, yaw_rate(t)])
    return ImuRecording(WHOLE - 0.001 + t, force, rate)


def made_track(count: int = 80, first: float = -0.5) -> Track:
    t = first + 0.25 * np.arange(count)
    fine = np.arange(first, t[-1] + 0.001, 0.001)
    moves = SPEED * 0.001 * np.column_stack([np.cos(course(fine)), np.sin(course(fine))])
    places = np.cumsum(moves, axis=0)[np.searchsorted(fine, t - 1e-6)]
    velocity = SPEED * np.column_stack([np.sin(course(t)), np.cos(course(t)), 0 * t])
    position = np.column_stack(
        [
            np.deg2rad(40 + NORTHWARDS * places[:, 0]),
            np.deg2rad(-105 + EASTWARDS * places[:, 1]),
            1600 + 0 * t,
        ]
    )
    quality = np.where(t < 5, 1, 2)
    return Track(WHOLE - 0.001 + t, position, velocity, quality)


def test_epochs_are_the_rows_nearest_to_whole_seconds() -> None:
    imu, track = made_imu(), made_track()
    drive = resample(imu, track)
    # the IMU begins 0.3 s before the epoch at 0; row 2 has this epoch, and the last row 19.25 s
    assert drive.start == WHOLE - 0.001
    np.testing.assert_array_equal(drive.time, np.arange(20.0))
    assert drive.period == 0.01
    assert drive.rotation_increments.shape == drive.velocity_increments.shape == (1900, 3)
    np.testing.assert_array_equal(drive.position, track.position[2:79:4])
    np.testing.assert_array_equal(drive.velocity, track.velocity[2:79:4])
    np.testing.assert_allclose(drive.track.time, 0.25 * np.arange(77), rtol=0, atol=1e-6)
    np.testing.assert_array_equal(drive.track.position, track.position[2:79])
    # 20 of the 77 rows are before 5 s
    assert drive.fixed_share == 20 / 77


def test_an_epoch_that_the_imu_does_not_cover_is_left_out() -> None:
    drive = resample(made_imu(first=0.0, last=18.9), made_track())
    assert drive.start == WHOLE + 0.999
    assert len(drive.time) == 18


def test_each_second_turns_as_the_course_did() -> None:
    drive = resample(made_imu(), made_track())
    # a straight line between samples of the integral is off by up to 0.15 * 0.011^2 / 8
    turned = drive.rotation_increments[:, 2].reshape(19, 100).sum(axis=1)
    np.testing.assert_allclose(turned, np.diff(course(np.arange(20.0))), rtol=0, atol=5e-6)
    # and each sample is in its place: the next one differs by up to 0.15 * 0.01^2
    ends = 0.01 * np.arange(1901)
    np.testing.assert_allclose(
        drive.rotation_increments[:, 2], np.diff(course(ends)), rtol=0, atol=5e-6
    )


def test_velocity_increments_are_in_the_axes_at_the_beginning_of_their_sample() -> None:
    # w about z and f along y for T: -f (1 - cos wT) / w along x, and f sin wT / w along y
    t = np.arange(-0.5, 20.5, 0.01)
    rate = np.tile([0.0, 0.0, 0.5], (t.size, 1))
    force = np.tile([0.0, 4.0, -9.8], (t.size, 1))
    track = made_track()
    at = 0.5 * (track.time - track.time[0])
    velocity = 8.0 * np.column_stack([np.sin(at), np.cos(at), 0 * at])
    drive = resample(
        ImuRecording(WHOLE - 0.001 + t, force, rate),
        Track(track.time, track.position, velocity, track.quality),
    )
    expected = [-4 * (1 - np.cos(0.005)) / 0.5, 4 * np.sin(0.005) / 0.5, -0.098]
    np.testing.assert_allclose(drive.velocity_increments[500], expected, rtol=0, atol=2e-7)


def test_coning_is_corrected() -> None:
    # two rates in quadrature: the third axis gains half of A^2 w in the mean
    size, frequency = 0.02, 2 * np.pi * 5
    t = np.arange(-0.5, 20.5, 0.001)
    wobble = [np.cos(frequency * t), np.sin(frequency * t), 0 * t]
    rate = size * frequency * np.column_stack(wobble)
    track = made_track()
    still = Track(track.time, track.position, 0 * track.velocity, track.quality)
    imu = ImuRecording(WHOLE - 0.001 + t, np.tile([0.0, 0.0, -9.8], (t.size, 1)), rate)
    gained = resample(imu, still).rotation_increments.sum(axis=0)
    # what is left out of coning at samples of T is (1 - sin(wT) / wT) of it; pyins gets most
    half = 0.5 * size**2 * frequency * 19
    share = 1 - np.sin(0.01 * frequency) / (0.01 * frequency)
    assert gained[2] == pytest.approx(half * share, rel=0.02)


@pytest.mark.parametrize(("first", "last"), [(-0.3, 1.9), (30.0, 40.0), (-40.0, -30.0)])
def test_too_little_in_common_is_refused(first: float, last: float) -> None:
    with pytest.raises(InswsnError, match=r"from 2025/07/08 19:3.* share 2 s or more") as error:
        resample(made_imu(first, last), made_track())
    one_sentence(error)


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (180 / np.pi, "turns 57.3 times as much"),
        (np.pi / 180, "turns 0.0175 times as much"),
        (-1.0, "with a correlation of -1"),
        (1.4, "turns 1.4 times as much"),
    ],
)
def test_turns_in_another_unit_are_refused(factor: float, told: str) -> None:
    imu = made_imu()
    with pytest.raises(InswsnError, match=told) as error:
        resample(ImuRecording(imu.time, imu.specific_force, factor * imu.rate), made_track())
    one_sentence(error)


def test_turns_of_another_drive_are_refused() -> None:
    imu = made_imu()
    other = imu.rate - 2 * np.array([0.0, 0.0, 0.25])
    with pytest.raises(InswsnError, match="may be of one drive"):
        resample(ImuRecording(imu.time, imu.specific_force, other), made_track())


# --------------------------------------------------------------------------------- emulation


def made_drive(velocity: Array | None = None, epochs: int = 50) -> RecordedDrive:
    if velocity is None:
        velocity = np.tile([-6.0, 8.0, 0.2], (epochs, 1))
    epochs = len(velocity)
    position = np.tile([np.deg2rad(40.0), np.deg2rad(-105.0), 1600.0], (epochs, 1))
    rng = np.random.default_rng(5)
    rotation, push = rng.normal(size=(2, 100 * (epochs - 1), 3))
    time = np.arange(float(epochs))
    track = Track(time, position, velocity, np.ones(epochs, dtype=np.int64))
    return RecordedDrive(0.0, time, 0.01, rotation, push, position, velocity, track)


def test_the_noise_is_as_asked() -> None:
    made = made_drive()
    drive = emulate_sensors(made, runs=400, seed=1)
    assert drive.origin == "recorded"
    assert drive.gps_position.shape == (50, 3, 400)
    moved = np.rad2deg(drive.gps_position[:, :2] - made.position[:, :2, None])
    metres = np.stack(
        [
            moved[:, 0] / NORTHWARDS,
            moved[:, 1] / EASTWARDS,
            drive.gps_position[:, 2] - 1600.0,
        ]
    )
    speeds = np.moveaxis(drive.gps_velocity - made.velocity[:, :, None], 1, 0)
    angles = drive.compass - np.arctan2(-6.0, 8.0)
    # 20000 numbers: five of their standard errors are 2.5 per cent of a deviation
    for errors, sd in [*((x, 3.0) for x in metres), *((x, 0.05) for x in speeds), (angles, None)]:
        size = np.deg2rad(0.15) if sd is None else sd
        assert errors.std() == pytest.approx(size, rel=0.025)
        assert abs(errors.mean()) < 5 * size / np.sqrt(20000)
        assert abs(np.mean(errors[1:] * errors[:-1])) < 5 * size**2 / np.sqrt(19600)
        assert abs(np.mean(errors[:, 1:] * errors[:, :-1])) < 5 * size**2 / np.sqrt(19950)
    pairs = [(metres[0], metres[1]), (metres[1], metres[2]), (metres[0], speeds[0])]
    for one, other in pairs:
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 5 / np.sqrt(20000)


def test_the_sizes_of_the_noise_are_taken_one_by_one() -> None:
    made = made_drive()
    none = {"gps_position_sd": 0.0, "gps_velocity_sd": 0.0, "compass_sd": 0.0}
    drive = emulate_sensors(made, runs=3, seed=1, **none)
    np.testing.assert_array_equal(drive.gps_position[:, :, 2], made.position)
    np.testing.assert_array_equal(drive.gps_velocity[:, :, 2], made.velocity)
    np.testing.assert_allclose(drive.compass, np.arctan2(-6.0, 8.0), rtol=1e-15)
    drive = emulate_sensors(made, runs=300, seed=1, **{**none, "compass_sd": 0.01})
    assert drive.compass.std() == pytest.approx(0.01, rel=0.03)
    drive = emulate_sensors(made, runs=300, seed=1, **{**none, "gps_velocity_sd": 0.7})
    assert (drive.gps_velocity - made.velocity[:, :, None]).std() == pytest.approx(0.7, rel=0.02)


def test_the_reference_is_rtk_without_an_attitude() -> None:
    made = made_drive()
    drive = emulate_sensors(made, runs=2, seed=1, places=[Place("bend", 7)])
    np.testing.assert_array_equal(drive.reference.position, made.position)
    np.testing.assert_array_equal(drive.reference.velocity, made.velocity)
    assert drive.reference.attitude is None
    assert drive.reference.gyro_bias is None
    assert drive.places == (Place("bend", 7),)
    np.testing.assert_array_equal(drive.time, made.time)
    assert (drive.period, drive.samples_per_epoch, drive.runs) == (0.01, 100, 2)


def test_the_seed_tells_the_noise() -> None:
    made = made_drive()
    one, same, other = (emulate_sensors(made, runs=2, seed=s) for s in (4, 4, 5))
    for name in ("gps_position", "gps_velocity", "compass"):
        np.testing.assert_array_equal(getattr(one, name), getattr(same, name))
        assert (getattr(one, name) != getattr(other, name)).all()


def test_the_course_is_held_at_low_speed() -> None:
    # east, north, up: rest, east, too slow, north at the limit, slow, south-west
    velocity = np.array(
        [
            [0, 0, 0],
            [0.1, -0.5, 0],
            [3, 0, 0],
            [-0.7, 0.7, 5],
            [0, 1, 0],
            [0, -0.99, 0],
            [-2, -2, 0],
        ],
        dtype=float,
    )
    drive = emulate_sensors(made_drive(velocity), runs=2, seed=1, compass_sd=0.0)
    expected = np.deg2rad([90.0, 90.0, 90.0, 90.0, 0.0, 0.0, -135.0])
    np.testing.assert_allclose(drive.compass, np.column_stack([expected, expected]), atol=1e-12)
    drive = emulate_sensors(made_drive(velocity), runs=1, seed=1, compass_sd=0.0, hold_below=2.5)
    expected = np.deg2rad([90.0] * 6 + [-135.0])
    np.testing.assert_allclose(drive.compass[:, 0], expected, atol=1e-12)


def test_a_held_course_is_measured_anew_each_second() -> None:
    velocity = np.zeros((300, 3))
    velocity[0] = [0, 5, 0]
    drive = emulate_sensors(made_drive(velocity), runs=1, seed=1, compass_sd=0.01)
    assert drive.compass.std() == pytest.approx(0.01, rel=0.2)


@pytest.mark.parametrize("east", [0.0, -0.0])
def test_the_compass_is_wrapped(east: float) -> None:
    velocity = np.tile([east, -5.0, 0.0], (200, 1))
    exact = emulate_sensors(made_drive(velocity), runs=1, seed=1, compass_sd=0.0)
    np.testing.assert_array_equal(exact.compass, np.pi)
    noisy = emulate_sensors(made_drive(velocity), runs=1, seed=1, compass_sd=0.1).compass
    assert ((noisy > -np.pi) & (noisy <= np.pi)).all()
    assert 60 < (noisy < 0).sum() < 140
    assert np.abs(noisy).min() > 2.5
    # a last digit beyond pi must not become -pi
    close = emulate_sensors(made_drive(velocity), runs=1, seed=1, compass_sd=5e-16).compass
    assert (close > -np.pi).all()


def test_the_imu_is_that_of_the_recording_in_every_run() -> None:
    made = made_drive()
    drive = emulate_sensors(made, runs=3, seed=1)
    for run in range(3):
        np.testing.assert_array_equal(
            drive.rotation_increments[:, :, run], made.rotation_increments
        )
        np.testing.assert_array_equal(
            drive.velocity_increments[:, :, run], made.velocity_increments
        )


def yawed(degrees: float) -> Array:
    """Return the rotation to axes that are turned to the left: what was forward is to the right."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def test_a_mounting_turns_both_increments() -> None:
    made = made_drive()
    drive = emulate_sensors(made, runs=2, seed=1, mounting=yawed(90.0))
    for told, source in (
        (drive.rotation_increments, made.rotation_increments),
        (drive.velocity_increments, made.velocity_increments),
    ):
        expected = np.column_stack([-source[:, 1], source[:, 0], source[:, 2]])
        np.testing.assert_allclose(told[:, :, 0], expected, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(told[:, :, 0], told[:, :, 1])


def test_each_run_can_have_its_mounting() -> None:
    made = made_drive()
    tilt = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    mounting = np.stack([np.eye(3), yawed(90.0), tilt, yawed(30.0)])
    drive = emulate_sensors(made, runs=4, seed=1, mounting=mounting)
    for told, source in (
        (drive.rotation_increments, made.rotation_increments),
        (drive.velocity_increments, made.velocity_increments),
    ):
        x, y, z = source.T
        np.testing.assert_allclose(told[:, :, 0], source, rtol=0, atol=1e-12)
        np.testing.assert_allclose(told[:, :, 1], np.column_stack([-y, x, z]), rtol=0, atol=1e-12)
        np.testing.assert_allclose(told[:, :, 2], np.column_stack([z, y, -x]), rtol=0, atol=1e-12)
        expected = np.column_stack([x * 0.75**0.5 - y / 2, x / 2 + y * 0.75**0.5, z])
        np.testing.assert_allclose(told[:, :, 3], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("runs", 0),
        ("runs", 2.0),
        ("runs", True),
        ("seed", -1),
        ("seed", None),
        ("gps_position_sd", -1.0),
        ("gps_velocity_sd", np.nan),
        ("compass_sd", np.inf),
        ("hold_below", -0.1),
        ("hold_below", 10.1),
        ("mounting", np.eye(2)),
        ("mounting", np.tile(np.eye(3), (3, 1, 1))),
        ("mounting", 2 * np.eye(3)),
        ("mounting", np.diag([1.0, 1.0, -1.0])),
        ("mounting", np.full((3, 3), np.nan)),
        ("places", [Place("late", 50)]),
    ],
)
def test_what_a_parameter_may_not_be_is_refused(name: str, value: Any) -> None:
    asked: dict[str, Any] = {"runs": 2, "seed": 1, name: value}
    with pytest.raises(ParameterError) as error:
        emulate_sensors(made_drive(), **asked)
    assert error.value.name == name
    one_sentence(error)


# ----------------------------------------------------------------------------------- the files


@pytest.fixture
def known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a mirror of small files whose digests are taken for those of the originals."""
    folder = tmp_path / "mirror" / MIRROR
    folder.mkdir(parents=True)
    for name in NAMES:
        (folder / name).write_text(f"content of {name}\n")
    monkeypatch.setattr(recorded, "_DIGESTS", {n: file_digest(folder / n) for n in NAMES})
    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    return tmp_path / "mirror"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, known: Path) -> list[str]:
    """Return the URLs that are asked for; the network has what the mirror has."""
    urls: list[str] = []

    def give(self: Any, url: str, output: str, pooch: object, check_only: bool = False) -> None:
        urls.append(url)
        connect, _ = self.kwargs["timeout"]
        assert connect <= 10
        Path(output).write_bytes((known / MIRROR / url.rsplit("/", 1)[1]).read_bytes())

    monkeypatch.setattr(pooch.HTTPDownloader, "__call__", give)
    return urls


def test_a_mirror_is_taken_instead_of_the_network(
    known: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(DATA_VARIABLE, str(known))
    assert fetch_drive() == {name: known / MIRROR / name for name in NAMES}
    assert asked == []


def test_a_mirror_that_is_no_folder_is_refused(
    known: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for place in (known / "nowhere", known / MIRROR / NAMES[0]):
        monkeypatch.setenv(DATA_VARIABLE, str(place))
        with pytest.raises(InswsnError, match=r"INSWSN_DATA is .*, which is not a folder") as error:
            fetch_drive()
        one_sentence(error)


@pytest.mark.parametrize("name", NAMES)
def test_a_mirror_without_a_file_is_refused(
    known: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv(DATA_VARIABLE, str(known))
    (known / MIRROR / name).unlink()
    with pytest.raises(InswsnError, match=f"There is no file .*{name}; the mirror") as error:
        fetch_drive()
    one_sentence(error)
    assert asked == []


@pytest.mark.parametrize("name", NAMES)
def test_a_mirror_with_another_file_is_refused(
    known: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv(DATA_VARIABLE, str(known))
    (known / MIRROR / name).write_text("another\n")
    with pytest.raises(InswsnError, match=f"{name} is not the original {name}") as error:
        fetch_drive()
    one_sentence(error)


def test_files_are_fetched_once_and_in_silence(
    tmp_path: Path, asked: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    # what pooch says goes to the stderr that was there when it was imported
    said: list[logging.LogRecord] = []
    listener = logging.Handler()
    listener.emit = said.append  # type: ignore[method-assign]
    pooch.get_logger().addHandler(listener)
    level = pooch.get_logger().level
    files = fetch_drive(tmp_path / "cache")
    base = (
        "https://raw.githubusercontent.com/rtklibexplorer/GNSS_IMU/"
        "8235ee6c5f349db529bf43ad556a3769b346b5a1/data/drive_0708/"
    )
    assert asked == [base + name for name in NAMES]
    assert {n: p.read_text() for n, p in files.items()} == {n: f"content of {n}\n" for n in NAMES}
    assert all(path.is_relative_to(tmp_path / "cache") for path in files.values())
    assert fetch_drive(tmp_path / "cache") == files
    assert len(asked) == 3
    pooch.get_logger().removeHandler(listener)
    assert said == []
    assert tuple(capfd.readouterr()) == ("", "")
    assert pooch.get_logger().level == level


def test_a_cache_is_a_mirror(
    tmp_path: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    files = fetch_drive(tmp_path / "cache")
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "cache"))
    assert fetch_drive() == files
    assert len(asked) == 3


def test_a_spoilt_file_in_the_cache_is_fetched_again(tmp_path: Path, asked: list[str]) -> None:
    files = fetch_drive(tmp_path)
    files[NAMES[1]].write_text("spoilt")
    assert fetch_drive(tmp_path)[NAMES[1]].read_text() == f"content of {NAMES[1]}\n"
    assert len(asked) == 4


def test_the_cache_of_the_user_is_the_default(
    tmp_path: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pooch, "os_cache", lambda project: tmp_path / project)
    assert all(path.is_relative_to(tmp_path / "inswsn") for path in fetch_drive().values())


@pytest.mark.parametrize(
    "cause",
    [
        requests.exceptions.ConnectTimeout("HTTPSConnectionPool: timed out.\nMax retries."),
        requests.exceptions.HTTPError("404 Client Error"),
        PermissionError(13, "Permission denied"),
    ],
)
def test_no_network_is_told_in_one_sentence(
    tmp_path: Path,
    known: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    cause: Exception,
) -> None:
    tried: list[str] = []

    def fail(self: object, url: str, *rest: object, **more: object) -> None:
        tried.append(url)
        raise cause

    monkeypatch.setattr(pooch.HTTPDownloader, "__call__", fail)
    with pytest.raises(DriveUnavailableError, match=r"imu_1934.csv could not be fetched") as error:
        load_drive(tmp_path / "cache")
    message = one_sentence(error)
    assert "INSWSN_DATA may name a local mirror" in message
    assert type(cause).__name__ in message
    assert len(tried) == 1
    assert tuple(capfd.readouterr()) == ("", "")
    assert isinstance(error.value, InswsnError)


def test_a_file_that_is_not_what_was_asked_for_is_not_taken(
    tmp_path: Path, known: Path, asked: list[str]
) -> None:
    (known / MIRROR / NAMES[2]).write_text("<html>log in</html>")
    with pytest.raises(
        DriveUnavailableError, match=r"pos could not .*its SHA-256 is another"
    ) as error:
        fetch_drive(tmp_path / "cache")
    one_sentence(error)
    assert not list((tmp_path / "cache").rglob("*.pos"))
    assert len(asked) == 3


def test_a_cache_that_cannot_be_written_is_told(
    tmp_path: Path, known: Path, asked: list[str]
) -> None:
    (tmp_path / "cache").write_text("a file")
    with pytest.raises(DriveUnavailableError, match="could not be fetched"):
        fetch_drive(tmp_path / "cache")


# ------------------------------------------------------------------------------ the recording

needs_recording = pytest.mark.skipif(
    not os.environ.get(DATA_VARIABLE), reason=f"{DATA_VARIABLE} names no mirror of the recording"
)


@pytest.fixture(scope="module")
def drive() -> RecordedDrive:
    return load_drive()


@needs_recording
def test_the_recording_is_the_drive_that_is_known(drive: RecordedDrive) -> None:
    # RTK ends at 19:43:26.999, the IMU begins at 19:34:21.85
    assert drive.start == pytest.approx(WHOLE + 3.999, abs=1e-6)
    assert len(drive.time) == 546
    assert drive.rotation_increments.shape == (54500, 3)
    assert len(drive.track.time) == 545 * 4 + 1
    assert drive.fixed_share == pytest.approx(0.996, abs=0.001)
    assert drive.track.speed.max() == pytest.approx(16.3, abs=0.05)
    assert 0.25 * drive.track.speed.sum() == pytest.approx(4050, abs=5)


@needs_recording
def test_the_car_stands_first(drive: RecordedDrive) -> None:
    # until 19:34:57, 38.7 s after RTK begins
    speed, time = drive.track.speed, drive.track.time
    assert speed[time < 34.5].max() < 0.1
    assert 35.0 <= time[np.argmax(speed > 0.5)] <= 35.5
    force = drive.velocity_increments[:3400].mean(axis=0) / drive.period
    # up is against down, and a cheap accelerometer has some per cent
    assert np.linalg.norm(force) == pytest.approx(G0, rel=0.02)
    assert force[2] < -0.99 * G0
    assert np.abs(np.rad2deg(drive.rotation_increments[:3400].mean(axis=0) / 0.01)).max() < 0.3


@needs_recording
def test_the_imu_turns_as_the_course(drive: RecordedDrive) -> None:
    moving = np.hypot(drive.velocity[:, 0], drive.velocity[:, 1]) > 3.0
    moving = moving[1:] & moving[:-1]
    told = np.diff(np.unwrap(np.arctan2(drive.velocity[:, 0], drive.velocity[:, 1])))[moving]
    turned = drive.rotation_increments[:, 2].reshape(545, 100).sum(axis=1)[moving]
    assert moving.sum() > 400
    assert np.corrcoef(told, turned)[0, 1] > 0.99
    assert told @ turned / (told @ told) == pytest.approx(1.0, abs=0.03)


@needs_recording
@pytest.mark.parametrize("part", [(40, 180), (180, 360), (360, 520)])
def test_imu_and_rtk_have_one_clock_early_and_late(
    drive: RecordedDrive, part: tuple[int, int]
) -> None:
    # the gain of speed, forwards as the IMU felt it and as RTK saw it, in steps of 0.25 s
    ends = 0.01 * np.arange(54501)
    felt = np.concatenate([[0.0], np.cumsum(drive.velocity_increments[:, 0])])
    time, speed = drive.track.time, drive.track.speed
    inside = (time > part[0]) & (time < part[1]) & (speed > 1.5)

    def likeness(lag: float) -> float:
        gain = np.diff(np.interp(time + lag, ends, felt))
        gain -= np.convolve(gain, np.full(21, 1 / 21), "same")  # the slope of the road is slow
        seen = np.diff(speed)
        seen = seen - np.convolve(seen, np.full(21, 1 / 21), "same")
        return float(np.corrcoef(gain[inside[1:]], seen[inside[1:]])[0, 1])

    lags = 0.01 * np.arange(-20, 21)
    best = lags[np.argmax([likeness(lag) for lag in lags])]
    assert abs(best) < 0.025


@needs_recording
def test_the_recording_makes_a_drive(drive: RecordedDrive) -> None:
    made = emulate_sensors(drive, runs=3, seed=1, places=[Place("bend", 100)])
    assert made.compass.shape == (546, 3)
    # the first course is held back to the beginning
    course = np.arctan2(drive.velocity[:, 0], drive.velocity[:, 1])
    first = int(np.argmax(np.hypot(drive.velocity[:, 0], drive.velocity[:, 1]) >= 1.0))
    assert first >= 35
    assert np.abs(made.compass[:first] - course[first]).max() < np.deg2rad(0.15 * 5)
