"""The name of `inswsn_lib.inertial` until version 2; what is asked for is found where it is now."""

from __future__ import annotations

import warnings
from typing import Any

from inswsn_lib import inertial, logs


def __getattr__(name: str) -> Any:
    """Return what has that name in the rooms that this one has become."""
    for room in (inertial, logs):
        if name in room.__all__:
            told = f"inswsn_lib.estimation.{name} is now {room.__name__}.{name}."
            warnings.warn(told, DeprecationWarning, stacklevel=2)
            return getattr(room, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
