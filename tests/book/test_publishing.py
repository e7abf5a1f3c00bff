"""The reference results: a fresh build agrees with them, and only `publish` changes them."""

from __future__ import annotations

import json
from pathlib import Path

from conftest import MiniProject, run_command
from inswsn_book.compare import changes_to_publish as changes
from inswsn_book.project import Project


def test_a_fresh_build_is_within_tolerance_of_the_reference(
    project: Project, built_site: Path
) -> None:
    assert [line for line in changes(project) if line.startswith("!")] == []


def test_publish_shows_what_changes_and_then_writes_it(mini: MiniProject) -> None:
    done = run_command(mini.root, "publish")
    assert done.returncode == 2
    assert "Chapter 00 has not been built as it is now" in done.stderr

    assert run_command(mini.root, "book").returncode == 0
    reference = mini.published / "00.json"
    done = run_command(mini.root, "publish", "--check")
    assert "! 00 twice: absent -> 42 m" in done.stdout
    assert not reference.exists()
    done = run_command(mini.root, "publish")
    assert "wrote data/published/00.json" in done.stdout
    assert json.loads(reference.read_text())["quantities"][0]["value"] == 42.0

    done = run_command(mini.root, "publish")
    assert done.stdout == ""

    # a run by hand writes to results/, and never reaches the reference
    (mini.results / "00.json").write_text("{}")
    assert run_command(mini.root, "publish", "--check").stdout == ""

    (mini.root / "data" / "papers" / "number.txt").write_text("21.2")
    assert run_command(mini.root, "book").returncode == 0
    moved, condition = changes(mini)
    assert moved == "  00 twice: 42 m -> 42.4 m (change +0.4, tolerance 0.5)"
    assert condition.startswith("! 00 data: data/papers/number.txt: ")
    assert run_command(mini.root, "publish", "--check").stdout == f"{moved}\n{condition}\n"

    # a reference of another schema is shown as all new, and replaced
    reference.write_text(
        reference.read_text().replace('"schema_version": 3', '"schema_version": 9')
    )
    assert "! 00 twice: absent -> 42.4 m" in run_command(mini.root, "publish").stdout
    assert run_command(mini.root, "publish", "--check").stdout == ""
    (mini.published / "07.json").write_text("{}")
    assert "07.json belongs to no chapter" in run_command(mini.root, "publish", "--check").stdout
