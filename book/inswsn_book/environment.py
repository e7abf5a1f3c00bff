"""The locked environment: compiling the lock, and telling when it does not fit what asks for it."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name

from inswsn_book.files import file_digest, text_digest, write_whole
from inswsn_book.project import Project
from inswsn_lib.errors import InswsnError

#: The Python that the locks are for.
PYTHON = "3.11"

_TORCH_INDEX = "https://download.pytorch.org/whl/cpu"
_TORCH_HEADER = f"""\
# torch, apart from all else: its CPU wheel for Linux on x86-64 lives on an index of its own, and an
# index that is out of reach costs pip seconds for each package looked up. Installed first, with
# --no-deps; what torch itself needs is in environment.lock. Made by `make lock`.
--extra-index-url {_TORCH_INDEX}
"""
_PLATFORM = 'sys_platform == "linux" and platform_machine == "x86_64"'
_ELSEWHERE = 'sys_platform != "linux" or platform_machine != "x86_64"'


def lock_problems(project: Project) -> list[str]:
    """Return every way in which the locks do not fit what they were compiled from.

    No network is used. Checked are: each requirement of environment.in is pinned within its
    bounds; each pin that came from environment.in is still asked for there; every pin has a hash;
    what pyproject.toml needs is pinned within its bounds; torch is pinned as environment-torch.in
    asks; neither lock has been edited by hand.

    Returns
    -------
    list of str
        One sentence each; empty if the locks fit.
    """
    root = project.root
    pins = _pins(root / "environment.lock")
    asked = list(_requirements(root / "environment.in"))
    problems = _unmet(asked, pins, "environment.in", "environment.lock")
    names = {canonicalize_name(requirement.name) for requirement in asked}
    for name, pin in pins.items():
        if pin.direct and name not in names:
            problems.append(f"environment.lock pins {name}, which environment.in no longer names.")
    try:
        pyproject = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise InswsnError(f"pyproject.toml is not TOML: {error}.") from None
    needed = [Requirement(text) for text in pyproject["project"]["dependencies"]]
    problems += _unmet(needed, pins, "pyproject.toml", "environment.lock")
    torch = list(_requirements(root / "environment-torch.in"))
    torch_pins = _pins(root / "environment-torch.lock")
    problems += _unmet(torch, torch_pins, "environment-torch.in", "environment-torch.lock")
    for lock, its_pins in (("environment.lock", pins), ("environment-torch.lock", torch_pins)):
        problems += [
            f"{lock} pins {name} without a hash."
            for name, pin in its_pins.items()
            if not pin.hashed
        ]
        first, _, body = (root / lock).read_text(encoding="utf-8").partition("\n")
        if first != _seal(body):
            problems.append(f"{lock} has been edited since it was made.")
    return problems


def compile_locks(project: Project, *, upgrade: bool = False) -> None:
    """Compile environment.in and environment-torch.in to their locks, hashes and all.

    Versions that are in the locks stay unless the requirements exclude them.

    Parameters
    ----------
    project : Project
        The checkout.
    upgrade : bool
        Take the newest versions that the requirements allow instead.

    Raises
    ------
    InswsnError
        If the requirements cannot be met, or an index cannot be reached.
    """
    root = project.root
    with tempfile.TemporaryDirectory() as name:
        new = Path(name) / "environment.lock"
        old = root / "environment.lock"
        if old.is_file() and not upgrade:
            pinned = old.read_text(encoding="utf-8").splitlines(keepends=True)
            new.write_text("".join(pinned[1:]), encoding="utf-8")
        _run([*_uv(), "environment.in", "-o", str(new)], root)
        body = new.read_text(encoding="utf-8")
    torch_body = _torch_lock(root)
    write_whole(old, f"{_seal(body)}\n{body}")
    write_whole(root / "environment-torch.lock", f"{_seal(torch_body)}\n{torch_body}")


def _seal(body: str) -> str:
    """Return the first line of a lock, which names the digest of the rest."""
    return f"# Made by `make lock`; do not edit. SHA-256 of what follows: {text_digest(body)}"


def _uv() -> list[str]:
    return [
        *(sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--universal"),
        *("--python-version", PYTHON, "--generate-hashes", "--no-header"),
    ]


def _torch_lock(root: Path) -> str:
    (torch,) = _requirements(root / "environment-torch.in")
    version = next(iter(torch.specifier)).version
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _run(
            [
                *(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", name),
                *("--only-binary", ":all:", "--extra-index-url", _TORCH_INDEX),
                # the wheel for Linux, wherever the lock is compiled
                *("--platform", "manylinux_2_28_x86_64", "--python-version", PYTHON),
                f"torch=={version}+cpu",
            ],
            root,
        )
        (wheel,) = folder.glob("*.whl")
        cpu = f"torch=={version}+cpu ; {_PLATFORM} \\\n    --hash=sha256:{file_digest(wheel)}\n"
        _run(
            [*_uv(), "--no-deps", "--no-annotate", "environment-torch.in", "-o", f"{name}/rest"],
            root,
        )
        rest = (folder / "rest").read_text(encoding="utf-8")
    return (
        _TORCH_HEADER + cpu + rest.replace(f"=={version} \\", f"=={version} ; {_ELSEWHERE} \\", 1)
    )


def _run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise InswsnError(f"The lock could not be compiled: {done.stderr.strip()}")


class _Pin:
    """All versions that a lock pins of one package, by marker."""

    def __init__(self) -> None:
        self.versions: list[str] = []
        self.hashed = True
        self.direct = False


def _pins(lock: Path) -> dict[str, _Pin]:
    """Read a lock: one entry a package. Comments below a pin say what asked for it."""
    if not lock.is_file():
        raise InswsnError(f"There is no {lock.name}; make it with `make lock`.")
    pins: dict[str, _Pin] = {}
    current = _Pin()
    for line in lock.read_text(encoding="utf-8").splitlines():
        if match := re.match(r"([A-Za-z0-9][\w.-]*)==([^\s;\\]+)", line):
            current = pins.setdefault(canonicalize_name(match[1]), _Pin())
            current.versions.append(match[2])
            current.hashed = current.hashed and line.endswith("\\")
        elif line.lstrip().startswith("#") and "-r environment.in" in line:
            current.direct = True
    return pins


def _requirements(path: Path) -> Iterator[Requirement]:
    for line in path.read_text(encoding="utf-8").splitlines():
        text = line.split("#", 1)[0].strip()
        if text:
            try:
                yield Requirement(text)
            except InvalidRequirement:
                raise InswsnError(
                    f"{path.name} has the line {text!r}, which names no package."
                ) from None


def _unmet(
    requirements: list[Requirement], pins: dict[str, _Pin], source: str, lock: str
) -> list[str]:
    problems = []
    for requirement in requirements:
        pin = pins.get(canonicalize_name(requirement.name))
        if pin is None:
            problems.append(f"{source} names {requirement.name}, which {lock} does not pin.")
            continue
        for version in pin.versions:
            if not requirement.specifier.contains(version, prereleases=True):
                problems.append(
                    f"{source} asks for {requirement}; {lock} pins {requirement.name} {version}."
                )
    return problems
