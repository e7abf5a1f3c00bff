"""The vehicle's filter against pyins' own, one big update, known biases, and itself in parts."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from inswsn_book.evidence.p3_equations import sequential_update
from lib.vehicle.by_pyins import run_by_pyins
from lib.vehicle.made_drive import (
    KNOWN,
    PERIOD,
    SENSORS,
    TURN,
    changed,
    flown,
    make_drive,
    only,
)
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, norm

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.evaluation import mean_bounds
from inswsn_lib.inertial import metres
from inswsn_lib.kernels import PLAIN
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
    smooth_vehicle_run,
)

WIDE = replace(KNOWN, gate=1e6)


@cache
def eight() -> Drive:
    """A minute with eight runs."""
    return make_drive(60, 8, seed=8)


@cache
def eight_run(aiding: bool = True) -> VehicleRun:
    return run_vehicle_filter(eight(), KNOWN, aiding=aiding)


def with_gap(drive: Drive, begin: int, stop: int, names: tuple[str, ...]) -> Drive:
    """Return the drive without some data from an epoch to before another."""
    values = {name: getattr(drive, name).copy() for name in names}
    for value in values.values():
        value[begin:stop] = np.nan
    return changed(drive, **values)


def same(one: VehicleRun, two: VehicleRun, a: Any = slice(None), b: Any = slice(None)) -> bool:
    """Whether two runs are the same to a millionth of a deviation, at some steps and runs of each.

    A run that begins anew from a state has it in latitude and longitude, rounded.
    """
    mine, other = one.states[a], two.states[b]
    size = np.sqrt(np.diagonal(other.covariance, axis1=-2, axis2=-1))
    turned = np.abs(mine.attitude - other.attitude).max()
    spread = (mine.covariance - other.covariance) / (size[..., None] * size[..., None, :])
    apart = np.concatenate(
        [mine.position - other.position, mine.velocity - other.velocity, mine.error - other.error],
        axis=-1,
    ) / size[..., [*range(6), *range(size.shape[-1])]]  # fmt: skip
    biases = [
        getattr(mine, name) - getattr(other, name) for name in ("accelerometer_bias", "gyro_drift")
    ]
    apart = np.concatenate([apart, np.concatenate(biases, axis=-1) / size[..., 9:15]], axis=-1)
    return bool(max(np.abs(apart).max(), np.abs(spread).max(), turned) < 1e-6)


def close(one: np.ndarray, two: np.ndarray) -> bool:
    """Whether positions (rad, rad, m), or innovations, are the same but for rounding."""
    return bool(np.allclose(one, two, rtol=1e-6, atol=1e-11, equal_nan=True))


# --- the update ---


def measured(seed: int) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 6, 6))
    P = root @ np.swapaxes(root, 1, 2) + 0.1 * np.eye(6)
    return (
        rng.normal(size=(3, 6)), P, rng.normal(size=(3, 5)),
        rng.normal(size=(3, 5, 6)), rng.uniform(0.1, 2, 5),
    )  # fmt: skip


def centralised(
    x: np.ndarray, P: np.ndarray, z: np.ndarray, H: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the estimate in the form that inverts covariances: information adds."""
    information = np.linalg.inv(P) + (H.T / R) @ H
    covariance = np.linalg.inv(information)
    return covariance @ (np.linalg.solve(P, x) + (H.T / R) @ z), covariance


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_group_after_group_is_all_at_once(seed: int, first: int) -> None:
    """P3 Section 3.3: for a block-diagonal R the sequence gives the centralised update."""
    x, P, z, H, R = measured(seed)
    used = np.ones((3, 5), dtype=bool)
    xs, Ps = x, P
    for part in (slice(0, first), slice(first, 5)):
        xs, Ps, _, _ = sequential_update(xs, Ps, z[:, part], H[:, part], R[part], used[:, part])
    for r in range(3):
        expected = centralised(x[r], P[r], z[r], H[r], R)
        assert xs[r] == pytest.approx(expected[0], rel=1e-6, abs=1e-6)
        assert Ps[r] == pytest.approx(expected[1], rel=1e-6, abs=1e-6)


@given(st.integers(0, 2**32 - 1))
def test_what_is_not_used_has_no_effect(seed: int) -> None:
    x, P, z, H, R = measured(seed)
    used = np.random.default_rng(seed).random((3, 5)) < 0.5
    spoilt = np.where(used, z, 1e9)
    found = sequential_update(x, P, spoilt, H, R, used)
    for r in range(3):
        rows = used[r]
        expected = centralised(x[r], P[r], z[r][rows], H[r][rows], R[rows])
        assert found[0][r] == pytest.approx(expected[0], rel=1e-6, abs=1e-6)
        assert found[1][r] == pytest.approx(expected[1], rel=1e-6, abs=1e-6)


@given(st.integers(0, 2**32 - 1))
def test_innovation_and_its_covariance_are_those_before_the_update(seed: int) -> None:
    x, P, z, H, R = measured(seed)
    _, _, nu, S = sequential_update(x, P, z, H, R, np.zeros((3, 5), dtype=bool))
    for r in range(3):
        assert nu[r] == pytest.approx(z[r] - H[r] @ x[r])
        assert S[r] == pytest.approx(H[r] @ P[r] @ H[r].T + np.diag(R))


def test_a_scalar_by_hand() -> None:
    """x = 0 with variance 4, a measurement 3 with variance 2: gain 2/3, x = 2, variance 4/3."""
    x, P, nu, S = sequential_update(
        np.zeros((1, 1)), np.full((1, 1, 1), 4.0), np.full((1, 1), 3.0), np.ones((1, 1, 1)),
        np.array([2.0]), np.ones((1, 1), dtype=bool),
    )  # fmt: skip
    found = [float(value.squeeze()) for value in (x, P, nu, S)]
    assert found == pytest.approx([2, 4 / 3, 3, 6])


# --- the filter against pyins ---


@pytest.mark.parametrize("aiding", [False, True])
@pytest.mark.filterwarnings("ignore")  # of pyins
def test_it_is_the_filter_of_pyins(aiding: bool) -> None:
    """Same data, start and noise; error model, tables and loop are theirs.

    pyins estimates the velocity in another frame, so the two differ to second order.
    """
    drive = make_drive(30, 1, seed=4)
    run = run_vehicle_filter(drive, WIDE, aiding=aiding)
    theirs = run_by_pyins(drive, WIDE, aiding=aiding, time_step=0.2)
    times = np.arange(len(drive.time) - 1) * 100 * PERIOD  # theirs ends before the last update
    track, deviations = theirs.trajectory.loc[times], theirs.trajectory_sd.loc[times]
    states = run.states[:-1, 0]
    own = np.sqrt(np.diagonal(states.covariance, axis1=1, axis2=2)).copy()
    own[:, :3] *= metres(states.position)

    lla = np.column_stack([np.deg2rad(track[["lat", "lon"]]), track.alt])
    apart = (states.position - lla) * metres(lla)
    assert np.abs(apart / own[:, :3]).max() < 0.02
    velocity = track[["VN", "VE", "VD"]].to_numpy() @ TURN
    assert np.abs((states.velocity - velocity) / own[:, 3:6]).max() < (0.1 if aiding else 0.25)
    drift, bias = theirs.gyro.loc[times].to_numpy(), theirs.accel.loc[times].to_numpy()
    assert np.abs((states.gyro_drift - drift) / own[:, 12:15]).max() < 0.2
    assert np.abs((states.accelerometer_bias - bias) / own[:, 9:12]).max() < 0.2

    close = 0.02 if aiding else 0.08
    for columns, names in (
        (slice(0, 3), ["north", "east", "down"]),
        (slice(3, 6), ["VE", "VN", "VD"]),
    ):
        assert own[:, columns] == pytest.approx(deviations[names].to_numpy(), rel=close)
    assert np.rad2deg(own[:, 8]) == pytest.approx(deviations.heading.to_numpy(), rel=close)
    assert own[:, 12:15] == pytest.approx(theirs.gyro_sd.loc[times].to_numpy(), rel=close)
    assert own[:, 9:12] == pytest.approx(theirs.accel_sd.loc[times].to_numpy(), rel=close)


# --- the filter against what is known of the drive ---


def errors_of(run: VehicleRun, drive: Drive, epoch: int) -> np.ndarray:
    """Return what all fifteen states should be, (runs, 15): INS less truth."""
    state, true = run.states[epoch], drive.reference
    assert true.attitude is not None
    assert true.gyro_bias is not None
    assert true.accelerometer_bias is not None
    D = state.attitude @ true.attitude[epoch].T
    phi = -0.5 * np.stack(
        [D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], axis=-1
    )
    return np.hstack([
        state.position - true.position[epoch], state.velocity - true.velocity[epoch], phi,
        true.accelerometer_bias.T - state.accelerometer_bias, true.gyro_bias.T - state.gyro_drift,
    ])  # fmt: skip


def normalised(x: np.ndarray, P: np.ndarray) -> np.ndarray:
    return np.einsum("ri,ri->r", x, np.linalg.solve(P, x[..., None])[..., 0])


@cache
def many() -> tuple[Drive, VehicleRun]:
    """Two minutes with 24 runs, without compass: the lateral velocity is no draw."""
    drive = make_drive(120, 24, seed=11)
    return drive, run_vehicle_filter(drive, KNOWN, aiding=False)


@pytest.mark.parametrize("epoch", [20, 60, 120])
def test_its_errors_are_as_large_as_it_says(epoch: int) -> None:
    """The sum of 24 normalised squares of 15 states: outside once in 1000 times an epoch."""
    drive, run = many()
    total = normalised(errors_of(run, drive, epoch), run.states.covariance[epoch]).sum()
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 15 * 24)
    assert low < total < high


def test_the_first_fix_counts_once() -> None:
    """It makes the first state: the position is as good as a fix, not as two."""
    drive, run = many()
    x = errors_of(run, drive, 0)[:, :3] * metres(drive.reference.position[0])
    low, high = chi2.ppf([5e-4, 1 - 5e-4], x.size)
    assert low < ((x / KNOWN.gps_position) ** 2).sum() < high  # so it is drawn
    for epoch in (0, 1, 2):
        P = run.states.covariance[epoch][:, :3, :3]
        total = normalised(errors_of(run, drive, epoch)[:, :3], P).sum()
        assert low < total < high


def test_its_innovations_are_as_large_as_it_says() -> None:
    """GPS, epochs 10 to 120: white by theory, so their squares add; wrong once in 1000 times."""
    _, run = many()
    nu = run.innovations[10:, 2:]
    S = run.innovation_covariances[10:, 2:, 2:]
    squares = np.array([
        normalised(nu[k].T, np.moveaxis(S[k], 2, 0)) for k in range(len(nu))
    ])  # fmt: skip
    low, high = chi2.ppf([5e-4, 1 - 5e-4], squares.size * 6)
    assert low < squares.sum() < high


def test_errors_are_given_in_metres_east_north_up() -> None:
    drive = only(eight(), [0])
    run = run_vehicle_filter(drive, KNOWN, last=3)
    true = drive.reference.position[:4, :, None]
    size = metres(drive.reference.position[:4])[:, [1, 0, 2]]
    moved = true + np.array([3 / size[:, 1], 4 / size[:, 0], 5 / size[:, 2]]).T[:, :, None]
    assert position_error(run, drive, moved)[:, :, 0] == pytest.approx(
        np.tile([4.0, 3.0, 5.0], (4, 1)), abs=1e-6
    )
    assert horizontal_error(run, drive, moved) == pytest.approx(np.full((4, 1), 5.0), abs=1e-6)
    own = position_error(run, drive)
    assert own == pytest.approx(position_error(run, drive, run.position))


def test_errors_of_nine_states_are_told_in_the_models_own_terms() -> None:
    """Closed loop as above; in open loop what is kept beside the INS is taken off first."""
    drive = eight()
    for feedback in (True, False):
        run = run_vehicle_filter(drive, KNOWN, feedback=feedback, last=30)
        corrected = replace(run, states=run.states.corrected())
        found = navigation_error(run, drive)
        assert found.shape == (31, 9, 8)
        close = {"rel": 1e-4} if feedback else {"rel": 0.05, "abs": 2e-3}
        for epoch in (5, 30):
            expected = errors_of(corrected, drive, epoch)[:, :9]
            told = found[epoch].T
            assert told == pytest.approx(expected, **close)
    recorded = changed(drive, reference=replace(drive.reference, attitude=None))
    with pytest.raises(ParameterError, match=r"one whose attitude is known, not a recording\.$"):
        navigation_error(run, recorded)


# --- feedback ---


def test_closed_loop_and_open_loop_agree_while_errors_are_small() -> None:
    """With a thousandth of the sensors' errors the second order vanishes, and only that differs."""
    drive = make_drive(20, 2, seed=6, errors=1e-3)
    settings = replace(
        KNOWN, yaw=np.deg2rad(0.2), tilt=np.deg2rad(0.2), accelerometer_bias=5e-5,
        gyro_drift=2e-6, accelerometer_noise=1e-5, gyro_noise=1e-6,
    )  # fmt: skip
    closed, opened = (
        run_vehicle_filter(drive, settings, feedback=feedback) for feedback in (True, False)
    )
    assert not closed.states.error.any()
    assert opened.states.error.any()
    apart = (closed.position - opened.position) * metres(
        np.moveaxis(closed.position, 1, 2)
    ).swapaxes(1, 2)
    deviation = np.sqrt(np.diagonal(closed.states.covariance, axis1=2, axis2=3))
    size = metres(closed.states.position)
    assert np.abs(apart / np.moveaxis(deviation[..., :3] * size, 2, 1)).max() < 0.02
    slow = (closed.velocity - opened.velocity) / np.moveaxis(deviation[..., 3:6], 2, 1)
    assert np.abs(slow).max() < 0.02
    # what open loop keeps beside the INS is what closed loop has taken off it
    both = opened.states[-1].corrected()
    assert both.attitude == pytest.approx(closed.states.attitude[-1], abs=2e-5)
    assert both.gyro_drift == pytest.approx(closed.states.gyro_drift[-1], abs=2e-7)


def test_the_open_loop_leaves_the_ins_alone() -> None:
    """Its positions are those of pure integration from the start, whatever GPS says."""
    drive = only(eight(), [1])
    opened = run_vehicle_filter(drive, KNOWN, feedback=False, last=20)
    deaf = run_vehicle_filter(
        drive, KNOWN, feedback=False, last=20, aiding=False, outages=[(0, 21)]
    )
    assert np.array_equal(opened.states.position, deaf.states.position)
    assert np.array_equal(opened.states.attitude, deaf.states.attitude)
    assert not deaf.states.error.any()


# --- outages, replays, runs ---


@pytest.mark.parametrize("feedback", [True, False])
def test_an_outage_is_missing_data_is_a_replay(feedback: bool) -> None:
    drive, begin, stop = eight(), 31, 46
    run = run_vehicle_filter(drive, KNOWN, feedback=feedback)
    outage = run_vehicle_filter(drive, KNOWN, feedback=feedback, outages=[(begin, stop)])
    missing = run_vehicle_filter(
        with_gap(drive, begin, stop, ("gps_position", "gps_velocity")), KNOWN, feedback=feedback
    )
    assert same(outage, missing)
    assert np.array_equal(outage.first, missing.first)
    assert np.array_equal(outage.innovations, missing.innovations, equal_nan=True)
    branch = replay(drive, KNOWN, run, [begin - 1], stop - begin, aiding=True, feedback=feedback)
    assert same(outage, branch, slice(begin - 1, stop))
    assert close(outage.first[begin:stop], branch.first[1:])
    assert np.array_equal(branch.epochs[:, 0], np.arange(begin - 1, stop))
    # and it is an outage: the positions go another way than with GPS
    assert not np.allclose(run.position[stop - 1], outage.position[stop - 1], atol=1e-9, rtol=0)
    assert np.isnan(outage.innovations[begin:stop, 2:]).all()
    assert np.isfinite(outage.innovations[[begin - 1, stop], 2:]).all()


def test_an_outage_may_be_without_aiding() -> None:
    drive, begin, stop = eight(), 31, 46
    bare = run_vehicle_filter(drive, KNOWN, outages=[(begin, stop)], aided_outages=False)
    missing = with_gap(drive, begin, stop, ("gps_position", "gps_velocity", "compass"))
    aided = run_vehicle_filter(missing, KNOWN)
    assert same(bare, aided, slice(0, begin), slice(0, begin))
    assert not same(bare, aided, begin, begin)  # the lateral velocity is left out, too
    assert np.isnan(bare.innovations[begin:stop]).all()
    assert np.isfinite(bare.innovations[begin - 1]).all()
    branch = replay(drive, KNOWN, eight_run(), [begin - 1], stop - begin, aiding=False)
    assert same(bare, branch, slice(begin - 1, stop))


def test_a_replay_with_gps_is_the_run_itself() -> None:
    run = eight_run()
    branch = replay(eight(), KNOWN, run, [20], 10, aiding=True, gps=True)
    assert same(run, branch, slice(20, 31))
    assert close(run.innovations[21:31], branch.innovations[1:])


def test_a_replay_with_feedback_begins_by_it() -> None:
    """Of a run in open loop, whose INS is corrected where the replay starts."""
    run = run_vehicle_filter(eight(), KNOWN, feedback=False)
    branch = replay(eight(), KNOWN, run, [20], 3, aiding=True)
    corrected = run.states[20].corrected()
    assert not branch.states.error.any()
    assert np.array_equal(branch.states.position[0], corrected.position)
    assert np.array_equal(branch.states.attitude[0], corrected.attitude)


def test_branches_are_those_of_their_epochs_and_runs() -> None:
    """(branches, runs): every run of every branch may begin at an epoch of its own."""
    drive, run = eight(), eight_run()
    starts = np.array([[10, 12, 14, 16, 18, 20, 22, 24], [30, 30, 31, 31, 32, 32, 33, 33]])
    branch = replay(drive, KNOWN, run, starts, 5, aiding=True)
    assert np.array_equal(branch.which, np.tile(np.arange(8), 2))
    assert np.array_equal(branch.epochs, starts.ravel() + np.arange(6)[:, None])
    for b in (3, 13):
        alone = replay(drive, KNOWN, run, [starts.ravel()[b]], 5, aiding=True)
        assert same(branch, alone, (slice(None), b), (slice(None), b % 8))


@pytest.mark.parametrize("which", [0, 5])
def test_a_run_is_what_it_is_alone(which: int) -> None:
    alone = run_vehicle_filter(only(eight(), [which]), KNOWN)
    assert same(eight_run(), alone, (slice(None), which), (slice(None), 0))


def test_it_may_end_early() -> None:
    drive = eight()
    short = run_vehicle_filter(drive, KNOWN, last=25)
    assert len(short.epochs) == 26
    assert same(eight_run(), short, slice(0, 26))


@pytest.mark.parametrize("plain", ["", "1"])
def test_the_first_update_is_that_of_compass_and_lateral_velocity(
    plain: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """P3's X1: in an outage there is no other; without aiding it is what was foreseen.

    But for what it is foreseen by: steps of the Earth in a level frame, or of a sample on it.
    """
    monkeypatch.setenv(PLAIN, plain)
    drive = eight()
    outage = run_vehicle_filter(drive, KNOWN, outages=[(40, 61)])
    assert np.array_equal(outage.first[40:], outage.position[40:])
    assert not np.array_equal(outage.first[39], outage.position[39])
    # what GPS moves after it is its gain, from the covariance after it, on what is left of it
    run = eight_run()
    size = metres(run.states.position)
    moved = np.moveaxis((run.position - run.first) * size.swapaxes(1, 2), 1, 2)[30:]
    assert 0.01 < np.sqrt((moved**2).mean()) < 1
    deaf = run_vehicle_filter(drive, KNOWN, outages=[(40, 61)], aided_outages=False)
    increments = [x[:, 49] for x in drive.increments]
    foreseen = flown(deaf.states[49], *increments).position
    apart = np.abs((deaf.first[50].T - foreseen) * size[50]).max()
    assert apart < 1e-6  # m
    aided = flown(outage.states[49], *increments).position
    assert np.abs((outage.first[50].T - aided) * size[50]).max() > 1e-4


# --- compass and gate ---


def test_without_aiding_the_compass_is_not_heard() -> None:
    """But for epoch 0, from which the yaw is taken."""
    drive = eight()
    compass = drive.compass.copy()
    compass[1:] = 1.0
    deaf = run_vehicle_filter(changed(drive, compass=compass), KNOWN, aiding=False)
    assert same(eight_run(False), deaf)
    assert np.isnan(deaf.innovations[:, :2]).all()


def test_the_gate_keeps_an_outlier_out() -> None:
    drive, epoch = eight(), 30
    compass = drive.compass.copy()
    compass[epoch, 2] += 0.5
    run = run_vehicle_filter(changed(drive, compass=compass), KNOWN)
    compass = compass.copy()
    compass[epoch, 2] = np.nan
    missing = run_vehicle_filter(changed(drive, compass=compass), KNOWN)
    assert same(run, missing)
    assert np.isnan(run.innovations[epoch, 0, 2])
    assert np.isfinite(run.innovations[epoch, 1, 2])  # the lateral velocity is still heard
    assert np.isfinite(np.delete(run.innovations[epoch], 2, axis=1)).all()


def test_the_gate_is_as_wide_as_it_says() -> None:
    """An innovation just within is used, just beyond it is not."""
    drive, epoch = only(eight(), [0]), 40
    run = run_vehicle_filter(drive, KNOWN, last=epoch)
    nu = run.innovations[epoch, 0, 0]
    deviation = np.sqrt(run.innovation_covariances[epoch, 0, 0, 0])
    for share, used in ((0.999, True), (1.001, False)):
        compass = drive.compass.copy()
        compass[epoch] += nu - share * KNOWN.gate * deviation
        found = run_vehicle_filter(changed(drive, compass=compass), KNOWN, last=epoch)
        assert np.isfinite(found.innovations[epoch, 0, 0]) == used


def test_yaw_wraps() -> None:
    """A compass that counts on beyond a whole turn says the same."""
    drive = only(eight(), [0])
    full = changed(drive, compass=drive.compass + 2 * np.pi)
    one, two = (run_vehicle_filter(d, KNOWN) for d in (drive, full))
    assert np.isfinite(two.innovations[1:]).all()
    assert two.position == pytest.approx(one.position, rel=1e-12)


def test_missing_rows_are_left_out_one_by_one() -> None:
    """Height alone may be missing; the rest of the fix is used."""
    drive = eight()
    position = drive.gps_position.copy()
    position[20, 2, 1] = np.nan
    run = run_vehicle_filter(changed(drive, gps_position=position), KNOWN, last=20)
    used = np.isfinite(run.innovations[20])
    assert not used[4, 1]
    assert used.sum() == used.size - 1


# --- states beyond P3's fifteen ---


@pytest.mark.parametrize(
    ("name", "of", "degrees"), [("compass", "compass_bias", 4), ("mounting",) * 2 + (3,)]
)
def test_an_error_that_lasts_is_found(name: Any, of: str, degrees: float) -> None:
    """A bias of the compass, or an IMU whose forward axis points to the left of the car's."""
    drive = make_drive(120, 8, seed=9, **{of: np.deg2rad(degrees)})
    settings = replace(KNOWN, extra=(name,), yaw=np.deg2rad(10), gate=20.0)
    run = run_vehicle_filter(drive, settings)
    deviation = np.sqrt(run.states.covariance[-1, :, 15, 15])
    assert (deviation < np.deg2rad(1)).all()
    off = run.states.error[-1, :, 15] - np.deg2rad(degrees)
    assert np.abs(off / deviation).max() < norm.isf(1e-3 / (2 * 8))
    # and the car does not slide sideways for it, as it does for a filter that does not know
    blind = run_vehicle_filter(drive, replace(KNOWN, gate=20.0))
    yaws = [r.states.attitude[60:, :, 1, 0] for r in (run, blind)]
    assert drive.reference.attitude is not None
    true = drive.reference.attitude[60:, None, 1, 0]
    sizes = [np.sqrt(((yaw - true) ** 2).mean()) for yaw in yaws]
    assert name == "mounting" or sizes[0] < sizes[1] / 2


def test_the_error_of_gps_stays_as_large_as_it_is() -> None:
    """Of a state that nothing measures: its variance is stationary, east and north alike."""
    drive = only(eight(), [0])
    settings = replace(KNOWN, extra=("gps",), gps_error=2.5, gps_time=20.0)
    run = run_vehicle_filter(drive, settings, outages=[(0, 61)])
    block = run.states.covariance[:, 0, 15:, 15:]
    assert block == pytest.approx(np.tile(2.5**2 * np.eye(2), (61, 1, 1)), rel=1e-3, abs=1e-9)
    # what was once known of it fades with its correlation time
    first = run.states[5]
    known = first.covariance.copy()
    known[:, 15, 15] = 0.01
    state = replace(first, covariance=known, error=first.error + np.eye(17)[16])
    begun = replace(run, states=replace(
        run.states,
        covariance=np.where(np.arange(61)[:, None, None, None] == 5, known, run.states.covariance),
        error=np.where(np.arange(61)[:, None, None] == 5, state.error, run.states.error),
    ))  # fmt: skip
    later = replay(drive, settings, begun, [5], 30, aiding=False)
    t = np.arange(31)
    expected = 2.5**2 + (0.01 - 2.5**2) * np.exp(-2 * t / 20)
    assert later.states.covariance[:, 0, 15, 15] == pytest.approx(expected, rel=1e-3)
    assert later.states.error[:, 0, 16] == pytest.approx(np.exp(-t / 20), rel=1e-3)


def test_an_error_of_gps_that_lasts_is_told_from_white_noise() -> None:
    """With the state the filter trusts GPS less, and says how much is common to its fixes."""
    drive = make_drive(60, 4, seed=12)
    wander = 5.0 / metres(drive.reference.position)[:, 1]
    moved = drive.gps_position.copy()
    moved[:, 1] += wander[:, None]  # 5 m east, always
    drive = changed(drive, gps_position=moved)
    known = replace(KNOWN, extra=("gps",), gps_error=5.0, gps_time=600.0)
    with_state, without = (run_vehicle_filter(drive, s) for s in (known, KNOWN))
    error = position_error(with_state, drive)[-1, 0]
    size = metres(with_state.states.position[-1])[:, 1]
    said = [np.sqrt(r.states.covariance[-1, :, 1, 1]) * size for r in (with_state, without)]
    assert (np.abs(error) / said[0] < norm.isf(1e-3 / 8)).all()
    assert (said[1] < 2).all()
    assert (said[0] > 3).all()
    both = with_state.states.covariance[-1, :, 1, 15] * size
    assert (both / (said[0] * np.sqrt(with_state.states.covariance[-1, :, 15, 15])) > 0.7).all()


def test_extra_states_stand_in_the_order_of_their_names() -> None:
    settings = replace(KNOWN, extra=("gps", "compass", "mounting"))
    assert settings.states == 19
    assert [settings.column(n) for n in settings.extra] == [15, 17, 18]
    P = settings.initial_covariance(np.array([[0.5, 0.1, 10.0]]))
    sizes = [settings.gps_error] * 2 + [settings.compass_bias, settings.mounting_yaw]
    assert np.sqrt(np.diagonal(P[0]))[15:] == pytest.approx(sizes)


def test_errors_that_last_are_of_a_size_of_their_own() -> None:
    """Unless told: a compass off by 5 degrees, an IMU by 3, GPS by 3 m for a minute."""
    told = np.degrees([KNOWN.compass_bias, KNOWN.mounting_yaw])
    assert told == pytest.approx([5, 3], rel=1e-2)
    assert (KNOWN.gps_error, KNOWN.gps_time, KNOWN.gate, KNOWN.substeps) == (3, 60, 5, 5)


def test_the_start_is_as_good_as_what_it_is_made_of() -> None:
    """Position and yaw are those of GPS and compass, and err by what is common to their data."""
    position = np.array([[0.5, 0.1, 10.0]])
    plain = KNOWN.initial_covariance(position)[0]
    north, east, up = np.sqrt(np.diagonal(plain))[:3] * metres(position)[0]
    assert [north, east, up] == pytest.approx([KNOWN.position] * 3)
    assert np.array_equal(plain, np.diag(np.diagonal(plain)))

    settings = replace(KNOWN, extra=("gps", "compass", "mounting"))
    P = settings.initial_covariance(position)[0]
    size = metres(position)[0]
    to_metres = np.diag(np.concatenate([size, np.ones(16)]))
    P = to_metres @ P @ to_metres
    rows = np.zeros((3, 19))  # what is left of an error when what is common is taken off
    rows[0, [1, 15]], rows[1, [0, 16]], rows[2, [8, 17, 18]] = [1, -1], [1, -1], [1, -1, -1]
    expected = np.diag([KNOWN.position**2, KNOWN.position**2, KNOWN.yaw**2])
    assert rows @ P @ rows.T == pytest.approx(expected)
    assert P[1, 1] == pytest.approx(KNOWN.position**2 + settings.gps_error**2)
    yaws = KNOWN.yaw**2 + settings.compass_bias**2 + settings.mounting_yaw**2
    assert P[8, 8] == pytest.approx(yaws)


# --- the smoother ---


def test_the_smoother_ends_where_the_filter_does() -> None:
    """And is surer before that, the more so in an outage."""
    settings = replace(KNOWN, extra=("gps", "compass"))
    smoothed = smooth_vehicle_run(eight(), settings, 3, outages=[(30, 50)])
    run = run_vehicle_filter(eight(), settings, outages=[(30, 50)])
    ends = [x[-1] for x in (smoothed, run.states[:, 3])]
    deviations = [np.sqrt(np.diagonal(x.covariance)) for x in ends]
    assert deviations[0] == pytest.approx(deviations[1], rel=0.05)
    assert np.abs((ends[0].position - ends[1].position) / deviations[1][:3]).max() < 0.05
    spread = [
        np.diagonal(x, axis1=1, axis2=2)
        for x in (smoothed.covariance, run.states[1:, 3].covariance)
    ]
    assert (spread[0][:-1] <= spread[1][:-1] * (1 + 1e-3)).all()
    assert (spread[0][48, :2] < 0.6 * spread[1][48, :2]).all()


def test_the_smoothers_errors_are_as_large_as_it_says() -> None:
    """Three epochs far from each other of eight runs, three components: once in 1000 times."""
    drive, total = make_drive(120, 8, seed=11), []
    for r in range(8):
        states = smooth_vehicle_run(drive, KNOWN, r, aiding=False)
        for k in (30, 60, 90):
            apart = states.position[k - 1] - drive.reference.position[k]
            P = states.covariance[k - 1, :3, :3]
            total.append(apart @ np.linalg.solve(P, apart))
    low, high = chi2.ppf([5e-4, 1 - 5e-4], 3 * 24)
    assert low < np.sum(total) < high


# --- the start ---


def test_it_is_aligned_by_weight_and_compass() -> None:
    """Roll 3, pitch -2 degrees, standing: found again from the specific force alone."""
    C = TURN @ Rotation.from_euler("ZYX", [-137, -2, 3], degrees=True).as_matrix()
    force = C.T @ [0, 0, 9.81]
    drive = make_drive(2, 1)
    dv = np.tile(force * PERIOD, (200, 1))[:, :, None]
    standing = changed(drive, velocity_increments=dv, compass=np.full((3, 1), np.deg2rad(-137.0)))
    begun = align(standing, KNOWN)
    assert begun.attitude[0] == pytest.approx(C, abs=1e-12)
    assert np.array_equal(begun.position[0], drive.gps_position[0, :, 0])
    assert not begun.velocity.any()
    assert not begun.error.any()
    run = run_vehicle_filter(standing, KNOWN)
    assert all(
        np.array_equal(getattr(run.states[0], f.name), getattr(begun, f.name))
        for f in fields(VehicleState)
    )
    assert np.isnan(run.innovations[0]).all()
    assert np.array_equal(run.first[0], begun.position.T)


def on_the_way(drive: Drive, epoch: int) -> Drive:
    """Return the drive from an epoch on, when the car moves."""
    first, reference = epoch * drive.samples_per_epoch, drive.reference
    assert reference.attitude is not None
    later = replace(
        reference, position=reference.position[epoch:], velocity=reference.velocity[epoch:],
        attitude=reference.attitude[epoch:],
    )  # fmt: skip
    samples = {n: getattr(drive, n)[first:] for n in SENSORS[:2]}
    epochs = {n: getattr(drive, n)[epoch:] for n in SENSORS[2:]}
    time = drive.time[: len(drive.time) - epoch]
    return replace(drive, time=time, reference=later, places=(), **samples, **epochs)


@pytest.mark.filterwarnings("ignore")  # of pyins
def test_from_a_moving_start_it_is_the_filter_of_pyins_within_5_cm() -> None:
    drive = on_the_way(make_drive(40, 1, seed=4), 14)
    assert np.linalg.norm(drive.reference.velocity[0]) > 8
    run = run_vehicle_filter(drive, KNOWN)
    theirs = run_by_pyins(drive, KNOWN, aiding=True, time_step=0.2)
    times = np.arange(len(drive.time) - 1) * 100 * PERIOD
    track = theirs.trajectory.loc[times]
    lla = np.column_stack([np.deg2rad(track[["lat", "lon"]]), track.alt])
    apart = (run.states.position[:-1, 0] - lla) * metres(lla)
    assert np.linalg.norm(apart, axis=1).max() < 0.05


def test_a_moving_start_is_no_worse_than_it_says() -> None:
    drive = on_the_way(make_drive(30, 200, seed=5), 14)
    begun = align(drive, KNOWN)
    assert np.array_equal(begun.velocity, drive.gps_velocity[0].T)
    true = drive.reference
    assert true.attitude is not None
    tilted = Rotation.from_matrix(begun.attitude @ true.attitude[0].T).as_rotvec(degrees=True)
    # biases of the accelerometers, 0.05 m/s^2, and noises of GPS velocities, 0.07 m/s^2
    assert np.sqrt(np.mean(tilted[:, :2] ** 2)) < 1.2
    run = run_vehicle_filter(drive, KNOWN)
    nu, S = run.innovations[1, 5:], run.innovation_covariances[1, 5:, 5:]
    nis = np.einsum("ir,ri->r", nu, np.linalg.solve(np.moveaxis(S, 2, 0), nu.T[..., None])[..., 0])
    # the fix that is judged has levelled it, too, so that there is less than the filter expects
    assert 1 < nis.mean() < mean_bounds(200, 3, 0.999)[1]


def test_a_moving_start_without_its_velocity_is_told() -> None:
    drive = on_the_way(make_drive(20, 1), 10)
    deaf = drive.gps_velocity.copy()
    deaf[1] = np.nan
    with pytest.raises(ParameterError, match=r"^drive must be one with GPS velocity at"):
        align(replace(drive, gps_velocity=deaf), KNOWN)


# --- what cannot be ---


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"compass": 0.0}, "compass .* not 0.0"),
        ({"gate": np.inf}, "gate .* not inf"),
        ({"gps_time": -1.0}, "gps_time .* not -1.0"),
        ({"substeps": 0}, "substeps .* not 0"),
        ({"extra": ("wheel",)}, r"extra .* not \('wheel',\)"),
        ({"extra": ("gps", "gps")}, "extra must be"),
        ({"extra": "gps"}, "extra .* not 'gps'"),
    ],
)
def test_settings_that_cannot_be(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        replace(KNOWN, **changes)


def test_settings_are_those_of_a_scenario_and_may_be_changed() -> None:
    values = {f.name: getattr(KNOWN, f.name) for f in fields(KNOWN) if f.name != "extra"}
    made = {
        f"filter_{name}": Setting(value=value, unit="1", source="assumed", why="A test.")
        for name, value in (values | {"gate": 7.0, "substeps": 4}).items()
    } | {"compass": Setting(value=9.0, unit="1", source="assumed", why="Of another kind.")}
    found = FilterSettings.from_settings(made, extra=("gps",), lateral=1.0)
    assert found == replace(KNOWN, gate=7.0, substeps=4, extra=("gps",), lateral=1.0)
    del made["filter_gate"], made["filter_gps_time"]
    defaults = FilterSettings.from_settings(made)
    assert (defaults.gate, defaults.gps_time, defaults.extra) == (5.0, 60.0, ())
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


def test_the_shortest_run_and_the_shortest_drive() -> None:
    run = run_vehicle_filter(make_drive(1), KNOWN, last=1)
    assert run.epochs[:, 0].tolist() == [0, 1]
    with pytest.raises(ParameterError, match="time must be at least two epochs long, not 1"):
        changed(make_drive(1), time=np.zeros(1))


@pytest.mark.parametrize(
    ("starts", "steps"),
    [
        ([-1], 5), ([61], 0), ([56], 5), ([1.5], 5), ([], 5), (3, 5), ([[[3]]], 5),
        ([True], 5), ([[3, 4]], 5), ([3], -1),
    ],
)  # fmt: skip
def test_replays_that_cannot_be(starts: Any, steps: int) -> None:
    with pytest.raises(ParameterError, match=r"st(arts|eps) must be"):
        replay(eight(), KNOWN, eight_run(), starts, steps, aiding=True)


def test_a_replay_begins_within_its_run() -> None:
    short = run_vehicle_filter(eight(), KNOWN, last=25)
    with pytest.raises(ParameterError, match="starts must be"):
        replay(eight(), KNOWN, short, [26], 5, aiding=True)
    branch = replay(eight(), KNOWN, short, [25], 35, aiding=True)
    assert branch.epochs[-1, 0] == 60
    with pytest.raises(ParameterError, match=r"run .* not a replay"):
        replay(eight(), KNOWN, branch, [25], 5, aiding=True)


def test_the_covariance_does_not_hang_on_the_steps() -> None:
    """Uneven steps too, 100 samples in 7: against a step a sample the error is of second order."""
    drive = only(eight(), [0])
    sizes = []
    for substeps in (100, 7, 5, 1):
        settings = replace(KNOWN, substeps=substeps)
        run = run_vehicle_filter(drive, settings, aiding=False, outages=[(30, 60)])
        sizes.append(np.sqrt(np.diagonal(run.states.covariance[59, 0])))
    assert sizes[1] == pytest.approx(sizes[0], rel=1e-3)
    assert sizes[2] == pytest.approx(sizes[0], rel=1e-3)
    assert sizes[3] == pytest.approx(sizes[0], rel=5e-3)  # taken at its beginning: 4 %


@pytest.mark.parametrize("name", ["gps_position", "compass"])
def test_a_start_needs_gps_and_compass(name: str) -> None:
    with pytest.raises(ParameterError, match="epoch 0"):
        run_vehicle_filter(with_gap(eight(), 0, 1, (name,)), KNOWN)


def test_a_drive_has_arrays_that_fit() -> None:
    drive = eight()
    for name in SENSORS:
        with pytest.raises(ParameterError, match=rf"{name} .* not of shape"):
            changed(drive, **{name: getattr(drive, name)[:-1]})
    for name in SENSORS[:2]:  # an INS has no gaps
        with pytest.raises(ParameterError, match=rf"{name} .* not NaN or infinite"):
            with_gap(drive, 5, 6, (name,))
    for values in ({"time": drive.time**1.1}, {"time": drive.time[:1]}, {"period": 0.013}):
        with pytest.raises(ParameterError, match="time must be"):
            changed(drive, **values)
    for start in (-1, 61):
        with pytest.raises(ParameterError, match="places must be"):
            changed(drive, places=(Place("off", start),))
