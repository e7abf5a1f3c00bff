from .files import RecordingUnavailableError as RecordingUnavailableError
from .gnss_imu import RecordedDrive as RecordedDrive, Track as Track, load_drive as load_drive
