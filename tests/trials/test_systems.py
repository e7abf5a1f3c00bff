"""Filters of random systems: no least gamma is silently wrong, whatever units, noise and period."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from random_systems import drawn, in_units

from inswsn_lib import ErrorModel, InswsnError
from inswsn_lib.lmi import design_filter, riccati_gamma

KINDS = [
    *("stable", "unstable", "hidden", "slow", "oscillator"),
    *("integrators", "quiet", "exact", "p1"),
]
DIFFERENT = 1e-3


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
