"""Packages that some names need and most do not: which extra of the library brings each."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import lazy_loader

from inswsn_lib.errors import InswsnError

#: What brings a package, by the name under which it is imported
EXTRAS = {
    "highspy": "solvers", "matplotlib": "figures", "numba": "speed", "pandas": "tables",
    "pooch": "logs", "scs": "solvers", "sklearn": "learners", "torch": "networks",
}  # fmt: skip


class MissingPackageError(InswsnError, ImportError):
    """A name needs a package that is not installed; the sentence says how it is installed.

    Examples
    --------
    >>> from inswsn_lib.extras import MissingPackageError
    >>> raise MissingPackageError("inswsn_lib.learning.BackpropRegressor", "torch")
    Traceback (most recent call last):
        ...
    inswsn_lib.extras.MissingPackageError: inswsn_lib.learning.BackpropRegressor needs torch: \
pip install 'inswsn[networks]'
    """

    def __init__(self, what: str, package: str) -> None:
        extra = "logs" if what.startswith("inswsn_lib.logs.") else EXTRAS[package]
        super().__init__(f"{what} needs {package}: pip install 'inswsn[{extra}]'")


def need(package: str, what: str) -> Any:
    """Return a package; `what` needs it.

    Raises
    ------
    MissingPackageError
        If it is not installed.

    Examples
    --------
    >>> from inswsn_lib.extras import need
    >>> need("pandas", "A table").DataFrame.__name__
    'DataFrame'
    """
    try:
        return import_module(package)
    except ModuleNotFoundError:
        raise MissingPackageError(what, package) from None


def attach(room: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a room whose stub has its names.

    A name is imported when it is first used. One that needs a package that is not installed
    raises `MissingPackageError`.

    Examples
    --------
    >>> import inswsn_lib
    >>> from inswsn_lib.extras import attach
    >>> attach("inswsn_lib", inswsn_lib.__file__)[0]("ErrorModel").__name__
    'ErrorModel'
    """
    imported, listed, names = lazy_loader.attach_stub(room, file)

    def attribute(name: str) -> Any:
        try:
            return imported(name)
        except ModuleNotFoundError as error:
            package = (error.name or "").partition(".")[0]
            if package not in EXTRAS:
                raise
            raise MissingPackageError(f"{room}.{name}", package) from None

    return attribute, listed, names
