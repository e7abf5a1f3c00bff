from .calibration import Calibration as Calibration
from .calibration_fit import calibrate as calibrate
from .columns import INS as INS, REFERENCE as REFERENCE, TIME as TIME, WSN as WSN
from .csv_writing import write_csv as write_csv
from .files import RecordingUnavailableError as RecordingUnavailableError
from .fix_velocities import slope_velocity as slope_velocity
from .gnss_imu import RecordedDrive as RecordedDrive, Track as Track, load_drive as load_drive
from .imu_clock import ImuClock as ImuClock, imu_clock as imu_clock
from .ins_wsn import TrackPair as TrackPair, read_recording as read_recording
from .range_fixes import multilaterate_track as multilaterate_track
from .recording import (
    Fixes as Fixes,
    Imu as Imu,
    Odometry as Odometry,
    Ranges as Ranges,
    Recording as Recording,
    Reference as Reference,
)
from .registry import load as load, names as names
