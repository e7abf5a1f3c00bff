"""P1's hybrid: a filter while the network is heard, and a regressor that stands in for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn import config_context
from sklearn.base import clone

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning.scaling import Scale, Scaling

Array = NDArray[np.float64]
Filter = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class HybridRun:
    """What a `HybridNavigator` made of a sequence of measurements.

    Attributes
    ----------
    estimates : ndarray, (steps, n, runs)
        The error of the INS, by the filter in training mode and by the regressor in predictor mode.
    predicting : ndarray, (steps, runs)
        Whether the step was in predictor mode.
    fits : int
        How many times a regressor was trained.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.linear_model import LinearRegression
    >>> from inswsn_lib.navigation import HybridNavigator
    >>> heard = np.where(np.arange(30) < 20, 1.0, np.nan).reshape(30, 1, 1)
    >>> run = HybridNavigator(np.nan_to_num, LinearRegression()).run(
    ...     heard, inputs=np.arange(30.0)[:, None]
    ... )
    >>> run.estimates.shape, int(run.predicting.sum()), run.fits
    ((30, 1, 1), 10, 1)
    """

    estimates: Array
    predicting: NDArray[np.bool_]
    fits: int


class HybridNavigator:
    r"""A filter and a regressor, switched by whether there are measurements (P1 Section 4).

    In *training mode*, while the network is heard, the estimate is that of the filter, and each
    step adds a pair of an input :math:`u_k` and a target, the filter's estimate
    :math:`\hat x_k`. When measurements are missing for more than `patience` steps, the regressor is
    trained on the latest pairs and the navigator is in *predictor mode*: the estimate is the
    regressor's output for :math:`u_k`, until a measurement comes. Then the filter takes over; it
    has coasted meanwhile by its own model.

    It goes through time once. An estimate uses measurements and inputs up to its own step, given
    that the filter's do.

    Parameters
    ----------
    filter : callable
        Takes measurements (steps, m, runs), NaN where missing, and returns estimates (steps, n,
        runs), each from the measurements up to its step; for example
        ``lambda y: run_kalman(model, y)``.
    regressor : scikit-learn regressor
        It is left as it is, and clones are trained; it must take several outputs. If it has a
        method ``fit_many``, the runs are trained together, each with its own number.
    feedback : bool
        Whether the estimate of the step before is part of the input, in predictor mode the
        navigator's own.
    scaled : bool
        Whether the regressor sees inputs and targets with mean 0 and deviation 1 on the pairs it
        is trained on. P1 says nothing of scaling.
    window : int, optional
        The latest pairs that train. Default: all.
    least : int
        With fewer pairs than this, or than `window` if that is less, the estimate stays that of the
        filter.
    patience : int
        Steps without measurement, after the last one, that are still the filter's: what a network
        that is slower than the INS leaves between fixes.

    Raises
    ------
    ParameterError
        If a number is not whole or too small, the filter is no function, or the regressor is not
        one of scikit-learn.

    Examples
    --------
    A drift of 0.5 m a step; the network is silent from step 20 on. The filter, here one that only
    copies, has nothing to say then, and a linear fit of its estimates over time goes on:

    >>> import numpy as np
    >>> from sklearn.linear_model import LinearRegression
    >>> from inswsn_lib.navigation import HybridNavigator
    >>> steps = np.arange(30.0)
    >>> measured = np.where(steps < 20, 0.5 * steps, np.nan)[:, None, None]  # (steps, 1, one run)
    >>> navigator = HybridNavigator(np.nan_to_num, LinearRegression())
    >>> run = navigator.run(measured, inputs=steps[:, None])
    >>> run.estimates[[19, 20, 29], 0, 0].round(6).tolist()
    [9.5, 10.0, 14.5]
    >>> run.predicting[[19, 20, 29], 0].tolist()
    [False, True, True]
    """

    def __init__(
        self,
        filter: Filter,
        regressor: Any,
        *,
        feedback: bool = False,
        scaled: bool = True,
        window: int | None = None,
        least: int = 10,
        patience: int = 0,
    ) -> None:
        for name, value, low in (
            ("window", 1 if window is None else window, 1), ("least", least, 1),
            ("patience", patience, 0),
        ):  # fmt: skip
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < low:
                raise ParameterError(name, value, f"a whole number, {low} or more")
        if not callable(filter):
            raise ParameterError("filter", filter, "a function of measurements")
        if not all(hasattr(regressor, name) for name in ("fit", "predict", "get_params")):
            raise ParameterError("regressor", regressor, "a scikit-learn regressor")
        self.filter, self.regressor = filter, regressor
        self.feedback, self.scaled = feedback, scaled
        self.window, self.least, self.patience = window, least, patience

    def run(self, measurements: ArrayLike, inputs: ArrayLike | None = None) -> HybridRun:
        """Navigate.

        Parameters
        ----------
        measurements : array_like, (steps, m, runs)
            INS less network, NaN where missing.
        inputs : array_like, (steps, p) or (steps, p, runs), optional
            What the regressor sees of each step. In an outage they must be what a system has then.
            A step with an input that is NaN does not train, and its estimate is the filter's. None
            only with `feedback`.

        Returns
        -------
        HybridRun

        Raises
        ------
        ParameterError
            If a shape does not fit, an input is infinite, there is no input at all, the filter's
            estimates are not finite where it is to train, or the regressor cannot be trained, or
            predicts another shape or what is not finite.

        Examples
        --------
        With feedback there need be no other input. The regressor learns each estimate from the one
        before it, here that they grow by 0.5, and goes on from the last of the filter and then from
        its own:

        >>> import numpy as np
        >>> from sklearn.linear_model import LinearRegression
        >>> from inswsn_lib.navigation import HybridNavigator
        >>> steps = np.arange(30.0)
        >>> measured = np.where(steps < 20, 0.5 * steps, np.nan)[:, None, None]
        >>> navigator = HybridNavigator(np.nan_to_num, LinearRegression(), feedback=True)
        >>> navigator.run(measured).estimates[[19, 20, 29], 0, 0].round(6).tolist()
        [9.5, 10.0, 14.5]
        """
        y = np.asarray(measurements, dtype=float)
        if y.ndim != 3:
            raise ParameterError("measurements", f"of shape {y.shape}", "(steps, m, runs)")
        u = self._checked_inputs(inputs, y)
        estimates = np.array(self.filter(y), dtype=float)
        if estimates.ndim != 3 or estimates.shape[::2] != y.shape[::2]:
            raise ParameterError(
                "filter", f"one that returns {estimates.shape}", "(steps, n, runs)"
            )
        heard, told = ~np.isnan(y).all(axis=1), ~np.isnan(u).any(axis=1)
        predicting, fits = np.zeros_like(heard), 0
        # runs with the same gaps are trained together
        patterns, which = np.unique(np.vstack([heard, told]), axis=1, return_inverse=True)
        for i, pattern in enumerate(patterns.T):
            runs = np.flatnonzero(which.ravel() == i)
            hears, knows = np.split(pattern, 2)
            for first, end in _silences(hears, self.patience):
                rows = np.flatnonzero((hears & knows)[:first])[-(self.window or first) :]
                if self.feedback:
                    rows = rows[rows > 0]
                steps = np.flatnonzero(knows[first:end]) + first
                if len(rows) < min(self.least, self.window or self.least) or not len(steps):
                    continue
                # what goes to the regressor is checked here, once
                with config_context(assume_finite=True):
                    found = self._predicted(estimates[..., runs], u[..., runs], rows, steps, runs)
                estimates[np.ix_(steps, np.arange(estimates.shape[1]), runs)] = found
                predicting[np.ix_(steps, runs)] = True
                fits += len(runs)
        return HybridRun(estimates, predicting, fits)

    def _checked_inputs(self, inputs: ArrayLike | None, y: Array) -> Array:
        steps, _, runs = y.shape
        if inputs is None:
            if not self.feedback:
                raise ParameterError("inputs", None, "given, unless feedback is true")
            return np.empty((steps, 0, runs))
        u = np.asarray(inputs, dtype=float)
        if u.ndim == 2:
            u = np.repeat(u[:, :, None], runs, axis=2)
        if u.ndim != 3 or u.shape[::2] != (steps, runs):
            raise ParameterError("inputs", f"of shape {u.shape}", f"({steps}, p, {runs})")
        if np.isinf(u).any():
            raise ParameterError("inputs", "infinite", "finite, or NaN where missing")
        return u

    def _predicted(
        self,
        known: Array,
        u: Array,
        rows: NDArray[np.intp],
        steps: NDArray[np.intp],
        numbers: NDArray[np.intp],
    ) -> Array:
        """Train on some rows of the estimates; return the estimates of some steps after them.

        `known` is (all, n, runs), `u` is (all, p, runs); the result is (steps, n, runs). `numbers`
        are those of the runs.
        """
        runs = known.shape[2]
        X, Y = u[rows], known[rows]
        if self.feedback:
            X = np.concatenate([X, known[rows - 1]], axis=1)
        if not np.isfinite(Y).all() or not np.isfinite(X).all():
            raise ParameterError(
                "filter", "one with estimates not finite", "finite where it trains"
            )
        scaling: Scaling = "standard" if self.scaled else "none"
        X_scale, Y_scale = Scale.of(X, scaling), Scale.of(Y, scaling)
        X, Y = X_scale.there(X), Y_scale.there(Y)
        machines = fit_many(
            self.regressor,
            [X[:, :, r] for r in range(runs)],
            [Y[:, :, r] for r in range(runs)],
            numbers.tolist(),
        )

        def outputs(inputs: Array) -> Array:
            Z = X_scale.there(inputs)
            each = [_predict(m, Z[:, :, r], Y.shape[1]) for r, m in enumerate(machines)]
            return Y_scale.back(np.stack(each, axis=2))

        if not self.feedback:
            return outputs(u[steps])
        found = np.empty((len(steps), *known.shape[1:]))
        for i, k in enumerate(steps):
            # the step before is the filter's at the start, and where it had no input
            last = found[i - 1] if i and steps[i - 1] == k - 1 else known[k - 1]
            found[i] = outputs(np.concatenate([u[k], last], axis=0)[None])[0]
        return found


def fit_many(
    regressor: Any, Xs: list[Array], ys: list[Array], numbers: list[int] | None = None
) -> list[Any]:
    """Train a clone of a regressor on each of several data sets.

    Parameters
    ----------
    regressor : scikit-learn regressor
        If it has a method ``fit_many``, that trains them all at once.
    Xs, ys : list of ndarray
        Inputs (samples, inputs) and targets (samples, outputs).
    numbers : list of int, optional
        Of the data sets, for random numbers that differ; only ``fit_many`` is told. Default: 0, 1,
        2 ...

    Returns
    -------
    list
        The fitted clones.

    Raises
    ------
    ParameterError
        If a fit fails.

    Examples
    --------
    The regressor that is given stays as it is:

    >>> import numpy as np
    >>> from sklearn.linear_model import LinearRegression
    >>> from inswsn_lib.navigation import fit_many
    >>> X = np.arange(5.0)[:, None]
    >>> given = LinearRegression()
    >>> machines = fit_many(given, [X, X], [2 * X, 3 * X])
    >>> [round(machine.coef_.item(), 6) for machine in machines], hasattr(given, "coef_")
    ([2.0, 3.0], False)
    """
    if hasattr(regressor, "fit_many"):
        return list(regressor.fit_many(Xs, ys, numbers))
    try:
        return [clone(regressor).fit(X, y) for X, y in zip(Xs, ys, strict=True)]
    except Exception as error:
        raise ParameterError(
            "regressor",
            f"{type(regressor).__name__}, whose fit fails: {type(error).__name__}: {error}",
            f"one that trains on inputs {Xs[0].shape} and targets {ys[0].shape}",
        ) from error


def observable_inputs(time: ArrayLike, ins: ArrayLike) -> dict[str, Array]:
    r"""Return inputs for a regressor that a system has in an outage, each (steps, p, runs).

    Parameters
    ----------
    time : array_like, (steps,)
        s.
    ins : array_like, (steps, 4, runs)
        What the INS alone indicates: position (m) and velocity (m/s).

    Returns
    -------
    dict of str to ndarray
        ``"time"``, seconds since the first step; ``"motion"``, the indicated position and velocity;
        ``"inertial"``, time and the indicated acceleration, the last change of velocity over its
        period (m/s^2), NaN at the first step.

    Raises
    ------
    ParameterError
        If a shape does not fit, or time does not increase.

    Examples
    --------
    An INS that speeds up by 2 m/s^2 along x:

    >>> import numpy as np
    >>> from inswsn_lib.navigation import observable_inputs
    >>> time = np.array([10.0, 10.5, 11.0])
    >>> ins = np.stack([(time - 10) ** 2, 0 * time, 2 * (time - 10), 0 * time], axis=1)[:, :, None]
    >>> inputs = observable_inputs(time, ins)
    >>> {name: x.shape for name, x in inputs.items()}
    {'time': (3, 1, 1), 'motion': (3, 4, 1), 'inertial': (3, 3, 1)}
    >>> inputs["inertial"][:, :, 0].tolist()  # time, and the acceleration along x and y
    [[0.0, nan, nan], [0.5, 2.0, 0.0], [1.0, 2.0, 0.0]]
    """
    t, x = np.asarray(time, dtype=float), np.asarray(ins, dtype=float)
    if x.ndim != 3 or x.shape[1] != 4 or len(x) < 2:
        raise ParameterError("ins", f"of shape {x.shape}", "(2 or more steps, 4, runs)")
    if t.shape != (len(x),) or not (np.diff(t) > 0).all():
        raise ParameterError("time", f"of shape {t.shape}", f"({len(x)},), increasing")
    clock = np.repeat((t - t[0])[:, None, None], x.shape[2], axis=2)
    change = np.diff(x[:, 2:], axis=0) / np.diff(t)[:, None, None]
    acceleration = np.concatenate([np.full_like(x[:1, 2:], np.nan), change])
    return {"time": clock, "motion": x, "inertial": np.concatenate([clock, acceleration], axis=1)}


def _silences(heard: NDArray[np.bool_], patience: int) -> list[tuple[int, int]]:
    """Return where predictor mode begins and ends: after each gap's first `patience` steps."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~heard, [False]]).astype(int)))
    return [(int(a) + patience, int(b)) for a, b in edges.reshape(-1, 2) if b - a > patience]


def _predict(machine: Any, X: Array, outputs: int) -> Array:
    found = np.asarray(machine.predict(np.ascontiguousarray(X)), dtype=float)
    if found.size != len(X) * outputs or not np.isfinite(found).all():
        name = type(machine).__name__
        raise ParameterError(
            "regressor",
            f"{name}, which predicts {found.shape}, or numbers that are not finite",
            f"one that predicts ({len(X)}, {outputs}), all finite",
        )
    return found.reshape(len(X), outputs)
