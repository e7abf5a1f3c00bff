"""Simulated drives: a route, the motion of the vehicle's body, and sensors with errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np
from scipy.signal import lfilter

from inswsn_lib.checks import Array, whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.inertial.earth import TURN, metres
from inswsn_lib.scenario import Range, Setting, between, from_settings
from inswsn_lib.simulation.drive import Drive, DriveReference, Place, wrapped
from inswsn_lib.simulation.ideal_sensors import as_increments, ideal_sensors
from inswsn_lib.simulation.route import Kinematics, Route
from inswsn_lib.simulation.route_planning import plan_route

_ROUNDING = 1e-9


@dataclass(frozen=True)
class VehicleModel:
    """Where the vehicle drives, how its body answers, and how often it is sampled."""

    latitude: float = between(-1.4, 1.4)  # rad, of the start
    longitude: float = between(-np.pi, np.pi)
    height: float = between(-500, 9000)  # m, above the ellipsoid
    pitch_response: float = between(0, 0.05)  # rad for each m/s^2 forward: the nose rises
    roll_response: float = between(0, 0.05)  # rad for each m/s^2 to a side: it leans out of a turn
    slip: float = between(0, 0.05)  # rad for each m/s^2 to a side: the course lags behind the yaw
    imu_period: float = between(0.001, 0.1)  # s
    aiding_period: float = between(0.1, 1)  # s, of GPS and compass


@dataclass(frozen=True)
class SensorErrors:
    """The errors of the sensors; standard deviations, unless said otherwise."""

    gps_position_noise: float = between(0, 1000)  # m, of each axis
    gps_velocity_noise: float = between(0, 100)  # m/s, of each axis
    gps_correlation_time: float = between(0, 1e6)  # s, of the part of the position's error that is
    gps_correlated_share: float = between(0, 1)  # correlated, and its share in the variance
    compass_noise: float = between(0, np.pi)  # rad
    compass_bias: float = between(-np.pi, np.pi)  # rad, the same in all runs
    compass_outlier: float = between(0, 1)  # the probability that a measurement is an outlier
    compass_outlier_size: Range = between(0, np.pi)  # rad, that it adds to either side, from and to
    mounting_yaw: float = between(-np.pi, np.pi)  # rad, of the IMU in the vehicle, to the right
    gyro_noise: float = between(0, 10)  # rad/s^0.5, angle random walk
    gyro_bias: float = between(0, 10)  # rad/s, turn-on, constant over a run
    gyro_instability: float = between(0, 10)  # rad/s, of a Gauss-Markov process beside it
    gyro_correlation_time: float = between(0, 1e6)  # s, of that process
    gyro_scale: float = between(0, 0.1)  # scale factor error
    accelerometer_noise: float = between(0, 10)  # m/s/s^0.5, velocity random walk
    accelerometer_bias: float = between(0, 10)  # m/s^2
    accelerometer_instability: float = between(0, 10)  # m/s^2
    accelerometer_correlation_time: float = between(0, 1e6)  # s
    accelerometer_scale: float = between(0, 0.1)


@dataclass(frozen=True, eq=False)
class Truth:
    """What happened on a route: the motion, and what ideal sensors in the vehicle's axes integrate.

    Attributes
    ----------
    seed : int
        Of the route.
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
    reference : DriveReference
        At the epochs; no biases.
    places : tuple of Place
    """

    seed: int
    time: Array
    period: float
    yaw: Array
    rotation: Array
    velocity: Array
    reference: DriveReference
    places: tuple[Place, ...]


def simulate_drive(
    settings: Mapping[str, Setting], *, runs: int, seed: int, route: int | Route = 0
) -> Drive:
    """Simulate a drive: `true_motion`, then `simulate_sensors`.

    Parameters
    ----------
    settings, route
        As in `true_motion`, and of the sensors' errors.
    runs, seed
        As in `simulate_sensors`.

    Raises
    ------
    InswsnError
        If a setting is missing, one may not be what it is, or they leave no route.

    Examples
    --------
    P3's drive of 25 minutes, here with an IMU at 10 Hz:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive = iw.simulate_drive(p3, runs=4, seed=0)
    >>> drive.time[-1].item(), drive.runs, drive.places[2].name
    (1500.0, 4, 'stop and start')
    """
    return simulate_sensors(true_motion(settings, route), settings, runs=runs, seed=seed)


def true_motion(settings: Mapping[str, Setting], route: int | Route = 0) -> Truth:
    """Return what happens on a route; it serves any number of `simulate_sensors`.

    By the formulas of `pyins.sim` the velocity is integrated on the ellipsoid, and position and
    attitude are differentiated.

    Parameters
    ----------
    settings : mapping of str to Setting
        From `load_scenario`; those of the vehicle, and of the route if it is to be planned.
    route : int or Route
        The seed to plan it with, or a route.

    Examples
    --------
    The vehicle stands at the start, and ideal accelerometers tell the reaction to gravity:

    >>> import numpy as np, inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> truth = iw.simulation.true_motion(p3)
    >>> print(f"{np.linalg.norm(truth.velocity[:, 0]) / truth.period:.1f} m/s^2")
    9.8 m/s^2
    """
    planned = route if isinstance(route, Route) else plan_route(settings, route)
    model = from_settings(VehicleModel, settings)
    second, each = 1 / model.aiding_period, model.aiding_period / model.imu_period
    if max(abs(x - round(x)) / x for x in (second, each)) > _ROUNDING:
        raise ParameterError(
            "imu_period and aiding_period",
            (model.imu_period, model.aiding_period),
            "such that whole samples fill an epoch and whole epochs fill a second",
        )
    second, each = round(second), round(each)
    epochs = round(planned.duration * second) + 1
    motion = planned.kinematics(model.imu_period * np.arange(each * (epochs - 1) + 1))
    start = np.array([*np.degrees([model.latitude, model.longitude]), model.height])
    attitude, velocity = body_attitude(motion, model), _velocity(motion)
    place, body, rotation, push = ideal_sensors(motion.time, start, attitude, velocity)
    here = slice(None, None, each)
    return Truth(
        seed=planned.seed,
        time=np.arange(epochs) / second,
        period=model.imu_period,
        yaw=attitude[here, 2].copy(),
        rotation=rotation,
        velocity=push,
        reference=DriveReference(
            position=np.column_stack([np.radians(place[here, :2]), place[here, 2]]),
            velocity=velocity[here] @ TURN,
            attitude=TURN @ body[here],
        ),
        places=tuple(Place(name, start * second) for name, start in planned.places),
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
        From `load_scenario`; those of the sensors' errors.
    runs, seed : int
        How many independent sets of sensors share the route, and their seed.

    Returns
    -------
    Drive
        The biases of its reference are those at the end of the drive, in the axes of the IMU.

    Examples
    --------
    A run is the same however many runs there are:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> truth = iw.simulation.true_motion(p3)
    >>> one, three = (iw.simulation.simulate_sensors(truth, p3, runs=n, seed=0) for n in (1, 3))
    >>> (one.compass[:, 0] == three.compass[:, 0]).all()
    np.True_
    """
    errors = from_settings(SensorErrors, settings)
    whole("runs", runs, 1)
    root = np.random.SeedSequence([whole("seed", seed), truth.seed])
    samples, epochs = truth.rotation.shape[1] - 1, len(truth.time)
    increments = np.empty((2, runs, samples, 3))  # as `Drive.increments` has them
    gps, compass = np.empty((2, epochs, 3, runs)), np.empty((epochs, runs))
    bias = np.empty((2, 3, runs))
    c, s = np.cos(errors.mounting_yaw), np.sin(errors.mounting_yaw)
    to_imu = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    ideal = to_imu @ truth.rotation, to_imu @ truth.velocity
    for run, child in enumerate(root.spawn(runs)):
        *triads, satellites, magnetic = map(np.random.default_rng, child.spawn(4))
        measured = [
            _triad(name, axes, errors, stream, truth.period)
            for name, axes, stream in zip(("gyro", "accelerometer"), ideal, triads, strict=True)
        ]
        bias[..., run] = [drift for _, drift in measured]
        corrected = as_increments(*(axes for axes, _ in measured))
        increments[:, run] = np.swapaxes(corrected, 1, 2)
        gps[..., run] = _gps(truth, errors, satellites)
        compass[:, run] = _compass(truth, errors, magnetic)
    return Drive(
        time=truth.time,
        period=truth.period,
        rotation_increments=np.moveaxis(increments[0], 0, 2),
        velocity_increments=np.moveaxis(increments[1], 0, 2),
        gps_position=gps[0],
        gps_velocity=gps[1],
        compass=compass,
        reference=replace(truth.reference, gyro_bias=bias[0], accelerometer_bias=bias[1]),
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


def gauss_markov(normal: Array, deviation: float, correlation_time: float, period: float) -> Array:
    r"""Return a stationary first-order Gauss-Markov process from normal numbers w, (..., steps).

    .. math::
        x_0 = \sigma w_0, \qquad x_{k+1} = \varphi x_k + \sigma\sqrt{1 - \varphi^2}\,w_{k+1},
        \qquad \varphi = e^{-T/\tau}

    A correlation time of zero makes white noise.
    """
    kept = np.exp(-period / correlation_time) if correlation_time > 0 else 0.0
    driven = deviation * np.sqrt(1 - kept**2) * normal
    driven[..., 0] = deviation * normal[..., 0]
    try:
        return np.asarray(lfilter([1.0], [1.0, -kept], driven))
    except ModuleNotFoundError:  # a page of the book has numpy alone: the same, slowly
        rows = (accumulate(row, lambda x, w: kept * x + w) for row in driven.tolist())
        return np.array([[*row] for row in rows])


def _velocity(motion: Kinematics) -> Array:
    """Return the velocity north, east, down, (steps, 3), m/s."""
    level = motion.speed * np.cos(motion.grade)
    north, east = level * np.cos(motion.course), level * np.sin(motion.course)
    return np.stack([north, east, -motion.speed * np.sin(motion.grade)], axis=1)


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
    moved = position + error.T / metres(position)
    return np.stack([moved, velocity + errors.gps_velocity_noise * speed.T])


def _compass(truth: Truth, errors: SensorErrors, rng: np.random.Generator) -> Array:
    """Return the measured yaw of one run in (-pi, pi], (epochs,), rad."""
    noise = errors.compass_noise * rng.standard_normal(len(truth.yaw))
    chance, side, size = rng.random((3, len(truth.yaw)))
    least, most = errors.compass_outlier_size
    outlier = np.where(side < 0.5, -1.0, 1.0) * (least + (most - least) * size)
    told = truth.yaw + errors.compass_bias + noise
    return wrapped(told + np.where(chance < errors.compass_outlier, outlier, 0.0))
