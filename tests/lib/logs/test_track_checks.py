"""What is found in a recording: nothing in the example, and each mistake put into it."""

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


def moved(track: np.ndarray, seconds: float) -> np.ndarray:
    """Return a track as it is told so much later, carried on at its ends."""
    time = 0.2 * np.arange(len(track))
    known = ~np.isnan(track[:, 0])
    late = np.column_stack([np.interp(time - seconds, time[known], x[known]) for x in track.T])
    early = np.maximum(seconds - time, 0)[:, None]
    late[:, :2] -= early * track[0, 2:]
    after = np.maximum(time - seconds - time[-1], 0)[:, None]
    late[:, :2] += after * track[-1, 2:]
    return np.round(late, 4)


def turned(track: np.ndarray, degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.asarray(track @ np.kron(np.eye(2), [[c, -s], [s, c]]).T)


EXCHANGED, ASIDE = [1, 0, 3, 2], np.array([3.0, 0, 0, 0])
TRUE = RIGHT.reference if RIGHT.reference is not None else RIGHT.ins
NOISE = np.round(RIGHT.wsn - TRUE, 4)
OTHER = [0.2, 0.2, 0.1, 0.1] * np.random.default_rng(8).standard_normal(TRUE.shape)


def test_the_recording_that_comes_along_fits() -> None:
    found = checked(RIGHT)
    assert all(each.fits for each in found)
    assert verdict(found) == "Recording and figures fit."


@pytest.mark.parametrize(
    ("change", "name", "subject", "value", "about"),
    [
        ({"wsn": moved(TRUE, 0.3) + NOISE}, "time", "network and reference", 0.3, 0.07),
        ({"reference": moved(TRUE, 2.0)}, "time", "network and reference", -2.0, 0.1),
        ({"reference": moved(TRUE, -0.5)}, "time", "network and reference", 0.5, 0.1),
        ({"reference": turned(TRUE, 30)}, "frame", "network and reference", -30, 0.5),
        ({"reference": TRUE[:, EXCHANGED]}, "axes", "network and reference", 90, 0.5),
        ({"reference": moved(TRUE, -1.0)[:, EXCHANGED]}, "axes and time", "network and reference",
         90, 0.5),
        ({"reference": TRUE * 1.0936}, "scale", "network and reference", 1 / 1.0936, 0.01),
        ({"reference": TRUE + ASIDE}, "origin", "network and reference", None, 0),
        ({"reference": RIGHT.wsn}, "copy", "network and reference", 0, 1e-12),
        ({"reference": TRUE + 0.7 * NOISE}, "copy", "network and reference", 0.09, 0.02),
        ({"reference": TRUE + OTHER}, "noise", "network and reference", 2, 0.3),
        ({"wsn": RIGHT.wsn[np.arange(301) // 5 * 5]}, "repeats", "network", None, 0),
        ({"wsn": np.nan_to_num(RIGHT.wsn)}, "repeats", "network", None, 0),
        ({"ins": RIGHT.ins[:, [0, 1, 3, 2]]}, "itself", "INS", None, 0),
        ({"wsn": TRUE + 2 * NOISE}, "size", "network and reference", 4, 0.6),
    ],
)  # fmt: skip
def test_a_mistake_is_found_and_named(
    change: dict[str, np.ndarray], name: str, subject: str, value: float | None, about: float
) -> None:
    found = checked(replace(RIGHT, **change))
    first = next(each for each in found if each.fits is False)
    if name == "size":  # the innovations tell it, too
        first = next(each for each in found if (each.name, each.subject) == (name, subject))
    assert (first.name, first.subject) == (name, subject)
    if value is not None:
        assert first.value == pytest.approx(value, abs=about)
    assert first.says in verdict(found) or name == "size"


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
