"""The least-squares support vector machine of P1 Section 3.1."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dposv, dpstrf
from scipy.spatial.distance import cdist

from inswsn_lib.checks import Array, number, one_of, whole
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.learning.base import Regressor

Kernel = Literal["rbf", "linear", "polynomial"]
KERNELS: tuple[Kernel, ...] = ("rbf", "linear", "polynomial")
_ROWS = 128  # of a kernel that are computed at a time, so that they stay in a cache
_CANDIDATES = 64  # for the next pivots, whose rows are computed at once
_CHECKED = 1000  # equations of a machine of low rank, evenly spaced, whose residual is told
_SMALL = 2**30  # bytes that are taken without asking
_NOTHING = 1e-12  # share of the largest diagonal entry below which what is left is rounding


def kernel_matrix(X: Array, Z: Array, kernel: Kernel, sigma: float, degree: int) -> Array:
    r"""Return how alike each row of X is to each of Z, (n, m), or of stacks of both, (..., n, m).

    .. math::
        \exp(-|x - z|^2 / 2\sigma^2), \qquad x'z, \qquad (1 + x'z/\sigma^2)^d

    for the kernels "rbf", which is radial (P1 3.9), "linear" and "polynomial".

    Parameters
    ----------
    X, Z : ndarray, (n, inputs) and (m, inputs), or (..., n, inputs) and (..., m, inputs)
    kernel : {"rbf", "linear", "polynomial"}
    sigma : float
        The width, in the unit of the inputs; the linear kernel has none.
    degree : int
        d, of the polynomial kernel.

    Examples
    --------
    The radial kernel has fallen to one half at :math:`\sqrt{2 \ln 2}` widths:

    >>> import inswsn_lib as iw, numpy as np
    >>> X, Z = np.array([[0.0]]), np.array([[0.0], [2.0 * np.sqrt(2 * np.log(2))]])
    >>> iw.learning.kernel_matrix(X, Z, "rbf", sigma=2.0, degree=1).round(6).tolist()
    [[1.0, 0.5]]
    """
    if kernel == "rbf":
        K = squared_distances(X, Z)
        K *= -0.5 / sigma**2
        return np.asarray(np.exp(K, out=K))
    K = X @ Z.mT
    return K if kernel == "linear" else np.asarray((1 + K / sigma**2) ** degree)


def squared_distances(X: Array, Z: Array) -> Array:
    """Return the squared distance of each row of X from each of Z, also of stacks, (..., n, m).

    Parameters
    ----------
    X, Z : ndarray, (..., n, inputs) and (..., m, inputs)

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.learning.lssvm import squared_distances
    >>> squared_distances(np.array([[0.0, 0.0]]), np.array([[3.0, 4.0], [1.0, 0.0]])).tolist()
    [[25.0, 1.0]]
    """
    if X.ndim == 2:
        return np.asarray(cdist(X, Z, "sqeuclidean"))
    found = np.zeros((*X.shape[:-1], Z.shape[-2]))
    for i in range(X.shape[-1]):
        found += (X[..., :, None, i] - Z[..., None, :, i]) ** 2
    return found


@contextmanager
def room_for(rows: int, columns: int) -> Iterator[None]:
    """Refuse samples X whose kernels (rows, columns) have no room in memory.

    It is told beforehand: a system may grant more than it has, and end the process later.
    """
    takes = 8 * rows * columns
    got = Described(f"of {rows:,} rows, whose kernels take {takes / 1e9:.3g} GB of memory")
    must_be = "of fewer rows, or LSSVMRegressor given a smaller rank=, such as rank=1000"
    if takes > _SMALL and takes > _free_memory():
        raise ParameterError("X", got, must_be)
    try:
        yield
    except MemoryError:
        raise ParameterError("X", got, must_be) from None


def _free_memory() -> float:
    """Return how much memory can be had, bytes; infinite where the system does not tell."""
    found = float("inf")
    with suppress(OSError, ValueError, IndexError):
        told = Path("/proc/meminfo").read_text().split("MemAvailable:")[1]
        found = 1024.0 * int(told.split()[0])
    with suppress(OSError, ValueError):  # of a container, unless it is "max"
        limit, used = (Path(f"/sys/fs/cgroup/memory.{x}").read_text() for x in ("max", "current"))
        found = min(found, float(int(limit) - int(used)))
    return found


@dataclass(eq=False, repr=False)
class LSSVMRegressor(Regressor):
    r"""Least-squares support vector machine for regression (P1 3.1-3.9).

    It is kernel ridge regression with a bias that is not penalised:

    .. math::
        \begin{bmatrix} 0 & 1' \\ 1 & K + I/\eta \end{bmatrix}
        \begin{bmatrix} b \\ \alpha \end{bmatrix} = \begin{bmatrix} 0 \\ y \end{bmatrix}, \qquad
        \hat y(x) = \sum_i \alpha_i k(x, x_i) + b .

    With :math:`H = K + I/\eta`, one Cholesky factor, which all outputs share, gives
    :math:`u = H^{-1}1` and :math:`v = H^{-1}y`; then :math:`b = 1'v / 1'u`,
    :math:`\alpha = v - u b`.

    Parameters
    ----------
    sigma : float
        Kernel width. For the radial kernel in the unit of the inputs.
    eta : float
        Regularisation: the larger, the closer the fit.
    kernel : {"rbf", "linear", "polynomial"}
        See `kernel_matrix`.
    degree : int
        Of the polynomial kernel.
    rank : int, optional
        At most so many samples, the pivots, carry a kernel. Default: all, which takes
        :math:`n^3/3` operations and :math:`8 n^2` bytes; with a rank r it takes :math:`2 r^2 n`
        and :math:`8 r n`. More than there is memory is refused.

    Attributes
    ----------
    alpha_ : ndarray, (n, outputs) or (pivots, outputs)
        What the kernels are multiplied with: the multipliers, or with a rank
        :math:`\beta`.
    bias_ : ndarray, (outputs,)
        b.
    X_fit_ : ndarray, (n, inputs) or (pivots, inputs)
        The inputs that carry a kernel.
    trace_left_ : float
        With a rank only: the share of the trace of K that is not in :math:`G'G`. It bounds every
        eigenvalue of the difference.
    residual_ : float
        With a rank only: by how much the equations above, with the whole K, are missed, root mean
        square over at most 1,000 of them, evenly spaced, over the root mean square of y.

    Notes
    -----
    With a rank, :math:`K \approx G'G`, with G (r, n) from a Cholesky factor whose pivots have the
    largest diagonal entries left, to a factor of two, since they are picked some at a time (Fine
    and Scheinberg 2001; Harbrecht, Peters and Schneider 2012). What is left, :math:`K - G'G`, is
    positive semidefinite and vanishes at the pivots. By the identity of Woodbury (Williams and
    Seeger 2001)

    .. math::
        H^{-1} R = \eta (R - G' S), \qquad S = (G G' + I/\eta)^{-1} G R ,

    for :math:`R = [1, y]`, and b as before. The machine that is linear in the kernels of the
    pivots has the multipliers :math:`\beta = G_P^{-1} (S_y - S_1 b)`, with the columns
    :math:`G_P` of the pivots, upper triangular. It is the machine with the kernel
    :math:`k(x, P) K_{PP}^{-1} k(P, z)`, and with all samples as pivots that with k.

    Examples
    --------
    A kernel far wider than the data makes a straight line, a narrow one falls back to the bias b
    away from them, here the mean of 1, 3, 5:

    >>> import inswsn_lib as iw
    >>> X, y = [[0.0], [1.0], [2.0]], [1.0, 3.0, 5.0]
    >>> for sigma in (1000.0, 0.1):
    ...     print(iw.LSSVMRegressor(sigma, eta=1e9).fit(X, y).predict([[10.0]]).round(1))
    [21.]
    [3.]

    A smooth curve through 2,000 samples needs few of them, and is told how much that misses:

    >>> import numpy as np
    >>> X = np.linspace(0, 6, 2000)[:, None]
    >>> dense, low = (iw.LSSVMRegressor(1.0, 10.0, rank=r).fit(X, np.sin(X)) for r in (None, 20))
    >>> bool(np.allclose(low.predict(X), dense.predict(X), atol=1e-6)), low.residual_ < 1e-6
    (True, True)
    >>> len(low.X_fit_), low.trace_left_ < 1e-9
    (20, True)
    """

    _learnt = ("X_fit_", "alpha_", "bias_")

    sigma: float = 1.0
    eta: float = 1.0
    kernel: Kernel = "rbf"
    degree: int = 2
    rank: int | None = None

    def _fit(self, X: Array, Y: Array) -> None:
        number("sigma", self.sigma, above=0)
        number("eta", self.eta, above=0)
        one_of("kernel", self.kernel, KERNELS)
        whole("degree", self.degree, 1)
        if self.rank is not None:
            rank = whole("rank", self.rank, 1, len(X))
            with room_for(len(X), rank):
                self._fit_pivots(X, Y, rank)
        else:
            with room_for(len(X), len(X)):
                self._fit_all(X, Y)

    def _fit_all(self, X: Array, Y: Array) -> None:
        n = len(X)
        H = np.empty((n, n))
        for first in range(0, n, _ROWS):  # what is above the diagonal is not read
            rows, end = slice(first, first + _ROWS), min(first + _ROWS, n)
            H[rows, :end] = self._kernel(X[rows], X[:end])
        H.ravel()[:: n + 1] += 1 / self.eta
        right = np.ones((n, 1 + Y.shape[1]), order="F")
        right[:, 1:] = Y
        solved = self._solved(H, right)
        u, v = solved[:, 0], solved[:, 1:]
        self.bias_: Array = v.sum(axis=0) / u.sum()
        self.alpha_: Array = v - np.outer(u, self.bias_)
        self.X_fit_: Array = X

    def _fit_pivots(self, X: Array, Y: Array, rank: int) -> None:
        G, pivots, left = self._pivoted(X, rank)
        right = np.column_stack([np.ones(len(X)), Y])
        small = G @ G.T
        small.ravel()[:: len(G) + 1] += 1 / self.eta
        S = self._solved(small, np.asfortranarray(G @ right))
        solved = self.eta * (right - G.T @ S)
        u, v = solved[:, 0], solved[:, 1:]
        self.bias_ = v.sum(axis=0) / u.sum()
        self.alpha_ = solve_triangular(G[:, pivots], S[:, 1:] - np.outer(S[:, 0], self.bias_))
        self.X_fit_ = X[pivots]
        self.trace_left_: float = left
        del G  # before rows of K need room
        alpha = v - np.outer(u, self.bias_)
        some = np.linspace(0, len(X) - 1, min(len(X), _CHECKED)).round().astype(int)
        missed = Y[some] - self.bias_ - alpha[some] / self.eta
        for first in range(0, len(some), _ROWS):
            rows = slice(first, first + _ROWS)
            missed[rows] -= self._kernel(X[some[rows]], X) @ alpha
        size = float(np.sqrt(np.mean(Y**2)))
        self.residual_: float = float(np.sqrt(np.mean(missed**2))) / (size or 1.0)

    def _pivoted(self, X: Array, rank: int) -> tuple[Array, Array, float]:
        """Return G (r, n) with K ~ G'G, the pivots, and the share of the trace of K left.

        Fewer than `rank` where what is left is rounding. Candidates are the samples with the
        largest diagonal entries left; their rows are computed at once, and among them LAPACK picks
        pivots as long as these have half of the largest entry or more.
        """
        n, m = len(X), 0
        # each row's kernel with itself
        diagonal = self._kernel(X[:, None], X[:, None])[:, 0, 0]
        left, least = diagonal.copy(), _NOTHING * diagonal.max()
        G, pivots = np.empty((rank, n)), np.empty(rank, dtype=int)
        while m < rank and left.max() > least:
            some = np.argsort(-left, kind="stable")[:_CANDIDATES]
            rows = self._kernel(X[some], X) - G[:m, some].T @ G[:m]
            factor, order, count, _ = dpstrf(rows[:, some], tol=left.max() / 2, lower=True)
            if not (count := min(count, rank - m)):
                break  # rounding
            picked = order[:count] - 1
            new = slice(m, m + count)
            pivots[new] = some[picked]
            G[new] = solve_triangular(factor[:count, :count], rows[picked], lower=True)
            left = np.maximum(left - np.einsum("ij,ij->j", G[new], G[new]), 0)
            m += count
            left[pivots[:m]] = 0
        share = float(left.sum() / diagonal.sum()) if diagonal.any() else 0.0
        return G[:m], pivots[:m], share

    def _kernel(self, X: Array, Z: Array) -> Array:
        return kernel_matrix(X, Z, self.kernel, self.sigma, self.degree)

    def _solved(self, H: Array, right: Array) -> Array:
        """Return the solution of H x = right; the lower triangle of H is read, both overwritten."""
        if not len(H):  # no sample is unlike zero, and LAPACK wants one equation
            return right
        # in the order that LAPACK overwrites, which takes the lower triangle for the upper one
        _, solved, failed = dposv(H.T, right, overwrite_a=True, overwrite_b=True)
        if failed:
            must_be = "smaller for such a kernel, since K + I/eta is singular to rounding"
            raise ParameterError("eta", self.eta, must_be)
        return np.asarray(solved)

    def _predict(self, X: Array) -> Array:
        return np.asarray(self._kernel(X, self.X_fit_) @ self.alpha_ + self.bias_)
