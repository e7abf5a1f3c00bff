"""P1's outages as a Monte Carlo: what a rehearsal sees, and methods whose answer is known."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from sklearn.dummy import DummyRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, DotProduct, WhiteKernel
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures

from inswsn_lib.errors import ParameterError
from inswsn_lib.navigation import BridgedOutages, Passage, bridged_outages
from inswsn_lib.navigation.bridged_outages import COASTING, KINDS, judge_best, share_findings
from inswsn_lib.scenario import with_values

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
    inputs = {"time": np.repeat(time[:, None, None], RUNS, 2), "state": None}
    return Passage("1", heard, error, y, inputs, time)


def test_a_passage_is_an_area_and_its_outage(outages: BridgedOutages) -> None:
    drawn, passage = outages.drawn, outages.judged["2"]
    assert passage.heard == 100
    assert np.array_equal(passage.error[:100], drawn["ins.area2"])
    assert np.array_equal(passage.error[100:], drawn["ins.outage2"])
    assert np.array_equal(passage.y[:100], drawn["ins.area2"] - drawn["wsn.area2"])
    assert np.isnan(passage.y[100:]).all()
    assert np.diff(passage.time) == pytest.approx(np.full(149, 0.21))
    assert set(passage.inputs) == set(KINDS)
    assert passage.inputs["oracle"] is passage.error
    # the motion is the true one, of 7.5 m/s along the path, and the error of the INS
    motion = passage.inputs["motion"]
    assert motion is not None
    truth = motion - passage.error
    assert np.hypot(truth[:, 2], truth[:, 3]) == pytest.approx(np.full((150, RUNS), 7.5))
    assert np.hypot(*np.diff(truth[:20, :2], axis=0).transpose(1, 0, 2)) == pytest.approx(
        np.full((19, RUNS), 7.5 * 0.21)
    )


def test_a_rehearsal_takes_the_second_half_for_an_outage(outages: BridgedOutages) -> None:
    passage = outages.judged["2"]
    rehearsal = passage.rehearsal()
    assert rehearsal.heard == 50
    assert np.array_equal(rehearsal.y[:50], passage.y[:50])
    assert np.isnan(rehearsal.y[50:]).all()
    # the error that is predicted is the one that was measured; nobody knows the true one
    assert np.array_equal(rehearsal.error, passage.y[:100])
    assert all(u is None or len(u) == 100 for u in rehearsal.inputs.values())
    assert np.isfinite(passage.y[50:100]).all()  # it keeps its own


def test_what_is_left_of_the_ins_is_all_if_nothing_is_corrected(outages: BridgedOutages) -> None:
    passage = outages.judged["1"]
    alone = passage.error[passage.heard :]
    assert passage.shares(alone) == pytest.approx(np.ones((4, RUNS)))
    left = alone * [[[0.5], [1.0], [1.5], [3.0]]]
    assert passage.shares(left) == pytest.approx(np.tile([[0.5], [1.0], [1.5], [3.0]], RUNS))


def test_a_drift_is_known_to_who_assumes_it(outages: BridgedOutages) -> None:
    still, steady = made(outages, 0.0), made(outages, 0.3)
    held = partial(
        outages.bridge, regressor=DummyRegressor(), kind="time", window=1, least=1
    )  # the last fix
    assert np.abs(held(still)).max() < 1e-12
    assert steady.shares(held(steady))[:2].min() > 0.05
    for kind in ("time", "state"):
        shares = outages.judge([steady], LinearRegression(), kind)
        assert shares.shape == (4, RUNS)
        assert shares.max() < 1e-9
    # the filter believes the model, and has seen a hundred fixes without noise
    assert steady.shares(outages.coast(steady, 1e-4))[:2].max() < 1e-3


def test_of_settings_the_one_with_the_least_loss_in_rehearsal_is_judged(
    outages: BridgedOutages,
) -> None:
    passages = [made(outages, 0.3), made(outages, 0.6)]

    def left(passage: Passage, share: float) -> np.ndarray:
        # better in the passages than in the rehearsal, where it loses
        kept = share if passage.heard == 50 else 1 / share
        return kept * passage.error[passage.heard :]

    settings = [partial(left, share=share) for share in (2.0, 0.5, 1.0, np.inf)]
    judged = judge_best("any", settings, passages, [p.rehearsal() for p in passages])
    assert judged.tuning.losses == pytest.approx((2.0, 0.5, 1.0, 1e6))
    assert judged.shares == pytest.approx(np.full((8, RUNS), 2.0))
    assert judged.by_run == pytest.approx(np.full((101, RUNS), 200.0))  # whichever runs tune


def test_a_choice_that_hangs_on_which_runs_tune_widens_the_interval() -> None:
    """Of draws of two runs of eight, those of the first half alone choose another setting."""
    passage = BridgedOutages(runs=8).judged["1"]
    half = np.arange(8) < 4

    def left(of: Passage, first: float, other: float) -> np.ndarray:
        return np.where(half, first, other) * of.error[of.heard :]

    settings = [partial(left, first=0.0, other=2.2), partial(left, first=1.0, other=1.0)]
    even = replace(passage, error=np.ones_like(passage.error))  # so that all runs weigh the same
    judged = judge_best("any", settings, [passage], [even])
    assert judged.by_run[0] == pytest.approx(np.full(8, 100.0))
    assert (judged.by_run[1:, -1] > 200).mean() == pytest.approx(0.25, abs=0.1)
    found = share_findings({("any", "motion"): judged})["fair.any.motion"]
    assert (found.low, found.value, found.high) == pytest.approx((0.0, 100.0, 220.0))


def test_all_methods_have_twelve_different_trials(outages: BridgedOutages) -> None:
    """A setting that stands twice is one trial less."""
    methods = outages.methods(KINDS)
    assert len(methods) == 5 * 5 + 3 + 2
    assert (COASTING, "state") in methods
    passage = made(outages, 0.3).rehearsal()
    for (name, kind), settings in methods.items():
        told = {repr(sorted(setting.keywords.items(), key=str)) for setting in settings}  # type: ignore[attr-defined]
        assert len(settings) == len(told) == 12, name
        assert kind != "state" or settings[0](passage).shape == (50, 4, RUNS)


def test_the_settings_are_scaled_and_the_rest_is_published() -> None:
    half = BridgedOutages(inertial_scale=0.5, range_noise=0.1)
    changed = [n for n, was in half.published.items() if half.settings[n].value != was.value]
    inertial = ["accelerometer_bias", "accelerometer_scale", "gyro_bias"]
    assert sorted(changed) == sorted([*inertial, "heading", "noise", "position", "velocity"])
    assert half.settings["noise"].value == 0.1
    for name in set(changed) - {"noise"}:
        was = np.array(half.published[name].value)
        assert np.array(half.settings[name].value) == pytest.approx(was / 2)


def test_the_scores_are_table_3() -> None:
    outages = BridgedOutages(runs=40, tuning_runs=4)
    scores = outages.scores()
    assert len(scores.methods) == 5 + 3 + 2 + 4
    printed = outages.judge(outages.judged.values(), outages.printed, "motion", scaled=False)
    for a, area in enumerate("12"):
        error = outages.judged[area].error[100:]
        for i, axis in enumerate(("rx", "ry", "vx", "vy")):
            expected = np.abs(error[:, i]).mean(axis=0)
            assert scores.values[f"ins.{axis}{area}"] == pytest.approx(expected)
            share = scores.values[f"printed.{axis}{area}"] / expected
            assert share == pytest.approx(printed[4 * a + i])
    assert np.all(scores.values["ins.left"] == 1)
    assert scores.values["printed.left"] == pytest.approx(printed.mean(axis=0))
    assert scores.methods["own"] == "sklearn.linear_model:LinearRegression"
    assert scores.methods["ls-svm-linear-kernel"] == "LS-SVM, linear kernel"


@pytest.mark.parametrize("length", [0.3, 10.0])
@pytest.mark.parametrize("deviation", [0.03, 0.3])
def test_the_gaussian_process_is_that_of_scikit_learn(length: float, deviation: float) -> None:
    rng = np.random.default_rng(1)
    X, Y, new = (rng.standard_normal((n, c)) for n, c in ((50, 3), (50, 2), (20, 3)))
    kernel = 1.0 * DotProduct(1.0) + RBF(length) + WhiteKernel(deviation**2)
    theirs = GaussianProcessRegressor(kernel, optimizer=None).fit(X, Y).predict(new)
    ours = bridged_outages._GaussianProcess(length, deviation).fit(X, Y).predict(new)
    assert ours == pytest.approx(theirs, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("samples", [1, 2, 3, 30])
def test_the_polynomial_is_that_of_scikit_learn(degree: int, samples: int) -> None:
    """Also where there are too few samples, and it is the least of those that fit."""
    rng = np.random.default_rng(2)
    X, Y, new = rng.normal(1, 3, (samples, 1)), rng.normal(2, 1, (samples, 4)), np.ones((5, 1))
    theirs = make_pipeline(PolynomialFeatures(degree), LinearRegression()).fit(X, Y).predict(new)
    ours = bridged_outages._Polynomial(degree).fit(X, Y).predict(new)
    assert ours == pytest.approx(theirs)


def test_learners_need_a_fix_at_each_sample(outages: BridgedOutages) -> None:
    with pytest.raises(ParameterError, match=r"^scene must be .* not one without at 33 of 100 in"):
        BridgedOutages(with_values(outages.published, lost_every=3), runs=RUNS).scores()
