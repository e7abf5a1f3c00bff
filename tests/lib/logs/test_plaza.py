"""A robot among four nodes: made files, spoilt ones, and what the original is like."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_folders import make_plaza, needs
from numpy.typing import NDArray
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.files import locate
from inswsn_lib.logs.radio_kinds import read_matrices
from inswsn_lib.logs.radio_kinds import read_plaza
from inswsn_lib.logs.registry import KNOWN
from inswsn_lib.streams import Odometry, Recording

Array = NDArray[np.float64]


def forward(recording: Recording) -> Array:
    """Return where the robot points, (rows, 2)."""
    assert recording.reference is not None
    return Rotation.from_quat(recording.reference.attitude).apply([1.0, 0.0, 0.0])[:, :2]


def reckon(odometry: Odometry, begin: float, heading: float) -> Array:
    """Return positions relative to the first, at the begin and the times of the odometry."""
    interval = np.diff(odometry.time, prepend=begin)
    turned = odometry.rate * interval
    middle = heading + np.cumsum(turned) - turned / 2
    way = np.column_stack([np.cos(middle), np.sin(middle)]) * (odometry.speed * interval)[:, None]
    return np.vstack([np.zeros(2), np.cumsum(way, axis=0)])


def test_increments_become_speed_and_rate(tmp_path: Path) -> None:
    make_plaza(tmp_path)
    odometry = read_plaza(tmp_path).odometry
    assert odometry is not None
    assert odometry.time.tolist() == [1.0, 1.1, 1.3]
    assert odometry.speed == pytest.approx([2.0, 1.0, 3.0])  # the first begins with GT's first
    assert odometry.rate == pytest.approx([0.5, 0.5, 1.0])


def test_the_robot_points_against_the_heading_of_gt(tmp_path: Path) -> None:
    make_plaza(tmp_path)
    read = read_plaza(tmp_path)
    assert read.reference is not None
    assert read.reference.position.tolist() == [[5, 0.9], [5, 1.0], [5, 1.1], [5, 1.3]]
    left = [0.0, 0.05, 0.1, 0.3]
    assert forward(read) == pytest.approx(np.column_stack([-np.sin(left), np.cos(left)]))


def test_a_heading_along_the_way_is_taken_as_it_is_and_ranges_in_any_order(tmp_path: Path) -> None:
    expected = (make_plaza(tmp_path), read_plaza(tmp_path))[1]
    tables = read_matrices(tmp_path / "Some_.mat")
    tables["GT"][:, 3] += np.pi
    savemat(tmp_path / "Some_.mat", tables | {"TD": tables["TD"][::-1]})
    read = read_plaza(tmp_path)
    assert forward(read) == pytest.approx(forward(expected))
    assert read.ranges is not None
    assert expected.ranges is not None
    assert sorted(read.ranges.distance) == sorted(expected.ranges.distance)


def test_ranges_name_their_nodes(tmp_path: Path) -> None:
    make_plaza(tmp_path)
    ranges = read_plaza(tmp_path / "Some_.mat").ranges
    assert ranges is not None
    assert (ranges.names, ranges.anchor.tolist()) == (("1", "5"), [1, 0, 1])
    assert ranges.anchors.tolist() == [[10, 20], [30, 40]]
    assert ranges.distance.tolist() == [7.5, 2.5, 7.0]


def test_an_interval_without_a_begin_is_left_out(tmp_path: Path) -> None:
    make_plaza(tmp_path)
    tables = read_matrices(tmp_path / "Some_.mat")
    tables["GT"] = tables["GT"][1:]
    savemat(tmp_path / "Some_.mat", tables)
    odometry = read_plaza(tmp_path).odometry
    assert odometry is not None
    assert odometry.time.tolist() == [1.1, 1.3]
    assert odometry.speed == pytest.approx([1.0, 3.0])


def repeat(table: Array) -> Array:
    return table[[0, 1, 1]]


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("GT", lambda table: None, r"Some_.mat: GT must be .* \(rows, 4\), not of shape \(0,\)\."),
        ("GT", lambda table: table[:, :3], r"GT .* not of shape \(4, 3\)"),
        ("TD", lambda table: table * np.nan, r"TD .* not NaN or infinite"),
        (
            "TD",
            lambda table: table + np.eye(4)[2],
            r"the anchor is 6 in row 1; it must be .* 1, 5\.",
        ),
        ("TL", lambda table: table * [0, 1, 1], r"the anchor 0 is there more than once"),
        ("DR", repeat, r"Some_.mat: DR: the time stamp repeats in row 3;"),
        ("GT", repeat, r"Reference: the time stamp repeats in row 3"),
        ("GT", lambda table: {"a": table}, r"GT .* not of shape \(0,\)"),
    ],
)
def test_spoilt_tables_are_refused(
    tmp_path: Path, name: str, change: Callable[[Array], Any], said: str
) -> None:
    make_plaza(tmp_path)
    tables: dict[str, Any] = dict(read_matrices(tmp_path / "Some_.mat"))
    tables[name] = change(tables[name])
    savemat(tmp_path / "Some_.mat", {n: t for n, t in tables.items() if t is not None})
    with pytest.raises(InswsnError, match=said):
        read_plaza(tmp_path)


@pytest.mark.parametrize("packed", [False, True])
def test_tables_are_read_as_scipy_reads_them(tmp_path: Path, packed: bool) -> None:
    """Of each type of numbers; what is no matrix of real numbers is passed over."""
    random = np.random.default_rng(1)
    tables: dict[str, Any] = {
        kind: random.integers(0, 100, size=(2, 3)).astype(kind)
        for kind in ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")
    } | {"one": np.array([[7]]), "none": np.zeros((0, 2)), "a_long_name_of_a_table": np.eye(5)}
    others = {"word": "text", "cells": np.array([[1, "b"]], dtype=object), "record": {"e": 1}}
    path = tmp_path / "some.mat"
    savemat(path, tables | others, do_compression=packed)
    np.testing.assert_equal(read_matrices(path), tables)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"MATLAB 4.2", r"some.mat: it is not a MATLAB file of level 5\."),
        (
            b" " * 126 + b"IM" + b"\x0f\0\0\0\x04\0\0\0abcd",
            r"what it has packed cannot be unpacked",
        ),
        (b" " * 126 + b"IM" + b"\x0e\0\0\0\x04\0\0\0abc", r"it ends too early"),
        (b" " * 126 + b"IM" + b"\x0e\0", r"it ends too early"),
    ],
)
def test_what_is_no_matlab_file_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "some.mat").write_bytes(content)
    with pytest.raises(InswsnError, match=said):
        read_plaza(tmp_path)


# --- the original ---


@pytest.fixture(scope="module")
def plaza() -> Recording:
    return logs.load("plaza/2")


@needs("plaza/2")
def test_the_robot_points_where_it_goes(plaza: Recording) -> None:
    assert plaza.reference is not None
    way = np.diff(plaza.reference.position, axis=0)
    moving = np.linalg.norm(way, axis=1) > 0.03
    direction = way[moving] / np.linalg.norm(way[moving], axis=1)[:, None]
    cosine = np.sum(direction * forward(plaza)[1:][moving], axis=1)
    assert moving.mean() > 0.9
    assert np.median(cosine) > 0.999
    assert np.quantile(cosine, 0.02) > 0.98


@needs("plaza/2")
def test_odometry_adds_up_to_the_dead_reckoning_of_the_file(
    plaza: Recording,
) -> None:
    """From the pose of the reference, over 1354 m, within 7 cm of the variable DRp."""
    (path,) = locate(KNOWN["plaza/2"].source).values()
    told = read_matrices(path)["DRp"]
    assert plaza.odometry is not None
    assert plaza.reference is not None
    first = forward(plaza)[0]
    heading = float(np.arctan2(first[1], first[0]))
    way = reckon(plaza.odometry, plaza.reference.time[0], heading) + plaza.reference.position[0]
    assert np.linalg.norm(way - told[:, 1:3], axis=1).max() < 0.07
    apart = np.linalg.norm(way - plaza.reference.position, axis=1)
    assert apart.max() == pytest.approx(71.7, abs=0.1)


@needs("plaza/2")
def test_the_rate_is_made_from_the_reference(plaza: Recording) -> None:
    """0.985 times its turns less a constant, without any noise."""
    assert plaza.odometry is not None
    assert plaza.reference is not None
    interval = np.diff(plaza.reference.time)
    ahead = forward(plaza)
    turned = np.diff(np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0])))
    left = plaza.odometry.rate * interval - 0.985 * turned
    assert left == pytest.approx(np.full(4090, -6.9672112e-4), abs=1e-11)


@needs("plaza/2")
def test_ranges_are_too_long_by_one_factor_and_have_the_clock_of_the_reference(
    plaza: Recording,
) -> None:
    ranges, reference = plaza.ranges, plaza.reference
    assert ranges is not None
    assert reference is not None

    def distances(lag: float) -> Array:
        at = [np.interp(ranges.time + lag, reference.time, x) for x in reference.position.T]
        away = np.column_stack(at) - ranges.anchors[ranges.anchor]
        return np.asarray(np.linalg.norm(away, axis=1))

    for node in range(4):
        mine = ranges.anchor == node
        scale, shift = np.polyfit(distances(0.0)[mine], ranges.distance[mine], 1)
        assert (scale, shift) == (pytest.approx(1.069, abs=1e-3), pytest.approx(0.0, abs=0.05))
    lags = 0.1 * np.arange(-5, 6)
    spread = [np.std(ranges.distance - 1.069 * distances(lag)) for lag in lags]
    assert lags[np.argmin(spread)] == 0.0
    assert min(spread) == pytest.approx(0.56, abs=0.01)
