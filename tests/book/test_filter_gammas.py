"""The gamma that P1 prints, by both inequalities."""

from __future__ import annotations

from typing import Any

import pytest
from inswsn_book.evidence.filter_gammas import printed_clocks, rebuild_gammas

from inswsn_lib import data_file
from inswsn_lib.papers import read_numbers


@pytest.fixture(scope="module")
def filters() -> Any:
    return read_numbers(data_file("papers/p1.yaml"))["filters"]


def test_the_clocks_are_the_printed_ones(filters: Any) -> None:
    assert printed_clocks(filters) == {"area1": (0.2, 0.0012), "area2": (0.21, 0.8409e-3)}


def test_the_fitted_noise_gives_the_printed_gamma(filters: Any) -> None:
    found = rebuild_gammas(filters)
    for area in ("area1", "area2"):
        for form in ("printed", "exact"):
            value = found[f"gamma.fitted.{form}.{area}"].value
            assert value == pytest.approx(float(filters[area]["gamma"]), abs=5e-5)


def test_gamma_has_the_unit_of_the_noise_and_the_exact_one_is_not_above(filters: Any) -> None:
    once, twice = (rebuild_gammas(filters, process_noise=n, measurement_noise=n) for n in (1, 2))
    for area in ("area1", "area2"):
        exact, printed = (once[f"gamma.alike.{form}.{area}"].value for form in ("exact", "printed"))
        assert exact <= printed + 1e-6
        assert twice[f"gamma.alike.exact.{area}"].value == pytest.approx(2 * exact, rel=1e-4)


def test_a_longer_period_needs_a_larger_gamma_in_both_areas(filters: Any) -> None:
    short, long = (rebuild_gammas(filters, period=T) for T in (0.2, 1.0))
    for area in ("area1", "area2"):
        name = f"gamma.alike.exact.{area}"
        assert long[name].value > 1.1 * short[name].value
