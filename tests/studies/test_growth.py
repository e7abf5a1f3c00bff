"""The page of growth: its figure is that of its numbers, and its exponents and limits by hand."""

from __future__ import annotations

import json
import math
from pathlib import Path

import growth
import pytest
from growth_figure import growth_svg


def test_the_figure_is_drawn_from_the_numbers(root: Path) -> None:
    found = json.loads((root / "data/growth.json").read_text(encoding="utf-8"))
    assert (root / "data/growth.svg").read_text(encoding="utf-8") == growth_svg(found)


@pytest.mark.parametrize("power", [1.0, 3.0])
def test_the_exponent_of_a_power_is_that_power(power: float) -> None:
    points = [{"size": n, "seconds": 2e-6 * n**power} for n in (10.0, 20.0, 50.0)]
    assert growth.exponent(points) == pytest.approx(power)


def test_every_kept_curve_is_one_that_is_measured_and_no_limit_is_beaten(root: Path) -> None:
    found = json.loads((root / "data/growth.json").read_text(encoding="utf-8"))
    assert [(c["name"], c["over"]) for c in found["curves"]] == [
        (c.name, c.over) for c in growth.CURVES
    ]
    for kept, curve in zip(found["curves"], growth.CURVES, strict=True):
        sizes = [point["size"] for point in kept["points"]]
        assert sizes == list(curve.sizes[: len(sizes)])
        for point in kept["points"]:
            limit = curve.load(point["size"]) / found["rates"][curve.rate]
            assert point["limit"] == pytest.approx(limit, rel=0.02)
            assert math.isfinite(point["seconds"])
            assert point["seconds"] > limit
