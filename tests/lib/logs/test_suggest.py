"""What is suggested for folders whose streams, names and units are known, and read by it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from made_recording import made, made_imu, motion

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.streams import Fixes, Recording

GRAVITY, DEGREE = 9.80665, np.pi / 180


def walk(seed: int) -> Recording:
    time = np.arange(0.2, 29.0, 0.1)
    fixes = Fixes(time, motion(time)[0])
    body = made(seed, seconds=30.0)
    return replace(body, imu=made_imu(seed, seconds=30.0), fixes=fixes)


# What a logger calls time and the axes, and how large a second, and units of rates and forces, are
LOGGERS = [
    ("Timestamp", "gyro_{}", "acc_{}", 1e3, DEGREE, GRAVITY),
    ("time_us", "Gyr {} [rad/s]", "Acc {} [m/s^2]", 1e6, 1.0, 1.0),
    ("t", "w{}", "a{}", 1.0, 1.0, 1.0),
    ("stamp", "angular_velocity.{}", "linear_acceleration_{}", 1e9, 1.0, 1.0),
    ("seconds_elapsed", "gyroscope_{} (dps)", "accelerometer_{} (mg)", 1.0, DEGREE, GRAVITY / 1e3),
]


@pytest.mark.parametrize("logger", LOGGERS, ids=[each[0] for each in LOGGERS])
@pytest.mark.parametrize("epoch", [0.0, 1.7e9])
def test_what_a_logger_writes_is_read_as_suggested(
    tmp_path: Path, logger: tuple[str, str, str, float, float, float], epoch: float
) -> None:
    stamp, gyroscope, force, second, degree, g = logger
    right = walk(3)
    imu = pd.DataFrame({stamp: (right.imu.time + epoch) * second, "temperature": 20.5})
    for axis, name in enumerate("xyz"):
        imu[gyroscope.format(name)] = right.imu.rate[:, axis] / degree
        imu[force.format(name)] = right.imu.force[:, axis] / g
    imu.to_csv(tmp_path / "sensors.csv", index=False)
    place = pd.DataFrame({stamp: (right.fixes.time + epoch) * second})
    place[["East", "North", "Up"]] = right.fixes.position
    place.to_csv(tmp_path / "gnss.txt", index=False, sep=";")
    true = pd.DataFrame({stamp: (right.reference.time + epoch) * second})
    true[["pos_x", "pos_y", "pos_z"]] = right.reference.position
    true[["q_x", "q_y", "q_z", "q_w"]] = right.reference.attitude
    true.to_csv(tmp_path / "mocap.csv", index=False)
    (tmp_path / "notes.txt").write_text("a walk in the yard\n")
    said = logs.suggest(tmp_path)
    for what in ("sensors.csv seems to be imu", "gnss.txt seems to be fixes",
                 "mocap.csv seems to be reference", "notes.txt is left out"):  # fmt: skip
        assert what in said
    assert "missing" not in said
    read = logs.load("csv", tmp_path)
    for mine, other in ((read.imu, right.imu), (read.fixes, right.fixes)):
        np.testing.assert_allclose(mine.time - epoch, other.time, atol=1e-6)
    np.testing.assert_allclose(read.imu.rate, right.imu.rate, atol=1e-12)
    np.testing.assert_allclose(read.imu.force, right.imu.force, atol=1e-9)
    np.testing.assert_allclose(read.fixes.position, right.fixes.position)
    np.testing.assert_allclose(read.reference.attitude, right.reference.attitude)


def test_ranges_and_anchors_are_known_and_what_is_missing_is_said(tmp_path: Path) -> None:
    right = walk(4)
    heard = pd.DataFrame({"time (ms)": right.ranges.time * 1e3, "beacon": right.ranges.anchor})
    heard["distance [mm]"] = right.ranges.distance * 1e3
    heard.to_csv(tmp_path / "uwb.csv", index=False)
    said = logs.suggest(tmp_path)
    assert "uwb.csv seems to be ranges: time_s is 'time (ms)' in ms, anchor is 'beacon'" in said
    for words in ("missing: imu or odometry", "There is no reference", "write anchors.csv"):
        assert words in said
    where = pd.DataFrame(right.ranges.anchors * 100, columns=["x (cm)", "y (cm)", "z (cm)"])
    where.insert(0, "id", range(len(where)))
    where.to_csv(tmp_path / "beacons.csv", index=False)
    (tmp_path / "recording.yaml").unlink()
    assert "beacons.csv seems to be anchors" in logs.suggest(tmp_path)
    read = logs.load("csv", tmp_path).ranges
    np.testing.assert_allclose(read.distance, right.ranges.distance)
    np.testing.assert_allclose(read.anchors, right.ranges.anchors)


def test_a_file_that_is_there_is_left_and_none_is_left_by_half(tmp_path: Path) -> None:
    (tmp_path / "wheels.csv").write_text("time_s,speed_mps,rate_radps\n0,1,0\n0.1,1,0\n")
    (tmp_path / "recording.yaml").write_text("name: mine\n")
    assert "is there already, and left as it is" in logs.suggest(tmp_path)
    assert (tmp_path / "recording.yaml").read_text() == "name: mine\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recording.yaml", "wheels.csv"]
    (tmp_path / "recording.yaml").unlink()
    assert "recording.yaml is written" in logs.suggest(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["recording.yaml", "wheels.csv"]
    assert logs.load("csv", tmp_path).odometry is not None
    empty = tmp_path / "empty"
    empty.mkdir()
    assert "Nothing is written" in logs.suggest(empty)
    assert not list(empty.iterdir())
    with pytest.raises(InswsnError, match="There is no folder"):
        logs.suggest(tmp_path / "absent")


# --- by recording.yaml ---


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("file: x.csv", r"recording.yaml: there is no file x.csv for odometry.csv"),
        ("time_s: [Stamp, days]", r"the unit of time_s must be one of s, ms, us, ns, not 'days'"),
        ("speed: [v]", r"odometry.csv must be of columns time_s, speed_mps, rate_radps, or file"),
        ("speed_mps: [v, km/h, 1]", r"speed_mps must be a name, or \[name, unit\]"),
        ("speed_mps: speed", r"odometry.csv has no column speed; it has time_s, v, rate_radps"),
    ],
)
def test_what_cannot_be_read_so_is_refused(tmp_path: Path, lines: str, said: str) -> None:
    (tmp_path / "odometry.csv").write_text("time_s,v,rate_radps\n0,36,0\n0.1,72,0\n")
    about = tmp_path / "recording.yaml"
    about.write_text("odometry.csv: {speed_mps: [v, km/h]}\n")
    assert logs.load("csv", tmp_path).odometry.speed.tolist() == [10, 20]
    about.write_text(f"odometry.csv: {{{lines}}}\n")
    with pytest.raises(InswsnError, match=said):
        logs.load("csv", tmp_path)


# --- latitude and longitude ---


@pytest.mark.parametrize("height", [True, False])
@pytest.mark.parametrize("latitude", [-33.0, 0.5, 48.1, 71.0])
def test_latitude_and_longitude_become_metres(
    tmp_path: Path, latitude: float, height: bool
) -> None:
    """Against the radii of curvature of the ellipsoid WGS 84, within 200 m of the first fix."""
    a, e2 = 6378137.0, 0.00669437999014
    rng = np.random.default_rng(2)
    east, north = rng.uniform(-200, 200, (2, 30))
    sine = np.sin(np.radians(latitude))
    meridian, across = (a * (1 - e2) / (1 - e2 * sine**2) ** 1.5, a / np.sqrt(1 - e2 * sine**2))
    table = pd.DataFrame({"time_s": np.arange(30.0)})
    table["lat_deg"] = latitude + np.degrees((north - north[0]) / meridian)
    cosine = np.cos(np.radians(latitude))
    table["lon_deg"] = 11.5 + np.degrees((east - east[0]) / across / cosine)
    if height:
        table["height_m"] = 7.0 + np.arange(30.0)
    table.to_csv(tmp_path / "fixes.csv", index=False)
    read = logs.load("csv", tmp_path)
    expected = [east - east[0], north - north[0], np.arange(30.0)][: 2 + height]
    atol = 0.02 if abs(latitude) < 60 else 0.1
    np.testing.assert_allclose(read.fixes.position, np.column_stack(expected), atol=atol)
    np.testing.assert_allclose(
        read.origin, [np.radians(latitude), np.radians(11.5), 7.0 if height else 0.0]
    )
    (tmp_path / "recording.yaml").write_text(
        f"origin_rad_m: [{np.radians(latitude)}, {np.radians(11.5)}, 5.0]\nheight_m: 1.5\n"
    )
    other = logs.load("csv", tmp_path)
    assert other.height == 1.5
    up = other.fixes.position[:, 2:] - read.fixes.position[:, 2:]
    np.testing.assert_allclose(up, 2.0, atol=1e-3)
    table["lat_deg"] *= 1e3
    table.assign(lat_deg=table["lat_deg"] + 100).to_csv(tmp_path / "fixes.csv", index=False)
    with pytest.raises(InswsnError, match="are no latitude and longitude"):
        logs.load("csv", tmp_path)
