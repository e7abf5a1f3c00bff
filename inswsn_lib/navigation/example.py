"""The running example of the lessons: one vehicle in the first training area of P1's scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array
from inswsn_lib.navigation.training_areas import TrainingAreas, noise_sizes, p1_settings


@dataclass(frozen=True, eq=False)
class ExampleRun:
    """What an INS and a network of nodes say of one vehicle, and where it was.

    Rows are samples. Columns are position x, y (m) and velocity x, y (m/s).

    Attributes
    ----------
    period : float
        Seconds from one sample to the next, but for a jitter of a millisecond.
    truth, ins, network : ndarray, (samples, 4)
        The true motion, that by the INS, and that by the network.
    process, measurement : ndarray, (2,)
        Standard deviations of what drifts in a step and of what the network errs, in position (m)
        and velocity (m/s), fitted to other runs: what a filter assumes.

    Examples
    --------
    >>> from inswsn_lib.navigation import example_run
    >>> run = example_run()
    >>> (run.ins - run.network).shape, float(run.time[-1].round(1))
    ((100, 4), 19.8)
    """

    period: float
    truth: Array
    ins: Array
    network: Array
    process: Array
    measurement: Array

    @property
    def time(self) -> Array:
        """Seconds since the first sample, (samples,)."""
        return np.asarray(self.period * np.arange(len(self.truth)))

    def distance(self, motion: ArrayLike) -> float:
        """Return how far positions are from the true ones on average, m.

        Parameters
        ----------
        motion : array_like, (samples, 4)
            Such as `ins` less an estimate of its error.
        """
        off = np.asarray(motion) - self.truth
        return float(np.hypot(off[:, 0], off[:, 1]).mean())


def example_run(seed: int = 2012, correlation_time: float = 0.0) -> ExampleRun:
    """Simulate the running example of the lessons: one vehicle in P1's first area.

    It is one run of `TrainingAreas`, whose settings say where each number comes from.

    Parameters
    ----------
    seed : int
        Seed of all random numbers.
    correlation_time : float
        Of the errors of the network, s; at 0 they are white.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import example_run
    >>> run = example_run()
    >>> run.truth.shape, run.period
    ((100, 4), 0.2)
    >>> bool(np.abs(run.network - run.truth).mean() < 0.2 < np.abs(run.ins - run.truth).mean())
    True
    """
    areas = TrainingAreas(
        p1_settings(), seed=seed, correlation_time=correlation_time, runs=1, other_runs=64
    )
    scene, drawn, noise = areas.scene, areas.drawn, areas.noise["1"]
    motion = scene.path.drive(scene.speed, scene.windows["area1"].times)
    truth = np.hstack([motion.position, motion.velocity])
    return ExampleRun(
        period=scene.periods[0],
        truth=truth,
        ins=truth + drawn["ins"]["1"][:, :, 0],
        network=truth + drawn["wsn"]["1"][:, :, 0],
        process=np.array(noise_sizes(noise.process)),
        measurement=np.array(noise_sizes(noise.measurement)),
    )
