"""The least-squares support vector machine of P1 Section 3.1."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg.lapack import dposv
from scipy.spatial.distance import cdist

from inswsn_lib.checks import Array, number, one_of, whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.learning.base import Regressor

Kernel = Literal["rbf", "linear", "polynomial"]
KERNELS: tuple[Kernel, ...] = ("rbf", "linear", "polynomial")
_ROWS = 128  # of a kernel that are computed at a time, so that they stay in a cache


def kernel_matrix(X: Array, Z: Array, kernel: Kernel, sigma: float, degree: int) -> Array:
    r"""Return how alike each row of X is to each of Z, (n, m).

    .. math::
        \exp(-|x - z|^2 / 2\sigma^2), \qquad x'z, \qquad (1 + x'z/\sigma^2)^d

    for the kernels "rbf", which is radial (P1 3.9), "linear" and "polynomial".

    Parameters
    ----------
    X, Z : ndarray, (n, inputs) and (m, inputs)
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
        K = cdist(X, Z, "sqeuclidean")
        K *= -0.5 / sigma**2
        return np.asarray(np.exp(K, out=K))
    K = X @ Z.T
    return K if kernel == "linear" else np.asarray((1 + K / sigma**2) ** degree)


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

    Attributes
    ----------
    alpha_ : ndarray, (n, outputs)
        The multipliers.
    bias_ : ndarray, (outputs,)
        b.
    X_fit_ : ndarray, (n, inputs)
        The training inputs.

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
    """

    sigma: float = 1.0
    eta: float = 1.0
    kernel: Kernel = "rbf"
    degree: int = 2

    def _fit(self, X: Array, Y: Array) -> None:
        number("sigma", self.sigma, above=0)
        number("eta", self.eta, above=0)
        one_of("kernel", self.kernel, KERNELS)
        whole("degree", self.degree, 1)
        n = len(X)
        H = np.empty((n, n))
        for first in range(0, n, _ROWS):  # what is above the diagonal is not read
            rows, end = slice(first, first + _ROWS), min(first + _ROWS, n)
            H[rows, :end] = kernel_matrix(X[rows], X[:end], self.kernel, self.sigma, self.degree)
        H.ravel()[:: n + 1] += 1 / self.eta
        right = np.ones((n, 1 + Y.shape[1]), order="F")
        right[:, 1:] = Y
        # in the order that LAPACK overwrites, which takes the lower triangle for the upper one
        _, solved, failed = dposv(H.T, right, overwrite_a=True, overwrite_b=True)
        if failed:
            may_be = "smaller for such a kernel: K + I/eta is singular to rounding"
            raise ParameterError("eta", self.eta, may_be)
        u, v = solved[:, 0], solved[:, 1:]
        self.bias_: Array = v.sum(axis=0) / u.sum()
        self.alpha_: Array = v - np.outer(u, self.bias_)
        self.X_fit_: Array = X

    def _predict(self, X: Array) -> Array:
        K = kernel_matrix(X, self.X_fit_, self.kernel, self.sigma, self.degree)
        return np.asarray(K @ self.alpha_ + self.bias_)
