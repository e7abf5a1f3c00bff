r"""An interior-point method for many inequalities that little else ties together.

Each part c has unknowns :math:`x_c` and :math:`X_c` of its own, and all may share one number s:

.. math::
    \min \sum_c q_c'x_c + s \quad\text{with}\quad
    F_c = J_c'\,Q(x_c, X_c)\,J_c - \mathrm{diag}(f + s\,o) \le 0, \qquad
    \sum_c G_c x_c = h, \quad \sum_c X_c = 0 .

Q puts each of :math:`x_c`, or minus it, in one or two places of a symmetric matrix, and
:math:`-X_c`, symmetric, fills its last corner. The equations for a step form an arrow: a block for
each part, and a border for the equations and s. So the time grows with the number of parts, and all
parts are computed at once. The steps are those of Mehrotra's predictor and corrector in the scaling
of Nesterov and Todd (1997), with which a step is exact also where the matrices are nearly singular.
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
    below `row`, and each has its mirror image besides. The last are the upper triangle of X, by
    rows, in the last `corner` rows.
    """

    size: int
    unknown: Array
    row: Array
    column: Array
    sign: Array
    corner: int

    def filled(self, x: Array) -> Array:
        """Return Q, (parts, size, size), of unknowns (parts, m)."""
        Q = np.zeros((len(x), self.size, self.size))
        Q[:, self.row, self.column] = Q[:, self.column, self.row] = self.sign * x[:, self.unknown]
        return Q

    def read(self, V: Array) -> Array:
        """Return the inner products of a symmetric V, (parts, size, size), with each unknown's."""
        return _summed(self._weight * V[:, self.row, self.column], self.unknown)

    def inside(self, J: Array) -> Array:
        """Return J'Q_a J for all unknowns a but those of X as rows, (parts, a, d(d+1)/2).

        Off the diagonal they are the root of 2 times as large: their products are the traces.
        """
        free = slice(-(self.corner * (self.corner + 1) // 2))
        places = (each[free] for each in (self.unknown, self.row, self.column, self._weight))
        columns: Array = choose("arrow_columns")(J, *places)
        return columns

    @cached_property
    def _weight(self) -> Array:
        return self.sign * np.where(self.row == self.column, 1.0, 2.0)


def _summed(values: Array, unknown: Array) -> Array:
    """Return the sums of what belongs to an unknown, places being the second axis."""
    return np.add.reduceat(values, np.flatnonzero(np.diff(unknown, prepend=-1)), axis=1)


@dataclass(frozen=True, eq=False)
class Arrow:
    """A problem: J (parts, size, d), o and f (d,), q (parts, m), G (parts, r, a), h (r,).

    The unknowns are a and then those of X. Without `shared` there is no s.
    """

    places: Places
    J: Array
    o: Array
    f: Array
    q: Array
    G: Array
    h: Array
    shared: bool

    def left(self, x: Array, s: float) -> Array:
        """Return what must be negative of each part, (parts, d, d)."""
        return self.change(x, s) - np.diag(self.f)

    def change(self, x: Array, s: float) -> Array:
        """Return what unknowns add to that."""
        return np.asarray(self.J.mT @ self.places.filled(x) @ self.J - np.diag(s * self.o))

    def equations(self, x: Array) -> Array:
        """Return the left sides of the equations."""
        x, X = np.split(x, [self.G.shape[2]], axis=1)
        return np.append((self.G @ x[:, :, None]).sum(axis=0), X.sum(axis=0))

    def multiplied(self, y: Array) -> Array:
        """Return what multipliers of the equations make of the unknowns, (parts, m)."""
        y, Y = np.split(y, [len(self.h)])
        return np.hstack([y @ self.G, np.tile(Y, (len(self.G), 1))])


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
        slack = _START + given.f
        self.S, self.Z = (
            np.broadcast_to(np.diag(each), (len(given.J), *2 * slack.shape))
            for each in (slack, _START**2 / slack)
        )
        self.y = np.zeros_like(given.equations(self.x))
        self._residuals()

    def _residuals(self) -> None:
        given = self.given
        slack = -given.left(self.x, self.s)
        self.primal = slack - self.S
        if np.abs(self.primal).max() < _ROUNDED * np.abs(slack).max():
            self.S, self.primal = slack, np.zeros_like(slack)  # or rounding adds up
        V = given.J @ self.Z @ given.J.mT
        self.dual = -given.q - given.places.read(V) - given.multiplied(self.y)
        self.dual_s = float(np.einsum("cii,i->", self.Z, given.o)) - 1.0
        self.equal = -given.equations(self.x)
        self.equal[: len(given.h)] += given.h
        self.gap = float(np.sum(self.S * self.Z))

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
        *_, dS, dZ = self._direction(target, 0)  # it only tells how much to centre
        # both together are minus D, so that the largest of one is the least of the other
        least, most = self._range(dS)
        reach = _reach(least), _reach(-1 - most)
        after = np.sum(
            (np.eye(d) * D[:, :, None] + reach[0] * dS)
            * (np.eye(d) * D[:, :, None] + reach[1] * dZ)
        )
        centred = min(1.0, max(float(after) / self.gap, 1e-9) ** 3 if min(reach) > 0.1 else 1.0)
        both = dS @ dZ
        target = target + centred * mean * np.eye(d) - (both + both.mT) / 2
        dx, ds, dy, dS, dZ = self._direction(target, _REFINED)
        primal, dual = (_reach(self._range(change)[0], _SHORT) for change in (dS, dZ))
        self.x, self.s = self.x + primal * dx, self.s + primal * ds
        self.S = self.S + primal * (self.primal - given.change(dx, ds))
        self.Z = self.Z + dual * (T @ dZ @ T.mT)
        self.S, self.Z = (self.S + self.S.mT) / 2, (self.Z + self.Z.mT) / 2
        self.y = self.y + dual * dy
        self._residuals()

    def _factored(self) -> None:
        """Factor the equations for a step: those of a part by QR, not by their squares.

        In axes turned so that X fills the last corner again, X can be all of it: the others are
        held to what is outside.
        """
        given, e = self.given, self.given.places.corner
        self.own = self.T[:, given.o > 0] * np.sqrt(given.o[given.o > 0, None])
        a, b, weight = _triangle(e)
        turn, root = np.linalg.qr(self.J[:, -e:].mT, mode="complete")
        turn, root = turn[:, :, ::-1], root[:, e - 1 :: -1]
        own = self.own @ turn
        rows = np.concatenate(
            [given.places.inside(self.J @ turn), _upper(-own.mT @ own)[:, None]], axis=1
        )
        outside, corner = np.split(rows, [-len(a)], axis=2)
        factor = np.asarray(np.linalg.qr(outside.mT, mode="r"))
        self.back, along = np.linalg.inv(factor[:, :-1, :-1]), factor[:, :-1, -1:]
        columns = choose("arrow_columns")
        last = columns(np.linalg.inv(root.mT), np.arange(len(a)), a, b, -weight) / weight
        none, across = np.zeros((len(last), len(a), len(given.h))), corner[:, :-1] @ last
        self.border = np.block([
            [self.back.mT @ given.G.mT, -self.back.mT @ across, along],
            [none, last, corner[:, -1:].mT],
        ])  # fmt: skip
        flat = self.border.reshape(-1, self.border.shape[2])
        self.schur = flat.T @ flat
        self.schur[-1, -1] = -np.sum(factor[:, -1, -1] ** 2)
        if not given.shared:
            self.schur[-1, :] = self.schur[:, -1] = 0.0
            self.schur[-1, -1] = 1.0

    def _direction(self, target: Array, refined: int) -> tuple[Array, float, Array, Array, Array]:
        given, D = self.given, self.D
        dZ = 2 * target / (D[:, :, None] + D[:, None, :]) - self.primal_
        dS, x, y = self.primal_, np.zeros_like(self.x), np.zeros(len(self.schur))
        m, last = len(self.back[0]), self.border[:, :, len(given.h) : -1]
        # what is left of the equations after one solution is small, and solved again
        for _ in range(1 + refined):
            dual = self.dual - given.places.read(self.J @ dZ @ self.J.mT)
            dual -= given.multiplied(y[:-1])
            ends = np.append(
                self.equal - given.equations(x), self.dual_s + np.sum((self.own @ dZ) * self.own)
            )
            first = (last @ dual[:, m:, None])[:, :, 0]
            first[:, :m] += (dual[:, None, :m] @ self.back)[:, 0]
            edge = first.ravel() @ self.border.reshape(-1, len(ends)) - ends
            if not given.shared:
                edge[-1] = 0.0
            dy = np.linalg.solve(self.schur, edge)
            first -= self.border @ dy
            dx = np.concatenate(
                [self.back @ first[:, :m, None], last.mT @ first[:, :, None]], axis=1
            )[:, :, 0]
            moved = self.J.mT @ given.places.filled(dx) @ self.J
            moved -= dy[-1] * (self.own.mT @ self.own)
            x, y, dS, dZ = x + dx, y + dy, dS - moved, dZ + moved
        return x, float(y[-1]), y[:-1], dS, dZ

    def _range(self, change: Array) -> tuple[float, float]:
        """Return the least and the largest eigenvalue of changes, D being one."""
        roots = np.sqrt(self.D)
        values = np.linalg.eigvalsh(change / roots[:, :, None] / roots[:, None, :])
        return float(values[:, 0].min()), float(values[:, -1].max())


def _reach(least: float, share: float = 1.0) -> float:
    """Return the share of the way to where a matrix is singular, at most 1."""
    return min(1.0, -share / least) if least < 0 else 1.0


def _upper(matrices: Array) -> Array:
    """Return the upper triangles, (..., d(d+1)/2), with the root of 2 off the diagonal."""
    a, b, weight = _triangle(matrices.shape[-1])
    return matrices[..., a, b] * weight


@cache
def _triangle(size: int) -> tuple[Any, Any, Array]:
    a, b = np.triu_indices(size)
    return a, b, np.where(a == b, 1.0, 2**0.5)
