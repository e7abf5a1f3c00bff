"""P2's percentages: of which filters they are, and what is computed for them."""

from __future__ import annotations

import numpy as np
import pytest
from inswsn_book.evidence.fusion_percentages import FirstReading, rebuild_percentages

from inswsn_lib.evaluation import mean_absolute_error
from inswsn_lib.filters import patterns_of
from inswsn_lib.navigation import ClusterFusion


def test_percentages_are_those_of_the_runs() -> None:
    fusion = ClusterFusion(runs=40, speed=6.0)
    vars(fusion)["chosen"] = {"fkf-reset": (0.4, 10.0), "dhf": (1.0, 1.0, 1.0, 0.5)}
    first = FirstReading(fusion)
    found = rebuild_percentages(first)
    ins, y = fusion.drawn["ins"], fusion.measurements
    dhf = fusion.distributed(fusion.white, 1.0, 1.0, for_sets=patterns_of(y))
    np.testing.assert_allclose(first.errors["DHF"], ins - dhf(y), atol=1e-9)
    left = mean_absolute_error(ins - fusion.filters["dhf"](y))
    left /= mean_absolute_error(ins - fusion.filters["fkf-reset"](y))
    value, low, high, unit, *_ = found["fair.cells.vy.vs-fkf"]
    assert (value, unit) == (pytest.approx(100 * (1 - np.median(left[3]))), "%")
    assert low < value < high
    both = 100 * (1 - left[2:].mean(axis=0))
    assert found["fair.cells.velocity.vs-fkf"].value == pytest.approx(np.median(both))


def test_a_filter_that_is_not_asked_for_is_not_tuned(monkeypatch: pytest.MonkeyPatch) -> None:
    tuned: list[str] = []

    def tune(_: ClusterFusion, name: str, make: object) -> None:
        tuned.append(name)

    monkeypatch.setattr(ClusterFusion, "_tune", tune)
    fusion = ClusterFusion()
    for _ in range(2):
        fusion.tuned["fkf-reset"]
    assert tuned == ["fkf-reset"]
    assert len(fusion.tuned) == 8
    with pytest.raises(KeyError):
        fusion.errors["fkf"]
