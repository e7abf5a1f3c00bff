"""What the simulation of P1's areas was given, held against what came out of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import mean_absolute_error, monte_carlo
from inswsn_lib.filters import run_kalman
from inswsn_lib.navigation.filter_contest import root_mean_square
from inswsn_lib.navigation.training_areas import AREAS, ByArea, TrainingAreas
from inswsn_lib.papers import AXES
from inswsn_lib.scenario import Setting, from_settings, with_values
from inswsn_lib.simulation import Scene, nodes_heard, position_covariance

#: An axis of a window, such as ``("area1", "rx")``
Cell = tuple[str, str]


class Refit(NamedTuple):
    """The INS-only cells that a fit gives: as they are, over the printed ones, and what is left."""

    cells: dict[Cell, float]
    over_printed: dict[Cell, float]
    residual: float


def places(scene: Scene) -> dict[str, Array]:
    """Return positions by window, and at 800 times of the whole ``path``, m."""
    whole = np.linspace(0, scene.path.length / scene.speed, 800)
    times = {name: window.times for name, window in scene.windows.items()} | {"path": whole}
    return {name: scene.path.drive(scene.speed, each).position for name, each in times.items()}


def scene_numbers(scene: Scene) -> dict[str, float]:
    """Return the numbers of the scene that P1 prints, and those of its timeline, by quantity."""
    inside, (side1, side2), reach = places(scene), scene.area_sizes, scene.ranging.reach
    path, nodes = inside["path"], scene.nodes["area1"]
    return {
        "scene.outside": np.maximum(np.maximum(-path, path - scene.size), 0).max(),
        "scene.start-distance": np.hypot(*path[0] - [650, 0]),
        "scene.end-distance": np.round(np.hypot(*path[-1] - [130, 400]), 6),
        "scene.area1-side": side1,
        "scene.area2-side": side2,
        "scene.jitter1": -scene.jitter[0],
        "scene.jitter2": scene.jitter[1],
        "scene.spacing": scene.spacing,
        "scene.reach": reach,
        "scene.training-samples": scene.training_samples,
        "scene.velocity-noise": scene.velocity_noise,
        "timeline.text.way2": side1,
        "timeline.matrices.way2": side1 * scene.periods[1] / scene.periods[0],
        "timeline.diagonal2": side2 * 2**0.5,
        "timeline.heard1": sum(len(nodes_heard(nodes, p, reach)) >= 3 for p in inside["outage1"]),
    }


def fix_variances(scene: Scene) -> tuple[Array, Array]:
    """Return the nodes heard at each sample of both areas, and the variance of each fix, m^2.

    The variance is that of both components; NaN where fewer than three nodes are heard.
    """
    inside, heard, variance = places(scene), [], []
    for area in (f"area{a}" for a in AREAS):
        for place in inside[area]:
            near = nodes_heard(scene.nodes[area], place, scene.ranging.reach)
            known = len(near) >= 3
            covariance = position_covariance(near, place, scene.ranging.noise) if known else np.nan
            heard.append(len(near))
            variance.append(np.trace(np.atleast_2d(covariance)))
    return np.array(heard), np.array(variance)


def refit(
    settings: Mapping[str, Setting],
    fitted: Mapping[str, Setting],
    printed: Mapping[Cell, float],
    without: Collection[Cell] = (),
) -> Refit:
    """Return the INS-only cells of P1 with these fitted errors and no sensor noise.

    The residual is the root mean square of the logarithms, without some cells.
    """
    silent: dict[str, Any] = {"accelerometer_noise": 0.0, "gyro_noise": 0.0, "jitter": [0.0, 0.0]}
    scene = from_settings(Scene, with_values({**settings, **fitted}, **silent))
    errors = scene.simulate(np.random.default_rng(0), 1)
    cells = {
        (window, axis): float(value)
        for window in scene.windows
        for axis, value in zip(
            AXES, mean_absolute_error(errors[f"ins.{window}"])[:, 0], strict=True
        )
    }
    ratios = {cell: cells[cell] / printed[cell] for cell in printed}
    left = root_mean_square(np.array([np.log(r) for c, r in ratios.items() if c not in without]))
    return Refit(cells, ratios, left)


def ins_numbers(scene: Scene, without: Refit, every: Refit) -> dict[str, float]:
    """Return what the fits without the suspect cells and to all of them gave, by quantity."""
    errors = scene.inertial
    heading = errors.heading + errors.gyro_bias * scene.windows["area2"].end
    return {
        "calibration.without.residual": without.residual,
        "calibration.with.residual": every.residual,
        "calibration.vy2": without.cells["area2", "vy"],
        "calibration.vx2": without.cells["area2", "vx"],
        "calibration.ry1-ratio": without.over_printed["area1", "ry"],
        "calibration.vy1-ratio": without.over_printed["area1", "vy"],
        "ins.gyro-bias": np.degrees(abs(errors.gyro_bias)),
        "ins.accelerometer-bias": 1000 * np.mean(np.abs(errors.accelerometer_bias)) / 9.81,
        "ins.heading": abs(np.degrees(heading)),
        "gyros.one-axis": gyroscopes_needed(1),
        "gyros.two-axis": gyroscopes_needed(2),
    }


def gyroscopes_needed(axes: int) -> int:
    """Return how many gyroscopes at right angles, with this many axes each, span a rotation."""
    unit = np.eye(3)
    # the k-th gyroscope spins about axis k and senses those that follow it
    sensed = {
        count: [unit[(k + j) % 3] for k in range(count) for j in range(1, axes + 1)]
        for count in (1, 2, 3)
    }
    return next(count for count, of in sensed.items() if np.linalg.matrix_rank(of) == 3)


def step_residual(areas: TrainingAreas) -> float:
    """Return the residual of P1's (2.1) over the step in position, the worse area."""
    shares = []
    for a, model in areas.models.items():
        ins = areas.drawn["ins"][a]
        left = (ins[1:] - model.A @ ins[:-1])[:, :2]
        shares.append(root_mean_square(left) / root_mean_square(model.period * ins[:-1, 2:]))
    return max(shares)


def velocity_factors(areas: TrainingAreas) -> ByArea:
    """Return the change of a position error over its velocity error, (steps, runs), s.

    The sensors are without noise. Steps in which a velocity error is near zero are left out.
    """
    quiet = with_values(areas.settings, accelerometer_noise=0.0, gyro_noise=0.0)
    simulate = from_settings(Scene, quiet).simulate
    drawn = monte_carlo(simulate, areas.other_runs, areas.seed + 2)
    found = {}
    for a in AREAS:
        error = drawn[f"ins.area{a}"]
        change, velocity = error[1:, 0] - error[:-1, 0], (error[1:, 2] + error[:-1, 2]) / 2
        fast = (np.abs(velocity) > 0.3 * np.abs(velocity).mean()).all(axis=1)
        found[a] = change[fast] / velocity[fast]
    return found


def model_numbers(areas: TrainingAreas, factors: ByArea) -> dict[str, tuple[float, int]]:
    """Return how far what is simulated is from the model, and of how many runs, by quantity.

    Parameters
    ----------
    areas : TrainingAreas
    factors : dict
        From `velocity_factors`.
    """
    drawn, noise, jitter = areas.drawn, areas.noise, areas.scene.jitter
    sizes = dict(zip(AREAS, jitter, strict=True))
    off, shift, measured, deviations = [], [], [], []
    for a in AREAS:
        ins, network, C = drawn["ins"][a], drawn["wsn"][a], areas.models[a].C
        off.append(abs(factors[a].std(axis=1).mean() / sizes[a] - 1))
        shift.append(1000 * np.abs(ins[:, 2:]).mean(axis=(0, 2)).max() * sizes[a])
        measured.append(np.nanmax(np.abs(C @ ins - network - (ins - network))))
        ours = np.nanmean(network**2, axis=(0, 2)) / np.diag(noise[a].measurement)
        deviations.append(np.abs(ours - 1).max())
    compact, stacked = step_differences(areas)
    return {
        "model.step-residual": (step_residual(areas), areas.runs),
        # E beta = 0: the mean factor of (2.2) is (T + delta t) E beta = 0, and that of (2.3) is T
        "model.mean-difference": (1.0, 1),
        "model.jitter-deviation": (max(off), areas.other_runs),
        "model.compact-difference": (compact, 1),
        "model.stacked-difference": (stacked, 1),
        "model.measurement-difference": (max(measured), 1),
        "model.noise-deviation": (max(deviations), areas.runs),
        "model.kalman-difference": (kalman_difference(areas), 1),
        "jitter.shift": (max(shift), areas.runs),
    }


def kalman_difference(areas: TrainingAreas) -> float:
    """Return how far the Kalman filter is from the best linear estimate, over the largest state.

    That is Cov(x, Y) Cov(Y)^-1 Y of the last of twelve states from all measurements Y at once, in
    P1's model with the noise that matches; of two areas the larger difference.
    """
    rng, steps, off = np.random.default_rng(areas.seed), 12, 0.0
    for model in areas.assuming(1.0).values():
        of_states = np.zeros((steps, 4, steps, 4))
        P = np.eye(4)
        for k in range(steps):
            later = P  # Cov(x_j, x_k) = A^(j - k) Cov(x_k)
            for j in range(k, steps):
                of_states[j, :, k], of_states[k, :, j] = later, later.T
                later = model.A @ later
            P = model.A @ P @ model.A.T + model.process_covariance
        measuring = np.kron(np.eye(steps), model.C)
        with_all = of_states.reshape(4 * steps, -1) @ measuring.T
        own = np.kron(np.eye(steps), model.measurement_covariance)
        y = rng.multivariate_normal(np.zeros(4 * steps), measuring @ with_all + own)
        best = with_all[-4:] @ np.linalg.solve(measuring @ with_all + own, y)
        found = run_kalman(model, y.reshape(steps, 4), initial_covariance=np.eye(4))[-1]
        off = max(off, np.abs(found - best).max() / np.abs(best).max())
    return off


def step_differences(areas: TrainingAreas) -> tuple[float, float]:
    """Return how far P1's model in matrices is from that in components, and with one input.

    The largest difference over random states and noise of a step written by components, and of the
    step with process and measurement noise stacked, from that by matrices.
    """
    rng = np.random.default_rng(areas.seed)
    compact, stacked = 0.0, 0.0
    for model in areas.models.values():
        x, w, v, b = (rng.standard_normal(size) for size in ((4, 50), (4, 50), (4, 50), 50))
        factor = model.period + model.E[0, 2] * b
        parts = x + np.vstack([factor * x[2:], np.zeros((2, 50))]) + w
        step = model.A @ x + model.E @ x * b
        separate = step + model.B @ w
        compact = max(compact, np.abs(parts - separate).max())
        both, zero = np.vstack([w, v]), 0 * model.B
        state = step + np.hstack([model.B, zero]) @ both - separate
        measured = np.hstack([zero, model.D]) @ both - model.D @ v
        stacked = max(stacked, np.abs(state).max(), np.abs(measured).max())
    return compact, stacked
