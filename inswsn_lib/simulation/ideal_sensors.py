"""What ideal inertial sensors integrate along a motion: the simulator of `pyins`, in less time.

The formulas are those of `pyins.sim.generate_imu`, to which a test holds them. Rotations are
written out here, where they are made of angles one by one there, and the spline through them is
solved in three equations alike, since the turn in one sample is small.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import solve_banded

from inswsn_lib.checks import Array
from inswsn_lib.inertial.earth import ECCENTRICITY, RATE, normal_gravity, radii

_MOST, _CLOSE = 20, 1e-12  # solutions, and rad/s from one to the next
_HALVINGS = 50  # of an error of 1 rad/s, to below rounding


def ideal_sensors(
    time: Array, start: Array, attitude: Array, velocity: Array
) -> tuple[Array, Array, Array, Array]:
    """Integrate a motion, and what sensors in the vehicle's axes feel of it.

    Parameters
    ----------
    time : ndarray, (steps,)
        s.
    start : ndarray, (3,)
        Latitude, longitude (degrees), height (m).
    attitude, velocity : ndarray, (steps, 3)
        Roll, pitch, yaw (rad); north, east, down (m/s).

    Returns
    -------
    place : ndarray, (steps, 3)
        As the start.
    body : ndarray, (steps, 3, 3)
        From the body's axes to north, east, down.
    rotation, push : ndarray, (3, steps)
        The integrals of angular rate (rad) and specific force (m/s) over each sample, as `Truth`
        has them.
    """
    place = _places(time, start, velocity)
    # in this order, so that positions are rounded as by pyins: they are differentiated twice
    latitude, longitude = np.deg2rad(place[:, 0]), np.deg2rad(place[:, 1] + np.rad2deg(RATE) * time)
    _, normal = radii(np.column_stack([latitude, longitude, 0.0 * latitude]))
    parallel = (normal + place[:, 2]) * np.cos(latitude)
    frame = _turn(longitude, 2, _turn(-np.pi / 2 - latitude, 1))
    body = _turn(attitude[:, 2], 2, _turn(attitude[:, 1], 1, _turn(attitude[:, 0], 0)))
    axes = frame @ body

    along = ((1 - ECCENTRICITY) * normal + place[:, 2]) * np.sin(latitude)
    r = np.column_stack([parallel * np.cos(longitude), parallel * np.sin(longitude), along])
    moved = (frame @ velocity[:, :, None])[..., 0]
    moved[:, 0] -= RATE * r[:, 1]
    moved[:, 1] += RATE * r[:, 0]
    pull = np.zeros((len(time), 3))  # of the mass of the Earth alone
    pull[:, 0] = RATE**2 * parallel * np.sin(latitude)
    pull[:, 2] = normal_gravity(np.sin(latitude), place[:, 2])
    pull[:, 2] += RATE**2 * parallel * np.cos(latitude)
    pull = (frame @ pull[:, :, None])[..., 0]

    steps = np.diff(time)
    # the acceleration of the cubic through positions and velocities: it is linear in a step
    each = steps[:, None]
    slope = np.diff(r, axis=0) / each
    bent = (moved[:-1] + moved[1:] - 2 * slope) / each
    to_body = np.swapaxes(axes[:-1], 1, 2)
    force = to_body @ (2 * ((slope - moved[:-1]) / each - bent) - pull[:-1])[:, :, None]
    change = to_body @ (6 * (bent / each) - np.diff(pull, axis=0) / each)[:, :, None]
    rotation = _rotation_spline(to_body @ axes[1:], steps)
    sensed = _integrals(steps, *rotation, force[..., 0].T.copy(), change[..., 0].T.copy())
    # a sample before the start, at rest
    turn, push = (np.concatenate([x[:, :1], x], axis=1) for x in sensed)
    return place, body, turn, push


def as_increments(rotation: Array, push: Array) -> tuple[Array, Array]:
    """Return rotation vectors and velocity increments as in `Drive`, each (3, samples).

    What sensors integrate, (3, samples + 1), is corrected for coning and sculling, and for the
    rotation in a sample, on the model that rate and force are linear over two of them:
    `pyins.strapdown.compute_increments_from_imu`.
    """
    (before, turn), (pushed, force) = ((x[:, :-1], x[:, 1:]) for x in (rotation, push))
    sculling = (_cross(before, force) + _cross(pushed, turn)) / 12
    return turn + _cross(before, turn) / 12, force + sculling + 0.5 * _cross(turn, force)


def _integrals(dt: Array, a: Array, b: Array, c: Array, d: Array, e: Array) -> tuple[Array, Array]:
    """Return the integrals over each sample of the angular rate and of the specific force.

    The rotation vector is a t + b t^2 + c t^3, the force in the axes at the beginning d + e t.
    """
    ab, ac, bc = _cross(a, b), _cross(a, c), _cross(b, c)
    rates = (
        a,
        2 * b,
        3 * c - 0.5 * ab,
        _cross(a, ab) / 6 - ac,
        _cross(a, ac) / 3 + _cross(b, ab) / 6 - 0.5 * bc,
        _cross(a, bc) / 6 + _cross(b, ac) / 3 + _cross(c, ab) / 6,
        _cross(b, bc) / 6 + _cross(c, ac) / 3,
        _cross(c, bc) / 6,
    )
    # what the turn does to the force, to first and, by halves, to second order
    turned = _cross(a, d), _cross(a, e) + _cross(b, d), _cross(b, e) + _cross(c, d), _cross(c, e)
    forces = [d, e - turned[0], *(-x for x in turned[1:]), *np.zeros((3, *d.shape))]
    for i, axis in enumerate((a, b, c)):
        for j, x in enumerate(turned):
            forces[2 + i + j] += 0.5 * _cross(axis, x)
    return _by_powers(dt, rates), _by_powers(dt, forces)


def _by_powers(dt: Array, terms: Sequence[Array]) -> Array:
    """Integrate a polynomial from 0 to dt."""
    total = np.zeros_like(terms[0])
    for k in reversed(range(len(terms))):
        total += terms[k] / (k + 1)
        total *= dt
    return total


def _cross(a: Array, b: Array) -> Array:
    """Return products of vectors, each (3, steps), much faster than numpy of (steps, 3)."""
    found = np.empty_like(a)
    for i, (j, k) in enumerate(((1, 2), (2, 0), (0, 1))):
        found[i] = a[j] * b[k] - a[k] * b[j]
    return found


def _places(time: Array, start: Array, velocity: Array) -> Array:
    """Integrate the velocity on the ellipsoid, degrees and m, (steps, 3)."""
    north, east, down = velocity.T
    height = start[2] + _integral(time, -down)
    first = latitude = np.deg2rad(start[0]) + 0.0 * height
    for _ in range(3):
        meridian, _ = _radii(latitude, height)
        before = latitude
        latitude = first + _integral(time, north / meridian)
        if np.all(np.abs((before - latitude) * meridian) < 0.01):
            break
    turned = _integral(time, east / _radii(latitude, height)[1])
    return np.column_stack([np.rad2deg(latitude), start[1] + np.rad2deg(turned), height])


def _integral(time: Array, values: Array) -> Array:
    """Return the integral of a cubic spline through values up to each time."""
    try:
        return np.asarray(CubicSpline(time, values).antiderivative()(time))
    except ModuleNotFoundError:  # a page of the book has numpy alone: slopes by differences
        steps, bent = np.diff(time), np.diff(np.gradient(values, time))
        parts = steps * (values[:-1] + values[1:]) / 2 - steps**2 * bent / 12
        return np.concatenate([[0.0], np.cumsum(parts)])


def _radii(latitude: Array, height: Array) -> tuple[Array, Array]:
    """Return the radii of the meridian and of the parallel, m, rounded as by pyins."""
    latitude = np.deg2rad(np.rad2deg(latitude))
    meridian, transverse = radii(np.stack([latitude, 0.0 * height, height], axis=-1))
    return meridian, transverse * np.sqrt(1 - np.sin(latitude) ** 2)


def _turn(angle: Array, axis: int, right: Array | None = None) -> Array:
    """Return rotations about an axis, times others, (steps, 3, 3)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = np.cos(angle), np.sin(angle)
    if right is None:
        turned = np.zeros((len(angle), 3, 3))
        turned[:, axis, axis] = 1.0
        turned[:, i, i] = turned[:, j, j] = cosine
        turned[:, i, j], turned[:, j, i] = -sine, sine
        return turned
    turned = right.copy()
    cosine, sine = cosine[:, None], sine[:, None]
    turned[:, i] = cosine * right[:, i] - sine * right[:, j]
    turned[:, j] = sine * right[:, i] + cosine * right[:, j]
    return turned


def _rotation_spline(turns: Array, steps: Array) -> tuple[Array, Array, Array]:
    r"""Return a, b, c of the rotation vectors :math:`a t + b t^2 + c t^3`, each (3, steps).

    The turns of the steps are matrices, (steps, 3, 3). Rate and acceleration are continuous, and at
    both ends the rate is that of the step's mean, as in scipy's `RotationSpline`. Were all turns
    about one axis this would be the spline of an angle; what couples the axes is as small as the
    turns, and is put right by the solution before.
    """
    # half of the antisymmetric part is the axis times the sine of the angle
    r = 0.5 * np.stack([turns[:, k, j] - turns[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))])
    sine = np.sqrt((r**2).sum(axis=0))
    angle = np.arctan2(sine, 0.5 * (np.trace(turns, axis1=1, axis2=2) - 1))
    r *= np.where(sine > 0, angle, 1.0) / np.where(sine > 0, sine, 1.0)
    q = (r**2).sum(axis=0)  # each series goes on below rounding, the turn being at most 0.3
    k0 = 1 / 12 + q * (1 / 720 + q * (1 / 30240 + q / 1209600))
    k1 = 1 / 2 - q * (1 / 24 - q * (1 / 720 - q / 40320))
    k2 = 1 / 6 - q * (1 / 120 - q * (1 / 5040 - q / 362880))
    k3 = 1 / 12 - q * (1 / 180 - q * (1 / 6720 - q / 453600))
    k4 = -1 / 60 + q * (1 / 1260 - q * (1 / 60480 - q / 4989600))
    ends = r / steps  # the rate at the end of each step; that of the last stays
    near, far = 2 / steps[:-1], 2 / steps[1:]
    bands = np.zeros((3, len(near)))
    bands[0, 1:], bands[1], bands[2, :-1] = near[1:], 2 * near + 2 * far, far[:-1]
    told = 3 * (r[:, :-1] / steps[:-1] * near + r[:, 1:] / steps[1:] * far)
    first = ends[:, :1].copy()
    for _ in range(_MOST):
        # from the rate to the derivative of the vector at the end of a step, and back at its start
        begins = np.concatenate([first, ends[:, :-1]], axis=1)
        across = _cross(r, ends)
        slopes = ends + 0.5 * across + k0 * _cross(r, across)
        across = _cross(r, begins)
        back = -k1 * across + k2 * _cross(r, across)
        across = _cross(r, slopes)
        bent = (r * slopes).sum(axis=0) * (k3 * across + k4 * _cross(r, across))
        bent += k2 * _cross(slopes, across)
        right = told - bent[:, :-1]
        right -= near * back[:, :-1] + far * (slopes - ends)[:, 1:]
        right[:, 0] -= near[0] * first[:, 0]
        right[:, -1] -= far[-1] * ends[:, -1]
        found = _solved(bands, right, ends[:, :-1])
        moved = np.abs(found - ends[:, :-1]) > _CLOSE * (1 + np.abs(found))
        ends[:, :-1] = found
        if not moved.any():
            break
    begins = np.concatenate([first, ends[:, :-1]], axis=1)
    b = (3 * r / steps - 2 * begins - slopes) / steps
    c = (begins + slopes - 2 * r / steps) / steps**2
    return begins, b, c


def _solved(bands: Array, right: Array, near: Array) -> Array:
    """Solve systems of three bands, as `solve_banded` has them; right sides (3, steps)."""
    try:
        return np.asarray(solve_banded((1, 1), bands, right.T).T)
    except ModuleNotFoundError:  # by Jacobi: each turn halves the error at least
        found = near
        for _ in range(_HALVINGS):
            rest = right.copy()
            rest[:, :-1] -= bands[0, 1:] * found[:, 1:]
            rest[:, 1:] -= bands[2, :-1] * found[:, :-1]
            found = rest / bands[1]
        return found
