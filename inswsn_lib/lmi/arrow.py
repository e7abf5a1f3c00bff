r"""An interior-point method for many inequalities that little else ties together.

Each part c has unknowns :math:`x_c` of its own, and all may share one number s:

.. math::
    \min \sum_c q_c'x_c + s \quad\text{with}\quad
    F_c = J_c'\,Q(x_c)\,J_c - (f + s)\,O \le 0, \qquad \sum_c G_c x_c - s\,g = h .

Q puts an unknown, or minus it, in one or two places of a symmetric matrix, and O is a diagonal of
zeros and ones. The equations for a step form an arrow: a block for each part, and a border for the
equations and s. So the time grows with the number of parts, and all parts are computed at once.
The steps are those of Mehrotra's predictor and corrector in the scaling of Nesterov and Todd
(1997), with which a step is exact also where the matrices are nearly singular.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.kernels import choose
from inswsn_lib.lmi.designs import InfeasibleDesignError

# Steps, and how far from a solution the method ends, is accurate, and is of some use
_STEPS, _ENDS, _ACCURATE, _OF_USE = 60, 1e-9, 1e-6, 1e-5
_ROUNDED, _REFINED = 1e-10, 2  # what a slack misses by rounding, and how often steps are refined
_START, _SHORT = 10.0, 0.98  # S and Z at first, and the share of the way to the border of a step


@dataclass(frozen=True, eq=False)
class Places:
    """Where the unknowns of a part stand in Q, (size, size).

    `unknown`, `row`, `column` and `sign`, (places,), are sorted by the unknown; `column` is not
    below `row`, and each has its mirror image besides.
    """

    size: int
    unknown: Array
    row: Array
    column: Array
    sign: Array

    def filled(self, x: Array) -> Array:
        """Return Q, (parts, size, size), of unknowns (parts, m)."""
        Q = np.zeros((len(x), self.size, self.size))
        Q[:, self.row, self.column] = Q[:, self.column, self.row] = self.sign * x[:, self.unknown]
        return Q

    def read(self, V: Array) -> Array:
        """Return the inner products of a symmetric V, (parts, size, size), with each unknown's."""
        return _summed(self._weight * V[:, self.row, self.column], self.unknown)

    def columns(self, J: Array) -> Array:
        """Return J'Q_a J for all unknowns a as columns, (parts, d(d+1)/2, m).

        Off the diagonal they are the root of 2 times as large: their products are the traces.
        """
        columns = choose("arrow_columns", _columns)
        return columns(J, self.unknown, self.row, self.column, self._weight).mT

    @cached_property
    def _weight(self) -> Array:
        return self.sign * np.where(self.row == self.column, 1.0, 2.0)


def _columns(J: Array, unknown: Array, row: Array, column: Array, weight: Array) -> Array:
    outer = J[:, row, :, None] * J[:, column, None, :] * (weight / 2)[:, None, None]
    return _summed(_upper(outer + outer.mT), unknown)


def _summed(values: Array, unknown: Array) -> Array:
    """Return the sums of what belongs to an unknown, places being the second axis."""
    return np.add.reduceat(values, np.flatnonzero(np.diff(unknown, prepend=-1)), axis=1)


@dataclass(frozen=True, eq=False)
class Arrow:
    """A problem: J (parts, size, d), O as a mask (d,), f, q (parts, m), G (parts, r, m), h, g (r,).

    Without `shared` there is no s.
    """

    places: Places
    J: Array
    O: Array  # noqa: E741
    f: float
    q: Array
    G: Array
    h: Array
    g: Array
    shared: bool

    def left(self, x: Array, s: float) -> Array:
        """Return what must be negative of each part, (parts, d, d)."""
        return self.change(x, self.f + s)

    def change(self, x: Array, s: float) -> Array:
        """Return what unknowns add to that."""
        return np.asarray(self.J.mT @ self.places.filled(x) @ self.J - np.diag(s * self.O))


@dataclass(frozen=True, eq=False)
class Found:
    """The unknowns (parts, m), s, the dual solutions (parts, d, d), and the word."""

    x: Array
    s: float
    Z: Array
    status: str


def solve_arrow(given: Arrow) -> Found:
    """Solve a problem; raise `InfeasibleDesignError` where no accurate answer is reached."""
    state = _State(given)
    best, found = np.inf, (state.x, state.s, state.Z)
    for _ in range(_STEPS):
        try:
            state.step()
        except np.linalg.LinAlgError:  # numbers that are no more
            break
        off = state.off()
        if off < best:
            best, found = off, (state.x, state.s, state.Z)
        elif best < _OF_USE:  # rounding is all that is left
            break
        if best < _ENDS:
            break
    if best > _OF_USE:
        raise InfeasibleDesignError(f"The method of parts stops {best:.1g} from a solution.")
    return Found(*found, "optimal" if best < _ACCURATE else "optimal_inaccurate")


class _State:
    """Unknowns x and s, slacks S, dual solutions Z, and multipliers y of the equations."""

    def __init__(self, given: Arrow) -> None:
        self.given = given
        self.x, self.s = np.zeros_like(given.q), 0.0
        slack = _START + given.f * given.O
        self.S, self.Z = (
            np.broadcast_to(np.diag(each), (len(given.J), *2 * slack.shape))
            for each in (slack, _START**2 / slack)
        )
        self.y = np.zeros(len(given.h))
        self._residuals()

    def _residuals(self) -> None:
        given, own = self.given, self.given.O
        slack = -given.left(self.x, self.s)
        self.primal = slack - self.S
        if np.abs(self.primal).max() < _ROUNDED * np.abs(slack).max():
            self.S, self.primal = slack, np.zeros_like(slack)  # or rounding adds up
        V = given.J @ self.Z @ given.J.mT
        self.dual = -given.q - given.places.read(V) - given.G.mT @ self.y
        self.dual_s = -1.0 + float(np.einsum("cii,i->", self.Z, own)) + float(given.g @ self.y)
        self.equal = given.h + self.s * given.g - self.applied(self.x)
        self.gap = float(np.sum(self.S * self.Z))

    def applied(self, x: Array) -> Array:
        """Return the left side of the equations."""
        return np.asarray((self.given.G @ x[:, :, None]).sum(axis=0)[:, 0])

    def off(self) -> float:
        """Return how far all is from a solution, relative."""
        given = self.given
        value = float(np.sum(given.q * self.x)) + (self.s if given.shared else 0.0)
        misses = (self.primal, self.S), (self.dual, given.q), (self.equal, given.h)
        return max(
            self.gap / (1 + abs(value)),
            abs(self.dual_s) if given.shared else 0.0,
            *(float(np.abs(miss).max() / (1 + np.abs(of).max())) for miss, of in misses),
        )

    def step(self) -> None:
        """Take a step."""
        given, S, Z = self.given, self.S, self.Z
        parts, _, d = given.J.shape
        root = np.linalg.cholesky(S)
        squares, turn = np.linalg.eigh(root.mT @ Z @ root)
        D = np.sqrt(np.maximum(squares, 1e-300))
        R = root @ turn / np.sqrt(D)[:, None, :]
        T = Z @ R / D[:, None, :]  # the inverse of R, transposed
        self.R, self.T, self.D, self.J = R, T, D, given.J @ T
        self.primal_ = T.mT @ self.primal @ T
        self._factored()
        mean = self.gap / (parts * d)
        target = -np.eye(d) * (D * D)[:, :, None]
        *_, dS, dZ = self._direction(target)
        reach = min(1.0, self._reach(dS)), min(1.0, self._reach(dZ))
        after = np.sum(
            (np.eye(d) * D[:, :, None] + reach[0] * dS)
            * (np.eye(d) * D[:, :, None] + reach[1] * dZ)
        )
        centred = min(1.0, max(float(after) / self.gap, 1e-9) ** 3 if min(reach) > 0.1 else 1.0)
        both = dS @ dZ
        target = target + centred * mean * np.eye(d) - (both + both.mT) / 2
        dx, ds, dy, dS, dZ = self._direction(target)
        primal = min(1.0, _SHORT * self._reach(dS))
        dual = min(1.0, _SHORT * self._reach(dZ))
        self.x, self.s = self.x + primal * dx, self.s + primal * ds
        self.S = self.S + primal * (self.primal - given.change(dx, ds))
        self.Z = self.Z + dual * (T @ dZ @ T.mT)
        self.S, self.Z = (self.S + self.S.mT) / 2, (self.Z + self.Z.mT) / 2
        self.y = self.y + dual * dy
        self._residuals()

    def _factored(self) -> None:
        """Factor the equations for a step: those of a part by QR, not by their squares."""
        given = self.given
        self.own = self.T[:, given.O > 0]
        shared = _upper(-self.own.mT @ self.own)[:, :, None]
        columns = np.concatenate([given.places.columns(self.J), shared], axis=2)
        factor = np.asarray(np.linalg.qr(columns, mode="r"))
        along, self.back = factor[:, :-1, -1:], np.linalg.inv(factor[:, :-1, :-1])
        self.border = np.concatenate([self.back.mT @ given.G.mT, along], axis=2)
        flat = self.border.reshape(-1, len(given.h) + 1)
        self.schur = flat.T @ flat
        self.schur[-1, :-1] += given.g
        self.schur[:-1, -1] += given.g
        self.schur[-1, -1] = -np.sum(factor[:, -1, -1] ** 2)
        if not given.shared:
            self.schur[-1, :] = self.schur[:, -1] = 0.0
            self.schur[-1, -1] = 1.0

    def _direction(self, target: Array) -> tuple[Array, float, Array, Array, Array]:
        given, D = self.given, self.D
        dZ = 2 * target / (D[:, :, None] + D[:, None, :]) - self.primal_
        dS, x, y = self.primal_, np.zeros_like(self.x), np.zeros(len(given.h) + 1)
        # what is left of the equations after one solution is small, and solved again
        for _ in range(1 + _REFINED):
            dual = self.dual - given.places.read(self.J @ dZ @ self.J.mT)
            dual -= given.G.mT @ y[:-1]
            trace = float(np.einsum("cij,cjk,cik->", self.own, dZ, self.own))
            ends = np.append(
                self.equal - self.applied(x) + given.g * y[-1],
                self.dual_s + trace + given.g @ y[:-1],
            )
            first = (dual[:, None] @ self.back)[:, 0]
            edge = first.ravel() @ self.border.reshape(-1, len(ends)) - ends
            if not given.shared:
                edge[-1] = 0.0
            dy = np.linalg.solve(self.schur, edge)
            dx = (self.back @ (first - self.border @ dy)[:, :, None])[:, :, 0]
            moved = self.J.mT @ given.places.filled(dx) @ self.J
            moved -= dy[-1] * (self.own.mT @ self.own)
            x, y, dS, dZ = x + dx, y + dy, dS - moved, dZ + moved
        return x, float(y[-1]), y[:-1], dS, dZ

    def _reach(self, change: Array) -> float:
        """Return how far one may go before a matrix is singular."""
        roots = np.sqrt(self.D)
        least = np.linalg.eigvalsh(change / roots[:, :, None] / roots[:, None, :])[:, 0].min()
        return float(-1 / least) if least < 0 else np.inf


def _upper(matrices: Array) -> Array:
    """Return the upper triangles, (..., d(d+1)/2), with the root of 2 off the diagonal."""
    a, b, weight = _triangle(matrices.shape[-1])
    return matrices[..., a, b] * weight


@cache
def _triangle(size: int) -> tuple[Any, Any, Array]:
    a, b = np.triu_indices(size)
    return a, b, np.where(a == b, 1.0, 2**0.5)
