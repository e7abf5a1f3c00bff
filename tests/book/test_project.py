"""Finding the checkout and its chapters."""

from __future__ import annotations

from pathlib import Path

import pytest
from inswsn_book.project import ROOT_VARIABLE, Project, find_root

from inswsn_lib.errors import InswsnError


def test_the_root_is_found_from_below(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(ROOT_VARIABLE, raising=False)
    monkeypatch.chdir(root / "book" / "_static")
    assert find_root() == root


def test_the_executor_can_name_the_root(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(ROOT_VARIABLE, str(root))
    assert find_root() == root


def test_chapters_come_in_order(mini: Project) -> None:
    source = (mini.root / "chapters" / "00-mini.md").read_text()
    for name in ("10-ten", "02-two"):
        (mini.root / "chapters" / f"{name}.md").write_text(source)
    assert [chapter.number for chapter in mini.chapters()] == ["00", "02", "10"]


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("Zero.md", "does not fit NN-words.md"),
        ("00-again.md", "The chapter number 00 is used twice"),
    ],
)
def test_a_bad_name_is_refused(mini: Project, name: str, sentence: str) -> None:
    (mini.root / "chapters" / name).write_text("# x\n")
    with pytest.raises(InswsnError, match=sentence):
        mini.chapters()


def test_no_chapter_is_refused(mini: Project) -> None:
    (mini.root / "chapters" / "00-mini.md").unlink()
    with pytest.raises(InswsnError, match="There is no chapter"):
        mini.chapters()
