"""The name of `inswsn_lib.logs` until version 3; its modules are found by their old names, too."""

from __future__ import annotations

import importlib
import pkgutil
import sys
import warnings
from typing import Any

from inswsn_lib import logs

warnings.warn("inswsn_lib.recordings is now inswsn_lib.logs.", DeprecationWarning, stacklevel=2)
for _module in pkgutil.iter_modules(logs.__path__):
    _name = f"{__name__}.{_module.name}"
    sys.modules[_name] = importlib.import_module(f"{logs.__name__}.{_module.name}")


def __getattr__(name: str) -> Any:
    """Return what has that name in the room."""
    return getattr(logs, name)
