from .fit import calibrate as calibrate
from .imu_clock import ImuClock as ImuClock, imu_clock as imu_clock
from .results import Calibration as Calibration
