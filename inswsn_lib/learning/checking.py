"""What every estimator of this room asks of data, first in ``fit`` and first in ``predict``.

scikit-learn checks them. It takes a fifth of a millisecond, most of it to rule out data frames;
predictions during an outage are made one input at a time, and take less. So finite arrays of
floats, which scikit-learn would hand back as they are, are told at once.
"""

from __future__ import annotations

from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted, validate_data

Array = NDArray[np.float64]


def data_to_fit(estimator: BaseEstimator, X: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Return inputs and targets as arrays of floats, and note how many inputs there are.

    Parameters
    ----------
    estimator : BaseEstimator
        What is being fitted; it gets ``n_features_in_``, as in scikit-learn.
    X : array_like, (n, inputs)
        Inputs.
    y : array_like, (n,) or (n, outputs)
        Targets.

    Returns
    -------
    inputs : ndarray, (n, inputs)
    targets : ndarray, (n,) or (n, outputs)

    Raises
    ------
    ValueError
        If they are not such arrays, or not finite.
    """
    if (
        _is_plain(X)
        and X.ndim == 2
        and _is_plain(y)
        and y.ndim in (1, 2)
        and len(X) == len(y)
        and not hasattr(estimator, "feature_names_in_")
    ):
        estimator.n_features_in_ = X.shape[1]
        return X, y
    inputs, y = validate_data(estimator, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
    return inputs, np.asarray(y, dtype=np.float64)


def data_to_predict(estimator: BaseEstimator, X: ArrayLike) -> Array:
    """Return inputs of a fitted estimator as an array of floats.

    Parameters
    ----------
    estimator : BaseEstimator
        What is to predict.
    X : array_like, (n, inputs)
        Inputs, as many as it was fitted with.

    Returns
    -------
    ndarray, (n, inputs)

    Raises
    ------
    sklearn.exceptions.NotFittedError
        If the estimator is not fitted.
    ValueError
        If they are not such an array, not finite, or more or fewer than it was fitted with.
    """
    if (
        _is_plain(X)
        and X.ndim == 2
        and X.shape[1] == getattr(estimator, "n_features_in_", None)
        and not hasattr(estimator, "feature_names_in_")
    ):
        return X
    check_is_fitted(estimator)
    inputs: Array = validate_data(estimator, X, reset=False, dtype=np.float64)
    return inputs


def _is_plain(values: Any) -> TypeGuard[Array]:
    return (
        type(values) is np.ndarray
        and values.dtype == np.float64
        and values.size > 0
        and bool(np.isfinite(values).all())
    )
