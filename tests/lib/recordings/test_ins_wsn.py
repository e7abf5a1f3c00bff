"""Reading a recording: what is taken from it, and every way to be refused."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st
from inswsn_book.parameters import chapter_schema

from inswsn_lib.errors import InswsnError
from inswsn_lib.navigation import INS, REFERENCE, TIME, WSN, read_recording

PERIOD = 0.25


def table(steps: int = 80, seed: int = 1) -> pd.DataFrame:
    """Return a walk round a bend: the INS drifts a little, the network is noisy."""
    rng = np.random.default_rng(seed)
    time = 5.0 + PERIOD * np.arange(steps)
    heading = 0.05 * time
    velocity = 1.5 * np.column_stack([np.cos(heading), np.sin(heading)])
    position = np.cumsum(velocity, axis=0) * PERIOD
    truth = np.hstack([position, velocity])
    drift = 0.01 * np.arange(steps)[:, None] * PERIOD * np.ones(2)
    ins = truth + np.hstack([np.cumsum(drift, axis=0) * PERIOD, drift])
    wsn = truth + rng.normal(scale=[0.2, 0.2, 0.1, 0.1], size=(steps, 4))
    columns = (TIME, *INS, *WSN, *REFERENCE)
    return pd.DataFrame(np.column_stack([time, ins, wsn, truth]), columns=list(columns))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "my.csv"


def write(path: Path, made: pd.DataFrame) -> Path:
    made.to_csv(path, index=False)
    return path


def test_what_is_written_is_read(path: Path) -> None:
    made = table()
    read = read_recording(write(path, made))
    assert read.period == pytest.approx(PERIOD)
    assert read.time == pytest.approx(made[TIME].to_numpy())
    assert read.ins == pytest.approx(made[list(INS)].to_numpy())
    assert read.wsn == pytest.approx(made[list(WSN)].to_numpy())
    assert read.reference == pytest.approx(made[list(REFERENCE)].to_numpy())
    assert read.jitter == pytest.approx(0, abs=1e-9)
    assert read.outages == []
    assert read.measurements.shape == (80, 4, 1)
    assert read.measurements[:, :, 0] == pytest.approx(read.ins - read.wsn)


def test_order_of_columns_comments_and_other_columns_do_not_matter(path: Path) -> None:
    made = table()
    text = "# a comment\n" + made[made.columns[::-1]].assign(note="x").to_csv(index=False)
    path.write_text(text.replace(",", " , "))
    assert read_recording(path).ins == pytest.approx(made[list(INS)].to_numpy())


def test_without_a_whole_reference_there_is_none(path: Path) -> None:
    assert read_recording(write(path, table().drop(columns=REFERENCE[0]))).reference is None


def test_a_network_without_velocities(path: Path) -> None:
    made = table()
    for change in (
        made.drop(columns=list(WSN[2:])),
        made.assign(**dict.fromkeys(WSN[2:], "")),
    ):
        read = read_recording(write(path, change))
        assert read.wsn[:, :2] == pytest.approx(made[list(WSN[:2])].to_numpy())
        assert np.isnan(read.wsn[:, 2:]).all()
        assert read.outages == []
    with pytest.raises(InswsnError, match="both or neither"):
        read_recording(write(path, made.drop(columns=WSN[3])))


def test_a_network_slower_than_the_ins_is_not_silent(path: Path) -> None:
    made = table()
    made.loc[made.index % 5 != 0, list(WSN)] = np.nan
    made.loc[40:51, list(WSN)] = np.nan  # fixes at 35 and 55 are left
    assert read_recording(write(path, made)).outages == [(36, 55)]


@given(
    st.sets(st.integers(1, 78), max_size=20),
    st.sets(st.integers(0, 79), max_size=30),
    st.integers(0, 99),
)
def test_rows_and_fixes_may_be_missing(
    tmp_path_factory: pytest.TempPathFactory, rows: set[int], fixes: set[int], seed: int
) -> None:
    made, rng = table(), np.random.default_rng(seed)
    made[TIME] += rng.uniform(-0.01, 0.01, len(made))
    made.loc[sorted(fixes), list(WSN)] = np.nan
    path = write(tmp_path_factory.mktemp("r") / "my.csv", made.drop(index=sorted(rows)))
    read = read_recording(path)
    assert read.period == pytest.approx(PERIOD, abs=1e-3)
    assert len(read.time) == 80
    assert set(np.flatnonzero(np.isnan(read.wsn).all(axis=1))) == rows | fixes
    kept = sorted(set(range(80)) - rows)
    assert read.ins[kept] == pytest.approx(made.loc[kept, list(INS)].to_numpy())
    assert np.isnan(read.ins[sorted(rows)]).all()


def changed(rows: object, name: str, value: object) -> Callable[[pd.DataFrame], pd.DataFrame]:
    def change(made: pd.DataFrame) -> pd.DataFrame:
        made = made.astype(object)
        made.loc[rows, name] = value
        return made

    return change


def scaled(factor: float, *names: str) -> Callable[[pd.DataFrame], pd.DataFrame]:
    return lambda made: made.assign(**{name: made[name] * factor for name in names})


@pytest.mark.parametrize("name", [TIME, *INS, *WSN[:2]])
def test_a_missing_column(path: Path, name: str) -> None:
    with pytest.raises(InswsnError, match=f"has no column {name}; it has "):
        read_recording(write(path, table().drop(columns=name)))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (changed(slice(10, 14), "ins_vx_mps", np.nan), "ins_vx_mps for 5 rows from row 12;"),
        (changed(79, "ins_x_m", np.nan), "in column ins_x_m for 1 row from row 81;"),
        (changed(slice(0, 80), "wsn_y_m", np.nan), "no number at all in column wsn_y_m"),
        (changed(3, "wsn_y_m", "lost"), "has 'lost' in column wsn_y_m, row 5;"),
        (changed(3, "ins_y_m", "inf"), "has 'inf' in column ins_y_m, row 5;"),
        (changed(3, TIME, np.nan), "no time stamp in row 5"),
        (changed(3, TIME, 5.5), "repeats 5.5 s in row 5"),
        (changed(3, TIME, 5.1), "goes back from 5.5 s in row 5"),
        (changed(40, TIME, 15.07), "in row 42 is \\+0.0\\d+ s off an even grid of 0.25"),
        (lambda made: made.iloc[::-1], "goes back from"),
        (lambda made: made.iloc[:2], "has 2 rows"),
        (lambda made: made + np.where(made.columns.str.startswith("wsn_x"), 5e5, 0), "km from"),
        (scaled(1000, TIME), "is 0.001 times .*ms"),
        (scaled(1000, "ins_x_m", "ins_y_m"), "is 1e\\+03 times .*mm"),
        (scaled(3.6, "ins_vx_mps", "ins_vy_mps"), "times .*km/h"),
        (scaled(1.9438, "ins_vx_mps", "ins_vy_mps"), "times .*knots"),
        (scaled(3.6, "wsn_vx_mps", "wsn_vy_mps"), "times .*km/h"),
        (scaled(1.9438, "wsn_vx_mps", "wsn_vy_mps"), "times .*knots"),
        (scaled(3.2808, *WSN), "times .*feet"),
        (scaled(3.2808, "ref_x_m", "ref_y_m"), "times .*feet"),
        (scaled(3.2808, *REFERENCE), "times .*feet"),
        (changed(slice(40, 79), TIME, np.arange(1e9, 1e9 + 40)), "jumps by .* in row 42"),
        (scaled(100, "wsn_x_m", "wsn_y_m"), "times .*cm"),
        (scaled(1 / 111200, "wsn_x_m", "wsn_y_m"), "times .*degrees of latitude"),
    ],
)
def test_a_wrong_recording_is_refused_in_one_sentence(
    path: Path, change: Callable[[pd.DataFrame], pd.DataFrame], said: str
) -> None:
    write(path, change(table()))
    with pytest.raises(InswsnError, match=said) as caught:
        read_recording(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def walk(seconds: float, bias: float, stand: float = 0.0) -> pd.DataFrame:
    """Return a walk at 1 m/s along x with a start from rest; the INS has a bias along its way."""
    time = np.arange(0, seconds, PERIOD)
    moving = np.maximum(time - stand, 0)
    zero, one = np.zeros_like(time), (time >= stand).astype(float)
    truth = np.column_stack([moving, zero, one, zero])
    drift = np.column_stack([bias * time**2 / 2, zero, bias * time, zero])
    rng = np.random.default_rng(6)
    wsn = truth + rng.normal(scale=[0.2, 0.2, 0.1, 0.1], size=truth.shape)
    columns = [TIME, *INS, *WSN, *REFERENCE]
    return pd.DataFrame(np.column_stack([time, truth + drift, wsn, truth]), columns=columns)


@pytest.mark.parametrize(("seconds", "bias"), [(120, 0.05), (300, 0.05), (600, 0.03)])
def test_a_drift_along_a_straight_way_is_no_wrong_unit(
    path: Path, seconds: float, bias: float
) -> None:
    assert len(read_recording(write(path, walk(seconds, bias))).time) == seconds / PERIOD


@pytest.mark.parametrize("factor", [3.2808, 1000.0, 0.01])
def test_a_wrong_unit_is_found_after_a_start_from_rest(path: Path, factor: float) -> None:
    made = walk(200, 0.001, stand=60)
    made[list(WSN)] *= factor
    with pytest.raises(InswsnError, match="times"):
        read_recording(write(path, made))


@pytest.mark.parametrize(("factor", "refused"), [(1.55, False), (1.65, True)])
def test_the_factor_between_positions_and_velocities(
    path: Path, factor: float, refused: bool
) -> None:
    made = table()
    made[list(INS[2:])] *= factor
    write(path, made)
    if refused:
        with pytest.raises(InswsnError, match="times"):
            read_recording(path)
    else:
        read_recording(path)


@pytest.mark.parametrize(("share", "refused"), [(0.18, False), (0.23, True)])
def test_how_far_off_the_grid_a_time_stamp_may_be(path: Path, share: float, refused: bool) -> None:
    made = table()
    made.loc[40, TIME] += share * PERIOD
    write(path, made)
    if refused:
        with pytest.raises(InswsnError, match="off an even grid"):
            read_recording(path)
    else:
        read_recording(path)


def test_the_jitter_is_the_standard_deviation_from_the_grid(path: Path) -> None:
    made = table()
    made[TIME] += np.where(made.index % 2 == 0, 0.01, -0.01)
    assert read_recording(write(path, made)).jitter == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("rate", [30, 60])
@pytest.mark.parametrize("gap", [0, 60, 3000])
def test_time_stamps_rounded_to_milliseconds(path: Path, rate: int, gap: int) -> None:
    made = table(200)
    steps = np.arange(200) + np.where(np.arange(200) > 90, gap, 0)
    if gap:
        made = made.astype(float)
    made[TIME] = np.round(steps / rate, 3)
    made[list(INS[2:] + WSN[2:] + REFERENCE[2:])] *= rate * PERIOD  # as fast as it moves
    if gap > 1000:
        with pytest.raises(InswsnError, match="jumps by"):
            read_recording(write(path, made))
        return
    read = read_recording(write(path, made))
    assert read.period == pytest.approx(1 / rate, rel=1e-3)
    assert len(read.time) == 200 + gap


def test_a_sign_in_a_cell_is_no_comment(path: Path) -> None:
    made = table()
    made.insert(1, "status", np.where(made.index % 4 == 0, "#lost lock", "run #2"))
    assert read_recording(write(path, made)).outages == []


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("\n", ",\n").replace("mps,\n", "mps\n", 1), "cells in row 2"),
        (lambda text: text.replace("ins_y_m", " ins_x_m "), "column ins_x_m more than once"),
        (lambda text: text.replace("ins_y_m", "a,a"), "has no column ins_y_m"),
        (lambda text: text + "1,2\n", "has 2 cells in row 82"),
        (lambda text: text + '"1\n', "is not a CSV file"),
    ],
)
def test_cells_that_do_not_fit_the_header(
    path: Path, change: Callable[[str], str], said: str
) -> None:
    path.write_text(change(table().to_csv(index=False)))
    with pytest.raises(InswsnError, match=said):
        read_recording(path)


def test_a_name_that_promises_compression_changes_nothing(path: Path) -> None:
    zipped = path.with_suffix(".zip")
    assert read_recording(write(path, table()).rename(zipped)).outages == []


def test_noise_standing_still_and_drift_are_no_wrong_unit(path: Path) -> None:
    made, rng = table(), np.random.default_rng(4)
    noisy = made.copy()
    noisy[["wsn_vx_mps", "wsn_vy_mps"]] += rng.normal(scale=5, size=(80, 2))
    read_recording(write(path, noisy))
    still = made.copy()
    still[[*INS, *WSN]] = rng.normal(scale=0.01, size=(80, 8))
    read_recording(write(path, still))
    drifting = made.copy()  # along its way, to twice the distance
    drifting[list(INS)] *= np.linspace(1, 2, 80)[:, None]
    drifting[["ins_vx_mps", "ins_vy_mps"]] = np.gradient(
        drifting[["ins_x_m", "ins_y_m"]].to_numpy(), PERIOD, axis=0
    )
    read_recording(write(path, drifting))


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b'a,b\n"1,2\n', b"\n\n\n"])
def test_what_is_no_table_is_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(InswsnError) as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_another_separator_is_named(path: Path, separator: str) -> None:
    table().to_csv(path, index=False, sep=separator)
    with pytest.raises(InswsnError, match="may be separated by commas"):
        read_recording(path)


def test_windows_line_ends_and_a_byte_order_mark(path: Path) -> None:
    text = table().to_csv(index=False).replace("\n", "\r\n")
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert read_recording(path).ins == pytest.approx(table()[list(INS)].to_numpy())


def test_no_file_and_a_folder(path: Path) -> None:
    with pytest.raises(InswsnError, match="There is no file"):
        read_recording(path)
    path.mkdir()
    with pytest.raises(InswsnError, match="is a folder"):
        read_recording(path)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("bytes") / "my.csv"
    path.write_bytes(content)
    with pytest.raises(InswsnError):
        read_recording(path)


def test_the_example_is_what_its_script_makes(root: Path, tmp_path: Path) -> None:
    made = runpy.run_path(str(root / "studies" / "example_recording.py"))["make"]()
    assert made == (root / "data" / "examples" / "ins-wsn.csv").read_text(encoding="utf-8")


def test_the_chapter_is_told_the_noise_that_the_example_was_made_with(root: Path) -> None:
    study = runpy.run_path(str(root / "studies" / "example_recording.py"))
    told = chapter_schema(root, "90").defaults
    assert (told["wsn_position_noise"], told["wsn_velocity_noise"]) == study["FIX_NOISE"]
    assert told["acceleration_noise"] == study["ACCELERATION_NOISE"]
