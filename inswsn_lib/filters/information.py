"""Filters in the information form, carried side by side: one a cluster, and of many runs at once.

Informations are arrays (filters, n, n, K), where K is 1 if all runs have the same, or the number of
runs.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Mask, covariance, positive_definite
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.filters.inputs import measured, occurring, over_steps
from inswsn_lib.kernels import choose
from inswsn_lib.models import ErrorModel

# Largest product of a variance and its place in the information: as many digits are lost
_INFLATION = 1e9


def inverses(matrices: Array) -> Array:
    """Return the inverses of positive definite matrices (..., n, n, K)."""
    found, inflation = _inverses(matrices)
    if not inflation <= _INFLATION:  # nor NaN
        raise _lost()
    return found


def _inverses(matrices: Array) -> tuple[Array, float]:
    """Return the inverses, and the largest product of a variance and its place in the other."""
    if matrices.shape[-1] == 1:  # for one LAPACK is quicker
        one = matrices[..., 0]
        found: Array = np.full(one.shape, np.nan)
        with suppress(np.linalg.LinAlgError):
            found = np.asarray(np.linalg.inv(one))
        return found[..., None], _largest(np.einsum("...ii,...ii->...i", one, found))
    count = int(np.prod(matrices.shape[:-3]))  # one for a matrix alone
    many = np.ascontiguousarray(matrices.reshape(count, *matrices.shape[-3:]))
    found = choose("eliminated")(many).reshape(matrices.shape)
    return found, _largest(np.einsum("...iik,...iik->...ik", matrices, found))


def _largest(products: Array) -> float:
    return float(products.max(initial=0.0))


def _lost() -> ParameterError:
    got = Described("so small beside P_0 or Q that the state is lost to rounding")
    return ParameterError("measurement_covariance", got, "larger")


def applied(matrices: Array, vectors: Array) -> Array:
    """Return the products of matrices (..., i, j, K) with vectors (..., j, runs)."""
    if matrices.shape[-1] == 1:
        return np.asarray(matrices[..., 0] @ vectors)
    return np.asarray(np.einsum("...ijr,...jr->...ir", matrices, vectors))


class Filters(NamedTuple):
    """Filters in the information form, of which the last has no measurements: the centre's.

    Attributes
    ----------
    Y : ndarray, (filters, n, n, K)
        Informations.
    i : ndarray, (filters, n, runs)
        Y times the states.
    """

    Y: Array
    i: Array

    @classmethod
    def start(cls, prior: Array, x: Array, shares: Array, K: int) -> Self:
        """Return filters that share out one information (n, n) about the states x (n, runs)."""
        return cls(np.broadcast_to(prior[..., None], (*prior.shape, K)), prior @ x).shared(shares)

    def shared(self, shares: Array) -> Self:
        """Return as many filters as there are shares of the information of one."""
        return type(self)(shares[:, None, None, None] * self.Y, shares[:, None, None] * self.i)

    def part(self, which: slice | Mask) -> Self:
        """Return some of the filters."""
        return type(self)(self.Y[which], self.i[which])

    def total(self) -> Self:
        """Return the one filter that has the informations of all."""
        return type(self)(self.Y.sum(axis=0), self.i.sum(axis=0))

    def states(self) -> Array:
        """Return the states (filters, n, runs)."""
        return applied(inverses(self.Y), self.i)

    def predicted(self, A: Array, Q: Array, shares: Array) -> Self:
        r"""Return Y+ = (A Y^-1 A' + Q/beta)^-1 and Y+ A x.

        One without a share (filters,) of the noise forgets all it knows.
        """
        some = shares > 0
        ahead = type(self)(np.zeros(self.Y.shape), np.zeros(self.i.shape))
        mine = self.part(some)
        P = inverses(mine.Y)
        count, n, _, K = P.shape
        # A P A' of all as one product; np.kron takes longer than all the rest
        squared = (A[:, None, :, None] * A[None, :, None, :]).reshape(n * n, n * n)
        moved_P = (squared @ P.reshape(count, n * n, K)).reshape(P.shape)
        Y = inverses(moved_P + (Q / shares[some, None, None])[..., None])
        ahead.Y[some], ahead.i[some] = Y, applied(Y, A @ applied(P, mine.i))
        return ahead

    def measured(self, Y: Array, i: Array) -> Self:
        """Return filters, all but the last with the informations of their measurements added."""
        after = type(self)(self.Y.copy(), self.i.copy())
        after.Y[:-1] += Y
        after.i[:-1] += i
        return after

    def where(self, mine: Mask, others: Self) -> Self:
        """Return these filters where a mask (filters, K) says so, and others elsewhere."""
        return type(self)(
            np.where(mine[:, None, None], self.Y, others.Y),
            np.where(mine[:, None], self.i, others.i),
        )


class Observations:
    """What the measurements of clusters say, as informations.

    Parameters
    ----------
    measurements : ndarray, (N, steps, m, runs)
        y; NaN where missing.
    C : ndarray, (m, n)
    R : ndarray, (N, 1 or steps, m, m)
        Positive definite.

    Attributes
    ----------
    heard : ndarray of bool, (N, steps, K)
        Whether any component is there; K is 1 if all runs miss the same.
    """

    def __init__(self, measurements: Array, C: Array, R: Array) -> None:
        # those missing have no weight
        there, self._values, _ = measured(measurements, *measurements.shape)
        self.heard = np.any(there, axis=2)
        masks, self._which = occurring(np.moveaxis(there, 2, 0))
        # an absent component gets a row and a column of the identity, and then of zeros
        both = masks[:, :, None] & masks[:, None, :]
        inner = np.where(both, R[:, :, None], np.eye(len(C)))
        weights = np.where(both, np.linalg.inv(inner), 0.0)
        gains = np.moveaxis(C.T @ weights, 2, -1)  # (N, 1 or steps, n, m, masks)
        tables = np.moveaxis(C.T @ weights @ C, 2, -1), gains
        # the entries (N, steps, ., .) at all steps at once, where all runs share them
        self._shared = self._which.shape[2] == 1
        if self._shared:
            c, k = np.ogrid[: len(R), : self._which.shape[1]]
            which, known = self._which[..., 0], np.minimum(k, R.shape[1] - 1)
            tables = tables[0][c, known, :, :, which], tables[1][c, known, :, :, which]
        self._tables = tables

    def at(self, step: int) -> tuple[Array, Array]:
        """Return C'R^-1 C (N, n, n, K) and C'R^-1 y (N, n, runs) of the data that are there."""
        matrices, gains = (self._taken(table, step) for table in self._tables)
        return matrices, applied(gains, self._values[:, step])

    def all(self) -> tuple[Array, Array, Mask]:
        """Return what `at` returns at all steps, where all runs miss the same, and what is heard.

        They are (N, steps, n, n), (N, steps, n, runs) and (N, steps).
        """
        matrices, gains = self._tables
        return matrices, gains @ self._values, self.heard[..., 0]

    def _taken(self, table: Array, step: int) -> Array:
        """Return the entries (N, ., ., K) of a table (N, 1 or steps, ., ., masks) at a step."""
        if self._shared:
            return table[:, step, ..., None]
        now = table[:, min(step, table.shape[1] - 1)]
        rows = zip(now, self._which[:, step], strict=True)
        return np.stack([each.take(which, axis=-1) for each, which in rows])


def centre_states(
    plain: Callable[..., tuple[Array, float]],
    A: Array,
    Qs: Array,
    shares: Array,
    start: Filters,
    observed: Observations,
    *how: object,
) -> Array:
    """Return the centre's states (steps, n, runs) of filters whose informations all runs share.

    `how` is the rule of the fusion, 0 for the sum, 1 for covariance intersection, 2 for the best;
    after how many steps the sum is shared out, 0 for never; whether states are before their
    measurements. `plain` gives the same, step by step: the way of lost messages and of gaps that
    runs do not share, 4 to 30 times as quick as the kernel where that is not compiled.
    """
    packed = np.ascontiguousarray
    found: Array
    found, inflation = choose("information_steps", plain)(
        packed(A), packed(Qs), shares, packed(start.Y[..., 0]), packed(start.i),
        *map(packed, observed.all()), *how,
    )  # fmt: skip
    if not inflation <= _INFLATION:  # nor NaN
        raise _lost()
    return found


def checked_noise(
    model: ErrorModel,
    measurements: Array,
    measurement_covariance: ArrayLike,
    initial_covariance: ArrayLike,
    process_covariance: ArrayLike | None,
) -> tuple[Array, Array, Array]:
    """Return P_0^-1 (n, n), Q (steps, n, n) and R (N, 1 or steps, m, m) of informations."""
    clusters, steps, m, _ = measurements.shape
    P0 = covariance("initial_covariance", initial_covariance, model.A.shape, definite=True)
    Qs = over_steps("process_covariance", process_covariance, model.process_covariance, steps)
    # A P A' + Q is positive definite for each positive definite P if, and only if, it is for I
    positive_definite("process_covariance", model.A @ model.A.T + Qs)
    shapes = (clusters, m, m), (clusters, steps, m, m)
    R = covariance("measurement_covariance", measurement_covariance, *shapes, definite=True)
    return np.asarray(np.linalg.inv(P0)), Qs, R if R.ndim == 4 else R[:, None]
