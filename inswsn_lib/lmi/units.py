"""Units in which the numbers of a design are of the order of one, whatever those of its model."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, matrix_balance, solve_discrete_are

from inswsn_lib.checks import Array
from inswsn_lib.lmi.designs import InfeasibleDesignError
from inswsn_lib.models import ErrorModel

# Of variances of the order of one: what keeps a Riccati equation from being singular
_LITTLE = 1e-12


@dataclass(frozen=True, eq=False)
class Units:
    """States, outputs and sizes in which a model is given to a solver.

    The states are `states` times x, (n, n), in which a Kalman predictor's error has the covariance
    I; the outputs are `outputs` times y, (m, m), in which its innovation has; what L sees is
    measured in `seen`.
    """

    states: Array
    back: Array
    outputs: Array
    seen: float

    @classmethod
    def of(cls, model: ErrorModel, least: float = 1e-15) -> Units:
        """Take the units of a model; variances are raised to a share, `least`, of the largest."""
        with np.errstate(all="ignore"):
            try:
                return cls._found(model, least)
            except (LinAlgError, ValueError):
                said = "The numbers of the model are too far apart to be computed with."
                raise InfeasibleDesignError(said) from None

    @classmethod
    def _found(cls, model: ErrorModel, least: float) -> Units:
        sizes, P = _prediction(model)
        values, vectors = np.linalg.eigh(P)
        roots = np.sqrt(np.maximum(values, least * values[-1]))
        back = sizes[:, None] * vectors * roots @ vectors.T
        noise = np.hstack([model.C @ back, model.D])
        heights = _or_one(np.linalg.norm(noise, axis=1))
        turned, spreads, _ = np.linalg.svd(noise / heights[:, None])
        spreads = np.maximum(spreads, _LITTLE)
        return cls(
            states=vectors / roots @ vectors.T / sizes,
            back=back,
            outputs=turned / spreads @ turned.T / heights,
            seen=float(np.linalg.norm(model.L @ back, 2)) or 1.0,
        )

    def scaled(self, model: ErrorModel) -> ErrorModel:
        """Return the model in these units."""
        S, back, r = self.states, self.back, self.outputs
        return replace(
            model, A=np.eye(len(S)) + self.moved(model), B=S @ model.B, C=r @ model.C @ back,
            D=r @ model.D, L=model.L @ back / self.seen, E=S @ model.E @ back,
        )  # fmt: skip

    def moved(self, model: ErrorModel) -> Array:
        """Return A - I in these units: of a slow model more than the scaled A keeps of it."""
        return np.asarray(self.states @ (model.A - np.eye(len(model.A))) @ self.back)


def _prediction(model: ErrorModel) -> tuple[Array, Array]:
    """Return sizes of the states, (n,), and in these the covariance of a Kalman predictor's error.

    If there is no such filter, it is I.
    """
    n = len(model.A)
    noise = np.sqrt(np.diag(model.measurement_covariance))
    outputs = np.where(noise > 0, noise, _or_one(np.linalg.norm(model.C, axis=1)))
    # Osborne's balancing of the states between what drives them and what they are seen by: powers
    # of two, so that nothing is rounded
    flow = np.zeros((n + 1, n + 1))
    flow[:n, :n], flow[:n, n] = np.abs(model.A), np.linalg.norm(model.B, axis=1)
    flow[n, :n] = np.linalg.norm(model.C / outputs[:, None], axis=0)
    factors = matrix_balance(flow, permute=False, separate=True)[1][0]
    sizes = factors[:n] / factors[n]
    A, B, C = model.A * sizes / sizes[:, None], model.B / sizes[:, None], model.C * sizes
    heights = _or_one(np.linalg.norm(np.hstack([C @ B, model.D]), axis=1))
    C, D, Q = C / heights[:, None], model.D / heights[:, None], B @ B.T
    Q, R = Q + _LITTLE * np.trace(Q) * np.eye(n), D @ D.T + _LITTLE * np.eye(len(D))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # units need not be exact
            P = solve_discrete_are(A.T, C.T, Q, R)
    except (LinAlgError, ValueError):  # a mode that is not seen and grows, or numbers too far apart
        return sizes, np.eye(n)
    deviations = np.sqrt(np.maximum(np.diag(P), _LITTLE * np.trace(P)))
    P = (P + P.T) / 2 / np.outer(deviations, deviations)
    return (sizes * deviations, P) if np.isfinite(P).all() else (sizes, np.eye(n))


def _or_one(numbers: Array) -> Array:
    return np.where(numbers > 0, numbers, 1.0)
