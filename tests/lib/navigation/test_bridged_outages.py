"""P1's outages as a Monte Carlo: what a rehearsal sees, and methods whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
from sklearn.dummy import DummyRegressor

from inswsn_lib.navigation import BridgedOutages, Passage
from inswsn_lib.navigation.bridged_outages import COASTING, KINDS

RUNS = 3


@pytest.fixture(scope="module")
def outages() -> BridgedOutages:
    return BridgedOutages(runs=RUNS, tuning_runs=4)


def made(outages: BridgedOutages, velocity: float) -> Passage:
    """An INS that drifts at one velocity, and a network without noise."""
    scene = outages.scene
    heard, silent = scene.training_samples, scene.outage_samples
    time = scene.windows["area1"].period * np.arange(heard + silent)
    error = np.zeros((heard + silent, 4, RUNS))
    error[:, :2] = 5.0 + velocity * time[:, None, None]
    error[:, 2:] = velocity
    y = error.copy()
    y[heard:] = np.nan
    return Passage("1", heard, error, y, {"time": np.repeat(time[:, None, None], RUNS, 2)}, time)


def test_a_rehearsal_takes_the_second_half_for_an_outage(outages: BridgedOutages) -> None:
    passage = outages.judged["2"]
    rehearsal = passage.rehearsal()
    half = passage.heard // 2
    assert rehearsal.heard == half
    assert np.array_equal(rehearsal.y[:half], passage.y[:half])
    assert np.isnan(rehearsal.y[half:]).all()
    # the error that is predicted is the one that was measured; nobody knows the true one
    assert np.array_equal(rehearsal.error, passage.y[: passage.heard])
    assert all(u is None or len(u) == passage.heard for u in rehearsal.inputs.values())
    assert set(passage.inputs) == set(KINDS)


def test_what_is_left_of_the_ins_is_all_if_nothing_is_corrected(outages: BridgedOutages) -> None:
    passage = outages.judged["1"]
    alone = passage.error[passage.heard :]
    assert passage.shares(alone) == pytest.approx(np.ones((4, RUNS)))
    assert passage.shares(alone / 2) == pytest.approx(np.full((4, RUNS), 0.5))
    assert passage.loss(alone / 2) == pytest.approx(0.5)


def test_the_mean_of_the_last_fixes_knows_an_error_that_stands_still(
    outages: BridgedOutages,
) -> None:
    passage = made(outages, 0.0)
    left = outages.bridge(passage, DummyRegressor(), "time", window=1, least=1)
    assert np.abs(left).max() < 1e-12


def test_the_coasting_filter_knows_a_steady_drift(outages: BridgedOutages) -> None:
    passage = made(outages, 0.3)
    # it believes the model, and has seen a hundred fixes without noise
    assert passage.shares(outages.coast(passage, 1e-4))[:2].max() < 1e-3
    held = outages.bridge(passage, DummyRegressor(), "time", window=1, least=1)
    assert passage.shares(held)[:2].min() > 0.05


def test_all_methods_have_the_same_trials(outages: BridgedOutages) -> None:
    trials = {name: len(machines) for name, machines in outages.learners.items()}
    trials |= {name: len(lasts) for name, (_, lasts) in outages.fits.items()}
    passages = list(outages.judged.values())
    trials[COASTING] = outages.compare_coasting(passages, outages.rehearsals).tuning.trials
    assert set(trials.values()) == {12}


def test_the_scores_of_the_ins_are_its_errors() -> None:
    outages = BridgedOutages(runs=40, tuning_runs=4)
    scores = outages.scores()
    for area in "12":
        error = outages.judged[area].error[100:]
        for i, axis in enumerate(("rx", "ry", "vx", "vy")):
            expected = np.abs(error[:, i]).mean(axis=0)
            assert scores.values[f"ins.{axis}{area}"] == pytest.approx(expected)
    assert np.all(scores.values["ins.left"] == 1)
