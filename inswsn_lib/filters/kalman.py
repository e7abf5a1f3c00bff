"""The Kalman filter: its gains for a pattern of data, runs of it, and its steady state."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import Array, Mask, array, covariance, mask
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.filters.inputs import (
    certain_innovation,
    first_state,
    measured,
    over_steps,
    solve_present,
    times,
)
from inswsn_lib.kernels import choose
from inswsn_lib.models import ErrorModel

_ROUNDING = 1e-8  # by which rounding moves the modes of a gain, in the units of its solution
_FAR = 1e5  # times the variance of a measurement: that of a prediction that needs square roots
Indices = NDArray[np.intp]
_contiguous = np.ascontiguousarray
#: K, I - K C, P, P+ and C P C' + R
_Step = tuple[Array, Array, Array, Array, Array]
_REMEMBERED = 64  # steps whose gains are kept; rounding takes few turns before it repeats itself
# s that the compiled form saves a step, and a step of each of many runs: see benchmarks/kernels.py
_SAVED, _SAVED_EACH = 5e-5, 3e-8


@dataclass(frozen=True, eq=False)
class KalmanDesign:
    """Gains and covariances of a Kalman filter, which do not depend on the measured values.

    Attributes
    ----------
    gains : ndarray, (steps, n, m)
        K_k; zero for components that are not measured at step k.
    predicted, filtered : ndarray, (steps, n, n)
        Covariance of the state before and after the measurement of step k.
    innovation : ndarray, (steps, m, m)
        Covariance of the innovation, C P C' + R, of all components, measured or not.

    Examples
    --------
    The gains of a random walk with noises of unit size are ratios of Fibonacci numbers:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> iw.design_kalman(model, [[True]] * 3, initial_covariance=[[1]]).gains.ravel().round(4)
    array([0.5   , 0.6   , 0.6154])
    """

    gains: Array
    predicted: Array
    filtered: Array
    innovation: Array


def design_kalman(
    model: ErrorModel,
    available: ArrayLike,
    *,
    initial_covariance: ArrayLike,
    process_covariance: ArrayLike | None = None,
    measurement_covariance: ArrayLike | None = None,
    A: ArrayLike | None = None,
    B: ArrayLike | None = None,
    C: ArrayLike | None = None,
) -> KalmanDesign:
    r"""Compute the gains of the Kalman filter for a pattern of available measurements.

    .. math::
        K_k = P_k C' (C P_k C' + R_k)^{-1}, \quad
        P_k^+ = (I - K_k C) P_k (I - K_k C)' + K_k R_k K_k', \quad
        P_{k+1} = A P_k^+ A' + Q_k

    The jitter E, which multiplies the state, is left out. Over 10^5 steps and ratios of Q to R from
    10^-12 to 10^12, with measurements that are missing, covariances are those of 50 digits to 1e-8
    of the products of deviations, those of predictions to 1e-11.

    Parameters
    ----------
    model : ErrorModel
        A, C, and by default Q = B B' and R = D D'.
    available : array_like of bool, (steps, m)
        Which components are measured at each step.
    initial_covariance : array_like, (n, n)
        P_0, before the first measurement.
    process_covariance : array_like, (n, n) or (steps, n, n), optional
        Q; entry k drives step k to k + 1.
    measurement_covariance : array_like, (m, m) or (steps, m, m), optional
        R.
    A, B, C : array_like, (n, n), (n, p) and (m, n), or (steps, ., .), optional
        Instead of those of the model; entry k of A and B leads from step k to k + 1, that of C is
        measured at step k.

    Examples
    --------
    Where the second measurement is missing, its gain is zero and the covariance grows by Q:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> design = iw.design_kalman(model, [[True], [False]], initial_covariance=[[1]])
    >>> design.gains.ravel().tolist(), design.filtered.ravel().tolist()
    ([0.5, 0.0], [0.5, 1.5])
    """
    there = mask("available", available, ("steps", len(model.C)))
    told = _Steps.of(model, process_covariance, measurement_covariance, len(there), A, B, C)
    covariances = _Covariances.start(model, initial_covariance)
    steps = [covariances.step(here, told, k) for k, here in enumerate(there[:, None])]
    m, n = model.C.shape
    gains, _, *others = (
        np.array([step[i] for step in steps]).reshape(len(steps), *shape)
        for i, shape in enumerate([(n, m), (n, n), (n, n), (n, n), (m, m)])
    )
    return KalmanDesign(gains, *others)


def run_kalman(
    model: ErrorModel,
    measurements: ArrayLike,
    *,
    initial_covariance: ArrayLike,
    process_covariance: ArrayLike | None = None,
    measurement_covariance: ArrayLike | None = None,
    initial_state: ArrayLike | None = None,
    predicted: bool = False,
    A: ArrayLike | None = None,
    B: ArrayLike | None = None,
    C: ArrayLike | None = None,
    control: ArrayLike | None = None,
) -> Array:
    """Run the Kalman filter of `design_kalman` over one run, or any number at once.

    Over 10^5 steps and ratios of Q to R from 10^-12 to 10^12 the estimates are those of 50 digits
    to 1e-7 of their size, or of their deviation where that is larger.

    Parameters
    ----------
    model : ErrorModel
        A, C, and by default Q = B B' and R = D D'.
    measurements : array_like, (steps, m) or (steps, m, runs)
        y; NaN, or masked, where a component is missing. Where all are, the filter predicts.
    initial_covariance, process_covariance, measurement_covariance, A, B, C
        As in `design_kalman`.
    initial_state : array_like, (n,) or (n, runs), optional
        The state before the first measurement. Default: zero.
    predicted : bool
        Return the state before the measurement of each step instead of after it.
    control : array_like, (steps, n) or (steps, n, runs), optional
        What is known to be added to the state, as G u of an input u; entry k from step k to k + 1.

    Returns
    -------
    ndarray, (steps, n) or (steps, n, runs)
        As the measurements are given. ``estimates[k]`` uses those up to and including step k, or
        before step k if `predicted`.

    Examples
    --------
    A random walk that is measured at 1 m, is not measured, and is measured at 1 m again:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> measured = [[1.0], [float("nan")], [1.0]]
    >>> iw.run_kalman(model, measured, initial_covariance=[[1]]).round(4).tolist()
    [[0.5], [0.5], [0.8571]]
    """
    there, y, back = measured(measurements, "steps", len(model.C), "runs")
    told = _Steps.of(model, process_covariance, measurement_covariance, len(y), A, B, C)
    covariances = _Covariances.start(model, initial_covariance)
    x = first_state(initial_state, len(model.A), y.shape[2])
    known = None
    if control is not None:
        shape = len(y), *x.shape
        added = array("control", control, shape[:2], shape).reshape(*shape[:2], -1)
        known = np.broadcast_to(added, shape)
    return back(_run(covariances, told, there, y, x, predicted, known)[0])


def stream_kalman(
    model: ErrorModel,
    measurements: Iterable[ArrayLike],
    *,
    initial_covariance: ArrayLike,
    process_covariance: ArrayLike | None = None,
    measurement_covariance: ArrayLike | None = None,
    initial_state: ArrayLike | None = None,
    predicted: bool = False,
) -> Iterator[Array]:
    """Run the Kalman filter of `run_kalman` over measurements that come piece by piece.

    So a record of any length takes the memory of a piece. Joined, the estimates are those of
    `run_kalman` of all steps at once.

    Parameters
    ----------
    model : ErrorModel
        As in `run_kalman`.
    measurements : iterable of array_like, (steps, m) or (steps, m, runs)
        One piece after the other, of any lengths and of the same runs.
    process_covariance, measurement_covariance : array_like, (n, n) and (m, m), optional
        Q and R, the same at all steps.
    initial_covariance, initial_state, predicted
        As in `run_kalman`, before the first piece.

    Yields
    ------
    ndarray, (steps, n) or (steps, n, runs)
        Of each piece, as it is given.

    Examples
    --------
    A random walk that is measured for 10,000 steps, in pieces of 1,000:

    >>> import numpy as np
    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> y = np.random.default_rng(0).normal(size=(10_000, 1, 3))
    >>> pieces = iw.stream_kalman(model, np.split(y, 10), initial_covariance=[[1]])
    >>> whole = iw.run_kalman(model, y, initial_covariance=[[1]])
    >>> bool(np.allclose(np.concatenate(list(pieces)), whole, rtol=1e-12))
    True
    """
    told = _Steps.of(model, process_covariance, measurement_covariance)
    covariances = _Covariances.start(model, initial_covariance)
    runs: int | str = "runs"
    x = None
    for piece in measurements:
        there, y, back = measured(piece, "steps", len(model.C), runs)
        if x is None:
            x = first_state(initial_state, len(model.A), y.shape[2])
            runs = y.shape[2]
        estimates, x, covariances = _run(covariances, told, there, y, x, predicted)
        yield back(estimates)


@dataclass(frozen=True, eq=False)
class _Steps:
    """A, C, Q and R with their square roots, (., ., .); one for all steps, or one for each.

    Above `limits` (., m) the variance of an innovation is far above that of the measurement.
    """

    A: Array
    C: Array
    Q: Array
    driving: Array
    R: Array
    root: Array
    limits: Array

    @classmethod
    def of(
        cls,
        model: ErrorModel,
        Q: ArrayLike | None,
        R: ArrayLike | None,
        steps: int = 1,
        A: ArrayLike | None = None,
        B: ArrayLike | None = None,
        C: ArrayLike | None = None,
    ) -> Self:
        """Return what is given, or that of the model, checked."""
        n = len(model.A)
        given = array("B", model.B if B is None else B, (n, "p"), (steps, n, "p"))
        noises = given.reshape(-1, *given.shape[-2:])
        own = np.reshape([b @ b.T for b in noises], (*given.shape[:-2], n, n))
        found = (
            over_steps("A", A, model.A, steps, array),
            over_steps("C", C, model.C, steps, array),
            over_steps("process_covariance", own if Q is None else Q, model.A, steps),
            over_steps("measurement_covariance", R, model.measurement_covariance, steps),
        )
        As, Cs, Qs, Rs = (X if X.strides[0] else X[:1] for X in found)
        # of noises that are given as such the root is exact
        driving = noises if np.array_equal(Qs, own.reshape(-1, n, n)) else _root(Qs)
        return cls(As, Cs, Qs, driving, Rs, _root(Rs), _FAR * np.diagonal(Rs, axis1=1, axis2=2))

    def at(self, k: int) -> _Steps:
        """Return all of them at a step, without the axis of steps."""
        parts = self.A, self.C, self.Q, self.driving, self.R, self.root, self.limits
        return _Steps(*(each[min(k, len(each) - 1)] for each in parts))

    @property
    def steady(self) -> bool:
        """Whether all steps share them."""
        return len(self.A) == len(self.C) == len(self.Q) == len(self.R) == 1


class _Covariances:
    """Covariances P (filters, n, n) of predictions, and square roots of them where asked for.

    Where a prediction is far less certain than the measurement, P+ is lost in the rounding of P:
    there P is carried as a square root.
    """

    def __init__(self, P: Array, root: Array) -> None:
        self.P = P
        self._root: Array | None = root
        self._before: tuple[Array, _Steps] | None = None
        # where P comes back to what it was, to the last bit, so does all that follows
        self._known: dict[bytes, tuple[_Step, Array, Array | None]] = {}

    @classmethod
    def start(cls, model: ErrorModel, initial_covariance: ArrayLike) -> Self:
        """Return the one of all filters before the first of steps, P_0 (n, n)."""
        P = covariance("initial_covariance", initial_covariance, model.A.shape)[None]
        return cls(P, _root(P))

    @property
    def root(self) -> Array:
        """W (filters, n, .) with P = W W'."""
        if self._root is None:
            assert self._before is not None
            after, told = self._before
            self._root = _moved(_root(after), told)
        return self._root

    def step(self, here: Mask, steps: _Steps, k: int) -> _Step:
        """Return K, I - K C, P, P+ and C P C' + R of a step, and go on to the next prediction.

        The pattern is `here`, (filters, m).
        """
        now = steps.at(k)
        if len(self.P) == 1 and steps.steady:
            root = b"" if self._root is None else self._root.tobytes()
            key = here.tobytes() + self.P.tobytes() + root
            found = self._known.pop(key, None) or self._step(here, now)
            self._known[key] = found
            if len(self._known) > _REMEMBERED:
                del self._known[next(iter(self._known))]
        else:
            found = self._step(here, now)
        told, ahead, self._root = found
        self.P, self._before = ahead, (told[3], now)
        return told

    def gains(self, there: Mask, steps: _Steps) -> Array:
        """Return K and I - K C beside it, (steps, n, m + n), of one filter, and go on.

        The pattern of each step is `there`, (steps, m).
        """
        (m, n), saves, k = steps.C.shape[1:], _SAVED * len(there), 0
        run = choose("kalman_gains", _gains, saves=saves)
        found = np.empty((len(there), n, m + n))
        while k < len(there):
            if steps.steady:
                now = steps.at(k)
                parts = now.A, now.C, now.Q, now.R, now.limits, self.P[0]
                A, C, Q, R, limits, P = map(_contiguous, parts)
                done, P, after, certain = run(A, C, Q, R, limits, P, there[k:], found[k:])
                if certain:
                    raise certain_innovation()
                if done:
                    self.P, self._before, self._root = P[None], (after[None], now), None
                k += done
            if k < len(there):
                gain, keep, *_ = self.step(there[k : k + 1], steps, k)
                found[k] = np.hstack([gain[0], keep[0]])
                k += 1
        return found

    def _step(self, here: Mask, now: _Steps) -> tuple[_Step, Array, Array | None]:
        """Return what `step` does, and the next P with its square root where it is needed."""
        root = None
        S = now.C @ self.P @ now.C.T + now.R
        if (S.diagonal(axis1=1, axis2=2) > now.limits).any():  # what is missing may come next
            gain, after, root = _updated_root(now.C, self.root, now.root, here)
            keep = np.eye(len(now.A)) - gain @ now.C
            root = _moved(root, now)
        else:
            gain, keep, after = updated(now.C, self.P, S, now.R, here)
        return (gain, keep, self.P, after, S), now.A @ after @ now.A.T + now.Q, root


def _moved(root: Array, told: _Steps) -> Array:
    """Return the square root (filters, n, .) of the prediction, from that of the estimate."""
    driving = np.broadcast_to(told.driving, (len(root), *told.driving.shape))
    return np.concatenate([driving, told.A @ root], axis=2)


def _run(
    covariances: _Covariances,
    steps: _Steps,
    there: Mask,
    y: Array,
    x: Array,
    predicted: bool,
    known: Array | None = None,
) -> tuple[Array, Array, _Covariances]:
    """Return the states (steps, n, runs), and the prediction after them with its covariances."""
    if there.shape[2] > 1 or len(covariances.P) > 1:
        added = np.zeros((1, len(x), 1)) if known is None else known
        return _run_each(
            covariances, steps, np.broadcast_to(there, y.shape), y, x, predicted, added
        )
    # one gain for all runs
    gains, keeps = np.split(covariances.gains(there[:, :, 0], steps), [y.shape[1]], axis=2)
    states = _states(steps.A, gains, keeps, y, x, predicted, known)
    if predicted:
        return states[:-1], states[-1], covariances
    with np.errstate(over="ignore"):  # perhaps nobody asks for it
        return states[1:], steps.A[-1] @ states[-1] if len(y) else x, covariances


def _states(
    A: Array,
    gains: Array,
    keeps: Array,
    y: Array,
    x: Array,
    predicted: bool,
    known: Array | None,
) -> Array:
    """Return x (n, runs) and the states (steps, n, runs) that follow it, by K and I - K C.

    The last one of predictions is that of the step after the last. What is `known` to be added
    enters as measurements do.
    """
    # from one estimate to the next
    before = A if len(A) == 1 else np.roll(A, 1, axis=0)
    F, G = (A @ keeps, A @ gains) if predicted else (keeps @ before, gains)
    if len(y) and not predicted:
        F[0] = keeps[0]
    if known is not None:
        whole = np.broadcast_to(np.eye(len(x)), keeps.shape)
        G = np.concatenate([G, whole if predicted else keeps], axis=2)
        y = np.concatenate([y, known if predicted else np.roll(known, 1, axis=0)], axis=1)
        y[:1, gains.shape[2] :] *= predicted
    states, c = np.empty((len(y) + 1, *x.shape)), _contiguous
    run = choose("linear_recursion", _recursion, saves=_SAVED_EACH * states[:, 0].size)
    run(c(F), c(G), c(x), c(y), states)
    return states


def _gains(
    A: Array, C: Array, Q: Array, R: Array, limits: Array, P: Array, there: Mask, out: Array
) -> tuple[int, Array, Array, bool]:
    """Fill `out` (steps, n, m + n) with K and I - K C, until an innovation is above the limits.

    Returns
    -------
    done : int
        How many steps are filled.
    P, after : ndarray, (n, n)
        Of the prediction after them, and of the estimate before it.
    certain : bool
        Whether an innovation is, so that there is no gain; here it raises an error.
    """
    after = np.zeros_like(P)
    known: dict[bytes, tuple[Array, Array, Array]] = {}  # as in `_Covariances.step`
    for k, here in enumerate(there):
        key = here.tobytes() + P.tobytes()
        found = known.pop(key, None)
        if found is None:
            S = C @ P @ C.T + R
            if (S.diagonal() > limits).any():
                return k, P, after, False
            gain, keep, (after,) = updated(C, P[None], S[None], R, here[None])
            found = np.hstack([gain[0], keep[0]]), after, A @ after @ A.T + Q
        known[key] = found
        if len(known) > _REMEMBERED:
            del known[next(iter(known))]
        out[k], after, P = found
    return len(there), P, after, False


def _recursion(F: Array, G: Array, x: Array, y: Array, out: Array) -> None:
    r"""Fill `out` with :math:`x_{k+1} = F_k x_k + G_k y_k`, from x (n, runs) on.

    Parameters
    ----------
    F, G : ndarray, (steps, n, n) and (steps, n, m)
    x, y : ndarray, (n, runs) and (steps, m, runs)
    out : ndarray, (steps + 1, n, runs)
    """
    out[0] = x
    n = len(x)
    weights, both = np.concatenate([F, G], axis=2), np.concatenate([x, np.empty(y.shape[1:])])
    for k in range(len(y)):
        both[n:] = y[k]
        both[:n] = np.matmul(weights[k], both, out=out[k + 1])


def _run_each(
    covariances: _Covariances,
    steps: _Steps,
    there: Mask,
    y: Array,
    x: Array,
    predicted: bool,
    known: Array,
) -> tuple[Array, Array, _Covariances]:
    """Return what `_run` does, where each run has gains of its own.

    States that have nothing to do with one another, as those of two axes, are filtered apart: the
    work grows with the cube of their number.
    """
    (length, _, count), n, p = y.shape, len(x), steps.driving.shape[2]
    run, c = choose("kalman_runs", _each_run), _contiguous
    there, y, states, x_after = c(there), c(y), np.empty((length, n, count)), np.empty(x.shape)
    P_after, W_after = np.zeros((count, n, n)), np.zeros((count, n, p + n))
    if not length:
        return states, x, covariances
    for some, seen in _parts(covariances, steps):
        at, to = some[:, None], seen[:, None]
        x_after[some], P, W, certain = run(
            c(steps.A[:, at, some]), c(steps.C[:, to, some]), c(steps.Q[:, at, some]),
            c(steps.driving[:, some]), c(steps.R[:, to, seen]), c(steps.root[:, seen]),
            c(steps.limits[:, seen]), c(covariances.P[:, at, some]), c(covariances.root[:, some]),
            c(x[some]), there, y, c(known[:, some]), some, seen, predicted, states,
        )  # fmt: skip
        if certain:
            raise certain_innovation()
        P_after[:, at, some] = P
        W_after[:, some, :p] = W[:, :, :p]
        W_after[:, at, p + some] = W[:, :, -len(some) :]
    return states, x_after, _Covariances(P_after, W_after)


def _parts(covariances: _Covariances, steps: _Steps) -> list[tuple[Indices, Indices]]:
    """Return the states and the outputs of each part of a filter that stands alone."""
    m, n = steps.C.shape[1:]
    tied = np.eye(n + m, dtype=bool)
    for X in (steps.A, covariances.P, steps.Q):
        tied[:n, :n] |= (X != 0).any(axis=0)
    tied[n:, :n], tied[n:, n:] = (steps.C != 0).any(axis=0), (steps.R != 0).any(axis=0)
    tied |= tied.T
    for _ in range((n + m).bit_length()):  # who is tied to whom by others, twice as many each time
        tied = tied @ tied
    state, output = np.split(tied.argmax(axis=1), [n])
    return [(np.flatnonzero(state == k), np.flatnonzero(output == k)) for k in np.unique(state)]


def _each_run(
    A: Array, C: Array, Q: Array, driving: Array, R: Array, noise: Array, limits: Array, P: Array,
    W: Array, x: Array, there: Mask, y: Array, known: Array, states: Indices, outputs: Indices,
    predicted: bool, out: Array,
) -> tuple[Array, Array, Array, bool]:  # fmt: skip
    """Run the filter where each run has gains of its own, and fill its `states` in `out`.

    The first seven are those of `_Steps`, roots of any width, and `known` (1 or steps, n, 1 or
    runs) is added to each prediction; P (1 or runs, n, n) has the square roots
    W (1 or runs, n, .). Of the measurements, zero where they are not there, the filter has its
    `outputs`.

    Returns
    -------
    x, P, W : ndarray, (n, runs), (runs, n, n) and (runs, n, .)
        Those of the prediction after the last step. The first p columns of W are those of the
        driving noise, and the last n those of the state before.
    certain : bool
        Whether an innovation is, so that there is no gain; here it raises an error.
    """
    told, covariances = _Steps(A, C, Q, driving, R, noise, limits), _Covariances(P, W)
    for k, here in enumerate(np.swapaxes(there[:, outputs], 1, 2)):
        gain, keep, *_ = covariances.step(here, told, k)
        after = times(keep, x) + times(gain, y[k, outputs])
        out[k, states] = x if predicted else after
        x = told.at(k).A @ after + known[min(k, len(known) - 1)]
    return x, covariances.P, covariances.root, False


def _root(P: Array) -> Array:
    """Return W (., n, n) with P = W W', by the eigenvalues of the correlations."""
    size = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    unit = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(P / unit[:, :, None] / unit[:, None, :])
    return np.asarray(unit[:, :, None] * vectors * np.sqrt(np.maximum(values, 0))[:, None, :])


def _updated_root(C: Array, W: Array, noise: Array, there: Mask) -> tuple[Array, Array, Array]:
    """Return K, P+ and its square root, from that of P (filters, n, .): `updated` by a QR.

    The noise (m, .) is a square root of R.

    The triangle of [W'C' W'; R^(1/2)' 0] holds the square roots of S and P+, and S^(-1/2) C P
    (Kailath, Sayed and Hassibi 2000, Section 12.3).
    """
    m, n = C.shape
    W = np.broadcast_to(W, (len(there), *W.shape[1:]))  # one until measurements differ
    seen, noise = (np.where(there[:, :, None], X, 0.0) for X in (C, noise))
    # what is missing has a noise of its own, and tells nothing
    noise = np.concatenate([noise, np.where(there[:, :, None], 0.0, np.eye(m))], axis=2)
    turned = np.swapaxes(W, 1, 2)
    upper = np.concatenate([turned @ np.swapaxes(seen, 1, 2), turned], axis=2)
    lower = np.concatenate(
        [np.swapaxes(noise, 1, 2), np.zeros((len(W), noise.shape[2], n))], axis=2
    )
    whole: Array = np.concatenate([upper, lower], axis=1)
    triangle: Array = np.asarray(np.linalg.qr(whole, mode="r"))
    solved = solve_present(np.ones_like(there), triangle[:, :m, :m], triangle[:, :m, m:])
    gain = np.swapaxes(solved, 1, 2)
    root = np.swapaxes(triangle[:, m : m + n, m:], 1, 2)
    return gain, root @ np.swapaxes(root, 1, 2), root


def updated(C: Array, P: Array, S: Array, R: Array, there: Mask) -> tuple[Array, Array, Array]:
    """Return K, I - K C and P+ (filters, ., .) for what is there (filters, m) of a measurement.

    P, S and R may be one for all filters.
    """
    S = np.broadcast_to(S, (len(there), *S.shape[1:]))
    gain = np.swapaxes(solve_present(there, S, C @ P), 1, 2)
    keep = np.eye(C.shape[1]) - gain @ C
    # Joseph's form stays symmetric and positive for any gain
    after = keep @ P @ np.swapaxes(keep, 1, 2) + gain @ R @ np.swapaxes(gain, 1, 2)
    return gain, keep, after


def predictor_gain(model: ErrorModel) -> Array:
    r"""Return the gain (n, m) of the Kalman predictor in the steady state, jitter left out.

    With P the stabilising solution of the Riccati equation, the covariance of the predicted error,

    .. math::
        B_f = A P C' (C P C' + D D')^{-1} , \qquad
        P = A P A' + B B' - B_f (C P C' + D D') B_f' .

    It is solved in the units of `design_filter`. It has been that of closed forms to 1e-9, for
    ratios of B B' to D D' from 10^-12 to 10^12, and that of 50 digits to 1e-4 where modes -1 and
    -1.00000008 are told apart by one output.

    Raises
    ------
    ParameterError
        If there is no steady state: a mode that is not stable is not measured, or a mode on the
        unit circle has no process noise, or D D' is singular.

    Examples
    --------
    For a random walk with noises of unit size :math:`P^2 = P + 1`: P is the golden ratio, and the
    gain :math:`P / (P + 1)` is one over it:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> print(f"{iw.predictor_gain(model).item():.4f}")
    0.6180
    """
    from scipy.linalg import solve_discrete_are  # noqa: PLC0415  # runs of filters need numpy alone

    from inswsn_lib.lmi.units import Units  # noqa: PLC0415  # as above

    radius = np.inf
    with suppress(np.linalg.LinAlgError, ValueError):
        units = Units.of(model)
        scaled = units.scaled(model)
        A, C, R = scaled.A, scaled.C, scaled.measurement_covariance
        gain = _gain(scaled, solve_discrete_are(A.T, C.T, scaled.process_covariance, R))
        radius = np.abs(np.linalg.eigvals(A - gain @ C)).max()
    if not radius < 1 - _ROUNDING:
        got = Described("one without a steady state")
        raise ParameterError("model", got, "one whose Riccati equation has a stable solution")
    # a step of Newton's method, for what a small process noise loses in the units
    gain = _gain(scaled, predicted_covariance(scaled, gain))
    return np.asarray(units.back @ gain @ units.outputs)


def _gain(model: ErrorModel, P: Array) -> Array:
    """Return A P C' (C P C' + R)^-1."""
    A, C, R = model.A, model.C, model.measurement_covariance
    return np.asarray(np.linalg.solve(C @ P @ C.T + R, C @ P @ A.T).T)


def predicted_covariance(model: ErrorModel, gain: Array) -> Array:
    """Return the covariance (n, n) of the error of a stable predictor with a gain (n, m)."""
    from scipy.linalg import solve_discrete_lyapunov  # noqa: PLC0415  # as above

    A, driven, _ = model.error_system(gain)
    return np.asarray(solve_discrete_lyapunov(A, driven @ driven.T))


def steady_error(model: ErrorModel, gain: ArrayLike) -> float:
    r"""Return the root mean square of L e of a predictor with a constant gain, jitter left out.

    For white noise of unit variance the covariance of e obeys
    :math:`X = \tilde A X \tilde A' + \tilde B \tilde B'` with :math:`\tilde A = A - B_f C` and
    :math:`\tilde B = [B\ \ {-B_f D}]`. It is infinite if the error system is not stable.

    Parameters
    ----------
    model : ErrorModel
    gain : array_like, (n, m)
        B_f.

    Examples
    --------
    The deadbeat gain of a random walk carries each measurement on by a step, so that two noises of
    unit size make the error. Without a gain it grows for ever:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> print(f"{iw.steady_error(model, [[1]]):.4f} {iw.steady_error(model, [[0]])}")
    1.4142 inf
    """
    A, _, L = model.error_system(gain)
    if np.abs(np.linalg.eigvals(A)).max() >= 1:
        return float("inf")
    X = predicted_covariance(model, np.asarray(gain, dtype=float))
    return float(np.sqrt(np.trace(L @ X @ L.T)))
