"""Simulation of P1's scene: a path, a two-dimensional INS, and a sensor network with geometry."""

from inswsn_lib.simulation.ins import InertialErrors, simulate_ins, true_increments
from inswsn_lib.simulation.network import (
    Ranging,
    measure_ranges,
    multilaterate,
    node_grid,
    nodes_heard,
    position_covariance,
)
from inswsn_lib.simulation.scenario import (
    Scene,
    Setting,
    Window,
    load_scenario,
    with_values,
)
from inswsn_lib.simulation.shapes import SHAPES, shaped_drift
from inswsn_lib.simulation.stress import drifting, heavy_tailed, losing
from inswsn_lib.simulation.trajectory import Motion, Path

__all__ = [
    "SHAPES",
    "InertialErrors",
    "Motion",
    "Path",
    "Ranging",
    "Scene",
    "Setting",
    "Window",
    "drifting",
    "heavy_tailed",
    "load_scenario",
    "losing",
    "measure_ranges",
    "multilaterate",
    "node_grid",
    "nodes_heard",
    "position_covariance",
    "shaped_drift",
    "simulate_ins",
    "true_increments",
    "with_values",
]
