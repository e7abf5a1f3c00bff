from .calibration import Calibration as Calibration, calibrate as calibrate
from .columns import INS as INS, REFERENCE as REFERENCE, TIME as TIME, WSN as WSN
from .correction import Rung as Rung
from .csv_folder import write_csv as write_csv
from .entries import Answer as Answer, Event as Event, Task as Task, judge as judge
from .estimates import Estimate as Estimate
from .files import RecordingUnavailableError as RecordingUnavailableError
from .filter_checks import (
    check_filter as check_filter,
    check_innovations as check_innovations,
    check_nees as check_nees,
)
from .findings import Finding as Finding, verdict as verdict
from .imu_clock import ImuClock as ImuClock, imu_clock as imu_clock
from .ins_wsn import TrackPair as TrackPair, read_recording as read_recording
from .ladder import Ladder as Ladder
from .network_fixes import (
    multilaterate_track as multilaterate_track,
    slope_velocity as slope_velocity,
)
from .outages import Outages as Outages
from .registry import load as load, load_drive as load_drive, names as names
from .report import Report as Report, report as report
from .set_up_checks import check_set_up as check_set_up
from .suggest import suggest as suggest
from .track_checks import check_recording as check_recording
