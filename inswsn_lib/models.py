"""The linear error model with a jittering period, on which P1 and P2 build their filters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array, covariance, matrices, number
from inswsn_lib.errors import ParameterError


@dataclass(frozen=True, eq=False, kw_only=True)
class ErrorModel:
    r"""A linear model with multiplicative noise (P1 2.4, 2.6, 2.8; P2 1-3).

    .. math::
        x_{k+1} = (A + E \beta_k)\, x_k + B w_k, \qquad
        y_k = C x_k + D v_k, \qquad z_k = L x_k

    with :math:`\beta_k` a white scalar of zero mean and unit variance, independent of
    :math:`w_k` and :math:`v_k`. Where a filter needs variances, :math:`w_k` and :math:`v_k` are
    white with unit covariance, so that :math:`Q = B B'` and :math:`R = D D'`.

    Attributes
    ----------
    A : ndarray, (n, n)
        Transition of the error state over one period.
    B : ndarray, (n, p)
        How process noise enters.
    C : ndarray, (m, n)
        How the state is measured.
    D : ndarray, (m, q)
        How measurement noise enters.
    L : ndarray, (l, n)
        The combinations of states that are to be estimated. Default: all states.
    E : ndarray, (n, n)
        How the jitter of the period enters. Default: zero.
    period : float
        The sampling period, s.

    Raises
    ------
    ParameterError
        If the period is not positive, an entry is not finite, or shapes do not fit together.

    Examples
    --------
    A random walk with noises of unit size:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> model.process_covariance.item(), model.L.item(), model.E.item()
    (1.0, 1.0, 0.0)
    """

    A: Array
    B: Array
    C: Array
    D: Array
    L: Array = None  # type: ignore[assignment]  # __post_init__ sets it
    E: Array = None  # type: ignore[assignment]
    period: float

    def __post_init__(self) -> None:
        number("period", self.period, above=0)
        states = len(array("A", self.A, ("n", "n")))
        L = np.eye(states) if self.L is None else self.L
        E = np.zeros((states, states)) if self.E is None else self.E
        found = matrices(
            A=(self.A, "nn"), B=(self.B, "np"), C=(self.C, "mn"), D=(self.D, "mq"),
            L=(L, "ln"), E=(E, "nn"),
        )  # fmt: skip
        for name, matrix in zip("ABCDLE", found, strict=True):
            object.__setattr__(self, name, matrix)

    @property
    def process_covariance(self) -> Array:
        """Q = B B', (n, n)."""
        return self.B @ self.B.T

    @property
    def measurement_covariance(self) -> Array:
        """R = D D', (m, m)."""
        return self.D @ self.D.T

    def error_system(self, gain: ArrayLike) -> tuple[Array, Array, Array]:
        r"""Return the system of a predictor's error, :math:`e^+ = \tilde A e + \tilde B d`.

        It is P1 (2.11) without the jitter: :math:`\tilde A = A - B_f C`, and the input d is process
        and measurement noise in one column, :math:`\tilde B = [B\ \ {-B_f D}]`.

        Parameters
        ----------
        gain : array_like, (n, m)
            B_f.

        Returns
        -------
        tuple of ndarray
            Its transition (n, n), its input (n, p + q), and L (l, n), through which it is seen.

        Examples
        --------
        >>> import inswsn_lib as iw
        >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[2]], period=1.0)
        >>> [matrix.tolist() for matrix in model.error_system([[0.25]])]
        [[[0.75]], [[1.0, -0.5]], [[1.0]]]
        """
        B_f = array("gain", gain, self.C.shape[::-1])
        return self.A - B_f @ self.C, np.hstack([self.B, -B_f @ self.D]), self.L

    def contracted(self, factor: float) -> Self:
        """Return the model with a transition that forgets: A times a factor.

        P1's A has the eigenvalue 1, so that a velocity error never dies and a filter that does not
        know the jitter has no finite gain over all time. A factor below 1 repairs that.

        Parameters
        ----------
        factor : float
            Above 0, at most 1.

        Returns
        -------
        ErrorModel

        Raises
        ------
        ParameterError
            If it is not.

        Examples
        --------
        >>> import inswsn_lib as iw
        >>> iw.ErrorModel.p1(period=1.0).contracted(0.5).A[0].tolist()
        [0.5, 0.0, 0.5, 0.0]
        """
        return replace(self, A=number("factor", factor, above=0, most=1) * self.A)

    def with_covariances(self, process: ArrayLike, measurement: ArrayLike) -> Self:
        """Return the model with other noise: B and D such that Q = B B' and R = D D'.

        B and D are the symmetric square roots, (n, n) and (m, m). Only the products matter to a
        filter.

        Parameters
        ----------
        process : array_like, (n, n)
            Q, the covariance of the process noise of a period.
        measurement : array_like, (m, m)
            R, the covariance of the measurement noise.

        Returns
        -------
        ErrorModel

        Raises
        ------
        ParameterError
            If one has another shape, or is not symmetric and positive semidefinite.

        Examples
        --------
        >>> import numpy as np
        >>> import inswsn_lib as iw
        >>> model = iw.ErrorModel.p1(period=1.0).with_covariances(4 * np.eye(4), 9 * np.eye(4))
        >>> float(model.B[0, 0]), float(model.D[0, 0])
        (2.0, 3.0)
        """
        states, outputs = len(self.A), len(self.C)
        Q = covariance("process", process, (states, states))
        R = covariance("measurement", measurement, (outputs, outputs))
        return replace(self, B=_root(Q), D=_root(R))

    def with_coloured_noise(self, correlation_time: ArrayLike, white: ArrayLike = 1e-12) -> Self:
        r"""Return the model with a state for the error of each measurement, correlated over time.

        A share s of the variance of each error is white, and the rest is c, a first-order
        Gauss-Markov process with :math:`\varphi = e^{-T/\tau}` (Bryson and Henrikson 1968; Brown
        and Hwang 2012, Section 4.6):

        .. math::
            c_{k+1} = \varphi c_k + \sqrt{(1 - \varphi^2)(1 - s)}\, D v_k , \qquad
            y_k = C x_k + c_k + \sqrt{s}\, D v'_k .

        The states are x, then c; the covariance of c at the start is :math:`(1 - s) D D'`.

        Parameters
        ----------
        correlation_time : float or array_like, (m,)
            :math:`\tau`, s, of all errors or of each; with 0 an error is white.
        white : float or array_like, (m,)
            s, above 0, at most 1. Filters ask for some noise of a measurement.

        Returns
        -------
        ErrorModel
            With n + m states; L and E do not see c.

        Raises
        ------
        ParameterError
            If a number is not such, or a shape does not fit.

        Examples
        --------
        An error that halves in a period:

        >>> import numpy as np
        >>> import inswsn_lib as iw
        >>> model = iw.ErrorModel.p1(period=1.0).with_coloured_noise(1 / np.log(2))
        >>> model.A.diagonal().round(6).tolist()
        [1.0, 1.0, 1.0, 1.0, 0.5, 0.5, 0.5, 0.5]
        """
        m = len(self.C)
        time, share = (
            np.broadcast_to(array(name, value, (), (m,)), (m,))
            for name, value in (("correlation_time", correlation_time), ("white", white))
        )
        if time.min() < 0:
            raise ParameterError("correlation_time", correlation_time, "at least 0 s")
        if share.min() <= 0 or share.max() > 1:
            raise ParameterError("white", white, "above 0 and at most 1")
        lasting = np.exp(-self.period / np.maximum(time, 1e-300))
        return replace(
            self,
            A=_blocks(self.A, np.diag(lasting)),
            B=_blocks(self.B, np.sqrt((1 - lasting**2) * (1 - share))[:, None] * self.D),
            C=np.hstack([self.C, np.eye(m)]),
            D=np.sqrt(share)[:, None] * self.D,
            L=np.hstack([self.L, np.zeros((len(self.L), m))]),
            E=_blocks(self.E, np.zeros((m, m))),
        )

    @classmethod
    def p1(
        cls,
        period: float,
        jitter: float = 0.0,
        *,
        process_noise: tuple[float, float] = (1.0, 1.0),
        measurement_noise: tuple[float, float] = (1.0, 1.0),
        L: ArrayLike | None = None,
    ) -> Self:
        r"""Return the model of P1 (2.3) and (2.5).

        The state is the error of the INS, :math:`(e_x, e_y, e_{vx}, e_{vy})` in m and m/s in the
        horizontal frame of the network, and so is the measurement: INS less WSN. P1 does not print
        B, D and L; the defaults are identities.

        Parameters
        ----------
        period : float
            T, s.
        jitter : float
            :math:`\delta t`, the standard deviation of the period, s.
        process_noise : tuple of two floats
            Standard deviations per step of position (m) and velocity (m/s): the diagonal of B.
        measurement_noise : tuple of two floats
            Standard deviations of the measured position (m) and velocity (m/s): that of D.
        L : array_like, (l, 4), optional
            Default: the identity.

        Returns
        -------
        ErrorModel
            With n = m = p = q = 4.

        Raises
        ------
        ParameterError
            If the period is not positive, or another number is negative or not finite.

        Examples
        --------
        The period enters A, and its jitter enters E in the same places:

        >>> import inswsn_lib as iw
        >>> model = iw.ErrorModel.p1(period=0.5, jitter=0.01, measurement_noise=(2.0, 0.1))
        >>> model.A[0].tolist(), model.E[0].tolist()
        ([1.0, 0.0, 0.5, 0.0], [0.0, 0.0, 0.01, 0.0])
        >>> model.D.diagonal().tolist()
        [2.0, 2.0, 0.1, 0.1]
        """
        A, E = np.eye(4), np.zeros((4, 4))
        A[0, 2] = A[1, 3] = number("period", period, above=0)
        E[0, 2] = E[1, 3] = number("jitter", jitter, least=0)
        return cls(
            A=A,
            B=_twice("process_noise", process_noise),
            C=np.eye(4),
            D=_twice("measurement_noise", measurement_noise),
            L=L,  # type: ignore[arg-type]  # made an array
            E=E,
            period=period,
        )

    @classmethod
    def p2(
        cls,
        period: float,
        *,
        process_noise: tuple[float, float] = (1.0, 1.0),
        measurement_noise: tuple[float, float] = (1.0, 1.0),
        L: ArrayLike | None = None,
    ) -> Self:
        """Return the model of a cluster of P2 (1) and (2): that of P1 without jitter.

        Parameters
        ----------
        period, process_noise, measurement_noise, L
            See `p1`.

        Returns
        -------
        ErrorModel
            With n = m = p = q = 4 and E = 0.

        Raises
        ------
        ParameterError
            As `p1`.

        Examples
        --------
        >>> import inswsn_lib as iw
        >>> bool(iw.ErrorModel.p2(period=1.0).E.any())
        False
        """
        return cls.p1(period, process_noise=process_noise, measurement_noise=measurement_noise, L=L)


def _twice(name: str, pair: ArrayLike) -> Array:
    """Return the diagonal matrix of a deviation of positions and one of velocities, in x and y."""
    deviations = array(name, pair, (2,))
    if deviations.min() < 0:
        raise ParameterError(name, pair, "two non-negative numbers, in m and m/s")
    return np.diag(np.repeat(deviations, 2))


def _blocks(first: Array, second: Array) -> Array:
    """Return the block diagonal matrix of two."""
    out = np.zeros(np.add(first.shape, second.shape))
    out[: len(first), : first.shape[1]] = first
    out[len(first) :, first.shape[1] :] = second
    return out


def _root(covariance: Array) -> Array:
    """Return the symmetric square root of a covariance."""
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)
