"""What the artefact is called and whose it is: data/about.yaml, or one sentence."""

from __future__ import annotations

import shutil
import tomllib
from datetime import date
from pathlib import Path

import pytest
import yaml
from conftest import MiniProject, run_command
from inswsn_book.about import About, Author, load_about

from inswsn_lib.errors import InswsnError


@pytest.fixture
def checkout(root: Path, tmp_path: Path) -> Path:
    (tmp_path / "data").mkdir()
    shutil.copy(root / "data" / "about.yaml", tmp_path / "data")
    shutil.copy(root / "pyproject.toml", tmp_path)
    return tmp_path


def edit(checkout: Path, **changes: object) -> None:
    path = checkout / "data" / "about.yaml"
    content = yaml.safe_load(path.read_text(encoding="utf-8")) | changes
    path.write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")


def test_the_kept_file_is_read(root: Path) -> None:
    about = load_about(root)
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert about.version == project["version"]
    assert about.licences.code == project["license"]
    assert date.fromisoformat(about.released).year == int(about.year)


def test_nothing_else_names_the_authors_or_the_title(root: Path) -> None:
    """One setting to change: no other file that is written by hand has a copy of it."""
    about = load_about(root)
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert "authors" not in project
    config = (root / "_config.yml").read_text(encoding="utf-8")
    assert about.title not in config
    assert about.shown_authors not in config


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("title", "", "title is '': it may be one line"),
        ("title", "two\nlines", "title is 'two\\nlines': it may be one line"),
        ("title", "a {brace}", "it may be one line"),
        ("released", "2026-13-01", "released is '2026-13-01': month must be in 1..12"),
        ("released", "tomorrow", "released is 'tomorrow'"),
        ("authors", [], "authors is []"),
        ("authors", [{"name": "A", "family": "B", "given": "C"}], "either a name, or a family"),
        ("authors", [{"family": "B"}], "a person has a family and a given name"),
        ("authors", [{"name": "A", "orcid": "https://orcid.org/0000-0002-1825-0097"}], "a group"),
        ("authors", [{"family": "B", "given": "C", "orcid": "0000"}], "authors.0.orcid is '0000'"),
        ("authors", [{"family": "B", "given": "C", "mail": "x"}], "authors.0.mail is 'x'"),
        ("authors", [{"name": "A"}, {"name": "A"}], "it may name each one once"),
        ("keywords", ["a", "a"], "it may name each one once"),
        ("keywords", "one", "keywords is 'one'"),
        ("repository", "git@host:a/b", "repository is 'git@host:a/b'"),
        ("repository", "https://host/owner/name/", "repository is"),
        ("doi", "https://doi.org/10.5281/x", "doi is 'https://doi.org/10.5281/x'"),
        ("licences", {"code": "BSD", "text": "CC-BY-4.0"}, "SPDX name of a licence"),
        ("licences", {"code": "mit", "text": "CC-BY-4.0"}, "it may be written MIT, as SPDX does"),
        ("version", "2.0", "the version stands in pyproject.toml alone"),
        ("colour", "red", "colour is 'red'"),
        (1, 2, "about.yaml"),
    ],
)
def test_a_field_that_is_not_of_the_form_is_one_sentence(
    checkout: Path, field: str, value: object, said: str
) -> None:
    path = checkout / "data" / "about.yaml"
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    path.write_text(yaml.safe_dump(content | {field: value}), encoding="utf-8")
    with pytest.raises(InswsnError) as caught:
        load_about(checkout)
    message = str(caught.value)
    assert said in message
    assert "\n" not in message
    assert len(message) < len(str(path)) + 260


def test_a_field_that_is_missing_is_named(checkout: Path) -> None:
    path = checkout / "data" / "about.yaml"
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    del content["keywords"]
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(InswsnError, match=r"about\.yaml: keywords is missing\.$"):
        load_about(checkout)


@pytest.mark.parametrize("text", ["- a list", "just words", "", "a: b: c", "x: 1\nx: 2"])
def test_a_file_that_is_no_mapping_is_one_sentence(checkout: Path, text: str) -> None:
    (checkout / "data" / "about.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(InswsnError, match=r"about\.yaml"):
        load_about(checkout)


@pytest.mark.parametrize("text", ["", "[project]\nname = 'x'", "project = 3", "no toml", "\xff"])
def test_a_project_without_a_version_is_one_sentence(checkout: Path, text: str) -> None:
    (checkout / "pyproject.toml").write_bytes(text.encode("latin-1"))
    with pytest.raises(InswsnError, match=r"pyproject\.toml names no version"):
        load_about(checkout)


def test_the_command_says_it_and_ends_with_status_2(mini: MiniProject) -> None:
    edit(mini.root, doi="not a doi")
    done = run_command(mini.root, "citation")
    assert done.returncode == 2
    assert "doi is 'not a doi'" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (mini.root / "CITATION.cff").exists()


def test_names_are_shown_and_listed() -> None:
    person = Author(family="van der Berg", given="Ana Maria")
    assert (person.shown, person.listed) == ("Ana Maria van der Berg", "van der Berg, Ana Maria")
    group = Author(name="Rovers & Co")
    assert (group.shown, group.listed) == ("Rovers & Co", "Rovers & Co")


@pytest.mark.parametrize(
    ("names", "line"),
    [(["A"], "A"), (["A", "B"], "A and B"), (["A", "B", "C"], "A, B and C")],
)
def test_the_line_of_authors(root: Path, names: list[str], line: str) -> None:
    about = load_about(root)
    several = about.model_copy(update={"authors": tuple(Author(name=name) for name in names)})
    assert isinstance(several, About)
    assert several.shown_authors == line
