"""The harness of spoilt recordings: its table, what is kept of it, and that no traceback comes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import spoilt as study
from conftest import WHOLE
from spoilers import Spoiler, spoilers
from spoilt_bases import made_wheels


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> study.Unspoilt:
    """A made vehicle."""
    return study.Unspoilt.of(made_wheels(), tmp_path_factory.mktemp("spoilt") / "recording")


@pytest.fixture(scope="module")
def kept(root: Path) -> study.Study:
    return study.Study.model_validate_json((root / study.SPOILT).read_text(encoding="utf-8"))


def test_each_kept_trial_is_of_a_recording_whose_error_is_kept(kept: study.Study) -> None:
    assert len(kept.trials) >= 500
    assert {each.recording for each in kept.trials} == {*kept.errors}


def test_no_kept_trial_ended_with_a_traceback(kept: study.Study) -> None:
    assert [each.says for each in kept.trials if each.outcome == "traceback"] == []


@pytest.mark.parametrize("outcome", ["refused", "detected", "passed"])
def test_a_kept_trial_comes_again(kept: study.Study, wheels: study.Unspoilt, outcome: str) -> None:
    mine = [each for each in kept.trials if each.recording == "made, odometry"]
    before = next(each for each in mine if each.outcome == outcome)
    [way] = [s for s in spoilers() if (s.file, s.name) == (before.file, before.spoiler)]
    after = study.try_one(wheels, way, before.sizes, before.draw)
    exact = {"harm": None, "says": ""}
    assert after.model_copy(update=exact) == before.model_copy(update=exact)
    if before.harm is not None:
        assert after.harm == pytest.approx(before.harm, rel=0.05)


def test_what_is_made_ends_without_a_traceback(wheels: study.Unspoilt) -> None:
    """Every tenth way to spoil a vehicle with odometry, weekly every fifth, of one size."""
    step = 5 if WHOLE else 10
    ways = [way for way in spoilers() if way.fits(wheels.folder)][::step]
    trials = [study.try_one(wheels, way, way.classes[-1], 0) for way in ways]
    assert len(trials) > 50 // step
    assert [each.says for each in trials if each.outcome == "traceback"] == []
    assert {"refused", "detected"} <= {each.outcome for each in trials}


def test_a_fault_of_the_library_is_told_as_one(
    wheels: study.Unspoilt, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fault(_: object) -> None:
        raise IndexError("out of bounds")

    way = Spoiler("nothing", "ranges.csv", lambda *_: None)
    found = study.try_one(wheels, way, "whole", 0)  # what is not spoilt passes without harm
    assert (found.outcome, found.harm, found.findings) == ("passed", 1.0, ())
    monkeypatch.setattr(study.logs, "check_set_up", fault)
    found = study.try_one(wheels, way, "whole", 0)
    assert (found.outcome, found.says) == ("traceback", "checks: IndexError: out of bounds")


def test_spoilers_change_what_they_say(tmp_path: Path) -> None:
    """A table with known numbers: a gap of 2 s in 10 s, ranges in feet, and a late clock."""
    ways = {(way.file, way.name): way for way in spoilers()}
    rows = [f"{k / 10},{1 + k}" for k in range(100)]
    path = tmp_path / "odometry.csv"

    def spoil(name: str, size: float) -> np.ndarray:
        path.write_text("\n".join(["time_s,speed_mps", *rows]) + "\n")
        ways["odometry.csv", name].change(path, size, np.random.default_rng(1))
        return np.loadtxt(path, delimiter=",", skiprows=1)

    assert len(spoil("gap", 2.0)) == 80
    assert np.diff(spoil("gap", 2.0)[:, 0]).max() == pytest.approx(2.1)
    assert abs(spoil("late clock", 0.3)[:, 0] - np.arange(100) / 10) == pytest.approx(0.3)
    assert spoil("speed too large", 0.5)[:, 1] == pytest.approx(1.5 * np.arange(1, 101))
    assert spoil("stamps in ms", 0.0)[:, 0] == pytest.approx(100 * np.arange(100))
