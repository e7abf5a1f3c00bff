"""Choosing kernel width and regularisation: leave-one-out in closed form, and P1's holdout."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh
from sklearn.utils.validation import check_X_y

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning.kernels import Kernel, check_kernel, check_positive, kernel_matrix
from inswsn_lib.learning.lssvm import LSSVMRegressor

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Selection:
    """The scores of all pairs of kernel width and regularisation, and the best pair.

    Attributes
    ----------
    sigmas, etas : ndarray, (widths,) and (regularisations,)
        The candidates.
    errors : ndarray, (widths, regularisations)
        Mean absolute error of each pair, over samples and outputs.
    by_output : ndarray, (widths, regularisations, outputs)
        The same of each output.
    sigma, eta : float
        The pair with the least error; of equals the first.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.learning import select_lssvm
    >>> X = np.linspace(0, 6, 25)[:, None]
    >>> found = select_lssvm(X, np.sin(X), sigmas=[0.05, 1.0, 50.0], etas=[1.0, 100.0])
    >>> found.errors.shape, found.by_output.shape, found.trials
    ((3, 2), (3, 2, 1), 6)
    >>> found.sigma, found.eta, bool(found.errors.min() == found.errors[1, 1])
    (1.0, 100.0, True)
    """

    sigmas: Array
    etas: Array
    errors: Array
    by_output: Array
    sigma: float
    eta: float

    @property
    def trials(self) -> int:
        """How many pairs were tried."""
        return int(self.errors.size)


def select_lssvm(
    X: ArrayLike,
    y: ArrayLike,
    sigmas: ArrayLike,
    etas: ArrayLike,
    *,
    trained_on: int | None = None,
    kernel: Kernel = "rbf",
    degree: int = 2,
) -> Selection:
    r"""Score an LS-SVM for every pair of kernel width and regularisation.

    By default each sample is left out once, in closed form: with C the bordered matrix of the
    LS-SVM, the residual of sample i in a machine that was trained on all others is
    :math:`\alpha_i / (C^{-1})_{ii}` (Cawley 2006). One eigendecomposition of the kernel matrix
    gives the residuals for all regularisations of a width.

    With `trained_on` the machine is trained on the first samples and scored on the rest, as P1
    Section 5.2 seems to say ("the first 50 points are the validation subset").

    Parameters
    ----------
    X : array_like, (n, inputs)
        Inputs.
    y : array_like, (n,) or (n, outputs)
        Targets.
    sigmas, etas : array_like
        Candidates; positive.
    trained_on : int, optional
        How many samples, from the first on, train a machine that is scored on the others. Default:
        leave one out.
    kernel, degree
        As for `LSSVMRegressor`.

    Returns
    -------
    Selection
        All scores, and the pair with the least.

    Raises
    ------
    ParameterError
        If a candidate is not positive, there is none, or `trained_on` leaves no sample to train or
        to score.
    ValueError
        If the data are not such arrays, or not finite.

    Examples
    --------
    Points of a sine are told from their neighbours by a kernel as wide as its bends, not by one
    narrower than their distance; P1's way of scoring, on the samples after the first ones, needs
    extrapolation, at which all are bad:

    >>> import numpy as np
    >>> from inswsn_lib.learning import select_lssvm
    >>> X = np.linspace(0, 6, 25)[:, None]
    >>> y = np.sin(X[:, 0])
    >>> left_out = select_lssvm(X, y, sigmas=[0.05, 1.0], etas=[100.0])
    >>> left_out.sigma, bool(left_out.errors.min() < 0.05)
    (1.0, True)
    >>> bool(select_lssvm(X, y, [0.05, 1.0], [100.0], trained_on=12).errors.min() > 0.3)
    True
    """
    inputs, y = check_X_y(X, y, multi_output=True, y_numeric=True, dtype=np.float64)
    targets = np.asarray(y, dtype=np.float64).reshape(len(inputs), -1)
    widths, strengths = _candidates("sigmas", sigmas), _candidates("etas", etas)
    for sigma in widths:
        check_kernel(kernel, sigma, degree)
    if trained_on is None:
        if len(inputs) < 2:
            raise ParameterError("X", f"{len(inputs)} sample", "2 samples or more to leave one out")
        scored = _left_out
    else:
        whole = isinstance(trained_on, int | np.integer) and not isinstance(trained_on, bool)
        if not whole or not 1 <= trained_on < len(inputs):
            raise ParameterError("trained_on", trained_on, f"from 1 to {len(inputs) - 1}")
        scored = partial(_held_out, trained_on)
    by_output = np.array(
        [scored(inputs, targets, float(sigma), strengths, kernel, degree) for sigma in widths]
    )
    errors = by_output.mean(axis=2)
    i, j = np.unravel_index(np.argmin(errors), errors.shape)
    return Selection(widths, strengths, errors, by_output, float(widths[i]), float(strengths[j]))


def leave_one_out(
    X: Array, y: Array, sigma: float, etas: Array, kernel: Kernel = "rbf", degree: int = 2
) -> Array:
    r"""Return the leave-one-out residuals for several regularisations, (etas, n, outputs).

    From :math:`K = V \Lambda V'`, with :math:`d = 1/(\lambda + 1/\eta)`, follow
    :math:`H^{-1}y = V d V'y` and the diagonal of :math:`H^{-1}`, :math:`\sum_j V_{ij}^2 d_j`, and
    from these the multipliers and the diagonal of the bordered inverse,
    :math:`(H^{-1})_{ii} - u_i^2 / 1'u`.

    Parameters
    ----------
    X : ndarray, (n, inputs)
        Inputs.
    y : ndarray, (n, outputs)
        Targets.
    sigma : float
        Kernel width.
    etas : ndarray, (etas,)
        Regularisations.
    kernel, degree
        As for `LSSVMRegressor`.

    Returns
    -------
    ndarray, (etas, n, outputs)
        Target less prediction of the machine that was trained on all other samples.

    Examples
    --------
    It is what training without the sample gives, for the price of one decomposition:

    >>> import numpy as np
    >>> from inswsn_lib.learning import LSSVMRegressor, leave_one_out
    >>> X = np.linspace(0, 6, 9)[:, None]
    >>> y = np.sin(X)
    >>> residuals = leave_one_out(X, y, 1.0, np.array([10.0]))
    >>> others = LSSVMRegressor(sigma=1.0, eta=10.0).fit(X[1:], y[1:, 0])
    >>> bool(np.isclose(residuals[0, 0, 0], y[0, 0] - others.predict(X[:1])[0]))
    True
    """
    values, V = eigh(kernel_matrix(X, X, kernel, sigma, degree), check_finite=False)
    d = 1 / (np.maximum(values, 0)[:, None] + 1 / etas)  # (n, etas)
    ones, turned = V.sum(axis=0), V.T @ y
    u = V @ (d * ones[:, None])  # (n, etas)
    v = np.einsum("ij,jk,jo->kio", V, d, turned, optimize=True)
    bias = v.sum(axis=1) / u.sum(axis=0)[:, None]
    alpha = v - u.T[:, :, None] * bias[:, None, :]
    diagonal = (V**2) @ d - u**2 / u.sum(axis=0)
    return np.asarray(alpha / diagonal.T[:, :, None])


def _left_out(X: Array, y: Array, sigma: float, etas: Array, kernel: Kernel, degree: int) -> Array:
    return np.asarray(np.abs(leave_one_out(X, y, sigma, etas, kernel, degree)).mean(axis=1))


def _held_out(
    first: int, X: Array, y: Array, sigma: float, etas: Array, kernel: Kernel, degree: int
) -> Array:
    machines = (LSSVMRegressor(sigma, float(eta), kernel, degree) for eta in etas)
    return np.array(
        [
            np.abs(m.fit(X[:first], y[:first]).predict(X[first:]) - y[first:]).mean(axis=0)
            for m in machines
        ]
    )


def _candidates(name: str, values: ArrayLike) -> Array:
    array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if array.ndim != 1 or not array.size:
        raise ParameterError(name, f"of shape {array.shape}", "one or more numbers")
    for value in array:
        check_positive(name, float(value))
    return array
