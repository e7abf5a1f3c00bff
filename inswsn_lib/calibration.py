"""The name of a part of `inswsn_lib.logs` until version 3."""

from __future__ import annotations

import warnings
from typing import Any

from inswsn_lib import logs

warnings.warn("inswsn_lib.calibration is now inswsn_lib.logs.", DeprecationWarning, stacklevel=2)


def __getattr__(name: str) -> Any:
    """Return what has that name in the room."""
    return getattr(logs, name)
