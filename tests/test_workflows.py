"""The workflow files of the public host, which cannot run here: they are checked by linters.

The usual linter, actionlint, is not in the lock: its package fetches it from the public host while
it is installed. So the form is checked by the schema that check-jsonschema carries, what is
unsafe by zizmor without the network, and the lines of shell by shellcheck. On the public host
`make actionlint` installs and runs it.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from inswsn_book.record.project import Project
from packaging.specifiers import SpecifierSet

PYTHON = "3.11"
BIN = Path(sys.executable).parent
#: What sets a job up, or hands files over: the only steps that are no target and not the script.
ACTIONS = {
    *("actions/checkout", "actions/setup-python", "actions/upload-artifact"),
    *("actions/download-artifact", "actions/upload-pages-artifact", "actions/deploy-pages"),
}
FOLDER = Path(".github") / "workflows"
GITHUB = "vendor.github-workflows"


@pytest.fixture(scope="module")
def texts(root: Path) -> dict[str, str]:
    found = {path.stem: path.read_text("utf-8") for path in (root / FOLDER).glob("*.yml")}
    assert set(found) == {"ci", "release", "weekly"}
    return found


@pytest.fixture(scope="module")
def workflows(texts: dict[str, str]) -> dict[str, Any]:
    # YAML 1.1 reads the key `on` as true; BaseLoader leaves words as they are
    return {name: yaml.load(text, Loader=yaml.BaseLoader) for name, text in texts.items()}


@pytest.fixture(scope="module")
def steps(workflows: dict[str, Any]) -> list[dict[str, Any]]:
    jobs = [job for workflow in workflows.values() for job in workflow["jobs"].values()]
    return [step for job in jobs for step in job["steps"]]


def lint(*words: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, check=False, **options)


def own(name: str) -> str:
    """Return a linter of the environment that runs the tests."""
    path = shutil.which(name, path=str(BIN))
    assert path is not None, f"{name} is in the lock and not in {BIN}"
    return path


# Their form --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("schema", "pattern"),
    [(GITHUB, f"{FOLDER}/*.yml"), ("vendor.dependabot", ".github/dependabot.yml")],
)
def test_the_form(root: Path, tmp_path: Path, schema: str, pattern: str) -> None:
    files, broken = list(root.glob(pattern)), tmp_path / "broken.yml"
    assert files
    broken.write_text(re.sub("runs-on:|schedule:", "runs_on:", files[0].read_text()))
    for paths, wrong in ((files, False), ([broken], True)):
        words = ("--builtin-schema", schema, *map(str, paths))
        done = lint(own("check-jsonschema"), *words)
        assert bool(done.returncode) is wrong, done.stdout + done.stderr


ZIZMOR = ("--offline", "--no-progress", "--persona", "pedantic")


def test_nothing_unsafe(root: Path) -> None:
    done = lint(own("zizmor"), *ZIZMOR, str(root / ".github"))
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        (r"with:\n *persist-credentials: false", "", "artipacked"),
        ("run: make tag", "run: make tag TAG=${{ github.ref_name }}", "template-injection"),
        (r"@[0-9a-f]{40} #.*", "@v6", "unpinned-uses"),
        (r"permissions: \{\}", "permissions: write-all", "excessive-permissions"),
    ],
)
def test_what_is_unsafe_is_found(
    texts: dict[str, str], tmp_path: Path, old: str, new: str, finding: str
) -> None:
    text, count = re.subn(old, new, texts["release"])
    assert count
    (tmp_path / FOLDER).mkdir(parents=True)
    (tmp_path / FOLDER / "release.yml").write_text(text)
    done = lint(own("zizmor"), *ZIZMOR, str(tmp_path / ".github"))
    assert done.returncode != 0
    assert finding in done.stdout


def test_the_scripts(root: Path) -> None:
    """The lines that workflows run are names of them, or targets of make, see below."""
    there = (root / ".ci").iterdir()  # and what Python keeps of its modules
    scripts = [path for path in there if path.is_file() and path.suffix == ""]
    assert len(scripts) == 4
    done = lint(own("shellcheck"), *map(str, scripts), str(root / "binder" / "postBuild"))
    assert done.returncode == 0, done.stdout


# What they run -----------------------------------------------------------------------------------


def test_each_step_is_a_make_target_or_the_script(root: Path, steps: list[dict[str, Any]]) -> None:
    makefile = (root / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z]+):(?!=)", makefile, re.MULTILINE))
    script = re.findall(r"^make ([a-z]+)", (root / ".ci/run").read_text(), re.MULTILINE)
    assert script == ["environment", "book", "test"]
    runs = {step["run"] for step in steps if "run" in step}
    called = {run.removeprefix("make ") for run in runs - {".ci/run"}}
    assert {*called, *script} <= targets
    assert len(called) > 7
    for target in called:  # make reads the whole file, and runs nothing
        done = lint("make", "-n", target, "TAG=v1.0.0", cwd=root)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("tag", ["v1$(touch owned)", "v1; touch owned", "v0.0.1", "", None])
def test_a_tag_that_is_not_the_version_is_refused(
    root: Path, texts: dict[str, str], workflows: dict[str, Any], tag: str | None
) -> None:
    """What a tag holds is never a line of shell."""
    own = f"v{Project(root).about()['version']}"
    environment = {"TAG": own if tag is None else tag, "PATH": "/usr/bin:/bin"}
    done = lint("make", "-s", "tag", cwd=root, env=environment)
    if tag is None:
        assert (done.returncode, done.stderr) == (0, "")
        # and that of this version would start a release
        assert workflows["release"]["on"] == {"push": {"tags": ["v*"]}}
        return
    assert done.returncode == 2
    assert f", not '{tag}'." in done.stderr
    assert not (root / "owned").exists()


def test_one_python_and_one_commit_of_each_action(
    root: Path, texts: dict[str, str], workflows: dict[str, Any], steps: list[dict[str, Any]]
) -> None:
    used = [step for step in steps if "uses" in step]
    asked = {step["with"]["python-version"] for step in used if "setup-python@" in step["uses"]}
    assert asked == {PYTHON, "${{ matrix.python }}"}
    pyproject = (root / "pyproject.toml").read_text()
    others = workflows["weekly"]["jobs"]["pythons"]["strategy"]["matrix"]["python"]
    said = re.findall(r"Python :: (3\.\d+)", pyproject)
    assert [PYTHON, *others] == said
    (allowed,) = re.findall(r'^requires-python = "(.*)"$', pyproject, re.MULTILINE)
    assert SpecifierSet(allowed).contains(PYTHON)
    assert f'target-version = "py{PYTHON.replace(".", "")}"' in pyproject
    pins = {tuple(step["uses"].split("@")) for step in used}
    assert len(pins) == len({name for name, _ in pins})
    assert {name for name, _ in pins} == ACTIONS
    lines = [line for text in texts.values() for line in text.splitlines() if "uses:" in line]
    assert [x for x in lines if not re.search(r"@[0-9a-f]{40} # v\d+\.\d+\.\d+$", x)] == []


def test_every_job_ends_and_has_its_own_rights(workflows: dict[str, Any]) -> None:
    writing = {}
    for file, workflow in workflows.items():
        assert workflow["permissions"] == {}
        assert "concurrency" in workflow
        for name, job in workflow["jobs"].items():
            assert int(job["timeout-minutes"]) <= 120
            rights = {right for right, how in job["permissions"].items() if how == "write"}
            if rights:
                writing[f"{file}: {name}"] = rights
    assert writing == {
        "release: pages": {"pages", "id-token"},
        "release: release": {"contents"},
        "weekly: report": {"issues"},
    }
