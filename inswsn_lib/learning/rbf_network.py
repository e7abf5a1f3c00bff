"""A radial-basis-function network that grows one neuron at a time, as MATLAB's newrb does."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.distance import cdist
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning.checking import data_to_fit, data_to_predict
from inswsn_lib.learning.kernels import check_positive

Array = NDArray[np.float64]

# What is left of a candidate after the neurons before it are taken out, below which it is spanned.
_SPANNED = 1e-14


class RBFNetworkRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]
    r"""Radial-basis-function network, grown by orthogonal least squares.

    The output is :math:`\sum_j w_j \exp(-\ln 2\, |x - c_j|^2 / s^2) + b` with the spread s, at
    which a neuron is at one half; a Gaussian with the width
    :math:`\sigma = s / \sqrt{2 \ln 2}`. Centres are training inputs. In each step the one is added
    that, made orthogonal to those before it, explains most of the targets (Chen, Cowan and Grant
    1991); then all weights and the bias are solved for by least squares, and the growth ends if
    the mean squared error is at most the goal. The bias takes no part in the choice, as in MATLAB's
    ``newrb``.

    Parameters
    ----------
    spread : float
        s, in the unit of the inputs.
    goal : float
        Mean squared error at which the growth ends; 0 or more.
    max_neurons : int, optional
        The most neurons. Default: as many as there are samples.

    Attributes
    ----------
    centres_ : ndarray, (neurons, inputs)
    weights_ : ndarray, (neurons,) or (neurons, outputs)
    bias_ : float or ndarray, (outputs,)
    errors_ : ndarray, (neurons + 1,)
        Mean squared error with none, one, two ... neurons.

    Examples
    --------
    A bump of one neuron's shape takes one neuron, in its middle and as high as it is:

    >>> import numpy as np
    >>> from inswsn_lib.learning import RBFNetworkRegressor
    >>> X = np.arange(-3.0, 4.0)[:, None]
    >>> bump = 5 * 0.5 ** X[:, 0] ** 2  # one half of 5 at the spread, 1
    >>> network = RBFNetworkRegressor(spread=1.0, goal=1e-12).fit(X, bump)
    >>> network.centres_.tolist(), network.weights_.round(6).tolist()
    ([[0.0]], [5.0])
    >>> print(f"{network.predict([[0.5]])[0] / 5:.4f} {0.5**0.25:.4f}")
    0.8409 0.8409
    """

    def __init__(
        self, spread: float = 1.0, goal: float = 0.0, max_neurons: int | None = None
    ) -> None:
        self.spread = spread
        self.goal = goal
        self.max_neurons = max_neurons

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Grow the network on inputs (n, inputs) and targets (n,) or (n, outputs).

        Parameters
        ----------
        X : array_like, (n, inputs)
            Inputs.
        y : array_like, (n,) or (n, outputs)
            Targets.

        Returns
        -------
        RBFNetworkRegressor
            Itself, fitted.

        Raises
        ------
        ParameterError
            If a parameter has a value it may not have.
        ValueError
            If the data are not such arrays, or not finite.
        """
        self._check_parameters()
        inputs, given = data_to_fit(self, X, y)
        responses = self._neurons(inputs, inputs)
        chosen, solution = self._grow(responses, given.reshape(len(given), -1))
        flat = given.ndim == 1
        self.centres_: Array = inputs[chosen]
        self.weights_: Array = solution[:-1, 0] if flat else solution[:-1]
        self.bias_: Any = float(solution[-1, 0]) if flat else solution[-1]
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
        return np.asarray(self._neurons(inputs, self.centres_) @ self.weights_ + self.bias_)

    def _neurons(self, X: Array, centres: Array) -> Array:
        if not len(centres):
            return np.zeros((len(X), 0))
        squares = cdist(X, centres, "sqeuclidean")
        return np.asarray(np.exp(-np.log(2) * squares / self.spread**2))

    def _grow(self, responses: Array, targets: Array) -> tuple[list[int], Array]:
        most = len(targets) if self.max_neurons is None else min(self.max_neurons, len(targets))
        left, chosen = responses.copy(), list[int]()
        whole = np.sum(responses**2, axis=0)
        solution, error = _least_squares(responses[:, []], targets)
        errors = [error]
        while len(chosen) < most and error > self.goal:
            sizes = np.sum(left**2, axis=0)
            there = sizes > _SPANNED * whole
            there[chosen] = False
            if not there.any():
                break
            shares = np.zeros(len(sizes))
            shares[there] = np.sum((left[:, there].T @ targets) ** 2, axis=1) / sizes[there]
            best = int(np.argmax(np.where(there, shares, -1.0)))
            direction = left[:, best] / np.sqrt(sizes[best])
            left -= np.outer(direction, direction @ left)
            chosen.append(best)
            solution, error = _least_squares(responses[:, chosen], targets)
            errors.append(error)
        self.errors_: Array = np.array(errors)
        return chosen, solution

    def _check_parameters(self) -> None:
        check_positive("spread", self.spread)
        number = isinstance(self.goal, int | float | np.number) and not isinstance(self.goal, bool)
        if not number or not 0 <= self.goal < np.inf:
            raise ParameterError("goal", self.goal, "finite, 0 or more")
        most = self.max_neurons
        whole = isinstance(most, int | np.integer) and not isinstance(most, bool)
        if most is not None and not (whole and most >= 0):
            raise ParameterError("max_neurons", most, "a whole number, 0 or more")


def _least_squares(neurons: Array, targets: Array) -> tuple[Array, float]:
    """Return weights and bias, and the mean squared error."""
    design = np.column_stack([neurons, np.ones(len(targets))])
    solution: Array = np.linalg.lstsq(design, targets, rcond=None)[0].astype(np.float64)
    return solution, float(np.mean((targets - design @ solution) ** 2))
