"""The one place where it is chosen whether a kernel runs compiled or not."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType
from typing import Any, ClassVar, TypeVar

import numpy as np

#: Set in the environment to 1, it makes no kernel run compiled; to 0, every one, whatever the size
#: of the work, and without a word. By default the size decides.
PLAIN = "INSWSN_PLAIN"

# What a compiled kernel must save to be worth it, s: numba is loaded with what it kept on disk in
# about one, and compiles in about eight (Python 3.11, numba 0.68, one core).
_LOADED, _COMPILED = 1.0, 8.0

_Given = TypeVar("_Given")


def kernel(**options: Any) -> Callable[[_Given], _Given]:
    """Mark a function of a kernel file for numba's ``njit``, with these options.

    The function stays what it is in Python, and calls others of its file as such.

    Examples
    --------
    >>> from inswsn_lib.kernels import kernel
    >>> @kernel(error_model="numpy")
    ... def doubled(x):
    ...     return 2 * x
    >>> doubled(3)
    6
    """

    def marked(function: Any) -> Any:
        function.of_numba = options
        return function

    return marked


def choose(
    name: str,
    plain: Callable[..., Any] | None = None,
    function: str = "",
    *,
    saves: float = float("inf"),
) -> Callable[..., Any]:
    """Return a function of the kernel file `name`, by default the one of that name.

    It is compiled, but where numba is missing or broken, where ``INSWSN_PLAIN`` is 1, and where
    compiled it would save less time than it costs: `saves`, in seconds, as it has been measured
    where this is called. There the source itself runs in Python, or what is given as `plain`: a
    form of it in numpy, where the page would be too slow without. Both take the same arguments,
    give the same to rounding, and change none of their arguments but one named `out`, which they
    fill: numpy gets large memory more quickly than numba.
    """
    asked = os.environ.get(PLAIN, "")
    always = asked == "0"
    found = None
    if always or not (asked or saves < _LOADED):
        found = _compiled(name, function or name)
    if found is None or not (always or saves >= _COMPILED or _is_kept(found)):
        return plain or _in_python(name, function or name)
    return _Lasting(found, plain or _in_python(name, function or name))


@cache
def _in_python(name: str, function: str) -> Callable[..., Any]:
    """Return a kernel as it stands in its file; like numba's it does not warn of a division."""
    source = getattr(import_module(f"inswsn_lib.kernels.{name}"), function)
    quietly: Callable[..., Any] = np.errstate(all="ignore")(source)
    return quietly


@cache
def _compiled(name: str, function: str) -> Any:
    """Return a compiled function, or None where numba is missing or broken."""
    if find_spec("numba") is None:
        return None
    try:
        _tell_of_compiling()
        with quiet():
            return keeping(partial(_by_numba, f"inswsn_lib.kernels.{name}"))[function]
    except (ImportError, OSError, RuntimeError):
        return None


def _by_numba(module: str) -> dict[str, Any]:
    """Return what a module names, its marked functions decorated, which call one another so."""
    from numba import njit  # noqa: PLC0415  # it takes long

    found = vars(import_module(module))
    names = dict(found)
    for name, own in found.items():
        if hasattr(own, "of_numba"):
            names[name] = njit(cache=True, **own.of_numba)(FunctionType(own.__code__, names, name))
    return names


class _Lasting:
    """A compiled function, and another where what is compiled cannot be written to disk."""

    lost: ClassVar[set[Any]] = set()

    def __init__(self, kernel: Any, plain: Callable[..., Any]) -> None:
        self.kernel, self._plain = kernel, plain

    def __call__(self, *arguments: Any) -> Any:
        """Run it."""
        if self.kernel not in self.lost:
            try:
                return self.kernel(*arguments)
            except OSError:  # of the cache, as on a full disk: no kernel reads or writes
                self.lost.add(self.kernel)
        return self._plain(*arguments)


def _is_kept(kernel: Any) -> bool:
    """Tell whether the disk has a compiled function."""
    own = kernel.py_func
    pattern = f"{own.__module__.rpartition('.')[2]}.{own.__qualname__}-*.nbi"
    return any(Path(kernel.stats.cache_path).glob(pattern))


def keeping(action: Callable[[], _Given]) -> _Given:
    """Return what an action gives by which numba finds a place for what it compiles.

    Where none of its own can be written, it is one that goes when this process ends.

    Examples
    --------
    >>> from inswsn_lib.kernels import keeping
    >>> keeping(lambda: "what is decorated by numba.njit(cache=True)")
    'what is decorated by numba.njit(cache=True)'
    """
    try:
        return action()
    except RuntimeError:  # "no locator available"
        import numba  # noqa: PLC0415  # it takes long

        before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _temporary_folder()
        try:
            return action()
        finally:
            numba.config.CACHE_DIR = before


@contextmanager
def quiet() -> Iterator[None]:
    """Keep numba from warning that functions as arguments are new to it.

    Examples
    --------
    >>> from inswsn_lib.kernels.choice import quiet
    >>> with quiet():
    ...     print("done")
    done
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "First-class function type feature")
        yield


@cache
def compiled(function: Callable[..., Any], arrays: int) -> Any:
    """Return a function of some arrays of floats that gives a float, compiled.

    Where the function stands in a file, it is kept on disk.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.kernels import compiled
    >>> def first(x):
    ...     return x[0]
    >>> compiled(first, 1)(np.ones(3))
    1.0
    """
    import numba  # noqa: PLC0415  # it takes long

    told = numba.float64(*[numba.float64[::1]] * arrays)
    try:
        return keeping(lambda: numba.njit(told, cache=True)(function))
    except RuntimeError:  # it stands in no file
        return numba.njit(told)(function)


@cache
def _temporary_folder() -> str:
    """Return a folder that goes when this process ends."""
    # few need them, and they load a third as many modules as all of the filter
    import atexit  # noqa: PLC0415
    import shutil  # noqa: PLC0415
    import tempfile  # noqa: PLC0415

    folder = tempfile.mkdtemp(prefix="inswsn-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@cache
def _tell_of_compiling() -> None:
    """Have the first compilation of this process tell of itself, before it keeps one waiting."""
    if os.environ.get(PLAIN) == "0":
        return
    from numba.core import event  # noqa: PLC0415  # it takes long

    class Teller(event.Listener):  # type: ignore[misc]  # numba has no types
        """Tells once."""

        def on_start(self, _: Any) -> None:
            event.unregister("numba:compile", self)
            print("inswsn_lib compiles a kernel, which takes some seconds.", file=sys.stderr)

        def on_end(self, _: Any) -> None:
            """Say nothing of the end."""

    event.register("numba:compile", Teller())
