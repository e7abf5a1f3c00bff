from .drive import Drive as Drive, Place as Place, Reference as Reference
from .error_model import (
    STATES as STATES,
    compass_row as compass_row,
    discretise as discretise,
    error_dynamics as error_dynamics,
    gps_rows as gps_rows,
    lateral_row as lateral_row,
    metres as metres,
    sequential_update as sequential_update,
    yaw as yaw,
)
from .errors import (
    horizontal_error as horizontal_error,
    navigation_error as navigation_error,
    position_error as position_error,
)
from .filter import (
    VehicleRun as VehicleRun,
    align as align,
    replay as replay,
    run_vehicle_filter as run_vehicle_filter,
    smooth_vehicle_run as smooth_vehicle_run,
)
from .recorded import (
    RecordedDrive as RecordedDrive,
    Track as Track,
    calibrate_inertial_noise as calibrate_inertial_noise,
    emulate_sensors as emulate_sensors,
    estimate_mounting as estimate_mounting,
)
from .route import Kinematics as Kinematics, Piece as Piece, Route as Route
from .settings import FilterSettings as FilterSettings
from .simulated import (
    Truth as Truth,
    simulate_drive as simulate_drive,
    simulate_sensors as simulate_sensors,
    true_motion as true_motion,
)
from .state import VehicleState as VehicleState
