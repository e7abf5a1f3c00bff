"""The science is a wheel of its own: its example runs without the machinery."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from collections.abc import Iterable
from importlib.metadata import distribution
from pathlib import Path
from venv import EnvBuilder

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ABSENT = {"papermill", "sphinx", "click", "rich", "pydantic", "dask", "torch", "IPython"}
# each module of the science but the network's, which needs the extra
IMPORT_ALL = """
import importlib, pkgutil, inswsn_lib
for module in pkgutil.walk_packages(inswsn_lib.__path__, "inswsn_lib."):
    if module.name != "inswsn_lib.learning.backprop":
        importlib.import_module(module.name)
"""


def build(source: Path, folder: Path) -> Path:
    command = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    done = subprocess.run(
        [sys.executable, "-m", "pip", *command, "--wheel-dir", str(folder), str(source)],
        capture_output=True, text=True, check=False, cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def wheel(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(root, tmp_path_factory.mktemp("wheel"))


def test_the_machinery_is_a_wheel_of_its_own(wheel: Path, root: Path, tmp_path: Path) -> None:
    """It has the version of the science and brings the command."""
    built = build(root / "book", tmp_path)
    assert built.name.split("-")[:2] == ["inswsn_book", wheel.name.split("-")[1]]
    with zipfile.ZipFile(built) as archive:
        names = archive.namelist()
        (entries,) = (name for name in names if name.endswith("/entry_points.txt"))
        assert "inswsn = inswsn_book.cli:main" in archive.read(entries).decode()
    assert {name.partition("/")[0].partition("-")[0] for name in names} == {"inswsn_book"}


def test_the_wheel_holds_the_science_and_its_data(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (metadata,) = (name for name in names if name.endswith("/METADATA"))
        needs = re.findall(r"^Requires-Dist: ([\w-]+)(.*)$", archive.read(metadata).decode(), re.M)
    assert {"inswsn_lib/data/scenarios/p1.yaml", "inswsn_lib/data/examples/ins-wsn.csv"} <= {*names}
    assert not [name for name in names if "inswsn_book" in name or "chapters" in name]
    always = {name for name, rest in needs if "extra ==" not in rest}
    assert not always & ABSENT
    assert [name for name, rest in needs if "extra ==" in rest] == ["torch"]


def needed(requirements: Iterable[str]) -> set[str]:
    """Return the distributions that requirements bring, with what those need in turn."""
    found: set[str] = set()
    waiting = [Requirement(text) for text in requirements]
    while waiting:
        asked = waiting.pop()
        name = canonicalize_name(asked.name)
        if name not in found and (asked.marker is None or asked.marker.evaluate({"extra": ""})):
            found.add(name)
            waiting += map(Requirement, distribution(name).requires or [])
    return found


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of an environment that has the wheel, what it says it needs, and no more."""
    folder = tmp_path_factory.mktemp("alone") / "environment"
    EnvBuilder(symlinks=True).create(folder)
    interpreter = folder / "bin" / "python"
    (packages,) = folder.glob("lib/python*/site-packages")
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith("/METADATA"))
        requirements = re.findall(r"^Requires-Dist: (.*)$", archive.read(name).decode(), re.M)
    for name in needed(requirements):
        installed = distribution(name)
        for top in {file.parts[0] for file in installed.files or []} - {"..", "__pycache__"}:
            if not (packages / top).exists():  # the packages of the lock, where they lie
                (packages / top).symlink_to(str(installed.locate_file(top)))
    install = ["install", "--quiet", "--no-deps", "--no-index", str(wheel)]
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", str(interpreter), *install], check=True
    )
    return interpreter


def run(python: Path, script: str, folder: Path) -> str:
    (folder / "script.py").write_text(script, encoding="utf-8")
    done = subprocess.run(
        [str(python), "-I", "script.py"], capture_output=True, text=True, check=False, cwd=folder
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.long
def test_the_science_is_imported_without_the_machinery(python: Path, tmp_path: Path) -> None:
    look = "import importlib.util\nprint([n for n in {!r} if importlib.util.find_spec(n)])"
    assert run(python, look.format(sorted({*ABSENT, "inswsn_book"})), tmp_path) == "[]\n"
    run(python, IMPORT_ALL, tmp_path)


@pytest.mark.long
def test_the_example_of_the_readme_runs_alone(python: Path, root: Path, tmp_path: Path) -> None:
    """A Kalman filter and an H-infinity design on the recording that the wheel carries."""
    readme = (root / "README.md").read_text(encoding="utf-8")
    (script,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    assert len([line for line in script.splitlines() if line and "import" not in line]) <= 10
    said = run(python, script, tmp_path)
    kalman, hinfinity = map(float, re.findall(r"(\d+\.\d+) m", said))
    assert 0 < kalman < 0.2  # the errors of the fixes have 0.2 m
    assert 0 < hinfinity < 1
