"""The name of `inswsn_lib.inertial` until version 2."""

from inswsn_lib import inertial, logs
from inswsn_lib.old_names import found_in

__getattr__ = found_in(__name__, inertial, logs)
