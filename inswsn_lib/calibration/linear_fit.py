"""A robust straight line, or any model that is linear in its unknowns, with block deviations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inswsn_lib.calibration.blocks import FEWEST, block_starts
from inswsn_lib.calibration.robust_fit import covariance, deviation_of, fit
from inswsn_lib.checks import Array


@dataclass(frozen=True, eq=False)
class _Linear:
    columns: Array
    values: Array

    def residual(self, state: Array) -> Array:
        return np.asarray(self.values - self.columns @ state)

    def jacobian(self, state: Array) -> Array:
        return -self.columns

    def moved(self, state: Array, by: Array) -> Array:
        return np.asarray(state + by)


@dataclass(frozen=True, eq=False)
class Line:
    """Coefficients (p,), their deviations, that of the residuals, and how many blocks there are.

    A deviation is infinite where nothing tells the coefficient.
    """

    values: Array
    deviations: Array
    noise: float
    blocks: int


def fit_linear(columns: Array, values: Array, time: Array, block: float) -> Line | None:
    """Return the coefficients of columns (n, p) that fit values (n,) best by soft-l1.

    None if there are too few rows or blocks of time.
    """
    starts = block_starts(time, block) if len(time) else np.zeros(0, dtype=np.intp)
    count = columns.shape[1]
    if len(starts) < FEWEST or len(values) < 2 * count + 2:
        return None
    size = np.sqrt(np.mean(columns**2, axis=0))
    sizes = 1 / np.where(size > 0, size, 1.0)
    problem = _Linear(columns, values)
    first: Array = np.asarray(np.linalg.lstsq(columns, values, rcond=None)[0], dtype=float)
    noise = deviation_of(problem.residual(first), count)
    state, noise = fit(problem, first, noise, lambda x: x * sizes)
    found, lost = covariance(problem, state, noise, sizes, starts)
    deviations = np.sqrt(np.diag(found))
    deviations[lost] = np.inf
    return Line(state, deviations, noise, len(starts))
