from .columns import INS as INS, REFERENCE as REFERENCE, TIME as TIME, WSN as WSN
from .contest import (
    Contestant as Contestant,
    FixesContest as FixesContest,
    RecordedContest as RecordedContest,
)
from .csv_writing import write_csv as write_csv
from .estimates import Estimate as Estimate
from .files import RecordingUnavailableError as RecordingUnavailableError
from .filter_checks import (
    check_errors as check_errors,
    check_filter as check_filter,
    check_innovations as check_innovations,
    check_nees as check_nees,
)
from .findings import Finding as Finding, verdict as verdict
from .ins_wsn import TrackPair as TrackPair, read_recording as read_recording
from .planar_contest import PlanarContest as PlanarContest
from .registry import load as load, load_drive as load_drive, names as names
from .report import Report as Report, report as report
from .set_up_checks import check_set_up as check_set_up
from .track_checks import check_recording as check_recording
