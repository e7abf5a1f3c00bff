"""The map of learners: methods on drifts that they meet exactly, and what a winner is."""

from __future__ import annotations

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.navigation import BridgedOutages, LearnerMap, Passage
from inswsn_lib.navigation.bridged_outages import COASTING, Bridge
from inswsn_lib.navigation.learner_map import ALONE, FREE, INPUTS, LEAD, LEARNERS, share

HOLD, LINE, PARABOLA = ((name, "none") for name in FREE[:3])
QUIET = (0.0, 0.0)


@pytest.fixture(scope="module")
def outages() -> BridgedOutages:
    return BridgedOutages(runs=2, tuning_runs=4)


def small(outages: BridgedOutages, *drifts: str, **options: object) -> LearnerMap:
    values = {"runs": 4, "tuning_runs": 3, "lengths": (2.0, 10.0), "noise": QUIET} | options
    return LearnerMap(outages, drifts=drifts, **values)  # type: ignore[arg-type]


def left(ground: LearnerMap, key: tuple[str, str]) -> np.ndarray:
    """Return what a method leaves of the error of the INS, (drifts, lengths), as a share."""
    alone = ground.means(ground.judged.error[ground.heard :]).mean(axis=2)
    return np.asarray(ground.judge(ground.methods[key]).errors.mean(axis=2) / alone)


def test_each_fit_meets_the_drift_of_its_order_and_not_the_next(outages: BridgedOutages) -> None:
    ground = small(outages, "offset", "steady", "accelerating")
    hold, line, parabola = (left(ground, key) for key in (HOLD, LINE, PARABOLA))
    assert hold[0] == pytest.approx(0, abs=1e-12)
    assert line[:2] == pytest.approx(0, abs=1e-9)
    assert parabola == pytest.approx(0, abs=1e-6)
    assert hold[1:, 1].min() > 0.1
    assert line[2, 1] > 0.01


def test_a_drift_of_the_motion_is_met_by_a_plane_on_the_motion_and_by_none_on_time(
    outages: BridgedOutages,
) -> None:
    ground = small(outages, "turning")
    on = {kind: left(ground, ("LS-SVM, linear kernel", kind)) for kind in ("motion", "time")}
    assert on["motion"].max() < 0.02  # the least ridge that is tried
    assert on["time"].min() > 0.02
    assert on["time"][0, 1] > 10 * on["motion"][0, 1]


def test_every_method_has_as_many_trials_as_the_others(outages: BridgedOutages) -> None:
    methods = small(outages, "offset").methods
    assert {len(bridges) for bridges in methods.values()} == {12}
    learners = {(name, kind) for name in LEARNERS for kind in INPUTS}
    assert set(methods) == learners | {(name, "none") for name in FREE}
    windows = [bridge.keywords["window"] for bridge in methods[LINE]]
    assert len(set(windows)) == 12
    assert max(windows) == 100


def test_a_seed_is_one_set_of_runs_and_drifts_are_drawn_by_themselves(
    outages: BridgedOutages,
) -> None:
    one = small(outages, "steady", "turning", noise=None)
    again = small(outages, "turning", noise=None)
    other = small(BridgedOutages(seed=7, runs=2, tuning_runs=4), "turning", noise=None)
    turning = slice(one.runs, None)
    assert np.array_equal(one.judged.error[..., turning], again.judged.error)
    assert np.array_equal(one.judged.y[..., turning], again.judged.y, equal_nan=True)
    assert not np.array_equal(again.judged.error, other.judged.error)
    key = (COASTING, "none")
    errors = one.judge(one.methods[key]).errors
    assert np.array_equal(errors[1:], again.judge(again.methods[key]).errors)


def test_the_network_is_heard_before_the_outage_and_in_the_rehearsal_alone(
    outages: BridgedOutages,
) -> None:
    ground = small(outages, "steady", runs=40, tuning_runs=40, noise=(0.3, 0.1))
    passage, rehearsed = ground.judged, ground.rehearsed
    assert np.isfinite(passage.y[:100]).all()
    assert np.isnan(passage.y[100:]).all()
    noise = (passage.error - passage.y)[:100]
    assert noise[:, :2].std() == pytest.approx(0.3, rel=0.03)
    assert noise[:, 2:].std() == pytest.approx(0.1, rel=0.03)
    assert np.array_equal(rehearsed.error[:100], rehearsed.y[:100])
    # in a rehearsal the error is measured: not straight, as this drift is
    assert np.abs(np.diff(rehearsed.error[100:, :2], 2, axis=0)).min() > 0
    assert np.diff(passage.error[100:, :2], 2, axis=0) == pytest.approx(0, abs=1e-9)
    assert not np.array_equal(passage.y[:100], rehearsed.y[:100])  # other runs
    # the motion that an INS indicates has its error, here a steady one that the truth has not
    indicated = passage.inputs["motion"]
    assert indicated is not None
    assert np.hypot(*np.moveaxis(indicated - passage.error, 1, 0)[2:]) == pytest.approx(7.5)


def test_an_error_is_a_mean_over_the_outage_and_both_positions(outages: BridgedOutages) -> None:
    ground = small(outages, "steady", "offset", runs=2, lengths=(0.4, 1.0))
    remains = np.zeros((5, 4, 4))
    remains[:, 0] = np.arange(1.0, 6.0)[:, None] * [1, -1, 0, 2]
    remains[:, 2:] = 1e3  # velocities do not count
    found = ground.means(remains)
    assert found.shape == (2, 2, 2)
    assert found[:, 0].ravel() == pytest.approx([0.75, 0.75, 0, 1.5])  # of 1 and 2, over 2
    assert found[:, 1].ravel() == pytest.approx([1.5, 1.5, 0, 3])  # of 1 to 5, over 2


def test_a_setting_is_chosen_in_the_rehearsal_and_judged_elsewhere(
    outages: BridgedOutages,
) -> None:
    ground = small(outages, "offset", "steady")
    gap = slice(ground.heard, None)

    # in rehearsal the first setting is better on one drift, the second on the other
    def setting(offset: float, steady: float, judged: float) -> Bridge:
        rehearsed = np.repeat([offset, steady], ground.tuning_runs)

        def bridge(passage: Passage) -> np.ndarray:
            factor = rehearsed if passage is ground.rehearsed else judged
            return np.asarray(factor * passage.error[gap])

        return bridge

    chosen = ground.judge([setting(0.1, 0.9, 2.0), setting(0.5, 0.2, 3.0)])
    assert chosen.settings.tolist() == [[0, 0], [1, 1]]
    alone = ground.means(ground.judged.error[gap])
    assert chosen.errors[0] == pytest.approx(2 * alone[0])
    assert chosen.errors[1] == pytest.approx(3 * alone[1])


def test_a_winner_is_ahead_beyond_the_interval_and_by_a_hundredth_of_the_error(
    outages: BridgedOutages,
) -> None:
    ground = small(outages, "steady", runs=48, lengths=(2.0,))
    alone = 10 + np.random.default_rng(0).standard_normal(48)
    noisy = np.random.default_rng(1).standard_normal(48)
    found = {
        ("best", "none"): 0.2 * alone,
        ("near", "none"): (0.2 + 0.9 * LEAD / 100) * alone,  # certain, and too little
        ("behind", "motion"): (0.2 + 1.1 * LEAD / 100) * alone,  # certain, and enough
        ("unsure", "none"): (0.2 + 2 * LEAD / 100) * alone + 2 * (noisy - noisy.mean()),
        (ALONE, "none"): alone,
    }
    ground.__dict__["compared"] = {key: e[None, None] for key, e in found.items()}
    table = ground.table().set_index(["input", "method"])
    assert table.loc["motion", "beaten"].to_dict() == {
        "best": False, "near": False, "behind": True, "unsure": False, ALONE: True,
    }  # fmt: skip
    assert ("time", "behind") not in table.index  # a learner stands under its own input
    assert table.loc[("time", "best"), "left"] == pytest.approx(20)
    assert table.loc[("time", ALONE), ["left", "low", "high"]].tolist() == pytest.approx([100] * 3)


def test_the_interval_of_a_share_covers() -> None:
    rng = np.random.default_rng(0)
    held = 0
    for _ in range(1000):
        wholes = np.abs(rng.standard_normal(48)) + np.abs(rng.standard_normal(48))
        values = 0.3 * wholes + 0.2 * rng.exponential(1.0, 48)
        ratio, within = share(values, wholes)
        # E|z| is sqrt(2/pi)
        held += abs(ratio / 100 - 0.3 - 0.2 / (2 * np.sqrt(2 / np.pi))) < within / 100
    assert 0.93 <= held / 1000 <= 0.965


def test_the_interval_of_a_share_covers_on_the_map(outages: BridgedOutages) -> None:
    drifts = ("steady", "oscillating", "turning")
    ground = small(outages, *drifts, runs=20 * 48, lengths=(10.0,), noise=None)
    errors = ground.means(ground.methods[COASTING, "none"][6](ground.judged))[:, 0]
    alone = ground.means(ground.judged.error[ground.heard :])[:, 0]
    held = 0
    for e, w in zip(errors, alone, strict=True):
        for block in range(20):
            part = slice(48 * block, 48 * (block + 1))
            left, within = share(e[part], w[part])
            held += abs(left - 100 * e.mean() / w.mean()) < within
    assert 0.88 <= held / 60 <= 1  # 95 % of 60, less 2.5 deviations


def test_what_is_out_of_order_is_refused(outages: BridgedOutages) -> None:
    for wrong in ({"runs": 1}, {"tuning_runs": 0}, {"lengths": ()}, {"lengths": (5.0, 2.0)}):
        with pytest.raises(ParameterError, match=next(iter(wrong))):
            small(outages, "offset", **wrong)
    with pytest.raises(ParameterError, match="drifts"):
        small(outages, "sideways")
    with pytest.raises(ParameterError, match="lengths"):
        small(outages, "offset", lengths=(0.1,))
