"""The core of chapter 02: what the chapter published, and limits known on paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inswsn_book.results import read_results

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import fit_noise, mean_absolute_error, monte_carlo
from inswsn_lib.filters import run_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import TrainingAreas, errors_by_area, table2_cells
from inswsn_lib.scenario import with_values

AREAS = "12"
FILTERS = ("kf-matched-filtered", "hf-exact-matched-filtered", "hf-printed-matched-filtered")


def areas(**values: Any) -> TrainingAreas:
    return TrainingAreas(**{"runs": 40, "other_runs": 40, **values})


@pytest.mark.long
def test_it_computes_what_the_chapter_published(root: Path) -> None:
    published = read_results(root / "data" / "published" / "02.json")
    found = TrainingAreas().scores()
    assert found.runs == published.parameters["runs"]
    for method in found.methods:
        for column, unit in list(found.columns.items())[:8]:
            quantity = published[f"table2.{method}.{column}"]
            median = np.median(found.of(method, column))
            assert median == pytest.approx(quantity.value, abs=quantity.tolerance), (method, column)
            assert quantity.unit == unit


@pytest.mark.parametrize("scale", [0.25, 5.0])
def test_the_path_is_the_same_sample_by_sample(scale: float) -> None:
    here, there = areas(time_scale=scale).scene, areas().scene
    for name, window in here.windows.items():
        places = here.path.drive(here.speed, window.times).position
        expected = there.path.drive(there.speed, there.windows[name].times).position
        np.testing.assert_allclose(places, expected, atol=1e-9)
    # 1.5 m a sample in area 1, and five hundredths more in area 2
    assert here.speed * np.array(here.periods) == pytest.approx([1.5, 1.575])


@pytest.mark.parametrize("scale", [0.25, 5.0])
def test_the_network_does_not_know_the_period(scale: float) -> None:
    for a in AREAS:
        np.testing.assert_allclose(
            areas(time_scale=scale).drawn["wsn"][a], areas().drawn["wsn"][a], atol=1e-6
        )


@pytest.mark.parametrize("scale", [0.25, 5.0])
def test_a_filter_that_is_told_of_endless_drift_is_the_network(scale: float) -> None:
    told = areas(time_scale=scale, q_scale=1e8)
    expected = table2_cells(told.errors("wsn"))
    for method in FILTERS:
        for column, cell in table2_cells(told.errors(method)).items():
            np.testing.assert_allclose(cell, expected[column], rtol=1e-3)


def test_the_noise_that_filters_are_told_is_what_was_put_in() -> None:
    # standard deviations of 4000 normal numbers: 1.1 %
    for fitted in areas(velocity_noise=0.3).noise.values():
        assert np.sqrt(np.diag(fitted.measurement)[2:]) == pytest.approx([0.3, 0.3], rel=0.03)


def test_a_filter_is_told_q_times_its_scale() -> None:
    there = areas(q_scale=4.0)
    found = there.errors("kf-matched-filtered")
    for a, fitted in there.noise.items():
        ins, network = there.drawn["ins"][a], there.drawn["wsn"][a]
        q, r = (
            [float(np.sqrt(np.diag(moment)[pair].mean())) for pair in (slice(2), slice(2, 4))]
            for moment in (fitted.process, fitted.measurement)
        )
        # four times the variance is twice the standard deviation
        told = ErrorModel.p1(
            there.scene.periods[int(a) - 1],
            process_noise=(2 * q[0], 2 * q[1]),
            measurement_noise=(r[0], r[1]),
        )
        expected = ins - run_kalman(told, ins - network, initial_covariance=1e6 * np.eye(4))
        np.testing.assert_allclose(found[a], expected, rtol=1e-9)


def test_the_same_runs_are_judged_whatever_is_told() -> None:
    once, told = areas(), areas().told(10.0)
    afresh = areas(q_scale=10.0)
    assert told.q_scale == 10.0
    for method in ("kf-matched-filtered", "hf-exact-matched-filtered"):
        for a in AREAS:
            np.testing.assert_array_equal(told.errors(method)[a], afresh.errors(method)[a])
            assert not np.allclose(told.errors(method)[a], once.errors(method)[a])


def test_noise_is_fitted_to_runs_that_are_not_judged() -> None:
    there = areas(seed=7)
    for seed, same in ((8, True), (7, False)):
        runs = errors_by_area(monte_carlo(there.scene.simulate, 40, seed))
        model = ErrorModel.p1(there.scene.periods[0])
        fitted = fit_noise(model.A, runs["ins"]["1"], runs["wsn"]["1"])
        assert np.array_equal(there.noise["1"].measurement, fitted.measurement) is same


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


QUIET = {"accelerometer_noise": 0.0, "gyro_noise": 0.0}


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
            np.testing.assert_allclose(found[:, 2:], scale * expected[:, 2:], rtol=0.01, atol=0.01)
            np.testing.assert_allclose(
                found[:, :2], scale**2 * expected[:, :2], rtol=0.01, atol=0.01
            )


@pytest.mark.parametrize(
    ("name", "sensor", "columns", "values"),
    [
        ("inertial_scale", "ins", slice(4), (0.1, 0.2)),
        ("range_noise", "wsn", slice(2), (0.05, 0.1)),
        ("velocity_noise", "wsn", slice(2, 4), (0.1, 0.2)),
    ],
)
def test_small_errors_grow_in_proportion(
    name: str, sensor: str, columns: slice, values: tuple[float, float]
) -> None:
    small, large = (areas(runs=20, **QUIET, **{name: value}).drawn[sensor] for value in values)
    for a in AREAS:
        sizes = [np.abs(drawn[a][:, columns]).mean(axis=(0, 2)) for drawn in (small, large)]
        # the heading of an INS multiplies its other errors: a tenth at this size
        np.testing.assert_allclose(sizes[1], 2 * sizes[0], rtol=0.15)


def test_means_are_those_of_the_cells() -> None:
    there = areas()
    found = there.scores()
    four = [found.of("kf-matched-filtered", c) for c in ("rx1", "ry1", "rx2", "ry2")]
    np.testing.assert_allclose(found.of("kf-matched-filtered"), sum(four) / 4, rtol=1e-12)
    by_hand = np.abs(there.drawn["wsn"]["2"][:, 3]).sum(axis=0) / 100
    np.testing.assert_allclose(found.of("wsn", "vy2"), by_hand, rtol=1e-12)
    expected = mean_absolute_error(there.drawn["ins"]["1"])[0]
    np.testing.assert_array_equal(found.of("ins", "rx1"), expected)


@pytest.mark.parametrize("values", [{"speed": -1.0}, {"velocity_source": "guess"}])
def test_what_may_not_be_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(ParameterError):
        areas(**values).scores()
