"""What the simulation of P1's areas was given, held against what came out of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import mean_absolute_error, monte_carlo
from inswsn_lib.navigation.filter_contest import root_mean_square
from inswsn_lib.navigation.training_areas import AREAS, ByArea, TrainingAreas
from inswsn_lib.papers import AXES
from inswsn_lib.scenario import Setting, from_settings, with_values
from inswsn_lib.simulation import Scene, nodes_heard, position_covariance

#: An axis of a window, such as ``("area1", "rx")``
Cell = tuple[str, str]


def fix_variances(scene: Scene, area: str, nodes: Array) -> tuple[Array, Array]:
    """Return the nodes heard at each sample of an area, and the variance of each fix, m^2.

    The variance is that of both components; NaN where fewer than three nodes are heard.
    """
    path = scene.path.drive(scene.speed, scene.windows[f"area{area}"].times).position
    heard = [nodes_heard(nodes, p, scene.ranging.reach) for p in path]
    variance = [
        np.trace(position_covariance(near, p, scene.ranging.noise)) if len(near) >= 3 else np.nan
        for near, p in zip(heard, path, strict=True)
    ]
    return np.array([len(near) for near in heard]), np.array(variance)


def every_other(nodes: Array, spacing: float) -> Array:
    """Return the nodes of a grid that is twice as wide."""
    steps = np.round((nodes - nodes.min(axis=0)) / spacing)
    return np.asarray(nodes[(steps % 2 == 0).all(axis=1)])


def ins_cells(settings: Mapping[str, Setting], fitted: Mapping[str, Setting]) -> dict[Cell, float]:
    """Return the sixteen INS-only cells of P1 with these fitted errors and no sensor noise."""
    silent: dict[str, Any] = {"accelerometer_noise": 0.0, "gyro_noise": 0.0, "jitter": [0.0, 0.0]}
    scene = from_settings(Scene, with_values({**settings, **fitted}, **silent))
    errors = scene.simulate(np.random.default_rng(0), 1)
    return {
        (window, axis): float(value)
        for window in scene.windows
        for axis, value in zip(
            AXES, mean_absolute_error(errors[f"ins.{window}"])[:, 0], strict=True
        )
    }


def gyroscopes_needed(axes: int) -> int:
    """Return how many gyroscopes at right angles, with this many axes each, span a rotation."""
    unit = np.eye(3)
    for count in (1, 2):
        # the k-th gyroscope spins about axis k and senses those that follow it
        sensed = [unit[(k + j) % 3] for k in range(count) for j in range(1, axes + 1)]
        if np.linalg.matrix_rank(sensed) == 3:
            return count
    return 3


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
        compact = max(compact, np.abs(parts - step - model.B @ w).max())
        both, zero = np.vstack([w, v]), 0 * model.B
        state = step + np.hstack([model.B, zero]) @ both - parts
        measured = np.hstack([zero, model.D]) @ both - model.D @ v
        stacked = max(stacked, np.abs(state).max(), np.abs(measured).max())
    return compact, stacked
