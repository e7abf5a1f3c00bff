"""Chapters 71 and 72: their results against closed forms, from the data of their pages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inswsn_book.project import Project
from inswsn_book.results import Results, read_results
from scipy.linalg import solve_discrete_are

RUNS = ("1x", "1y", "2x", "2y")
PARTS = ("position", "velocity")


@pytest.fixture(scope="module")
def results(built_site: Path, project: Project) -> dict[str, Results]:
    return {number: read_results(project.results / f"{number}.json") for number in ("71", "72")}


def test_what_a_reader_moves_begins_at_one_of_its_places(labs: dict[str, Any]) -> None:
    for lab in labs.values():
        for slider in lab["sliders"]:
            steps = (slider["high"] - slider["low"]) / slider["step"]
            from_low = (slider["start"] - slider["low"]) / slider["step"]
            assert steps >= 1
            assert (steps, from_low) == pytest.approx((round(steps), round(from_low)))
            assert 0 <= from_low <= steps
        for choice in lab["choices"]:
            assert choice["start"] in dict(choice["options"])
            assert len(choice["options"]) >= 2


@pytest.mark.parametrize("name", RUNS)
def test_a_gain_of_one_leaves_the_error_of_the_network(
    results: dict[str, Results], labs: dict[str, Any], name: str
) -> None:
    network = np.abs(labs["gain"]["data"]["runs"][name]["network"]).mean(axis=0)
    for part, value in zip(PARTS, network, strict=True):
        assert results["71"][f"lab.{name}.gain.100.{part}"].value == pytest.approx(value, rel=1e-9)
        assert results["71"][f"lab.{name}.network.{part}"].value == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("name", RUNS)
def test_a_gain_of_zero_carries_the_first_measurement_on(
    results: dict[str, Results], labs: dict[str, Any], name: str
) -> None:
    run = labs["gain"]["data"]["runs"][name]
    A, ins = np.array([[1, run["period"]], [0, 1]]), np.array(run["ins"])
    state = ins[0] - run["network"][0]
    left = [e - np.linalg.matrix_power(A, k) @ state for k, e in enumerate(ins)]
    for part, value in zip(PARTS, np.abs(left).mean(axis=0), strict=True):
        assert results["71"][f"lab.{name}.gain.0.{part}"].value == pytest.approx(value, rel=1e-9)


@pytest.mark.parametrize("name", RUNS)
def test_told_much_drift_kf_is_the_filter_of_its_steady_gain(
    results: dict[str, Results], labs: dict[str, Any], name: str
) -> None:
    """By the Riccati equation; nearly the network, the filter is steady after a step or two."""
    run = labs["gain"]["data"]["runs"][name]
    A, ins = np.array([[1, run["period"]], [0, 1]]), np.array(run["ins"])
    Q = 1e4 * np.diag(np.square(run["noise"]["process"]))
    R = np.diag(np.square(run["noise"]["measurement"]))
    P = solve_discrete_are(A.T, np.eye(2), Q, R)
    K = P @ np.linalg.inv(P + R)
    y = ins - np.array(run["network"])
    states = [y[0]]
    for measured in y[1:]:
        ahead = A @ states[-1]
        states.append(ahead + K @ (measured - ahead))
    for part, value in zip(PARTS, np.abs(ins - states).mean(axis=0), strict=True):
        assert results["71"][f"lab.{name}.kf.high.{part}"].value == pytest.approx(value, rel=1e-3)


def test_no_filter_has_a_gamma_below_a_constant_error_of_the_network(
    results: dict[str, Results], labs: dict[str, Any]
) -> None:
    """A constant error of the measured position looks like a state: its gain is one."""
    assert results["71"]["lab.floor"].value >= 1
    for name in RUNS:
        run = labs["gain"]["data"]["runs"][name]
        A = np.array([[1, run["period"]], [0, 1]])
        for B_f in run["designs"]:
            # e = A e - B_f (e + n): at rest, with n = (1, 0)
            at_rest = np.linalg.solve(np.eye(2) - A + np.array(B_f), -np.array(B_f) @ [1.0, 0.0])
            assert at_rest == pytest.approx([-1.0, 0.0], abs=1e-6)


def test_both_ends_of_the_width_leave_the_mean_of_the_targets(
    results: dict[str, Results], labs: dict[str, Any]
) -> None:
    half = labs["kernel"]["data"]["areas"]["1"]
    targets, ins = np.array(half["targets"]), np.array(half["ins"])
    left = np.abs(ins[len(targets) :] - targets.mean(axis=0)).mean(axis=0)
    for part, value in zip(PARTS, left[[0, 2]], strict=True):
        for end in ("narrow", "wide"):
            found = results["72"][f"lab.{end}.ls-svm.{part}"].value
            assert found == pytest.approx(value, rel=2e-3)
    assert results["72"]["lab.mean.wide"].value < 5


def test_the_ins_alone_leaves_its_own_error(
    results: dict[str, Results], labs: dict[str, Any]
) -> None:
    half = labs["kernel"]["data"]["areas"]["1"]
    ins = np.array(half["ins"])[len(half["targets"]) :]
    for short, steps in (("start", 50), ("wide", 50), ("short", 1)):
        for part, value in zip(PARTS, np.abs(ins[:steps, [0, 2]]).mean(axis=0), strict=True):
            found = results["72"][f"lab.{short}.ins.{part}"].value
            assert found == pytest.approx(value, rel=1e-9)
