"""The citations: valid in their formats, in agreement, and right for whatever names stand there."""

from __future__ import annotations

import hashlib
import json
import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import MiniProject, run_command
from hypothesis import given, settings
from hypothesis import strategies as st
from inswsn_book.about import About, Author, load_about
from inswsn_book.citation import (
    bibtex_text,
    cff_text,
    citation_page,
    plain_text,
    verdict_page,
    zenodo_text,
)
from inswsn_book.ledger import LEDGER, claims_of, load_claims
from inswsn_book.project import Project
from inswsn_book.references import read_articles
from inswsn_book.results import read_results
from inswsn_book.verdicts import verdicts
from jsonschema import Draft7Validator
from pybtex.database import parse_string
from pybtex.richtext import Text

from inswsn_lib.errors import InswsnError

ORCID = "https://orcid.org/0000-0002-1825-0097"
PERSON = Author(family="Núñez", given="Ana", orcid=ORCID, affiliation="Institute of “Navigation”")
GROUP = Author(name='The "Rovers": a & b')

# the official schema of version 1.2.0, which check-jsonschema brings
SCHEMA = files("check_jsonschema") / "builtin_schemas" / "vendor" / "citation-file-format.json"

# https://developers.zenodo.org, "Deposit metadata": what the fields are called and may be
ZENODO_FIELDS = {
    *("upload_type", "publication_type", "image_type", "publication_date", "title", "creators"),
    *("description", "access_right", "license", "embargo_date", "access_conditions", "doi"),
    *("prereserve_doi", "keywords", "notes", "related_identifiers", "contributors", "references"),
    *("communities", "grants", "journal_title", "journal_volume", "journal_issue"),
    *("journal_pages", "conference_title", "conference_acronym", "conference_dates"),
    *("conference_place", "conference_url", "conference_session", "conference_session_part"),
    *("imprint_publisher", "imprint_isbn", "imprint_place", "partof_title", "partof_pages"),
    *("thesis_supervisors", "thesis_university", "subjects", "version", "language", "locations"),
    *("dates", "method"),
}
ZENODO_TYPES = {
    *("publication", "poster", "presentation", "dataset", "image", "video", "software"),
    *("lesson", "physicalobject", "other"),
}
ZENODO_RELATIONS = {
    *("isCitedBy", "cites", "isSupplementTo", "isSupplementedBy", "isContinuedBy", "continues"),
    *("isDescribedBy", "describes", "hasMetadata", "isMetadataFor", "isNewVersionOf"),
    *("isPreviousVersionOf", "isPartOf", "hasPart", "isReferencedBy", "references"),
    *("isDocumentedBy", "documents", "isCompiledBy", "compiles", "isVariantFormOf"),
    *("isOriginalFormof", "isIdenticalTo", "isAlternateIdentifier", "isReviewedBy", "reviews"),
    *("isDerivedFrom", "isSourceOf", "requires", "isRequiredBy", "isObsoletedBy", "obsoletes"),
}
DOIS = {"10.1155/2012/707326", "10.3969/j.issn.1003-7985.2012.02.006", "10.1155/2015/176947"}


@pytest.fixture(scope="module")
def about(root: Path) -> About:
    """The kept setting, as it is while nothing is archived."""
    return load_about(root).model_copy(update={"repository": None, "doi": None})


@pytest.fixture(scope="module")
def schema() -> Draft7Validator:
    content = json.loads(SCHEMA.read_text(encoding="utf-8"))
    assert content["$id"].endswith("/1.2.0/schema.json")
    return Draft7Validator(content)


def with_authors(about: About, *authors: Author, **changes: Any) -> About:
    return about.model_copy(update={"authors": authors, **changes})


def cff(about: About, root: Path) -> Any:
    return yaml.safe_load(cff_text(about, read_articles(root, about)))


def test_the_kept_files_are_what_the_source_says(root: Path) -> None:
    done = run_command(root, "citation", "--check")
    assert done.returncode == 0, done.stderr


def test_the_papers_are_read_from_the_bibliography(root: Path, about: About) -> None:
    articles = read_articles(root, about)
    assert [article.name for article in articles] == ["P1", "P2", "P3"]
    assert {article.doi for article in articles} == DOIS
    second = articles[1]
    assert second.title == (
        "Distributed H-infinity fusion filter design for INS/WSN integrated positioning system"
    )
    assert second.authors == (("Li", "Qinghua"), ("Chen", "Xiyuan"), ("Xu", "Yuan"))
    assert (second.year, second.volume, second.number) == (2012, "28", "2")
    assert second.pages == ("164", "168")


@pytest.mark.parametrize("authors", [(GROUP,), (PERSON,), (PERSON, GROUP)])
@pytest.mark.parametrize("archived", [False, True])
def test_the_cff_is_valid_by_its_schema(
    root: Path,
    about: About,
    schema: Draft7Validator,
    authors: tuple[Author, ...],
    archived: bool,
) -> None:
    host = {"repository": "https://host.example/owner/name", "doi": "10.5281/zenodo.1234567"}
    content = cff(with_authors(about, *authors, **(host if archived else {})), root)
    assert list(schema.iter_errors(content)) == []
    assert ("identifiers" in content, "repository-code" in content) == (archived, archived)
    assert {reference["doi"] for reference in content["references"]} == DOIS
    assert len(content["authors"]) == len(authors)


def test_the_schema_would_tell(root: Path, about: About, schema: Draft7Validator) -> None:
    content = cff(about, root) | {"license": "no such licence"}
    assert list(schema.iter_errors(content)) != []


@pytest.mark.parametrize("authors", [(GROUP,), (PERSON,), (PERSON, GROUP)])
def test_the_deposit_metadata_have_zenodos_fields(
    root: Path, about: About, authors: tuple[Author, ...]
) -> None:
    changed = with_authors(about, *authors, abstract="Less < more & so on")
    content = json.loads(zenodo_text(changed, read_articles(root, about)))
    assert set(content) <= ZENODO_FIELDS
    assert {"upload_type", "title", "creators", "description", "publication_date"} <= set(content)
    assert content["upload_type"] in ZENODO_TYPES
    assert content["access_right"] == "open"
    assert content["description"] == "<p>Less &lt; more &amp; so on</p>"
    related = content["related_identifiers"]
    assert {entry["relation"] for entry in related} <= ZENODO_RELATIONS
    assert {entry["identifier"] for entry in related} == DOIS
    assert [creator["name"] for creator in content["creators"]] == [a.listed for a in authors]
    for creator in content["creators"]:
        assert set(creator) <= {"name", "affiliation", "orcid"}
    if PERSON in authors:
        assert content["creators"][0]["orcid"] == "0000-0002-1825-0097"


def test_all_name_the_same_licences(root: Path, about: About) -> None:
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    kept = yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))
    deposit = json.loads((root / ".zenodo.json").read_text(encoding="utf-8"))
    code, text = about.licences.code, about.licences.text
    assert project["license"] == code
    assert kept["license"] == code
    assert text in kept["message"]
    assert deposit["license"].casefold() == code.casefold()
    assert code in deposit["notes"]
    assert text in deposit["notes"]
    for name, version in (("LICENSE", "BSD 3-Clause License"), ("LICENSE-TEXT", "Attribution 4.0")):
        assert (root / name).read_text(encoding="utf-8").startswith(version)


def test_the_licence_of_the_text_is_the_whole_legal_code(root: Path) -> None:
    """As Creative Commons publishes it in plain text; nobody edits it."""
    digest = hashlib.sha256((root / "LICENSE-TEXT").read_bytes()).hexdigest()
    assert digest == "1b9324f84c3915cd133587a505affc600b09656442703d5fe54c6e9c21415131"


ORDINARY = st.characters(categories=("L", "Nd"), include_characters=" \"':;,.-&#%_()/@+*=|[]<>!?")
# what LaTeX sets as one sign, and what YAML, JSON and HTML need not keep apart
JOINED = ("--", "``", "''", ",,", "<<", ">>", "  ")
NAMES = st.text(ORDINARY, min_size=1, max_size=30).filter(
    lambda name: name == name.strip() and name.isprintable() and not any(j in name for j in JOINED)
)
AUTHORS = st.lists(
    st.one_of(
        st.builds(Author, name=NAMES),
        st.builds(Author, family=NAMES, given=NAMES, affiliation=st.none() | NAMES),
    ),
    min_size=1,
    max_size=4,
    unique=True,
)


@settings(max_examples=25)
@given(AUTHORS)
def test_any_names_come_back_from_the_cff(
    about: About, schema: Draft7Validator, authors: list[Author]
) -> None:
    content = yaml.safe_load(cff_text(with_authors(about, *authors), []))
    assert list(schema.iter_errors(content)) == []
    read = [
        Author(
            name=entry.get("name"),
            family=entry.get("family-names"),
            given=entry.get("given-names"),
            affiliation=entry.get("affiliation"),
        )
        for entry in content["authors"]
    ]
    assert read == authors


@settings(max_examples=25)
@given(AUTHORS)
def test_any_names_come_back_from_the_deposit_metadata(about: About, authors: list[Author]) -> None:
    content = json.loads(zenodo_text(with_authors(about, *authors), []))
    assert [entry["name"] for entry in content["creators"]] == [a.listed for a in authors]
    assert [entry.get("affiliation") for entry in content["creators"]] == [
        author.affiliation for author in authors
    ]


@settings(max_examples=25)
@given(AUTHORS)
def test_any_names_come_back_from_bibtex(about: About, authors: list[Author]) -> None:
    (entry,) = parse_string(bibtex_text(with_authors(about, *authors)), "bibtex").entries.values()
    read = [
        (plain(person.last_names), plain(person.first_names)) for person in entry.persons["author"]
    ]
    assert read == [(author.name or author.family, author.given or "") for author in authors]


def plain(parts: list[str]) -> str:
    return str(Text.from_latex(" ".join(parts)))


def test_the_bibtex_entry_has_version_doi_and_address(about: About) -> None:
    archived = about.model_copy(update={"doi": "10.5281/zenodo.12_3", "repository": None})
    (entry,) = parse_string(bibtex_text(archived), "bibtex").entries.values()
    assert entry.fields["note"] == f"Version {about.version}"
    assert entry.fields["year"] == about.released[:4]
    # taken literally by BibTeX's styles: an underscore is not escaped
    assert entry.fields["doi"] == "10.5281/zenodo.12_3"
    assert entry.fields["url"] == "https://doi.org/10.5281/zenodo.12_3"
    assert "doi" not in parse_string(bibtex_text(about), "bibtex").entries["inswsn"].fields


def test_the_plain_citation_names_all(about: About) -> None:
    line = plain_text(with_authors(about, PERSON, GROUP))
    assert line.startswith(f'Núñez, Ana; The "Rovers": a & b ({about.released[:4]}). {about.title}')
    assert f"Version {about.version}" in line


def test_a_verdict_is_cited_as_it_is_computed(project: Project, about: About) -> None:
    decided = claims_of(load_claims(project.root / LEDGER), "00")
    judged = verdicts(decided, [read_results(project.published / "00.json")])
    page = verdict_page(about, judged)
    example = next(entry for entry in judged if entry.quantity is not None)
    assert f"claim {example.claim.id}: {example.verdict}" in page
    said = plain_text(about, f"Claim {example.claim.id}: {example.verdict}, claims.html#")
    assert said.split("claims.html#")[0] in " ".join(page.split())
    assert f"claims.html#{example.claim.anchor}." in page
    assert f"version {about.version}" in page.lower()
    assert "@misc{inswsn-" in page
    assert verdict_page(about, []) == "No chapter decides a claim yet.\n"


def test_the_page_has_text_and_bibtex(about: About) -> None:
    page = citation_page(about)
    assert plain_text(about) in " ".join(page.split())
    assert bibtex_text(about) in page


def test_a_change_of_the_setting_reaches_every_file_and_page(built: MiniProject) -> None:
    assert run_command(built.root, "citation").returncode == 0
    before = load_about(built.root).shown_authors
    path = built.root / "data" / "about.yaml"
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    content["authors"] = [{"family": "Núñez", "given": "Ana"}]
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    done = run_command(built.root, "citation", "--check")
    assert done.returncode == 2
    assert done.stderr == (
        "inswsn: CITATION.cff and .zenodo.json differ from what data/about.yaml says; "
        "write them again: make citation.\n"
    )
    done = run_command(built.root, "citation")
    assert done.stdout == "wrote CITATION.cff\nwrote .zenodo.json\n"
    assert run_command(built.root, "citation", "--check").returncode == 0
    assert "Núñez" in (built.root / "CITATION.cff").read_text(encoding="utf-8")

    assert run_command(built.root, "book").returncode == 0
    page = (built.site / "index.html").read_text(encoding="utf-8")
    assert "Ana Núñez" in page
    assert before not in page

    (built.root / ".zenodo.json").write_text("{}", encoding="utf-8")
    said = run_command(built.root, "citation", "--check").stderr
    assert said.startswith("inswsn: .zenodo.json differs from what data/about.yaml says")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("@article{xu2012ins,", "@article{other,", "has no entry xu2012ins, the key of P1"),
        ("  doi     = {10.1155/2012/707326}\n", "", "the entry xu2012ins lacks doi"),
        ("  year    = {2012},\n  volume  = {2012}", "  year    = {soon}", "lacks a year in digits"),
        ("@article{xu2012ins,", "@article{", "cannot be read"),
    ],
)
def test_a_bibliography_without_a_paper_is_one_sentence(
    mini: MiniProject, old: str, new: str, said: str
) -> None:
    path = mini.root / "book" / "references.bib"
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InswsnError) as caught:
        read_articles(mini.root, load_about(mini.root))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
