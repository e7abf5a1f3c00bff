"""The running example of the lessons: the drive and its first area are the same vehicle."""

from __future__ import annotations

import numpy as np

from inswsn_lib.navigation import TrainingAreas, example_drive, example_run
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
