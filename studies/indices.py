"""Sensitivity over all factors at once: places to try, and what follows from them, by SALib.

Morris (Technometrics 33, 1991) steps through the factors one by one, from random points: the mean
size of the effects tells how strong a factor is, their deviation whether it is so everywhere.
Sobol' indices are shares of the variance of a result: of a factor alone (first order), and of it
with all that it does together with others (total).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from inswsn_book.record.results import Finite, Frozen
from SALib.analyze import morris as morris_analysis, sobol as sobol_analysis
from SALib.sample import morris as morris_design, sobol as sobol_design

from inswsn_lib.checks import Array

#: Levels of a factor in the screening
LEVELS = 4
#: How far a step of the screening goes, as a share of the whole range
STEP = LEVELS / (2 * (LEVELS - 1))
#: Resamples of the bootstrap behind intervals
RESAMPLES = 1000
#: By how much intervals of total indices are wider than the bootstrap's
WIDER = 1.5
# Digits of a place: what is stored is what was computed with
_DIGITS = 6


class Effect(Frozen):
    """What a factor does to a result, by the screening."""

    mean: Finite  # mean size of its effects over the whole range, mu*
    deviation: Finite  # of its effects, sigma
    half: Finite  # half of the 95 % interval of the mean


class Share(Frozen):
    """Shares of the variance of a result, with 95 % intervals."""

    first: Finite
    first_half: Finite
    total: Finite
    total_low: Finite
    total_high: Finite


def morris_places(names: Sequence[str], trajectories: int, seed: int) -> Array:
    """Return places of all factors, (trajectories times one more than factors, factors)."""
    found = morris_design.sample(_problem(names), trajectories, num_levels=LEVELS, seed=seed)
    return np.asarray(np.round(found, _DIGITS))


def morris_effects(
    names: Sequence[str], places: Array, values: Array, seed: int, words: Collection[str] = ()
) -> dict[str, Effect]:
    """Return the effects of each factor, from what was found at `morris_places`.

    The effect of a number is that of its whole range, as if it went on as in the step that was
    made. A step changes a word once, so the effect of a word is what was found.
    """
    found = morris_analysis.analyze(
        _problem(names), places, filled(values),
        num_resamples=RESAMPLES, num_levels=LEVELS, seed=seed,
    )  # fmt: skip
    columns = np.array([found["mu_star"], found["sigma"], found["mu_star_conf"]], dtype=float)
    effects = {}
    for name, column in zip(names, columns.T, strict=True):
        mean, deviation, half = column * (STEP if name in words else 1.0)
        effects[name] = Effect(mean=_short(mean), deviation=_short(deviation), half=_short(half))
    return effects


def sobol_places(names: Sequence[str], groups: Sequence[str], base: int, seed: int) -> Array:
    """Return places of all factors; those of one group are exchanged together.

    The points are `base`, a power of two, times two more than groups.
    """
    problem = _problem(names, groups)
    found = sobol_design.sample(problem, base, calc_second_order=False, seed=seed)
    return np.asarray(np.round(found, _DIGITS))


def sobol_shares(
    names: Sequence[str], groups: Sequence[str], values: Array, seed: int
) -> dict[str, Share]:
    """Return the shares of each group, from what was found at `sobol_places`."""
    each = list(dict.fromkeys(groups))
    values = filled(values)
    if np.ptp(values) == 0:  # a result that nothing moves has no variance to share
        none = Share(first=0, first_half=0, total=0, total_low=0, total_high=0)
        return dict.fromkeys(each, none)
    found = sobol_analysis.analyze(
        _problem(names, groups), values,
        calc_second_order=False, num_resamples=RESAMPLES, seed=seed,
    )  # fmt: skip
    columns = zip(found["S1"], found["S1_conf"], found["ST"], found["ST_conf"], strict=True)
    shares = {}
    for group, (first, first_half, total, half) in zip(each, columns, strict=True):
        low, high = total_ends(total, half)
        shares[group] = Share(
            first=_short(first), first_half=_short(first_half),
            total=_short(total), total_low=_short(low), total_high=_short(high),
        )  # fmt: skip
    return shares


def total_ends(total: float, half: float) -> tuple[float, float]:
    """Return the ends of the 95 % interval of a total index, by half of the bootstrap's.

    Of results with a long tail few points make most of the variance. An index is then too small
    more often than too large, and the smaller the narrower its bootstrap. So the interval is one
    of the logarithm, `WIDER` than the bootstrap's, and ends at 1.
    """
    factor = math.exp(WIDER * half / total) if total > 0 else 1.0
    return min(total / factor, 1.0), min(total * factor, 1.0)


def filled(values: Array) -> Array:
    """Return values whose missing ones are the median of the others, which hides no effect much."""
    return np.where(np.isnan(values), np.nanmedian(values), values)


def _problem(names: Sequence[str], groups: Sequence[str] | None = None) -> dict[str, Any]:
    problem: dict[str, Any] = {
        "num_vars": len(names),
        "names": list(names),
        "bounds": [[0.0, 1.0]] * len(names),
    }
    return problem if groups is None else problem | {"groups": list(groups)}


def _short(value: float) -> float:
    return float(f"{value:.4g}")
