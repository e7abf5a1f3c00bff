"""What a run was made with: the state of the checkout, and the machine."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

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


def _git(root: Path, *words: str) -> str | None:
    try:
        done = subprocess.run(
            ["git", "-C", str(root), *words], capture_output=True, text=True, check=False
        )
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def machine_facts() -> dict[str, Any]:
    """Return what this process computes with, as plain data: the fields of `Provenance`."""
    from threadpoolctl import threadpool_info  # noqa: PLC0415  # the parent needs no numerics

    for name in ("numpy", "scipy.linalg"):
        import_module(name)
    libraries = {
        f"{entry['internal_api']} {entry.get('version') or '(version unknown)'} "
        f"of {_owner(str(entry['filepath']))}, "
        + (f"for {entry['architecture']}, " if entry.get("architecture") else "")
        + f"{entry['num_threads']} thread{'s' if entry['num_threads'] > 1 else ''}"
        for entry in threadpool_info()
        if entry["user_api"] == "blas"
    }
    packages = {name: _installed_version(name) for name in _COMPUTING}
    return {
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cpu": _cpu_name(),
        "cores": available_cores(),
        "blas": sorted(libraries),
        "packages": {name: found for name, found in packages.items() if found},
    }


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


def _owner(path: str) -> str:
    """Return the package whose folder of libraries, such as numpy.libs, holds the file."""
    folder = Path(path).parent.name
    return folder.removesuffix(".libs") if folder.endswith(".libs") else "the system"


def _installed_version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
