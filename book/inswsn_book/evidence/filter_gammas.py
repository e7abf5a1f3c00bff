"""The least gamma that P1 prints of its two areas: by its inequality, and by the exact one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from inswsn_lib.evaluation import Finding
from inswsn_lib.lmi import minimise_gamma
from inswsn_lib.models import ErrorModel

#: Standard deviations of process and measurement noise, position (m) and velocity (m/s), that give
#: the printed gamma; of all that do, those with the fewest digits
FITTED = ((4.0, 4.0), (0.21, 0.0))
_PERIOD = 0.2  # s, of the first area
_WORDS = {
    "alike": "noise of one size in all states and of one in all measurements",
    "fitted": f"process noise of {FITTED[0][0]:g}, noise of {FITTED[1][0]:g} m in the positions "
    "alone",
}


def printed_clocks(filters: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Return period and jitter of either area, s, from the filters that P1 prints.

    Parameters
    ----------
    filters : mapping
        ``filters`` of the numbers of P1's text, from `read_numbers`.
    """
    return {
        area: (float(of["B_f"][0][2]), abs(float(of["E"][0][2])) * float(of["E_factor"]))
        for area, of in filters.items()
    }


def rebuild_gammas(
    filters: Mapping[str, Any],
    *,
    process_noise: float = 1.0,
    measurement_noise: float = 1.0,
    period: float = _PERIOD,
    solver: Any = "clarabel",
) -> dict[str, Finding]:
    """Return the least gamma of either area by either inequality, for two kinds of noise.

    ``gamma.alike.FORM.AREA`` is for noise of one size in all states and one in all measurements,
    ``gamma.fitted.FORM.AREA`` for `FITTED`. P1 does not print the noise.

    Parameters
    ----------
    filters : mapping
        As `printed_clocks` takes them.
    process_noise, measurement_noise : float
        Standard deviations, position (m) and velocity (m/s) alike.
    period : float
        Of the first area, s; that of the second is to it as in print.
    solver
        As `minimise_gamma` takes it.
    """
    alike = (process_noise, process_noise), (measurement_noise, measurement_noise)
    found = {}
    for area, (T, jitter) in printed_clocks(filters).items():
        for noise, (process, measurement) in {"alike": alike, "fitted": FITTED}.items():
            model = ErrorModel.p1(
                T * (period / _PERIOD), jitter, process_noise=process, measurement_noise=measurement
            )
            for form in ("printed", "exact"):
                gamma, _ = minimise_gamma(model, form, solver=solver)
                how = f"Least gamma, {area}, {form} inequality, {_WORDS[noise]}."
                found[f"gamma.{noise}.{form}.{area}"] = Finding(gamma, gamma, gamma, "1", how)
    return found
