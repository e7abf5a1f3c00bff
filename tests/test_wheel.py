"""The science is a wheel of its own: its example runs without the machinery."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterable, Sequence
from importlib.metadata import distribution
from pathlib import Path
from venv import EnvBuilder

import pytest
from conftest import unprivileged
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ABSENT = {"papermill", "sphinx", "click", "rich", "pydantic", "dask", "torch", "IPython"}
# each module of the science but the network's, which needs the extra
ALONE = f"""
import importlib, importlib.util, pkgutil, inswsn_lib
print([n for n in {sorted({*ABSENT, "inswsn_book"})!r} if importlib.util.find_spec(n)])
for module in pkgutil.walk_packages(inswsn_lib.__path__, "inswsn_lib."):
    if module.name != "inswsn_lib.learning.backprop":
        importlib.import_module(module.name)
"""


def build(source: Path, folder: Path) -> tuple[str, list[str], dict[str, str]]:
    """Build a wheel; return its path, the files in it, and what it says of itself."""
    command = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run(
        [sys.executable, "-m", "pip", *command, "--wheel-dir", str(folder), str(source)],
        check=True, cwd=folder,
    )  # fmt: skip
    (built,) = folder.glob("*.whl")
    with zipfile.ZipFile(built) as archive:
        names = archive.namelist()
        own = [name for name in names if ".dist-info/" in name]
        return str(built), names, {Path(name).name: archive.read(name).decode() for name in own}


@pytest.fixture(scope="module")
def wheel(
    root: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, list[str], dict[str, str]]:
    return build(root, tmp_path_factory.mktemp("wheel"))


def test_the_machinery_is_a_wheel_of_its_own(
    wheel: tuple[str, list[str], dict[str, str]], root: Path, tmp_path: Path
) -> None:
    """It has the version of the science and brings the command."""
    _, names, says = build(root / "book", tmp_path)
    assert "inswsn = inswsn_book.__main__:main" in says["entry_points.txt"]
    assert {name.partition("/")[0].partition("-")[0] for name in names} == {"inswsn_book"}
    version = re.compile(r"^Version: (.*)$", re.M)
    assert version.findall(says["METADATA"]) == version.findall(wheel[2]["METADATA"])


def test_the_wheel_holds_science_and_data(wheel: tuple[str, list[str], dict[str, str]]) -> None:
    _, names, says = wheel
    data = ("data/scenarios/p1.yaml", "data/examples/ins-wsn.csv", "logs/known.yaml")
    assert {f"inswsn_lib/{name}" for name in (*data, "logs/words.yaml")} <= {*names}
    assert not [name for name in names if "inswsn_book" in name or "chapters" in name]
    needs = re.findall(r"^Requires-Dist: ([\w-]+)(.*)$", says["METADATA"], re.M)
    assert not {name for name, rest in needs if "extra ==" not in rest} & ABSENT
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


@pytest.mark.whole
@pytest.mark.long
def test_the_example_of_the_readme_runs_by_the_science_alone(
    wheel: tuple[str, list[str], dict[str, str]], root: Path, tmp_path: Path
) -> None:
    """In an environment that has the wheel, what it says it needs, and no more.

    Nothing can be written there, nor in a home folder. The ten lines need no compiler; a kernel is
    compiled nevertheless where it is asked for.
    """
    path, _, says = wheel
    EnvBuilder(symlinks=True).create(tmp_path / "environment")
    python = tmp_path / "environment" / "bin" / "python"
    (packages,) = tmp_path.glob("environment/lib/python*/site-packages")
    for name in needed(re.findall(r"^Requires-Dist: (.*)$", says["METADATA"], re.M)):
        installed = distribution(name)
        for top in {file.parts[0] for file in installed.files or []} - {"..", "__pycache__"}:
            if not (packages / top).exists():  # the packages of the lock, where they lie
                (packages / top).symlink_to(str(installed.locate_file(top)))
    install = ["--python", str(python), "install", "--quiet", "--no-deps", "--no-index", path]
    subprocess.run([sys.executable, "-m", "pip", *install], check=True)

    readme = (root / "README.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    assert len([line for line in example.splitlines() if line and "import" not in line]) <= 10
    folders = [p for p in (packages / "inswsn_lib").rglob("*") if p.is_dir()]
    for folder in (packages / "inswsn_lib", *folders):
        folder.chmod(0o555)
    nobody = unprivileged()
    surroundings = os.environ | {"HOME": "/dev/null", "INSWSN_PLAIN": ""}
    surroundings.pop("XDG_CACHE_HOME", None)

    def run(code: str, before: Sequence[str] = (), **variables: str) -> list[str]:
        done = subprocess.run(
            [*before, str(python), "-I", "-c", code], capture_output=True, text=True,
            check=False, cwd=tmp_path, env=surroundings | variables,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    said = run(example + "\nimport sys; print({'numba', 'pandas'} & sys.modules.keys())", nobody)
    assert said.pop() == "set()"
    assert run(example, nobody, INSWSN_PLAIN="0") == said
    run("from inswsn_lib import logs, vehicle; logs.load_drive, vehicle.align", nobody)
    there, *again = run(ALONE + example)
    assert (there, again) == ("[]", said)
    (shown,) = re.findall(r"```text\n(drift.*?)```", readme, re.DOTALL)
    assert said == shown.splitlines()
    # each filter is better where it is right
    fixes, kalman, worst, _, misled, careful = (float(line.split()[-2]) for line in said)
    assert kalman < worst < fixes
    assert careful < fixes < misled
