"""The one place where it is chosen whether a kernel runs compiled or as plain numpy."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any, TypeVar, cast

#: Set in the environment, it makes every kernel run as plain numpy
PLAIN = "INSWSN_PLAIN"

_Kernel = TypeVar("_Kernel", bound=Callable[..., Any])


def choose(name: str, plain: _Kernel, function: str = "") -> _Kernel:
    """Return what runs in place of `plain`: a function of the kernel file `name`.

    By default it is the function of that name.
    It is plain numpy where numba is missing, or where ``INSWSN_PLAIN`` is set. Both take the same
    arguments, give the same to rounding, and change none of their arguments but one named `out`,
    which they fill: numpy gets large memory more quickly than numba.
    """
    if os.environ.get(PLAIN) or not _numba_is_there():
        return plain
    return cast(_Kernel, _compiled(name, function or name))


@cache
def _numba_is_there() -> bool:
    return find_spec("numba") is not None


@cache
def _compiled(name: str, function: str) -> Callable[..., Any]:
    found: Callable[..., Any] = getattr(import_module(f"inswsn_lib.kernels.{name}"), function)
    return found
