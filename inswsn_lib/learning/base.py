"""The base of the regressors, the simplest of them, and the scaling of data."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin, clone
from sklearn.utils.validation import check_is_fitted, validate_data

from inswsn_lib.checks import Array, unmasked

Scaling = Literal["range", "standard", "none"]


class Regressor(MultiOutputMixin, RegressorMixin, BaseEstimator, ABC):  # type: ignore[misc]
    """Base of a regressor that follows the interface of scikit-learn.

    A subclass has ``_fit(X, Y)``, which learns from arrays (n, inputs) and (n, outputs), and
    ``_predict(X)``, which returns (n, outputs). Here data are checked, and one output may be flat.
    Parameters are the fields of a dataclass, ``@dataclass(eq=False, repr=False)``.

    Examples
    --------
    >>> import inswsn_lib as iw, numpy as np
    >>> class Mean(iw.learning.Regressor):
    ...     def _fit(self, X, Y): self.mean_ = Y.mean(axis=0)
    ...     def _predict(self, X): return np.tile(self.mean_, (len(X), 1))
    >>> Mean().fit([[0.0], [1.0]], [2.0, 4.0]).predict([[9.0]]).tolist()
    [3.0]
    """

    #: Names of what was learnt, arrays of one or two axes. A class that has them itself predicts
    #: from stacks of them, (runs, ...), and of inputs, (runs, n, inputs), too: see `joined`
    _learnt: ClassVar[tuple[str, ...]] = ()

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Learn from inputs and targets; return itself.

        Parameters
        ----------
        X : array_like, (n, inputs)
        y : array_like, (n,) or (n, outputs)

        Raises
        ------
        ParameterError
            If a parameter has a value it may not have.
        ValueError
            If the data are not such arrays, or not finite.
        """
        self._fit(*self._samples(X, y))
        return self

    def predict(self, X: ArrayLike) -> Array:
        """Return the predictions for inputs (n, inputs): (n,) or (n, outputs), as the targets."""
        return self._shaped(self._predict(self._inputs(X)))

    def __sklearn_clone__(self) -> Self:
        """Return one with the same parameters that has learnt nothing.

        scikit-learn would read the signature each time, which takes longer than a small fit.
        """
        values = {name: getattr(self, name) for name in _parameters(type(self))}
        return type(self)(**{n: clone(value, safe=False) for n, value in values.items()})

    @abstractmethod
    def _fit(self, X: Array, Y: Array) -> None:
        """Check the parameters, and learn from inputs (n, inputs) and targets (n, outputs)."""

    @abstractmethod
    def _predict(self, X: Array) -> Array:
        """Return the outputs (n, outputs) for inputs (n, inputs)."""

    def _samples(self, X: Any, y: Any) -> tuple[Array, Array]:
        """Return inputs and targets as arrays (n, inputs) and (n, outputs); note their shape."""
        plain = self._is_plain(X) and _is_finite(y) and y.ndim in (1, 2) and len(X) == len(y)
        if plain:
            self.n_features_in_ = X.shape[1]
        else:
            X, y = unmasked(X), unmasked(y)
            X, y = validate_data(self, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
            y = np.asarray(y, dtype=np.float64)
        self._flat = y.ndim == 1
        return X, y.reshape(len(y), -1)

    def _inputs(self, X: Any) -> Array:
        """Return inputs as an array (n, inputs), as many as the estimator was fitted with."""
        if not self._is_plain(X) or X.shape[1] != getattr(self, "n_features_in_", None):
            check_is_fitted(self)
            X = validate_data(self, unmasked(X), reset=False, dtype=np.float64)
        return X  # type: ignore[no-any-return]

    def _shaped(self, outputs: Array) -> Array:
        """Return outputs (..., outputs), without the last axis if the targets had none."""
        return outputs[..., 0] if self._flat else outputs

    def _is_plain(self, X: Any) -> bool:
        """Tell inputs that scikit-learn would hand back as they are.

        It takes a fifth of a millisecond to find out, most of it to rule out data frames. Most
        predictions in an outage are made one input at a time, and take less.
        """
        return _is_finite(X) and X.ndim == 2 and not hasattr(self, "feature_names_in_")


@cache
def _parameters(kind: type[Regressor]) -> tuple[str, ...]:
    """Return the names of an estimator's parameters."""
    return tuple(kind._get_param_names())


def joined(machines: Sequence[Any]) -> Callable[[Array], Array] | None:
    """Return what predicts with many machines at once, (runs, n, inputs) to (runs, n, outputs).

    None if it cannot be done: they must be of one class that says what it learns, with equal
    parameters, and have learnt arrays of the same shapes.

    Examples
    --------
    >>> import inswsn_lib as iw, numpy as np
    >>> from inswsn_lib.learning.base import joined
    >>> steep, flat = (iw.LSSVMRegressor(kernel="linear", eta=1e9) for _ in range(2))
    >>> both = joined([steep.fit([[0], [1]], [0, 5]), flat.fit([[0], [1]], [0, 2])])
    >>> both(np.array([[[2.0]], [[3.0]]])).round(6).tolist()
    [[[10.0]], [[6.0]]]
    """
    kind: type[Regressor] = type(machines[0])
    if not vars(kind).get("_learnt") or any(type(machine) is not kind for machine in machines):
        return None
    together = copy(machines[0])
    parameters = [[getattr(m, name) for name in _parameters(kind)] for m in machines]
    if any(found != parameters[0] for found in parameters):
        return None
    for name in kind._learnt:
        parts = [np.atleast_2d(getattr(machine, name)) for machine in machines]
        if len({part.shape for part in parts}) > 1:
            return None
        setattr(together, name, np.stack(parts))
    return together._predict  # type: ignore[no-any-return]


def _is_finite(values: Any) -> bool:
    """Tell whether values are an array of finite floats that is not empty."""
    return (
        type(values) is np.ndarray
        and values.dtype == np.float64
        and values.size > 0
        and bool(np.isfinite(values).all())
    )


class HoldRegressor(Regressor):
    """Predict the last target it was given, whatever the input.

    Attributes
    ----------
    last_ : ndarray, (outputs,)

    Examples
    --------
    The least that a method has to beat:

    >>> import inswsn_lib as iw
    >>> iw.HoldRegressor().fit([[0], [1], [2]], [5, 6, 7]).predict([[3], [100]]).tolist()
    [7.0, 7.0]
    """

    def _fit(self, X: Array, Y: Array) -> None:
        self.last_: Array = Y[-1].copy()

    def _predict(self, X: Array) -> Array:
        return np.tile(self.last_, (len(X), 1))


@dataclass(frozen=True, eq=False)
class Scale:
    """An affine map that brings columns to one size; those that do not vary are only moved.

    It is quicker than a scaler of scikit-learn, which checks its data each time, and takes stacks.

    Attributes
    ----------
    middle, size : ndarray, (columns,) or (columns, runs)

    Examples
    --------
    >>> import inswsn_lib as iw, numpy as np
    >>> values = np.array([[0.0, 1000.0, 7.0], [1.0, 2000.0, 7.0], [2.0, 3000.0, 7.0]])
    >>> scale = iw.learning.Scale.of(values, "range")
    >>> scale.transform(values).tolist()
    [[-1.0, -1.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 0.0]]
    """

    middle: Array
    size: Array

    @classmethod
    def of(cls, values: Array, scaling: Scaling) -> Scale:
        """Return the map of values (rows, columns) or (rows, columns, runs), each run its own.

        It brings their range to [-1, 1], or mean and deviation to 0 and 1, or changes nothing.
        """
        if scaling == "none":
            return cls(np.zeros(values.shape[1:]), np.ones(values.shape[1:]))
        low, high = values.min(axis=0), values.max(axis=0)
        middle, size = (low + high) / 2, (high - low) / 2
        if scaling == "standard":
            middle, size = values.mean(axis=0), values.std(axis=0)
        # the deviation of equal numbers need not be 0 exactly
        return cls(middle, np.where((low < high) & (size > 0), size, 1.0))

    def transform(self, values: Array) -> Array:
        """Return values in the new units."""
        return (values - self.middle) / self.size

    def inverse_transform(self, values: Array) -> Array:
        """Return values in the units that they came from."""
        return values * self.size + self.middle
