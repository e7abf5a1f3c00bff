"""Models for the tests of designs and the trial of systems, in other units and with few outputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from inswsn_lib import ErrorModel


def in_units(model: ErrorModel, rng: np.random.Generator, decades: float) -> ErrorModel:
    """Return the model in other units of states and outputs, up to so many decades apart."""
    sizes = len(model.A), len(model.C)
    S, W = (10.0 ** (decades * rng.uniform(-0.5, 0.5, size=size)) for size in sizes)
    return replace(
        model, A=model.A * S[:, None] / S, B=model.B * S[:, None], C=model.C * W[:, None] / S,
        D=model.D * W[:, None], L=model.L / S, E=model.E * S[:, None] / S,
    )  # fmt: skip


def positions_only(period: float) -> ErrorModel:
    """Return P1's model of which positions alone are measured."""
    return replace(ErrorModel.p1(period), C=np.eye(2, 4), D=np.eye(2))


def drawn(kind: str, rng: np.random.Generator, *, jitter: bool = False) -> ErrorModel:
    """Return a model of a kind, in the units in which it is drawn: D has full row rank.

    But for the kind "exact"; "p1" is that of P1, and others are called by their transition.
    """
    if kind == "p1":
        sizes = (10.0 ** rng.uniform(-2, 2, size=2) for _ in "BD")
        process, measurement = ((float(a), float(b)) for a, b in sizes)
        full = ErrorModel.p1(
            10 ** rng.uniform(-3.5, 0), process_noise=process, measurement_noise=measurement
        )
        rows = int(rng.choice([2, 4]))
        return replace(full, C=full.C[:rows], D=full.D[:rows, :rows])
    n = int(rng.integers(1, 6))
    m, p = (int(rng.integers(1, min(n, 3) + 1)) for _ in "mp")
    A = transition(kind, n, rng)
    B, C = rng.normal(size=(n, p)), rng.normal(size=(m, n))
    D = rng.normal(size=(m, m + int(rng.integers(0, 2))))
    if kind == "integrators":
        C = np.eye(m, n)
    elif kind == "quiet":
        D *= 10 ** rng.uniform(-12, -6)
    elif kind == "exact":
        D = np.diag(rng.integers(0, 2, size=m)).astype(float)
    if kind == "hidden":  # a state of its own that no output sees, stable or not
        A = np.block([[A, np.zeros((n, 1))], [rng.normal(size=(1, n)), rng.uniform(0.2, 1.2)]])
        B, C = np.vstack([B, rng.normal(size=(1, p))]), np.hstack([C, np.zeros((m, 1))])
    L = np.eye(len(A)) if rng.random() < 0.5 else rng.normal(size=(2, len(A)))
    E = 0.1 * rng.normal(size=A.shape) if jitter else None
    return ErrorModel(A=A, B=B, C=C, D=D, L=L, E=E, period=1.0)


def transition(kind: str, n: int, rng: np.random.Generator) -> np.ndarray:
    if kind == "integrators":
        return np.eye(n) + 10 ** rng.uniform(-3, 0) * np.eye(n, k=1)
    if kind in ("slow", "oscillator"):
        A, turn = np.diag(1 - 10 ** rng.uniform(-5, -0.5, size=n)), rng.normal(size=(n, n))
        for i in range(0, n - 1, 2) if kind == "oscillator" else ():
            w = rng.uniform(0, np.pi)
            A[i : i + 2, i : i + 2] = A[i, i] * np.array(
                [[np.cos(w), -np.sin(w)], [np.sin(w), np.cos(w)]]
            )
        turn = np.linalg.qr(turn)[0]
        return np.asarray(turn @ A @ turn.T)
    A = rng.normal(size=(n, n))
    radius = rng.uniform(1, 1.6) if kind == "unstable" else rng.uniform(0.1, 0.98)
    return np.asarray(A * radius / np.abs(np.linalg.eigvals(A)).max())
