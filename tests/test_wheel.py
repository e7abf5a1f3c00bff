"""The science is a wheel of its own: its example runs without the machinery."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ABSENT = ("papermill", "sphinx", "click", "rich", "pydantic", "dask", "torch", "IPython")
# refuses what the wheel may not need, though the interpreter has it
HOOK = f"""\
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {(*ABSENT, "inswsn_book")!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Absent())
"""


@pytest.fixture(scope="module")
def wheel(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    build = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    done = subprocess.run(
        [sys.executable, "-m", "pip", *build, "--wheel-dir", str(folder), str(root)],
        capture_output=True, text=True, check=False, cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    (built,) = folder.glob("inswsn-*.whl")
    return built


def test_the_wheel_holds_the_science_and_its_data(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (metadata,) = (name for name in names if name.endswith("/METADATA"))
        needs = re.findall(r"^Requires-Dist: ([\w-]+)(.*)$", archive.read(metadata).decode(), re.M)
    assert {"inswsn_lib/data/scenarios/p1.yaml", "inswsn_lib/data/examples/ins-wsn.csv"} <= {*names}
    assert not [name for name in names if "inswsn_book" in name or "chapters" in name]
    always = {name for name, rest in needs if "extra ==" not in rest}
    assert not always & set(ABSENT)
    assert [name for name, rest in needs if "extra ==" in rest] == ["torch"]


@pytest.mark.long
def test_the_example_of_the_readme_runs_alone(wheel: Path, root: Path, tmp_path: Path) -> None:
    """A Kalman filter and an H-infinity design on the recording that the wheel carries."""
    readme = (root / "README.md").read_text(encoding="utf-8")
    (script,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    assert len([line for line in script.splitlines() if line and "import" not in line]) <= 10
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    (tmp_path / "run.py").write_text(f"{HOOK}\n{script}", encoding="utf-8")
    command = f"import sys; sys.path[:0] = [{str(tmp_path / 'installed')!r}]; import runpy; "
    done = subprocess.run(
        [sys.executable, "-c", f"{command}runpy.run_path({str(tmp_path / 'run.py')!r})"],
        capture_output=True, text=True, check=False, cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    kalman, hinfinity = map(float, re.findall(r"(\d+\.\d+) m", done.stdout))
    assert 0 < kalman < 0.2  # the errors of the fixes have 0.2 m
    assert 0 < hinfinity < 1
