"""The running example of the lessons: one vehicle in the first training area of P1's scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import monte_carlo
from inswsn_lib.navigation.training_areas import TrainingAreas, noise_sizes, p1_settings
from inswsn_lib.simulation.ins import inertial_errors


@dataclass(frozen=True, eq=False)
class ExampleRun:
    """What an INS and a network of nodes measure of one vehicle, and where it was.

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

    def distances(self, motion: ArrayLike) -> Array:
        """Return how far positions are from the true ones at each sample, m.

        Parameters
        ----------
        motion : array_like, (samples, 4)
            Such as `ins` less an estimate of its error.
        """
        return _lengths((np.asarray(motion) - self.truth)[:, :2])


@dataclass(frozen=True, eq=False)
class ExampleDrive:
    """The whole way of that vehicle, ten samples a second, its INS, and its fixes.

    Attributes
    ----------
    period : float
        Seconds from one sample to the next.
    position, velocity : ndarray, (samples, 2)
        The true motion, m and m/s, in x and y.
    heading : ndarray, (samples,)
        Of the vehicle, radians from x towards y.
    ins : ndarray, (samples, 2)
        The position by the INS, m.
    fix_times, fixes : ndarray, (n,) and (n, 2)
        When the network gives a fix, s since the start, and the fix, m.
    fix_errors : ndarray, (n, 2)
        What the fixes are off by, m.
    nodes : ndarray, (m, 2)
        The nodes of the network in the first area, m.

    Examples
    --------
    >>> from inswsn_lib.navigation import example_drive
    >>> drive = example_drive()
    >>> drive.position[0].tolist(), len(drive.nodes)
    ([650.0, 0.0], 961)
    """

    period: float
    position: Array
    velocity: Array
    heading: Array
    ins: Array
    fix_times: Array
    fixes: Array
    fix_errors: Array
    nodes: Array

    @property
    def time(self) -> Array:
        """Seconds since the start, (samples,)."""
        return np.asarray(self.period * np.arange(len(self.position)))

    def distances(self, positions: ArrayLike) -> Array:
        """Return how far positions (samples, 2), such as `ins`, are from the true ones, m."""
        return _lengths(np.asarray(positions) - self.position)


def example_drive(seed: int = 2012) -> ExampleDrive:
    """Simulate the whole way through P1's scene, of which `example_run` is the first area.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import example_drive
    >>> drive = example_drive()
    >>> bool(np.hypot(*(drive.ins - drive.position).T)[-1] > 10)
    True
    """
    areas = _areas(seed)
    scene, motion, every = areas.scene, areas.scene.motion, 10

    def whole_way(rng: np.random.Generator, runs: int) -> dict[str, Array]:
        (sensors,) = rng.spawn(1)
        return {"ins": inertial_errors(motion, scene.inertial, sensors, runs)}

    errors = monte_carlo(whole_way, 1, seed=seed)["ins"]  # by the same draws as in the areas
    times = [scene.windows[f"area{half}"].times for half in "12"]
    truths = [scene.path.drive(scene.speed, when).position for when in times]
    off = np.vstack([areas.drawn["wsn"][half][:, :2, 0] for half in "12"])
    return ExampleDrive(
        period=every * scene.inertial_interval,
        position=motion.position[::every],
        velocity=motion.velocity[::every],
        heading=motion.heading[::every],
        ins=(motion.position + errors[:, :2, 0])[::every],
        fix_times=np.concatenate(times),
        fixes=np.vstack(truths) + off,
        fix_errors=off,
        nodes=scene.nodes["area1"],
    )


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
    return _first_run(_areas(seed, correlation_time))


def example_clusters(
    seed: int = 2012, clusters: int = 3, *, shuffled: bool = True
) -> tuple[ExampleRun, Array]:
    """Simulate the running example with several clusters of nodes, each with fixes of its own.

    Parameters
    ----------
    seed : int
        Seed of all random numbers.
    clusters : int
        Each gives a fix at each sample, as good as those of `example_run`; their errors are
        independent.
    shuffled : bool
        Whether the steps by which the INS drifts come in random order. Then they are white, as
        filters assume; in their own order they come with the turns.

    Returns
    -------
    run : ExampleRun
        That of `example_run`, but for the order; its network is the first cluster.
    fixes : ndarray, (clusters, samples, 4)

    Examples
    --------
    >>> from inswsn_lib.navigation import example_clusters
    >>> run, fixes = example_clusters(clusters=3)
    >>> fixes.shape, bool((fixes[0] == run.network).all())
    ((3, 100, 4), True)
    """
    areas = _areas(seed, runs=clusters)
    run, ins = _first_run(areas), areas.drawn["ins"]["1"][:, :, 0].copy()
    if shuffled:
        A = areas.models["1"].A
        steps = np.random.default_rng(seed).permutation(ins[1:] - ins[:-1] @ A.T)
        for k, step in enumerate(steps):
            ins[k + 1] = A @ ins[k] + step
    fixes = run.truth + np.moveaxis(areas.drawn["wsn"]["1"], 2, 0)
    return replace(run, ins=run.truth + ins, network=fixes[0]), fixes


@lru_cache(8)  # a lesson asks for the same run again and again
def _areas(seed: int, correlation_time: float = 0.0, runs: int = 1) -> TrainingAreas:
    return TrainingAreas(
        p1_settings(), seed=seed, correlation_time=correlation_time, runs=runs, other_runs=64
    )


def _first_run(areas: TrainingAreas) -> ExampleRun:
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


def _lengths(vectors: Array) -> Array:
    return np.asarray(np.hypot(vectors[:, 0], vectors[:, 1]))
