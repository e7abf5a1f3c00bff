"""Simulated drives: against closed forms, against pyins' integration, and their noise."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from lib.vehicle.made_drive import SENSORS, TURN, as_pva, as_table
from pyins import strapdown, transform
from scipy import stats

from inswsn_lib.errors import ParameterError
from inswsn_lib.scenario import Setting, load_scenario, with_values
from inswsn_lib.simulation import (
    Drive,
    Piece,
    Route,
    Truth,
    simulate_drive,
    simulate_sensors,
    true_motion,
)
from inswsn_lib.simulation.drive import wrapped
from inswsn_lib.simulation.route_planning import RouteLimits, plan_route
from inswsn_lib.simulation.vehicle_sensors import SensorErrors, VehicleModel, gauss_markov

Settings = dict[str, Setting]
Array = np.ndarray

LATITUDE, HEIGHT = np.radians(32.06), 20.0
# WGS 84
A, E2, EARTH_RATE = 6378137.0, 6.6943799901413e-3, 7.292115e-5
SQUARE = 1 - E2 * np.sin(LATITUDE) ** 2
MERIDIAN = A * (1 - E2) / SQUARE**1.5
TRANSVERSE = A / SQUARE**0.5
# Somigliana's formula, with the linear decrease over the height
GRAVITY = 9.7803253359 * (1 + 0.00193185265241 * np.sin(LATITUDE) ** 2) / SQUARE**0.5
GRAVITY *= 1 - 2 * HEIGHT / A
PERIOD = 0.01

NO_ERRORS = dict.fromkeys([
    "gps_position_noise", "gps_velocity_noise", "compass_noise", "compass_outlier",
    *(
        f"{sensor}_{what}" for sensor in ("gyro", "accelerometer")
        for what in ("noise", "bias", "instability", "scale")
    ),
], 0)  # fmt: skip
STIFF = {"pitch_response": 0, "roll_response": 0, "slip": 0}


@pytest.fixture(scope="module")
def settings(root: Path) -> Settings:
    return load_scenario(root / "data/scenarios/p3.yaml")


@pytest.fixture(scope="module")
def quiet(settings: Settings) -> Settings:
    return with_values(settings, **NO_ERRORS)


@pytest.fixture(scope="module")
def truth(settings: Settings) -> Truth:
    return true_motion(settings, 0)


@pytest.fixture(scope="module")
def ideal(truth: Truth, quiet: Settings) -> Drive:
    return simulate_sensors(truth, quiet, runs=1, seed=0)


@pytest.fixture(scope="module")
def still(settings: Settings) -> Truth:
    """Ten seconds at rest, headed east."""
    return true_motion(settings, steady(0.0, 0.0, np.pi / 2))


def steady(speed: float, curvature: float, course: float, seed: int = 0) -> Route:
    """Ten seconds on a level road of constant curvature at constant speed."""
    rate = speed * curvature
    return Route((Piece(10.0, speed, course_rate=(rate, rate)),), course=course, seed=seed)


def is_variance(errors: Array, sigma: float) -> bool:
    """Whether normal errors of mean 0 have a deviation; wrong for true ones once in 10,000."""
    low, high = stats.chi2.ppf([5e-5, 1 - 5e-5], errors.size)
    return bool(low < (errors**2).sum() / sigma**2 < high)


def integrated(drive: Drive) -> pd.DataFrame:
    """What pyins' integration makes of the first run of a drive, at the epochs."""
    true = drive.reference
    assert true.attitude is not None
    start = as_pva(true.position[0], true.velocity[0], true.attitude[0])
    samples = drive.rotation_increments[..., 0], drive.velocity_increments[..., 0]
    out = strapdown.Integrator(start).integrate(as_table(*samples, drive.period))
    return out.iloc[:: drive.samples_per_epoch]


def test_the_settings_are_what_their_reasons_say(settings: Settings) -> None:
    degree, hour, g = np.pi / 180, 3600, 9.80665
    expected = {
        "latitude": 32.06 * degree, "longitude": 118.80 * degree, "slip": 0.3 * degree,
        "pitch_response": 0.4 * degree, "roll_response": 0.4 * degree, "imu_period": 1 / 100,
        "compass_noise": 0.15 * degree, "gyro_noise": 4.5 * degree / hour**0.5,
        "gyro_bias": 0.02 * degree, "gyro_instability": 10 * degree / hour,
        "accelerometer_noise": 1 / hour**0.5, "accelerometer_bias": 0.010 * g,
        "accelerometer_instability": 0.001 * g,
    }  # fmt: skip
    for name, value in expected.items():
        assert settings[name].value == pytest.approx(value, rel=1e-5)
    assert settings["compass_outlier_size"].value == pytest.approx([5 * degree, 10 * degree])
    kinds = (RouteLimits, VehicleModel, SensorErrors)
    mine = {field.name for kind in kinds for field in fields(kind)}
    assert {name for name in mine if settings[name].source == "paper"} == {
        *("imu_period", "aiding_period", "compass_noise"),
        *("gps_position_noise", "gps_velocity_noise"),
    }


@pytest.mark.parametrize(
    ("v", "course"), [(0.0, np.pi / 2), (15.0, 0.0), (15.0, 2.5), (15.0, -1.9)]
)
def test_at_rest_and_on_a_straight_there_is_no_turn(
    settings: Settings, v: float, course: float
) -> None:
    truth = true_motion(settings, steady(v, 0.0, course))
    c, s = np.cos(course), np.sin(course)
    north, east = v * c, v * s
    earth = EARTH_RATE * np.array([np.cos(LATITUDE), 0, -np.sin(LATITUDE)])
    across = east / (TRANSVERSE + HEIGHT)
    transport = np.array([across, -north / (MERIDIAN + HEIGHT), -across * np.tan(LATITUDE)])
    # what keeps the vehicle level and on its course over the turning Earth
    to_body = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    rate = to_body @ (earth + transport)
    coriolis = np.cross(2 * earth + transport, [north, east, 0])
    force = to_body @ (coriolis - [0, 0, GRAVITY])
    # the latitude changes by 150 m / 6371 km
    assert np.ptp(truth.rotation, axis=1).max() / PERIOD < 1e-8
    assert truth.rotation.mean(axis=1) / PERIOD == pytest.approx(rate, abs=1e-8 if v else 1e-10)
    assert truth.velocity.mean(axis=1) / PERIOD == pytest.approx(force, abs=1e-5 if v else 1e-6)


@pytest.mark.parametrize("radius", [20.0, -35.0])
def test_in_a_steady_turn(settings: Settings, radius: float) -> None:
    v = 6.5
    truth = true_motion(with_values(settings, **STIFF), steady(v, 1 / radius, 0.4))
    # the Earth's rate and the Coriolis acceleration are what is left over
    roll, pitch, yaw = truth.rotation / PERIOD
    forward, right, down = truth.velocity / PERIOD
    assert yaw == pytest.approx(v / radius + 0 * yaw, abs=1.1 * EARTH_RATE)
    assert np.abs([roll, pitch]).max() < 1.1 * EARTH_RATE
    left_over = 2.2 * EARTH_RATE * v
    # over a sample the force turns with the body, to the second order
    assert right == pytest.approx(v**2 / radius + 0 * right, abs=left_over + 1e-5)
    assert np.abs(forward).max() < left_over + 1e-5
    assert down == pytest.approx(-GRAVITY + 0 * down, abs=left_over + 1e-5)


def test_the_body_leans_and_slips(settings: Settings) -> None:
    v, radius = 6.5, 20.0
    truth = true_motion(settings, steady(v, 1 / radius, 0.4))
    lateral = v**2 / radius  # to the right
    attitude = truth.reference.attitude
    assert attitude is not None
    roll, pitch, yaw = transform.mat_to_rph(TURN @ attitude).T
    course = np.degrees(np.arctan2(*truth.reference.velocity[:, :2].T))
    assert roll == pytest.approx(-0.4 * lateral + 0 * roll, abs=1e-5)  # out of the turn
    assert pitch == pytest.approx(0 * pitch, abs=1e-9)
    behind = (yaw - course + 180) % 360 - 180
    assert behind == pytest.approx(0.3 * lateral + 0 * yaw, abs=1e-5)


def test_the_increments_integrate_to_the_reference(ideal: Drive) -> None:
    out = integrated(ideal)
    position = np.degrees(ideal.reference.position)
    position[:, 2] = ideal.reference.position[:, 2]
    off = transform.compute_lla_difference(out[["lat", "lon", "alt"]].to_numpy(), position)
    assert np.abs(off).max() < 0.05  # m, after 25 minutes
    velocity = ideal.reference.velocity @ TURN
    assert np.abs(out[["VN", "VE", "VD"]].to_numpy() - velocity).max() < 1e-4
    attitude = ideal.reference.attitude
    assert attitude is not None
    turned = transform.mat_from_rph(out[["roll", "pitch", "heading"]])
    assert np.abs(turned - TURN @ attitude).max() < 1e-8


def test_the_reference_is_the_route(settings: Settings, truth: Truth) -> None:
    route = plan_route(settings, 0)
    motion = route.kinematics(truth.time)
    assert len(truth.time) == 1501
    assert truth.places == route.places
    velocity = truth.reference.velocity
    assert np.linalg.norm(velocity, axis=1) == pytest.approx(motion.speed, abs=1e-9)
    assert velocity[:, 2] == pytest.approx(motion.speed * np.sin(motion.grade), abs=1e-9)
    # in the body: forward, and to the side what the slip law says
    attitude = truth.reference.attitude
    assert attitude is not None
    forward, right, down = np.einsum("kij,ki->jk", attitude, velocity)
    slip = -np.radians(0.3) * motion.lateral_acceleration
    assert np.abs(right).max() > 0.05
    assert right == pytest.approx(motion.speed * np.sin(slip), abs=1e-4)
    rise = np.radians(0.4) * motion.acceleration
    # but for the product of lean and slip, at most 0.017 times 0.013
    assert down == pytest.approx(motion.speed * np.sin(rise), abs=3e-3)
    assert (forward >= -1e-9).all()


def test_without_errors_the_sensors_tell_the_truth(truth: Truth, ideal: Drive) -> None:
    reference = ideal.reference
    assert ideal.origin == "simulated"
    assert ideal.rotation_increments.shape == (150_000, 3, 1)
    assert np.array_equal(ideal.gps_position[:, :, 0], reference.position)
    assert np.array_equal(ideal.gps_velocity[:, :, 0], reference.velocity)
    assert reference.attitude is not None
    east, north = reference.attitude[:, :2, 0].T
    apart = ideal.compass[:, 0] - np.arctan2(east, north)
    assert np.cos(apart) == pytest.approx(1 + 0 * apart, abs=1e-12)
    assert (np.abs(ideal.compass) <= np.pi).all()
    assert reference.gyro_bias is not None
    assert not reference.gyro_bias.any()


def test_a_mounted_imu_turns_what_it_measures(truth: Truth, ideal: Drive, quiet: Settings) -> None:
    angle = np.radians(3)
    mounted = simulate_sensors(truth, with_values(quiet, mounting_yaw=angle), runs=1, seed=0)
    c, s = np.cos(angle), np.sin(angle)
    for name in ("rotation_increments", "velocity_increments"):
        x, y, z = np.moveaxis(getattr(ideal, name), 1, 0)
        # turned to the right, its x axis points a little to the vehicle's right
        expected = np.stack([c * x + s * y, c * y - s * x, z], axis=1)
        assert np.abs(getattr(mounted, name) - expected).max() < 1e-12
    assert np.array_equal(mounted.compass, ideal.compass)


RUNS = 300


def only(quiet: Settings, truth: Truth, runs: int = RUNS, **errors: Any) -> Drive:
    """The drive on which the sensors have these errors and no others."""
    return simulate_sensors(truth, with_values(quiet, **errors), runs=runs, seed=5)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_gps(quiet: Settings, still: Truth, share: float) -> None:
    """Of errors of the position a share is correlated from epoch to epoch."""
    told = {"gps_correlation_time": 20, "gps_correlated_share": share}
    drive = only(quiet, still, gps_position_noise=3, gps_velocity_noise=0.05, **told)
    true = still.reference.position
    errors = (drive.gps_position - true[:, :, None]) * np.array([
        [MERIDIAN + HEIGHT], [(TRANSVERSE + HEIGHT) * np.cos(LATITUDE)], [1.0]
    ])  # fmt: skip
    for axis in range(3):
        assert is_variance(errors[0, axis], 3)
        assert is_variance(errors[10, axis], 3)
        assert is_variance(drive.gps_velocity[:, axis], 0.05)
    # a correlation of n pairs has the deviation n^-1/2
    for epoch in (1, 10):
        correlation = np.mean(errors[0] * errors[epoch]) / 9
        expected = share * np.exp(-epoch / 20)
        assert correlation == pytest.approx(expected, abs=4 / errors[0].size ** 0.5)


def test_compass(quiet: Settings, still: Truth) -> None:
    sigma, bias = np.radians(0.15), np.radians(4)
    drive = only(quiet, still, compass_noise=sigma, compass_bias=bias)
    assert is_variance(drive.compass - np.pi / 2 - bias, sigma)


def test_compass_outliers(quiet: Settings, still: Truth) -> None:
    low, high = np.radians(5), np.radians(10)
    drive = only(quiet, still, compass_outlier=0.02, compass_outlier_size=[low, high])
    off = drive.compass - np.pi / 2
    out = np.abs(off) > 1e-9
    few, many = stats.binom.ppf([5e-5, 1 - 5e-5], off.size, 0.02)
    assert few <= out.sum() <= many
    size = np.abs(off[out])
    assert low - 1e-9 <= size.min() < size.max() <= high + 1e-9
    few, many = stats.binom.ppf([5e-5, 1 - 5e-5], out.sum(), 0.5)
    assert few <= (off[out] > 0).sum() <= many


@pytest.mark.parametrize(("sensor", "field"), [("gyro", "rotation"), ("accelerometer", "velocity")])
class TestTriads:
    def errors(self, drive: Drive, field: str, truth: Truth) -> Array:
        names = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]
        table = pd.DataFrame(np.vstack([truth.rotation, truth.velocity]).T, columns=names)
        ideal = strapdown.compute_increments_from_imu(table, "increment").to_numpy()
        columns = slice(1, 4) if field == "rotation" else slice(4, 7)
        found: Array = getattr(drive, f"{field}_increments") - ideal[:, columns, None]
        return found

    def test_noise(self, sensor: str, field: str, quiet: Settings, still: Truth) -> None:
        drive = only(quiet, still, **{f"{sensor}_noise": 0.01})
        # of each sample: the random walk over 0.01 s; the corrections move a millionth of it
        for axis in range(3):
            errors = self.errors(drive, field, still)[:, axis]
            assert is_variance(errors, 0.01 * PERIOD**0.5)
            pairs = errors[:-1] * errors[1:] / (0.01**2 * PERIOD)
            assert abs(pairs.mean()) < 4 / pairs.size**0.5

    @pytest.mark.parametrize("what", ["bias", "instability"])
    def test_bias(self, sensor: str, field: str, quiet: Settings, still: Truth, what: str) -> None:
        """That of the reference is the last."""
        told = {f"{sensor}_{what}": 0.01, f"{sensor}_correlation_time": 5.0}
        drive = only(quiet, still, **told)
        errors = self.errors(drive, field, still) / PERIOD
        bias = getattr(drive.reference, f"{sensor}_bias")
        assert errors[-1] == pytest.approx(bias, abs=1e-5)
        assert is_variance(errors[0], 0.01)
        assert is_variance(bias, 0.01)
        lasting = 1.0 if what == "bias" else np.exp(-(len(errors) - 1) * PERIOD / 5)
        correlation = np.mean(errors[0] * bias) / np.mean(bias**2)
        assert correlation == pytest.approx(lasting, abs=4 / bias.size**0.5)

    def test_scale(self, sensor: str, field: str, quiet: Settings, settings: Settings) -> None:
        # half a turn in ten seconds, about the axis that gravity is along
        turning = true_motion(with_values(settings, **STIFF), steady(6.0, np.pi / 60, 0.0))
        drive = only(quiet, turning, **{f"{sensor}_scale": 0.001})
        index = 0 if field == "rotation" else 1
        ideal = (turning.rotation, turning.velocity)[index][2, 1:].sum()
        shares = self.errors(drive, field, turning)[:, 2].sum(axis=0) / ideal
        assert is_variance(shares, 0.001)


@pytest.mark.parametrize("time", [0.0, 3.0])
def test_a_gauss_markov_process_by_its_recursion(time: float) -> None:
    """That of no correlation time is white."""
    normal = np.random.default_rng(1).standard_normal(40)
    kept = np.exp(-0.5 / 3) if time else 0.0
    x = [2.0 * normal[0]]
    for w in normal[1:]:
        x.append(kept * x[-1] + 2.0 * np.sqrt(1 - kept**2) * w)
    assert gauss_markov(normal, 2.0, time, 0.5) == pytest.approx(np.array(x), abs=1e-13)


def test_angles_are_wrapped_to_a_half_open_turn() -> None:
    beyond = np.nextafter(np.pi, 4)
    angles = np.array([0.0, 3.0, np.pi, -np.pi, 4.0, -4.0, 20.0, beyond, -beyond])
    found = wrapped(angles)
    assert found[:4].tolist() == [0.0, 3.0, np.pi, np.pi]
    assert found[4:7] == pytest.approx([4 - 2 * np.pi, 2 * np.pi - 4, 20 - 6 * np.pi])
    assert ((found > -np.pi) & (found <= np.pi)).all()


def test_seeds(settings: Settings, still: Truth) -> None:
    drive = simulate_sensors(still, settings, runs=3, seed=1)
    more = simulate_sensors(still, settings, runs=5, seed=1)
    other = simulate_sensors(still, settings, runs=3, seed=2)
    elsewhere = true_motion(settings, steady(0.0, 0.0, np.pi / 2, seed=1))
    other_route = simulate_sensors(elsewhere, settings, runs=3, seed=1)
    for name in SENSORS:
        value = getattr(drive, name)
        assert np.array_equal(value, getattr(more, name)[..., :3])  # whatever the number of runs
        assert not (value == getattr(other, name)).all(axis=0).any()
        assert not (value == getattr(other_route, name)).all(axis=0).any()
        assert not (value[..., 0] == value[..., 1]).all(axis=0).any()


def test_drives_are_what_they_were(settings: Settings) -> None:
    """Every simulation of the book rests on the order of these draws."""
    changes = {"gps_correlation_time": 60, "gps_correlated_share": 0.9, "compass_bias": 0.02}
    coarse = with_values(settings, imu_period=0.1, **changes)
    drive = simulate_drive(coarse, runs=2, seed=3, route=7)
    expected = {
        "rotation_increments": (-0.00039222058421628514, 0.0236909660396011),
        "velocity_increments": (-0.19852547268414286, -0.9495440953198843),
        "gps_position": (0.5594115363705292, 21.74839829267972),
        "gps_velocity": (13.808587197165389, -0.038266333045783946),
        "compass": (1.8757315238316628, 1.7380924857722855),
    }
    for name, values in expected.items():
        x = getattr(drive, name)
        assert (x[700].flat[0], x[1234].flat[-1]) == pytest.approx(values, rel=1e-9)
    assert simulate_drive(coarse, runs=1, seed=3).places == plan_route(coarse, 0).places


def test_a_change_of_one_setting_moves_no_other_draw(settings: Settings, still: Truth) -> None:
    drive = simulate_sensors(still, settings, runs=2, seed=1)
    changed = with_values(settings, gyro_noise=0, gps_position_noise=1, compass_outlier=0)
    other = simulate_sensors(still, changed, runs=2, seed=1)
    assert np.array_equal(drive.gps_velocity, other.gps_velocity)
    same = np.isclose(drive.compass, other.compass, atol=1e-12)
    assert 0.8 < same.mean() <= 1
    assert drive.reference.gyro_bias is not None
    assert np.array_equal(drive.reference.gyro_bias, other.reference.gyro_bias)


def test_epochs_may_be_closer_than_a_second(settings: Settings) -> None:
    """At 2 Hz with 20 samples an epoch; the places are at the same times."""
    coarse = with_values(settings, imu_period=0.1)
    often = true_motion(with_values(settings, imu_period=0.025, aiding_period=0.5), 0)
    once = true_motion(coarse, 0)
    assert np.array_equal(often.time, 0.5 * np.arange(3001))
    assert often.rotation.shape == (3, 60_001)
    assert [p.start for p in often.places] == [2 * p.start for p in once.places]
    assert often.reference.velocity[::2] == pytest.approx(once.reference.velocity, abs=1e-9)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"aiding_period": 0.3}, "imu_period and aiding_period must be"),
        ({"imu_period": 0.013}, "imu_period and aiding_period must be"),
        ({"latitude": 1.57}, "latitude must be a number between -1.4 and 1.4, not 1.57."),
        ({"gyro_noise": -1.0}, "gyro_noise must be a number between 0 and 10, not -1.0."),
        ({"compass_outlier_size": [0.2, 0.1]}, "compass_outlier_size must be"),
    ],
)
def test_what_may_not_be(settings: Settings, changes: dict[str, Any], said: str) -> None:
    changed = with_values(settings, **changes)
    with pytest.raises(ParameterError) as refused:
        simulate_sensors(true_motion(changed, steady(0.0, 0.0, 0.0)), changed, runs=1, seed=0)
    assert str(refused.value).startswith(said)


def test_runs_seeds_and_routes_are_whole_numbers(settings: Settings, still: Truth) -> None:
    with pytest.raises(ParameterError, match=r"runs .* not 0"):
        simulate_sensors(still, settings, runs=0, seed=0)
    with pytest.raises(ParameterError, match=r"seed .* not -1"):
        simulate_sensors(still, settings, runs=1, seed=-1)
    with pytest.raises(ParameterError, match=r"route .* not -1"):
        true_motion(settings, -1)
