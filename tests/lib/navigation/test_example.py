"""The running example of the lessons: the drive and its first area are the same vehicle."""

from __future__ import annotations

import numpy as np

from inswsn_lib.navigation import TrainingAreas, example_clusters, example_drive, example_run
from inswsn_lib.navigation.training_areas import p1_settings


def test_the_run_is_the_first_area_of_the_drive() -> None:
    drive, run = example_drive(3), example_run(3)
    window = TrainingAreas(p1_settings(), seed=3, runs=1).scene.windows["area1"]
    assert np.array_equal(drive.fixes[:100], run.network[:, :2])
    assert np.array_equal(drive.fix_times[:100], window.times)
    # the INS is sampled with a jitter of a millisecond in each interval, at less than 2 m/s
    for axis in (0, 1):
        error = np.interp(window.times, drive.time, (drive.ins - drive.position)[:, axis])
        assert np.abs(error - (run.ins - run.truth)[:, axis]).max() < 0.1


def test_distances_are_those_of_pythagoras() -> None:
    drive, run = example_drive(), example_run()
    assert np.allclose(drive.distances(np.add(drive.position, [3.0, 4.0])), 5.0)
    assert np.allclose(run.distances(np.add(run.truth, [3.0, 4.0, 100.0, 100.0])), 5.0)


def test_errors_that_last_hang_together_from_one_fix_to_the_next() -> None:
    def correlation(run: object) -> float:
        error = (run.network - run.truth)[:, 0]  # type: ignore[attr-defined]
        return float(np.corrcoef(error[1:], error[:-1])[0, 1])

    lasting = [correlation(example_run(seed, correlation_time=2.0)) for seed in range(4)]
    white = [correlation(example_run(seed)) for seed in range(4)]
    assert min(lasting) > 0.5  # exp(-0.2 / 2) is 0.9
    assert max(white) < 0.4  # of 99 pairs, 0 +- 0.1


def test_clusters_share_the_ins_of_the_run_and_each_has_fixes_of_its_own() -> None:
    alone, (run, fixes) = example_run(3), example_clusters(3, 4, shuffled=False)
    assert np.allclose(run.ins, alone.ins, rtol=0, atol=1e-9)
    assert np.allclose(fixes[0], alone.network, rtol=0, atol=1e-9)
    errors = (fixes - run.truth)[:, :, 0]
    off = np.corrcoef(errors)[np.triu_indices(4, 1)]
    assert np.abs(off).max() < 0.4  # of 100 pairs, 0 +- 0.1
    assert np.allclose(errors.std(axis=1), alone.measurement[0], rtol=0.3)


def test_shuffled_the_steps_are_the_same_ones_in_another_order() -> None:
    A = np.kron([[1, 0.2], [0, 1]], np.eye(2))

    def steps(shuffled: bool) -> np.ndarray:
        run, _ = example_clusters(3, 1, shuffled=shuffled)
        errors = run.ins - run.truth
        return errors[1:] - errors[:-1] @ A.T

    mixed, own = steps(True), steps(False)
    order = [np.lexsort(each.round(9).T) for each in (mixed, own)]
    assert not np.allclose(mixed, own)
    assert np.allclose(mixed[order[0]], own[order[1]], rtol=0, atol=1e-9)
