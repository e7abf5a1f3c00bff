"""The lock fits what asks for it: nothing is missing, nothing lies outside its bounds."""

from __future__ import annotations

import ast
import inspect
import io
import json
import os
import re
import signal
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
from collections.abc import Iterable, Iterator
from hashlib import sha256
from importlib.metadata import packages_distributions
from itertools import chain
from pathlib import Path

import environment
import pytest
from conftest import unprivileged
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from inswsn_lib.extras import EXTRAS

PIN = re.compile(r"^([A-Za-z0-9][\w.-]*)==([^\s;\\]+)(.*)$", re.MULTILINE)


def asked(root: Path) -> Iterator[Requirement]:
    for line in (root / "environment.in").read_text(encoding="utf-8").splitlines():
        if text := line.split("#", 1)[0].strip():
            yield Requirement(text)
    for name in ("pyproject.toml", "book/pyproject.toml"):
        project = tomllib.loads((root / name).read_text(encoding="utf-8"))["project"]
        extras = project["optional-dependencies"].values() if name == "pyproject.toml" else []
        yield from map(Requirement, chain(project["dependencies"], *extras))


def problems(requirements: Iterable[Requirement], lock: str) -> list[str]:
    pinned = {canonicalize_name(name): version for name, version, _ in PIN.findall(lock)}
    found = {r.name: (r, pinned.get(canonicalize_name(r.name))) for r in requirements}
    found.pop("inswsn", None)  # the checkout itself
    return [
        name
        for name, (requirement, version) in found.items()
        if version is None or not requirement.specifier.contains(version, prereleases=True)
    ]


def test_the_lock_has_all_that_is_asked_for(root: Path) -> None:
    locks = [(root / f"environment{name}.lock").read_text("utf-8") for name in ("", "-torch")]
    assert problems(asked(root), "".join(locks)) == []
    wanted = [Requirement("numpy>=2"), Requirement("scipy"), Requirement("click<9")]
    assert problems(wanted, "numpy==1.9 \\\nclick==8.2 \\\n") == ["numpy", "scipy"]


def test_what_the_library_declares_is_what_it_imports(root: Path) -> None:
    """What is no part of the core is an extra, and the one that a sentence names."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    imported = set(EXTRAS)
    for path in (root / "inswsn_lib").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add((node.module or "").partition(".")[0])
    homes = packages_distributions()
    names = imported - {*sys.stdlib_module_names, "inswsn_lib"}
    found = {name: canonicalize_name(homes[name][0]) for name in names}
    declared = {Requirement(text).name for text in chain(project["dependencies"], *extras.values())}
    assert {*found.values()} == declared - {"inswsn"}
    core = {Requirement(text).name for text in project["dependencies"]}
    assert {name for name, home in found.items() if home not in core} == EXTRAS.keys()
    for name, extra in EXTRAS.items():
        assert found[name] in {Requirement(text).name for text in extras[extra]}


def test_jupyterlab_is_pinned_as_it_is_asked_for(root: Path) -> None:
    project = tomllib.loads((root / "book" / "pyproject.toml").read_text(encoding="utf-8"))
    wanted = map(Requirement, project["project"]["optional-dependencies"]["jupyter"])
    pins = (root / ".ci" / "jupyter.txt").read_text(encoding="utf-8")
    assert problems(wanted, pins) == []


@pytest.mark.parametrize("name", ["environment.lock", "environment-torch.lock", ".ci/jupyter.txt"])
def test_every_pin_has_a_hash(root: Path, name: str) -> None:
    pins = PIN.findall((root / name).read_text(encoding="utf-8"))
    assert pins
    assert [pin for pin, _, rest in pins if not rest.endswith("\\")] == []


def test_another_python_than_the_hashed_one_gets_torch_by_its_version(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(root)
    hashed = (root / environment.TORCH).read_text(encoding="utf-8")
    plain = environment.without_hashes(tmp_path, environment.TORCH).read_text(encoding="utf-8")
    assert "--hash" in hashed
    assert "--hash" not in plain
    pins = [[pin[:2] for pin in PIN.findall(text)] for text in (hashed, plain)]
    assert pins[0] == pins[1] != []
    assert "+cpu" in pins[1][0][1]


@pytest.mark.parametrize("runs", [11, 12, 13])
def test_make_takes_a_python_that_runs(root: Path, tmp_path: Path, runs: int) -> None:
    """The one of a lower version is a shim of nothing; those of all higher versions run."""
    (tmp_path / "Makefile").write_text((root / "Makefile").read_text(encoding="utf-8"))
    for name in ("python3.11", "python3", "python", "python3.12", "python3.13"):
        _, _, version = name.partition("3.")
        code = "exit 0" if version and int(version) >= runs else "echo command not found; exit 127"
        (tmp_path / name).write_text(f"#!/bin/sh\n{code}\n")
        (tmp_path / name).chmod(0o755)
    said = subprocess.run(
        ["make", "-n", "environment"], cwd=tmp_path, text=True, check=True, capture_output=True,
        env={k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "PYTHON"))}
        | {"PATH": f"{tmp_path}:{os.environ['PATH']}"},
    ).stdout  # fmt: skip
    assert said.endswith(f"; python3.{runs} .ci/environment.py\n")


def test_another_python_has_another_environment(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(root)
    names = set()
    for minor in (11, 12, 12):
        monkeypatch.setattr(sys, "version_info", (3, minor, 0))
        names.add(environment.digest(environment.LOCK))
    assert len(names) == 2


# How it is made: by the recipe itself, with one small package in the lock -------------------------


def write_wheel(folder: str, name: str, version: int = 1, text: str = "") -> str:
    """Write a package of one module; return the name of its file."""
    import zipfile

    wheel = f"{name}-{version}-py3-none-any.whl"
    head = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    with zipfile.ZipFile(f"{folder}/{wheel}", "w") as made:
        for path, content in {
            f"{name}.py": text,
            f"{name}-{version}.dist-info/METADATA": head,
            f"{name}-{version}.dist-info/WHEEL": "Wheel-Version: 1.0\nTag: py3-none-any\n",
            f"{name}-{version}.dist-info/RECORD": "",
        }.items():
            made.writestr(path, content)
    return wheel


PROJECT = """
[build-system]
requires = []
build-backend = "backend"
backend-path = ["."]
"""
BACKEND = """
def build_editable(folder, settings=None, metadata=None):
    import os
    return write_wheel(folder, "own" if os.path.exists("Makefile") else "own_book")
"""


BUILD = """
def build_wheel(folder, settings=None, metadata=None):
    return write_wheel(folder, "small", 3, "print(3)")
"""


class Checkout:
    """A folder in which ``make environment`` needs no network."""

    def __init__(self, folder: Path, root: Path) -> None:
        self.folder, self.made = folder, folder / ".venvs"
        for part in (folder, folder / ".ci", folder / "book"):
            part.mkdir(exist_ok=True)
            (part / "pyproject.toml").write_text(PROJECT)
            (part / "backend.py").write_text(inspect.getsource(write_wheel) + BACKEND)
        for name in ("Makefile", ".ci/environment.py"):
            (folder / name).write_text((root / name).read_text())
        for name in (".ci/pip.txt", "environment-torch.lock"):
            (folder / name).write_text("")
        self.lock(1)

    def lock(self, version: int) -> Path:
        """Write the lock, and the package that it pins."""
        text = f"print({version})"
        wheel = self.folder / write_wheel(str(self.folder), "small", version, text)
        pin = f"small @ {wheel.as_uri()} --hash=sha256:{sha256(wheel.read_bytes()).hexdigest()}\n"
        (self.folder / "environment.lock").write_text(pin)
        return wheel

    def lock_source(self) -> None:
        """Lock a package that pip has to build, as it has to build filterpy."""
        build = inspect.getsource(write_wheel) + BUILD
        with tarfile.open(self.folder / "small-3.tar.gz", "w:gz") as source:
            for name, text in (
                ("pyproject.toml", PROJECT), ("backend.py", build),
                ("PKG-INFO", "Metadata-Version: 2.1\nName: small\nVersion: 3\n"),
            ):  # fmt: skip
                entry = tarfile.TarInfo(f"small-3/{name}")
                entry.size = len(text)
                source.addfile(entry, io.BytesIO(text.encode()))
        path = self.folder / "small-3.tar.gz"
        pin = f"small @ {path.as_uri()} --hash=sha256:{sha256(path.read_bytes()).hexdigest()}\n"
        (self.folder / "environment.lock").write_text(pin)

    def start(self, **variables: str) -> subprocess.Popen[str]:
        kept = {name: v for name, v in os.environ.items() if not name.startswith(("MAKE", "PIP_"))}
        return subprocess.Popen(
            ["make", "environment", f"PYTHON={sys.executable}"], cwd=self.folder, text=True,
            env=kept | {"PIP_NO_INDEX": "1", "PIP_CONFIG_FILE": os.devnull} | variables,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip

    def make(self, **variables: str) -> tuple[int, str]:
        started = self.start(**variables)
        said = started.communicate(timeout=600)[0]
        return started.returncode, said

    def installed(self) -> str:
        """Return the version that ``.venv`` has of the package."""
        words = [self.folder / ".venv/bin/python", "-c", "import small, own, own_book"]
        return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path, root: Path) -> Checkout:
    return Checkout(tmp_path, root)


@pytest.mark.whole
def test_an_environment_is_made_anew_for_another_lock_alone(checkout: Checkout) -> None:
    wheel, lock = checkout.folder / "small-1-py3-none-any.whl", checkout.folder / "environment.lock"
    status, said = checkout.make()
    assert status == 0, said
    assert checkout.installed() == "1"
    wheel.unlink()
    lock.touch()
    assert checkout.make() == (0, "")
    checkout.lock(2).unlink()  # as without a network
    status, said = checkout.make()
    assert status != 0
    assert ".venv is as it was" in said
    assert checkout.installed() == "1"
    assert {path.name for path in checkout.made.iterdir()} - {"pip"} == {
        "lock", (checkout.folder / ".venv").resolve().name,
    }  # fmt: skip
    checkout.lock(2)
    status, said = checkout.make()
    assert status == 0, said
    assert checkout.installed() == "2"
    assert len({p.name for p in checkout.made.iterdir()} - {"pip"}) == 2, "the old one is gone"


@pytest.mark.whole
def test_it_is_made_without_a_home_folder(checkout: Checkout) -> None:
    """What pip fetches and builds is kept in the checkout."""
    checkout.lock_source()
    status, said = checkout.make(HOME=os.devnull, XDG_CACHE_HOME="")
    assert status == 0, said
    assert checkout.installed() == "3"
    assert (checkout.made / "pip").is_dir()


@pytest.mark.whole
def test_two_at_once_wait_for_each_other(checkout: Checkout) -> None:
    both = [checkout.start(), checkout.start()]
    said = "".join(started.communicate(timeout=600)[0] for started in both)
    assert [started.returncode for started in both] == [0, 0], said
    assert said.count("Installing the locked environment") == 1
    assert said.count("Waiting for another make") == 1
    assert checkout.installed() == "1"


@pytest.mark.whole
@pytest.mark.usefixtures("as_in_a_terminal")
def test_one_that_is_stopped_leaves_the_folder_of_an_earlier_version(checkout: Checkout) -> None:
    old = checkout.folder / ".venv/bin/python"
    old.parent.mkdir(parents=True)
    old.write_text("of before")
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        started = checkout.start()
        while not list(checkout.made.glob("*/bin/python")):
            assert started.poll() is None
            time.sleep(0.01)
        os.killpg(started.pid, number)
        started.communicate(timeout=600)
        assert started.returncode != 0
        assert old.read_text() == "of before"
    status, said = checkout.make()
    assert status == 0, said
    assert checkout.installed() == "1"
    assert (checkout.folder / ".venv").is_symlink()
    assert len({p.name for p in checkout.made.iterdir()} - {"pip"}) == 2


@pytest.mark.whole
@pytest.mark.long
def test_the_steps_of_the_container_in_a_fresh_folder(root: Path) -> None:
    """As a builder takes them, but for Debian's packages and its user, which this machine has.

    Then the command runs where nothing can be written but in the volumes.
    """
    with tempfile.TemporaryDirectory() as above:  # which anybody may read, as no folder of pytest
        Path(above).chmod(0o755)
        take_the_steps(root, Path(above))


def take_the_steps(root: Path, above: Path) -> None:
    text = (root / "Containerfile").read_text(encoding="utf-8")
    steps = [line.split(" ", 1) for line in text.splitlines() if not line.startswith("#")]
    folder, settings, made = above / "inswsn", dict[str, str](), list[str]()
    for word, rest in steps:
        if word == "COPY":
            subprocess.run(["git", "clone", "--quiet", root, folder], check=True)
        elif word == "ENV":
            settings |= dict(each.split("=", 1) for each in rest.split())
        elif word == "RUN" and not rest.startswith(("apt-get ", "useradd ")):
            subprocess.run(rest, shell=True, cwd=folder, check=True)
            made.append(rest)
    assert made[0].startswith("make environment")
    said = dict(steps)
    volumes = {folder.parent / name[1:] for name in json.loads(said["VOLUME"])}
    for path in (folder, *folder.rglob("*")):
        if path not in volumes and not path.is_symlink():
            path.chmod(path.stat().st_mode & ~0o222)
    settings["GIT_CONFIG_VALUE_0"] = str(folder)
    entry = [*unprivileged(), *json.loads(said["ENTRYPOINT"])]
    for words in (json.loads(said["CMD"]), ["claims", "P1-Z-01"], ["run", "62"]):
        done = subprocess.run(
            [*entry, *words], cwd=folder, env=os.environ | settings, capture_output=True,
            text=True, check=False,
        )  # fmt: skip
        assert (done.returncode, bool(done.stdout)) == (0, True), done.stderr
