r"""How small a mean position error can be when the mean velocity error is known.

An uncorrected INS obeys P1 (2.1) without noise, :math:`p_{k+1} = p_k + T v_k`. If the velocity
error :math:`v_k` is a polynomial in time (constant acceleration error: degree 1; acceleration
error that grows with a tilt: degree 2), then a published pair of mean :math:`|p|` and mean
:math:`|v|` bounds the sampling period :math:`T` from above. No simulation is involved.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from inswsn_lib.errors import InswsnError, ParameterError

Array = NDArray[np.float64]

_MAX_DEGREE = 2
_CERTIFICATE_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Motion:
    """A class of INS velocity errors.

    Parameters
    ----------
    name : str
        A few words for the reader.
    degree : int
        Degree of the velocity error as a polynomial in time, 0 to 2.
    one_sign : bool
        True: the velocity error keeps one sign, and the position error starts at zero or with
        that sign, so both keep it. False: any polynomial, with any initial position error.

    Raises
    ------
    ParameterError
        If the degree is not 0, 1 or 2.

    Examples
    --------
    A velocity error that a constant acceleration error makes, and one that is refused:

    >>> from inswsn_lib.evaluation import Motion
    >>> Motion("linear, one sign", degree=1, one_sign=True).degree
    1
    >>> Motion("cubic", degree=3, one_sign=True)
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: degree is 3; it may be a whole number from 0 to 2.
    """

    name: str
    degree: int
    one_sign: bool

    def __post_init__(self) -> None:
        if not 0 <= self.degree <= _MAX_DEGREE:
            raise ParameterError("degree", self.degree, f"a whole number from 0 to {_MAX_DEGREE}")


#: The four classes that the book uses
MOTIONS = (
    Motion("linear, one sign", 1, True),
    Motion("quadratic, one sign", 2, True),
    Motion("linear, any signs", 1, False),
    Motion("quadratic, any signs", 2, False),
)


@dataclass(frozen=True)
class DriftBound:
    r"""A lower bound on the mean position error over a window.

    Attributes
    ----------
    motion : Motion
        The class of velocity errors that it holds for.
    samples : int
        Number :math:`n` of samples in the window.
    ratio : float
        The least value of
        :math:`\overline{|p|} / (n T\, \overline{|v|})` in the class, dimensionless.
    position, velocity : ndarray, shape (samples,)
        A motion that attains it, for T = 1 s, in m and m/s.
    residual : float
        Largest violation of the certificates of optimality, relative.

    Examples
    --------
    The motion that attains the bound of `drift_bound` obeys P1 (2.1), and its means are in the
    ratio:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import MOTIONS, drift_bound
    >>> bound = drift_bound(MOTIONS[0], 50)
    >>> bool(np.allclose(np.diff(bound.position), bound.velocity[:-1]))
    True
    >>> share = np.abs(bound.position).mean() / (50 * np.abs(bound.velocity).mean())
    >>> print(f"{share:.4f} {bound.ratio:.4f}")
    0.3200 0.3200
    """

    motion: Motion
    samples: int
    ratio: float
    position: Array
    velocity: Array
    residual: float


def drift_bound(motion: Motion, samples: int) -> DriftBound:
    r"""Find the least mean position error, per unit of mean velocity error, in a class of motions.

    Minimise :math:`\overline{|p|}/(n T\,\overline{|v|})` over :math:`p_{k+1} = p_k + T v_k`,
    with :math:`v_k` a polynomial of the class, means over :math:`k = 0, \dots, n-1`.

    Parameters
    ----------
    motion : Motion
        The class of velocity errors.
    samples : int
        Number of samples in the window, 4 or more.

    Returns
    -------
    DriftBound
        The bound, a motion that attains it, and the residual of its certificate.

    Raises
    ------
    ParameterError
        If `samples` is less than 4.
    InswsnError
        If the certificate of optimality does not hold.

    Notes
    -----
    One sign: with :math:`v_k \ge 0` and :math:`p_0 = 0` the least :math:`\overline{p}` with
    :math:`\overline{v} = 1` is a linear program. Its dual is the largest :math:`\lambda` for which
    weights :math:`w_k \ge 0` exist with
    :math:`\overline{p} = \lambda \overline{v} + \sum_k w_k v_k` for all polynomials.

    Any signs: :math:`\overline{|v|}` is the largest :math:`\overline{s_k v_k}` over sign
    patterns :math:`s`, and a polynomial of degree :math:`d` changes sign at most :math:`d`
    times. For each pattern the least :math:`\overline{|p|}` with :math:`\overline{s_k v_k} = 1`
    is a linear program. Its dual is the largest :math:`\lambda` for which weights
    :math:`|w_k| \le 1/n` exist with :math:`\sum_k w_k p_k = \lambda\, \overline{s_k v_k}` for all
    polynomials. The bound is the least :math:`\lambda` of all patterns.

    In both cases the weights prove the bound to whoever has them, whatever solver found them, and
    a motion that attains it shows that it is the best. ``residual`` is how far the weights of any
    pattern, or the motion, miss.

    Examples
    --------
    A velocity error that is linear and of one sign does least to the position if it begins at zero:
    with :math:`v_k = k` the ratio is :math:`(n - 2)/3n`. For one that is quadratic the bound tends
    to :math:`(3 - \sqrt 3)/6`, by the nodes of Gauss and Legendre.

    >>> from inswsn_lib.evaluation import MOTIONS, drift_bound
    >>> print(f"{drift_bound(MOTIONS[0], 100).ratio:.4f} {98 / 300:.4f}")
    0.3267 0.3267
    >>> print(f"{drift_bound(MOTIONS[1], 1000).ratio:.3f} {(3 - 3**0.5) / 6:.3f}")
    0.211 0.211
    """
    if samples < 4:
        raise ParameterError("samples", samples, "a whole number of at least 4")
    position, velocity = _monomials(motion.degree, samples)
    if motion.one_sign:
        return _one_sign_bound(motion, samples, position, velocity)
    return _free_bound(motion, samples, position, velocity)


def longest_period(position: float, velocity: float, bound: DriftBound) -> float:
    r"""Return the longest sampling period that a published pair of means allows.

    .. math:: T \le \frac{\overline{|p|}}{\overline{|v|}\; n\; \text{ratio}}

    Parameters
    ----------
    position, velocity : float
        Mean absolute position error in m and velocity error in m/s over the window, positive.
    bound : DriftBound
        The bound for the class of motions and the number of samples.

    Returns
    -------
    float
        The longest T that the class of motions allows, s.

    Raises
    ------
    ParameterError
        If a mean is not positive and finite.

    Examples
    --------
    A mean of 10 m beside one of 2 m/s, over 50 samples, of a velocity error that grows evenly:

    >>> from inswsn_lib.evaluation import MOTIONS, drift_bound, longest_period
    >>> bound = drift_bound(MOTIONS[0], 50)  # its ratio is 0.32
    >>> print(f"{longest_period(10.0, 2.0, bound):.4f} s")
    0.3125 s
    """
    for name, mean in (("position", position), ("velocity", velocity)):
        if not 0 < mean < np.inf:
            raise ParameterError(name, mean, "a positive, finite mean error")
    return float(position / (velocity * bound.samples * bound.ratio))


def _monomials(degree: int, samples: int) -> tuple[Array, Array]:
    """Return p (samples, degree + 2) and v (samples, degree + 1) of the scaled monomials, T = 1 s.

    Column j of v is (k/n)^j; column j of p is the sum of v before k; the last column of p is the
    initial position error, in which nothing of v moves.
    """
    k = np.arange(samples) / samples
    velocity = k[:, None] ** np.arange(degree + 1)
    travelled = np.vstack([np.zeros(degree + 1), np.cumsum(velocity, axis=0)[:-1]])
    return np.hstack([travelled, np.ones((samples, 1))]), velocity


def _one_sign_bound(motion: Motion, samples: int, position: Array, velocity: Array) -> DriftBound:
    basis, triangle = np.linalg.qr(velocity)
    ways = position[:, :-1] @ np.linalg.inv(triangle)  # an initial error would only add
    value, weights, coefficients = _largest_multiplier(
        basis, ways.mean(axis=0), basis.mean(axis=0), (0.0, np.inf)
    )
    p, v = ways @ coefficients, basis @ coefficients
    scale = np.abs(v).mean()
    residual = max(
        float(np.abs(ways.mean(axis=0) - value * basis.mean(axis=0) - weights @ basis).max()),
        -float(weights.min()),
        -float(v.min() / scale),
        float(abs(p.mean() / (value * v.mean()) - 1.0)),
    )
    return _certified(DriftBound(motion, samples, value / samples, p, v, residual))


def _free_bound(motion: Motion, samples: int, position: Array, velocity: Array) -> DriftBound:
    # an orthonormal basis of the position errors keeps the equations well scaled
    basis, triangle = np.linalg.qr(position)
    rates = np.hstack([velocity, np.zeros((samples, 1))]) @ np.linalg.inv(triangle)
    best, best_coefficients, residual = np.inf, np.zeros(basis.shape[1]), 0.0
    for pattern in _sign_patterns(samples, motion.degree):
        target = pattern @ rates / samples
        value, weights, coefficients = _largest_multiplier(
            basis, np.zeros(basis.shape[1]), target, (-1 / samples, 1 / samples)
        )
        residual = max(
            residual,
            float(np.abs(weights @ basis + value * target).max() / np.abs(value * target).max()),
            float(samples * np.abs(weights).max() - 1.0),
        )
        if value < best:
            best, best_coefficients = value, coefficients
    p, v = basis @ best_coefficients, rates @ best_coefficients
    residual = max(residual, float(abs(np.abs(p).mean() / (best * np.abs(v).mean()) - 1.0)))
    return _certified(DriftBound(motion, samples, best / samples, p, v, residual))


def _certified(bound: DriftBound) -> DriftBound:
    if bound.residual > _CERTIFICATE_TOLERANCE:
        raise InswsnError(
            f"The drift bound for {bound.samples} samples, velocity error {bound.motion.name}, "
            f"misses its certificate by {bound.residual:.1e}."
        )
    return bound


def _sign_patterns(samples: int, changes: int) -> list[Array]:
    """Return all rows of signs, first +1, that change at most `changes` times."""
    index = np.arange(samples)
    patterns = []
    for count in range(changes + 1):
        for places in combinations(range(1, samples), count):
            flips = np.searchsorted(np.array(places), index, side="right")
            patterns.append(np.where(flips % 2 == 0, 1.0, -1.0))
    return patterns


def _largest_multiplier(
    basis: Array, constant: Array, target: Array, limits: tuple[float, float]
) -> tuple[float, Array, Array]:
    """Return the largest x with constant = x target + w @ basis, w, and the multipliers.

    The weights w are within limits. The multipliers of the equations are the coefficients of the
    motion that attains the bound.
    """
    samples = basis.shape[0]
    solution = linprog(
        c=np.append(np.zeros(samples), -1.0),
        A_eq=np.hstack([basis.T, target[:, None]]),
        b_eq=constant,
        bounds=[limits] * samples + [(None, None)],
        method="highs",
    )
    if solution.status != 0:
        raise InswsnError(f"The linear program of the drift bound failed: {solution.message}")
    return float(solution.x[-1]), solution.x[:-1], -np.asarray(solution.eqlin.marginals)
