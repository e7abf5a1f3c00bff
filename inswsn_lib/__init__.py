"""Methods and forensics of three papers on integrated navigation.

``import inswsn_lib as iw`` gives every name that an engineer needs, imported when it is first used:
a model, a filter, a design, a recording, a learner, a score. `__init__.pyi` lists them. The rooms,
and what each may use, are listed in ``CONTRIBUTING.md``.
"""

from importlib import import_module
from typing import Any

from inswsn_lib.extras import attach

_OLD_ROOMS = ("calibration", "estimation", "recordings")
_imported, __dir__, __all__ = attach(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name in _OLD_ROOMS:
        return import_module(f"{__name__}.{name}")
    if name != "__version__":
        return _imported(name)
    # loads what takes half as long as numpy
    from importlib.metadata import version  # noqa: PLC0415

    return version("inswsn")
