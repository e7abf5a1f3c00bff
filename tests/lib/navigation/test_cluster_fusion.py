"""The core of p2-fusion: filters whose answers are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import patterns_of, run_switched
from inswsn_lib.lmi import design_filter
from inswsn_lib.navigation import ClusterFusion, cluster_fusion, planar_rms
from inswsn_lib.scenario import with_values

#: Numbers of each method, in place of a search
CHOSEN = {
    **dict.fromkeys(
        ("fkf-reset", "fkf-no-reset", "fkf-each-fix", "covariance-intersection", "best-cluster"),
        (0.4, 10.0),
    ),
    **dict.fromkeys(("dhf", "hf-centralised", "dhf-one-ins"), (1.0, 1.0, 1.0, 0.5)),
    "kf-with-bias": (0.03, 10.0),
}


def fusion(**values: Any) -> ClusterFusion:
    return ClusterFusion(**{"runs": 4, "other_runs": 4, "speed": 6.0, **values})


@pytest.fixture(scope="module")
def chosen() -> ClusterFusion:
    there = fusion(runs=8)
    vars(there)["chosen"] = CHOSEN
    return there


def test_what_is_assumed_at_the_start_follows_the_scene() -> None:
    a, T = 2.0, fusion().scene.period
    step = [(a * T**2 / 2) ** 2] * 2 + [(a * T) ** 2] * 2  # the INS of P2 starts exact
    np.testing.assert_allclose(np.diag(fusion().initial_covariance(a)), step)
    off = fusion(published=with_values(fusion().published, position=[3.0, 4.0]))
    np.testing.assert_allclose(np.diag(off.initial_covariance(a) - np.diag(step)), [9, 16, 0, 0])


def test_without_noise_the_network_is_a_step_late() -> None:
    there = fusion(range_noise=1e-6, velocity_source="sensor")
    ins = there.drawn["ins"]
    error = ins - there.network_alone(there.measurements)
    # what the INS has moved in the step
    np.testing.assert_allclose(error[1:, :2], np.diff(ins, axis=0)[:, :2], atol=1e-4)
    assert np.isnan(error[0]).all()


def test_filters_that_hear_nothing_leave_the_ins(chosen: ClusterFusion) -> None:
    nothing = np.full_like(chosen.measurements, np.nan)
    for method, run in chosen.filters.items():
        if method == "network-alone":
            assert np.isnan(run(nothing)).all()
        else:
            np.testing.assert_array_equal(run(nothing), 0)


def test_the_central_filter_of_the_mean_is_that_of_all_measurements(chosen: ClusterFusion) -> None:
    numbers = (1.0, 1.0, 1.0, 0.5)
    models, gains = chosen._weighed(*numbers[:3]), {}
    for heard in chosen.sets:
        inside = [m for m, there in zip(models, heard, strict=True) if there]
        C, D = np.vstack([m.C for m in inside]), block_diag(*[m.D for m in inside])
        gains[heard] = design_filter(replace(inside[0], C=C, D=D), margin=numbers[3])
    expected = run_switched(gains, chosen.measurements, predicted=True)
    found = chosen.central_hf(*numbers)(chosen.measurements)
    assert np.nanmax(np.abs(expected)) > 1  # m
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_with_one_cluster_in_reach_every_fusion_is_its_filter(chosen: ClusterFusion) -> None:
    y = chosen.measurements.copy()
    (alone,) = patterns_of(y[:, :1])
    assert sum(alone) == 1
    y[~np.array(alone)] = np.nan
    reset, *others = (
        chosen.filters[name](y) for name in ("fkf-reset", "covariance-intersection", "best-cluster")
    )
    assert np.abs(reset).max() > 1
    for other in others:
        np.testing.assert_allclose(other, reset, atol=1e-9)


def test_weights_for_one_ins_are_those_of_the_same_designs(chosen: ClusterFusion) -> None:
    # with one cluster in reach its weight is one, whatever the noise
    first = chosen.measurements.copy()
    first[1:] = np.nan
    dhf, one_ins = (chosen.filters[name](first) for name in ("dhf", "dhf-one-ins"))
    np.testing.assert_allclose(one_ins, dhf, atol=1e-9)
    both = [chosen.errors[name] for name in ("dhf", "dhf-one-ins")]
    assert np.abs(both[0] - both[1]).max() > 1e-6


def test_federated_and_distributed_filters_are_told_the_same_noise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What reaches the filters themselves: R of every step, and D of every design, by cluster."""
    there, told = fusion(), {}

    def federated(model: Any, y: Any, *, measurement_covariance: Any, **_: Any) -> Any:
        told["R"], told["Q"] = measurement_covariance, model.process_covariance
        return np.zeros_like(y[0])

    monkeypatch.setattr(cluster_fusion, "run_federated", federated)
    there.federated(0.7, 3.0)(there.measurements)
    for design, R in zip(there.local_designs(0.7, 3.0, 1.0, 0.5), told["R"], strict=True):
        np.testing.assert_allclose(R, np.broadcast_to(design.model.measurement_covariance, R.shape))
        np.testing.assert_allclose(design.model.process_covariance, told["Q"])


def test_filters_are_tuned_on_runs_that_are_not_judged() -> None:
    np.testing.assert_array_equal(fusion(seed=7).tuning["wsn"], fusion(seed=8).drawn["wsn"])


def test_scores_are_the_errors_of_the_runs(chosen: ClusterFusion) -> None:
    found = chosen.scores()
    assert (found.runs, found.headline) == (8, "position")
    error = chosen.drawn["ins"] - chosen.filters["kf-with-bias"](chosen.measurements)
    by_hand = [np.sqrt(np.mean(np.hypot(*error[:, 2:, run].T) ** 2)) for run in range(8)]
    np.testing.assert_allclose(found.of("kf-with-bias", "velocity"), by_hand, rtol=1e-12)
    assert found.leader().best in ("kf-with-bias", "fkf-reset")
    assert (found.of("network-alone") > found.of("fkf-reset")).all()


def test_a_step_without_an_estimate_is_left_out() -> None:
    error = np.ones((4, 4, 1))
    error[0] = np.nan
    assert planar_rms(error) == pytest.approx(np.sqrt([[2.0], [2.0]]))


@pytest.mark.parametrize("values", [{"speed": -1.0}, {"velocity_source": "guess"}])
def test_what_may_not_be_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(ParameterError):
        ClusterFusion(**values).scores()
