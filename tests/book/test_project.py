"""Where the checkout is, its chapters, whose it is, and which of its files a chapter may need."""

from __future__ import annotations

import tomllib
from datetime import date
from pathlib import Path

import pytest
import yaml
from conftest import MINI_CHAPTER, MiniProject
from inswsn_book.parameters import chapter_schema
from inswsn_book.project import ROOT_VARIABLE, Project, find_root

from inswsn_lib.errors import InswsnError


def test_the_root_is_found_from_below_or_named(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(ROOT_VARIABLE, raising=False)
    monkeypatch.chdir(root / "book" / "_static")
    assert find_root() == root
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InswsnError, match="is not in a checkout of inswsn"):
        find_root()
    monkeypatch.setenv(ROOT_VARIABLE, str(root))  # as the executor does
    assert find_root() == root


def test_chapters_come_in_order_and_are_found_by_number_and_name(mini: MiniProject) -> None:
    for name in ("10-ten", "02-two"):
        (mini.root / "chapters" / f"{name}.md").write_text("# x\n")
    assert [chapter.number for chapter in mini.chapters()] == ["00", "02", "10"]
    assert [mini.find(word).name for word in ("2", "02", "02-two")] == ["02-two"] * 3


def test_a_lesson_comes_before_its_evidence_and_a_number_stands_for_the_lesson(
    mini: MiniProject,
) -> None:
    for path in (mini.source.parent / "evidence" / "02-proof.md", mini.source.with_name("02-a.md")):
        path.parent.mkdir(exist_ok=True)
        path.write_text(MINI_CHAPTER.replace("@BODY@", "").replace("scale", path.stem[3:]))
    names = {chapter.id: chapter.name for chapter in mini.chapters()}
    assert list(names.items()) == [
        ("00", "00-mini"), ("lesson-02", "02-a"), ("02", "evidence/02-proof")
    ]  # fmt: skip
    for word in ("2", "02", "02-a", "lesson-02"):
        assert mini.find(word).id == "lesson-02"
    assert [mini.find(word).id for word in ("02-proof", "evidence/02-proof")] == ["02", "02"]
    assert [mini.find(word, evidence=True).id for word in ("2", "02", "0")] == ["02", "02", "00"]
    assert [mini.by_id(name).name for name in names] == [*names.values()]
    declared = [[*chapter_schema(mini.root, name).defaults] for name in names]
    assert [chapter.lesson for chapter in mini.chapters()] == [False, True, False]
    assert [names[0] for names in declared] == ["scale", "a", "proof"]


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("Zero.md", "does not fit NN-words.md"),
        ("00-again.md", "The chapter number 00 is used twice"),
        (None, "There is no chapter in"),
    ],
)
def test_chapters_that_may_not_be(mini: MiniProject, name: str | None, sentence: str) -> None:
    if name is None:
        mini.source.unlink()
    else:
        (mini.root / "chapters" / name).write_text("# x\n")
    with pytest.raises(InswsnError, match=sentence):
        mini.chapters()


def test_one_file_says_what_the_work_is_called_and_whose_it_is(project: Project) -> None:
    about = project.about()
    cited = yaml.safe_load((project.root / "CITATION.cff").read_text(encoding="utf-8"))
    packaged = tomllib.loads((project.root / "pyproject.toml").read_text("utf-8"))["project"]
    assert (about["title"], about["license"]) == (cited["title"], packaged["license"])
    assert about["version"] == cited["version"] == packaged["version"]
    assert about["names"] == ["inswsn contributors"]
    assert date.fromisoformat(about["date-released"])
    assert "authors" not in packaged
    config = (project.root / "_config.yml").read_text(encoding="utf-8")
    assert not any(words in config for words in (about["title"], *about["names"]))


@pytest.mark.parametrize(
    "field", ["title", "abstract", "version", "authors", "date-released", "license"]
)
def test_a_citation_that_lacks_a_field_is_refused(mini: MiniProject, field: str) -> None:
    path = mini.root / "CITATION.cff"
    said = yaml.safe_load(path.read_text(encoding="utf-8"))
    del said[field]
    path.write_text(yaml.safe_dump(said), encoding="utf-8")
    with pytest.raises(
        InswsnError, match=rf"CITATION\.cff is not a citation file: it lacks '{field}'"
    ):
        mini.about()


def test_two_authors_are_named_family_first(mini: MiniProject) -> None:
    path = mini.root / "CITATION.cff"
    said = yaml.safe_load(path.read_text(encoding="utf-8"))
    said["authors"] = [{"family-names": "van Berg", "given-names": "Ana"}, {"name": "Rovers"}]
    path.write_text(yaml.safe_dump(said), encoding="utf-8")
    assert mini.about()["names"] == ["van Berg, Ana", "Rovers"]


def test_a_second_build_of_a_checkout_is_refused(mini: MiniProject) -> None:
    with mini.build_lock(), pytest.raises(InswsnError, match=r"Another build of .* is running"):
        Project(mini.root).build_lock()
    with mini.build_lock():  # it was given back
        pass
