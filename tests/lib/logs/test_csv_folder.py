"""A folder of one's own: what is read, every way to be refused, and what is written."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays
from made_folders import HALF, make_csv, values_of

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.streams import Fixes, Imu, Odometry, Ranges, Recording, Reference


def test_all_files_are_read(tmp_path: Path) -> None:
    make_csv(tmp_path)
    read, no = logs.load("csv", tmp_path), np.nan
    expected = {
        "lever_arm": [0.0, 0.5, 1.0], "origin": [0.7, -1.8, 9.0],
        "imu.time": [0.0, 0.01], "imu.rate": [[0.1, 0.2, 0.3], [0.1, 0.2, 0.3]],
        "imu.force": [[0.0, 0.0, 9.8], [0.5, -0.5, 9.9]],
        "odometry.time": [0.1, 0.2], "odometry.speed": [1.5, 1.25], "odometry.rate": [-0.2, 0.0],
        "ranges.time": [0.1, 0.1, 0.2], "ranges.anchor": [1, 0, 1],
        "ranges.distance": [2.5, 3.5, 2.25],
        "ranges.anchors": [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "ranges.names": ("007", "A 1"),
        "fixes.time": [0.0, 1.0], "fixes.position": [[1.0, 2.0, 3.0], [no, no, no]],
        "fixes.velocity": [[0.1, 0.2], [no, no]], "fixes.deviation": [[0.01, 0.02], [no, no]],
        "fixes.good": [True, False],
        "reference.time": [0.0, 0.5], "reference.position": [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]],
        "reference.attitude": [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, HALF, HALF]],
    }  # fmt: skip
    found = values_of(read)
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_array_equal(found[name], value, name)
    assert (read.name, read.licence, read.source) == ("a walk", "mine", str(tmp_path))
    assert len(read.digests) == 7


def test_a_stream_alone_in_a_plane_is_enough(tmp_path: Path) -> None:
    (tmp_path / "reference.csv").write_text("time_s;y_m;x_m;note\n# a comment\n0,5;1;2,5;#a\n\n")
    read = logs.load("csv", tmp_path)
    assert [*read.streams] == ["reference"]
    assert read.reference.position.tolist() == [[2.5, 1.0]]
    assert read.reference.attitude is None
    assert read.name == tmp_path.name
    assert read.lever_arm.tolist() == [0, 0, 0]


def test_a_quaternion_of_nearly_unit_length_is_made_one(tmp_path: Path) -> None:
    (tmp_path / "reference.csv").write_text("time_s,x_m,y_m,qx,qy,qz,qw\n0,1,2,0.6004,0,0,0.8\n")
    reference = logs.load("csv", tmp_path).reference
    assert np.linalg.norm(reference.attitude) == pytest.approx(1.0, abs=1e-15)
    assert reference.attitude[0, 0] / reference.attitude[0, 3] == pytest.approx(0.6004 / 0.8)


@pytest.mark.parametrize("sign", ["#", "# ", "%", "%  "])
def test_a_header_may_stand_behind_a_sign(tmp_path: Path, sign: str) -> None:
    make_csv(tmp_path)
    expected = values_of(logs.load("csv", tmp_path))
    for path in tmp_path.glob("*.csv"):
        before = "% x_m and time_s are columns\n\n# by me\n"
        path.write_text(before + path.read_text())  # the header is plain
        np.testing.assert_equal(values_of(logs.load("csv", tmp_path)), expected)
        path.write_text(path.read_text().replace("by me\n", f"by me\n{sign}"))
    np.testing.assert_equal(values_of(logs.load("csv", tmp_path)), expected)


@pytest.mark.parametrize("name", ["t_s", "time_ms", "t_us", "time_ns"])
def test_time_stamps_may_be_in_smaller_units(tmp_path: Path, name: str) -> None:
    size = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[name.partition("_")[2]]
    stamps = [1_700_000_000, 1_700_000_001, 1_700_000_003]
    rows = "".join(f"{k * size + size // 2 if size > 1 else k + 0.5},1,0\n" for k in stamps)
    (tmp_path / "odometry.csv").write_text(f"{name},speed_mps,rate_radps\n{rows}")
    odometry = logs.load("csv", tmp_path).odometry
    assert odometry.time.tolist() == [k + 0.5 for k in stamps]


def odometry_at(path: Path, time: Any) -> None:
    rows = "".join(f"{t!r},1,0\n" for t in np.asarray(time, dtype=float).tolist())
    (path / "odometry.csv").write_text(f"time_s,speed_mps,rate_radps\n{rows}")


@pytest.mark.parametrize("early", [1, 15, 29])
def test_a_clock_that_was_set_is_told_with_its_row(tmp_path: Path, early: int) -> None:
    time = 1.7e9 + 0.1 * np.arange(30)
    time[:early] -= 1.7e9
    odometry_at(tmp_path, time)
    with pytest.raises(InswsnError, match=rf"time_s: .* jumps by 1.7e\+09 s in row {early + 2}, "):
        logs.load("csv", tmp_path)
    for gap, rest in ((3500.0, 0.1), (6900.0, 5.0)):  # a break of a logger
        odometry_at(tmp_path, rest * np.arange(30) + gap * (np.arange(30) >= early))
        assert logs.load("csv", tmp_path).odometry is not None


@pytest.mark.parametrize(("unit", "size"), [(None, 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize("rate", [1.5, 10, 50, 400])
def test_stamps_of_a_motion_in_a_smaller_unit_are_refused(
    tmp_path: Path, unit: str | None, size: float, rate: float
) -> None:
    make_csv(tmp_path)
    head = (tmp_path / "imu.csv").read_text().partition("\n")[0]
    rows = "".join(f"{k / rate * size!r},0.1,0.2,0.3,0,0,9.8\n" for k in range(30))
    (tmp_path / "imu.csv").write_text(f"{head}\n{rows}")
    if unit is None:
        assert logs.load("csv", tmp_path).imu is not None
    else:
        with pytest.raises(InswsnError, match=r"imu.csv: time_s has a median step of .* in .s, of"):
            logs.load("csv", tmp_path)
        if rate > 10:
            with pytest.raises(InswsnError, match=f"seems to be in {unit}, of which the column"):
                logs.load("csv", tmp_path)


@pytest.mark.parametrize(("unit", "size"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_one_stream_in_a_smaller_unit_is_refused(tmp_path: Path, unit: str, size: float) -> None:
    car = drive(0, 1.0)
    other = replace(car, fixes=replace(car.fixes, time=size * (car.fixes.time + 0.3)))
    logs.write_csv(other, tmp_path / "new")
    with pytest.raises(InswsnError, match=f"fixes.csv: time_s has a median step .* in {unit}, of"):
        logs.load("csv", tmp_path / "new")
    slow = replace(car, fixes=replace(car.fixes, time=30 * car.fixes.time))
    logs.write_csv(slow, tmp_path / "slow")
    assert logs.load("csv", tmp_path / "slow").fixes is not None


def drive(seed: int, noise: float) -> Recording:
    """A car at 8 m/s that winds, with an IMU, fixes, a reference and odometry."""
    rng, time = np.random.default_rng(seed), np.arange(0, 60, 0.02)
    turn = 0.3 * np.cos(0.4 * time + seed)
    heading = np.cumsum(turn) * 0.02
    place = 0.16 * np.cumsum([np.cos(heading), np.sin(heading), 0 * time], axis=1).T
    force = np.column_stack([0 * time, 8 * turn, 0 * time + 9.81]) + rng.normal(0, 0.05, (3000, 3))
    rate = np.outer(turn, [0, 0, 1])
    fixes = Fixes(time[::10], place[::10] + noise * rng.normal(size=(300, 3)))
    odometry = Odometry(time, 8 + 0 * time, turn)
    reference = Reference(time, place)
    return Recording("car", Imu(time, rate, force), odometry, None, fixes, reference)


@pytest.mark.parametrize("only", ["imu", "odometry"])
@pytest.mark.parametrize("north", [0, 1])
@pytest.mark.parametrize("noise", [0.01, 2.0])
def test_degrees_are_no_metres(tmp_path: Path, only: str, north: int, noise: float) -> None:
    right = drive(north, noise)
    position = right.fixes.position[:, :2] + 20.0
    metres = replace(right.fixes, position=position)
    kept = replace(right, fixes=metres).without("odometry" if only == "imu" else "imu")
    logs.write_csv(kept, tmp_path / "metres")
    assert logs.load("csv", tmp_path / "metres").fixes is not None
    degrees = np.roll([48.1, 11.5], north) + position / 111e3
    logs.write_csv(replace(kept, fixes=replace(metres, position=degrees)), tmp_path / "new")
    said = r"fixes.csv: the positions in columns x_m, y_m seem to be latitude and longitude in deg"
    with pytest.raises(InswsnError, match=said):
        logs.load("csv", tmp_path / "new")


@pytest.mark.parametrize("noise", [1e-3, 0.05])
def test_a_tag_at_rest_is_not_in_degrees(tmp_path: Path, noise: float) -> None:
    """An antenna about which an IMU turns by hand, far from the origin of its frame."""
    rng, right = np.random.default_rng(4), drive(0, 0.0)
    time = right.imu.time
    force = 9.81 * np.column_stack([np.sin(time), np.cos(time), 0 * time])
    fixes = Fixes(time[::10], [11.5, 48.1, 1.0] + noise * rng.normal(size=(300, 3)))
    logs.write_csv(Recording("still", replace(right.imu, force=force), fixes=fixes), tmp_path / "a")
    assert logs.load("csv", tmp_path / "a").fixes is not None


def test_a_description_that_is_no_mapping_is_refused(tmp_path: Path) -> None:
    make_csv(tmp_path)
    (tmp_path / "recording.yaml").write_text("- a walk\n")
    with pytest.raises(InswsnError, match=r"recording.yaml: it is not a mapping; it must have"):
        logs.load("csv", tmp_path)


@pytest.mark.parametrize(("size", "unit"), [(0.02, None), (0.97, "g"), (9.7, None), (981, "mg")])
def test_a_force_in_another_unit_is_refused(tmp_path: Path, size: float, unit: str | None) -> None:
    make_csv(tmp_path)
    path = tmp_path / "imu.csv"
    path.write_text(re.sub(r"0.0,0.0,9.8|0.5,-0.5,9.9", f"0,0,{size}", path.read_text()))
    if unit is None:
        assert logs.load("csv", tmp_path).imu is not None
        return
    with pytest.raises(InswsnError, match=f"{size} *; it seems to be in {unit}"):
        logs.load("csv", tmp_path)


def test_a_folder_with_nothing_is_refused(tmp_path: Path) -> None:
    said = r"has no rows of a recording; it must have one of imu.csv, odometry.csv, ranges.csv"
    with pytest.raises(InswsnError, match=said):
        logs.load("csv", tmp_path)
    (tmp_path / "walk.csv").write_text("time_s\n1\n")
    (tmp_path / "anchors.csv").write_text("anchor,x_m,y_m\nA,1,2\n")
    with pytest.raises(InswsnError, match=f"{tmp_path.name} {said}"):
        logs.load("csv", tmp_path)
    (tmp_path / "odometry.csv").write_text("")
    with pytest.raises(InswsnError, match=r"odometry.csv is empty; it must be a CSV file with"):
        logs.load("csv", tmp_path)


# --- what is written ---


def floats(most: float = 1e6) -> st.SearchStrategy[float]:
    return st.floats(-most, most, allow_nan=False)


def times(rows: int, **how: Any) -> st.SearchStrategy[list[float]]:
    return st.lists(floats(1e3), min_size=rows, max_size=rows, **how).map(sorted)


ANCHOR = st.text(min_size=1, max_size=5).filter(
    lambda name: name.isprintable() and name == name.strip() and not name.startswith("#")
)
TEXT = st.text(st.characters(exclude_categories=("Cs",)), max_size=20)


@st.composite
def made(draw: st.DrawFn) -> Recording:
    """Return a recording of any numbers that have the units of one."""
    rows, dimension = draw(st.integers(1, 4)), draw(st.integers(2, 3))
    names = draw(st.lists(ANCHOR, min_size=1, max_size=3, unique=True))

    def table(*width: int, most: float = 1e6, gaps: bool = False) -> Any:
        numbers = st.one_of(floats(most), st.just(np.nan)) if gaps else floats(most)
        return draw(arrays(float, (rows, *width), elements=numbers))

    def time(repeats: bool = False) -> Any:
        return np.array(draw(times(rows, unique=not repeats)))

    def maybe(value: Any) -> Any:
        return value if draw(st.booleans()) else None

    attitude = table(4) + 3e6 * np.eye(4)[3]
    attitude /= np.linalg.norm(attitude, axis=1)[:, None]
    anchor = draw(arrays(int, rows, elements=st.integers(0, len(names) - 1)))
    places = draw(arrays(float, (len(names), dimension), elements=floats()))
    fixes = [maybe(table(dimension, gaps=True)) for _ in range(2)]
    good = maybe(draw(arrays(bool, rows)))
    return Recording(
        draw(TEXT.filter(bool)),
        imu=maybe(Imu(time(), table(3, most=35.0), table(3, most=0.5))),
        odometry=maybe(Odometry(time(), table(), table())),
        ranges=maybe(Ranges(time(repeats=True), anchor, table(), places, tuple(names))),
        fixes=maybe(Fixes(time(), table(dimension, gaps=True), *fixes, good)),
        reference=Reference(time(), table(dimension), maybe(attitude)),
        lever_arm=draw(arrays(float, 3, elements=floats())),
        origin=maybe(draw(arrays(float, 3, elements=floats()))),
        licence=draw(TEXT),
        source=draw(TEXT.filter(bool)),
    )


@given(recording=made())
@settings(max_examples=40)
def test_what_is_written_is_read_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, recording: Recording
) -> None:
    folder = tmp_path_factory.mktemp("written") / "new"
    logs.write_csv(recording, folder)
    read = logs.load("csv", folder)
    np.testing.assert_equal(values_of(read), values_of(recording))
    about = (recording.name, recording.licence, recording.source)
    assert (read.name, read.licence, read.source) == about


def test_what_is_there_is_not_written_over(tmp_path: Path) -> None:
    make_csv(tmp_path)
    read = logs.load("csv", tmp_path)
    with pytest.raises(InswsnError, match=r"has imu.csv, .*, recording.yaml already; it must be "):
        logs.write_csv(read, tmp_path)
    with pytest.raises(InswsnError, match=r"imu.csv.new cannot be written to: Not a directory\."):
        logs.write_csv(read, tmp_path / "imu.csv" / "new")
    logs.write_csv(read.without("ranges"), str(tmp_path / "a" / "b"))
    assert not (tmp_path / "a" / "b" / "anchors.csv").exists()
