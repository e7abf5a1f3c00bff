"""Navigation: the hybrid of a filter and a regressor, and recordings to run it on."""

from inswsn_lib.navigation.hybrid import (
    HybridNavigator,
    HybridRun,
    fit_many,
    observable_inputs,
)
from inswsn_lib.navigation.recordings import INS, REFERENCE, TIME, WSN, Recording, read_recording

__all__ = [
    "INS",
    "REFERENCE",
    "TIME",
    "WSN",
    "HybridNavigator",
    "HybridRun",
    "Recording",
    "fit_many",
    "observable_inputs",
    "read_recording",
]
