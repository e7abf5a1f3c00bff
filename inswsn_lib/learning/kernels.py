"""Kernels of the support vector machines: how alike two inputs are."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]
Kernel = Literal["rbf", "linear", "polynomial"]
KERNELS: tuple[Kernel, ...] = ("rbf", "linear", "polynomial")


def kernel_matrix(X: Array, Z: Array, kernel: Kernel, sigma: float, degree: int) -> Array:
    r"""Return the kernel of every row of X with every row of Z, (len(X), len(Z)).

    .. math::
        \exp(-|x - z|^2 / 2\sigma^2), \qquad x'z, \qquad (1 + x'z/\sigma^2)^d

    for the radial (P1 3.9), the linear and the polynomial kernel.

    Parameters
    ----------
    X, Z : ndarray, (rows, inputs)
        Inputs.
    kernel : {"rbf", "linear", "polynomial"}
    sigma : float
        Kernel width; the linear kernel has none.
    degree : int
        d, of the polynomial kernel.

    Returns
    -------
    ndarray, (len(X), len(Z))

    Examples
    --------
    The radial kernel has fallen to one half at :math:`\sqrt{2 \ln 2}` widths:

    >>> import numpy as np
    >>> from inswsn_lib.learning.kernels import kernel_matrix
    >>> X, Z = np.array([[0.0]]), np.array([[0.0], [2.0 * np.sqrt(2 * np.log(2))]])
    >>> kernel_matrix(X, Z, "rbf", 2.0, 1).round(6).tolist()
    [[1.0, 0.5]]
    >>> kernel_matrix(np.array([[1.0, 2.0]]), np.array([[3.0, 4.0]]), "linear", 1.0, 1).tolist()
    [[11.0]]
    """
    if kernel == "rbf":
        K = cdist(X, Z, "sqeuclidean")
        K *= -0.5 / sigma**2
        return np.asarray(np.exp(K, out=K))
    K = X @ Z.T
    return K if kernel == "linear" else np.asarray((1 + K / sigma**2) ** degree)


def check_kernel(kernel: Any, sigma: Any, degree: Any) -> None:
    """Raise a ParameterError if a kernel or one of its parameters is none."""
    if kernel not in KERNELS:
        raise ParameterError("kernel", kernel, 'one of "rbf", "linear", "polynomial"')
    check_positive("sigma", sigma)
    if isinstance(degree, bool) or not isinstance(degree, int | np.integer) or degree < 1:
        raise ParameterError("degree", degree, "a whole number, 1 or more")


def check_positive(name: str, value: Any) -> None:
    """Raise a ParameterError if a value is no positive, finite number."""
    number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not (number and np.isfinite(value) and value > 0):
        raise ParameterError(name, value, "a positive, finite number")
