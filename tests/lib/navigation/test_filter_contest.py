"""Filters on equal terms, and the map of where each is right, against limits that are known."""

from __future__ import annotations

import numpy as np
import pytest
from inswsn_book.evidence.filter_map import FilterMap

from inswsn_lib.filters import run_kalman
from inswsn_lib.navigation import CONTESTANTS, FilterContest, TrainingAreas
from inswsn_lib.navigation.filter_contest import TRIALS, run_wandering
from inswsn_lib.navigation.training_areas import UNKNOWN


@pytest.fixture(scope="module")
def contest() -> FilterContest:
    return FilterContest(TrainingAreas(runs=40, other_runs=40))


@pytest.fixture(scope="module")
def chart(contest: FilterContest) -> FilterMap:
    return FilterMap(contest, runs=40)


def test_every_filter_has_two_numbers_and_no_more_than_the_same_trials(
    contest: FilterContest,
) -> None:
    assert set(contest.tunings) == set(CONTESTANTS)
    for search in contest.tunings.values():
        assert search.trials <= TRIALS
        assert {len(candidate) for candidate in search.candidates} == {2}
        assert search.candidates[0][0] == 1.0  # all begin with the Q that matches


@pytest.mark.parametrize("area", ["1", "2"])
def test_all_filters_are_the_kalman_filter_where_their_second_number_takes_them_there(
    contest: FilterContest, area: str
) -> None:
    drawn = contest.areas.drawn
    y = drawn["ins"][area] - drawn["wsn"][area]
    plain = contest.build("Kalman", 1.0, 1.0)(area, y)
    limits = {
        "HF, exact LMI": 1e4,  # a margin without a bound on the worst case
        "Kalman, coloured error": 1e-9,  # s
        "Kalman, acceleration states": 1e-9,  # m/s^2
        "Kalman with Huber update": 1e9,  # standard deviations
    }
    for name, own in limits.items():
        found = contest.build(name, 1.0, own)(area, y)
        # an H-infinity filter has its last gain from the start
        np.testing.assert_allclose(found[60:], plain[60:], atol=3e-3 if "HF" in name else 1e-5)


def test_a_factor_on_the_measurement_noise_is_one_over_it_on_that_of_the_process(
    contest: FilterContest,
) -> None:
    """So inflating R is no number of its own: nothing is known before the first measurement."""
    model = contest.areas.matched["1"]
    y = contest.areas.drawn["ins"]["1"] - contest.areas.drawn["wsn"]["1"]
    Q, R = model.process_covariance, model.measurement_covariance
    found = [
        run_kalman(model.with_covariances(*noise), y, initial_covariance=1e6 * UNKNOWN)
        for noise in ((Q, 10 * R), (Q / 10, R))
    ]
    np.testing.assert_allclose(found[0], found[1], atol=1e-6)


def test_a_filter_with_acceleration_states_takes_a_bias_off() -> None:
    """Of 2 m/s^2, without noise: after 20 s the lag is gone, where a filter without them has it."""
    areas = TrainingAreas(runs=1, other_runs=40)
    model, time = areas.matched["1"], 0.2 * np.arange(100)[:, None, None]
    error = np.concatenate([time**2, time**2, 2 * time, 2 * time], axis=1)
    left = error - run_wandering(model, 2.0, error, correlation_time=1e6)
    lag = error - run_kalman(model, error, initial_covariance=UNKNOWN)
    assert np.abs(left[-1]).max() < 1e-3
    assert np.abs(lag[-1, :2]).max() > 1e-2


def test_one_that_is_told_the_truth_is_the_tuned_filter_or_a_better_one(chart: FilterMap) -> None:
    nothing = chart.errors("correlation", 0.0)
    assert nothing["told"] == nothing["kalman"]
    for ground, size in (("bias", 3.0), ("correlation", 5.0), ("assumed-q", 1e-4)):
        found = chart.errors(ground, size)
        assert sum(found["told"]) < 0.9 * sum(found["kalman"])


def test_against_an_adversary_the_bound_orders_the_filters(chart: FilterMap) -> None:
    """All energy where it harms most is the worst-case gain; none is the error by Lyapunov."""
    (white, _), (worst, _) = (
        zip(
            *(chart.errors("adversary", share)[n] for n in ("hf-least", "hf", "kalman")),
            strict=True,
        )
        for share in (0.0, 100.0)
    )
    assert worst[0] < worst[1] < worst[2]
    assert white[2] < white[0]
    model = chart.contest.areas.matched["1"]
    channels, by_white, by_worst = chart._steady["network"]
    # the deadbeat predictor has the error A D v - B w, which no step before it enters
    driven = np.hstack([model.B, -model.A @ model.D])[:2]
    assert channels == 8
    assert by_white[0, 0] == pytest.approx(np.linalg.norm(driven))
    assert by_worst[0, 0] == pytest.approx(np.linalg.norm(driven, 2), rel=1e-4)
