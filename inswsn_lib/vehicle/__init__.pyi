from .calibration import calibrate_inertial_noise as calibrate_inertial_noise
from .differences import (
    numeric_dynamics as numeric_dynamics,
    numeric_rows as numeric_rows,
    row_difference as row_difference,
)
from .drive import Drive as Drive, Place as Place, Reference as Reference
from .error_model import (
    STATES as STATES,
    compass_row as compass_row,
    discretise as discretise,
    error_dynamics as error_dynamics,
    gps_rows as gps_rows,
    lateral_row as lateral_row,
    metres as metres,
    noise_input as noise_input,
    yaw as yaw,
)
from .filter import (
    FilterSettings as FilterSettings,
    VehicleRun as VehicleRun,
    align as align,
    horizontal_error as horizontal_error,
    navigation_error as navigation_error,
    position_error as position_error,
    replay as replay,
    run_vehicle_filter as run_vehicle_filter,
    sequential_update as sequential_update,
)
from .mounting import Mounting as Mounting, estimate_mounting as estimate_mounting
from .pyins_filter import PeerRun as PeerRun, run_pyins_filter as run_pyins_filter
from .recorded import (
    DriveUnavailableError as DriveUnavailableError,
    RecordedDrive as RecordedDrive,
    Track as Track,
    emulate_sensors as emulate_sensors,
    load_drive as load_drive,
)
from .simulated import (
    Truth as Truth,
    simulate_drive as simulate_drive,
    simulate_sensors as simulate_sensors,
    true_motion as true_motion,
)
from .strapdown import (
    Flight as Flight,
    VehicleState as VehicleState,
    integrate_strapdown as integrate_strapdown,
)
