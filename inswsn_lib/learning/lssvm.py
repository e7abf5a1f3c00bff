"""The least-squares support vector machine of P1 Section 3.1."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning.checking import data_to_fit, data_to_predict
from inswsn_lib.learning.kernels import Kernel, check_kernel, check_positive, kernel_matrix

Array = NDArray[np.float64]


class LSSVMRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
    r"""Least-squares support vector machine for regression (P1 3.1-3.9).

    The problem (3.2), (3.3),

    .. math::
        \min_{w, b, e}\ \tfrac12 w'w + \tfrac\eta2 \sum_i e_i^2, \qquad
        y_i = w'\varphi(x_i) + b + e_i ,

    has, by its optimality conditions (3.6), :math:`\alpha_i = \eta e_i`, the solution of

    .. math::
        \begin{bmatrix} 0 & 1' \\ 1 & K + I/\eta \end{bmatrix}
        \begin{bmatrix} b \\ \alpha \end{bmatrix} = \begin{bmatrix} 0 \\ y \end{bmatrix}, \qquad
        \hat y(x) = \sum_i \alpha_i k(x, x_i) + b .

    With :math:`H = K + I/\eta`, one Cholesky factor gives :math:`u = H^{-1}1` and
    :math:`v = H^{-1}y`, and then :math:`b = 1'v / 1'u`, :math:`\alpha = v - u b`. It is kernel
    ridge regression with a bias that is not penalised. Several outputs share the factor.

    Parameters
    ----------
    sigma : float
        Kernel width. For the radial kernel in the unit of the inputs.
    eta : float
        Regularisation: the larger, the closer the fit.
    kernel : {"rbf", "linear", "polynomial"}
        See `kernels.kernel_matrix`.
    degree : int
        Of the polynomial kernel.

    Attributes
    ----------
    alpha_ : ndarray, (n,) or (n, outputs)
        The multipliers.
    bias_ : float or ndarray, (outputs,)
        b.
    X_fit_ : ndarray, (n, inputs)
        The training inputs.

    Examples
    --------
    A kernel far wider than the data makes a straight line, a narrow one falls back to the bias b
    away from them:

    >>> import numpy as np
    >>> from inswsn_lib.learning import LSSVMRegressor
    >>> X = np.arange(6.0)[:, None]
    >>> wide = LSSVMRegressor(sigma=1000.0, eta=1e9).fit(X, 2 * X[:, 0] + 1)
    >>> print(f"{wide.predict([[10.0]])[0]:.1f}")
    21.0
    >>> narrow = LSSVMRegressor(sigma=0.1, eta=1e8).fit(X, 2 * X[:, 0] + 1)
    >>> print(f"{narrow.predict([[10.0]])[0]:.2f} {narrow.bias_:.2f}")
    6.00 6.00

    By the optimality conditions the multipliers are :math:`\eta` times the errors, and add up to
    nothing:

    >>> y = np.array([0.0, 1.0, 0.0, 1.0, 0.0, 1.0])
    >>> machine = LSSVMRegressor(sigma=1.0, eta=2.0).fit(X, y)
    >>> bool(np.allclose(machine.alpha_, 2.0 * (y - machine.predict(X))))
    True
    >>> bool(abs(machine.alpha_.sum()) < 1e-12)
    True
    """

    def __init__(
        self, sigma: float = 1.0, eta: float = 1.0, kernel: Kernel = "rbf", degree: int = 2
    ) -> None:
        self.sigma = sigma
        self.eta = eta
        self.kernel = kernel
        self.degree = degree

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Fit the machine to inputs (n, inputs) and targets (n,) or (n, outputs).

        Parameters
        ----------
        X : array_like, (n, inputs)
            Inputs.
        y : array_like, (n,) or (n, outputs)
            Targets.

        Returns
        -------
        LSSVMRegressor
            Itself, fitted.

        Raises
        ------
        ParameterError
            If a parameter has a value it may not have, or eta is so large that K + I/eta is
            singular to rounding.
        ValueError
            If the data are not such arrays, or not finite.
        """
        check_kernel(self.kernel, self.sigma, self.degree)
        check_positive("eta", self.eta)
        inputs, targets = data_to_fit(self, X, y)
        H = kernel_matrix(inputs, inputs, self.kernel, self.sigma, self.degree)
        H[np.diag_indices_from(H)] += 1 / self.eta
        right = np.column_stack([np.ones(len(inputs)), targets])
        # H is symmetric, so its transpose is in the order that LAPACK overwrites
        try:
            factor = cho_factor(H.T, overwrite_a=True, check_finite=False)
        except LinAlgError:
            raise ParameterError(
                "eta", self.eta, "smaller for such a kernel: K + I/eta is singular to rounding"
            ) from None
        solved = cho_solve(factor, right, overwrite_b=True, check_finite=False)
        u, v = solved[:, 0], solved[:, 1:]
        bias = v.sum(axis=0) / u.sum()
        alpha = v - np.outer(u, bias)
        flat = targets.ndim == 1
        self.alpha_: Array = alpha[:, 0] if flat else alpha
        self.bias_: Any = float(bias[0]) if flat else bias
        self.X_fit_: Array = inputs
        return self

    def predict(self, X: ArrayLike) -> Array:
        """Return the predictions for inputs (n, inputs): (n,) or (n, outputs).

        Parameters
        ----------
        X : array_like, (n, inputs)
            Inputs.

        Returns
        -------
        ndarray, (n,) or (n, outputs)
        """
        inputs = data_to_predict(self, X)
        K = kernel_matrix(inputs, self.X_fit_, self.kernel, self.sigma, self.degree)
        return np.asarray(K @ self.alpha_ + self.bias_)
