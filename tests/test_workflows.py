"""The workflow files of the public host, which cannot run here: they are checked by linters.

The usual linter, actionlint, is not in the lock: its package fetches it from the public host while
it is installed. So the form is checked by the schema that check-jsonschema carries, what is
unsafe by zizmor without the network, and the lines of shell by shellcheck. Where an ``actionlint``
is on the path it is used as well; on the public host `make actionlint` installs and runs it.
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
from inswsn_book.project import Project
from packaging.specifiers import SpecifierSet

PYTHON = "3.11"

BIN = Path(sys.executable).parent
#: What sets a job up, or hands files over: the only steps that are no target and not the script.
ACTIONS = {
    "actions/checkout",
    "actions/setup-python",
    "actions/upload-artifact",
    "actions/download-artifact",
    "actions/upload-pages-artifact",
    "actions/deploy-pages",
}


def workflow_files(root: Path) -> list[Path]:
    return sorted((root / ".github" / "workflows").glob("*.yml"))


@pytest.fixture(scope="module")
def workflows(root: Path) -> dict[str, Any]:
    # YAML 1.1 reads the key `on` as true; BaseLoader leaves words as they are
    return {
        path.stem: yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.BaseLoader)
        for path in workflow_files(root)
    }


@pytest.fixture(scope="module")
def steps(workflows: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    return [
        (f"{file}: {job}", step)
        for file, workflow in workflows.items()
        for job, settings in workflow["jobs"].items()
        for step in settings["steps"]
    ]


def lint(*words: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, check=False, **options)


def own(name: str) -> str:
    """Return a linter of the environment that runs the tests."""
    path = shutil.which(name, path=str(BIN))
    assert path is not None, f"{name} is in the lock and not in {BIN}"
    return path


def test_there_are_three(workflows: dict[str, Any]) -> None:
    assert set(workflows) == {"ci", "release", "weekly"}


@pytest.mark.parametrize(
    ("schema", "pattern"),
    [
        ("vendor.github-workflows", ".github/workflows/*.yml"),
        ("vendor.dependabot", ".github/dependabot.yml"),
    ],
)
def test_the_form(root: Path, schema: str, pattern: str) -> None:
    files = [str(path) for path in root.glob(pattern)]
    assert files
    done = lint(own("check-jsonschema"), "--builtin-schema", schema, *files)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_schema_finds_what_is_wrong(root: Path, tmp_path: Path) -> None:
    broken = tmp_path / "ci.yml"
    text = (root / ".github/workflows/ci.yml").read_text()
    broken.write_text(text.replace("runs-on:", "run-on:"))
    done = lint(own("check-jsonschema"), "--builtin-schema", "vendor.github-workflows", str(broken))
    assert done.returncode == 1


def zizmor(folder: Path) -> subprocess.CompletedProcess[str]:
    words = ("--offline", "--no-progress", "--persona", "pedantic", str(folder))
    return lint(own("zizmor"), *words)


def test_nothing_unsafe(root: Path) -> None:
    done = zizmor(root / ".github")
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
    root: Path, tmp_path: Path, old: str, new: str, finding: str
) -> None:
    text, count = re.subn(old, new, (root / ".github/workflows/release.yml").read_text())
    assert count
    folder = tmp_path / ".github" / "workflows"
    folder.mkdir(parents=True)
    (folder / "release.yml").write_text(text)
    done = zizmor(tmp_path / ".github")
    assert done.returncode != 0
    assert finding in done.stdout


def test_actionlint_where_there_is_one(root: Path) -> None:
    if shutil.which("actionlint") is None:
        pytest.skip("There is no actionlint on the path; `make actionlint` installs it.")
    done = lint("actionlint", "-no-color", cwd=root)
    assert done.returncode == 0, done.stdout


def test_lines_of_shell(root: Path, steps: list[tuple[str, dict[str, Any]]]) -> None:
    """The host runs them by bash -e; what they call is checked as it stands."""
    for where, step in steps:
        if "run" in step:
            text = f"#!/usr/bin/env bash\nset -e\n{step['run']}\n"
            done = lint(own("shellcheck"), "-", input=text)
            assert done.returncode == 0, f"{where}: {done.stdout}"
    scripts = [path for path in (root / ".ci").iterdir() if path.suffix == ""]
    scripts.append(root / "binder" / "postBuild")
    assert len(scripts) == 4
    done = lint(own("shellcheck"), *map(str, scripts))
    assert done.returncode == 0, done.stdout


def targets(root: Path) -> set[str]:
    lines = (root / "Makefile").read_text(encoding="utf-8").splitlines()
    return {line.split(":")[0] for line in lines if re.match(r"[a-z]+:(?!=)", line)}


def test_each_step_is_a_make_target_or_the_script(
    root: Path, steps: list[tuple[str, dict[str, Any]]]
) -> None:
    there, called = targets(root), set()
    for where, step in steps:
        if "uses" in step:
            assert step["uses"].split("@")[0] in ACTIONS, where
            continue
        run = step["run"]
        match = re.fullmatch(r"make ([a-z]+)", run)
        assert match or run == ".ci/run", f"{where} runs {run!r}"
        if match:
            assert match[1] in there, f"{where} runs {run!r}, and the Makefile has no such target"
            called.add(match[1])
    assert {"tag", "archive", "assets", "release", "upgrade", "report", "actionlint"} <= called


def test_what_the_script_calls_is_in_the_makefile(root: Path) -> None:
    called = re.findall(r"^make ([a-z]+)", (root / ".ci/run").read_text(), re.MULTILINE)
    assert called == ["book", "test"]
    assert set(called) <= targets(root)


def test_make_prints_the_new_targets(root: Path) -> None:
    """`make -n` reads the whole Makefile and runs nothing."""
    for target in ("tag", "assets", "release", "report", "upgrade", "actionlint"):
        done = lint("make", "-n", target, "TAG=v1.0.0", cwd=root)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("tag", ["v1$(touch owned)", "v1; touch owned", "v0.0.1", ""])
def test_a_tag_that_is_not_the_version_is_refused(root: Path, tag: str) -> None:
    """What a tag holds is never a line of shell."""
    done = lint("make", "-s", "tag", cwd=root, env={"TAG": tag, "PATH": "/usr/bin:/bin"})
    assert done.returncode == 2
    assert f"TAG is '{tag}'; it may be v" in done.stderr
    assert not (root / "owned").exists()


def test_the_tag_of_the_version_is_taken(root: Path) -> None:
    tag = f"v{Project(root).about()['version']}"
    done = lint("make", "-s", "tag", cwd=root, env={"TAG": tag, "PATH": "/usr/bin:/bin"})
    assert (done.returncode, done.stderr) == (0, "")


def test_one_python_everywhere(root: Path, steps: list[tuple[str, dict[str, Any]]]) -> None:
    versions = {
        step["with"]["python-version"]
        for _, step in steps
        if step.get("uses", "").startswith("actions/setup-python@")
    }
    assert versions == {PYTHON}
    pyproject = (root / "pyproject.toml").read_text()
    allowed = re.search(r'^requires-python = "(.*)"$', pyproject, re.MULTILINE)
    assert allowed is not None
    assert SpecifierSet(allowed[1]).contains(PYTHON)
    assert f'target-version = "py{PYTHON.replace(".", "")}"' in pyproject


def test_one_commit_for_each_action(steps: list[tuple[str, dict[str, Any]]]) -> None:
    pins: dict[str, set[str]] = {}
    for _, step in steps:
        if "uses" in step:
            name, commit = step["uses"].split("@")
            assert re.fullmatch("[0-9a-f]{40}", commit)
            pins.setdefault(name, set()).add(commit)
    assert all(len(commits) == 1 for commits in pins.values())
    assert set(pins) == ACTIONS


def test_each_commit_says_its_version(root: Path) -> None:
    for path in workflow_files(root):
        for line in path.read_text().splitlines():
            if "uses:" in line:
                assert re.search(r"@[0-9a-f]{40} # v\d+\.\d+\.\d+$", line), line


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


def test_when_they_run(workflows: dict[str, Any]) -> None:
    assert set(workflows["ci"]["on"]) == {"push", "pull_request"}
    assert workflows["ci"]["on"]["push"] == {"branches": ["**"]}
    assert workflows["release"]["on"] == {"push": {"tags": ["v*"]}}
    (entry,) = workflows["weekly"]["on"]["schedule"]
    *_, day_of_month, month, weekday = entry["cron"].split()
    assert (day_of_month, month) == ("*", "*")
    assert weekday in set("0123456")


def test_the_tag_of_this_version_would_start_a_release(
    root: Path, workflows: dict[str, Any]
) -> None:
    (pattern,) = workflows["release"]["on"]["push"]["tags"]
    assert f"v{Project(root).about()['version']}".startswith(pattern.removesuffix("*"))


def names_of(job: dict[str, Any]) -> list[str]:
    return [step.get("run", step.get("uses", "")).split("@")[0] for step in job["steps"]]


def test_a_release_checks_before_it_builds_and_builds_before_it_publishes(
    workflows: dict[str, Any],
) -> None:
    jobs = workflows["release"]["jobs"]
    runs = [step["run"] for step in jobs["build"]["steps"] if "run" in step]
    assert runs == ["make tag", ".ci/run", "make archive", "make assets"]
    assert jobs["pages"]["needs"] == "build"
    assert "build" in jobs["release"]["needs"]
    handed = {
        step["uses"].split("@")[0]: step["with"]["path"]
        for step in jobs["build"]["steps"]
        if "upload" in step.get("uses", "")
    }
    assert handed == {
        "actions/upload-pages-artifact": "_build/html",
        "actions/upload-artifact": "_build/release",
    }
    # the files come back to where the script of the release looks for them
    (taken,) = [
        step["with"]
        for step in jobs["release"]["steps"]
        if "download-artifact" in step.get("uses", "")
    ]
    assert taken == {"name": "release", "path": "_build/release"}
    assert names_of(jobs["release"])[-1] == "make release"


def test_the_weekly_jobs_do_not_wait_for_each_other(workflows: dict[str, Any]) -> None:
    jobs = workflows["weekly"]["jobs"]
    assert "needs" not in jobs["locked"]
    assert "needs" not in jobs["newest"]
    assert set(jobs["report"]["needs"]) == {"locked", "newest"}
    newest = [step["run"] for step in jobs["newest"]["steps"] if "run" in step]
    assert newest == ["make upgrade", "make book", "make test"]


def test_a_cache_is_keyed_on_the_locks_and_is_in_no_release(root: Path) -> None:
    texts = {path.stem: path.read_text() for path in workflow_files(root)}
    assert "cache-dependency-path: environment*.lock" in texts["ci"]
    found = {path.name for path in root.glob("environment*.lock")}
    assert found == {"environment.lock", "environment-torch.lock"}
    for name in ("release", "weekly"):
        assert not re.search(r"^\s*cache", texts[name], re.MULTILINE)
