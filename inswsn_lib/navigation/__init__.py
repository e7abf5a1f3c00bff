"""Navigation on recordings: reading them, for the filters to run on."""

from inswsn_lib.navigation.recordings import INS, REFERENCE, TIME, WSN, Recording, read_recording

__all__ = ["INS", "REFERENCE", "TIME", "WSN", "Recording", "read_recording"]
