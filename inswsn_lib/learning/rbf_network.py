"""A radial-basis-function network that grows one neuron at a time, as MATLAB's newrb does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inswsn_lib.checks import Array, number, whole
from inswsn_lib.learning.base import Regressor
from inswsn_lib.learning.lssvm import squared_distances

# What is left of a candidate after the neurons before it are taken out, below which it is spanned.
_SPANNED = 1e-14


@dataclass(eq=False, repr=False)
class RBFNetworkRegressor(Regressor):
    r"""Radial-basis-function network, grown by orthogonal least squares.

    The output is :math:`\sum_j w_j \exp(-\ln 2\, |x - c_j|^2 / s^2) + b`. Centres are training
    inputs. In each step the one is added that, made orthogonal to those before it, explains most of
    the targets (Chen, Cowan and Grant 1991); then all weights and the bias are solved for by least
    squares. The bias takes no part in the choice, as in MATLAB's ``newrb``.

    Parameters
    ----------
    spread : float
        s, at which a neuron is at one half, in the unit of the inputs.
    goal : float
        Mean squared error at which the growth ends; 0 or more.
    max_neurons : int, optional
        The most neurons. Default: as many as there are samples.

    Attributes
    ----------
    centres_ : ndarray, (neurons, inputs)
    weights_ : ndarray, (neurons, outputs)
    bias_ : ndarray, (outputs,)
    errors_ : ndarray, (neurons + 1,)
        Mean squared error with none, one, two ... neurons.

    Examples
    --------
    A bump of one neuron's shape takes one neuron, in its middle and as high as it is:

    >>> import inswsn_lib as iw, numpy as np
    >>> X = np.arange(-3.0, 4.0)[:, None]
    >>> bump = 5 * 0.5 ** X**2  # one half of 5 at the spread, 1
    >>> network = iw.RBFNetworkRegressor(spread=1.0, goal=1e-12).fit(X, bump)
    >>> network.centres_.tolist(), network.weights_.round(6).tolist()
    ([[0.0]], [[5.0]])
    """

    _learnt = ("centres_", "weights_", "bias_")

    spread: float = 1.0
    goal: float = 0.0
    max_neurons: int | None = None

    def _fit(self, X: Array, Y: Array) -> None:
        number("spread", self.spread, above=0)
        number("goal", self.goal, least=0)
        most = len(X)
        if self.max_neurons is not None:
            most = min(most, whole("max_neurons", self.max_neurons))
        responses = self._responses(X, X)
        sizes_before = np.sum(responses**2, axis=0)
        left, chosen = responses.copy(), list[int]()
        basis = np.zeros((len(X), most + 1))  # of the bias and the chosen neurons
        basis[:, 0] = 1 / np.sqrt(len(X))
        residual = Y - Y.mean(axis=0)
        error = float(np.mean(residual**2))
        errors = [error]
        while len(chosen) < most and error > self.goal:
            sizes = np.sum(left**2, axis=0)  # of what the chosen neurons do not span
            free = sizes > _SPANNED * sizes_before
            free[chosen] = False
            if not free.any():
                break
            explained = np.full(len(sizes), -1.0)
            explained[free] = np.sum((left[:, free].T @ Y) ** 2, axis=1) / sizes[free]
            best = int(np.argmax(explained))
            direction = left[:, best] / np.sqrt(sizes[best])
            left -= np.outer(direction, direction @ left)
            chosen.append(best)
            new = _beside(basis, responses[:, best])
            basis[:, len(chosen)] = new
            residual -= np.outer(new, new @ residual)
            error = float(np.mean(residual**2))
            errors.append(error)
        design = np.column_stack([responses[:, chosen], np.ones(len(X))])
        solution = np.asarray(np.linalg.lstsq(design, Y, rcond=None)[0])
        self.errors_: Array = np.array(errors)
        self.centres_: Array = X[chosen]
        self.weights_: Array = solution[:-1]
        self.bias_: Array = solution[-1]

    def _predict(self, X: Array) -> Array:
        return np.asarray(self._responses(X, self.centres_) @ self.weights_ + self.bias_)

    def _responses(self, X: Array, centres: Array) -> Array:
        """Return what each neuron says of each input, (len(X), neurons)."""
        squares = squared_distances(X, centres)
        return np.asarray(np.exp(-np.log(2) * squares / self.spread**2))


def _beside(basis: Array, column: Array) -> Array:
    """Return the unit vector along what orthonormal columns do not span of one, or zeros."""
    left = column
    for _ in range(2):  # once leaves too much where little is left, twice is enough
        left = left - basis @ (basis.T @ left)
    size = np.linalg.norm(left)
    return left / size if size > _SPANNED * np.linalg.norm(column) else np.zeros_like(left)
