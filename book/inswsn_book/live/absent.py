"""What the page has no package for: it may be imported, and says so when it is used.

In the page there are numpy and the standard library. A module of the library that imports scipy for
one of its functions is of use there all the same, for the others. Imported first, this makes every
other package one whose names can be had, inherited from and passed on, but not called.
"""

from __future__ import annotations

import os
import sys
from abc import ABCMeta
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

#: Packages of which the page knows that they are not there
PACKAGES = frozenset({
    "IPython", "clarabel", "click", "cvxpy", "dask", "distributed", "highspy", "jupytext",
    "matplotlib", "numba", "pandas", "papermill", "pooch", "pydantic", "pyins", "rich", "scipy",
    "scs", "sklearn", "torch", "yaml",
})  # fmt: skip


class AbsentError(ModuleNotFoundError):
    """Code needs a package that is not in the page; ``name`` says which."""

    def __init__(self, package: str) -> None:
        super().__init__(f"{package} is not in the page.", name=package)


class _Absent(ABCMeta):
    """The kind of each name of an absent package: a class to inherit from, or an exception."""

    package: str

    def __call__(cls, *values: Any, **named: Any) -> Any:
        if not any("__init__" in vars(each) for each in cls.__mro__ if each not in _PLAIN):
            raise AbsentError(cls.package)
        return super().__call__(*values, **named)

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _absent(cls.package)

    def __or__(cls, other: Any) -> Any:
        return Any

    __ror__ = __or__


_PLAIN = (Exception, BaseException, object)


def _absent(package: str) -> Any:
    return _Absent("Absent", (Exception,), {"package": package})


class _Module(ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") and name != "__with_libyaml__":
            raise AttributeError(name)
        return _absent(self.__name__.partition(".")[0])


class _Finder(MetaPathFinder, Loader):
    """Finds absent packages, and each module in them."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname.partition(".")[0] not in PACKAGES:
            return None
        return ModuleSpec(fullname, self, is_package=True)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Module(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        pass


def block() -> None:
    """Make packages absent, whether they are installed or not; none may be loaded by now."""
    if loaded := sorted(PACKAGES & {name.partition(".")[0] for name in sys.modules}):
        raise RuntimeError(f"{loaded[0]} is loaded already.")
    sys.meta_path.insert(0, _Finder())
    os.environ["INSWSN_PLAIN"] = "1"  # no kernel is compiled where numba is absent
