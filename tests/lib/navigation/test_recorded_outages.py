"""Outages and clusters of recordings: what stands in for fixes, where the answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_folders import needs
from made_recording import made, made_imu, motion

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs import Ladder, Outages
from inswsn_lib.logs.correction import COLOURED, WHITE
from inswsn_lib.navigation import RecordedClusters, RecordedOutages
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
    return RecordedOutages(walk, longest=4.0, every=5.0)


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


def test_fixes_alone_make_outages_too_and_too_few_are_told() -> None:
    time = np.arange(0.5, 60.0, 0.25)
    place = motion(time)[0]
    fixes = Fixes(time, place, good=np.arange(len(time)) % 7 > 0)
    recording = Recording("walk", imu=made_imu(7), fixes=fixes)
    outages = Outages(Ladder(recording, alignment=15.0, begins=1), 4.0, 4.0)
    table = outages.table((4.0,))
    assert "P1's LS-SVM" not in table.index
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


@needs("inrol/1")
def test_in_recorded_outages_the_learners_are_worse_than_standing_still() -> None:
    table = RecordedOutages(on_fixes(logs.load("inrol/1")), every=8.0).table((10.0,))
    still = table.loc["stand still at the last fix", "rms 10 s"]
    assert table.loc["P1's LS-SVM", "rms 10 s"] > still
    assert table.loc["coasting filter", "ratio 10 s"] < 1
