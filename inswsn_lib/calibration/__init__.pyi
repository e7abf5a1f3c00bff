from .fit import calibrate as calibrate
from .fix_velocities import slope_velocity as slope_velocity
from .imu_clock import ImuClock as ImuClock, imu_clock as imu_clock
from .range_fixes import multilaterate_track as multilaterate_track
from .results import Calibration as Calibration
