"""Filters of random systems: no least gamma is silently wrong, whatever units, noise and period."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from other_units import in_units

from inswsn_lib import ErrorModel, InswsnError
from inswsn_lib.lmi import design_filter, riccati_gamma

KINDS = (
    "stable",
    "unstable",
    "hidden",
    "slow",
    "oscillator",
    "integrators",
    "quiet",
    "exact",
    "p1",
)
DIFFERENT = 1e-3


def drawn(kind: str, rng: np.random.Generator) -> ErrorModel:
    """Return a model of a kind; its units are those in which it was drawn."""
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
    return ErrorModel(A=A, B=B, C=C, D=D, L=L, period=1.0)


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


def detectable(kind: str, model: ErrorModel) -> bool:
    """Tell whether a filter exists: all but a hidden mode are seen, since C is drawn."""
    return kind != "hidden" or abs(model.A[-1, -1]) < 1


def gamma_or(word: str, find: Callable[[], float]) -> float | str:
    """Return a least gamma, or the word if it is refused."""
    try:
        return find()
    except InswsnError:
        return word


def outcome(kind: str, model: ErrorModel, rng: np.random.Generator) -> str:
    """Tell what comes of a model, in its own units and in others."""
    gamma = gamma_or("refused", lambda: design_filter(model).gamma)
    if not detectable(kind, model):
        return "no filter exists" if gamma == "refused" else "wrong"
    others = in_units(model, rng, rng.choice([4.0, 8.0, 16.0]))
    elsewhere = gamma_or("refused", lambda: design_filter(others).gamma)
    riccati = gamma_or("refused", lambda: riccati_gamma(model))
    known = [value for value in (gamma, elsewhere, riccati) if not isinstance(value, str)]
    if known and not max(known) <= min(known) * (1 + DIFFERENT):
        return "wrong"
    return "refused" if "refused" in (gamma, elsewhere) else "designed"


@pytest.mark.long
def test_no_design_is_silently_wrong(
    size: Callable[[int, int], int], seed: int, tell: Callable[[str], None]
) -> None:
    """Three routes agree, or say that they cannot tell: here, in other units, and by Riccati."""
    count, found = size(36, 1000), Counter[str]()
    for i in range(count):
        rng = np.random.default_rng([seed, i])
        kind = KINDS[i % len(KINDS)]
        found[outcome(kind, drawn(kind, rng), rng)] += 1
    possible = found["designed"] + found["refused"]
    tell(
        f"{count:,} systems in units of their own and in others up to 10^16 apart; "
        f"{found['wrong']} silently wrong; of {possible} with a filter {found['refused']} refused "
        f"({100 * found['refused'] / possible:.1f} %); {found['no filter exists']} have none"
    )
    assert found["wrong"] == 0
    assert found["refused"] <= max(2, 0.05 * possible)


@pytest.mark.parametrize("period", [1e-4, 1e-3, 2e-3, 5e-3])
@pytest.mark.parametrize("jitter", [0.0, 0.02])
def test_short_periods(period: float, jitter: float) -> None:
    """P1's own model down to 0.1 ms, with all outputs and with positions alone."""
    full = ErrorModel.p1(period, jitter * period)
    for rows in (2, 4):
        model = replace(full, C=full.C[:rows], D=full.D[:rows, :rows])
        design = design_filter(model)
        assert design.certificate.upper <= design.certificate.lower * (1 + DIFFERENT)
        expected = riccati_gamma(replace(model, E=np.zeros((4, 4))))
        if jitter == 0:
            assert design.gamma == pytest.approx(expected, rel=DIFFERENT)
        else:
            assert expected * (1 - 1e-4) <= design.gamma <= expected * 1.01
