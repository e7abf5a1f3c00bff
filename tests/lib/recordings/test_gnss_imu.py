"""The recorded drive: made files that are read, the original ones, and how they are had."""

from __future__ import annotations

import hashlib
import logging
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pooch
import pytest
import requests
from inswsn_book.files import file_digest
from made_folders import needs
from numpy.typing import NDArray

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import DATA_VARIABLE
from inswsn_lib.recordings import RecordingUnavailableError, gnss_imu, load_drive
from inswsn_lib.recordings.files import locate
from inswsn_lib.vehicle import RecordedDrive

Array = NDArray[np.float64]
IMU, TAG, POSITIONS = NAMES = ("imu_1934.csv", "imu_1934.csv.tag", "gnss_1934_sf.pos")
MIRROR = (
    "rtklibexplorer__GNSS_IMU/8235ee6c5f349db529bf43ad556a3769b346b5a1/data/drive_0708"  # as asked
)
# 2025-07-08 19:34:18 in the calendar of UTC, from `date -u -d ... +%s`
WHOLE = 1752003258
G0 = 9.80665


def made_files(folder: Path) -> None:
    """Write files of 8 s: it turns right at a rate that grows by 1 deg/s a second, and goes north.

    Row i of the log was taken 10 i ms after a start at 18.5 s, and arrived 155 ms later; the tag
    tells of every third row, with those before it. RTK is at .999, .249, .499 and .749.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows = [
        f"{-0.1},{0.2},{0.97 + i * 1e-5:.5f},{1.5},{-2.5},{-0.01 * i:.2f},{261906 + 10 * i}"
        for i in range(801)
    ]
    rows[0], rows[-1] = "906", "0.1,0.2,0.9"
    (folder / IMU).write_bytes("".join(f"{row}\n" for row in rows).encode())
    tag = b"TIMETAG RTKLIB demo5".ljust(60, b"\0") + struct.pack("<IId", 77, WHOLE, 0.5)
    for i in range(2, 801, 3):
        length = sum(len(row) + 2 for row in rows[: i + 1])  # two bytes ended a line
        tag += struct.pack("<II", 10 * (i - 1) + 155, length)
    (folder / TAG).write_bytes(tag)
    lines = ["%  GPST  latitude(deg) ..."]
    for i in range(40):
        ms = 18249 + 250 * i
        lines.append(
            f"2025/07/08 19:34:{ms // 1000:02d}.{ms % 1000:03d} {40 + 1e-5 * i:.9f} -105.0 "
            f"{1600 + i} {1 + (i > 30)} 21 .01 .01 .01 0 0 0 0 0 {3 + 0.1 * i:.4f} 4.0 0.5 0 0 0"
        )
    (folder / POSITIONS).write_text("".join(f"{line}\n" for line in lines))


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RecordedDrive:
    """What is read from made files whose digests are taken for those of the originals."""
    folder = tmp_path / MIRROR
    made_files(folder)
    digests = {name: file_digest(folder / name) for name in NAMES}
    monkeypatch.setattr(gnss_imu, "DRIVE", replace(gnss_imu.DRIVE, digests=digests))
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    return load_drive()


def test_epochs_are_rows_of_rtk_near_whole_seconds(made: RecordedDrive) -> None:
    """The IMU is there from 18.51 s to 26.48 s: epochs from 18.999 s, row 3, to 25.999 s."""
    assert made.start == pytest.approx(WHOLE + 0.999, abs=1e-6)
    np.testing.assert_array_equal(made.time, np.arange(8.0))
    rows = 3 + 4 * np.arange(8)
    assert np.rad2deg(made.position[:, 0]) == pytest.approx(40 + 1e-5 * rows, abs=1e-9)
    assert np.rad2deg(made.position[:, 1]) == pytest.approx(-105 + 0 * rows)
    assert made.position[:, 2] == pytest.approx(1600 + rows)
    east_north_up = np.column_stack([4 + 0 * rows, 3 + 0.1 * rows, 0.5 + 0 * rows])
    assert made.velocity == pytest.approx(east_north_up)
    assert made.track.time == pytest.approx(0.25 * np.arange(29), abs=1e-6)
    assert np.array_equal(made.track.position[::4], made.position)
    assert np.array_equal(made.track.velocity[::4], made.velocity)
    assert made.track.quality.tolist() == [1] * 28 + [2]


def test_the_imu_is_on_the_clock_of_rtk_forward_right_down(made: RecordedDrive) -> None:
    """Rate and force are lines in time, so that each sample's integral tells when it was.

    A row arrives with those that the tag tells of together, 10 ms after its own in the mean.
    """
    assert made.period == 0.01
    assert made.rotation_increments.shape == made.velocity_increments.shape == (700, 3)
    t = 0.499 + 0.01 * (np.arange(700) + 0.5)  # since 18.5 s, the middles of the samples
    turned = np.rad2deg(made.rotation_increments) / 0.01
    assert turned[:, :2] == pytest.approx(np.tile([-1.5, -2.5], (700, 1)), abs=2e-3)
    assert turned[:, 2] == pytest.approx(t, abs=2e-3)
    force = made.velocity_increments / 0.01 / G0
    assert force[:, :2] == pytest.approx(np.tile([0.1, 0.2], (700, 1)), abs=1e-3)
    assert force[:, 2] == pytest.approx(-0.97 - 1e-3 * t, abs=1e-5)


# --- the original files ---

needs_recording = needs("rtklib/drive-0708")
#: SHA-256 of what the first reader made of the files, and sizes
DIGESTS = {
    "time": ("88d1f7f2d8be0aeb6509c04de3220f25", (546,)),
    "rotation_increments": ("f55870ccace784c397ed104ebdcd4380", (54500, 3)),
    "velocity_increments": ("e56673806c99c91f84c1f9a97ecaf0d8", (54500, 3)),
    "position": ("4a3524d954ce9d15d1ee14965e3c2a2b", (546, 3)),
    "velocity": ("69e7c23d3d16769de70c6ff89310d85b", (546, 3)),
    "track.time": ("55935444e5beb3adff5549f094dbee80", (2181,)),
    "track.position": ("f8f9d440d9aff3f1443e771acce0c0b6", (2181, 3)),
    "track.velocity": ("07a87bb047172dea4f5cbbab033b652c", (2181, 3)),
    "track.quality": ("41beee8f208dee8215521c2792a06f04", (2181,)),
}


@pytest.fixture(scope="module")
def drive() -> RecordedDrive:
    return load_drive()


@needs_recording
@pytest.mark.parametrize("name", DIGESTS)
def test_the_recording_is_what_it_was_to_the_last_bit(drive: RecordedDrive, name: str) -> None:
    found: Any = drive
    for part in name.split("."):
        found = getattr(found, part)
    digest, shape = DIGESTS[name]
    assert found.shape == shape
    assert hashlib.sha256(np.ascontiguousarray(found).tobytes()).hexdigest().startswith(digest)
    assert (drive.start, drive.period) == (WHOLE + 3.999, 0.01)


@needs_recording
def test_the_car_stands_first(drive: RecordedDrive) -> None:
    """Until 19:34:57: up is against down, and a cheap accelerometer has some per cent."""
    speed, time = np.hypot(*drive.track.velocity[:, :2].T), drive.track.time
    assert speed[time < 34.5].max() < 0.1
    assert 35.0 <= time[np.argmax(speed > 0.5)] <= 35.5
    force = drive.velocity_increments[:3400].mean(axis=0) / drive.period
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
    """The gain of speed, forwards as the IMU felt it and as RTK saw it, in steps of 0.25 s."""
    ends = 0.01 * np.arange(54501)
    felt = np.concatenate([[0.0], np.cumsum(drive.velocity_increments[:, 0])])
    time, speed = drive.track.time, np.hypot(*drive.track.velocity[:, :2].T)
    inside = (time > part[0]) & (time < part[1]) & (speed > 1.5)

    def without_slope(gain: Array) -> Array:  # that of the road is slow
        return gain - np.convolve(gain, np.full(21, 1 / 21), "same")

    def likeness(lag: float) -> float:
        gain = without_slope(np.diff(np.interp(time + lag, ends, felt)))
        return float(np.corrcoef(gain[inside[1:]], without_slope(np.diff(speed))[inside[1:]])[0, 1])

    lags = 0.01 * np.arange(-20, 21)
    assert abs(lags[np.argmax([likeness(lag) for lag in lags])]) < 0.025


# --- where the files are ---


@pytest.fixture
def known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A mirror of small files whose digests are taken for those of the originals."""
    folder = tmp_path / "mirror" / MIRROR
    folder.mkdir(parents=True)
    for name in NAMES:
        (folder / name).write_text(f"content of {name}\n")
    digests = {name: file_digest(folder / name) for name in NAMES}
    monkeypatch.setattr(gnss_imu, "DRIVE", replace(gnss_imu.DRIVE, digests=digests))
    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    return tmp_path / "mirror"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, known: Path) -> list[str]:
    """The URLs that are asked for; the network has what the mirror has."""
    urls: list[str] = []

    def give(self: Any, url: str, output: str, pooch: object, check_only: bool = False) -> None:
        urls.append(url)
        assert self.kwargs["timeout"][0] <= 10
        Path(output).write_bytes((known / MIRROR / url.rsplit("/", 1)[1]).read_bytes())

    monkeypatch.setattr(pooch.HTTPDownloader, "__call__", give)
    return urls


def fetched(cache: Path | None = None) -> dict[str, Path]:
    return locate(gnss_imu.DRIVE, cache)


def test_a_mirror_is_taken_instead_of_the_network(
    known: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(DATA_VARIABLE, str(known))
    assert fetched() == {name: known / MIRROR / name for name in NAMES}
    assert asked == []


@pytest.mark.parametrize("name", NAMES)
def test_a_mirror_has_to_have_each_file_as_it_is(
    known: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv(DATA_VARIABLE, str(known))
    (known / MIRROR / name).write_text("another\n")
    with pytest.raises(InswsnError, match=rf"{name} is not the original"):
        fetched()
    (known / MIRROR / name).unlink()
    with pytest.raises(InswsnError, match=rf"There is no file .*{name}; INSWSN_DATA may name"):
        fetched()
    assert asked == []


def test_files_are_fetched_once_and_in_silence(
    tmp_path: Path, asked: list[str], capfd: pytest.CaptureFixture[str]
) -> None:
    said: list[logging.LogRecord] = []  # pooch writes to the stderr that was there at its import
    listener = logging.Handler()
    listener.emit = said.append  # type: ignore[method-assign]
    pooch.get_logger().addHandler(listener)
    level = pooch.get_logger().level
    files = fetched(tmp_path / "cache")
    base = f"https://raw.githubusercontent.com/{MIRROR.replace('__', '/', 1)}/"
    assert asked == [base + name for name in NAMES]
    assert {n: p.read_text() for n, p in files.items()} == {n: f"content of {n}\n" for n in NAMES}
    assert fetched(tmp_path / "cache") == files
    assert len(asked) == 3
    pooch.get_logger().removeHandler(listener)
    assert said == []
    assert tuple(capfd.readouterr()) == ("", "")
    assert pooch.get_logger().level == level


def test_a_cache_is_a_mirror_and_is_mended(
    tmp_path: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    files = fetched(tmp_path)
    files[TAG].write_text("spoilt")
    assert fetched(tmp_path)[TAG].read_text() == f"content of {TAG}\n"
    assert len(asked) == 4
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    assert fetched() == files
    monkeypatch.delenv(DATA_VARIABLE)
    monkeypatch.setattr(pooch, "os_cache", lambda project: tmp_path / project)
    assert all(path.is_relative_to(tmp_path / "inswsn") for path in fetched().values())


@pytest.mark.parametrize(
    "cause",
    [
        requests.exceptions.ConnectTimeout("HTTPSConnectionPool: timed out.\nMax retries."),
        PermissionError(13, "Permission denied"),
    ],
)
def test_no_network_is_told_in_one_sentence(
    tmp_path: Path, known: Path, monkeypatch: pytest.MonkeyPatch, cause: Exception
) -> None:
    tried: list[str] = []

    def fail(self: object, url: str, *rest: object, **more: object) -> None:
        tried.append(url)
        raise cause

    monkeypatch.setattr(pooch.HTTPDownloader, "__call__", fail)
    with pytest.raises(RecordingUnavailableError, match=r"imu_1934.csv could not .*\.$") as error:
        load_drive(tmp_path / "cache")
    assert f"({type(cause).__name__})" in str(error.value)
    assert "\n" not in str(error.value)
    assert len(tried) == 1


def test_a_file_that_is_not_what_was_asked_for_is_not_taken(
    tmp_path: Path, known: Path, asked: list[str]
) -> None:
    (known / MIRROR / POSITIONS).write_text("<html>log in</html>")
    with pytest.raises(RecordingUnavailableError, match=r"pos could not .*its SHA-256 is another"):
        fetched(tmp_path / "cache")
    assert not list((tmp_path / "cache").rglob("*.pos"))
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(RecordingUnavailableError, match="could not be fetched"):
        fetched(tmp_path / "taken")
