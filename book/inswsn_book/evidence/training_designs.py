"""The filters of P1's areas by their worst-case gain: designed, printed, and the Kalman filter."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from inswsn_book.evidence.filter_map import last_gain
from inswsn_lib.checks import Array
from inswsn_lib.lmi import FilterDesign, design_filter, hinf_norm, spectral_radius
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation.training_areas import AREAS, TrainingAreas

#: What a filter is, the noise that it assumes, and the area
Key = tuple[str, str, str]
DEADBEAT, KALMAN = "published (deadbeat)", "Kalman, last gain"


def all_designs(areas: TrainingAreas) -> dict[Key, FilterDesign]:
    """Return the designs by form of the inequality, assumed noise and area."""
    by_noise = {"identity": areas.identity_designs, "matched": areas.matched_designs}
    return {
        (form, noise, a): by_noise[noise][form][a]
        for form in ("exact", "printed")
        for noise in by_noise
        for a in AREAS
    }


def other_filters(areas: TrainingAreas) -> dict[Key, tuple[ErrorModel, Array]]:
    """Return models and gains of filters that come from no inequality, as `all_designs`."""
    found = {(DEADBEAT, "identity", a): areas.deadbeat[a] for a in AREAS}
    steps = areas.scene.training_samples
    for noise, models in (("identity", areas.identity), ("matched", areas.matched)):
        found |= {(KALMAN, noise, a): (m, last_gain(m, steps)) for a, m in models.items()}
    return found


def norms_of(filters: Mapping[Key, tuple[ErrorModel, Array]]) -> dict[Key, float]:
    """Return the norms of the error systems."""
    return {key: hinf_norm(*model.error_system(gain)) for key, (model, gain) in filters.items()}


def table_of_designs(
    designs: Mapping[Key, FilterDesign], others: Mapping[Key, tuple[ErrorModel, Array]]
) -> pd.DataFrame:
    """Return the designs with their certificates, and what the other filters have of them."""
    rows = {
        key: (
            f"{design.gamma:.5f}",
            f"{design.certificate.norm:.5f}",
            f"{design.certificate.largest_eigenvalue:.1e}",
            f"{spectral_radius(design.A_f):.2f}",
        )
        for key, design in designs.items()
    }
    for key, norm in norms_of(others).items():
        model, gain = others[key]
        rows[key] = "–", f"{norm:.5f}", "–", f"{spectral_radius(model.A - gain):.2f}"
    columns = ["least $\\gamma$", "norm of the error system", "largest eigenvalue"]
    return pd.DataFrame.from_dict(
        {f"{what}, {noise}, area {a}": row for (what, noise, a), row in rows.items()},
        orient="index",
        columns=[*columns, "spectral radius of $A_f$"],
    ).rename_axis("form, noise, area")


def without_noise(areas: TrainingAreas, printed_gain: Mapping[str, Array]) -> dict[str, float]:
    """Return how far the exact design with D = 0 is from the printed matrices, by quantity.

    D = 0 was chosen when it was known to give them: that is a fit, as it would be for gamma.
    """
    found = {}
    for a, model in areas.models.items():
        silent = ErrorModel.p1(model.period, measurement_noise=(0.0, 0.0))
        design = design_filter(silent, solver=(areas.solver, "clarabel"))
        found[f"design.no-noise.bf{a}"] = float(np.abs(design.gain - printed_gain[a]).max())
        found[f"design.no-noise.af{a}"] = float(np.abs(design.A_f).max())
    return found
