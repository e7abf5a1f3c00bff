"""Simulation: a path, a two-dimensional INS, sensor networks with geometry; P1's and P2's scene."""

from inswsn_lib.scenario import Setting, load_scenario, with_values
from inswsn_lib.simulation.clusters import ClusterScene
from inswsn_lib.simulation.ins import InertialErrors, simulate_ins, true_increments
from inswsn_lib.simulation.network import (
    Ranging,
    measure_ranges,
    multilaterate,
    multilaterate_each,
    node_grid,
    nodes_heard,
    position_covariance,
    velocity_slopes,
)
from inswsn_lib.simulation.scene import Scene, Window
from inswsn_lib.simulation.shapes import SHAPES, shaped_drift
from inswsn_lib.simulation.stress import drifting, heavy_tailed, losing
from inswsn_lib.simulation.traffic import OPERATIONS, Traffic, count_hops, count_traffic
from inswsn_lib.simulation.trajectory import Motion, Path

__all__ = [
    "OPERATIONS",
    "SHAPES",
    "ClusterScene",
    "InertialErrors",
    "Motion",
    "Path",
    "Ranging",
    "Scene",
    "Setting",
    "Traffic",
    "Window",
    "count_hops",
    "count_traffic",
    "drifting",
    "heavy_tailed",
    "load_scenario",
    "losing",
    "measure_ranges",
    "multilaterate",
    "multilaterate_each",
    "node_grid",
    "nodes_heard",
    "position_covariance",
    "shaped_drift",
    "simulate_ins",
    "true_increments",
    "velocity_slopes",
    "with_values",
]
