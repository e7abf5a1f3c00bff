"""P1's hybrid: a filter while the network is heard, and a regressor that stands in for it."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn import config_context
from sklearn.base import clone

from inswsn_lib.checks import Array, Mask, array, of_runs, whole
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.learning import Scale
from inswsn_lib.learning.base import Scaling, joined

Filter = Callable[[Array], Array]
Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class HybridRun:
    """What a `HybridNavigator` made of a sequence of measurements.

    Attributes
    ----------
    estimates : ndarray, (steps, states) or (steps, states, runs)
        The error of the INS, by the filter in training mode and by the regressor in predictor mode.
    predicting : ndarray, (steps,) or (steps, runs)
        Whether the step was in predictor mode.

    Examples
    --------
    >>> import inswsn_lib as iw, numpy as np
    >>> heard = np.where(np.arange(30) < 20, 1.0, np.nan)[:, None]
    >>> navigator = iw.HybridNavigator(np.nan_to_num, iw.HoldRegressor())
    >>> run = navigator.run(heard, inputs=np.arange(30.0)[:, None])
    >>> run.estimates.shape, int(run.predicting.sum())
    ((30, 1), 10)
    """

    estimates: Array
    predicting: Mask


class HybridNavigator:
    r"""A filter and a regressor, switched by whether there are measurements (P1 Section 4).

    In *training mode*, while the network is heard, the estimate is that of the filter, and each
    step adds a pair of an input :math:`u_k` and a target, the filter's estimate
    :math:`\hat x_k`. When measurements are missing for more than `patience` steps, the regressor is
    trained on the latest pairs and the navigator is in *predictor mode*: the estimate is the
    regressor's output for :math:`u_k`, until a measurement comes. Then the filter takes over; it
    has coasted meanwhile by its own model. An estimate uses measurements and inputs up to its own
    step, given that the filter's do.

    Parameters
    ----------
    filter : callable
        Takes measurements as they are given to `run`, NaN where missing, and returns estimates
        (steps, states) or (steps, states, runs), for example ``lambda y: run_kalman(model, y)``.
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
        Steps without measurement, after the last one, that are still the filter's: the gaps
        between fixes of a network that is slower than the INS.

    Raises
    ------
    ParameterError
        If a number is not whole or too small.

    Examples
    --------
    A drift of 0.5 m a step; the network is silent from step 20 on. The filter, here one that only
    copies, has nothing to say then, and a linear fit of its estimates over time goes on:

    >>> import inswsn_lib as iw, numpy as np
    >>> steps = np.arange(30.0)[:, None]
    >>> measured = np.where(steps < 20, 0.5 * steps, np.nan)
    >>> line = iw.LSSVMRegressor(eta=1e6, kernel="linear")
    >>> run = iw.HybridNavigator(np.nan_to_num, line).run(measured, inputs=steps)
    >>> run.estimates[[19, 20, 29], 0].round(3).tolist()
    [9.5, 10.0, 14.5]
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
        self.filter, self.regressor = filter, regressor
        self.feedback, self.scaled = feedback, scaled
        self.window = None if window is None else whole("window", window, 1)
        self.least, self.patience = whole("least", least, 1), whole("patience", patience)

    def run(self, measurements: ArrayLike, inputs: ArrayLike | None = None) -> HybridRun:
        """Navigate.

        Parameters
        ----------
        measurements : array_like, (steps, outputs) or (steps, outputs, runs)
            INS less network, NaN where missing.
        inputs : array_like, (steps, inputs) or (steps, inputs, runs), optional
            What the regressor sees of each step. In an outage they must be what a system has then.
            A step with an input that is NaN does not train, and its estimate is the filter's. None
            only with `feedback`.

        Returns
        -------
        HybridRun

        Raises
        ------
        ParameterError
            If an argument is something else, the filter's estimates are not finite where it is to
            train, or the regressor cannot be trained, or predicts another shape or what is not
            finite.
        """
        y, back = of_runs("measurements", measurements, "steps", "outputs", "runs", gaps=True)
        steps, _, runs = y.shape
        if inputs is None:
            if not self.feedback:
                raise ParameterError("inputs", None, "given unless feedback is true")
            inputs = np.empty((steps, 0))
        u = array("inputs", inputs, (steps, "inputs"), (steps, "inputs", runs), gaps=True)
        if u.ndim == 2:
            u = np.repeat(u[:, :, None], runs, axis=2)
        given = self.filter(back(y))
        filtered, _ = of_runs("what filter returns", given, steps, "states", runs, gaps=True)
        estimates = filtered.copy()
        heard = np.asarray(~np.isnan(y).all(axis=1))
        told = np.asarray(~np.isnan(u).any(axis=1))
        predicting = np.zeros_like(heard)
        # runs with the same gaps are trained together
        patterns: dict[bytes, list[int]] = {}
        for r, pattern in enumerate(np.vstack([heard, told]).T):
            patterns.setdefault(pattern.tobytes(), []).append(r)
        for alike in map(np.array, patterns.values()):
            hears, knows = heard[:, alike[0]], told[:, alike[0]]
            for first, end in _silences(hears, self.patience):
                rows = np.flatnonzero((hears & knows)[:first])[-(self.window or first) :]
                if self.feedback:
                    rows = rows[rows > 0]
                ahead = np.flatnonzero(knows[first:end]) + first
                if len(rows) < min(self.least, self.window or self.least) or not len(ahead):
                    continue
                # what goes to the regressor is checked here, once
                with config_context(assume_finite=True):
                    found = self._predicted(
                        estimates[..., alike], u[..., alike], rows, ahead, alike
                    )
                estimates[np.ix_(ahead, np.arange(estimates.shape[1]), alike)] = found
                predicting[np.ix_(ahead, alike)] = True
        return HybridRun(back(estimates), back(predicting))

    def _predicted(self, known: Array, u: Array, rows: Rows, ahead: Rows, numbers: Rows) -> Array:
        """Train on some rows of the estimates; return the estimates of the steps ahead.

        `known` is (steps, states, runs), `u` is (steps, inputs, runs); the result is (ahead,
        states, runs). `numbers` are those of the runs.
        """
        X, Y = u[rows], known[rows]
        if self.feedback:
            X = np.concatenate([X, known[rows - 1]], axis=1)
        if not np.isfinite(Y).all() or not np.isfinite(X).all():
            raise ParameterError(
                "what filter returns", Described("NaN or infinite"), "finite where it trains"
            )
        scaling: Scaling = "standard" if self.scaled else "none"
        X_scale, Y_scale = Scale.of(X, scaling), Scale.of(Y, scaling)
        Xs = list(np.moveaxis(X_scale.transform(X), 2, 0))
        Ys = list(np.moveaxis(Y_scale.transform(Y), 2, 0))
        machines = _fit_many(self.regressor, Xs, Ys, numbers.tolist())

        # it takes more memory, and pays where inputs come one by one
        together = joined(machines) if self.feedback else None

        def outputs(inputs: Array) -> Array:
            Z = np.moveaxis(X_scale.transform(inputs), 2, 0)
            shape = (Z.shape[1], Y.shape[1])
            if together:
                found = _checked(machines[0], together(Z), (len(Z), *shape))
            else:
                each = zip(machines, Z, strict=True)
                found = np.stack([_checked(m, m.predict(z), shape) for m, z in each])
            return Y_scale.inverse_transform(np.moveaxis(found, 0, 2))

        if not self.feedback:
            return outputs(u[ahead])
        found = np.empty((len(ahead), *known.shape[1:]))
        for i, k in enumerate(ahead):
            # the step before is the filter's at the start, and where it had no input
            last = found[i - 1] if i and ahead[i - 1] == k - 1 else known[k - 1]
            found[i] = outputs(np.concatenate([u[k], last], axis=0)[None])[0]
        return found


def observable_inputs(time: ArrayLike, ins: ArrayLike) -> dict[str, Array]:
    r"""Return the inputs that a regressor has in an outage, with a runs axis if `ins` has one.

    Parameters
    ----------
    time : array_like, (steps,)
        s, increasing.
    ins : array_like, (steps, 4) or (steps, 4, runs)
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

    >>> import inswsn_lib as iw, numpy as np
    >>> time = np.array([10.0, 10.5, 11.0])
    >>> ins = np.stack([(time - 10) ** 2, 0 * time, 2 * (time - 10), 0 * time], axis=1)
    >>> inputs = iw.observable_inputs(time, ins)
    >>> inputs["inertial"].tolist()  # time, and the acceleration along x and y
    [[0.0, nan, nan], [0.5, 2.0, 0.0], [1.0, 2.0, 0.0]]
    """
    x, back = of_runs("ins", ins, "steps", 4, "runs", gaps=True)
    t = array("time", time, (len(x),))
    if not (np.diff(t) > 0).all():
        raise ParameterError("time", Described("out of order"), "increasing")
    clock = np.repeat((t - t[0])[:, None, None], x.shape[2], axis=2)
    change = np.diff(x[:, 2:], axis=0) / np.diff(t)[:, None, None]
    acceleration = np.concatenate([np.full_like(x[:1, 2:], np.nan), change])
    inertial = np.concatenate([clock, acceleration], axis=1)
    return {"time": back(clock), "motion": back(x), "inertial": back(inertial)}


def _silences(heard: Mask, patience: int) -> list[tuple[int, int]]:
    """Return where predictor mode begins and ends: after each gap's first `patience` steps."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~heard, [False]]).astype(int)))
    return [(int(a) + patience, int(b)) for a, b in edges.reshape(-1, 2) if b - a > patience]


def _fit_many(regressor: Any, Xs: list[Array], ys: list[Array], numbers: list[int]) -> list[Any]:
    """Return clones of a regressor, each trained on its data set, of which a run has the number."""
    if hasattr(regressor, "fit_many"):
        return list(regressor.fit_many(Xs, ys, numbers))
    try:
        blank = clone(regressor)  # once, since it looks up anew what parameters there are
        return [deepcopy(blank).fit(X, y) for X, y in zip(Xs, ys, strict=True)]
    except Exception as error:
        told = f"{type(regressor).__name__}, whose fit fails: {type(error).__name__}: {error}"
        must_be = f"one that trains on inputs {Xs[0].shape} and targets {ys[0].shape}"
        raise ParameterError("regressor", Described(told), must_be) from error


def _checked(machine: Any, predicted: Any, shape: tuple[int, ...]) -> Array:
    found = np.asarray(predicted, dtype=float)
    if found.size != math.prod(shape) or not np.isfinite(found).all():
        got = Described(f"{type(machine).__name__}, which predicts {found.shape} or not finite")
        raise ParameterError("regressor", got, f"one that predicts finite numbers, {shape}")
    return found.reshape(shape)
