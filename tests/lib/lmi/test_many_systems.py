"""Designs for a hundred random systems of four kinds, each judged by routes that share no code.

Whether a filter exists is decided by the Riccati equation, whether one keeps its bound by the
frequency response or the Riccati iteration. Seeds are fixed, so nothing here is left to chance.
With INSWSN_TESTS=whole they are two and a half times as many.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest
from conftest import WHOLE

from inswsn_lib.lmi import (
    FilterDesign,
    InfeasibleDesignError,
    design_filter,
    hinf_norm,
    largest_singular_value,
    mean_square_radius,
    riccati_filter,
    riccati_gain_below,
)
from inswsn_lib.lmi.filter_design import Form
from inswsn_lib.models import ErrorModel

KINDS = ("stable", "unstable", "hidden mode", "badly scaled")
EACH = 60 if WHOLE else 16
# What may differ between solvers: the relative accuracy of gamma.
CLOSE = 1e-4


def draw(kind: str, seed: int, jitter: bool = False) -> ErrorModel:
    """Return a random model; D has full row rank, so that the Riccati equation exists."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    n, m, p = (int(rng.integers(1, high)) for high in (5, 4, 4))
    A = rng.normal(size=(n, n))
    radius = rng.uniform(1.0, 1.5) if kind == "unstable" else rng.uniform(0.1, 0.95)
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    C = rng.normal(size=(m, n))
    if kind == "hidden mode":  # a state of its own that no output sees, stable or not
        A = np.block([[A, np.zeros((n, 1))], [rng.normal(size=(1, n)), rng.uniform(0.2, 1.2)]])
        C, n = np.hstack([C, np.zeros((m, 1))]), n + 1
    model = ErrorModel(
        A=A, B=rng.normal(size=(n, p)), C=C, D=rng.normal(size=(m, m + 1)),
        L=rng.normal(size=(2, n)), E=0.1 * rng.normal(size=(n, n)) if jitter else np.zeros((n, n)),
        period=1.0,
    )  # fmt: skip
    return in_units(model, rng) if kind == "badly scaled" else model


def in_units(model: ErrorModel, rng: np.random.Generator) -> ErrorModel:
    """Return the model in other units of states and outputs, each up to 1,000 times larger."""
    S, W = (10.0 ** rng.uniform(-3, 3, size=size) for size in (len(model.A), len(model.C)))
    return replace(
        model, A=model.A * S[:, None] / S, B=model.B * S[:, None], C=model.C * W[:, None] / S,
        D=model.D * W[:, None], L=model.L / S, E=model.E * S[:, None] / S,
    )  # fmt: skip


@dataclass(frozen=True)
class Case:
    """A model, and its design, or None where it was refused."""

    model: ErrorModel
    design: FilterDesign | None


@lru_cache
def cases(kind: str, form: Form = "exact", jitter: bool = False) -> tuple[Case, ...]:
    made = []
    for seed in range(EACH):
        model = draw(kind, seed, jitter)
        try:
            made.append(Case(model, design_filter(model, form)))
        except InfeasibleDesignError:
            made.append(Case(model, None))
    return tuple(made)


def size(model: ErrorModel) -> float:
    """Return a bound that no filter can be below."""
    return float(np.linalg.norm(model.L @ model.B, 2))


def feasible(model: ErrorModel) -> bool:
    """Tell whether some filter has a bound below a very large one, by the Riccati equation."""
    return any(riccati_filter(model, size(model) * 10.0**k) is not None for k in range(7))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("jitter", [False, True])
def test_a_design_that_is_returned_keeps_its_word(kind: str, jitter: bool) -> None:
    returned = [case for case in cases(kind, jitter=jitter) if case.design is not None]
    assert len(returned) > EACH / 4
    for case in returned:
        model, design = case.model, case.design
        assert design is not None
        driven = np.hstack([model.B, -design.gain @ model.D])
        assert np.linalg.eigvalsh(design.P).min() > 0
        assert mean_square_radius(design.A_f, model.E) < 1
        # a sweep of the test's own
        angles = np.concatenate([np.linspace(0, np.pi, 2001), np.logspace(-5, 0, 200)])
        sweep = largest_singular_value(design.A_f, driven, model.L, angles).max()
        assert sweep <= design.level * (1 + 1e-6)
        if jitter:
            slack = design.level * (1 + 1e-5)
            assert riccati_gain_below(design.A_f, model.E, driven, model.L, slack)


@pytest.mark.parametrize("kind", KINDS)
def test_gamma_is_the_least_bound_of_all_filters(kind: str) -> None:
    """Just above it the Riccati equation has a filter, and just below it has none."""
    for case in cases(kind):
        if case.design is None:
            continue
        gamma = case.design.gamma
        found = riccati_filter(case.model, gamma * (1 + CLOSE))
        assert found is not None
        driven = np.hstack([case.model.B, -found @ case.model.D])
        assert hinf_norm(case.model.A - found @ case.model.C, driven, case.model.L) == (
            pytest.approx(gamma, rel=2 * CLOSE)
        )
        assert riccati_filter(case.model, gamma * (1 - CLOSE)) is None


def test_few_filters_that_exist_are_refused() -> None:
    """Fewer than 2 of 100 of those for which the Riccati equation has a filter."""
    exist = [case for kind in KINDS for case in cases(kind) if feasible(case.model)]
    assert len(exist) > 2.5 * EACH
    refused = sum(case.design is None for case in exist)
    assert refused < 0.02 * len(exist)


def test_what_cannot_be_has_a_named_error() -> None:
    """A hidden mode outside the unit circle: no filter, and the error says what failed."""
    none = [case for case in cases("hidden mode") if not feasible(case.model)]
    assert len(none) > EACH / 12
    for case in none:
        assert case.design is None
        with pytest.raises(InfeasibleDesignError, match=r"solution|solver|certificate"):
            design_filter(case.model)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("jitter", [False, True])
def test_the_printed_gamma_is_never_below_the_exact_one(kind: str, jitter: bool) -> None:
    compared = 0
    for exact, printed in zip(
        cases(kind, jitter=jitter), cases(kind, "printed", jitter), strict=True
    ):
        if printed.design is not None:
            assert exact.design is not None  # what the printed form can do, the exact one can
            assert exact.design.gamma <= printed.design.gamma * (1 + CLOSE)
            compared += 1
    assert compared > EACH / 6


@pytest.mark.parametrize("kind", ["stable", "badly scaled"])
def test_a_system_that_is_not_measured_has_the_norm_of_its_sweep(kind: str) -> None:
    """C = 0: no gain helps, and gamma is the peak of the frequency response."""
    for seed in range(EACH):
        model = draw(kind, seed)
        blind = replace(model, C=0 * model.C)
        norm = hinf_norm(model.A, model.B, model.L)
        assert design_filter(blind).gamma == pytest.approx(norm, rel=CLOSE)


@pytest.mark.parametrize("kind", ["stable", "unstable"])
def test_gamma_does_not_depend_on_units(kind: str) -> None:
    for case, seed in zip(cases(kind), range(EACH), strict=True):
        if case.design is None:
            continue
        other = in_units(case.model, np.random.default_rng(seed))
        assert design_filter(other).gamma == pytest.approx(case.design.gamma, rel=CLOSE)
