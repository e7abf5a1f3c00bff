"""What a run was made with: the state of the checkout, and the machine."""

from __future__ import annotations

import os
import platform
import subprocess
from contextlib import suppress
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

#: The file in which a kernel leaves its `machine_facts`
MACHINE = "machine.json"
# The packages whose numbers end up on a page; the lock names all the others.
_COMPUTING = (
    *("numpy", "scipy", "pandas", "mpmath", "cvxpy", "clarabel", "scs"),
    *("scikit-learn", "torch", "python-ins", "matplotlib"),
)


def repository_state(root: Path) -> tuple[str | None, bool | None]:
    """Return the commit that is checked out and whether the work tree is that commit.

    Both are None if `root` is not the top of a git checkout, or there is no git.
    """
    top, commit = (_git(root, "rev-parse", word) for word in ("--show-toplevel", "HEAD"))
    # a copy without a history may lie inside another repository
    if top is None or commit is None or Path(top).resolve() != root.resolve():
        return None, None
    return commit, _git(root, "status", "--porcelain") == ""


def edited(root: Path) -> list[str]:
    """Return the paths of what computes, or is computed from, and is not as it was committed.

    There is none outside a git checkout.
    """
    if repository_state(root)[0] is None:
        return []
    which = ("chapters/*.md", "inswsn_lib", "book/inswsn_book/evidence", "data")
    return (_git(root, "diff", "--name-only", "HEAD", "--", *which) or "").splitlines()


def _git(root: Path, *words: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *words], capture_output=True, text=True, check=False
        )
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


@cache
def package_versions() -> dict[str, str]:
    """Return the versions of the packages that compute, as this process finds them."""
    packages = {}
    for name in _COMPUTING:
        with suppress(PackageNotFoundError):
            packages[name] = version(name)
    return packages


def machine_facts() -> dict[str, Any]:
    """Return what this process computes with, as plain data: the fields of `Provenance`."""
    from threadpoolctl import threadpool_info  # noqa: PLC0415  # the parent needs no numerics

    for name in ("numpy", "scipy.linalg"):
        import_module(name)
    libraries = {_described(entry) for entry in threadpool_info() if entry["user_api"] == "blas"}
    return {
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cpu": _cpu_name(),
        "cores": available_cores(),
        "blas": sorted(libraries),
        "packages": package_versions(),
    }


def _described(library: dict[str, Any]) -> str:
    """Return such as ``"openblas 0.3.30 of scipy, for Haswell, 1 thread"``."""
    folder = Path(library["filepath"]).parent.name  # numpy.libs in that of a package
    owner = folder.removesuffix(".libs") if folder.endswith(".libs") else "the system"
    path = f"for {library['architecture']}, " if library.get("architecture") else ""
    threads = f"{library['num_threads']} thread{'s' if library['num_threads'] > 1 else ''}"
    known = library.get("version") or "(version unknown)"
    return f"{library['internal_api']} {known} of {owner}, {path}{threads}"


def available_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _cpu_name() -> str:
    # platform.processor() is empty on most Linux systems
    info = Path("/proc/cpuinfo")
    for line in info.read_text(encoding="utf-8").splitlines() if info.is_file() else ():
        name, _, value = line.partition(":")
        if name.strip() == "model name":
            return value.strip()
    return platform.processor() or platform.machine() or "unknown"
