r"""How small a mean position error can be when the mean velocity error is known.

An uncorrected INS obeys P1 (2.1) without noise, :math:`p_{k+1} = p_k + T v_k`. If the velocity
error :math:`v_k` is a polynomial in time (constant acceleration error: degree 1; acceleration
error that grows with a tilt: degree 2), then a published pair of mean :math:`|p|` and mean
:math:`|v|` bounds the sampling period :math:`T` from above. No simulation is involved.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from highspy import Highs, HighsModelStatus

from inswsn_lib.checks import Array, number, whole
from inswsn_lib.errors import InswsnError

_MOST_DEGREE = 2
_CERTIFICATE_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Motion:
    """A class of INS velocity errors.

    Attributes
    ----------
    name : str
        A few words for the reader.
    degree : int
        Degree of the velocity error as a polynomial in time, 0 to 2.
    one_sign : bool
        True: the velocity error keeps one sign, and the position error starts at zero or with
        that sign, so both keep it. False: any polynomial, with any initial position error.

    Examples
    --------
    A velocity error that a constant acceleration error makes:

    >>> from inswsn_lib.evaluation import Motion
    >>> Motion("linear, one sign", degree=1, one_sign=True).degree
    1
    """

    name: str
    degree: int
    one_sign: bool

    def __post_init__(self) -> None:
        whole("degree", self.degree, 0, _MOST_DEGREE)


#: The four classes that the book uses
MOTIONS = (
    Motion("linear, one sign", 1, True),
    Motion("quadratic, one sign", 2, True),
    Motion("linear, any signs", 1, False),
    Motion("quadratic, any signs", 2, False),
)


@dataclass(frozen=True)
class DriftBound:
    r"""A lower bound on the mean position error over a window of n samples, from `drift_bound`.

    Attributes
    ----------
    motion, samples : Motion, int
        The class of velocity errors that it holds for, and n.
    ratio : float
        The least :math:`\overline{|p|} / (n T\, \overline{|v|})` in the class, dimensionless.
    position, velocity : ndarray, (samples,)
        A motion that attains it, for T = 1 s, in m and m/s.
    residual : float
        Largest violation of the certificates of optimality, relative.
    """

    motion: Motion
    samples: int
    ratio: float
    position: Array
    velocity: Array
    residual: float

    def __post_init__(self) -> None:
        if self.residual > _CERTIFICATE_TOLERANCE:
            raise InswsnError(
                f"The drift bound for {self.samples} samples, velocity error {self.motion.name}, "
                f"misses its certificate by {self.residual:.1e}."
            )


def drift_bound(motion: Motion, samples: int) -> DriftBound:
    r"""Find the least mean position error, per unit of mean velocity error, in a class of motions.

    Minimise :math:`\overline{|p|}/(n T\,\overline{|v|})` over :math:`p_{k+1} = p_k + T v_k`,
    with :math:`v_k` a polynomial of the class, means over :math:`k = 0, \dots, n-1`.

    Parameters
    ----------
    motion : Motion
        The class of velocity errors.
    samples : int
        n, 4 or more.

    Raises
    ------
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
    with :math:`v_k = k` the ratio is :math:`(n - 2)/3n`.

    >>> from inswsn_lib.evaluation import MOTIONS, drift_bound
    >>> print(f"{drift_bound(MOTIONS[0], 100).ratio:.4f} {98 / 300:.4f}")
    0.3267 0.3267
    """
    whole("samples", samples, 4)
    # p and v of the monomials (k/n)^j, T = 1 s; a last column of p stands for its first value
    k = np.arange(samples) / samples
    velocity = k[:, None] ** np.arange(motion.degree + 1)
    travelled = np.vstack([np.zeros(motion.degree + 1), np.cumsum(velocity, axis=0)[:-1]])
    if motion.one_sign:  # an initial error would only add
        return _one_sign_bound(motion, samples, travelled, velocity)
    position = np.hstack([travelled, np.ones((samples, 1))])
    return _free_bound(motion, samples, position, np.hstack([velocity, np.zeros((samples, 1))]))


def longest_period(position: float, velocity: float, bound: DriftBound) -> float:
    r"""Return the longest sampling period that a published pair of means allows, s.

    .. math:: T \le \frac{\overline{|p|}}{\overline{|v|}\; n\; \text{ratio}}

    Parameters
    ----------
    position, velocity : float
        Mean absolute position error in m and velocity error in m/s over the window, positive.
    bound : DriftBound
        The bound for the class of motions and the number of samples.

    Examples
    --------
    A mean of 10 m beside one of 2 m/s, over 50 samples, of a velocity error that grows evenly:

    >>> from inswsn_lib.evaluation import MOTIONS, drift_bound, longest_period
    >>> print(f"{longest_period(10.0, 2.0, drift_bound(MOTIONS[0], 50)):.4f}")  # its ratio is 0.32
    0.3125
    """
    number("position", position, above=0)
    number("velocity", velocity, above=0)
    return float(position / (velocity * bound.samples * bound.ratio))


def _one_sign_bound(motion: Motion, samples: int, position: Array, velocity: Array) -> DriftBound:
    basis, triangle = np.linalg.qr(velocity)
    ways = position @ np.linalg.inv(triangle)
    target = basis.mean(axis=0)
    ((value, weights, coefficients),) = _largest_multipliers(
        basis, ways.mean(axis=0), [target], (0.0, np.inf)
    )
    p, v = ways @ coefficients, basis @ coefficients
    residual = max(
        float(np.abs(ways.mean(axis=0) - value * target - weights @ basis).max()),
        -float(weights.min()),
        -float(v.min() / np.abs(v).mean()),
        float(abs(p.mean() / (value * v.mean()) - 1.0)),
    )
    return DriftBound(motion, samples, value / samples, p, v, residual)


def _free_bound(motion: Motion, samples: int, position: Array, velocity: Array) -> DriftBound:
    # an orthonormal basis of the position errors keeps the equations well scaled
    basis, triangle = np.linalg.qr(position)
    rates = velocity @ np.linalg.inv(triangle)
    least, attained, residual = np.inf, np.zeros(basis.shape[1]), 0.0
    targets = [pattern @ rates / samples for pattern in _sign_patterns(samples, motion.degree)]
    found = _largest_multipliers(
        basis, np.zeros(basis.shape[1]), targets, (-1 / samples, 1 / samples)
    )
    for target, (value, weights, coefficients) in zip(targets, found, strict=True):
        residual = max(
            residual,
            float(np.abs(weights @ basis + value * target).max() / np.abs(value * target).max()),
            float(samples * np.abs(weights).max() - 1.0),
        )
        if value < least:
            least, attained = value, coefficients
    p, v = basis @ attained, rates @ attained
    residual = max(residual, float(abs(np.abs(p).mean() / (least * np.abs(v).mean()) - 1.0)))
    return DriftBound(motion, samples, least / samples, p, v, residual)


def _sign_patterns(samples: int, changes: int) -> list[Array]:
    """Return all rows of signs, first +1, that change at most `changes` times."""
    index = np.arange(samples)
    patterns = []
    for count in range(changes + 1):
        for places in combinations(range(1, samples), count):
            flips = np.searchsorted(np.array(places), index, side="right")
            patterns.append(np.where(flips % 2 == 0, 1.0, -1.0))
    return patterns


def _largest_multipliers(
    basis: Array, constant: Array, targets: Iterable[Array], limits: tuple[float, float]
) -> Iterator[tuple[float, Array, Array]]:
    """Give the largest x with constant = x target + w @ basis, w within limits, and multipliers.

    The multipliers of the equations are the coefficients of the motion that attains the bound. One
    program serves all targets, each from the answer to the one before: neighbours are a step apart.
    """
    samples = len(basis)
    program = Highs()
    program.setOptionValue("output_flag", False)
    low, high = ([limit] * samples for limit in limits)
    program.addVars(samples + 1, np.array([*low, -np.inf]), np.array([*high, np.inf]))
    program.changeColCost(samples, -1.0)
    columns = np.arange(samples + 1, dtype=np.int32)
    for equals, row in zip(constant, basis.T, strict=True):
        program.addRow(equals, equals, samples + 1, columns, np.append(row, 0.0))
    for target in targets:
        for row, entry in enumerate(target):
            program.changeCoeff(row, samples, entry)
        program.run()
        status = program.getModelStatus()
        if status != HighsModelStatus.kOptimal:
            said = program.modelStatusToString(status)
            raise InswsnError(f"The linear program of the drift bound failed: {said}.")
        found = program.getSolution()
        x = np.array(found.col_value)
        yield float(x[-1]), x[:-1], -np.array(found.row_dual)
