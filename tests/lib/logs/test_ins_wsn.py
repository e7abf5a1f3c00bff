"""Reading a recording: what is taken from it, and every way to be refused."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st
from inswsn_book.record.parameters import chapter_schema

from inswsn_lib import files
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs import INS, REFERENCE, TIME, WSN, TrackPair, read_recording

PERIOD = 0.25
Change = Callable[[pd.DataFrame], pd.DataFrame]


def table(steps: int = 80, seed: int = 1) -> pd.DataFrame:
    """Return a walk round a bend: the INS drifts a little, the network is noisy."""
    rng = np.random.default_rng(seed)
    time = 5.0 + PERIOD * np.arange(steps)
    heading = 0.05 * time
    velocity = 1.5 * np.column_stack([np.cos(heading), np.sin(heading)])
    truth = np.hstack([np.cumsum(velocity, axis=0) * PERIOD, velocity])
    drift = 0.01 * np.arange(steps)[:, None] * PERIOD * np.ones(2)
    ins = truth + np.hstack([np.cumsum(drift, axis=0) * PERIOD, drift])
    wsn = truth + rng.normal(scale=[0.2, 0.2, 0.1, 0.1], size=(steps, 4))
    columns = [TIME, *INS, *WSN, *REFERENCE]
    return pd.DataFrame(np.column_stack([time, ins, wsn, truth]), columns=columns)


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
    assert np.array_equal(read.ins, made[list(INS)])
    assert np.array_equal(read.wsn, made[list(WSN)])
    assert np.array_equal(read.reference, made[list(REFERENCE)])
    assert read.jitter == pytest.approx(0, abs=1e-9)
    assert read.outages == []
    assert np.array_equal(read.measurements[:, :, 0], read.ins - read.wsn)
    made[TIME] += np.where(made.index % 2 == 0, 0.01, -0.01)
    with patch.object(files, "_PIECE", 300):  # in pieces the same is read
        other = read_recording(str(write(path, made.drop(columns=[*REFERENCE]))))
    assert other.reference is None
    assert other.jitter == pytest.approx(0.01, rel=1e-3)
    assert np.array_equal(np.hstack([other.ins, other.wsn]), np.hstack([read.ins, read.wsn]))


def test_how_the_file_is_written_does_not_matter(path: Path) -> None:
    """Order and other columns, quotes, comments, blanks, line ends, whole numbers, a wrong name."""
    made = table()
    made["ins_x_m"] = made["ins_x_m"].round()
    made.insert(1, "status", np.where(made.index % 4 == 0, "#lost, lock", "run #2"))
    made["wsn_x_m"] = made["wsn_x_m"].where(made.index != 7, "NaN ")
    text = "# a comment\n" + made[made.columns[::-1]].to_csv(index=False).replace(".0,", " , ")
    path = path.with_suffix(".zip")
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n\r\n# more\r\n").encode())
    read = read_recording(path)
    assert np.array_equal(read.ins, made[list(INS)])
    assert np.isnan(read.wsn[7]).tolist() == [True, False, False, False]


SIGNS = [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ",")]


@pytest.mark.parametrize(("separator", "decimal"), SIGNS)
@pytest.mark.parametrize("stamps", ["seconds", "with a zone", "without dashes"])
def test_separators_decimal_signs_and_dates(
    path: Path, separator: str, decimal: str, stamps: str
) -> None:
    made = table()
    expected = made[TIME] if stamps == "seconds" else made[TIME] + 1_700_000_000
    if stamps != "seconds":
        moments = pd.to_datetime(expected, unit="s", utc=True)
        if stamps == "with a zone":
            moments = moments.dt.tz_convert("Asia/Kolkata")  # +05:30
        form = "%Y%m%dT%H%M%S.%f" if stamps == "without dashes" else "%Y-%m-%d %H:%M:%S.%f"
        texts = moments.dt.strftime(form + ("%z" if stamps == "with a zone" else ""))
        made[TIME] = texts.str.replace(".", decimal)
    made.loc[7, "wsn_x_m"] = np.nan
    made.insert(0, "status", "ok")
    made.to_csv(path, index=False, sep=separator, decimal=decimal)
    read = read_recording(path)
    assert read.time == pytest.approx(expected.to_numpy(), abs=1e-6)
    assert np.array_equal(read.ins, made[list(INS)])
    assert np.array_equal(read.wsn, made[list(WSN)], equal_nan=True)


def test_the_other_decimal_sign_is_refused(path: Path) -> None:
    made = table().round(3).astype(str)
    made.loc[40, "ins_y_m"] = "1,5"
    made.to_csv(path, index=False, sep=";")
    with pytest.raises(InswsnError, match="has '1,5' in column ins_y_m, row 42"):
        read_recording(path)


def test_a_network_without_velocities(path: Path) -> None:
    made = table()
    for change in (made.drop(columns=list(WSN[2:])), made.assign(**dict.fromkeys(WSN[2:], ""))):
        read = read_recording(write(path, change))
        assert np.array_equal(read.wsn[:, :2], made[list(WSN[:2])])
        assert np.isnan(read.wsn[:, 2:]).all()
        assert read.outages == []


def test_a_network_slower_than_the_ins_is_not_silent(path: Path) -> None:
    made = table()
    made.loc[made.index % 5 != 0, list(WSN)] = np.nan
    made.loc[40:51, list(WSN)] = np.nan  # fixes at 35 and 55 are left
    assert read_recording(write(path, made)).outages == [(36, 55)]
    # two steps are missing: 3 is more than 2.5 times the usual distance of fixes, 2 is not
    wsn = np.zeros((11, 4))
    wsn[[2, 5, 6, 9, 10]] = np.nan
    wsn[8, 0] = np.nan  # the other components are there
    assert TrackPair(np.arange(11.0), 1.0, wsn, wsn, None, 0.0).outages == [(5, 7), (9, 11)]


@given(
    st.sets(st.integers(1, 78), max_size=20), st.sets(st.integers(0, 79), max_size=30),
    st.integers(0, 99),
)  # fmt: skip
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
    assert np.array_equal(read.ins[kept], made.loc[kept, list(INS)])
    assert np.isnan(read.ins[sorted(rows)]).all()


def changed(rows: object, name: str, value: object) -> Change:
    def change(made: pd.DataFrame) -> pd.DataFrame:
        made = made.astype(object)
        made.loc[rows, name] = value
        return made

    return change


def scaled(factor: float, *names: str) -> Change:
    return lambda made: made.assign(**{name: made[name] * factor for name in names})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        *((lambda made, name=name: made.drop(columns=name), f"has no column {name}; it has ")
          for name in (TIME, INS[3], WSN[1])),
        (lambda made: made.drop(columns=WSN[3]), "only wsn_vx_mps of the columns wsn_vx_mps, "),
        (lambda made: made.drop(columns=[*REFERENCE[1:]]), "only ref_x_m of the columns"),
        (changed(slice(10, 14), "ins_vx_mps", np.nan), "empty cell is .* ins_vx_mps, row 12;"),
        (changed(79, "ins_x_m", np.nan), "an empty cell is in column ins_x_m, row 81; .* left out"),
        (changed(slice(0, 80), "wsn_y_m", np.nan), "no number at all in column wsn_y_m"),
        (changed(3, "wsn_y_m", "lost"), "has 'lost' in column wsn_y_m, row 5;"),
        (changed(3, "ins_y_m", "inf"), "has 'inf' in column ins_y_m, row 5;"),
        (changed(3, "ins_y_m", "1e308"), "has '1e.?308' in column ins_y_m, row 5;"),
        (changed(3, TIME, "noon"), "has 'noon' in column time_s, row 5; .* ISO 8601"),
        (changed(3, TIME, "2024-05-01T12:00"), "has '2024-05-01T12:00' in column time_s, row 5"),
        (changed(3, TIME, np.nan), "an empty cell is in column time_s, row 5"),
        (changed(3, TIME, 5.5), "time_s: the time stamp repeats in row 5"),
        (changed(3, TIME, 5.1), "time_s: .* goes back by 0.4 s in row 5"),
        (changed(40, TIME, 15.07), r"15.07 s in row 42 is \+0.0\d+ s off an even grid of 0.25"),
        (lambda made: made.iloc[:2], "has 2 rows"),
        (lambda made: made + np.where(made.columns.str.startswith("wsn_x"), 5e5, 0), "500 km from"),
        (changed(slice(40, 79), TIME, np.arange(1e9, 1e9 + 40)), "jumps by 1e.09 s in row 42"),
        (scaled(1000, TIME), "ins_x_m and ins_y_m is 0.001 times that in ins_vx_mps .*ms"),
        (scaled(1000, "ins_x_m", "ins_y_m"), r"is 1e\+03 times .*mm"),
        (scaled(3.6, "ins_vx_mps", "ins_vy_mps"), "is 0.278 times .*km/h"),
        (scaled(1.9438, "wsn_vx_mps", "wsn_vy_mps"), "is 0.5.* times .*knots"),
        (lambda made: scaled(3.2808, *WSN)(table(400).drop(columns=[*REFERENCE])),
         "change of speed along wsn_x_m .* that along ins_x_m .*feet"),
        (scaled(3.2808, *REFERENCE), "speed along wsn_x_m .* 0.3.* that along ref_x_m .*feet"),
        (scaled(100, "wsn_x_m", "wsn_y_m"), "times .*cm"),
        (scaled(1 / 111200, "wsn_x_m", "wsn_y_m"), "times .*degrees of latitude"),
    ],
)  # fmt: skip
def test_a_wrong_recording_is_refused_in_one_sentence(
    path: Path, change: Change, said: str
) -> None:
    write(path, change(table()))
    with pytest.raises(InswsnError, match=said) as caught:
        read_recording(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("\n", ",\n").replace("mps,\n", "mps\n", 1), "14 cells in row 2"),
        (lambda text: text.replace("ins_y_m", " ins_x_m "), "column ins_x_m more than once"),
        (lambda text: text.replace("ins_y_m", "a,a"), "has no column ins_y_m"),
        (lambda text: text + "1,2\n", "has 2 cells in row 82"),
        (lambda text: text + '"1\n', "is not a CSV file"),
        (lambda text: text.replace(".", ","), "has 26 cells in row 2; there must be 13"),
        (lambda text: text + '"1,2",3,4,5,6,7,8,9,10,11,12,13\n', "has 12 cells in row 82"),
        (lambda text: "\n# all\n", "is empty"),
        (lambda text: text.partition("\n")[0], "has 0 rows"),
    ],
)
def test_cells_that_do_not_fit_the_header(
    path: Path, change: Callable[[str], str], said: str
) -> None:
    path.write_text(change(table().to_csv(index=False)))
    with pytest.raises(InswsnError, match=said):
        read_recording(path)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("bytes") / "my.csv"
    for what in (content, f"{','.join([TIME, *INS, *WSN])}\n".encode() + content):
        path.write_bytes(what)
        with pytest.raises(InswsnError):
            read_recording(path)


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


@pytest.mark.parametrize("factor", [3.2808, 1000.0, 0.01])
def test_a_wrong_unit_is_found_after_a_start_from_rest(path: Path, factor: float) -> None:
    made = walk(200, 0.001, stand=60)
    made[list(WSN)] *= factor
    made.loc[300:340, list(WSN)] = np.nan  # and with gaps
    with pytest.raises(InswsnError, match="times"):
        read_recording(write(path, made.drop(index=range(500, 540))))


def test_what_is_no_wrong_unit(path: Path) -> None:
    """A drift along a straight way, standing still, noise, and a drift to twice the distance."""
    for seconds, bias in ((120, 0.05), (300, 0.05), (600, 0.03)):
        assert len(read_recording(write(path, walk(seconds, bias))).time) == seconds / PERIOD
    rng, noisy = np.random.default_rng(4), table()
    noisy[["wsn_vx_mps", "wsn_vy_mps"]] += rng.normal(scale=5, size=(80, 2))
    still = table()
    still[[*INS, *WSN]] = rng.normal(scale=0.01, size=(80, 8))
    drifting = table()
    drifting[list(INS)] *= np.linspace(1, 2, 80)[:, None]
    drifting[["ins_vx_mps", "ins_vy_mps"]] = np.gradient(
        drifting[["ins_x_m", "ins_y_m"]].to_numpy(), PERIOD, axis=0
    )
    for made in (noisy, still, drifting):
        assert len(read_recording(write(path, made)).time) == 80


@pytest.mark.parametrize(
    ("steps", "change", "said"),
    [
        (80, scaled(1.55, *INS[2:]), None),
        (80, scaled(1.65, *INS[2:]), "times"),
        (80, changed(40, TIME, 15 + 0.18 * PERIOD), None),
        (80, changed(40, TIME, 15 + 0.23 * PERIOD), "off an even grid"),
        (80, scaled(3.5, *WSN, *REFERENCE), None),  # three changes of speed are too few
        (400, scaled(2.4, *WSN, *REFERENCE), None),
        (400, scaled(2.9, *WSN, *REFERENCE), "the change of speed"),
        (400, scaled(5.0, *WSN, *REFERENCE), None),  # of no known unit
        (80, lambda made: made + np.where(made.columns.str.startswith("wsn_x"), 9900, 0), None),
    ],
)
def test_how_far_off_is_too_far(path: Path, steps: int, change: Change, said: str | None) -> None:
    write(path, change(table(steps)))
    if said is None:
        assert len(read_recording(path).time) == steps
        return
    with pytest.raises(InswsnError, match=said):
        read_recording(path)


def uneven(seed: int, gaps: tuple[int, ...] = ()) -> pd.DataFrame:
    """Return a steady acceleration, stamps 80 ms off, an INS of constant error, some rows gone."""
    time = PERIOD * np.arange(120) + np.random.default_rng(seed).uniform(-0.08, 0.08, 120)
    truth = accelerated(time)
    made = pd.DataFrame(
        np.column_stack([time, np.add(truth, [1.0, -2.0, 0.0, 0.0]), truth]),
        columns=[TIME, *INS, *WSN],
    )
    return made.drop(index=list(gaps))


def accelerated(time: np.ndarray) -> np.ndarray:
    return np.column_stack([0.15 * time**2, 2 * time - 0.05 * time**2, 0.3 * time, 2 - 0.1 * time])


@pytest.mark.parametrize("gaps", [(), tuple(range(40, 60))])
def test_uneven_stamps_are_resampled_if_that_is_asked(path: Path, gaps: tuple[int, ...]) -> None:
    """Cubic polynomials are exact for a steady acceleration, and so is what a fix differs by."""
    write(path, uneven(1, gaps))
    with pytest.raises(InswsnError, match=r"off an even grid .* resample=True"):
        read_recording(path)
    read = read_recording(path, resample=True)
    assert read.resampled
    assert np.ptp(np.diff(read.time)) < 1e-9
    assert read.period == pytest.approx(PERIOD, rel=0.05)
    there = ~np.isnan(read.ins).any(axis=1)
    assert there.mean() > (0.8 if gaps else 0.99)
    error = read.ins - accelerated(read.time) - [1.0, -2.0, 0.0, 0.0]
    assert np.nanmax(np.abs(error[1:-1])) < 1e-9
    fixed = ~np.isnan(read.wsn).any(axis=1)
    assert fixed.sum() > 0.6 * (120 - len(gaps))
    measured = read.measurements[fixed, :, 0]
    assert np.abs(measured - [1.0, -2.0, 0.0, 0.0]).max() < 1e-9
    assert 0.02 < read.jitter < PERIOD / 2
    if gaps:
        [(first, last)] = read.outages
        assert (last - first) * read.period == pytest.approx(20 * PERIOD, abs=2 * PERIOD)


def test_even_stamps_are_resampled_onto_themselves(path: Path) -> None:
    read, other = (read_recording(write(path, table()), resample=r) for r in (True, False))
    assert (read.resampled, other.resampled) == (True, False)
    for name in ("ins", "wsn", "reference"):
        assert getattr(read, name) == pytest.approx(getattr(other, name))
    assert read.jitter == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("rate", "gap"), [(30, 0), (60, 60)])
def test_time_stamps_rounded_to_milliseconds(path: Path, rate: int, gap: int) -> None:
    made = table(200)
    made[TIME] = np.round((np.arange(200) + np.where(np.arange(200) > 90, gap, 0)) / rate, 3)
    made[list(INS[2:] + WSN[2:] + REFERENCE[2:])] *= rate * PERIOD  # as fast as it moves
    write(path, made)
    read = read_recording(path)
    assert read.period == pytest.approx(1 / rate, rel=1e-3)
    assert len(read.time) == 200 + gap


def test_the_example_is_what_its_script_makes_and_its_chapter_is_told(root: Path) -> None:
    study = runpy.run_path(str(root / "studies" / "example_recording.py"))
    assert study["make"]() == (root / "data/examples/ins-wsn.csv").read_text(encoding="utf-8")
    told = chapter_schema(root, "your-own-data").defaults
    assert (told["wsn_position_noise"], told["wsn_velocity_noise"]) == study["FIX_NOISE"]
    assert told["acceleration_noise"] == study["ACCELERATION_NOISE"]
