from .filter import (
    VehicleRun as VehicleRun,
    align as align,
    horizontal_error as horizontal_error,
    navigation_error as navigation_error,
    position_error as position_error,
    replay as replay,
    run_vehicle_filter as run_vehicle_filter,
    smooth_outages as smooth_outages,
)
from .recorded import (
    calibrate_inertial_noise as calibrate_inertial_noise,
    emulate_sensors as emulate_sensors,
    estimate_mounting as estimate_mounting,
)
from .settings import FilterSettings as FilterSettings
from .state import STATES as STATES, VehicleState as VehicleState, yaw as yaw
