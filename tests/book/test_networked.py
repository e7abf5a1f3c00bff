"""Chapter 02 as an experiment: what the chapter published, and limits known on paper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inswsn_book.experiments.networked import NETWORKED, NetworkedTrial
from inswsn_book.parameters import chapter_schema
from inswsn_book.results import read_results

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import fit_noise, mean_absolute_error, monte_carlo
from inswsn_lib.filters import run_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.simulation import with_values

# as the chapter calls them
PUBLISHED = {
    "ins": "ins",
    "network": "wsn",
    "kf": "kf-matched-filtered",
    "hf-exact": "hf-exact-matched-filtered",
    "hf-printed": "hf-printed-matched-filtered",
    "hf-published": "hf-printed-predicted",
}
AREAS = "12"


@pytest.fixture(scope="module")
def settings(root: Path) -> Any:
    return NETWORKED.load(root / "data")


def trial(settings: Any, **values: float) -> NetworkedTrial:
    return NetworkedTrial(NETWORKED.schema.check({"other_runs": 40, **values}), settings)


@pytest.mark.long
def test_it_computes_what_the_chapter_published(root: Path, settings: Any) -> None:
    published = read_results(root / "data" / "published" / "02.json")
    found = NETWORKED.run({}, published.parameters["runs"], settings)
    for method, name in PUBLISHED.items():
        for column in list(NETWORKED.columns)[:8]:
            quantity = published[f"table2.{name}.{column}"]
            median = np.median(found[f"{method}.{column}"])
            assert median == pytest.approx(quantity.value, abs=quantity.tolerance), (method, column)
            assert quantity.unit == NETWORKED.columns[column]


def test_defaults_and_rules_are_those_of_the_chapter(root: Path) -> None:
    chapter = chapter_schema(root, "02")
    renamed = {"period": "period_area1"}
    for parameter in NETWORKED.schema.parameters:
        if parameter.name == "q_scale":
            continue
        twin = chapter[renamed.get(parameter.name, parameter.name)]
        assert (parameter.kind, parameter.default, parameter.unit) == (
            twin.kind, twin.default, twin.unit,
        )  # fmt: skip
        if parameter.name != "period":  # the path of the chapter is laid for one period
            assert parameter.rule == twin.rule


@pytest.mark.parametrize("period", [0.05, 1.0])
def test_the_path_is_the_same_sample_by_sample(settings: Any, period: float) -> None:
    here, there = (trial(settings, period=p).scene for p in (period, 0.2))
    for name, window in here.windows.items():
        places = here.path.drive(here.speed, window.times).position
        expected = there.path.drive(there.speed, there.windows[name].times).position
        np.testing.assert_allclose(places, expected, atol=1e-9)
    # 1.5 m a sample in area 1, and five hundredths more in area 2
    assert here.speed * np.array(here.periods) == pytest.approx([1.5, 1.575])


@pytest.fixture(scope="module")
def drawn(settings: Any) -> dict[float, Any]:
    rng = np.random.default_rng
    return {p: trial(settings, period=p).draw(rng(0), 40) for p in (0.05, 0.2, 1.0)}


def test_the_network_does_not_know_the_period(drawn: dict[float, Any]) -> None:
    for a in AREAS:
        for period in (0.05, 1.0):
            np.testing.assert_allclose(
                drawn[period][f"wsn.area{a}"], drawn[0.2][f"wsn.area{a}"], atol=1e-6
            )


@pytest.mark.parametrize("period", [0.05, 1.0])
def test_a_filter_that_is_told_of_endless_drift_is_the_network(
    settings: Any, drawn: dict[float, Any], period: float
) -> None:
    judge = trial(settings, period=period).judge({"q_scale": 1e8})
    found = judge(drawn[period])
    for column in ("rx1", "vy1", "rx2", "vy2"):
        for method in ("kf", "hf-exact", "hf-printed"):
            expected = found[f"network.{column}"]
            np.testing.assert_allclose(found[f"{method}.{column}"], expected, rtol=1e-3)


def test_the_noise_that_filters_are_told_is_what_was_put_in(settings: Any) -> None:
    # standard deviations of 4000 normal numbers: 1.1 %
    for fitted in trial(settings, velocity_noise=0.3).noise.values():
        assert np.sqrt(np.diag(fitted.measurement)[2:]) == pytest.approx([0.3, 0.3], rel=0.03)


def test_a_filter_is_told_q_times_its_scale(settings: Any, drawn: dict[float, Any]) -> None:
    there = trial(settings)
    found = there.judge({"q_scale": 4.0})(drawn[0.2])
    for a, fitted in there.noise.items():
        ins, network = drawn[0.2][f"ins.area{a}"], drawn[0.2][f"wsn.area{a}"]
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
        error = ins - run_kalman(told, ins - network, initial_covariance=1e6 * np.eye(4))
        for column, means in zip(("rx", "ry", "vx", "vy"), mean_absolute_error(error), strict=True):
            np.testing.assert_allclose(found[f"kf.{column}{a}"], means, rtol=1e-9)


def test_noise_is_fitted_to_runs_that_are_not_judged(settings: Any) -> None:
    there = trial(settings, seed=7)
    for seed, same in ((8, True), (7, False)):
        runs = monte_carlo(there.scene.simulate, 40, seed)
        model = ErrorModel.p1(there.scene.periods[0])
        fitted = fit_noise(model.A, runs["ins.area1"], runs["wsn.area1"])
        assert np.array_equal(there.noise["1"].measurement, fitted.measurement) is same


QUIET = {"accelerometer_noise": 0.0, "gyro_noise": 0.0}


def test_a_bias_drifts_with_the_time_that_the_path_takes(settings: Any) -> None:
    none = {name: [0.0, 0.0] for name in ("accelerometer_scale", "velocity", "position")}
    alone = with_values(settings, **none, gyro_bias=0.0, heading=0.0)
    errors = {
        period: trial(alone, period=period, **QUIET).draw(np.random.default_rng(0), 1)
        for period in (0.05, 0.2, 1.0)
    }
    # the heading is the same sample by sample, so a velocity is off in proportion to the time that
    # has passed, and a position in proportion to its square
    for period in (0.05, 1.0):
        ratio = period / 0.2
        for a in AREAS:
            found, expected = (errors[p][f"ins.area{a}"] for p in (period, 0.2))
            assert np.abs(expected).max() > 1
            np.testing.assert_allclose(found[:, 2:], ratio * expected[:, 2:], rtol=0.01, atol=0.01)
            np.testing.assert_allclose(
                found[:, :2], ratio**2 * expected[:, :2], rtol=0.01, atol=0.01
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
    settings: Any, name: str, sensor: str, columns: slice, values: tuple[float, float]
) -> None:
    small, large = (
        trial(settings, **{**QUIET, name: value}).draw(np.random.default_rng(0), 20)
        for value in values
    )
    for a in AREAS:
        sizes = [
            np.abs(drawn[f"{sensor}.area{a}"][:, columns]).mean(axis=(0, 2))
            for drawn in (small, large)
        ]
        # the heading of an INS multiplies its other errors: a tenth at this size
        np.testing.assert_allclose(sizes[1], 2 * sizes[0], rtol=0.15)


def test_means_are_those_of_the_cells(settings: Any, drawn: dict[float, Any]) -> None:
    found = trial(settings).judge({"q_scale": 1.0})(drawn[0.2])
    assert tuple(found) == NETWORKED.quantities
    four = [found[f"kf.{c}"] for c in ("rx1", "ry1", "rx2", "ry2")]
    np.testing.assert_allclose(found["kf.position"], sum(four) / 4, rtol=1e-12)
    by_hand = np.abs(drawn[0.2]["wsn.area2"][:, 3]).sum(axis=0) / 100
    np.testing.assert_allclose(found["network.vy2"], by_hand, rtol=1e-12)


@pytest.mark.parametrize("values", [{"period": 0.0}, {"q_scale": -1.0}, {"runs": 7}])
def test_what_may_not_be_is_refused(settings: Any, values: dict[str, Any]) -> None:
    with pytest.raises(ParameterError):
        NETWORKED.run(values, 64, settings)
