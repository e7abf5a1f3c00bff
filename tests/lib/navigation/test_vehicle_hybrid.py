"""The vehicle's hybrid where the difference is known, and what it may not know."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from typing import Any, ClassVar, Self

import numpy as np
import pytest
from lib.vehicle.made_drive import KNOWN, SENSORS, changed, make_drive, only
from numpy.typing import ArrayLike
from pyins import transform
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.dummy import DummyRegressor
from sklearn.linear_model import LinearRegression

from inswsn_lib.errors import ParameterError
from inswsn_lib.inertial import metres
from inswsn_lib.learning import HoldRegressor, SelectedLSSVM
from inswsn_lib.navigation.vehicle_hybrid import Bridge, Ramps, VehicleHybrid, sensed_motion
from inswsn_lib.simulation import Drive
from inswsn_lib.vehicle import VehicleRun, replay, run_vehicle_filter

START, STEPS = 70, 20
ZERO = DummyRegressor(strategy="constant", constant=[0.0, 0.0])
# what it could have used: 20 s of ramps that are 10 s long
SHORT: dict[str, Any] = {"tau": 10, "window": 20}


@cache
def driven() -> tuple[Drive, VehicleRun]:
    """100 s with three runs, and the second module of each."""
    drive = make_drive(100, 3, seed=21)
    return drive, run_vehicle_filter(drive, KNOWN)


def hybrid(regressor: Any = None, **changes: Any) -> VehicleHybrid:
    return VehicleHybrid(KNOWN, regressor or LinearRegression(), **(SHORT | changes))


def made_ramps(slopes: ArrayLike, offset: ArrayLike = (0.0, 0.0)) -> Ramps:
    """Return ramps of 10 s that grow by lines: slopes (runs, ramps), or with east and north."""
    rates = np.atleast_3d(slopes) * np.ones(2)
    run, number, step = (x.ravel() for x in np.indices((*rates.shape[:2], 10)))
    elapsed, difference = step + 1, np.asarray(offset) + (step[:, None] + 1) * rates[run, number]
    motion = np.random.default_rng(0).normal(size=(len(run), 3))
    return Ramps(10 * number + elapsed, run, 10 * number, elapsed.astype(float), motion, difference)


def line(slope: ArrayLike, offset: ArrayLike) -> Ramps:
    """Return ramps until the start that are alike, of three runs."""
    return made_ramps(np.broadcast_to(slope, (3, START // 10, 2)), offset)


class Spy(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Keeps, in the order of the runs, what clones are trained on; each predicts what is said."""

    seen: ClassVar[list[tuple[np.ndarray, np.ndarray]]] = []

    def __init__(self, says: Any = None) -> None:
        self.says = says

    def fit(self, X: np.ndarray, y: np.ndarray) -> Self:
        self.number_ = len(Spy.seen)
        Spy.seen.append((X, y))
        return self

    def predict(self, X: np.ndarray) -> np.ndarray:
        return np.ones((len(X), 2)) if self.says is None else self.says[:, self.number_]


@pytest.fixture(autouse=True)
def _spy_is_fresh() -> None:
    Spy.seen.clear()


def taken_off(bridge: Bridge) -> np.ndarray:
    """Return what the hybrid took off the first module's positions, east, north, up (m)."""
    first = np.moveaxis(bridge.branch.first, 2, 1)
    found = np.moveaxis(bridge.position, 2, 1)
    return ((first - found) * metres(first))[..., [1, 0, 2]]


# --- what is known ---


@pytest.mark.parametrize(("scaled", "anchored"), [(True, False), (False, False), (True, True)])
def test_a_line_is_learned_and_carried_on(scaled: bool, anchored: bool) -> None:
    """The difference is a line in time: its regressor predicts the outage exactly, to its end.

    Anchored, what the line began with is taken off.
    """
    drive, run = driven()
    machine = hybrid(motion=False, scaled=scaled, anchored=anchored)
    bridge = machine.bridge(drive, run, [START], STEPS, ramps=line([0.5, -2.0], [3.0, 1.0]))
    t = np.arange(STEPS + 1)[:, None, None]
    begun = np.array([0.0, 0.0] if anchored else [3.0, 1.0])
    expected = begun[:, None] + t * np.array([0.5, -2.0])[:, None]
    expected = np.broadcast_to(expected, (STEPS + 1, 2, 3)).copy()
    expected[0] = 0  # the outage has not begun
    assert bridge.predicted == pytest.approx(expected, abs=1e-9)
    off = taken_off(bridge)
    assert off[..., :2] == pytest.approx(np.moveaxis(expected, 2, 1), abs=1e-4)
    assert not off[..., 2].any()  # heights are left as they are
    assert [m.pairs for m in bridge.machines] == [20] * 3


def test_hold_gives_the_last_difference_of_the_run() -> None:
    drive, run = driven()
    ramps = line([0.0, 0.0], [0.0, 0.0])
    known = np.random.default_rng(1).normal(size=ramps.difference.shape)
    ramps = replace(ramps, difference=known)
    bridge = hybrid(HoldRegressor()).bridge(drive, run, [START - 3], STEPS, ramps=ramps)
    for r in range(3):
        last = known[(ramps.run == r) & (ramps.epoch == START - 3)][0]
        assert bridge.predicted[1:, :, r] == pytest.approx(np.tile(last, (STEPS, 1)))


@pytest.mark.parametrize("frame", ["navigation", "body"])
def test_who_predicts_nothing_is_the_filter(frame: Any) -> None:
    """Two starts at once, starts first and runs within them: the branch's own X1, bit for bit."""
    drive, run = driven()
    bridge = hybrid(ZERO, frame=frame, scaled=False).bridge(drive, run, [60, START], STEPS)
    branch = replay(drive, KNOWN, run, [60, START], STEPS, aiding=True)
    assert np.array_equal(bridge.position, branch.first)
    assert np.array_equal(bridge.position[0], np.hstack([run.position[60], run.position[START]]))
    assert np.array_equal(bridge.branch.which, [0, 1, 2, 0, 1, 2])


def test_the_better_branch_is_the_one_with_the_true_difference() -> None:
    """Its own difference from the second module, taken off, gives the second module's position."""
    drive, run = driven()
    branch = replay(drive, KNOWN, run, [START], STEPS, aiding=True)
    second = run.position[START : START + STEPS + 1]
    size = metres(np.moveaxis(second, 2, 1))
    truth = (np.moveaxis(branch.first - second, 2, 1) * size)[..., [1, 0]]

    bridge = hybrid(Spy(truth), scaled=False).bridge(drive, run, [START], STEPS, branch=branch)
    apart = (bridge.position - second) * np.moveaxis(size, 1, 2)
    assert np.abs(apart[:, :2]).max() < 1e-3
    assert np.abs((branch.first - second) * np.moveaxis(size, 1, 2))[-1, :2].max() > 0.1


# --- simulated outages ---


def test_pairs_are_what_a_branch_and_the_run_differ_by() -> None:
    drive, run = driven()
    ramps = hybrid().simulate_outages(drive, run, [START])
    assert sorted(set(ramps.ramp.tolist())) == list(range(0, START, 10))
    assert len(ramps.epoch) == 7 * 10 * 3
    assert np.array_equal(ramps.elapsed, ramps.epoch - ramps.ramp)
    for k in (37, 100, 209):
        begun, which, epoch = ramps.ramp[k], ramps.run[k], ramps.epoch[k]
        alone = replay(drive, KNOWN, run, [begun], 10, aiding=True)
        first, second = alone.first[epoch - begun, :, which], run.position[epoch, :, which]
        north, east = ((first - second) * metres(second))[:2]
        assert ramps.difference[k] == pytest.approx([east, north], abs=1e-6)
        assert ramps.motion[k] == pytest.approx(sensed_motion(drive)[epoch, :, which])


def test_without_aiding_the_first_module_has_none() -> None:
    drive, run = driven()
    sizes = []
    for aiding in (True, False):
        machine = hybrid(ZERO, aiding=aiding, scaled=False)
        ramps = machine.simulate_outages(drive, run, [START])
        sizes.append(np.abs(ramps.difference[ramps.elapsed == 10]).mean())
        branch = machine.bridge(drive, run, [START], STEPS).branch
        assert np.isfinite(branch.innovations[1:, :2]).any() == aiding
    assert sizes[1] > 1.2 * sizes[0]


@pytest.mark.parametrize(
    ("changes", "starts", "begun"),
    [
        ({}, [35], [0, 10, 20, 30]),
        ({}, [40], [0, 10, 20, 30]),
        ({"phase": 4}, [35], [4, 14, 24, 34]),
        ({"tau": 16}, [35], [0, 16, 32]),
        ({"restart": "bank", "spacing": 7}, [35], [0, 7, 14, 21, 28]),
        ({"restart": "bank", "spacing": 7, "phase": 3}, [35], [3, 10, 17, 24, 31]),
        ({"restart": "aligned"}, [35], [25]),
        ({"restart": "aligned"}, [35, 60], [25, 50]),
        ({"restart": "aligned"}, [5, 60], [50]),
    ],
)
def test_when_simulated_outages_begin(
    changes: dict[str, Any], starts: list[int], begun: list[int]
) -> None:
    drive, run = driven()
    ramps = hybrid(**changes).simulate_outages(drive, run, starts)
    assert sorted(set(ramps.ramp.tolist())) == begun
    tau = changes.get("tau", 10)
    for first in begun:
        epochs = ramps.epoch[(ramps.ramp == first) & (ramps.run == 1)]
        assert np.array_equal(epochs, first + np.arange(1, tau + 1))


def test_where_the_run_ends_the_simulated_outage_ends_with_it() -> None:
    drive, machine = driven()[0], hybrid(phase=3)
    run = run_vehicle_filter(drive, KNOWN, last=48)
    ramps = machine.simulate_outages(drive, run, [48])
    lengths = {b: int(np.sum((ramps.ramp == b) & (ramps.run == 0))) for b in np.unique(ramps.ramp)}
    assert lengths == {3: 10, 13: 10, 23: 10, 33: 10, 43: 5}
    assert ramps.epoch.max() == 48
    assert np.array_equal(ramps.epoch - ramps.ramp, ramps.elapsed)
    # as far as it goes it is what it would have been
    longer = machine.simulate_outages(drive, run_vehicle_filter(drive, KNOWN, last=80), [60])
    rows, others = ramps.ramp == 43, (longer.ramp == 43) & (longer.epoch <= 48)
    for name in ("epoch", "run", "elapsed", "motion", "difference"):
        assert np.array_equal(getattr(ramps, name)[rows], getattr(longer, name)[others]), name
    # and it is the first module after compass and constraint, less the second after GPS, east first
    first = replay(drive, KNOWN, run, [43], 5, aiding=True).first[1:]
    second = run.position[44:]
    for r in range(drive.runs):
        degrees = np.array([np.rad2deg(1), np.rad2deg(1), 1.0])
        away = transform.compute_lla_difference(first[..., r] * degrees, second[..., r] * degrees)
        found = ramps.difference[rows & (ramps.run == r)]
        assert found == pytest.approx(away[:, [1, 0]], rel=1e-4, abs=1e-4)


def test_in_body_axes_the_difference_is_turned_by_the_yaw() -> None:
    drive, run = driven()
    plain, turned = (
        hybrid(frame=frame).simulate_outages(drive, run, [START])
        for frame in ("navigation", "body")
    )
    assert drive.reference.attitude is not None
    forward = drive.reference.attitude[plain.epoch][:, :2, 0]
    right = np.column_stack([forward[:, 1], -forward[:, 0]])
    expected = np.column_stack([
        (plain.difference * forward).sum(axis=1), (plain.difference * right).sum(axis=1),
    ])  # fmt: skip
    size = np.linalg.norm(plain.difference, axis=1, keepdims=True)
    # the yaw is the filter's, good to a few tenths of a degree
    assert np.abs(turned.difference - expected).max() < 0.03 * size.max()
    assert np.linalg.norm(turned.difference, axis=1) == pytest.approx(size[:, 0])


def test_body_axes_turn_there_and_back() -> None:
    """3 m forward and 1 m to the right of the car, wherever it heads, is predicted as that."""
    drive, run = driven()
    ramps = line([0.0, 0.0], [3.0, 1.0])
    bridge = hybrid(HoldRegressor(), frame="body").bridge(drive, run, [START], STEPS, ramps=ramps)
    assert drive.reference.attitude is not None
    axes = drive.reference.attitude[START + 1 : START + STEPS + 1]
    forward = axes[:, :2, 0] / np.linalg.norm(axes[:, :2, 0], axis=1, keepdims=True)
    expected = 3 * forward + np.column_stack([forward[:, 1], -forward[:, 0]])
    for r in range(3):
        assert np.abs(bridge.predicted[1:, :, r] - expected).max() < 0.1
    assert np.linalg.norm(bridge.predicted[1:], axis=1) == pytest.approx(np.sqrt(10))
    assert np.ptp(bridge.predicted[1:, 0, 0]) > 1  # the car turned meanwhile


# --- what trains ---


def trained_on(machine: VehicleHybrid, ramps: Ramps, which: int, start: int) -> Ramps:
    """Return the pairs that a machine is trained on, told by numbers that stand for rows."""
    numbers = np.arange(len(ramps.run), dtype=float)
    known = replace(ramps, difference=np.column_stack([numbers, numbers]))
    replace(machine, regressor=Spy(), scaled=False).train(known, which, start)
    rows = Spy.seen[0][1][:, 0].astype(int)
    return Ramps(**{f.name: getattr(ramps, f.name)[rows] for f in fields(Ramps)})


@pytest.mark.parametrize("restart", ["successive", "bank"])
@pytest.mark.parametrize("start", [45, 50])
def test_pairs_of_the_run_and_of_the_window_train(restart: Any, start: int) -> None:
    drive, run = driven()
    machine = hybrid(restart=restart, window=15)
    ramps = machine.simulate_outages(drive, run, [60])
    used = trained_on(machine, ramps, 1, start)
    assert set(used.run) == {1}
    assert set(used.epoch) == set(range(start - 14, start + 1))
    assert (np.diff(used.epoch) >= 0).all()
    if restart == "successive":
        assert len(used.epoch) == 15  # each second once
    else:  # every 5 s a ramp of 10 s
        assert len(used.epoch) == 30


def test_aligned_pairs_are_of_the_ramp_that_ends_at_the_start() -> None:
    drive, run = driven()
    machine = hybrid(restart="aligned", window=8)
    ramps = machine.simulate_outages(drive, run, [48, 50])
    used = trained_on(machine, ramps, 2, 50)
    assert set(used.ramp) == {40}
    assert np.array_equal(used.epoch, np.arange(43, 51))


def test_a_start_named_twice_trains_on_each_pair_once() -> None:
    drive, run = driven()
    bridge = hybrid(restart="aligned").bridge(drive, run, [50, 50], 5)
    assert [m.pairs for m in bridge.machines] == [10] * 6


@pytest.mark.parametrize("restart", ["successive", "aligned", "bank"])
def test_starts_do_not_disturb_each_other(restart: Any) -> None:
    drive, run = driven()
    machine = hybrid(SelectedLSSVM(), restart=restart)
    both, alone = (machine.bridge(drive, run, starts, STEPS) for starts in ([47, START], [47]))
    assert np.array_equal(both.position[:, :, :3], alone.position)


def altered(drive: Drive, since: int) -> Drive:
    """Return the drive with other data in all sensors after an epoch."""
    rng = np.random.default_rng(5)
    values = {}
    for name in SENSORS:
        value = getattr(drive, name).copy()
        first = since * 100 if name in SENSORS[:2] else since + 1
        size = np.abs(value).max() * (1e-6 if "position" in name else 0.3)
        value[first:] += size * rng.normal(size=value[first:].shape)
        values[name] = value
    return changed(drive, **values)


@pytest.mark.parametrize("restart", ["successive", "aligned", "bank"])
def test_nothing_after_the_start_is_known(restart: Any) -> None:
    """All sensors tell something else from 10 s into the outage on: until then all is the same.

    GPS tells something else, or nothing, from the start on: that changes nothing at all.
    """
    drive, run = driven()
    machine = hybrid(SelectedLSSVM(), restart=restart, frame="body")
    found = machine.bridge(drive, run, [START], STEPS)

    other = altered(drive, START + 10)
    again = machine.bridge(other, run_vehicle_filter(other, KNOWN), [START], STEPS)
    assert np.array_equal(found.position[:11], again.position[:11])
    assert not np.array_equal(found.position[11], again.position[11])

    gps = altered(drive, START)
    deaf = changed(drive, gps_position=gps.gps_position, gps_velocity=gps.gps_velocity)
    again = machine.bridge(deaf, run_vehicle_filter(deaf, KNOWN), [START], STEPS)
    assert np.array_equal(found.position, again.position)


@pytest.mark.parametrize("restart", ["successive", "aligned", "bank"])
def test_the_end_of_the_drive_is_not_known(restart: Any) -> None:
    """A drive that ends with the outage trains on what a longer one does: ramps may be cut."""
    drive, run = driven()
    machine = hybrid(SelectedLSSVM(), restart=restart, tau=30, window=40)
    start = 65  # the last simulated outage, from 60 on, would end at 90
    found = machine.bridge(drive, run, [start], STEPS)
    end = start + STEPS
    cut = changed(
        drive, time=drive.time[: end + 1], places=(),
        **{name: getattr(drive, name)[: end * 100] for name in SENSORS[:2]},
        **{name: getattr(drive, name)[: end + 1] for name in SENSORS[2:]},
    )  # fmt: skip
    again = machine.bridge(cut, run_vehicle_filter(cut, KNOWN), [start], STEPS)
    assert [m.pairs for m in again.machines] == [m.pairs for m in found.machines]
    assert np.array_equal(found.position, again.position)


def test_runs_are_what_they_are_alone() -> None:
    drive, run = driven()
    machine = hybrid(SelectedLSSVM())
    found = machine.bridge(drive, run, [START], STEPS)
    alone = only(drive, [0])
    again = machine.bridge(alone, run_vehicle_filter(alone, KNOWN), [START], STEPS)
    assert np.array_equal(found.position[..., :1], again.position)


# --- a regressor that has to prove itself ---


def proving(regressor: Any = None, **options: Any) -> VehicleHybrid:
    """One that learns from the last ramp alone, by its time."""
    values: dict[str, Any] = {"tau": 10, "window": 10, "motion": False, "past": 8}
    return VehicleHybrid(KNOWN, regressor or LinearRegression(), **(values | options))


def test_where_all_ramps_are_alike_the_regressor_is_kept() -> None:
    ramps = made_ramps(np.full((1, 10), 0.7))
    machine = proving().train(ramps, 0, 100)
    assert isinstance(machine.regressor, LinearRegression)
    assert machine.pairs == 10
    assert machine.predict(np.array([[40.0]])) == pytest.approx(np.full((1, 2), 28.0))


TURNS = [1, -1, 1, -1]


@pytest.mark.parametrize(
    ("slopes", "options", "start", "kept"),
    [
        # old ramps that change their sign do not count, new ones do
        (TURNS + 6 * [1], {"past": 5}, 100, True),
        (TURNS + 6 * [1], {"past": 8}, 100, False),
        (6 * [1] + TURNS, {"past": 5}, 100, False),
        # nor what comes after the start, nor a ramp that is under way: of three ramps one of the
        # other sign has four times its square against three
        (8 * [1] + TURNS[::-1], {"past": 3}, 80, True),
        (8 * [1] + TURNS[::-1], {"past": 3}, 89, True),
        (8 * [1] + TURNS[::-1], {"past": 3}, 90, False),
    ],
)
def test_ramps_that_are_over_judge(
    slopes: list[int], options: dict[str, Any], start: int, kept: bool
) -> None:
    machine = proving(**options).train(made_ramps([slopes]), 0, start)
    assert (machine.regressor is not None) == kept


def test_the_first_ramp_of_all_has_nothing_before_it_and_is_not_judged() -> None:
    ramps = made_ramps(np.ones((1, 10)))
    later = replace(ramps, epoch=ramps.epoch + 60, ramp=ramps.ramp + 60)
    assert proving(past=10, phase=60).train(later, 0, 160).regressor is not None


def test_the_best_of_the_rivals_is_taken() -> None:
    wrong = [DummyRegressor(strategy="constant", constant=[c, c]) for c in (-9.0, 50.0)]
    ramps = made_ramps(np.full((1, 10), 0.7))
    machine = proving(wrong[0], rivals=[wrong[1], LinearRegression()]).train(ramps, 0, 100)
    assert isinstance(machine.regressor, LinearRegression)
    assert machine.predict(np.array([[3.0]])) == pytest.approx(np.full((1, 2), 2.1))
    with_none = proving(wrong[0], rivals=wrong, scaled=False).train(ramps, 0, 100)
    assert with_none.regressor is None


def test_a_run_is_judged_by_its_own_ramps() -> None:
    slopes = np.ones((2, 10))
    slopes[1, ::2] = -1
    ramps = made_ramps(slopes)
    assert proving().train(ramps, 0, 100).regressor is not None
    assert proving().train(ramps, 1, 100).regressor is None


def test_a_ramp_is_predicted_from_the_one_before_it() -> None:
    slopes = np.array([[0.5, -2.0, 3.0, 1.0]])
    ramps, line = made_ramps(slopes), np.arange(1.0, 11)[:, None] * [1, 1]
    for number in (1, 2, 3):
        predicted, came = proving().predict_ramp(ramps, 0, 10 * number)
        assert predicted == pytest.approx(slopes[0, number - 1] * line)
        assert came == pytest.approx(slopes[0, number] * line)
    constant = DummyRegressor(strategy="constant", constant=[4.0, 5.0])
    predicted, _ = proving(scaled=False).predict_ramp(ramps, 0, 20, constant)
    assert np.array_equal(predicted, np.tile([4.0, 5.0], (10, 1)))


def test_in_outages_it_says_what_it_was_chosen_to_say() -> None:
    """The whole way: made ramps of one slope, and of changing sign, through `bridge`."""
    drive = only(driven()[0], [0, 1])
    run = run_vehicle_filter(drive, KNOWN, last=80)
    slopes = np.full((2, 8), 0.7)
    slopes[1, ::2] = -0.7
    bridge = proving(past=4).bridge(drive, run, [80], 9, ramps=made_ramps(slopes))
    expected = 0.7 * np.arange(10)[:, None] * [1, 1]
    assert bridge.predicted[:, :, 0] == pytest.approx(expected)
    assert not bridge.predicted[:, :, 1].any()
    assert np.array_equal(bridge.position[..., 1], bridge.branch.first[..., 1])


# --- inputs ---


def test_inputs_are_motion_and_time_as_asked() -> None:
    motion, elapsed = np.arange(12.0).reshape(4, 3), np.arange(4.0)
    assert np.array_equal(hybrid().inputs(motion, elapsed), np.column_stack([motion, elapsed]))
    assert np.array_equal(hybrid(timed=False).inputs(motion, elapsed), motion)
    assert np.array_equal(hybrid(motion=False).inputs(motion, elapsed), elapsed[:, None])


def test_scaled_inputs_have_mean_zero_and_deviation_one() -> None:
    drive, run = driven()
    bridge = hybrid(Spy()).bridge(drive, run, [START], STEPS)
    for values in (part for pair in Spy.seen for part in pair):
        assert values.mean(axis=0) == pytest.approx(0, abs=1e-9)
        assert values.std(axis=0) == pytest.approx(1)
    # a prediction of one deviation comes back in metres
    ramps = hybrid().simulate_outages(drive, run, [START])
    chosen = (ramps.run == 0) & (ramps.epoch > START - 20) & (ramps.epoch <= START)
    y = ramps.difference[chosen]
    assert bridge.predicted[5, :, 0] == pytest.approx(y.mean(axis=0) + y.std(axis=0))


def test_motion_is_what_the_car_does() -> None:
    """Forward and lateral specific force and yaw rate, from the trajectory of the simulator."""
    drive = make_drive(60, 2, seed=3, errors=1e-6)
    true = drive.reference
    assert true.attitude is not None
    found = sensed_motion(drive)
    assert found.shape == (61, 3, 2)
    assert np.array_equal(found[0], found[1])
    forward = true.attitude[:, :, 0]
    speed = (true.velocity * forward).sum(axis=1)
    pitch = np.arcsin(forward[:, 2])
    heading = np.unwrap(np.arctan2(forward[:, 0], forward[:, 1]))
    acceleration = np.diff(speed) + 9.81 * np.sin(0.5 * (pitch[1:] + pitch[:-1]))
    turning = np.diff(heading)
    assert found[1:, 0, 0] == pytest.approx(acceleration, abs=0.02)
    assert found[1:, 2, 1] == pytest.approx(turning, abs=2e-3)
    sideways = turning * 0.5 * (speed[1:] + speed[:-1])
    assert found[1:, 1, 0] == pytest.approx(sideways, abs=0.05)


# --- what cannot be ---


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"tau": 0}, "tau .* not 0"),
        ({"phase": -1}, "phase .* not -1"),
        ({"spacing": 0}, "spacing .* not 0"),
        ({"window": 1}, "window .* not 1"),
        ({"past": -1}, "past .* not -1"),
        ({"past": 3, "anchored": True}, "past .* not 3"),  # no pair at the start of a past ramp
        ({"past": 3, "restart": "aligned"}, "past .* not 3"),  # no ramp before one to learn from
        ({"rivals": ["a line"]}, "regressor .* not 'a line'"),
        ({"restart": "never"}, "restart .* not 'never'"),
        ({"frame": "moon"}, "frame .* not 'moon'"),
        ({"motion": False, "timed": False}, "timed .* not False"),
    ],
)
def test_hybrids_that_cannot_be(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        hybrid(**changes)


@pytest.mark.parametrize(
    ("changes", "starts", "steps"),
    [
        ({}, [0], 5), ({}, [1], 5), ({"phase": 50}, [51], 5), ({"restart": "aligned"}, [9], 5),
        ({}, [101], 0), ({}, [90], 11),
    ],
)  # fmt: skip
def test_an_outage_has_pairs_before_it_and_ends_within_the_drive(
    changes: dict[str, Any], starts: list[int], steps: int
) -> None:
    drive, run = driven()
    with pytest.raises(ParameterError, match="starts must be"):
        hybrid(**changes).bridge(drive, run, starts, steps)
