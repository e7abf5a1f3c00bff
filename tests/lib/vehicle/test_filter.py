"""The vehicle's filter against pyins' own, known errors, and itself in parts."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from lib.kernels.both_ways import both as both_ways
from lib.vehicle.by_pyins import run_by_pyins
from lib.vehicle.made_drive import (
    KNOWN,
    PERIOD,
    SENSORS,
    TURN,
    flown,
    make_drive,
    off,
    on_the_way,
    only,
)
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.evaluation import mean_bounds
from inswsn_lib.inertial import metres
from inswsn_lib.scenario import Setting
from inswsn_lib.simulation import Drive, Place
from inswsn_lib.vehicle import (
    FilterSettings,
    VehicleRun,
    VehicleState,
    align,
    horizontal_error,
    navigation_error,
    position_error,
    replay,
    run_vehicle_filter,
    smooth_outages,
)

GPS = ("gps_position", "gps_velocity")
SAME = 1e-6  # deviations: a run that begins anew has its place in latitude and longitude, rounded


@cache
def eight() -> Drive:
    """A minute with eight runs."""
    return make_drive(60, 8, seed=8)


@cache
def eight_run() -> VehicleRun:
    return run_vehicle_filter(eight(), KNOWN)


def with_values(drive: Drive, values: Any, at: Any, *names: str) -> Drive:
    """Return the drive with other values of some data at some epochs."""
    data = {name: getattr(drive, name).copy() for name in names}
    for each in data.values():
        each[at] = values
    return replace(drive, **data)


def deviations(state: VehicleState) -> np.ndarray:
    """Return those of all states, positions in metres."""
    found = np.sqrt(np.diagonal(state.covariance, axis1=-2, axis2=-1)).copy()
    found[..., :3] *= metres(state.position)
    return found


def normalised(x: np.ndarray, P: np.ndarray) -> float:
    """Return the sum of normalised squares over runs."""
    return float(np.einsum("ri,ri->", x, np.linalg.solve(P, x[..., None])[..., 0]))


def assert_chi_square(total: float, count: int) -> None:
    """Refuse a sum of normalised squares that is true once in 1000 times."""
    low, high = chi2.ppf([5e-4, 1 - 5e-4], count)
    assert low < total < high


# --- the filter against pyins ---


def both(drive: Drive, settings: FilterSettings, aiding: bool = True) -> tuple[Any, Any, Any]:
    """Return what both filters make of a drive, theirs at its epochs, and how far apart (m)."""
    run = run_vehicle_filter(drive, settings, aiding=aiding)
    theirs = run_by_pyins(drive, settings, aiding=aiding, time_step=0.2)
    times = np.arange(len(drive.time) - 1) * 100 * PERIOD  # theirs ends before the last update
    told = {name: theirs[name].loc[times] for name in theirs if name != "innovations"}
    track = told["trajectory"]
    lla = np.column_stack([np.deg2rad(track[["lat", "lon"]]), track.alt])
    states = run.states[:-1, 0]
    return states, told, (states.position - lla) * metres(lla)


@pytest.mark.parametrize("aiding", [False, True])
@pytest.mark.filterwarnings("ignore")  # of pyins
def test_it_is_the_filter_of_pyins(aiding: bool) -> None:
    """Same data, start and noise; error model, tables and loop are theirs.

    pyins estimates the velocity in another frame, so the two differ to second order.
    """
    states, told, apart = both(make_drive(30, 1, seed=4), replace(KNOWN, gate=1e6), aiding)
    own, spread = deviations(states), told["trajectory_sd"]
    assert np.abs(apart / own[:, :3]).max() < 0.02
    velocity = told["trajectory"][["VN", "VE", "VD"]].to_numpy() @ TURN
    assert np.abs((states.velocity - velocity) / own[:, 3:6]).max() < (0.1 if aiding else 0.25)
    close = 0.02 if aiding else 0.08
    for columns, mine, name in (
        (slice(12, 15), states.gyro_drift, "gyro"),
        (slice(9, 12), states.accelerometer_bias, "accel"),
    ):
        assert np.abs((mine - told[name].to_numpy()) / own[:, columns]).max() < 0.2
        assert own[:, columns] == pytest.approx(told[f"{name}_sd"].to_numpy(), rel=close)
    theirs = spread[["north", "east", "down", "VE", "VN", "VD"]].to_numpy()
    assert own[:, :6] == pytest.approx(theirs, rel=close)
    assert np.rad2deg(own[:, 8]) == pytest.approx(spread.heading.to_numpy(), rel=close)


@pytest.mark.filterwarnings("ignore")  # of pyins
def test_from_a_moving_start_it_is_the_filter_of_pyins_within_5_cm() -> None:
    drive = on_the_way(make_drive(40, 1, seed=4), 14)
    assert np.linalg.norm(drive.reference.velocity[0]) > 8
    assert np.linalg.norm(both(drive, KNOWN)[2], axis=1).max() < 0.05


# --- the filter against what is known of the drive ---


def errors_of(states: VehicleState, drive: Drive, epoch: int) -> np.ndarray:
    """Return what all fifteen errors should be, (runs, 15): INS less truth."""
    state, true = states[epoch], drive.reference
    assert true.attitude is not None
    assert true.gyro_bias is not None
    assert true.accelerometer_bias is not None
    D = state.attitude @ true.attitude[epoch].T
    phi = 0.5 * (np.swapaxes(D, 1, 2) - D)[:, [2, 0, 1], [1, 2, 0]]
    return np.hstack([
        state.position - true.position[epoch], state.velocity - true.velocity[epoch], phi,
        true.accelerometer_bias.T - state.accelerometer_bias, true.gyro_bias.T - state.gyro_drift,
    ])  # fmt: skip


def test_errors_and_innovations_are_as_large_as_it_says() -> None:
    """Of 24 runs, without compass: the lateral velocity is no draw. Innovations are white."""
    drive = make_drive(120, 24, seed=11)
    run = run_vehicle_filter(drive, KNOWN, aiding=False)
    for epoch in (20, 60, 120):
        P = run.states.covariance[epoch]
        assert_chi_square(normalised(errors_of(run.states, drive, epoch), P), 15 * 24)
    nu, S = run.innovations[10:, 2:], run.innovation_covariances[10:, 2:, 2:]
    total = sum(normalised(v.T, np.moveaxis(s, 2, 0)) for v, s in zip(nu, S, strict=True))
    assert_chi_square(total, nu.size)


def test_errors_are_given_in_metres_east_north_up() -> None:
    drive = only(eight(), [0])
    run = run_vehicle_filter(drive, KNOWN, last=3)
    true = drive.reference.position[:4]
    moved = (true + np.array([3.0, 4.0, 5.0]) / metres(true))[:, :, None]
    assert position_error(run, drive, moved)[2, :, 0] == pytest.approx([4, 3, 5], abs=1e-6)
    assert horizontal_error(run, drive, moved) == pytest.approx(np.full((4, 1), 5.0), abs=1e-6)
    assert np.array_equal(position_error(run, drive), position_error(run, drive, run.position))


@pytest.mark.parametrize("feedback", [True, False])
def test_errors_of_nine_states_are_told_in_the_models_own_terms(feedback: bool) -> None:
    """In open loop what is kept beside the INS is taken off first."""
    drive = eight()
    run = run_vehicle_filter(drive, KNOWN, feedback=feedback, last=30)
    found = navigation_error(run, drive)
    close = {"rel": 1e-4} if feedback else {"rel": 0.05, "abs": 2e-3}
    for epoch in (5, 30):
        expected = errors_of(run.states.corrected(), drive, epoch)[:, :9]
        told = found[epoch].T
        assert told == pytest.approx(expected, **close)
    recorded = replace(drive, reference=replace(drive.reference, attitude=None))
    with pytest.raises(ParameterError, match=r"one whose attitude is known, not a recording\.$"):
        navigation_error(run, recorded)


def test_the_open_loop_leaves_the_ins_alone() -> None:
    """Its positions are those of pure integration from the start, whatever GPS says."""
    drive, none = only(eight(), [1]), {"aiding": False, "outages": [(0, 21)]}
    opened, deaf = (
        run_vehicle_filter(drive, KNOWN, feedback=False, last=20, **more) for more in ({}, none)
    )
    assert np.array_equal(opened.states.position, deaf.states.position)
    assert np.array_equal(opened.states.attitude, deaf.states.attitude)
    assert opened.states.error.any()
    assert not deaf.states.error.any()


# --- outages, replays, runs ---


@pytest.mark.parametrize(("feedback", "aided"), [(True, True), (False, True), (True, False)])
def test_an_outage_is_a_replay_is_missing_data(feedback: bool, aided: bool) -> None:
    drive, begin, stop = eight(), 31, 46
    more: dict[str, Any] = {"feedback": feedback, "aided_outages": aided}
    run = run_vehicle_filter(drive, KNOWN, **more)
    outage = run_vehicle_filter(drive, KNOWN, outages=[(begin, stop)], **more)
    branch = replay(drive, KNOWN, run, [begin - 1], stop - begin, aiding=aided, feedback=feedback)
    assert off(outage, branch, slice(begin - 1, stop)) < SAME
    assert outage.first[begin:stop] == pytest.approx(branch.first[1:], rel=1e-6, abs=1e-11)
    assert np.array_equal(branch.epochs[:, 0], np.arange(begin - 1, stop))
    missing = np.isnan(outage.innovations[begin:stop])
    assert missing[:, 2:].all()
    assert missing[:, :2].any() != aided
    assert np.isfinite(outage.innovations[[begin - 1, stop]]).all()
    names = GPS if aided else (*GPS, "compass")
    gap = with_values(drive, np.nan, slice(begin, stop), *names)
    # where nothing aids, the lateral velocity is left out, too
    assert (off(outage, run_vehicle_filter(gap, KNOWN, **more)) < SAME) == aided
    assert off(outage, run, stop - 1, stop - 1) > 0.1


def test_a_replay_with_gps_is_the_run_itself() -> None:
    run = eight_run()
    branch = replay(eight(), KNOWN, run, [20], 10, aiding=True, gps=True)
    assert off(run, branch, slice(20, 31)) < SAME
    assert run.innovations[21:31] == pytest.approx(branch.innovations[1:], rel=1e-6, abs=1e-11)


def test_a_replay_with_feedback_begins_by_it() -> None:
    """Of a run in open loop, whose INS is corrected where the replay starts."""
    run = run_vehicle_filter(eight(), KNOWN, feedback=False, last=20)
    branch = replay(eight(), KNOWN, run, [20], 3, aiding=True)
    assert not branch.states.error.any()
    assert np.array_equal(branch.states.attitude[0], run.states[20].corrected().attitude)


def test_branches_are_those_of_their_epochs_and_runs() -> None:
    """(branches, runs): every run of every branch may begin at an epoch of its own."""
    drive, run = eight(), eight_run()
    starts = np.array([[10, 12, 14, 16, 18, 20, 22, 24], [30, 30, 31, 31, 32, 32, 33, 33]])
    branch = replay(drive, KNOWN, run, starts, 5, aiding=True)
    assert np.array_equal(branch.which, np.tile(np.arange(8), 2))
    assert np.array_equal(branch.epochs, starts.ravel() + np.arange(6)[:, None])
    for b in (3, 13):
        alone = replay(drive, KNOWN, run, [starts.ravel()[b]], 5, aiding=True)
        assert off(branch, alone, (slice(None), b), (slice(None), b % 8)) < SAME


def test_a_smoother_that_waits_for_nothing_is_the_filter() -> None:
    """But for the order of corrections. At the end of what it knows it is that in any case."""
    drive, run = eight(), eight_run()
    branch = replay(drive, KNOWN, run, [20], 10, aiding=True)
    for more in ({"lag": 0.0, "after": 5}, {"after": 0}):
        found = smooth_outages(drive, KNOWN, run, [20], 10, **more)
        assert found.shape == branch.position.shape
        apart = position_error(branch, drive, found) - position_error(branch, drive)
        ends = slice(None) if "lag" in more else [0, -1]
        assert np.abs(apart[ends]).max() < 0.05


def test_a_smoother_is_at_the_fixes_after_the_outage() -> None:
    """GPS without noise, from the outage's end on: the way there is known at both ends."""
    drive = make_drive(70, 4, seed=3)
    true = drive.reference
    drive = replace(
        drive,
        gps_position=np.repeat(true.position[:, :, None], 4, axis=2),
        gps_velocity=np.repeat(true.velocity[:, :, None], 4, axis=2),
    )
    told = replace(KNOWN, gps_position=0.01, gps_velocity=0.01, position=0.1)
    run = run_vehicle_filter(drive, told, last=30)
    branch = replay(drive, told, run, [30], 30, aiding=False)
    late = horizontal_error(branch, drive, smooth_outages(drive, told, run, [30], 30, after=5))
    lagged = smooth_outages(drive, told, run, [30], 30, after=5, lag=5.0)
    lag = horizontal_error(branch, drive, lagged)
    assert late[-1].max() < 0.1
    assert horizontal_error(branch, drive)[-1].min() > 10 * late[-1].max()
    # what comes within the lag is known, so that the last epochs are those of the smoother
    assert lag[-1] == pytest.approx(late[-1], abs=0.02)
    assert np.sqrt(np.mean(late**2)) < np.sqrt(np.mean(lag**2))


def test_wheels_hold_the_way_along_the_road() -> None:
    """By the constraint, the compass and its true speed a car knows its way: 0.3 m in 40 s."""
    drive = eight()
    nothing = np.full((61, 3, 8), np.nan)
    wheels = nothing.copy()
    wheels[:, 0] = np.linalg.norm(drive.reference.velocity, axis=1)[:, None]
    ends = []
    for told in (nothing, wheels):
        run = run_vehicle_filter(replace(drive, body_velocity=told), KNOWN, outages=[(20, 61)])
        apart = position_error(run, drive)
        ends.append(np.linalg.norm(apart[60, :2] - apart[20, :2], axis=0))
    assert ends[1].max() < 1.0 < ends[0].mean() / 2
    # what tells nothing changes nothing
    same = run_vehicle_filter(replace(drive, body_velocity=nothing), KNOWN)
    assert off(same, eight_run()) == 0
    assert np.array_equal(same.innovations, eight_run().innovations, equal_nan=True)


def test_a_run_is_what_it_is_alone_and_until_its_end() -> None:
    alone = run_vehicle_filter(only(eight(), [5]), KNOWN, last=25)
    assert len(alone.epochs) == 26
    assert off(eight_run(), alone, (slice(0, 26), 5), (slice(None), 0)) < SAME


def test_the_first_update_is_that_of_compass_and_lateral_velocity() -> None:
    """P3's X1: in an outage there is no other; without aiding it is what was foreseen."""
    drive = eight()
    aided, bare = (
        run_vehicle_filter(drive, KNOWN, outages=[(40, 61)], aided_outages=aids, last=50)
        for aids in (True, False)
    )
    assert np.array_equal(aided.first[40:], aided.position[40:])
    size = metres(aided.states.position)
    moved = (aided.position - aided.first).swapaxes(1, 2)[30:40] * size[30:40]
    assert 0.01 < np.sqrt((moved**2).mean()) < 1
    samples = [x[:, 49] for x in drive.increments]
    apart = [
        np.abs((run.first[50].T - flown(run.states[49], *samples).position) * size[50]).max()
        for run in (aided, bare)
    ]
    assert apart[0] > 1e-4  # m
    assert apart[1] < 1e-6


@pytest.mark.parametrize("feedback", [True, False])
@pytest.mark.parametrize("extra", [(), ("gps", "mounting"), ("mounting", "compass", "gps")])
def test_it_is_the_same_compiled_and_in_numpy(extra: tuple[str, ...], feedback: bool) -> None:
    """With gaps, an outlier and an outage; also branches from epochs of their own."""
    drive, rng = make_drive(12, 3, seed=3), np.random.default_rng(3)
    told = {name: getattr(drive, name).copy() for name in SENSORS[2:]}
    for values in told.values():
        values[1:][rng.random(values[1:].shape) < 0.2] = np.nan
    told["gps_position"][5], told["compass"][7] = np.nan, 1.0
    drive, settings = replace(drive, **told), replace(KNOWN, extra=extra, substeps=3)

    def runs() -> tuple[VehicleRun, VehicleRun]:
        run = run_vehicle_filter(drive, settings, outages=[(8, 10)], feedback=feedback)
        starts = np.array([[1, 2, 3], [4, 4, 0]])
        how = {"aiding": True, "gps": True, "feedback": feedback}
        return run, replay(drive, settings, run, starts, 7, **how)

    for one, two in zip(*both_ways(runs), strict=True):
        assert off(one, two) < SAME
        size = np.sqrt(np.diagonal(two.states.covariance, axis1=2, axis2=3))
        assert np.abs(np.moveaxis(one.first - two.first, 1, 2) / size[..., :3]).max() < SAME
        spread = np.moveaxis(np.diagonal(two.innovation_covariances, axis1=1, axis2=2), 2, 1)
        own = np.sqrt(np.where(spread > 0, spread, 1.0))
        assert one.innovations / own == pytest.approx(two.innovations / own, abs=1e-6, nan_ok=True)
        apart = one.innovation_covariances - two.innovation_covariances
        assert np.abs(apart / (own[:, :, None] * own[:, None])).max() < 1e-8
        assert np.isnan(one.innovations[1:]).any()
        assert np.isfinite(one.innovations).any()


# --- compass and gate, and what is missing ---


def test_the_gate_is_as_wide_as_it_says_and_keeps_an_outlier_out() -> None:
    """An innovation just within is used, just beyond it is as good as missing."""
    drive, epoch = only(eight(), [0]), 40
    run = run_vehicle_filter(drive, KNOWN, last=epoch)
    nu = run.innovations[epoch, 0, 0]
    size = KNOWN.gate * np.sqrt(run.innovation_covariances[epoch, 0, 0, 0])
    within, beyond, missing = (
        run_vehicle_filter(with_values(drive, value, epoch, "compass"), KNOWN, last=epoch)
        for value in (*(drive.compass[epoch] + nu - np.array([[0.999], [1.001]]) * size), np.nan)
    )
    assert np.isfinite(within.innovations[epoch]).all()
    assert np.isnan(beyond.innovations[epoch]).sum() == 1
    assert np.isnan(beyond.innovations[epoch, 0])
    assert off(beyond, missing) < SAME < off(within, missing)


def test_yaw_wraps() -> None:
    """A compass that counts on beyond a whole turn says the same."""
    drive = only(eight(), [0])
    full = replace(drive, compass=drive.compass + 2 * np.pi)
    one, two = (run_vehicle_filter(d, KNOWN) for d in (drive, full))
    assert np.isfinite(two.innovations[1:]).all()
    assert two.position == pytest.approx(one.position, rel=1e-12)


def test_missing_rows_are_left_out_one_by_one() -> None:
    """Latitude alone may be missing; the rest of the fix is used."""
    gap = with_values(eight(), np.nan, (20, 0, 1), "gps_position")
    missing = np.isnan(run_vehicle_filter(gap, KNOWN, last=20).innovations[20])
    assert np.argwhere(missing).tolist() == [[2, 1]]


# --- states beyond P3's fifteen ---


@pytest.mark.parametrize(
    ("name", "of", "degrees"), [("compass", "compass_bias", 4), ("mounting",) * 2 + (3,)]
)
def test_an_error_that_lasts_is_found(name: Any, of: str, degrees: float) -> None:
    """A bias of the compass, or an IMU whose forward axis points to the left of the car's."""
    drive = make_drive(120, 8, seed=9, **{of: np.deg2rad(degrees)})
    settings = replace(KNOWN, extra=(name,), yaw=np.deg2rad(10), gate=20.0)
    end = run_vehicle_filter(drive, settings).states[-1]
    deviation = np.sqrt(end.covariance[:, 15, 15])
    assert (deviation < np.deg2rad(1)).all()
    apart = end.error[:, 15] - np.deg2rad(degrees)
    assert np.abs(apart / deviation).max() < norm.isf(1e-3 / (2 * 8))


def test_the_error_of_gps_stays_as_large_as_it_is() -> None:
    """Of a state that nothing measures: its variance is stationary, what was known fades."""
    settings = replace(KNOWN, extra=("gps",), gps_error=2.5, gps_time=20.0)
    run = run_vehicle_filter(only(eight(), [0]), settings, outages=[(0, 61)])
    block = run.states.covariance[:, 0, 15:, 15:]
    assert block == pytest.approx(np.tile(2.5**2 * np.eye(2), (61, 1, 1)), rel=1e-3, abs=1e-9)
    run.states.error[5, 0, 16] = 1.0
    later = replay(only(eight(), [0]), settings, run, [5], 30, aiding=False).states.error[:, 0, 16]
    assert later == pytest.approx(np.exp(-np.arange(31) / 20), rel=1e-3)


def test_the_start_is_as_good_as_what_it_is_made_of() -> None:
    """Position and yaw are those of GPS and compass, and err by what is common to their data."""
    settings, position = replace(KNOWN, extra=("gps", "compass", "mounting")), np.array([0.5, 0, 9])
    assert [settings.column(name) for name in settings.extra] == [15, 17, 18]
    to_metres = np.diag([*metres(position), *np.ones(16)])
    P = to_metres @ settings.initial_covariance(position[None])[0] @ to_metres
    rows = np.eye(19)  # what is left of an error when what is common is taken off
    rows[0, 16] = rows[1, 15] = rows[8, 17] = rows[8, 18] = -1
    s = settings
    sizes = [
        *np.repeat([s.position, s.velocity], 3), s.tilt, s.tilt, s.yaw,
        *np.repeat([s.accelerometer_bias, s.gyro_drift], 3),
        s.gps_error, s.gps_error, s.compass_bias, s.mounting_yaw,
    ]  # fmt: skip
    assert rows @ P @ rows.T == pytest.approx(np.diag(np.square(sizes)))


# --- the start ---


def test_it_is_aligned_by_weight_and_compass() -> None:
    """Roll 3, pitch -2 degrees, standing: found again from the specific force alone."""
    C = TURN @ Rotation.from_euler("ZYX", [-137, -2, 3], degrees=True).as_matrix()
    drive = make_drive(2, 1)
    dv = np.tile(C.T @ [0, 0, 9.81] * PERIOD, (200, 1))[:, :, None]
    standing = replace(drive, velocity_increments=dv, compass=np.full((3, 1), np.deg2rad(-137.0)))
    begun, run = align(standing, KNOWN), run_vehicle_filter(standing, KNOWN)
    assert begun.attitude[0] == pytest.approx(C, abs=1e-12)
    assert np.array_equal(begun.position[0], drive.gps_position[0, :, 0])
    assert not begun.velocity.any()
    assert not begun.error.any()
    for f in fields(VehicleState):
        assert np.array_equal(getattr(run.states[0], f.name), getattr(begun, f.name))
    assert np.isnan(run.innovations[0]).all()
    assert np.array_equal(run.first[0], begun.position.T)


def test_a_moving_start_is_no_worse_than_it_says() -> None:
    drive = on_the_way(make_drive(30, 200, seed=5), 14)
    begun, true = align(drive, KNOWN), drive.reference.attitude
    assert np.array_equal(begun.velocity, drive.gps_velocity[0].T)
    assert np.allclose(begun.covariance[:, 3:6, 3:6], KNOWN.gps_velocity**2 * np.eye(3))
    assert true is not None
    tilted = Rotation.from_matrix(begun.attitude @ true[0].T).as_rotvec(degrees=True)
    # biases of the accelerometers, 0.05 m/s^2, and noises of GPS velocities, 0.07 m/s^2
    assert np.sqrt(np.mean(tilted[:, :2] ** 2)) < 1.2
    run = run_vehicle_filter(drive, KNOWN, last=1)
    nu, S = run.innovations[1, 5:], run.innovation_covariances[1, 5:, 5:]
    # the fix that is judged has levelled it, too, so that there is less than the filter expects
    nis = normalised(nu.T, np.moveaxis(S, 2, 0)) / 200
    assert 1 < nis < mean_bounds(200, 3, 0.999)[1]


@pytest.mark.parametrize(
    ("name", "epoch", "said"),
    [
        ("gps_position", 0, "one with GPS and compass at epoch 0"),
        ("compass", 0, "one with GPS and compass at epoch 0"),
        ("gps_velocity", 1, "one with GPS velocity at"),
    ],
)
def test_a_start_needs_what_it_is_made_of(name: str, epoch: int, said: str) -> None:
    drive = with_values(on_the_way(make_drive(20, 1), 10), np.nan, epoch, name)
    with pytest.raises(ParameterError, match=f"^drive must be {said}"):
        run_vehicle_filter(drive, KNOWN)


# --- what cannot be ---


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"compass": 0.0}, "compass .* not 0.0"),
        ({"gate": np.inf}, "gate .* not inf"),
        ({"substeps": 0}, "substeps .* not 0"),
        ({"extra": ("wheel",)}, r"extra .* not \('wheel',\)"),
        ({"extra": ("gps", "gps")}, "extra must be"),
        ({"extra": "gps"}, "extra .* not 'gps'"),
    ],
)
def test_settings_that_cannot_be(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        replace(KNOWN, **changes)


def test_settings_are_those_of_a_scenario_and_may_be_replace() -> None:
    values = {f.name: getattr(KNOWN, f.name) for f in fields(KNOWN) if f.name != "extra"}
    told = {f"filter_{name}": x for name, x in (values | {"substeps": 4}).items()}
    del told["filter_gate"]
    made = {
        name: Setting(value=x, unit="1", source="assumed", why="A test.")
        for name, x in (told | {"compass": 9.0}).items()  # the last is of another kind
    }
    found = FilterSettings.from_settings(made, extra=("gps",), lateral=1.0)
    assert found == replace(KNOWN, gate=5.0, substeps=4, extra=("gps",), lateral=1.0)
    del made["filter_compass"]
    with pytest.raises(InswsnError, match="lacks the setting compass"):
        FilterSettings.from_settings(made)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"last": 0}, "last .* not 0"),
        ({"last": 61}, "last .* not 61"),
        ({"outages": [(10, 10)]}, "outages .* not 10"),
        ({"outages": [(-1, 10)]}, "outages .* not -1"),
        ({"outages": [(10, 62)]}, "outages .* not 62"),
        ({"settings": replace(KNOWN, substeps=101)}, "substeps .* not 101"),
        # else the series for the transition would let its variance grow without end
        ({"settings": replace(KNOWN, extra=("gps",), gps_time=0.1)}, r"gps_time .* not 0\.1"),
    ],
)
def test_runs_that_cannot_be(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        run_vehicle_filter(eight(), **({"settings": KNOWN} | arguments))


@pytest.mark.parametrize(
    ("starts", "steps"),
    [([-1], 5), ([26], 5), ([1.5], 5), ([], 5), (3, 5), ([[[3]]], 5), ([[3, 4]], 5), ([3], -1)],
)
def test_replays_that_cannot_be(starts: Any, steps: int) -> None:
    """Also beyond the end of a run that ends before its drive."""
    run = run_vehicle_filter(eight(), KNOWN, last=25)
    with pytest.raises(ParameterError, match=r"st(arts|eps) must be"):
        replay(eight(), KNOWN, run, starts, steps, aiding=True)
    branch = replay(eight(), KNOWN, run, [25], 35, aiding=True)
    assert branch.epochs[-1, 0] == 60
    with pytest.raises(ParameterError, match="starts must be"):
        replay(eight(), KNOWN, run, [25], 36, aiding=True)
    with pytest.raises(ParameterError, match=r"run .* not a replay"):
        replay(eight(), KNOWN, branch, [25], 5, aiding=True)


def test_a_drive_has_arrays_that_fit() -> None:
    drive = eight()
    for name in SENSORS:
        with pytest.raises(ParameterError, match=rf"{name} .* not of shape"):
            replace(drive, **{name: getattr(drive, name)[:-1]})
    for name in SENSORS[:2]:  # an INS has no gaps
        with pytest.raises(ParameterError, match=rf"{name} .* not NaN or infinite"):
            with_values(drive, np.nan, 5, name)
    for values in ({"time": drive.time**1.1}, {"time": drive.time[:1]}, {"period": 0.013}):
        with pytest.raises(ParameterError, match="time must be"):
            replace(drive, **values)
    for start in (-1, 61):
        with pytest.raises(ParameterError, match="places must be"):
            replace(drive, places=(Place("off", start),))
