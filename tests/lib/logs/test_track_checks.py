"""What is found in a recording: nothing in the example; `trials.test_recordings` has mistakes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import inswsn_lib as iw
from inswsn_lib import ErrorModel, ParameterError, TrackPair
from inswsn_lib.logs import Finding, check_recording, verdict

MODEL = ErrorModel.p1(0.2, process_noise=(0.001, 0.01), measurement_noise=(0.2, 0.1))
RIGHT = iw.read_recording(iw.data_file("examples/ins-wsn.csv"))


def checked(data: TrackPair, model: ErrorModel = MODEL) -> list[Finding]:
    return check_recording(data, model, initial_covariance=np.diag([1.0, 1.0, 0.01, 0.01]))


def test_the_recording_that_comes_along_fits() -> None:
    found = checked(RIGHT)
    assert all(each.fits for each in found)
    assert verdict(found) == "Recording and figures fit."


def test_two_rates_in_one_file(tmp_path: object) -> None:
    rows = np.ones(301, dtype=bool)
    rows[151:250:2] = False
    ins = np.where(rows[:, None], RIGHT.ins, np.nan)
    found = checked(replace(RIGHT, ins=ins))
    assert [each.name for each in found if each.fits is False] == ["rate"]


def test_what_does_not_move_cannot_be_told() -> None:
    rng = np.random.default_rng(5)
    ins = np.zeros((400, 4))
    wsn = np.array([0.2, 0.2, 0.1, 0.1]) * rng.standard_normal((400, 4))
    wrong = TrackPair(0.2 * np.arange(400), 0.2, ins, wsn, None, 0.0)
    told = replace(MODEL, B=np.zeros((4, 4)))
    found = checked(wrong, told)
    assert {each.name for each in found if each.fits is None} == {"time", "frame"}
    assert verdict(found).endswith(
        "cannot tell time (network and reference), frame (network and reference)."
    )


def test_a_model_that_is_none_of_an_ins_is_refused() -> None:
    walk = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    with pytest.raises(ParameterError, match=r"model must be of 4 states .*, not of 1 and 1"):
        check_recording(RIGHT, walk, initial_covariance=[[1.0]])
