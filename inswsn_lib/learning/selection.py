"""Choosing kernel width and regularisation: leave-one-out in closed form, and P1's holdout."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array, matrices, number, one_of, whole
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.learning.base import Regressor
from inswsn_lib.learning.lssvm import KERNELS, Kernel, LSSVMRegressor, kernel_matrix, room_for

#: Candidates of `SelectedLSSVM`, for inputs of unit deviation
SIGMAS = tuple(float(s) for s in np.geomspace(0.125, 64.0, 10))
ETAS = tuple(float(e) for e in np.geomspace(1e-2, 1e2, 9))
_ENTRIES = 2**16  # of kernels that are decomposed together: so many stay in a cache
_COPIES = 6  # of a kernel that its decomposition takes


@dataclass(frozen=True, eq=False)
class Selection:
    """The errors of all pairs of kernel width and regularisation, and the best pair.

    Attributes
    ----------
    sigmas, etas : ndarray, (widths,) and (regularisations,)
        The candidates.
    by_output : ndarray, (widths, regularisations, outputs)
        Mean absolute error over samples.
    errors : ndarray, (widths, regularisations)
        The same, over outputs too.
    sigma, eta : float
        The pair with the least error; of equals the first.

    Examples
    --------
    >>> import inswsn_lib as iw, numpy as np
    >>> X = np.linspace(0, 6, 25)[:, None]
    >>> found = iw.select_lssvm(X, np.sin(X), sigmas=[0.05, 1.0, 50.0], etas=[1.0, 100.0])
    >>> found.sigma, found.eta, bool(found.errors.min() == found.errors[1, 1])
    (1.0, 100.0, True)
    """

    sigmas: Array
    etas: Array
    by_output: Array
    errors: Array
    sigma: float
    eta: float


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
    :math:`\alpha_i / (C^{-1})_{ii}` (Cawley 2006).

    Parameters
    ----------
    X : array_like, (n, inputs)
        Inputs.
    y : array_like, (n,) or (n, outputs)
        Targets.
    sigmas, etas : array_like
        Candidates; positive.
    trained_on : int, optional
        How many samples, from the first on, train a machine that is scored on the others, as P1
        Section 5.2 seems to say. Default: leave one out.
    kernel, degree
        As for `LSSVMRegressor`.

    Returns
    -------
    Selection
        All scores, and the pair with the least.

    Raises
    ------
    ParameterError
        If an argument is something else, leaves no sample to train or to score, or takes more
        memory than there is.

    Examples
    --------
    A kernel as wide as the bends of a sine tells a point from its neighbours; none extrapolates:

    >>> import inswsn_lib as iw, numpy as np
    >>> X = np.linspace(0, 6, 25)[:, None]
    >>> left_out = iw.select_lssvm(X, np.sin(X), sigmas=[0.05, 1.0], etas=[100.0])
    >>> ahead = iw.select_lssvm(X, np.sin(X), [0.05, 1.0], [100.0], trained_on=12)
    >>> left_out.sigma, bool(left_out.errors.min() < 0.05), bool(ahead.errors.min() > 0.3)
    (1.0, True, True)
    """
    targets = array("y", y, ("n",), ("n", "outputs"))
    columns = targets[:, None] if targets.ndim == 1 else targets
    inputs, targets = matrices(X=(X, "np"), y=(columns, "nq"))
    widths, strengths = _candidates("sigmas", sigmas), _candidates("etas", etas)
    one_of("kernel", kernel, KERNELS)
    whole("degree", degree, 1)
    if trained_on is not None:
        whole("trained_on", trained_on, 1, len(inputs) - 1)
    elif len(inputs) < 2:
        raise ParameterError("X", Described("1 sample"), "at least 2 samples to leave one out")

    def ahead(sigma: float) -> Array:
        first, rest = slice(trained_on), slice(trained_on, None)
        machines = (LSSVMRegressor(sigma, float(eta), kernel, degree) for eta in strengths)
        fitted = [machine.fit(inputs[first], targets[first]) for machine in machines]
        return np.array([targets[rest] - machine.predict(inputs[rest]) for machine in fitted])

    def left_out(sigmas: Array) -> Array:
        K = [kernel_matrix(inputs, inputs, kernel, float(sigma), degree) for sigma in sigmas]
        return _left_out(np.array(K), targets, strengths)

    if trained_on is None:
        parts = -(-len(widths) * len(inputs) ** 2 // _ENTRIES)
        some = np.array_split(widths, min(parts, len(widths)))
        with room_for(len(inputs), _COPIES * len(inputs)):
            residuals = [left_out(each) for each in some]
    else:
        residuals = [ahead(float(sigma))[None] for sigma in widths]
    by_output = np.concatenate([np.abs(some).mean(axis=2) for some in residuals])
    errors = by_output.mean(axis=2)
    i, j = np.unravel_index(np.argmin(errors), errors.shape)
    return Selection(widths, strengths, by_output, errors, float(widths[i]), float(strengths[j]))


def _left_out(K: Array, Y: Array, etas: Array) -> Array:
    r"""Return the leave-one-out residuals of kernels (widths, n, n), (widths, etas, n, outputs).

    From :math:`K = V \Lambda V'`, with :math:`d = 1/(\lambda + 1/\eta)`, follow
    :math:`H^{-1}y = V d V'y` and the diagonal of :math:`H^{-1}`, :math:`\sum_j V_{ij}^2 d_j`, and
    from these the multipliers and the diagonal of the bordered inverse,
    :math:`(H^{-1})_{ii} - u_i^2 / 1'u`.
    """
    widths, n, _ = K.shape
    values, V = np.linalg.eigh(K)
    d = 1 / (np.maximum(values, 0)[:, :, None] + 1 / etas)  # (widths, n, etas)
    turned = V.mT @ np.column_stack([np.ones(n), Y])
    damped = (d[:, :, :, None] * turned[:, :, None]).reshape(widths, n, -1)
    solved = np.moveaxis((V @ damped).reshape(widths, n, len(etas), -1), 1, 2)
    u, v = solved[..., :1], solved[..., 1:]  # (widths, etas, n, outputs)
    whole = u.sum(axis=2, keepdims=True)
    alpha = v - u * (v.sum(axis=2, keepdims=True) / whole)
    diagonal = (V**2 @ d).mT[..., None] - u**2 / whole
    return np.asarray(alpha / diagonal)


def _candidates(name: str, values: ArrayLike) -> Array:
    found = array(name, values, ("n",))
    if not len(found):
        raise ParameterError(name, Described("empty"), "one or more positive numbers")
    for value in found:
        number(name, value, above=0)
    return found


@dataclass(eq=False, repr=False)
class SelectedLSSVM(Regressor):
    """LS-SVM with the kernel width and regularisation of least leave-one-out error.

    Each fit tries all pairs, in closed form, on the data it is given (`select_lssvm`), and trains
    with the best one.

    Parameters
    ----------
    sigmas, etas : sequence of float
        Candidates; positive.

    Attributes
    ----------
    selection_ : Selection
        The scores of all pairs.
    machine_ : LSSVMRegressor
        What was trained.

    Examples
    --------
    It finds by itself that a smooth curve wants a wide kernel and little regularisation:

    >>> import inswsn_lib as iw, numpy as np
    >>> X = np.linspace(0, 6, 25)[:, None]
    >>> machine = iw.SelectedLSSVM(sigmas=(0.05, 1.0), etas=(0.1, 1000.0)).fit(X, np.sin(X))
    >>> machine.selection_.sigma, machine.selection_.eta
    (1.0, 1000.0)
    """

    sigmas: tuple[float, ...] = SIGMAS
    etas: tuple[float, ...] = ETAS

    def _fit(self, X: Array, Y: Array) -> None:
        self.selection_: Selection = select_lssvm(X, Y, self.sigmas, self.etas)
        best = LSSVMRegressor(self.selection_.sigma, self.selection_.eta)
        self.machine_: LSSVMRegressor = best.fit(X, Y)

    def _predict(self, X: Array) -> Array:
        return self.machine_.predict(X)
