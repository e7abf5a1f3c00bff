"""The name of `inswsn_lib.logs`, or of a part of it, until version 2."""

from inswsn_lib import logs
from inswsn_lib.old_names import found_in

__getattr__ = found_in(__name__, logs)
