"""What must hold of the repository as a whole."""

from __future__ import annotations

import inspect
import json
import re
import shutil
import subprocess
import sys
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from types import ModuleType

import pytest
import yaml
from inswsn_book.make.archive import SITE_PACKAGES
from inswsn_book.record.project import Project
from inswsn_book.run.store import book_runs
from jsonschema import Draft7Validator
from pybtex.database import parse_file
from threadpoolctl import threadpool_info

import inswsn_lib
from inswsn_lib.logs.registry import KNOWN

ROOMS = [
    face for name in inswsn_lib.__all__ if hasattr(face := getattr(inswsn_lib, name), "__path__")
]


@pytest.fixture(scope="module")
def tracked(root: Path) -> dict[str, bytes]:
    """The project's own files, by their paths."""
    words = ["git", "-C", str(root), "ls-files", "-co", "--exclude-standard"]
    if (
        shutil.which("git") is None
        or subprocess.run(words, capture_output=True, check=False).returncode
    ):
        pytest.skip("Not a git checkout, so there is no list of the project's own files.")
    names = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
    return {name: (root / name).read_bytes() for name in names if (root / name).is_file()}


def test_no_path_of_a_machine_and_no_registry_host(tracked: dict[str, bytes]) -> None:
    # written in parts, so that this file does not find itself
    forbidden = (b"py" + b"pi.org", b"python" + b"hosted.org", b"/ro" + b"ot/", b"/ho" + b"me/",
                 b"npm" + b"js.org")  # fmt: skip
    found = [f"{name}: {word!r}" for name, text in tracked.items() for word in forbidden
             if word in text]  # fmt: skip
    assert found == []


def test_nothing_heavy_and_no_recording_is_kept(tracked: dict[str, bytes], root: Path) -> None:
    """A recording is known by the digests of THIRD-PARTY.md, whatever it is called."""
    assert [name for name, content in tracked.items() if len(content) > 400_000] == []
    text = (root / "THIRD-PARTY.md").read_text(encoding="utf-8")
    others = set(re.findall(r"\b[0-9a-f]{64}\b", text))
    assert others
    assert [name for name, c in tracked.items() if sha256(c).hexdigest() in others] == []


def test_no_page_has_what_changes_from_run_to_run(project: Project, built_site: Path) -> None:
    """A warning on standard error, or an address in memory, in the output of a cell."""
    for run in book_runs(project):
        for cell in json.loads(run.notebook or "{}")["cells"]:
            for output in cell.get("outputs", []):
                assert output.get("name") != "stderr", cell["id"]
                shown = [output.get("text", ""), *output.get("data", {}).values()]
                words = " ".join("".join(part) for part in shown if isinstance(part, str | list))
                assert not re.search(r"\bat 0x[0-9a-f]{6,}", words), cell["id"]


def test_the_tests_compute_with_one_thread_a_process() -> None:
    """The library is imported, and with it numpy and scipy."""
    assert {entry["num_threads"] for entry in threadpool_info()} == {1}


def test_the_first_screen_of_the_readme_has_the_two_commands(root: Path) -> None:
    first_screen = "\n".join((root / "README.md").read_text(encoding="utf-8").splitlines()[:24])
    for command in ("make book", "make test"):
        assert re.search(rf"^\s*{command}\b", first_screen, re.MULTILINE), command


def test_the_two_routes_without_make_agree(root: Path) -> None:
    def steps(name: str) -> list[str]:
        text = (root / name).read_text(encoding="utf-8").split("# Without make\n")[1]
        return re.findall(r"^\S*python\S* -m .*$", text.split("```")[1], re.MULTILINE)

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


# the official schema of version 1.2.0, which check-jsonschema brings
SCHEMA = files("check_jsonschema") / "builtin_schemas" / "vendor" / "citation-file-format.json"


def test_the_citation_is_valid_and_cites_the_papers_as_the_bibliography_does(root: Path) -> None:
    said = yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))
    schema = Draft7Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))
    assert list(schema.iter_errors(said)) == []
    assert list(schema.iter_errors(said | {"license": "mine"})) != []
    entries = parse_file(str(root / "book" / "references.bib"), "bibtex").entries
    papers = [entries[k].fields for k in ("xu2012ins", "li2012distributed", "li2015hybrid")]
    assert [(r["doi"], str(r["year"])) for r in said["references"]] == [
        (paper["doi"], paper["year"]) for paper in papers
    ]


def test_what_belongs_to_others_is_named(root: Path) -> None:
    text = (root / "THIRD-PARTY.md").read_text(encoding="utf-8")
    said = yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))
    for word in (
        *(paper["doi"] for paper in said["references"]),
        *(digest for known in KNOWN.values() for digest in known.digests.values()),
        *(package for package in SITE_PACKAGES if package != "packaging"),
    ):
        assert word in text, word


@pytest.mark.long
def test_mypy_has_nothing_to_say(root: Path) -> None:
    """It takes one processor for a minute; here the other goes on with tests."""
    done = subprocess.run(
        [sys.executable, "-m", "mypy"], cwd=root, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
