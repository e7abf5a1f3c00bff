"""Where the checkout is, its chapters, whose it is, and which of its files a chapter may need."""

from __future__ import annotations

import json
import tomllib
from datetime import date
from pathlib import Path

import pytest
import yaml
from conftest import MINI_CHAPTER, MiniProject
from inswsn_book.record.parameters import chapter_schema
from inswsn_book.record.project import ROOT_VARIABLE, Project, find_root

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


def test_lessons_come_first_and_each_chapter_is_found_by_number_and_name(mini: MiniProject) -> None:
    folder = mini.source.parent
    for name in ("2-two", "1-one", "evidence/p1-proof", "words"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / f"{name}.md").write_text(
            MINI_CHAPTER.replace("@BODY@", "").replace("scale", name[-3:])
        )
    (mini.root / "book" / "renamed.yaml").write_text(
        'chapters: {lesson-05: lesson-2, "05": p1-proof}\n'
    )
    names = {chapter.id: chapter.name for chapter in mini.chapters()}
    assert list(names.items())[:3] == [
        ("lesson-1", "1-one"), ("lesson-2", "2-two"), ("00", "00-mini")
    ]  # fmt: skip
    assert {"p1-proof": "evidence/p1-proof", "words": "words"}.items() <= names.items()
    assert [chapter.lesson for chapter in mini.chapters()][:3] == [True, True, False]
    for word in ("2", "2-two", "lesson-2"):
        assert mini.find(word).id == "lesson-2"
    assert mini.find("p1-proof") == mini.find("evidence/p1-proof") == mini.by_id("p1-proof")
    declared = [next(iter(chapter_schema(mini.root, name).defaults)) for name in names]
    assert sorted(declared) == ["one", "oof", "rds", "scale", "two"]
    with pytest.raises(InswsnError, match=r"^05 is called lesson-2 or p1-proof now\.$"):
        mini.find("05")


def test_each_old_name_of_a_chapter_has_a_new_one(project: Project) -> None:
    renamed, now = project.renamed(), {chapter.id for chapter in project.chapters()}
    assert set(renamed["chapters"].values()) <= now
    old = {f"lesson-0{n}" for n in range(7)} | {f"0{n}" for n in range(8)} | {"90", "91"}
    assert set(renamed["chapters"]) == old
    assert not old & now


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("Zero.md", "does not fit N-words.md"),
        ("00-again.md", "The chapter name 00 is used twice"),
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
    meta = json.loads((project.root / "codemeta.json").read_text(encoding="utf-8"))
    assert about["version"] == cited["version"] == packaged["version"] == meta["version"]
    assert (meta["name"], meta["dateModified"]) == (about["title"], about["date-released"])
    assert meta["license"].endswith(f"/{about['license']}")
    assert [author["name"] for author in meta["author"]] == about["names"]
    assert meta["keywords"] == cited["keywords"]
    changes = (project.root / "CHANGELOG.md").read_text(encoding="utf-8")
    assert (
        f"## {about['version']} ({about['date-released']})\n\n### What you must change\n" in changes
    )
    assert about["names"] == ["inswsn contributors"]
    assert date.fromisoformat(about["date-released"])
    assert {"authors", "urls"} <= {*packaged["dynamic"]}  # of this file, when the wheel is built
    assert cited["keywords"] == packaged["keywords"]
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
