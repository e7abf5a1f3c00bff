"""Outages in a recorded drive that was made, and the file that keeps what came of them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from lib.vehicle.made_drive import KNOWN, driven, logged
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array
from inswsn_lib.inertial import metres
from inswsn_lib.learning import HoldRegressor
from inswsn_lib.navigation import RecordedTrials, VehicleHybrid, read_trials, run_recorded_outages
from inswsn_lib.navigation.recorded_trials import _standing
from inswsn_lib.simulation import Drive
from inswsn_lib.simulation.drive import DriveReference
from inswsn_lib.streams import Recording
from inswsn_lib.vehicle import FilterSettings

#: Of the car's forward axis in the IMU's axes: to the right, and up
YAW, PITCH = np.deg2rad([6.0, -2.5])
STARTS, STEPS = (90, 110), 12


# --- the file ---


def some_trials(seed: int = 0) -> RecordedTrials:
    rng = np.random.default_rng(seed)
    return RecordedTrials(
        starts=np.array([3, 5]),
        errors={"never": rng.gamma(2, 30, (4, 2, 3)), "no time": rng.gamma(2, 3, (4, 2, 3))},
        tracks={"never": rng.normal(0, 900, (4, 2, 2)), "no time": rng.normal(0, 900, (4, 2, 2))},
        reference=rng.normal(0, 900, (9, 2)),
        speed=rng.gamma(2, 5, 9),
        mounting=rng.normal(0, 0.1, (2, 2, 3)),
        ladder={"lateral": rng.gamma(2, 3, (3, 2, 3)), "lagged": rng.gamma(2, 3, (3, 2, 1))},
    )


def arrays_of(trials: RecordedTrials) -> dict[str, Array]:
    named = {f"errors.{name}": x for name, x in trials.errors.items()}
    named |= {f"tracks.{name}": x for name, x in trials.tracks.items()}
    named |= {f"ladder.{name}": x for name, x in trials.ladder.items()}
    return named | {name: getattr(trials, name) for name in ("reference", "speed", "mounting")}


def test_what_is_kept_comes_back_to_the_millimetre(tmp_path: Path) -> None:
    kept, path = some_trials(), tmp_path / "new" / "trials.json"
    path.parent.mkdir()
    path.write_text(
        kept.to_json(made="2015-02-03", level=2.0, levels={"1": 0.5}, clean=False), encoding="utf-8"
    )
    found, facts = read_trials(path)
    assert facts == {"made": "2015-02-03", "level": 2.0, "levels": {"1": 0.5}, "clean": False}
    assert found.starts.dtype.kind == "i"
    assert np.array_equal(found.starts, kept.starts)
    assert list(found.errors) == list(found.tracks) == ["never", "no time"]
    before, after = arrays_of(kept), arrays_of(found)
    for name, x in before.items():
        half = 0.5e-6 if name == "mounting" else 0.5e-3
        assert after[name].shape == x.shape
        assert np.abs(after[name] - x).max() <= half * (1 + 1e-9), name
        # it is rounded, and not what was written down in full
        assert not np.array_equal(after[name], x)
    assert path.read_text(encoding="utf-8").endswith("}\n")
    # what has been rounded once stays
    path.write_text(found.to_json(**facts), encoding="utf-8")
    again, _ = read_trials(path)
    assert all(np.array_equal(x, arrays_of(found)[name]) for name, x in arrays_of(again).items())


# --- the outages ---


def turned() -> Array:
    """Take vectors from the IMU's axes to the car's: first about down, then about the new right."""
    return Rotation.from_euler("ZY", [YAW, PITCH]).inv().as_matrix()


@cache
def recording() -> Recording:
    """A recording of the made drive: an IMU without errors, turned in the car."""
    made = driven(125)
    return logged(made, np.hstack([x @ turned() for x in np.split(made.integrals, 2, axis=1)]))


def beliefs() -> FilterSettings:
    return replace(KNOWN, yaw=float(np.deg2rad(10)), tilt=float(np.deg2rad(5)))


def methods(told: FilterSettings) -> dict[str, VehicleHybrid]:
    return {"hold": VehicleHybrid(told, HoldRegressor(), tau=10, window=20)}


def taken(recorded: Recording, starts: tuple[int, ...] = STARTS) -> RecordedTrials:
    return run_recorded_outages(recorded, beliefs(), starts, STEPS, methods, runs=2, seed=4)


@cache
def trials() -> RecordedTrials:
    return taken(recording())


def test_the_ladder_has_no_wheels() -> None:
    """The smoothers in the first run."""
    found = trials().ladder
    aided = dict.fromkeys(("compass", "lateral", "standstill"), (STEPS + 1, 2, 2))
    aided |= dict.fromkeys(("lagged", "smoothed"), (STEPS + 1, 2, 1))
    assert {name: x.shape for name, x in found.items()} == aided
    # an IMU without errors and with the constraint stays where GPS of 3 m had it, smoothed
    for name in ("lateral", "standstill", "lagged", "smoothed"):
        assert np.sqrt(np.mean(found[name][-1] ** 2)) < 3, name


def test_it_stands_where_the_imu_is_quiet() -> None:
    """It shakes but for ten seconds, one, and five: of these one is not believed."""
    shaken, nothing = np.random.default_rng(0).normal(size=(8000, 3, 1)), np.zeros((81, 3, 1))
    for first, last in ((20, 30), (40, 41), (70, 75)):
        shaken[100 * first : 100 * last] /= 100
    reference = DriveReference(nothing[:, :, 0], nothing[:, :, 0])
    drive = Drive(
        np.arange(81.0), 0.01, shaken, shaken, nothing, nothing, nothing[:, 0], reference, (),
        "recorded",
    )  # fmt: skip
    told = _standing(drive, 60)[:, :, 0]
    # the first second is quiet when it is over, and then it is to last for two
    expected = [*range(23, 31), *range(73, 76)]
    assert np.flatnonzero(np.isfinite(told).all(axis=1)).tolist() == expected
    assert not told[expected].any()


def test_the_mounting_is_found_again() -> None:
    """The car never slides, so what is left is the filter's own yaw and pitch, by GPS velocity."""
    yaw, pitch = trials().mounting
    assert trials().mounting.shape == (2, 2, 2)
    assert np.rad2deg(yaw) == pytest.approx(np.rad2deg(YAW), abs=0.5)
    assert np.rad2deg(pitch) == pytest.approx(np.rad2deg(PITCH), abs=0.5)


def test_with_the_mounting_the_constraint_holds() -> None:
    """An IMU without errors: through the outage the aided filter stays where the car is."""
    end = {name: np.sqrt(np.mean(e[-1] ** 2)) for name, e in trials().errors.items()}
    assert end["through"] < 3  # 12 s after GPS of 3 m that is smoothed
    # a mounting that is not estimated sends it 6 degrees to the side: 10 m in 12 s at 9 m/s
    assert 12 * 9 * np.sin(YAW) > 3 * end["through"]


def test_the_reference_is_the_way_that_was_driven() -> None:
    found, way = trials(), driven(125).trajectory.iloc[::100]
    assert not found.reference[0].any()
    latitude, longitude = np.deg2rad(way[["lat", "lon"]].to_numpy()).T
    size = metres(np.array([latitude[0], longitude[0], way.alt.iloc[0]]))
    east, north = (longitude - longitude[0]) * size[1], (latitude - latitude[0]) * size[0]
    assert found.reference == pytest.approx(np.column_stack([east, north]), abs=1e-6)
    # the way along it is as long as the speed says, to the second difference of a second
    length = np.hypot(*np.diff(found.reference, axis=0).T).sum()
    assert length == pytest.approx(np.trapezoid(found.speed), rel=0.01)


def test_errors_and_tracks_say_the_same_of_the_first_run() -> None:
    found = trials()
    for name, track in found.tracks.items():
        for i, start in enumerate(STARTS):
            gap = track[:, :, i] - found.reference[start : start + STEPS + 1]
            # metres of a radian are taken at the start of the drive, a kilometre away
            distance = np.hypot(gap[:, 0], gap[:, 1])
            assert found.errors[name][:, i, 0] == pytest.approx(distance, rel=2e-3, abs=1e-3)


def test_an_outage_is_the_same_alone() -> None:
    alone = taken(recording(), STARTS[1:])
    for name, error in trials().errors.items():
        assert np.array_equal(alone.errors[name][:, 0], error[:, 1])
    assert np.array_equal(alone.mounting[:, 0], trials().mounting[:, 1])


def changed_after(epoch: int, stream: str, **sizes: float) -> Recording:
    """Return the recording with other data after an epoch, and after a sample that begins there."""
    rng, found = np.random.default_rng(3), getattr(recording(), stream)
    later = found.time[:, None] > epoch + 1e-3
    values = {
        name: getattr(found, name) + size * later * rng.normal(size=(len(found), 3))
        for name, size in sizes.items()
    }
    return replace(recording(), **{stream: replace(found, **values)})


@pytest.mark.parametrize(
    ("stream", "after", "sizes", "same", "steps"),
    [
        # RTK is the reference alone: GPS and compass, emulated from it, may not reach an outage
        ("fixes", 0, {"position": 60.0}, ("never", "until", "through", "hold"), STEPS + 1),
        ("fixes", 0, {"velocity": 3.0}, ("never", "until"), STEPS + 1),  # the compass hangs on it
        ("imu", 0, {"rate": 5.0, "force": 5.0}, (), 0),
        ("imu", 5, {"rate": 5.0, "force": 5.0}, ("never", "until", "through", "hold"), 6),
    ],
)
def test_what_comes_after_is_not_known(
    stream: str, after: int, sizes: dict[str, float], same: tuple[str, ...], steps: int
) -> None:
    """Nor is the mounting of an outage estimated by it."""
    other = taken(changed_after(STARTS[0] + after, stream, **sizes))
    assert np.array_equal(other.mounting[:, 0], trials().mounting[:, 0])
    assert not np.array_equal(other.mounting[:, 1], trials().mounting[:, 1])
    for name, track in trials().tracks.items():
        found, known = other.tracks[name][:, :, 0], track[:, :, 0]
        first = steps if name in same else 0
        assert np.array_equal(found[:first], known[:first]), name
        assert first == len(known) or not np.array_equal(found[first:], known[first:]), name


def test_the_draws_are_those_of_the_seed() -> None:
    again = run_recorded_outages(recording(), beliefs(), STARTS[:1], STEPS, methods, runs=2, seed=5)
    assert not np.array_equal(again.errors["never"][:, 0], trials().errors["never"][:, 0])
    runs = trials().errors["never"]
    assert not np.array_equal(runs[..., 0], runs[..., 1])
