"""An LS-SVM that chooses its own kernel width and regularisation, and a regressor that holds."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin

from inswsn_lib.learning.checking import data_to_fit, data_to_predict
from inswsn_lib.learning.lssvm import LSSVMRegressor
from inswsn_lib.learning.selection import Selection, select_lssvm

Array = NDArray[np.float64]

#: Candidates of `SelectedLSSVM`, for inputs of unit deviation
SIGMAS = tuple(float(s) for s in np.geomspace(0.125, 64.0, 10))
ETAS = tuple(float(e) for e in np.geomspace(1e-2, 1e2, 9))


class SelectedLSSVM(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
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

    >>> import numpy as np
    >>> from inswsn_lib.learning import SelectedLSSVM
    >>> X = np.linspace(0, 6, 25)[:, None]
    >>> machine = SelectedLSSVM(sigmas=(0.05, 1.0), etas=(0.1, 1000.0)).fit(X, np.sin(X[:, 0]))
    >>> machine.selection_.sigma, machine.selection_.eta
    (1.0, 1000.0)
    >>> bool(abs(machine.predict([[1.6]])[0] - np.sin(1.6)) < 0.01)
    True
    """

    def __init__(self, sigmas: tuple[float, ...] = SIGMAS, etas: tuple[float, ...] = ETAS) -> None:
        self.sigmas = sigmas
        self.etas = etas

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Choose and fit, on inputs (n, inputs) and targets (n,) or (n, outputs).

        Parameters
        ----------
        X : array_like, (n, inputs)
            Inputs.
        y : array_like, (n,) or (n, outputs)
            Targets.

        Returns
        -------
        SelectedLSSVM
            Itself, fitted.

        Raises
        ------
        ParameterError
            If a candidate is not positive, or there are fewer than two samples.
        ValueError
            If the data are not such arrays, or not finite.
        """
        inputs, targets = data_to_fit(self, X, y)
        self.selection_: Selection = select_lssvm(inputs, targets, self.sigmas, self.etas)
        best = LSSVMRegressor(self.selection_.sigma, self.selection_.eta)
        self.machine_: LSSVMRegressor = best.fit(inputs, targets)
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
        return self.machine_.predict(inputs)


class HoldRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Predict the last target it was given, whatever the input.

    Attributes
    ----------
    last_ : float or ndarray, (outputs,)

    Examples
    --------
    The least that a method has to beat:

    >>> from inswsn_lib.learning import HoldRegressor
    >>> held = HoldRegressor().fit([[0.0], [1.0], [2.0]], [[5.0, 0.0], [6.0, 0.0], [7.0, 1.0]])
    >>> held.predict([[3.0], [100.0]]).tolist()
    [[7.0, 1.0], [7.0, 1.0]]
    """

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Keep the last of the targets (n,) or (n, outputs).

        Parameters
        ----------
        X : array_like, (n, inputs)
            Inputs; only how many there are of them matters.
        y : array_like, (n,) or (n, outputs)
            Targets.

        Returns
        -------
        HoldRegressor
            Itself, fitted.

        Raises
        ------
        ValueError
            If the data are not such arrays, or not finite.
        """
        _, targets = data_to_fit(self, X, y)
        self.last_: Any = targets[-1].copy()
        return self

    def predict(self, X: ArrayLike) -> Array:
        """Return it for every row of inputs: (n,) or (n, outputs).

        Parameters
        ----------
        X : array_like, (n, inputs)
            Inputs.

        Returns
        -------
        ndarray, (n,) or (n, outputs)
        """
        rows = len(data_to_predict(self, X))
        return np.repeat(np.asarray(self.last_)[None], rows, axis=0)
