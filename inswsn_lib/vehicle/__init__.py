"""The vehicle of P3: its error model, its filter, and drives, made and recorded."""

from inswsn_lib.vehicle.calibration import calibrate_inertial_noise
from inswsn_lib.vehicle.differences import numeric_dynamics, numeric_rows, row_difference
from inswsn_lib.vehicle.drive import Drive, Place, Reference
from inswsn_lib.vehicle.error_model import (
    STATES,
    compass_row,
    discretise,
    error_dynamics,
    gps_rows,
    lateral_row,
    metres,
    noise_input,
    yaw,
)
from inswsn_lib.vehicle.filter import (
    FilterSettings,
    VehicleRun,
    align,
    horizontal_error,
    navigation_error,
    position_error,
    replay,
    run_vehicle_filter,
    sequential_update,
)
from inswsn_lib.vehicle.mounting import Mounting, estimate_mounting
from inswsn_lib.vehicle.pyins_filter import PeerRun, run_pyins_filter
from inswsn_lib.vehicle.recorded import (
    DriveUnavailableError,
    RecordedDrive,
    emulate_sensors,
    load_drive,
)
from inswsn_lib.vehicle.simulated import simulate_drive, simulate_sensors, true_motion
from inswsn_lib.vehicle.strapdown import VehicleState, integrate_strapdown

__all__ = [
    "STATES",
    "Drive",
    "DriveUnavailableError",
    "FilterSettings",
    "Mounting",
    "PeerRun",
    "Place",
    "RecordedDrive",
    "Reference",
    "VehicleRun",
    "VehicleState",
    "align",
    "calibrate_inertial_noise",
    "compass_row",
    "discretise",
    "emulate_sensors",
    "error_dynamics",
    "estimate_mounting",
    "gps_rows",
    "horizontal_error",
    "integrate_strapdown",
    "lateral_row",
    "load_drive",
    "metres",
    "navigation_error",
    "noise_input",
    "numeric_dynamics",
    "numeric_rows",
    "position_error",
    "replay",
    "row_difference",
    "run_pyins_filter",
    "run_vehicle_filter",
    "sequential_update",
    "simulate_drive",
    "simulate_sensors",
    "true_motion",
    "yaw",
]
