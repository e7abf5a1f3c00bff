from .clusters import ClusterScene as ClusterScene
from .ins import (
    InertialErrors as InertialErrors,
    simulate_ins as simulate_ins,
    true_increments as true_increments,
)
from .network import (
    Ranging as Ranging,
    measure_ranges as measure_ranges,
    multilaterate as multilaterate,
    multilaterate_each as multilaterate_each,
    node_grid as node_grid,
    nodes_heard as nodes_heard,
    position_covariance as position_covariance,
    velocity_slopes as velocity_slopes,
)
from .scene import Scene as Scene, Window as Window
from .shapes import SHAPES as SHAPES, shaped_drift as shaped_drift
from .stress import drifting as drifting, heavy_tailed as heavy_tailed, losing as losing
from .traffic import (
    OPERATIONS as OPERATIONS,
    Traffic as Traffic,
    count_hops as count_hops,
    count_traffic as count_traffic,
)
from .trajectory import Motion as Motion, Path as Path
