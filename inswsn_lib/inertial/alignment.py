r"""Where a filter starts: levelling at rest, and alignment in motion by a bank of searches.

In motion nothing is assumed of the start but wide limits: of the attitude only the tilt is
guessed, by the mean specific force. From each of several headings the most likely start is searched
for by the way of Gauss and Newton, with all errors linearised about the motion from the last one
that was found, first in two seconds of the data, then in windows twice as long each, so that no
step is far from linear. With the errors :math:`x_0` of a start, whose estimate and covariance by
all measurements :math:`z` are :math:`\hat x_0` and :math:`P_0^s`, a search goes down on

.. math::
    -\log p(z, x_0 = 0) = -\log p(z) - \log p(x_0 = 0 \mid z)
    = -\log p(z) + \tfrac12 \hat x_0' (P_0^s)^{-1} \hat x_0
    + \tfrac12 \log \det 2 \pi P_0^s ,

which one run of the filter gives: :math:`x_0` is a state of it that does not change (fixed-point
smoothing, Anderson and Moore, "Optimal Filtering", 1979, Section 7.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array, array, number
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.inertial.error_state import Solution, Start, run_error_state
from inswsn_lib.inertial.mechanization import ERRORS
from inswsn_lib.inertial.observations import Observation, RangesToAnchors, Sensor
from inswsn_lib.inertial.planar import OdometryMotion, PlanarState
from inswsn_lib.inertial.sensors import position as place
from inswsn_lib.inertial.strapdown import (
    ATTITUDE,
    FORCE_BIAS,
    RATE_BIAS,
    InertialMotion,
    InertialState,
)
from inswsn_lib.streams import Imu

#: Standard deviations that are assumed of position, velocity, attitude and both biases: wide
WIDE = (1000.0, 30.0, 2.0, 0.6, 0.06)
#: A heading is told if its standard deviation is below this, degrees
LARGEST_HEADING = 20.0
_HEADINGS, _PLANAR_HEADINGS = 6, 36
_FIRST, _FEWEST = 2.0, 3  # s of the first window, and measurements in it
_PASSES, _FIRST_PASSES = 30, 8  # of a search, in the last window and before it
_LARGEST_TURN = 0.7  # rad, of a step
_SHORTEST = 1e-3  # share of a step that is tried last
_SETTLED = 0.05  # mean square of a step in deviations, below which a search has settled
_UNLIKELY = 150.0  # by how much less likely a search is, in logarithms, that is given up
_AS_LIKELY = 12.0  # less than this, and two starts fit alike
_AGREEING = 2  # searches that must lead to a start
_PRIOR, _MISSED = 3.5, 3.0  # deviations of a bias, and of innovations in the mean
# s of which an IMU's means are compared, and in how many deviations they agree; m/s, and rad/s by
# the Earth, at rest
_BLOCK, _MOVED, _STILL, _EARTH_RATE = 0.5, 6.0, 0.02, 1e-4


def level(imu: Imu, heading: float = 0.0) -> Array:
    """Return the attitude of an IMU that is not accelerated, by its mean specific force, (3, 3).

    Parameters
    ----------
    imu : Imu
        What it says at rest or in a steady motion.
    heading : float
        Of the body's x axis against x, to the left, rad.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.inertial import level
    >>> from inswsn_lib.streams import Imu
    >>> still = Imu(np.arange(3.0), np.zeros((3, 3)), np.tile([0.0, 0.0, 9.8], (3, 1)))
    >>> level(still).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    up = imu.force.mean(axis=0)
    up = up / np.linalg.norm(up)
    ahead = np.eye(3)[np.argmin(np.abs(up))] if abs(up[0]) > 0.9 else np.array([1.0, 0.0, 0.0])
    ahead = ahead - up * (up @ ahead)
    ahead /= np.linalg.norm(ahead)
    levelled = np.stack([ahead, np.cross(up, ahead), up])
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, heading]).as_matrix() @ levelled)


def align(
    motion: InertialMotion,
    observations: Sequence[Observation],
    begin: float,
    end: float,
    *,
    deviations: Sequence[float] = WIDE,
    prior: Start | None = None,
    latest: float | None = None,
) -> Start:
    """Return where a filter starts at the end of a window, by the measurements in it.

    While the IMU says the same all the time nothing tells a heading that is not known, so that the
    search begins two seconds before that changes. A body at rest is not told from one that turns
    steadily: what that would say of the gyroscopes' biases is taken from `known_start` alone.

    Parameters
    ----------
    motion : InertialMotion
    observations : sequence of Observation
        Fixes and velocities. Ranges are far from linear in a position of which nothing is known.
    begin, end : float
        The window, s.
    deviations : sequence of float
        Standard deviations that are assumed at its beginning of position, m, velocity, m/s,
        attitude, rad, and the biases of accelerometers, m/s^2, and gyroscopes, rad/s.
    prior : Start, optional
        What is known of the state at the beginning, of `known_start`, in place of `deviations`.
    latest : float, optional
        Until when the window is made longer where no start in it can be trusted, s; by default it
        is not.

    Raises
    ------
    InswsnError
        If the window has no measurement, or there are ranges; and where no start can be trusted:
        the heading is not told, the search has not settled or is the only one that leads there,
        starts with other headings fit as well, biases are not those of the deviations, or
        measurements are missed by more than theirs.

    Examples
    --------
    A body that looks along y and is moved to and fro along x, to its right and to its left:

    >>> import numpy as np
    >>> from inswsn_lib import inertial as nav
    >>> from inswsn_lib.streams import Fixes, Imu
    >>> t, fixed = np.arange(0, 10.01, 0.01), np.arange(0.2, 10.1, 0.2)
    >>> force = np.stack([0 * t, -np.sin(t), 0 * t + 9.80665], axis=1)
    >>> imu = Imu(t, np.zeros((1001, 3)), force)
    >>> motion = nav.InertialMotion(imu, nav.ImuNoise(0.01, 0.001, 1e-4, 1e-5))
    >>> fixes = Fixes(fixed, np.outer(fixed - np.sin(fixed), [1.0, 0.0, 0.0]))
    >>> observed = [nav.PositionFixes(fixes, np.zeros(3), white=np.full(3, 0.01))]
    >>> start = nav.align(motion, observed, begin=0.0, end=10.0)
    >>> print(f"{start.state.velocity[0]:.1f} m/s, {1 - np.cos(10):.1f} m/s in truth")
    1.8 m/s, 1.8 m/s in truth
    >>> np.abs(start.state.attitude.round(1))[:, 0].tolist()  # where the body's nose is
    [0.0, 1.0, 0.0]
    """
    if any(isinstance(each, RangesToAnchors) for each in observations):
        raise InswsnError("Ranges do not align an INS: take fixes by multilateration of them.")
    if len(motion.imu.part(begin, end)) < 2:
        raise InswsnError(f"The IMU says nothing between {begin:.6g} and {end:.6g} s.")
    if prior is None:
        prior = known_start(motion.imu.part(begin, end), begin, deviations=deviations)
    while True:
        fits = _fitted(motion, observations, prior, end)
        try:
            _refuse_unlike(fits, f"between {begin:.6g} and {end:.6g} s")
        except InswsnError:
            if latest is None or end >= latest:
                raise
            end = min(2 * end - begin, latest)
        else:
            return fits[0].end


def align_planar(
    motion: OdometryMotion, observations: Sequence[Observation], begin: float, end: float,
    place: Array, deviations: Sequence[float] = (1.0, 0.1, 0.02),
) -> Start:  # fmt: skip
    """Return where a vehicle is at the end of a window, its heading by a bank of filters.

    One filter for each of 36 headings at the beginning runs over the window, and the one that makes
    the measurements most likely is taken. States of the observations are left behind.

    Parameters
    ----------
    motion : OdometryMotion
    observations : sequence of Observation
        Fixes or ranges.
    begin, end : float
        The window, s.
    place : ndarray, (2,)
        About where the vehicle is at its beginning, m.
    deviations : sequence of float
        Standard deviations at its beginning of position (m), scale and bias of the rate (rad/s).

    Raises
    ------
    InswsnError
        If the window has no measurement, or does not tell the heading.

    Examples
    --------
    Wheels say 1 m/s, fixes go along y:

    >>> import numpy as np
    >>> from inswsn_lib import inertial as nav
    >>> from inswsn_lib.streams import Fixes, Odometry
    >>> t = np.arange(0, 10.1, 0.1)
    >>> wheels = Odometry(t, speed=np.full(101, 1.0), rate=np.zeros(101))
    >>> motion = nav.OdometryMotion(wheels, nav.OdometryNoise(0.01, 0.001, 1e-4, 1e-5))
    >>> observed = [nav.PositionFixes(Fixes(t, np.outer(t, [0.0, 1.0])), np.zeros(2), np.ones(2))]
    >>> start = nav.align_planar(motion, observed, begin=0.0, end=10.0, place=np.zeros(2))
    >>> print(f"{np.degrees(start.state.heading):.0f} degrees")
    90 degrees
    """
    apart = 2 * np.pi / _PLANAR_HEADINGS
    where, scale, bias = deviations
    P0 = np.diag(np.square([where, where, apart, scale, bias]))
    fits = [
        run_error_state(
            motion, Start(begin, PlanarState(place, heading), P0), observations, end=end
        )
        for heading in apart * np.arange(_PLANAR_HEADINGS)
    ]
    best = max(fits, key=lambda fit: fit.log_likelihood)
    state, P = best.states[-1], best.covariances[-1][: PlanarState.errors, : PlanarState.errors]
    spread = float(np.degrees(np.sqrt(P[2, 2])))
    if not spread < LARGEST_HEADING:
        raise InswsnError(
            f"The heading cannot be told between {begin:.6g} and {end:.6g} s: its standard "
            f"deviation is {spread:.0f} degrees. Take a longer window, or one in which it moves."
        )
    return Start(float(best.time[-1]), replace(state, own=np.zeros(0)), P)


def _fitted(
    motion: InertialMotion, observations: Sequence[Observation], prior: Start, end: float
) -> list[_Fit]:
    """Return the searches' ends that are apart, the best first."""
    imu = motion.imu.part(prior.time, end)
    headings = np.zeros(1)
    if _spread(prior) > np.degrees(_LARGEST_TURN):
        prior = replace(prior, time=max(prior.time, _steady(imu) - _FIRST))
        headings = np.linspace(0, 2 * np.pi, _HEADINGS, endpoint=False)
    ends = _ends(observations, prior.time, end)
    turns = np.zeros((len(headings), ERRORS))
    turns[:, ATTITUDE] = np.outer(headings, prior.state.attitude[2])
    states = [prior.state.plus(turn) for turn in turns]
    fits = [_Fit.of(motion, observations, prior, state, ends[0]) for state in states]
    for last in ends:
        passes = _PASSES if last == end else _FIRST_PASSES
        fits = _apart([fit.until(last).settled(passes) for fit in fits])
    if fits[0].begins < _AGREEING:
        turns = np.outer([-_LARGEST_TURN, _LARGEST_TURN], fits[0].about.attitude[2])
        others = [fits[0].turned(turn).settled(_PASSES) for turn in turns]
        fits = _apart([*fits, *others])
    return fits


def known_start(
    imu: Imu,
    time: float,
    *,
    heading: tuple[float, float] | None = None,
    attitude: tuple[ArrayLike, float] | None = None,
    position: tuple[ArrayLike, float] | None = None,
    velocity: tuple[ArrayLike, float] | None = None,
    rest: float | None = None,
    deviations: Sequence[float] = WIDE,
) -> Start:
    """Return what is known of a start: values, each with its standard deviation.

    Of a body that is known to stand still the mean rate is the gyroscopes' bias, but for the turn
    of the Earth.

    Parameters
    ----------
    imu : Imu
        By whose first seconds the body is levelled where the attitude is not known.
    time : float
        s.
    heading : (float, float), optional
        Of the body's x axis against x, to the left, rad.
    attitude : (array_like (3, 3), float), optional
        Turns vectors of the body into the frame; rad.
    position, velocity : (array_like (3,), float), optional
        m and m/s.
    rest : float, optional
        Until when the body stands still, s: that is the time of the start.
    deviations : sequence of float
        What is assumed of the rest, as in `align`.

    Raises
    ------
    ParameterError
        If the attitude is no rotation, a deviation is not positive, or the rest has no samples.

    Examples
    --------
    A body at rest that looks along y, to 5 degrees:

    >>> import numpy as np
    >>> from inswsn_lib.inertial import known_start
    >>> from inswsn_lib.streams import Imu
    >>> still = Imu(np.arange(3.0), np.zeros((3, 3)), np.tile([0.0, 0.0, 9.8], (3, 1)))
    >>> start = known_start(still, 0.0, heading=(np.pi / 2, np.radians(5)))
    >>> start.state.attitude.round(3)[:, 0].tolist()
    [0.0, 1.0, 0.0]
    >>> np.degrees(np.sqrt(np.diag(start.covariance)[6:9])).round().tolist()
    [115.0, 115.0, 5.0]
    """
    sizes = np.repeat(np.asarray(deviations, dtype=float), 3)
    values = np.zeros((3, 3))
    steady = imu.part(time, time + _FIRST)
    if rest is not None:
        steady = imu.part(time, number("rest", rest, above=time))
        if len(steady) < 2:
            raise ParameterError("rest", rest, "a time with samples of the IMU before it")
        velocity = velocity or (np.zeros(3), _STILL)
        values[2] = steady.rate.mean(axis=0)
        sizes[RATE_BIAS] = steady.rate.std(axis=0) / np.sqrt(len(steady)) + _EARTH_RATE
    for i, (name, known) in enumerate((("position", position), ("velocity", velocity))):
        if known is not None:
            values[i] = array(name, known[0], (3,))
            sizes[3 * i : 3 * i + 3] = number(f"deviation of the {name}", known[1], above=0)
    turned = level(steady, heading[0] if heading else 0.0)
    if attitude is not None:
        turned = array("attitude", attitude[0], (3, 3))
        if np.abs(turned @ turned.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turned) < 0:
            raise ParameterError("attitude", turned.tolist(), "a rotation matrix")
        sizes[ATTITUDE] = number("deviation of the attitude", attitude[1], above=0)
    P = np.diag(np.square(sizes))
    if heading is not None and attitude is None:
        up = turned[2]
        wide = sizes[ATTITUDE][0] ** 2
        narrow = number("deviation of the heading", heading[1], above=0) ** 2
        P[ATTITUDE, ATTITUDE] = wide * np.eye(3) + (narrow - wide) * np.outer(up, up)
    state = InertialState(values[0], values[1], turned, rate_bias=values[2])
    return Start(time if rest is None else rest, state, P)


def _steady(imu: Imu) -> float:
    """Return until when the means of an IMU over half seconds are those of its first two, s."""
    begin = float(imu.time[0])
    # of as many blocks as there are rows, one has fewer than two
    blocks = np.floor((imu.time - begin) / _BLOCK).clip(max=len(imu)).astype(int)
    counts: Array = np.maximum(np.bincount(blocks), 1.0)
    values = np.column_stack([imu.rate, imu.force])
    sums = [np.bincount(blocks, column) for column in values.T]
    means = np.column_stack(sums) / counts[:, None]
    first = blocks < _FIRST / _BLOCK
    white = (values[first] - means[blocks[first]]).std(axis=0)
    apart = np.abs(means - values[first].mean(axis=0))
    moved = (apart > _MOVED * white / np.sqrt(counts)[:, None]).any(axis=1) | (counts < 2)
    return begin + _BLOCK * int(np.argmax(np.append(moved, True)))


def _ends(observations: Sequence[Observation], begin: float, end: float) -> list[float]:
    """Return where windows end: each is twice as long as the one before, the last is whole."""
    when = np.unique(np.concatenate([each.time for each in observations]))
    when = when[(when > begin) & (when <= end)]
    if not len(when):
        raise InswsnError(f"There is no measurement between {begin:.6g} and {end:.6g} s.")
    first = max(_FIRST, float(when[min(_FEWEST, len(when)) - 1]) - begin)
    ends = first * 2.0 ** np.arange(max(0, np.ceil(np.log2((end - begin) / first / 1.25))))
    return [*(begin + ends).tolist(), end]


@dataclass(frozen=True, eq=False)
class _Fit:
    """A start, and what the measurements say of its errors, linearised about its motion."""

    motion: InertialMotion
    observations: Sequence[Observation]
    prior: Start
    about: InertialState
    last: float  # s, of the window
    solution: Solution
    step: Array  # (15,), the estimate of the errors
    size: float  # mean square of the step in its deviations
    cost: float
    begins: int = 1  # of how many searches it is the end

    @classmethod
    def of(
        cls, motion: InertialMotion, observations: Sequence[Observation], prior: Start,
        about: InertialState, last: float,
    ) -> _Fit:  # fmt: skip
        """Run the filter, with the errors of the start as states."""
        P0 = prior.covariance
        remembered = Start(prior.time, prior.state, np.block([[P0, P0], [P0, P0]]))
        none, constant = np.zeros((0, 1)), np.full(ERRORS, np.inf)
        axis, zeros = np.zeros((1, 4)), np.zeros(ERRORS)
        memory = Sensor(place, none[:, 0], none, np.ones(1), axis, zeros, constant)
        observed: list[Observation] = [memory, *observations]
        found = run_error_state(motion, remembered, observed, end=last, about=about, kept=False)
        before = prior.state.minus(about)
        step = before + found.end.state.own[:ERRORS]
        P = found.end.covariance[ERRORS : 2 * ERRORS, ERRORS : 2 * ERRORS]
        scale = np.sqrt(np.diag(P))
        scaled = P / np.outer(scale, scale)
        square = float(step / scale @ np.linalg.solve(scaled, step / scale))
        logarithm = np.linalg.slogdet(scaled)[1] + 2 * np.log(scale).sum()
        cost = -found.log_likelihood + 0.5 * (square + float(logarithm))
        return cls(motion, observations, prior, about, last, found, step, square / ERRORS, cost)

    def until(self, last: float) -> _Fit:
        """Return the same start by a longer window."""
        return self if last == self.last else self._at(self.about, last)

    def settled(self, passes: int) -> _Fit:
        """Go down by the steps of Gauss and Newton, shortened until each leads down."""
        fit = self
        for _ in range(passes):
            if fit.size < _SETTLED:
                break
            share = min(1.0, _LARGEST_TURN / float(np.linalg.norm(fit.step[ATTITUDE])))
            tried = fit._at(fit.about.plus(share * fit.step), fit.last)
            while not tried.cost < fit.cost and share > _SHORTEST:
                share /= 3
                tried = fit._at(fit.about.plus(share * fit.step), fit.last)
            if not tried.cost < fit.cost:
                break
            fit = tried
        return fit

    def turned(self, turn: Array) -> _Fit:
        """Return another begin of a search: a start that is turned about axes of the body."""
        error = np.zeros(ERRORS)
        error[ATTITUDE] = turn
        return replace(self._at(self.about.plus(error), self.last), begins=1)

    def _at(self, about: InertialState, last: float) -> _Fit:
        found = _Fit.of(self.motion, self.observations, self.prior, about, last)
        return replace(found, begins=self.begins)

    @property
    def end(self) -> Start:
        """Where the filter starts: at the end of the window."""
        found = self.solution.end
        state = replace(found.state, own=np.zeros(0))
        return Start(found.time, state, found.covariance[:ERRORS, :ERRORS])

    @property
    def spread(self) -> float:
        """Standard deviation of the heading at the end, degrees."""
        return _spread(self.end)

    def off(self, other: _Fit, part: slice = slice(None)) -> float:
        """Return the square of how far another start lies from this one, in its deviations."""
        apart = self.end.state.minus(other.end.state)[part]
        return float(apart @ np.linalg.solve(self.end.covariance[part, part], apart))

    def is_like(self, other: _Fit) -> bool:
        """Return whether both searches found one start, within its deviations."""
        told = max(self.spread, other.spread) < LARGEST_HEADING / 2
        return told and self.off(other) < ERRORS


def _apart(fits: list[_Fit]) -> list[_Fit]:
    """Return fits from the best on that are not alike, without far less likely ones."""
    found: list[_Fit] = []
    for fit in sorted(fits, key=lambda fit: fit.cost):
        if found and fit.cost > found[0].cost + _UNLIKELY:
            break
        like = next((k for k, better in enumerate(found) if fit.is_like(better)), None)
        if like is None:
            found.append(fit)
        else:
            found[like] = replace(found[like], begins=found[like].begins + fit.begins)
    return found


def _refuse_unlike(fits: list[_Fit], window: str) -> None:
    """Raise an error where the best of some fits is no start to trust."""
    best = fits[0]
    if not best.spread < LARGEST_HEADING:
        raise InswsnError(
            f"The heading cannot be told {window}: its standard deviation is {best.spread:.0f} "
            "degrees, for want of acceleration. Take a longer window, or one with turns."
        )
    if best.size > _SETTLED:
        raise InswsnError(
            f"The search for a start {window} has not settled: its last step is "
            f"{best.size**0.5:.2g} deviations. Take a longer window, or say what is known."
        )
    if best.begins < _AGREEING:
        raise InswsnError(
            f"Of the searches for a start {window} only one leads there. Take a longer window, or "
            "say what is known."
        )
    for fit in fits[1:]:
        if fit.cost < best.cost + _AS_LIKELY and best.off(fit, ATTITUDE) > _PRIOR**2:
            one, other = (f"{_heading(each.end.state):.0f}" for each in (best, fit))
            raise InswsnError(
                f"Two starts fit alike {window}, with headings of {one} and {other} degrees. Take "
                "a longer window, or one with turns."
            )
    assumed = np.sqrt(np.diag(best.prior.covariance))
    for name, part, bias, unit in (
        ("accelerometers", FORCE_BIAS, best.about.force_bias, "m/s^2"),
        ("gyroscopes", RATE_BIAS, best.about.rate_bias, "rad/s"),
    ):
        off = np.abs(best.about.minus(best.prior.state)[part])
        if (off > _PRIOR * assumed[part]).any():
            raise InswsnError(
                f"The start {window} needs a bias of the {name} of {np.abs(bias).max():.2g} "
                f"{unit}, which its assumed deviation of {assumed[part].max():.2g} {unit} "
                "excludes. Check units and axes, or give larger deviations."
            )
    missed = [float(np.nanmean(each.squares)) for each in best.solution.innovations[1:]]
    if max(missed) > _MISSED**2:
        raise InswsnError(
            f"The start {window} misses measurements by {max(missed) ** 0.5:.2g} times their "
            "deviations in the mean. Check clocks, units and axes, or give larger deviations."
        )


def _spread(start: Start) -> float:
    """Return the standard deviation of the heading, degrees."""
    up = start.state.attitude[2]  # the axis upwards, in axes of the body
    return float(np.degrees(np.sqrt(up @ start.covariance[ATTITUDE, ATTITUDE] @ up)))


def _heading(state: InertialState) -> float:
    """Return the heading of the body's x axis, degrees."""
    return float(np.degrees(np.arctan2(state.attitude[1, 0], state.attitude[0, 0])))
