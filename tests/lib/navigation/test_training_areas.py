"""The core of evidence p1-training: limits known on paper."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import fit_noise, monte_carlo
from inswsn_lib.filters import run_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import (
    TrainingAreas,
    errors_by_area,
    first_measured,
    noise_sizes,
    table2_cells,
)
from inswsn_lib.scenario import with_values

AREAS = "12"
FILTERS = ("kf-matched-filtered", "hf-exact-matched-filtered", "hf-printed-matched-filtered")
QUIET = {"accelerometer_noise": 0.0, "gyro_noise": 0.0}


@cache
def areas(**values: Any) -> TrainingAreas:
    return TrainingAreas(**{"runs": 40, "other_runs": 40, **values})


@pytest.mark.parametrize("scale", [0.25, 5.0])
def test_path_and_network_are_the_same_sample_by_sample(scale: float) -> None:
    here, there = areas(time_scale=scale), areas()
    for name, window in here.scene.windows.items():
        places = here.scene.path.drive(here.scene.speed, window.times).position
        times = there.scene.windows[name].times
        expected = there.scene.path.drive(there.scene.speed, times).position
        np.testing.assert_allclose(places, expected, atol=1e-9)
    # 1.5 m a sample in area 1, and five hundredths more in area 2
    assert here.scene.speed * np.array(here.scene.periods) == pytest.approx([1.5, 1.575])
    told = areas(time_scale=scale, q_scale=1e8)
    expected_cells = table2_cells(told.errors("wsn"))
    for a in AREAS:
        np.testing.assert_allclose(here.drawn["wsn"][a], there.drawn["wsn"][a], atol=1e-6)
    # a filter that is told of endless drift is the network
    for method in FILTERS:
        for column, cell in table2_cells(told.errors(method)).items():
            np.testing.assert_allclose(cell, expected_cells[column], rtol=1e-3)


def test_a_filter_is_told_the_noise_that_other_runs_have_and_q_times_its_scale() -> None:
    there = areas(q_scale=4.0, velocity_noise=0.3, seed=7)
    found = there.errors("kf-matched-filtered")
    runs = errors_by_area(monte_carlo(there.scene.simulate, 40, 8))
    for a in AREAS:
        period = there.scene.periods[int(a) - 1]
        fitted = fit_noise(ErrorModel.p1(period).A, runs["ins"][a], runs["wsn"][a])
        (q, u), (r, v) = noise_sizes(fitted.process), noise_sizes(fitted.measurement)
        assert v == pytest.approx(0.3, rel=0.03)  # deviations of 8000 normal numbers: 0.8 %
        assert (q, u) == pytest.approx(
            [np.diag(fitted.process)[i : i + 2].mean() ** 0.5 for i in (0, 2)]
        )
        # four times the variance is twice the standard deviation
        told = ErrorModel.p1(period, process_noise=(2 * q, 2 * u), measurement_noise=(r, v))
        ins, network = there.drawn["ins"][a], there.drawn["wsn"][a]
        expected = ins - run_kalman(told, ins - network, initial_covariance=1e6 * np.eye(4))
        np.testing.assert_allclose(found[a], expected, rtol=1e-9)


def test_the_same_runs_are_judged_whatever_is_told() -> None:
    once, told, afresh = areas(), areas().told(10.0), areas(q_scale=10.0)
    assert told.q_scale == 10.0
    for method in ("kf-matched-filtered", "hf-exact-matched-filtered"):
        for a in AREAS:
            np.testing.assert_array_equal(told.errors(method)[a], afresh.errors(method)[a])
            assert not np.allclose(told.errors(method)[a], once.errors(method)[a])


def test_a_prediction_has_not_seen_the_measurement() -> None:
    there = areas()
    y = there.drawn["ins"]["1"] - there.drawn["wsn"]["1"]
    later = y.copy()
    later[50:] += 1.0
    for method in ("kf-identity", "hf-printed", "hf-exact-identity", "hf-printed-matched"):
        for word, first in (("predicted", 51), ("filtered", 50)):
            before, after = (there.estimate(f"{method}-{word}", "1", x) for x in (y, later))
            moved = np.abs(after - before).max(axis=(1, 2)) > 1e-9
            assert int(moved.argmax()) == first
        assert len(there.errors(f"{method}-predicted")["1"]) == len(y) - 1
    # the published filter, A_f = 0: what it says of a step is the measurement
    np.testing.assert_allclose(there.estimate("hf-printed-filtered", "1", y), y, atol=1e-9)


def test_a_bias_drifts_with_the_time_that_the_path_takes() -> None:
    none = {name: [0.0, 0.0] for name in ("accelerometer_scale", "velocity", "position")}
    alone = with_values(areas().published, **none, gyro_bias=0.0, heading=0.0)
    errors = {
        scale: TrainingAreas(alone, runs=1, time_scale=scale, **QUIET).drawn["ins"]
        for scale in (0.25, 1.0, 5.0)
    }
    # the heading is the same sample by sample, so a velocity is off in proportion to the time that
    # has passed, and a position in proportion to its square
    for scale in (0.25, 5.0):
        for a in AREAS:
            found, expected = errors[scale][a], errors[1.0][a]
            assert np.abs(expected).max() > 1
            for part, factor in ((slice(2), scale**2), (slice(2, 4), scale)):
                np.testing.assert_allclose(
                    found[:, part], factor * expected[:, part], rtol=0.01, atol=0.01
                )


def test_all_methods_are_judged_where_the_network_has_a_fix() -> None:
    # nodes 8 m apart: there are samples without a fix, at the beginning, too
    spaced = with_values(areas().published, spacing=8.0)
    there = TrainingAreas(spaced, runs=8, other_runs=8)
    missing = {a: np.isnan(network) for a, network in there.drawn["wsn"].items()}
    assert missing["1"][0].any()
    for method in ("ins", "kf-matched-filtered", "hf-exact-matched-filtered", "wsn"):
        for a, error in there.errors(method).items():
            np.testing.assert_array_equal(np.isnan(error), missing[a])
    # the first fix is where a filter of measurements without a memory begins
    y = there.drawn["ins"]["1"] - there.drawn["wsn"]["1"]
    first = first_measured(y)
    assert not np.isnan(first).any()
    run = int(missing["1"][0, 0].argmax())
    begun = int((~missing["1"][:, 0, run]).argmax())
    np.testing.assert_array_equal(first[:2, run], y[begun, :2, run])
    np.testing.assert_array_equal(first[2:], y[0, 2:])  # a sensor of velocity needs no fix


def test_cells_and_their_means_by_hand() -> None:
    there = areas()
    found = there.scores()
    for column, names in (("position", "rx1 ry1 rx2 ry2"), ("velocity", "vx1 vy1 vx2 vy2")):
        four = [found.of("kf-matched-filtered", name) for name in names.split()]
        np.testing.assert_allclose(found.of("kf-matched-filtered", column), sum(four) / 4)
    by_hand = np.abs(there.drawn["wsn"]["2"][:, 3]).sum(axis=0) / 100
    np.testing.assert_allclose(found.of("wsn", "vy2"), by_hand, rtol=1e-12)
    by_hand = np.abs(there.drawn["ins"]["1"][:, 0]).sum(axis=0) / 100
    np.testing.assert_allclose(found.of("ins", "rx1"), by_hand, rtol=1e-12)
    assert (found.headline, found.baselines, found.columns["vy2"]) == ("position", {"ins"}, "m/s")
    with pytest.raises(ParameterError, match=r"velocity_source .* not 'guess'"):
        areas(velocity_source="guess").scores()
