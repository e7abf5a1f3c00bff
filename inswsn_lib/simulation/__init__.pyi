from .clusters import ClusterScene as ClusterScene
from .disturbances import (
    coloured as coloured,
    drifting as drifting,
    heavy_tailed as heavy_tailed,
    losing as losing,
)
from .drive import Drive as Drive, DriveReference as DriveReference, Place as Place
from .ins import InertialErrors as InertialErrors, simulate_ins as simulate_ins
from .multilateration import (
    multilaterate as multilaterate,
    position_covariance as position_covariance,
)
from .network import (
    Ranging as Ranging,
    nodes_heard as nodes_heard,
    velocity_slopes as velocity_slopes,
)
from .route import Kinematics as Kinematics, Piece as Piece, Route as Route
from .scene import Scene as Scene, Window as Window
from .trajectory import Motion as Motion, Path as Path
from .vehicle_sensors import (
    Truth as Truth,
    simulate_drive as simulate_drive,
    simulate_sensors as simulate_sensors,
    true_motion as true_motion,
)
