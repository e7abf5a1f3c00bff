"""What must hold of the repository as a whole."""

from __future__ import annotations

import inspect
import json
import re
import shutil
import subprocess
from hashlib import sha256
from pathlib import Path
from types import ModuleType

import pytest
from inswsn_book.project import Project
from inswsn_book.runs import book_runs
from threadpoolctl import threadpool_info

import inswsn_lib

ROOMS = [
    face for name in inswsn_lib.__all__ if hasattr(face := getattr(inswsn_lib, name), "__path__")
]


@pytest.fixture(scope="module")
def tracked(root: Path) -> list[Path]:
    if shutil.which("git") is None:
        pytest.skip("There is no git here, so there is no list of the project's own files.")
    done = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        pytest.skip("Not a git checkout, so there is no list of the project's own files.")
    return [root / name for name in done.stdout.splitlines() if (root / name).is_file()]


def test_no_path_of_a_machine_and_no_registry_host(tracked: list[Path], root: Path) -> None:
    # written in parts, so that this file does not find itself
    forbidden = [
        "py" + "pi.org",
        "python" + "hosted.org",
        "/ro" + "ot/",
        "/ho" + "me/",
        "npm" + "js.org",
    ]
    found = [
        f"{path.relative_to(root)}: {word}"
        for path in tracked
        for word in forbidden
        if word in path.read_text(encoding="utf-8", errors="ignore")
    ]
    assert found == []


def test_nothing_heavy_is_kept(tracked: list[Path], root: Path) -> None:
    heavy = [p.relative_to(root).as_posix() for p in tracked if p.stat().st_size > 400_000]
    assert heavy == []


def test_no_recording_of_others_is_kept(tracked: list[Path], root: Path) -> None:
    """Whatever it is called: by the digests of THIRD-PARTY.md."""
    text = (root / "THIRD-PARTY.md").read_text(encoding="utf-8")
    others = set(re.findall(r"\b[0-9a-f]{64}\b", text))
    assert others
    assert [path for path in tracked if sha256(path.read_bytes()).hexdigest() in others] == []


def test_no_page_has_what_changes_from_run_to_run(root: Path, built_site: Path) -> None:
    """A warning on standard error, or an address in memory, in the output of a cell."""
    for run in book_runs(Project(root)):
        for cell in json.loads(run.notebook or "{}")["cells"]:
            for output in cell.get("outputs", []):
                assert output.get("name") != "stderr", cell["id"]
                shown = [output.get("text", ""), *output.get("data", {}).values()]
                words = " ".join("".join(part) for part in shown if isinstance(part, str | list))
                assert not re.search(r"\bat 0x[0-9a-f]{6,}", words), cell["id"]


def test_the_tests_compute_with_one_thread_a_process() -> None:
    """The library is imported, and with it numpy and scipy."""
    threads = {entry["num_threads"] for entry in threadpool_info()}
    assert threads == {1}


def test_the_first_screen_of_the_readme_has_the_two_commands(root: Path) -> None:
    first_screen = "\n".join((root / "README.md").read_text(encoding="utf-8").splitlines()[:24])
    for command in ("make book", "make test"):
        assert re.search(rf"^\s*{command}\b", first_screen, re.MULTILINE), command


def test_the_two_routes_without_make_agree(root: Path) -> None:
    def steps(name: str) -> list[str]:
        text = (root / name).read_text(encoding="utf-8")
        return re.findall(r"^(?:python3\.11|\.venv/bin/python) -m .*$", text, re.MULTILINE)

    assert len(steps("README.md")) >= 6
    assert set(steps("book/reproduce.md")) == set(steps("README.md"))


@pytest.mark.parametrize("room", ROOMS, ids=lambda m: m.__name__)
def test_public_functions_say_what_they_take(room: ModuleType) -> None:
    functions = [f for f in map(room.__dict__.get, room.__all__) if inspect.isfunction(f)]
    short = [
        f.__name__
        for f in functions
        if len(inspect.signature(f).parameters) > 1
        and "Parameters\n----------" not in (inspect.getdoc(f) or "")
    ]
    assert short == []


def test_the_reference_page_has_every_public_name(built_site: Path) -> None:
    page = (built_site / "api.html").read_text(encoding="utf-8")
    names = [f"{room.__name__}.{name}" for room in ROOMS for name in room.__all__]
    missing = [
        name
        for name in names
        if not re.search(rf'id="inswsn_lib\.([\w.]*\.)?{name.rsplit(".", 1)[1]}"', page)
    ]
    assert missing == []
