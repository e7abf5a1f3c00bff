"""The archive of a release: whole, the same each time, described, offline, only what is ours."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from conftest import MiniProject, build_once, run_command, shared_folder
from filelock import FileLock
from inswsn_book.about import load_about
from inswsn_book.results import read_results
from inswsn_book.third_party import licence_texts, load_third_party
from playwright.sync_api import sync_playwright
from rocrate.rocrate import ROCrate

from inswsn_lib.vehicle import recorded

IGNORED = "/_build/\n/results/\n/runs/\n/book/chapters/\n/book/generated/\n*.egg-info/\n"


def git(root: Path, *words: str) -> None:
    who = ["-c", "user.name=a", "-c", "user.email=a@b.example", "-c", "commit.gpgsign=false"]
    subprocess.run(["git", "-C", str(root), *who, *words], check=True, capture_output=True)


def commit(root: Path) -> None:
    git(root, "add", "-A")
    git(root, "commit", "-q", "-m", "all of it")


@pytest.fixture(scope="session")
def released_mini(built_mini: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small project as it is before `make archive`: published, committed, built."""
    if shutil.which("git") is None:
        pytest.skip("There is no git here, and an archive is made of what git keeps.")
    folder = shared_folder(tmp_path_factory) / "released-mini"
    with FileLock(folder.with_suffix(".made")):
        if not folder.exists():
            prepare(built_mini, folder)
    build_once(folder, folder.with_suffix(".json"))
    return folder


def prepare(built: Path, folder: Path) -> None:
    shutil.copytree(built, folder)
    project = MiniProject(folder)
    (folder / ".gitignore").write_text(IGNORED, encoding="utf-8")
    for name in ("LICENSE", "LICENSE-TEXT"):
        shutil.copy(Path(__file__).parents[2] / name, folder / name)
    script = folder / "tool.sh"
    script.write_text("#!/bin/sh\n", encoding="utf-8")
    script.chmod(0o775)
    project.page("# Mini\n\nA page with $x^2$ and a nightingale.\n")
    # a recording that lies beside the sources, as INSWSN_DATA may name it
    beside = folder / "runs" / "rtklibexplorer__GNSS_IMU" / "imu_1934.csv"
    beside.parent.mkdir(parents=True)
    beside.write_text("1,2,3\n", encoding="utf-8")
    for command in ("citation", "publish"):
        assert run_command(folder, command).returncode == 0
    git(folder, "init", "-q")
    commit(folder)


@pytest.fixture
def released(released_mini: Path, tmp_path: Path) -> MiniProject:
    """A copy of it that a test may break."""
    shutil.copytree(released_mini, tmp_path / "mini", symlinks=True)
    return MiniProject(tmp_path / "mini")


@pytest.fixture(scope="session")
def archived(released_mini: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its archive."""
    target = shared_folder(tmp_path_factory) / "released-mini.zip"
    with FileLock(target.with_suffix(".lock")):
        if not target.exists():
            done = run_command(released_mini, "archive", "--output", str(target))
            assert done.returncode == 0, done.stderr
            assert done.stdout.startswith(f"wrote {target}")
    return target


@pytest.fixture(scope="session")
def unpacked(archived: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(archived) as archive:
        archive.extractall(folder)
    return folder


@pytest.fixture(scope="session")
def graph(unpacked: Path) -> dict[str, dict[str, Any]]:
    """The entities of the description by their ids."""
    crate = json.loads((unpacked / "ro-crate-metadata.json").read_text(encoding="utf-8"))
    assert crate["@context"] == "https://w3id.org/ro/crate/1.1/context"
    entities = {entity["@id"]: entity for entity in crate["@graph"]}
    assert len(entities) == len(crate["@graph"])
    return entities


def test_two_archives_of_one_build_are_the_same(
    released: MiniProject, archived: Path, tmp_path: Path
) -> None:
    """From another folder, with other times and another order of writing."""
    for path in released.root.rglob("*"):
        os.utime(path, (1_000_000_000, 1_000_000_000))
    git(released.root, "status")
    done = run_command(released.root, "archive")
    assert done.returncode == 0, done.stderr
    again = released.build / f"inswsn-{load_about(released.root).version}.zip"
    assert again.read_bytes() == archived.read_bytes()
    assert [path.name for path in released.build.glob(".inswsn*")] == []


def test_times_and_modes_are_fixed(archived: Path, released_mini: Path) -> None:
    about = load_about(released_mini)
    with zipfile.ZipFile(archived) as archive:
        entries = archive.infolist()
    names = [entry.filename for entry in entries]
    assert names == sorted(names)
    day = datetime.fromisoformat(about.released)
    assert {entry.date_time for entry in entries} == {day.timetuple()[:6]}
    modes = {entry.filename: entry.external_attr >> 16 for entry in entries}
    assert modes.pop("tool.sh") == 0o100755
    assert set(modes.values()) == {0o100644}


def test_a_time_can_be_given(released: MiniProject, tmp_path: Path) -> None:
    target = tmp_path / "a.zip"
    environment = os.environ | {"SOURCE_DATE_EPOCH": "1700000000"}
    words = ("archive", "--output", str(target))
    assert run_command(released.root, *words, env=environment).returncode == 0
    with zipfile.ZipFile(target) as archive:
        times = {entry.date_time for entry in archive.infolist()}
    assert times == {(2023, 11, 14, 22, 13, 20)}
    for wrong in ("soon", "-1", "9" * 30):
        target.unlink(missing_ok=True)
        done = run_command(released.root, *words, env=environment | {"SOURCE_DATE_EPOCH": wrong})
        assert done.returncode == 2
        assert done.stderr == (
            f"inswsn: SOURCE_DATE_EPOCH is {wrong!r}; it may be a time from 1980 to 2107 in "
            "seconds since 1970.\n"
        )
        assert not target.exists()


def test_it_holds_sources_site_notebooks_results_and_verdicts(
    unpacked: Path, released_mini: Path
) -> None:
    tracked = subprocess.run(
        ["git", "-C", str(released_mini), "ls-files"], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    for name in tracked:
        assert (unpacked / name).read_bytes() == (released_mini / name).read_bytes(), name
    notebook = json.loads((unpacked / "executed" / "00-mini.ipynb").read_text(encoding="utf-8"))
    assert any(cell.get("outputs") for cell in notebook["cells"])
    results = read_results(unpacked / "results" / "00.json")
    assert results.parameters == {"scale": 2.0}
    assert results.provenance is not None
    (verdict, other) = json.loads((unpacked / "verdicts.json").read_text(encoding="utf-8"))
    assert (verdict["id"], verdict["verdict"]) == ("P1-M-twice", "reproduced")
    assert other["verdict"] == "cannot be tested"
    assert "nightingale" in (unpacked / "site" / "index.html").read_text(encoding="utf-8")
    for name in ("environment.lock", "environment-torch.lock", "LICENSE", "CITATION.cff"):
        assert (unpacked / name).is_file()


def test_the_sums_are_those_of_all_other_files(unpacked: Path) -> None:
    lines = (unpacked / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    said = {name: digest for digest, name in (line.split("  ", 1) for line in lines)}
    there = {
        path.relative_to(unpacked).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in unpacked.rglob("*")
        if path.is_file() and path.name != "SHA256SUMS"
    }
    assert said == there


def test_nothing_of_others_is_in_it(unpacked: Path) -> None:
    names = [path.relative_to(unpacked).as_posix() for path in unpacked.rglob("*")]
    assert [name for name in names if "imu_1934" in name or name.startswith("runs")] == []
    # and no note of the build to itself
    assert [name for name in names if ".inswsn" in name or ".buildinfo" in name] == []


def test_a_recording_that_was_committed_is_refused(released: MiniProject) -> None:
    known = b"a recording"
    path = released.root / "data" / "third-party.yaml"
    text = path.read_text(encoding="utf-8")
    digest = hashlib.sha256(known).hexdigest()
    path.write_text(re.sub(r"(imu_1934\.csv: )\w+", rf"\g<1>{digest}", text), encoding="utf-8")
    (released.root / "data" / "mine.csv").write_bytes(known)
    commit(released.root)
    done = run_command(released.root, "archive")
    assert done.returncode == 2
    assert done.stderr == (
        "inswsn: data/mine.csv is a file of drive_0708 of rtklibexplorer/GNSS_IMU, which is not "
        "ours to give; remove it from git.\n"
    )


def test_the_digests_of_recordings_are_those_of_the_code_that_reads_them(root: Path) -> None:
    third_party = load_third_party(root)
    files = {name: digest for r in third_party.recorded for name, digest in r.files.items()}
    assert recorded._DIGESTS.items() <= files.items()
    addresses = [recording.address for recording in third_party.recorded]
    place = f"{recorded._OWNER}/{recorded._REPOSITORY}/tree/{recorded._COMMIT}/{recorded._FOLDER}"
    assert any(address.endswith(place) for address in addresses)


def test_every_kept_result_of_a_recording_names_it(root: Path) -> None:
    named = {name for r in load_third_party(root).recorded for name in r.results}
    kept = {f"data/recorded/{path.name}" for path in (root / "data" / "recorded").iterdir()}
    assert kept <= named
    assert all((root / name).is_file() for name in named)


def test_whatever_the_programs_put_into_the_site_has_its_licence(
    unpacked: Path, root: Path
) -> None:
    third_party = load_third_party(root)
    named = {name for part in third_party.site for name in part.files}
    own = {path.name for path in (root / "book" / "_static").iterdir()}
    there = {
        re.sub(r"\.[0-9a-f]{64}\.", ".", path.name)
        for path in (unpacked / "site" / "_static").iterdir()
    }
    assert there - own - named == set()
    for name, text in licence_texts(third_party).items():
        assert (unpacked / "licences" / name).read_text(encoding="utf-8") == text
        assert len(text) > 200


def test_the_description_can_be_read_and_names_files_that_are_there(
    archived: Path, unpacked: Path, graph: dict[str, dict[str, Any]]
) -> None:
    crate = ROCrate(archived)
    assert crate.root_dataset["license"]
    parts = [part["@id"] for part in graph["./"]["hasPart"]]
    for name in parts:
        assert (unpacked / name).exists(), name
    described = {entity for entity in graph if not entity.startswith(("#", "http"))}
    assert described - {"./", "ro-crate-metadata.json"} == set(parts)
    for name in ("site/", "executed/00-mini.ipynb", "results/00.json", "environment.lock"):
        assert name in parts


def test_every_reference_in_it_leads_somewhere(graph: dict[str, dict[str, Any]]) -> None:
    for entity in graph.values():
        for key, value in entity.items():
            for target in references(value):
                if not target.startswith(("http://schema.org/", "https://w3id.org/ro/crate/")):
                    assert target in graph, f"{entity['@id']}: {key}"


def references(value: Any) -> Iterator[str]:
    for part in value if isinstance(value, list) else [value]:
        if isinstance(part, dict):
            yield part["@id"]


def test_nothing_in_it_is_random(graph: dict[str, dict[str, Any]]) -> None:
    for identity in graph:
        assert not re.search(r"[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-", identity), identity


def test_it_agrees_with_the_one_source(
    released_mini: Path, graph: dict[str, dict[str, Any]]
) -> None:
    about = load_about(released_mini)
    crate = graph["./"]
    assert crate["name"] == about.title
    assert crate["description"] == about.abstract
    assert crate["datePublished"] == about.released
    assert crate["version"] == about.version
    licences = [graph[entry["@id"]]["identifier"] for entry in crate["license"]]
    assert licences == [about.licences.code, about.licences.text]
    authors = [graph[entry["@id"]]["name"] for entry in crate["author"]]
    assert authors == [author.shown for author in about.authors]
    articles = [graph[entry["@id"]] for entry in crate["citation"]]
    assert {article["@type"] for article in articles} == {"ScholarlyArticle"}
    assert [article["alternateName"] for article in articles] == ["P1", "P2", "P3"]
    assert articles[0]["@id"] == "https://doi.org/10.1155/2012/707326"
    assert graph[articles[0]["author"][0]["@id"]]["familyName"] == "Xu"


def test_a_run_links_what_it_was_made_from_and_what_it_made(
    unpacked: Path, graph: dict[str, dict[str, Any]]
) -> None:
    made = read_results(unpacked / "results" / "00.json").provenance
    assert made is not None
    (mention,) = graph["./"]["mentions"]
    run = graph[mention["@id"]]
    assert run["@type"] == "CreateAction"
    source, library = (graph[entry["@id"]] for entry in run["instrument"])
    assert source["@id"] == "chapters/00-mini.md"
    assert source["name"] == "A small chapter"
    assert "SoftwareSourceCode" in source["@type"]
    assert library["softwareVersion"] == made.version
    used = [graph[entry["@id"]] for entry in run["object"]]
    (parameter,) = (entity for entity in used if entity["@type"] == "PropertyValue")
    assert (parameter["name"], parameter["value"]) == ("scale", 2.0)
    assert {"data/papers/number.txt", "environment.lock"} <= {entity["@id"] for entity in used}
    assert {entry["@id"] for entry in run["result"]} == {
        "executed/00-mini.ipynb",
        "results/00.json",
    }
    ended = datetime.fromisoformat(run["endTime"])
    assert ended.strftime("%Y-%m-%d %H:%M UTC") == made.finished
    began = datetime.fromisoformat(run["startTime"])
    assert (ended - began).total_seconds() == round(made.seconds)


def test_what_is_not_a_release_is_refused(released: MiniProject, tmp_path: Path) -> None:
    target = tmp_path / "a.zip"

    def refused() -> str:
        done = run_command(released.root, "archive", "--output", str(target))
        assert done.returncode == 2
        assert not target.exists()
        assert done.stderr.count("\n") == 1
        return str(done.stderr)

    (released.root / "new.txt").write_text("x", encoding="utf-8")
    assert "changes that are not committed" in refused()
    commit(released.root)
    # the commit stands at the foot of every page
    assert "not up to date; build it again: make book" in refused()

    ledger = released.root / "data" / "claims.yaml"
    text = ledger.read_text(encoding="utf-8")
    ledger.write_text(text.replace("P2-M-lost", "P2-M-other"), encoding="utf-8")
    commit(released.root)
    assert "has no claim P2-M-lost, which has been published" in refused()
    more = text[text.index("- id: P2-M-lost") :].replace("P2-M-lost", "P2-M-other")
    ledger.write_text(text + more, encoding="utf-8")
    commit(released.root)
    assert "data/claim-ids.txt lacks P2-M-other" in refused()
    ledger.write_text(text, encoding="utf-8")

    (released.root / "CITATION.cff").write_text("", encoding="utf-8")
    commit(released.root)
    assert "CITATION.cff differs from what data/about.yaml says" in refused()
    assert run_command(released.root, "citation").returncode == 0

    (released.root / "data" / "papers" / "number.txt").write_text("22", encoding="utf-8")
    commit(released.root)
    assert "Chapter 00 has not been built as it is now; build it first: make book" in refused()

    shutil.rmtree(released.site)
    (released.root / "data" / "papers" / "number.txt").write_text("21", encoding="utf-8")
    commit(released.root)
    assert "There is no built book" in refused()

    shutil.rmtree(released.root / ".git")
    assert "is not a git checkout" in refused()


@pytest.mark.page
def test_it_opens_without_a_network_and_without_a_server(chromium: str, unpacked: Path) -> None:
    flags = ["--disable-gpu", "--disable-background-networking", "--no-first-run"]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        flags.append("--no-sandbox")
    asked: list[str] = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=flags)
        page = browser.new_context(offline=True).new_page()
        page.on("request", lambda request: asked.append(request.url))
        page.goto((unpacked / "index.html").as_uri())
        page.wait_for_url("**/site/index.html")
        page.wait_for_selector("mjx-container")
        assert "nightingale" in page.inner_text("main")
        page.goto(f"{(unpacked / 'site' / 'search.html').as_uri()}?q=nightingale")
        page.wait_for_selector("#search-results li")
        assert "Mini" in page.inner_text("#search-results")
        browser.close()
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []


def test_the_unpacked_archive_is_a_checkout(unpacked: Path) -> None:
    done = run_command(unpacked, "chapters")
    assert done.returncode == 0, done.stderr
    assert "scale = 2.0" in done.stdout
