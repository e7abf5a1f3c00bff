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

import package_page
import pytest
from conftest import unprivileged
from inswsn_book.record.project import Project
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ABSENT = {"papermill", "sphinx", "click", "rich", "pydantic", "dask", "torch", "IPython"}
ALONE = f"""
import importlib.util
print([n for n in {sorted({*ABSENT, "inswsn_book"})!r} if importlib.util.find_spec(n)])
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
    assert all(
        f"\n{each}" in says["METADATA"] for each in ("Author: ", "Project-URL: P1", "# inswsn\n")
    )
    assert {name.partition("/")[0].partition("-")[0] for name in names} == {"inswsn_book"}
    version = re.compile(r"^Version: (.*)$", re.M)
    assert version.findall(says["METADATA"]) == version.findall(wheel[2]["METADATA"])


def test_the_wheel_holds_science_and_data(wheel: tuple[str, list[str], dict[str, str]]) -> None:
    _, names, _ = wheel
    data = ("data/scenarios/p1.yaml", "data/examples/ins-wsn.csv", "logs/known.yaml")
    assert {f"inswsn_lib/{name}" for name in (*data, "logs/words.yaml")} <= {*names}
    assert not [name for name in names if "inswsn_book" in name or "chapters" in name]
    assert "inswsn_lib/py.typed" in names


def needed(requirements: Iterable[str], *extras: str) -> set[str]:
    """Return the distributions that requirements bring, with what those need in turn."""
    found: dict[str, set[str]] = {}
    waiting = [(Requirement(text), {"", *extras}) for text in requirements]
    while waiting:
        asked, wanted = waiting.pop()
        name = canonicalize_name(asked.name)
        if asked.marker and not any(asked.marker.evaluate({"extra": extra}) for extra in wanted):
            continue
        if name not in found or not found[name] >= asked.extras:
            found[name] = found.get(name, {""}) | asked.extras
            waiting += [(Requirement(r), found[name]) for r in distribution(name).requires or []]
    return {*found}


def size(names: Iterable[str]) -> float:
    """Return the size of distributions as installed, in MB."""
    files = (path for name in names for path in distribution(name).files or [])
    paths = (Path(str(path.locate())) for path in files if "__pycache__" not in path.parts)
    return sum(path.stat().st_size for path in paths if path.is_file()) / 1e6


def environment(folder: Path, wheel: tuple[str, list[str], dict[str, str]], *extras: str) -> Path:
    """Return the Python of an environment that has the wheel, what its extras need, and no more."""
    path, _, says = wheel
    EnvBuilder(symlinks=True).create(folder)
    (packages,) = folder.glob("lib/python*/site-packages")
    for name in needed(re.findall(r"^Requires-Dist: (.*)$", says["METADATA"], re.M), *extras):
        installed = distribution(name)
        for top in {file.parts[0] for file in installed.files or []} - {"..", "__pycache__"}:
            if not (packages / top).exists():  # the packages of the lock, where they lie
                (packages / top).symlink_to(str(installed.locate_file(top)))
    python = folder / "bin" / "python"
    install = ["--python", str(python), "install", "--quiet", "--no-deps", "--no-index", path]
    subprocess.run([sys.executable, "-m", "pip", *install], check=True)
    return python


# what an extra is for, and the extra that is named where it is missing
USES = {
    "learners": "iw.LSSVMRegressor",
    "networks": "iw.BackpropRegressor",
    "speed": "from inswsn_lib.kernels.choice import _compiled as c; 1 / bool(c(*['descend'] * 2))",
    "tables": "iw.evaluation.Scores({'a': 'A'}, {'e': 'm'}, {'a.e': np.ones(40)}, 'e').table()",
    "logs": "iw.logs.report, iw.load_drive",
    "figures": "iw.plotting",
    "solvers": "iw.evaluation.drift_bound, iw.design_filter(model, solver='scs')",
}
MODEL = """
import numpy as np, inswsn_lib as iw
model = iw.ErrorModel.p1(1.0, process_noise=(0.02, 0.2), measurement_noise=(0.2, 0.1))
"""


@pytest.mark.parametrize("repository", ["", "https://code.example/a/b"])
def test_the_package_page_has_authors_and_no_link_that_leads_nowhere(
    wheel: tuple[str, list[str], dict[str, str]], root: Path, repository: str
) -> None:
    says, readme = wheel[2]["METADATA"], (root / "README.md").read_text(encoding="utf-8")
    about = Project(root).about()
    assert re.findall(r"^Author: (.*)$", says, re.M) == about["names"]
    own = {"Repository": about["repository-code"]} if about["repository-code"] else {}
    assert dict(re.findall(r"^Project-URL: (.*), (.*)$", says, re.M)) == own | {
        f"P{k}": f"https://doi.org/{paper['doi']}" for k, paper in enumerate(about["references"], 1)
    }
    shown = package_page.page(readme, repository, "1.0")
    assert shown in says or repository or own
    words, led = (re.findall(r"\[([^]]*)\]\(([^)]*)\)", text) for text in (readme, shown))
    assert len(words) > 5
    assert all(each in shown for each, _ in words)
    assert len(led) == (len(words) if repository else 0)
    assert all(to.startswith(("https:", f"{repository}/")) for _, to in led)


def test_the_core_is_ten_packages_of_350_megabytes(
    wheel: tuple[str, list[str], dict[str, str]],
) -> None:
    asked = re.findall(r"^Requires-Dist: (.*)$", wheel[2]["METADATA"], re.M)
    core = needed(asked)
    assert len(core) + 1 <= 10, core
    assert 100 < size(core) <= 350
    extras = re.findall(r"^Provides-Extra: (.*)$", wheel[2]["METADATA"], re.M)
    assert {*extras} == {*USES, "all"}
    assert needed(asked, "all") == set.union(*(needed(asked, extra) for extra in USES)) > core


@pytest.mark.whole
@pytest.mark.long
@pytest.mark.parametrize("extra", [*USES, "all"])
def test_an_extra_brings_what_its_names_need(
    wheel: tuple[str, list[str], dict[str, str]], tmp_path: Path, extra: str
) -> None:
    python = environment(tmp_path, wheel, extra)
    for use in USES.values() if extra == "all" else [USES[extra]]:
        done = subprocess.run(
            [str(python), "-I", "-c", MODEL + use],
            capture_output=True, text=True, check=False, cwd=tmp_path,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr


@pytest.mark.whole
@pytest.mark.long
def test_the_example_of_the_readme_runs_by_the_science_alone(
    wheel: tuple[str, list[str], dict[str, str]], root: Path, tmp_path: Path
) -> None:
    """In an environment that has the wheel, what it says it needs, and no more.

    Nothing can be written there, nor in a home folder. A name that needs more says which extra.
    """
    python = environment(tmp_path / "environment", wheel)
    (packages,) = tmp_path.glob("environment/lib/python*/site-packages")
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
    assert run(ALONE + example) == ["[]", *said]
    for name, use in USES.items():
        if name != "speed":  # what is not compiled is slow
            (told,) = run(f"{MODEL}try:\n    {use}\nexcept iw.MissingPackageError as e: print(e)")
            assert told.endswith(f"pip install 'inswsn[{name}]'")
    (shown,) = re.findall(r"```text\n(drift.*?)```", readme, re.DOTALL)
    assert said == shown.splitlines()
    # each filter is better where it is right
    fixes, kalman, worst, _, misled, careful = (float(line.split()[-2]) for line in said)
    assert kalman < worst < fixes
    assert careful < fixes < misled
