"""Rooms that had other names: what is asked for is found where it is now, with a warning."""

from __future__ import annotations

import importlib
import pkgutil
import sys
import warnings
from collections.abc import Callable
from types import ModuleType
from typing import Any


def found_in(old: str, *rooms: ModuleType) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a room that is these now; their modules have its name, too.

    Parameters
    ----------
    old : str
        The name of the room that was.
    rooms : modules
    """
    for room in rooms:
        for module in pkgutil.iter_modules(room.__path__):
            there = importlib.import_module(f"{room.__name__}.{module.name}")
            sys.modules[f"{old}.{module.name}"] = there

    def attribute(name: str) -> Any:
        for room in rooms:
            if name in room.__all__:
                told = f"{old}.{name} is now {room.__name__}.{name}."
                warnings.warn(told, DeprecationWarning, stacklevel=2)
                return getattr(room, name)
        raise AttributeError(f"module {old!r} has no attribute {name!r}")

    return attribute
