"""P1's designs: what is known without them, and what they refuse."""

import pytest

from inswsn_lib.errors import InswsnError
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import LMIDesigns, gain_and_error


@pytest.mark.parametrize("g", [0.3, 0.618, 1.0])
@pytest.mark.parametrize("noise", [0.5, 2.0])
def test_a_scalar_predictor_costs_what_is_found_by_hand(g: float, noise: float) -> None:
    """For 0 < g <= 1 the worst case is constant: a sum of a geometric series."""
    walk = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[noise]], period=1.0)
    variance = (1 + (g * noise) ** 2) / (2 * g - g**2)
    expected = ((1 / g**2 + noise**2) ** 0.5, variance**0.5)
    assert gain_and_error(walk, [[g]]) == pytest.approx(expected, rel=1e-6)


def test_only_the_ratio_of_the_noises_counts() -> None:
    one, other = LMIDesigns(process_noise=2.0), LMIDesigns(measurement_noise=0.5)
    values = [[found.value for found in each.findings().values()] for each in (one, other)]
    assert values[0] == pytest.approx(values[1], abs=1e-3)


def test_far_above_the_least_gamma_nothing_is_saved_or_paid() -> None:
    """The central filter tends to the Kalman filter as its bound grows."""
    found = LMIDesigns(margin=1e3).findings()
    assert max(abs(found[f"curve.{name}"].value) for name in ("gain-saved", "rms-paid")) < 0.01


def test_a_period_that_is_none_is_refused() -> None:
    with pytest.raises(InswsnError, match="period must be"):
        LMIDesigns(period=-0.2).findings()
