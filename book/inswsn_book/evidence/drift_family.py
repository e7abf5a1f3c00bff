r"""The remaining error of a filter where the INS error is known by printed means alone.

On one axis the error of an uncorrected INS is taken as a polynomial of position, whose derivative
is the error of velocity, over an area with fixes and the outage after it. Its mean absolute values
in the two windows are four printed cells. A filter is a linear map from measurements to estimates,
so the remaining error is linear in the numbers of the drift, and the mean absolute
errors follow without a simulation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import ArrayLike
from scipy.linalg import block_diag
from scipy.optimize import leastsq
from scipy.special import erf

from inswsn_lib.checks import Array, array, number, whole
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.kernels import choose

_MOST_DEGREE = 9
_LEAST_DEVIATION = 1e-12  # m, m/s: what an error has that is without noise
_LINEAR = 1e-6  # of the largest estimate; a design from a solver is not exact
_X_AXIS, _Y_AXIS = [0, 2], [1, 3]


@dataclass(frozen=True)
class DriftFamily:
    r"""The errors of an INS on one axis that are polynomials, in an area and the outage after it.

    .. math:: p_k = \sum_{j=0}^{d} a_j s_k^j , \qquad
              v_k = \frac{1}{\tau} \sum_{j=1}^{d} j\, a_j s_k^{j-1} , \qquad s_k = \frac{kT}{\tau}

    with :math:`\tau = nT` and n the samples of both windows. The :math:`a_j` are the `numbers` of a
    drift, in m. A drift and its negative have the same mean absolute errors.

    Attributes
    ----------
    period : float
        T, s.
    samples, silent : int
        Samples of the area, 2 or more, and of the outage that follows, 1 or more.
    degree : int
        d, 1 to 9; 3 has as many numbers as an axis has printed cells.

    Raises
    ------
    ParameterError
        If a size is none of these.
    """

    period: float
    samples: int = 100
    silent: int = 50
    degree: int = 3

    def __post_init__(self) -> None:
        number("period", self.period, above=0)
        whole("samples", self.samples, 2)
        whole("silent", self.silent, 1)
        whole("degree", self.degree, 1, _MOST_DEGREE)

    @cached_property
    def basis(self) -> Array:
        """Position and velocity error of each number, (samples + silent, 2, degree + 1)."""
        steps = self.samples + self.silent
        power = np.arange(self.degree + 1)
        position = (np.arange(steps) / steps)[:, None] ** power
        velocity = np.zeros_like(position)
        velocity[:, 1:] = power[1:] * position[:, :-1] / (steps * self.period)
        return np.stack([position, velocity], axis=1)

    def cells(self, numbers: ArrayLike) -> Array:
        """Return the mean absolute errors of drifts, (drifts, 4).

        They are position and velocity in the area, then position and velocity in the outage.

        Parameters
        ----------
        numbers : array_like, (drifts, degree + 1)
            In m.
        """
        return self._cells.of(self._drifts(numbers))

    def draw_starts(self, cells: ArrayLike, count: int, rng: np.random.Generator) -> Array:
        """Return drifts from which a fit may start, (count, degree + 1), by one printed axis.

        The velocity error is a sum of Legendre polynomials over both windows with independent
        standard normal weights, scaled to the printed mean velocity error of the area. The position
        error starts at a normal number with the printed mean position error as deviation.

        Parameters
        ----------
        cells : array_like, (4,)
            In the order of `cells`; the first two are used.
        count : int
        rng : numpy.random.Generator
        """
        position, velocity, *_ = _positive("cells", cells, 4)
        shape = 2 * np.arange(self.samples + self.silent) / (self.samples + self.silent) - 1
        waves = legvander(shape, self.degree - 1)
        # the same polynomials in the powers of the numbers; both span all of this degree
        powers = np.linalg.lstsq(self.basis[:, 1, 1:], waves, rcond=None)[0]
        numbers = np.zeros((whole("count", count, 1), self.degree + 1))
        numbers[:, 1:] = rng.standard_normal((count, self.degree)) @ powers.T
        numbers *= (velocity / self.cells(numbers)[:, 1])[:, None]
        numbers[:, 0] = position * rng.standard_normal(count)
        return numbers

    @cached_property
    def _cells(self) -> _Cells:
        area, outage = np.split(self.basis, [self.samples])
        return _Cells.over(area).beside(_Cells.over(outage))

    def _drifts(self, numbers: ArrayLike) -> Array:
        return array("numbers", numbers, ("drifts", self.degree + 1))


@dataclass(frozen=True, eq=False)
class Correction:
    r"""A filter as the linear map from the measurements of an axis to its estimates.

    The measurement is the INS error less that of the network, :math:`y = e - v`, and the remaining
    error is :math:`e - Fy = (I - F)\,e + Fv`, over all samples of an area, position and velocity.

    Attributes
    ----------
    response : ndarray, (samples, 2, samples, 2)
        F: the estimates from a measurement of one in each place.
    noise : array_like, (2,)
        Standard deviations of v in position and velocity, m and m/s; white.
    first : int
        Samples at the start that are left out of mean errors.
    """

    response: Array
    noise: ArrayLike
    first: int = 0

    def __post_init__(self) -> None:
        steps = len(array("response", self.response, ("samples", 2, "samples", 2)))
        array("response", self.response, (steps, 2, steps, 2))
        if array("noise", self.noise, (2,)).min() < 0:
            raise ParameterError("noise", self.noise, "two numbers of at least 0")
        whole("first", self.first, 0, steps - 1)

    @classmethod
    def of(
        cls, estimate: Callable[[Array], Array], samples: int, noise: ArrayLike, first: int = 0
    ) -> Correction:
        """Return the map of a filter, from its answers to single measurements.

        Parameters
        ----------
        estimate : callable
            From measurements (samples, 4, runs), two positions and two velocities, to estimates of
            the same shape. The x axis is taken.
        samples : int
        noise, first
            As the attributes.

        Raises
        ------
        ParameterError
            If the filter is not linear, or carries measurements of one axis to the other.
        """
        columns = 2 * whole("samples", samples, 2)
        # the last run has unequal measurements at once: their answers, weighed, if it is linear
        weights = np.linspace(1.0, 2.0, columns)
        measured = np.zeros((samples, 4, columns + 1))
        measured[:, _X_AXIS] = np.column_stack([np.eye(columns), weights]).reshape(samples, 2, -1)
        answer = array("estimate", estimate(measured), measured.shape)
        response, together = answer[:, _X_AXIS, :-1], answer[:, _X_AXIS, -1]
        off = max(np.abs(answer[:, _Y_AXIS]).max(), np.abs(response @ weights - together).max())
        if off > _LINEAR * max(1.0, np.abs(answer).max()):
            raise ParameterError(
                "estimate", Described(f"off by {off:.1e}"), "linear, with the axes independent"
            )
        return cls(response.reshape(samples, 2, samples, 2), noise, first)

    def cells(self, family: DriftFamily, numbers: ArrayLike) -> Array:
        r"""Return the expected mean absolute errors in position and velocity, (drifts, 2).

        An error of the drift m with Gaussian noise of the deviation s has

        .. math:: \mathbb{E}|m + s z| = s \sqrt{2/\pi}\, e^{-m^2/2s^2}
                  + m\, \mathrm{erf}\frac{m}{s\sqrt 2} .

        Parameters
        ----------
        family : DriftFamily
            With as many samples as the filter has.
        numbers : array_like, (drifts, degree + 1)
        """
        return self._cells(family).of(family._drifts(numbers))

    def draw_cells(
        self, family: DriftFamily, numbers: ArrayLike, rng: np.random.Generator
    ) -> Array:
        """Return mean absolute errors of one run for each drift, (drifts, 2), with drawn noise.

        Parameters
        ----------
        family, numbers
            As in `cells`.
        rng : numpy.random.Generator
        """
        drifts = family._drifts(numbers)
        drawn = rng.standard_normal((len(drifts), family.samples, 2)) * np.asarray(self.noise)
        # rows of drifts times matrices: one product each
        left = drifts @ np.moveaxis(self._left(family), 2, 0).reshape(family.degree + 1, -1)
        noise = drawn.reshape(len(drifts), -1) @ self._matrix.T
        errors = left + noise[:, 2 * self.first :]
        return np.asarray(np.abs(errors).reshape(len(drifts), -1, 2).mean(axis=1))

    @property
    def _matrix(self) -> Array:
        """The response as a matrix, (2 samples, 2 samples)."""
        return self.response.reshape(2 * len(self.response), -1)

    def _left(self, family: DriftFamily) -> Array:
        """Return what remains of each number of a drift, (samples - first, 2, degree + 1)."""
        if len(self.response) != family.samples:
            raise ParameterError("family", family, f"one with {len(self.response)} samples")
        drift = family.basis[: family.samples]
        return (drift - np.tensordot(self.response, drift, axes=2))[self.first :]

    def _cells(self, family: DriftFamily) -> _Cells:
        left = self._left(family)
        variance = np.tile(np.asarray(self.noise) ** 2, family.samples)
        deviation = np.sqrt(self._matrix**2 @ variance).reshape(-1, 2)
        return _Cells.over(left, deviation[self.first :])


class DriftFits(NamedTuple):
    """Drifts that were fitted to printed cells, from `fit_drifts`.

    Attributes
    ----------
    numbers : ndarray, (starts, degree + 1)
    ratios : ndarray, (starts, cells)
        Of the drift's cells to the printed ones.
    """

    numbers: Array
    ratios: Array

    def meeting(self, within: float) -> Array:
        """Return the numbers of the drifts that meet each cell within this share of it."""
        return self.numbers[(np.abs(self.ratios - 1) <= within).all(axis=1)]

    def best(self) -> Array:
        """Return the ratios of the drift with the least sum of squared logarithms, (cells,)."""
        return np.asarray(self.ratios[np.argmin((np.log(self.ratios) ** 2).sum(axis=1))])


def fit_drifts(
    family: DriftFamily,
    cells: ArrayLike,
    starts: ArrayLike,
    correction: Correction | None = None,
    *,
    most: int = 200,
) -> DriftFits:
    """Fit a drift to the printed cells of one axis, from each start.

    The sum of squared logarithms of fitted over printed cells is made small by the method of
    Levenberg and Marquardt, with exact derivatives.

    Parameters
    ----------
    family : DriftFamily
    cells : array_like, (4,) or (6,)
        The mean errors of the INS, in the order of `DriftFamily.cells`; with a `correction`, also
        those in position and velocity that remain. Positive.
    starts : array_like, (starts, degree + 1)
        Such as `DriftFamily.draw_starts` gives.
    correction : Correction, optional
        A filter whose cells are fitted as well.
    most : int
        Evaluations from one start, at most.

    Raises
    ------
    ParameterError
        If there are not as many cells as are to be fitted.
    """
    fitted = family._cells.beside(correction._cells(family)) if correction else family._cells
    printed = _positive("cells", cells, len(fitted.mean))
    fits = [_fit(fitted, printed, start, most) for start in family._drifts(starts)]
    return DriftFits(*map(np.array, zip(*fits, strict=True)))


@dataclass(frozen=True, eq=False)
class _Cells:
    """Mean absolute values of errors that are linear in the numbers of a drift, with noise."""

    basis: Array  # (errors, numbers)
    deviation: Array  # (errors,)
    mean: Array  # (cells, errors), which errors are averaged in which cell

    @classmethod
    def over(cls, basis: Array, deviation: Array | None = None) -> _Cells:
        """Return the two cells of a window, from (steps, 2, numbers) and (steps, 2)."""
        steps = len(basis)
        spread = np.zeros((steps, 2)) if deviation is None else deviation
        # an error without noise is one with very little: one formula for both
        spread = np.maximum(spread.ravel(), _LEAST_DEVIATION)
        return cls(basis.reshape(2 * steps, -1), spread, np.tile(np.eye(2), steps) / steps)

    def beside(self, other: _Cells) -> _Cells:
        """Return these cells and others, in this order."""
        return _Cells(
            np.concatenate([self.basis, other.basis]),
            np.concatenate([self.deviation, other.deviation]),
            block_diag(self.mean, other.mean),
        )

    def of(self, drifts: Array) -> Array:
        """Return the expected cells, (drifts, cells)."""
        return np.asarray(_sizes(drifts @ self.basis.T, self.deviation)[0] @ self.mean.T)

    @cached_property
    def value_and_slope(self) -> Callable[[Array], tuple[Array, Array]]:
        """From one drift its expected cells, and their derivatives (cells, numbers)."""
        return partial(choose("mean_sizes"), self.basis, self.deviation, self.mean)


def _sizes(mean: Array, deviation: Array) -> tuple[Array, Array]:
    """Return the expected absolute values of errors, and their derivatives by the mean."""
    ratio = mean / deviation
    sign = erf(ratio / np.sqrt(2))
    return np.sqrt(2 / np.pi) * deviation * np.exp(-(ratio**2) / 2) + mean * sign, sign


def _fit(fitted: _Cells, printed: Array, start: Array, most: int) -> tuple[Array, Array]:
    # rows of zeros where a drift has more numbers than there are cells: the method asks for as many
    cells, rows = len(printed), max(len(printed), len(start))

    last: list[Any] = [None, None]  # the slopes are asked where the residuals have been

    def residuals(drift: Array) -> Array:
        last[:] = drift.copy(), fitted.value_and_slope(drift)
        values = np.zeros(rows)
        values[:cells] = np.log(last[1][0] / printed)
        return values

    def slopes(drift: Array) -> Array:
        values = np.zeros((rows, len(start)))
        there = np.array_equal(drift, last[0])
        mean, values[:cells] = last[1] if there else fitted.value_and_slope(drift)
        values[:cells] /= mean[:, None]
        return values

    # MINPACK's own call: with few cells `least_squares` takes longer around it than the method
    ends = dict.fromkeys(("ftol", "xtol", "gtol"), 1e-8)
    numbers, _, found, *_ = leastsq(
        residuals, start, Dfun=slopes, full_output=True, maxfev=most, **ends
    )
    return numbers, np.exp(found["fvec"][:cells])


def _positive(name: str, value: ArrayLike, count: int) -> Array:
    cells = array(name, value, (count,))
    if cells.min() <= 0:
        raise ParameterError(name, value, "positive numbers")
    return cells
