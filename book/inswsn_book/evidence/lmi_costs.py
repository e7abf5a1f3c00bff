"""What the printed inequality and a guarantee cost, and what P1 may have designed for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pandas as pd

from inswsn_book.evidence.filter_gammas import FITTED, printed_clocks
from inswsn_book.show import tick
from inswsn_lib.checks import Array
from inswsn_lib.filters import deadbeat_gain, predictor_gain
from inswsn_lib.lmi import (
    FilterDesign,
    InfeasibleDesignError,
    central_gain,
    design_filter,
    minimise_gamma,
    stochastic_gain,
)
from inswsn_lib.lmi.designs import Form, Solver
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import gain_and_error

Solvers = Solver | tuple[Solver, ...]

#: Process and measurement noise, position and velocity, that P1 may have designed for
HYPOTHESES = {
    "1: no measurement noise, stopped early": ((4, 4), (0, 0)),
    "2: no measurement noise": ((4.0055, 4.0055), (0, 0)),
    "3: noise in all measurements": ((4, 4), (0.1895, 0.1895)),
    "4: noise in positions alone": FITTED,
    "5: noise in velocities alone": ((4, 4), (0, 0.206)),
    "6: no measurement noise, unequal process noise": ((4.0055, 1), (0, 0)),
    "7: identities": ((1, 1), (1, 1)),
}
#: The largest entry of A_f that a hypothesis may give
ALLOWED = 3e-8


def design_or_none(model: ErrorModel, form: Form, **options: Any) -> FilterDesign | None:
    """Return the design, or None if the solver found none."""
    try:
        return design_filter(model, form, **options)
    except InfeasibleDesignError:
        return None


def measuring(model: ErrorModel, rows: int) -> ErrorModel:
    """Return the model with its first measurements alone."""
    return replace(model, C=model.C[:rows], D=model.D[:rows, :rows])


def least_gammas(
    models: Mapping[tuple[str, str, float], ErrorModel], solver: Solvers
) -> pd.DataFrame:
    """Return the least gammas, a row for each model and a column for each inequality."""
    rows = {}
    for key, model in models.items():
        designs = {form: design_or_none(model, form, solver=solver) for form in get_args(Form)}
        rows[key] = {form: made.gamma if made else np.nan for form, made in designs.items()}
    index = pd.MultiIndex.from_tuples([*rows])
    return pd.DataFrame([*rows.values()], index=index).sort_index()


def printed_over_level(model: ErrorModel, solver: Solvers) -> float:
    """Return the gain over the level of a filter near the least gamma of the printed inequality."""
    tight = design_or_none(model, "printed", margin=1e-3, solver=solver)
    if tight is None:
        return np.nan
    if not model.E.any():
        return tight.certificate.norm / tight.level
    return stochastic_gain(tight.A_f, model.E, *tight.error_system[1:]) / tight.level


def trace_curve(
    model: ErrorModel, margins: Sequence[float], margin: float, solver: Solvers
) -> dict[str, Any]:
    """Return worst-case gain and error under white noise of designs and of other filters."""

    def point(form: Form, margin: float) -> tuple[float, float]:
        return gain_and_error(model, design_filter(model, form, margin=margin, solver=solver).gain)

    return {
        "exact": [point("exact", m) for m in margins],
        "printed": [point("printed", m) for m in margins],
        "here": point("exact", margin),
        "Kalman": gain_and_error(model, predictor_gain(model)),
        "deadbeat": gain_and_error(model, deadbeat_gain(model)),
    }


def near_the_least(curve: Mapping[str, Any]) -> dict[str, float]:
    """Return what a tenth more gain than the least makes of the error, in per cent.

    "above" is the error above that of the Kalman filter, "most" the largest, "gone" the share of
    the excess error that is gone.
    """
    gain, error = np.transpose(sorted(curve["exact"]))
    tenth, kalman = np.interp(1.1 * gain[0], gain, error), curve["Kalman"][1]
    return {
        "above": 100 * (tenth / kalman - 1),
        "most": 100 * (error.max() / kalman - 1),
        "gone": 100 * (error.max() - tenth) / (error.max() - kalman),
    }


def score_hypotheses(filters: Mapping[str, Any], solver: Solvers) -> dict[str, Array]:
    """Return least gamma, largest entry of A_f and that at the centre, a row for each area."""
    scores = {}
    for name, (process, measurement) in HYPOTHESES.items():
        rows = []
        for period, jitter in printed_clocks(filters).values():
            model = ErrorModel.p1(
                period, jitter, process_noise=process, measurement_noise=measurement
            )
            gamma, end = minimise_gamma(model, "printed", solver=solver)
            centre = central_gain(model, 1.005 * gamma, "printed", solver=solver)
            entries = [np.abs(model.A - gain @ model.C).max() for gain in (end, centre)]
            rows.append([gamma, *entries])
        scores[name] = np.array(rows)
    return scores


def judge_hypotheses(scores: Mapping[str, Array], gamma: float) -> pd.DataFrame:
    """Tell which hypotheses give the printed gamma in both areas, and entries of A_f as small."""
    rows = {}
    for name, found in scores.items():
        gammas, ends, centres = found.T
        early = "early" in name  # within 1 % of the least square of gamma
        reached = 1.01**0.5 * gammas if early else gammas
        right = ((gammas < gamma + 5e-5) & (gamma - 5e-5 <= reached)).all()
        rows[name] = right, (centres if early else ends).max() < ALLOWED
    return pd.DataFrame.from_dict(rows, orient="index", columns=["explains γ", "explains $A_f$"])


def show_hypotheses(scores: Mapping[str, Array], judged: pd.DataFrame) -> pd.DataFrame:
    """Return the table of the hypotheses."""
    found = {name: (*s[:, 0], s[:, 1].max(), s[:, 2].max()) for name, s in scores.items()}
    columns = {
        "γ, 0.2 s": "{:.5f}", "γ, 0.21 s": "{:.5f}",
        "largest entry of $A_f$": "{:.0e}", "at the centre": "{:.0e}",
    }  # fmt: skip
    numbers = pd.DataFrame.from_dict(found, orient="index", columns=[*columns])
    shown = {name: numbers[name].map(form.format) for name, form in columns.items()}
    return pd.DataFrame(shown).join(judged.map(tick)).rename_axis("hypothesis")
