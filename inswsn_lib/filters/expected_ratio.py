"""What a filter leaves of the errors of fixes, told before it runs: by how long errors last."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array, number
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import autocorrelation
from inswsn_lib.filters.kalman import run_kalman
from inswsn_lib.models import ErrorModel

# Of the time that the INS holds, over which lags are taken; how many lags, and how many errors for
# each; how often errors must have faded, and the INS drifted, in a series
_SHARE, _FEWEST, _MOST, _PER_LAG, _MEMORIES = 0.5, 2, 12, 12, 10.0
_WHITE = 0.01  # deviations, of a measurement that is not in the states
_DOUBLED = 30  # times a step of the filter: more than its memory
_ROUNDS = 20  # in which the INS's drift and the noise of its velocity are told apart


#: RMS differences of the logarithms of what error-state filters left of the errors of fixes, in
#: position and velocity, and of what was expected: `gains` of `navigation.recorded_gains`, on six
#: recordings as they are and made worse
MISFIT = (0.07, 0.11)
_NINETY = 1.75  # deviations, by Student's t of so many series


def likely_interval(ratio: float, misfit: float) -> tuple[float, float, float]:
    """Return an expected ratio and between what it is in 90 % of cases, by `MISFIT` or another.

    Parameters
    ----------
    ratio : float
        As of `ErrorStatistics.ratios`.
    misfit : float
        RMS of the difference of logarithms.

    Examples
    --------
    >>> from inswsn_lib.filters import likely_interval
    >>> print("{:.2f} {:.2f} {:.2f}".format(*likely_interval(0.5, misfit=0.1)))
    0.50 0.42 0.60
    """
    wide = math.exp(_NINETY * misfit)
    return ratio, ratio / wide, ratio * wide


def lasting_ratio(period: float, correlation_time: float, hold_time: float) -> float:
    r"""Return what a filter leaves of the error of a fix whose errors last: the scalar law.

    A motion whose error is a random walk, which is as large as a fix's after the hold time
    :math:`T_h`, and fixes every T with errors of a Gauss-Markov process, :math:`\varphi =
    e^{-T/\tau}`. A fix leaves one number unknown, the share P of the variance of its error, and
    the Riccati equation is quadratic:

    .. math::
        P^2 + \kappa P - \kappa = 0, \qquad
        \kappa = \frac{T}{T_h} \, \frac{1 + \varphi}{1 - \varphi} \approx \frac{2 \tau}{T_h},
        \qquad r = \sqrt{P}.

    Parameters
    ----------
    period : float
        T, s.
    correlation_time : float
        :math:`\tau`, s; 0 if errors are white.
    hold_time : float
        :math:`T_h`, s.

    Returns
    -------
    float
        The RMS error of the filter over that of the fixes, in the steady state.

    Examples
    --------
    Errors that last for ten periods, and a motion that holds a fix's accuracy for as long:

    >>> import inswsn_lib as iw
    >>> print(f"{iw.filters.lasting_ratio(0.1, 1.0, 1.0):.2f}")
    0.86
    """
    step = number("period", period, above=0)
    lasts = number("correlation_time", correlation_time, least=0)
    hold = number("hold_time", hold_time, above=0)
    fades = math.exp(-step / lasts) if lasts else 0.0
    kappa = step / hold * (1 + fades) / (1 - fades)
    # the root without a difference of large numbers
    return math.sqrt(2 * kappa / (kappa + math.sqrt(kappa**2 + 4 * kappa)))


@dataclass(frozen=True, eq=False)
class ErrorStatistics:
    r"""What can be measured of an INS and of a network before a filter runs, by axis.

    The INS drifts as P1's model says: its velocity error is a random walk of density q, and its
    position error the integral. Beside it its velocity has white errors. The errors of fixes are a
    vector autoregression of the order p of position and velocity, by the Yule-Walker equations
    of the first p lags (Lütkepohl 2005, Section 3.3), which go with the measured lags exactly.

    Attributes
    ----------
    period : float
        Between fixes, s.
    covariances : ndarray, (p + 1, 2, 2)
        :math:`E[e_{k+j} e_k']` of the fixes' errors of position (m) and velocity (m/s) along an
        axis, by lag j.
    density : float
        q, m²/s³.
    velocity_noise : float
        Deviation of the white errors of the INS's velocity, m/s.

    Examples
    --------
    White errors of 0.1 m and 0.1 m/s, five times a second, and an INS that is 0.1 m off after 3 s:

    >>> import numpy as np
    >>> from inswsn_lib.filters import ErrorStatistics
    >>> none = np.zeros((1, 2, 2))
    >>> told = ErrorStatistics(0.2, np.concatenate([0.01 * np.eye(2)[None], none]), 0.01 / 9)
    >>> print("{:.1f} s; {:.2f} {:.2f}".format(told.hold_time, *told.ratios()))
    3.0 s; 0.39 0.33
    """

    period: float
    covariances: Array
    density: float
    velocity_noise: float = 0.0

    @classmethod
    def of(cls, ins: ArrayLike, network: ArrayLike, period: float) -> ErrorStatistics:
        r"""Return those of recorded or simulated errors.

        The density is that of the changes of the INS's velocity error over a lag h, less its white
        part, :math:`V^2 = q h + 2 s^2`, where :math:`\sqrt{q h^3 / 3}` is the RMS error of a fix;
        s is told by the change over a period. There are as many lags as fit in half of the hold
        time, from 2 to 12, and twelve errors for each.

        Parameters
        ----------
        ins, network : array_like, (n, 4)
            Errors of x, y (m) and of their velocities (m/s) at even times, of an INS that is not
            corrected and of a network; NaN where missing.
        period : float
            s.

        Raises
        ------
        InswsnError
            If there are fewer than 36 errors, or their time is not ten times that for which errors
            last, until a share 1/e of their first lag is left, and not ten hold times.
        """
        errors = array("network", network, ("n", 4), gaps=True)
        apart = array("ins", ins, (len(errors), 4), gaps=True)
        step, count = number("period", period, above=0), int(np.isfinite(errors).all(axis=1).sum())
        if count < (_FEWEST + 1) * _PER_LAG:
            raise InswsnError(f"{count} errors of fixes are too few to tell how long they last.")
        size = math.sqrt(float(np.nanmean(np.square(errors[:, :2]))))
        density, noise = _drift(apart[:, 2:], step, size)
        hold = (3 * size**2 / density) ** (1 / 3)
        lags = int(np.clip(round(_SHARE * hold / step), _FEWEST, min(_MOST, count // _PER_LAG)))
        memory = _memory(errors[:, :2]) * step
        if count * step < _MEMORIES * max(memory, hold):
            raise InswsnError(
                f"Errors of fixes last for {memory:.2g} s, and the motion holds their accuracy for "
                f"{hold:.2g} s: {count * step:.3g} s are too short to tell what a filter gains."
            )
        return cls(step, _covariances(errors, lags), density, noise)

    @property
    def size(self) -> tuple[float, float]:
        """RMS errors of fixes by axis: of position, m, and of velocity, m/s."""
        position, velocity = np.sqrt(np.diag(self.covariances[0])).tolist()
        return position, velocity

    @property
    def hold_time(self) -> float:
        """For how long the INS holds a fix's accuracy from a right start, s."""
        return float((3 * self.size[0] ** 2 / self.density) ** (1 / 3))

    def model(self, *, white: bool = False) -> ErrorModel:
        """Return P1's model of an axis with states for what lasts: INS less network.

        States are the INS's errors of position and velocity, the white error of its velocity, and
        the last p errors of fixes; with `white` fixes have white errors of the same size.
        """
        T, sizes = self.period, np.array(self.size)
        transition, driven = self._autoregression(white=white)
        n = len(transition)
        A, Q = np.zeros((3 + n, 3 + n)), np.zeros((3 + n, 3 + n))
        A[0, :3], A[1, 1], A[3:, 3:] = [1, T, T], 1, transition
        Q[:2, :2] = self.density * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
        Q[2, 2], Q[3:5, 3:5] = self.velocity_noise**2, driven
        C = np.zeros((2, 3 + n))
        C[0, [0, 3]], C[1, [1, 2, 4]] = 1, 1
        L = np.zeros((2, 3 + n))
        L[0, 0], L[1, [1, 2]] = 1, 1
        empty = ErrorModel(A=A, B=np.eye(3 + n), C=C, D=np.eye(2), L=L, period=T)
        return empty.with_covariances(Q, np.diag(np.square(_WHITE * sizes)))

    def ratios(self, *, white: bool = False) -> tuple[float, float]:
        """Return RMS errors of the filter over those of fixes, of position and of velocity.

        Of the steady state of the Kalman filter of `model`, after a fix.
        """
        model = self.model(white=white)
        C, L, P = model.C, model.L, _steady(model)
        K = np.linalg.solve(C @ P @ C.T + model.measurement_covariance, C @ P).T
        left = np.sqrt(np.diag(L @ (P - K @ C @ P) @ L.T))
        position, velocity = (left / self.size).tolist()
        return position, velocity

    def run(self, measured: ArrayLike) -> Array:
        """Return what the Kalman filter of `model` finds of the INS's errors, (steps, 4).

        Parameters
        ----------
        measured : array_like, (steps, 4)
            INS less network: x, y (m) and their velocities (m/s), NaN where missing.
        """
        y = array("measured", measured, ("steps", 4), gaps=True).reshape(-1, 2, 2)
        model = self.model()
        begin = 1e6 * np.diag(np.append([1.0, 1.0], np.zeros(len(model.A) - 2)))
        stationary = np.kron(np.eye(len(self.covariances) - 1), self.covariances[0])
        begin[2, 2], begin[3:, 3:] = self.velocity_noise**2, stationary
        states = run_kalman(model, y, initial_covariance=begin)
        return np.asarray(np.einsum("ln,sna->sla", model.L, states).reshape(-1, 4))

    def _autoregression(self, *, white: bool) -> tuple[Array, Array]:
        """Return how the last p errors of fixes go on, (2p, 2p), and what drives the first (2, 2).

        By the Yule-Walker equations; without lags for white errors.
        """
        R, p = self.covariances, len(self.covariances) - 1
        if white or not R[1:].any():
            return np.zeros((2, 2)), R[0] * np.eye(2)
        lags = np.subtract.outer(np.arange(p), np.arange(p))  # of row and column: E[e_-i e_-j']
        blocks = np.where((lags > 0)[..., None, None], R[abs(lags)].swapaxes(-1, -2), R[abs(lags)])
        of_last = blocks.swapaxes(1, 2).reshape(2 * p, 2 * p)
        with_next = np.hstack(list(R[1:]))
        ahead = np.linalg.lstsq(of_last.T, with_next.T)[0].T
        transition = np.eye(2 * p, k=-2)
        transition[:2] = ahead
        values, vectors = np.linalg.eigh(R[0] - ahead @ with_next.T)
        return transition, (vectors * np.maximum(values, 0.0)) @ vectors.T


def _steady(model: ErrorModel) -> Array:
    """Return the covariance of the predicted state in the steady state, (n, n).

    The Riccati equation is solved by doubling (Chu, Fan, Lin and Wang 2004), in numpy alone: what
    2^k steps of the filter do to a covariance is made of what 2^(k-1) do.
    """
    A, P = model.A.T, model.process_covariance
    G = model.C.T @ np.linalg.solve(model.measurement_covariance, model.C)
    for _ in range(_DOUBLED):
        AW = np.linalg.solve((np.eye(len(P)) + G @ P).T, A.T).T
        WA = np.linalg.solve(np.eye(len(P)) + G @ P, A)
        A, G, P = AW @ A, G + AW @ G @ A.T, P + A.T @ P @ WA
    return np.asarray((P + P.T) / 2)


def _drift(velocity: Array, period: float, size: float) -> tuple[float, float]:
    """Return the density of an INS's drift, and the deviation of its velocity's white errors.

    Of its errors of velocity (n, 2), about the lag at which their growth is one of `size` m.
    """
    lags = np.arange(1, max(len(velocity) // 4, 3))
    squares = np.array([np.nanmean(np.square(velocity[k:] - velocity[:-k])) for k in lags])
    times, white = lags * period, 0.0
    for _ in range(_ROUNDS):
        grown = np.maximum(squares - 2 * white, 1e-3 * squares)
        off = np.log(np.sqrt(grown / 3) * times)
        over = np.flatnonzero(off >= math.log(size))
        k = int(over[0]) if len(over) else len(lags) - 1
        density = grown / times
        told = density[k]
        if k and len(over):  # between two lags
            share = (math.log(size) - off[k - 1]) / (off[k] - off[k - 1])
            told = density[k - 1] ** (1 - share) * density[k] ** share
        white = max(float(squares[0] - told * period), 0.0) / 2 if k else 0.0
    return float(told), math.sqrt(white)


def _memory(errors: Array) -> float:
    """Return how long errors (n, 2) last, in steps: until little of their first lag is left."""
    rho = autocorrelation(errors, np.arange(max(len(errors) // 2, 2))).mean(axis=1)
    if rho[1] < 2 / math.sqrt(len(errors)):
        return 1.0
    gone = np.flatnonzero(rho[1:] < rho[1] / math.e)
    return float(1 + gone[0]) if len(gone) else float(len(errors))


def _covariances(errors: Array, lags: int) -> Array:
    """Return E[e_(k+j) e_k'] of errors (n, 4), the mean of both axes, (lags + 1, 2, 2)."""
    axes = errors.reshape(-1, 2, 2)  # position and velocity, by axis
    found = []
    for lag in range(lags + 1):
        late, early = axes[lag:], axes[: len(axes) - lag]
        both = np.isfinite(late).all(axis=(1, 2)) & np.isfinite(early).all(axis=(1, 2))
        found.append(np.einsum("nia,nja->ij", late[both], early[both]) / (2 * both.sum()))
    return np.array(found)
