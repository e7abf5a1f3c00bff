"""Simulated drives: a planned route, the motion of the vehicle's body, and sensors with errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pyins import earth, sim, transform
from scipy.signal import lfilter

from inswsn_lib.checks import whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.scenario import Range, Setting, between, from_settings
from inswsn_lib.vehicle.drive import Drive, Place, Reference
from inswsn_lib.vehicle.route import Kinematics, Route, plan_route

Array = NDArray[np.float64]

# north-east-down to east-north-up
_TO_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_ROUNDING = 1e-9


@dataclass(frozen=True)
class VehicleModel:
    """Where the vehicle drives, how its body answers, and how often it is sampled.

    Attributes
    ----------
    latitude, longitude : float
        Of the start, rad.
    height : float
        Of the start above the ellipsoid, m.
    pitch_response : float
        How far the nose rises for each m/s^2 of acceleration, rad.
    roll_response : float
        How far the body leans out of a turn for each m/s^2 of lateral acceleration, rad.
    slip : float
        How far the course lags behind the yaw for each m/s^2 of lateral acceleration, rad.
    imu_period, aiding_period : float
        Of the IMU, and of GPS and compass, s.
    """

    latitude: float = between(-1.4, 1.4)
    longitude: float = between(-np.pi, np.pi)
    height: float = between(-500, 9000)
    pitch_response: float = between(0, 0.05)
    roll_response: float = between(0, 0.05)
    slip: float = between(0, 0.05)
    imu_period: float = between(0.001, 0.1)
    aiding_period: float = between(0.1, 1)


@dataclass(frozen=True)
class SensorErrors:
    """The errors of the sensors; standard deviations, unless said otherwise.

    Attributes
    ----------
    gps_position_noise, gps_velocity_noise : float
        Of each axis, m and m/s.
    gps_correlation_time : float
        Of the correlated part of the position's error, s; 0 for white noise.
    gps_correlated_share : float
        The share of that part in the variance of the position's error.
    compass_noise : float
        rad.
    compass_bias : float
        The same in all runs, rad.
    compass_outlier : float
        The probability that a measurement is an outlier.
    compass_outlier_size : tuple of two floats
        What an outlier adds, to either side, from and to, rad.
    mounting_yaw : float
        How far the IMU is turned about the down axis of the vehicle, to the right, rad.
    gyro_noise : float
        Angle random walk, rad per sqrt(s).
    gyro_bias : float
        Turn-on, constant over a run, rad/s.
    gyro_instability : float
        Of a first-order Gauss-Markov process that adds to the bias, rad/s.
    gyro_correlation_time : float
        Of that process, s.
    gyro_scale : float
        Scale factor error, 1.
    accelerometer_noise : float
        Velocity random walk, m/s per sqrt(s).
    accelerometer_bias, accelerometer_instability : float
        m/s^2.
    accelerometer_correlation_time : float
        s.
    accelerometer_scale : float
        Scale factor error, 1.
    """

    gps_position_noise: float = between(0, 1000)
    gps_velocity_noise: float = between(0, 100)
    gps_correlation_time: float = between(0, 1e6)
    gps_correlated_share: float = between(0, 1)
    compass_noise: float = between(0, np.pi)
    compass_bias: float = between(-np.pi, np.pi)
    compass_outlier: float = between(0, 1)
    compass_outlier_size: Range = between(0, np.pi)
    mounting_yaw: float = between(-np.pi, np.pi)
    gyro_noise: float = between(0, 10)
    gyro_bias: float = between(0, 10)
    gyro_instability: float = between(0, 10)
    gyro_correlation_time: float = between(0, 1e6)
    gyro_scale: float = between(0, 0.1)
    accelerometer_noise: float = between(0, 10)
    accelerometer_bias: float = between(0, 10)
    accelerometer_instability: float = between(0, 10)
    accelerometer_correlation_time: float = between(0, 1e6)
    accelerometer_scale: float = between(0, 0.1)


@dataclass(frozen=True, eq=False)
class Truth:
    """What happened on a route: the motion, and what ideal sensors in the vehicle's axes integrate.

    Attributes
    ----------
    route : int
        The seed of the route.
    time : ndarray, (epochs,)
        Of GPS and compass, s.
    period : float
        Of the IMU, s.
    yaw : ndarray, (epochs,)
        Of the vehicle, rad, clockwise from north, continuous.
    rotation, velocity : ndarray, (3, samples + 1)
        The integrals of the angular rate (rad) and the specific force (m/s) over each sample, body
        axes (forward, right, down), without corrections for coning and sculling. The first column
        is that of a sample before the start, at rest, and equals the next.
    reference : Reference
        At the epochs; no biases.
    places : tuple of Place

    Examples
    --------
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import true_motion
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> truth = true_motion(with_values(scenario, imu_period=0.1))
    >>> truth.rotation.shape  # ten samples in each of 1500 s, and the one before the start
    (3, 15001)
    """

    route: int
    time: Array
    period: float
    yaw: Array
    rotation: Array
    velocity: Array
    reference: Reference
    places: tuple[Place, ...]


def simulate_drive(
    settings: Mapping[str, Setting], *, runs: int, seed: int, route: int = 0
) -> Drive:
    """Simulate a drive: `true_motion`, then `simulate_sensors`.

    Parameters
    ----------
    settings : mapping of str to Setting
        From `load_scenario`.
    runs : int
        How many independent sets of sensors share the route.
    seed : int
        Of the sensors.
    route : int
        The seed of the route.

    Returns
    -------
    Drive
        With the truth as its reference.

    Raises
    ------
    InswsnError
        If a setting is missing, or the route cannot be.
    ParameterError
        If a setting, the number of runs or a seed may not be what it is.

    Examples
    --------
    P3's drive of 25 minutes, here with an IMU at 10 Hz:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import metres, simulate_drive
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=4, seed=0)
    >>> drive.time[-1].item(), drive.samples_per_epoch, drive.runs, len(drive.places)
    (1500.0, 10, 4, 8)
    >>> true = drive.reference.position[:, :, None]
    >>> error = (drive.gps_position - true) * metres(drive.reference.position)[:, :, None]
    >>> print(f"{error.std():.0f} m")  # of each axis, as P3 says
    3 m
    """
    return simulate_sensors(true_motion(settings, route), settings, runs=runs, seed=seed)


def true_motion(settings: Mapping[str, Setting], route: int = 0) -> Truth:
    """Return what happened on a route; it serves any number of `simulate_sensors`.

    `pyins` integrates the velocity on the ellipsoid and differentiates position and attitude.

    Parameters
    ----------
    settings : mapping of str to Setting
        From `load_scenario`; those of `RouteLimits` and `VehicleModel`.
    route : int
        The seed of the route.

    Returns
    -------
    Truth
        The motion, and what ideal sensors integrate.

    Raises
    ------
    InswsnError
        If a setting is missing, or the route cannot be.
    ParameterError
        If a setting or the seed may not be what it is.

    Examples
    --------
    The vehicle stands at the start, and ideal accelerometers then tell the reaction to gravity:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import true_motion
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> truth = true_motion(with_values(scenario, imu_period=0.1))
    >>> bool(np.abs(truth.reference.velocity[:10]).max() < 1e-6)
    True
    >>> print(f"{np.linalg.norm(truth.velocity[:, 0]) / truth.period:.1f} m/s^2")
    9.8 m/s^2
    """
    planned = plan_route(settings, route)
    return follow_route(planned, settings, route)


def follow_route(planned: Route, settings: Mapping[str, Setting], number: int = 0) -> Truth:
    """Return what happens on a route that is planned already.

    Parameters
    ----------
    planned : Route
    settings : mapping of str to Setting
        Those of `VehicleModel`.
    number : int
        What is to stand for the seed of the route.

    Raises
    ------
    InswsnError
        If a setting is missing.
    ParameterError
        If a setting may not be what it is.
    """
    model = from_settings(VehicleModel, settings)
    each, second = _samples_per_epoch(model)
    epochs = round(planned.duration * second) + 1
    motion = planned.kinematics(model.imu_period * np.arange(each * (epochs - 1) + 1))
    start = [*np.degrees([model.latitude, model.longitude]), model.height]
    attitude = body_attitude(motion, model)
    trajectory, imu = sim.generate_imu(
        motion.time, start, np.degrees(attitude), _velocity(motion), "increment"
    )
    here = trajectory.iloc[::each]
    to_body = transform.mat_from_rph(here[["roll", "pitch", "heading"]])
    return Truth(
        route=number,
        time=np.arange(epochs) / second,
        period=model.imu_period,
        yaw=attitude[::each, 2].copy(),
        rotation=np.ascontiguousarray(imu[["gyro_x", "gyro_y", "gyro_z"]].to_numpy().T),
        velocity=np.ascontiguousarray(imu[["accel_x", "accel_y", "accel_z"]].to_numpy().T),
        reference=Reference(
            position=np.column_stack([np.radians(here[["lat", "lon"]]), here["alt"]]),
            velocity=here[["VN", "VE", "VD"]].to_numpy() @ _TO_ENU.T,
            attitude=_TO_ENU @ to_body,
        ),
        places=tuple(Place(name, begin * second) for name, begin in planned.places),
    )


def simulate_sensors(
    truth: Truth, settings: Mapping[str, Setting], *, runs: int, seed: int
) -> Drive:
    """Simulate the sensors of a number of runs on one route.

    Run k depends on the two seeds and on k alone, however many runs there are. Each purpose has a
    stream of its own, so that a change of one setting moves no other draw.

    Parameters
    ----------
    truth : Truth
        From `true_motion`.
    settings : mapping of str to Setting
        Those of `SensorErrors`.
    runs : int
        How many.
    seed : int
        Of the sensors.

    Returns
    -------
    Drive
        The biases of its reference are those at the end of the drive, in the axes of the IMU.

    Raises
    ------
    InswsnError
        If a setting is missing.
    ParameterError
        If a setting, the number of runs or the seed may not be what it is.

    Examples
    --------
    A run is the same however many runs there are:

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import simulate_sensors, true_motion
    >>> scenario = with_values(
    ...     load_scenario(data_file("scenarios/p3.yaml")), imu_period=0.1
    ... )
    >>> truth = true_motion(scenario)
    >>> one, three = (simulate_sensors(truth, scenario, runs=runs, seed=0) for runs in (1, 3))
    >>> bool((one.gps_position == three.gps_position[..., :1]).all())
    True
    >>> bool((three.compass[:, 0] == three.compass[:, 1]).any())
    False
    """
    errors = from_settings(SensorErrors, settings)
    whole("runs", runs, 1)
    root = np.random.SeedSequence([whole("seed", seed, 0), truth.route])
    samples, epochs = truth.rotation.shape[1] - 1, len(truth.time)
    increments = np.empty((2, samples, 3, runs))
    gps = np.empty((2, epochs, 3, runs))
    compass = np.empty((epochs, runs))
    bias = np.empty((2, 3, runs))
    ideal = _as_mounted(truth, errors.mounting_yaw)
    for run, child in enumerate(root.spawn(runs)):
        *triads, satellites, magnetic = map(np.random.default_rng, child.spawn(4))
        measured = [
            _triad(name, axes, errors, stream, truth.period)
            for name, axes, stream in zip(("gyro", "accelerometer"), ideal, triads, strict=True)
        ]
        bias[..., run] = [drift for _, drift in measured]
        corrected = corrected_increments(measured[0][0], measured[1][0])
        for k in range(2):
            increments[k, ..., run] = corrected[k].T
        gps[..., run] = _gps(truth, errors, satellites)
        compass[:, run] = _compass(truth, errors, magnetic)
    reference = truth.reference
    return Drive(
        time=truth.time,
        period=truth.period,
        rotation_increments=increments[0],
        velocity_increments=increments[1],
        gps_position=gps[0],
        gps_velocity=gps[1],
        compass=compass,
        reference=Reference(
            position=reference.position,
            velocity=reference.velocity,
            attitude=reference.attitude,
            gyro_bias=bias[0],
            accelerometer_bias=bias[1],
        ),
        places=truth.places,
        origin="simulated",
    )


def body_attitude(motion: Kinematics, model: VehicleModel) -> Array:
    r"""Return roll, pitch and yaw of the body, (steps, 3), rad.

    With the acceleration :math:`a`, the lateral acceleration :math:`a_y` to the right, the slope
    :math:`\gamma` of the road and the course :math:`\chi`,

    .. math::
        \phi = -k_\phi a_y, \qquad \theta = \gamma + k_\theta a, \qquad \psi = \chi + k_\beta a_y:

    the body leans out of a turn, the nose rises when the vehicle accelerates, and it points into a
    turn, by the slip angle :math:`\beta = -k_\beta a_y` of the velocity in the body. So the lateral
    velocity is :math:`v \sin\beta`, but for products of small angles.

    Parameters
    ----------
    motion : Kinematics
        Of (steps,) samples.
    model : VehicleModel
    """
    lateral = motion.lateral_acceleration
    return np.stack(
        [
            -model.roll_response * lateral,
            motion.grade + model.pitch_response * motion.acceleration,
            motion.course + model.slip * lateral,
        ],
        axis=1,
    )


def corrected_increments(rotation: Array, velocity: Array) -> tuple[Array, Array]:
    r"""Return rotation vectors and velocity increments with coning and sculling corrections.

    For samples :math:`\alpha` of the angular rate and :math:`v` of the specific force, each with
    the one before it (primed), both taken to be linear in time over the two,

    .. math::
        \theta = \alpha + \tfrac1{12}\,\alpha' \times \alpha, \qquad
        \Delta v = v + \tfrac12\,\alpha \times v
            + \tfrac1{12}(\alpha' \times v + v' \times \alpha),

    the same as `pyins.strapdown.compute_increments_from_imu`.

    Parameters
    ----------
    rotation, velocity : ndarray, (3, samples + 1)
        Integrals over samples, rad and m/s; the first column is the sample before the first.

    Returns
    -------
    tuple of two ndarrays, (3, samples)
        rad, and m/s in the body frame at the beginning of the sample.
    """
    before, now = rotation[:, :-1], rotation[:, 1:]
    pushed_before, pushed = velocity[:, :-1], velocity[:, 1:]
    turned = now + _cross(before, now) / 12
    sculling = (_cross(before, pushed) + _cross(pushed_before, now)) / 12
    return turned, pushed + sculling + _cross(now, pushed) / 2


def gauss_markov(normal: Array, deviation: float, correlation_time: float, period: float) -> Array:
    r"""Return a stationary first-order Gauss-Markov process.

    .. math::
        x_0 = \sigma w_0, \qquad x_{k+1} = \varphi x_k + \sigma\sqrt{1 - \varphi^2}\,w_{k+1},
        \qquad \varphi = e^{-T/\tau}

    Parameters
    ----------
    normal : ndarray, (..., steps)
        Standard normal numbers w.
    deviation : float
        :math:`\sigma`.
    correlation_time : float
        :math:`\tau`, s; 0 for white noise.
    period : float
        T, s.
    """
    kept = np.exp(-period / correlation_time) if correlation_time > 0 else 0.0
    driven = deviation * np.sqrt(1 - kept**2) * normal
    driven[..., 0] = deviation * normal[..., 0]
    return np.asarray(lfilter([1.0], [1.0, -kept], driven))


def _samples_per_epoch(model: VehicleModel) -> tuple[int, int]:
    """Return how many samples fill an epoch, and how many epochs a second; refuse others."""
    each, second = model.aiding_period / model.imu_period, 1 / model.aiding_period
    if abs(second - round(second)) > _ROUNDING:
        raise ParameterError("aiding_period", model.aiding_period, "1 s over a whole number")
    if abs(each - round(each)) > _ROUNDING * each:
        raise ParameterError(
            "imu_period", model.imu_period, "such that whole samples fill the aiding_period"
        )
    return round(each), round(second)


def _velocity(motion: Kinematics) -> Array:
    """Return the velocity north, east, down, (steps, 3), m/s."""
    level = motion.speed * np.cos(motion.grade)
    return np.stack(
        [
            level * np.cos(motion.course),
            level * np.sin(motion.course),
            -motion.speed * np.sin(motion.grade),
        ],
        axis=1,
    )


def _as_mounted(truth: Truth, yaw: float) -> tuple[Array, Array]:
    """Return what ideal sensors integrate in the axes of the IMU, twice (3, samples + 1)."""
    c, s = np.cos(yaw), np.sin(yaw)
    to_imu = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return to_imu @ truth.rotation, to_imu @ truth.velocity


def _triad(
    name: str, ideal: Array, errors: SensorErrors, rng: np.random.Generator, period: float
) -> tuple[Array, Array]:
    """Return what three sensors integrate, (3, samples + 1), and their bias at the end, (3,)."""
    noise, bias, instability, correlation_time, scale = (
        getattr(errors, f"{name}_{what}")
        for what in ("noise", "bias", "instability", "correlation_time", "scale")
    )
    bias_draw, scale_draw = rng.standard_normal((2, 3, 1))
    walk, white = rng.standard_normal((2, *ideal.shape))
    drift = bias * bias_draw + gauss_markov(walk, instability, correlation_time, period)
    measured = (1 + scale * scale_draw) * ideal + period * drift + noise * np.sqrt(period) * white
    return measured, drift[:, -1]


def _gps(truth: Truth, errors: SensorErrors, rng: np.random.Generator) -> Array:
    """Return position (rad, rad, m) and velocity (m/s) of one run, (2, epochs, 3)."""
    position, velocity = truth.reference.position, truth.reference.velocity
    white, correlated, speed = rng.standard_normal((3, *position.T.shape))
    sigma, share = errors.gps_position_noise, errors.gps_correlated_share
    error = sigma * np.sqrt(1 - share) * white + gauss_markov(
        correlated,
        sigma * np.sqrt(share),
        errors.gps_correlation_time,
        float(truth.time[1] - truth.time[0]),
    )
    north, _, east = earth.principal_radii(np.degrees(position[:, 0]), position[:, 2])
    error[:2] /= np.stack([north, east])
    return np.stack([position + error.T, velocity + errors.gps_velocity_noise * speed.T])


def _compass(truth: Truth, errors: SensorErrors, rng: np.random.Generator) -> Array:
    """Return the measured yaw of one run in (-pi, pi], (epochs,), rad."""
    noise = errors.compass_noise * rng.standard_normal(len(truth.yaw))
    chance, side, size = rng.random((3, len(truth.yaw)))
    least, most = errors.compass_outlier_size
    outlier = np.where(side < 0.5, -1.0, 1.0) * (least + (most - least) * size)
    yaw = truth.yaw + errors.compass_bias + noise
    yaw += np.where(chance < errors.compass_outlier, outlier, 0.0)
    return np.pi - (np.pi - yaw) % (2 * np.pi)


def _cross(first: Array, second: Array) -> Array:
    """Return the cross product of columns of three, (3, n); quicker than that of numpy."""
    a, b, c = first
    x, y, z = second
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x])
