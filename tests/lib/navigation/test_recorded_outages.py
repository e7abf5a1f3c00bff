"""Outages and clusters of recordings: what stands in for fixes, where the answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_recording import made, made_imu, motion

from inswsn_lib.errors import InswsnError
from inswsn_lib.learning import LSSVMRegressor
from inswsn_lib.logs import Ladder, Outages
from inswsn_lib.logs.correction import COLOURED, WHITE
from inswsn_lib.navigation import RecordedClusters, RecordedOutages
from inswsn_lib.navigation.recorded_study import NEVER, RESTARTED, LearnerSetting
from inswsn_lib.streams import Fixes, Recording


@pytest.fixture(scope="module")
def walk() -> Ladder:
    recording = made(6, seconds=80.0, rate=200.0, noise=0.05)
    return on_fixes(replace(recording, imu=made_imu(6, seconds=80.0)))


def on_fixes(recording: Recording) -> Ladder:
    """Return a ladder with the filters on fixes alone, each search of which begins once."""
    found = Ladder(recording, alignment=15.0, begins=1)
    vars(found)["rungs"] = {name: found.rungs[name] for name in (WHITE, COLOURED)}
    vars(found)["families"] = ("KF",)
    return found


@pytest.fixture(scope="module")
def outages(walk: Ladder) -> RecordedOutages:
    found = RecordedOutages(walk, longest=4.0, every=5.0, windows=(25,))
    few = {name: settings[::20] for name, settings in found.choices.items()}
    vars(found)["choices"] = few
    return found


def test_outages_lie_in_the_judged_part_and_end_in_the_recording(outages: RecordedOutages) -> None:
    time = outages.ladder.fixes.time[outages.starts]
    assert (time > outages.ladder.split).all()
    assert (time + 4.0 < outages.ladder.fixes.time[-1]).all()
    assert (np.diff(time) >= 5.0).all()
    assert outages.steps == 20


def test_who_stands_still_errs_by_the_way_that_the_tag_goes(outages: RecordedOutages) -> None:
    ladder, k = outages.ladder, outages.starts
    ahead = k[:, None] + 1 + np.arange(outages.steps)
    moved = motion(ladder.fixes.time[ahead].ravel())[0][:, :2].reshape(*ahead.shape, 2)
    begin = motion(ladder.fixes.time[k])[0][:, None, :2]
    way = np.linalg.norm(moved - begin, axis=2)
    # but for the errors of the last fix, of 5 cm a range
    assert outages.errors["stand still at the last fix"] == pytest.approx(way, abs=0.1)


def test_a_filter_that_coasts_beats_all_that_has_no_imu(outages: RecordedOutages) -> None:
    table = outages.table((1.0, 4.0))
    coasting = table.loc["coasting filter", "rms 4 s"]
    assert coasting < 0.2
    assert table.loc["go on at the last velocity", "rms 4 s"] > 1.0
    assert table.loc["go on at the last velocity", "ratio 4 s"] == 1.0
    assert table.loc["smoother, fixes on both sides", "rms 4 s"] < coasting
    assert table.loc["P1's LS-SVM", "rms 4 s"] > coasting
    oracles = table.index[table["oracle"].astype(bool)]
    assert set(oracles) == set(outages.oracles)


def test_an_ins_that_is_restarted_at_the_last_fix_is_the_filter_that_coasts(
    outages: RecordedOutages,
) -> None:
    passage = outages.passage(outages.starts, 0)
    off = np.linalg.norm(passage.error[1:, :2], axis=1).T
    assert off == pytest.approx(outages.errors["coasting filter"], abs=1e-9)
    # P1's INS is off by what it drifts in the window, one that is never corrected by much more
    off = {w: np.abs(outages.passage(outages.starts, w).error[w, :2]).max() for w in (25, 75)}
    never = np.abs(outages.passage(outages.starts, 25, NEVER).error[25, :2]).max()
    assert off[25] < off[75] < 0.2 * never


def test_a_perfect_filter_and_a_learner_of_the_right_form_leave_no_error(
    walk: Ladder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The INS errs by a parabola in time, which continues, and the filter knows it exactly."""

    def astray(outages: RecordedOutages, k: int, window: int) -> np.ndarray:
        rows = slice(k - window, k + outages.steps + 1)
        passed = (walk.fixes.time[rows] - walk.fixes.time[rows.start])[:, None]
        growth = np.hstack([passed**2 / 2, passed**2, passed, 2 * passed])
        return np.asarray(walk.truth[rows] + growth)

    monkeypatch.setattr(RecordedOutages, "_restarted", astray)
    outages = RecordedOutages(walk, 4.0, 5.0)
    starts = tuple(outages.starts.tolist())
    exact = outages.passage(outages.starts, 25).error
    monkeypatch.setattr(RecordedOutages, "_kalman", lambda _, y: np.where(np.isnan(y), 0.0, exact))
    machine = LSSVMRegressor(1.0, 1e10, "polynomial")
    left = outages._bridged(starts, RESTARTED, LearnerSetting("time", 25, machine))
    assert np.linalg.norm(exact[-1, :2], axis=0).min() > 50.0
    assert left.max() < 1e-4
    # who has but a line goes straight on from a parabola
    line = outages._bridged(
        starts, RESTARTED, LearnerSetting("time", 25, LSSVMRegressor(1, 1e10, "linear"))
    )
    assert line[:, -1].min() > 5.0


def test_what_comes_after_an_outage_began_changes_no_prediction(outages: RecordedOutages) -> None:
    walk, k = outages.ladder, outages.starts[-2]
    late = walk.fixes.time > walk.fixes.time[k]
    assert walk.fixes.velocity is not None
    spoilt = replace(
        walk.fixes, position=walk.fixes.position + 100.0 * late[:, None],
        velocity=walk.fixes.velocity - 5.0 * late[:, None],
    )  # fmt: skip
    other = replace(walk)
    vars(other).update(
        filters=replace(walk.filters, fixes=spoilt), families=("KF",), _searches=walk._searches
    )
    vars(other.filters)["start"] = walk.start
    found = replace(outages, ladder=other)
    vars(found).update(starts=outages.starts, settings=outages.settings)
    for name in [n for n in outages.errors if n.startswith("P1's")]:
        mine, same = found.errors[name], outages.errors[name]
        assert mine[:-1] == pytest.approx(same[:-1], rel=1e-9, abs=1e-9), name
        assert np.abs(mine[-1] - same[-1]).min() > 1.0, name


def test_settings_are_chosen_in_outages_that_end_before_the_split(outages: RecordedOutages) -> None:
    rehearsed, ladder = outages.rehearsed, outages.ladder
    assert ladder.fixes.time[rehearsed + outages.steps].max() < ladder.split
    assert ladder.fixes.time[rehearsed - 25].min() > ladder.start.time
    chosen = outages.chosen()
    assert chosen.loc["P1's LS-SVM", "trials"] == len(outages.choices["LS-SVM"])
    everything = RecordedOutages(ladder).choices
    assert len(everything["LS-SVM"]) == len(everything["BP network"]) == 540


def test_fixes_alone_make_outages_too_and_too_few_are_told() -> None:
    time = np.arange(0.5, 60.0, 0.25)
    place = motion(time)[0]
    fixes = Fixes(time, place, good=np.arange(len(time)) % 7 > 0)
    recording = Recording("walk", imu=made_imu(7), fixes=fixes)
    outages = RecordedOutages(Ladder(recording, alignment=15.0, begins=1), 4.0, 3.0, (12,))
    vars(outages)["choices"] = {"LS-SVM": outages.choices["LS-SVM"][-1:]}
    table = outages.table((4.0,))
    assert table.loc["P1's LS-SVM", "rms 4 s"] < table.loc["go on at the last velocity", "rms 4 s"]
    assert table.loc["coasting filter", "rms 4 s"] < 0.5
    # what is not good is never held against a method
    assert np.isnan(outages.errors["coasting filter"]).any()
    # where no fix is good, or none is even there, there is no outage
    for each in (replace(fixes, good=(time < 45) | (time > 50)),
                 fixes.kept((time < 45) | (time > 55))):  # fmt: skip
        ladder = Ladder(Recording("walk", imu=made_imu(7), fixes=each), alignment=15.0)
        cut = Outages(ladder, 2.0, 2.0)
        errors = cut.apart(np.zeros((len(cut.starts), cut.steps, 2)), cut.starts)
        assert cut.ratio(errors, errors, 0.5)[1:] == pytest.approx((1.0, 1.0, 1.0))
        assert np.ptp(ladder.fixes.time[cut.ahead(cut.starts)], axis=1).max() < 3.0
    with pytest.raises(InswsnError, match=r"^walk has room for \d outages of 26 s; three are"):
        _ = replace(outages, longest=26.0).starts


def test_two_clusters_with_independent_errors_are_fused_as_theory_says() -> None:
    recording = replace(made(8, rate=200.0, noise=0.4), imu=made_imu(8))
    clusters = RecordedClusters(on_fixes(recording))
    P = clusters.covariance
    assert np.abs(np.array(clusters.correlation)).max() < 0.15
    table = clusters.table()
    # independent errors: the variance of the best weights is the inverse of the sum of information
    expected = np.trace(np.linalg.inv(np.linalg.inv(P[:2, :2]) + np.linalg.inv(P[2:, 2:])))
    assert table.loc["weighted, as if independent", "position"] == pytest.approx(
        np.sqrt(expected), rel=0.15
    )
    assert 0.7 < table.loc["weighted, as if independent", "nees"] < 1.4
    assert table.loc["covariance intersection", "nees"] < 1.2
    assert table.loc["all anchors at once", "position_ratio"] == 1.0
