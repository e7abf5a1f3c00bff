"""What makes a chapter due again, and what does not."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from inswsn_book.cache import chapter_key, lookup, store
from inswsn_book.files import file_digest
from inswsn_book.project import Project
from inswsn_book.results import Results

from inswsn_lib.files import DATA_VARIABLE


@pytest.fixture
def library(mini: Project, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = mini.root / "inswsn_lib" / "a.py"
    path.parent.mkdir()
    path.write_text("x = 1\n")
    (path.parent / "artefact").mkdir()
    for name in ("worker.py", "rendering.py"):
        (path.parent / "artefact" / name).write_text("x = 1\n")
    monkeypatch.setattr(Project, "library", path.parent)
    return path


def append(name: str) -> Callable[[Path], None]:
    def change(root: Path) -> None:
        path = root / name
        path.write_text(path.read_text() + "\n# changed\n")

    return change


@pytest.mark.parametrize(
    "change",
    [
        append("chapters/00-mini.md"),
        append("environment.lock"),
        append("environment-torch.lock"),
        append("inswsn_lib/a.py"),
        append("book/inswsn_book/worker.py"),
        lambda root: (root / "inswsn_lib" / "b.py").write_text(""),
        lambda root: (root / "inswsn_lib" / "a.py").rename(root / "inswsn_lib" / "c.py"),
    ],
    ids=["source", "lock", "torch lock", "library", "worker", "new module", "renamed module"],
)
def test_a_change_of_content_changes_the_key(
    mini: Project, library: Path, change: Callable[[Path], None]
) -> None:
    (chapter,) = mini.chapters()
    before = chapter_key(mini, chapter, {})
    change(mini.root)
    assert chapter_key(mini, chapter, {}) != before


def test_another_python_changes_the_key(mini: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    (chapter,) = mini.chapters()
    before = chapter_key(mini, chapter, {})
    monkeypatch.setattr("sys.version_info", (3, 11, 999))
    assert chapter_key(mini, chapter, {}) != before


def test_parameters_change_the_key(mini: Project) -> None:
    (chapter,) = mini.chapters()
    keys = {chapter_key(mini, chapter, p) for p in ({}, {"a": 1}, {"a": 2}, {"b": 1})}
    assert len(keys) == 4


def test_whether_there_are_recorded_data_changes_the_key(
    mini: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (chapter,) = mini.chapters()
    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    without = chapter_key(mini, chapter, {})
    made = Results(chapter="00", parameters={}, data={}, quantities=())
    store(mini, chapter, without, '{"made": "without"}\n', made)
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "first"))
    had = chapter_key(mini, chapter, {})
    assert had != without
    assert lookup(mini, chapter, had) is None  # what was executed without them is not taken
    # which folder it is and what it holds does not count
    (tmp_path / "first" / "file").touch()
    assert chapter_key(mini, chapter, {}) == had
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "second"))
    assert chapter_key(mini, chapter, {}) == had
    # a name of no folder gives no data
    for name in ("", str(tmp_path / "none"), str(tmp_path / "first" / "file")):
        monkeypatch.setenv(DATA_VARIABLE, name)
        assert chapter_key(mini, chapter, {}) == without, name
    # each is kept while the other is made
    store(mini, chapter, had, '{"made": "with"}\n', made)
    for key, text in ((without, "without"), (had, "with")):
        entry = lookup(mini, chapter, key)
        assert entry is not None
        assert entry.notebook.read_text() == f'{{"made": "{text}"}}\n'


def test_what_a_kill_leaves_takes_the_place_of_nothing(mini: Project) -> None:
    (chapter,) = mini.chapters()
    made = Results(chapter="00", parameters={}, data={}, quantities=())
    whole = [store(mini, chapter, letter * 64, "{}\n", made).notebook.parent for letter in "ab"]
    (whole[1] / "results.json").unlink()  # it comes last
    last = store(mini, chapter, "c" * 64, "{}\n", made).notebook.parent
    assert {whole[0], last} == set(last.parent.iterdir())
    # of those that are whole the last but one is kept
    newest = store(mini, chapter, "d" * 64, "{}\n", made).notebook.parent
    assert {last, newest} == set(last.parent.iterdir())


def test_times_and_unrelated_files_do_not(mini: Project, library: Path) -> None:
    (chapter,) = mini.chapters()
    before = chapter_key(mini, chapter, {})
    os.utime(library, (0, 0))
    os.utime(chapter.source, (0, 0))
    (mini.root / "README.md").write_text("unrelated")
    # the command line and the pages may change without any chapter being due
    (library.parent / "artefact" / "rendering.py").write_text("x = 2\n")
    (mini.root / "data" / "papers" / "other.txt").write_text("unrelated")
    assert chapter_key(mini, chapter, {}) == before


def test_an_entry_holds_while_its_data_are_unchanged(mini: Project) -> None:
    (chapter,) = mini.chapters()
    data = mini.root / "data" / "papers" / "number.txt"
    results = Results(
        chapter="00",
        parameters={},
        data={"data/papers/number.txt": file_digest(data)},
        quantities=(),
    )
    key = chapter_key(mini, chapter, {})
    assert lookup(mini, chapter, key) is None
    store(mini, chapter, key, "{}\n", results)
    assert lookup(mini, chapter, key) is not None
    data.write_text("22")
    assert lookup(mini, chapter, key) is None
    data.unlink()
    assert lookup(mini, chapter, key) is None


def test_an_entry_that_was_cut_short_is_none(mini: Project) -> None:
    (chapter,) = mini.chapters()
    key = chapter_key(mini, chapter, {})
    results = Results(chapter="00", parameters={}, data={}, quantities=())
    entry = store(mini, chapter, key, "{}\n", results)
    (entry.notebook.parent / "results.json").write_bytes(b'{"schema_version\xff')
    assert lookup(mini, chapter, key) is None
    entry = store(mini, chapter, key, '{"cells": []}\n', results)
    entry.notebook.write_text('{"cells"')
    assert lookup(mini, chapter, key) is None


def test_the_last_two_entries_are_kept(mini: Project) -> None:
    (chapter,) = mini.chapters()
    results = Results(chapter="00", parameters={}, data={}, quantities=())
    first, second, third = "a" * 64, "b" * 64, "c" * 64
    for moment, key in enumerate((third, second, first, second)):
        entry = store(mini, chapter, key, "{}\n", results)
        os.utime(entry.notebook.parent, (moment, moment))
    assert [lookup(mini, chapter, key) is None for key in (first, second, third)] == [
        False,
        False,
        True,
    ]
