"""The description of the archive: an RO-Crate 1.1 that says what was made from what."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from rocrate.model import ContextEntity, Dataset, File
from rocrate.rocrate import ROCrate

from inswsn_book.about import About, Author
from inswsn_book.project import Chapter
from inswsn_book.references import Article
from inswsn_book.results import Provenance, Results
from inswsn_book.third_party import Recording, ThirdParty

#: Where it stands in the archive.
CRATE = "ro-crate-metadata.json"

# What each chapter run is: https://www.researchobject.org/workflow-run-crate/profiles/process_run_crate
_PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
_JSON, _NOTEBOOK, _MARKDOWN = "application/json", "application/x-ipynb+json", "text/markdown"

_FOLDERS = {
    "site/": "The rendered book; index.html opens it without a network",
    "executed/": "The executed chapters with their outputs",
    "results/": "What each chapter found, with the parameters and the provenance of its run",
    "licences/": "The licences of what the site holds of the programs that made it",
    "inswsn_lib/": "The library",
    "chapters/": "The chapters, as MyST notebooks and as notebooks without outputs",
    "book/": "The pages around the chapters",
    "tests/": "The tests",
    "data/papers/": "What the papers print",
    "data/scenarios/": "Every number of a simulation, with its unit and its source",
    "data/published/": "The reference results",
    "data/recorded/": "What was computed from recorded data",
}
_FILES = {
    "verdicts.json": ("Every claim with its verdict", _JSON),
    "SHA256SUMS": ("The SHA-256 of every other file", "text/plain"),
    "index.html": ("The way into the book", "text/html"),
    "README.md": ("How to build the book, and what it finds", _MARKDOWN),
    "CITATION.cff": ("How to cite it", "application/yaml"),
    ".zenodo.json": ("The metadata of a deposit at Zenodo", _JSON),
    "LICENSE": ("The licence of the code", "text/plain"),
    "LICENSE-TEXT": ("The licence of text and figures", "text/plain"),
    "THIRD-PARTY.md": ("What belongs to others", _MARKDOWN),
    "environment.lock": ("The locked environment", "text/plain"),
    "environment-torch.lock": ("The locked environment, torch", "text/plain"),
    "data/about.yaml": ("Title, authors and licences: the source of the citations", "text/yaml"),
    "data/claims.yaml": ("What the papers claim, and what decides each claim", "text/yaml"),
    "data/claim-ids.txt": ("The ids of all claims ever published", "text/plain"),
    "data/third-party.yaml": ("What belongs to others, for programs", "text/yaml"),
}


@dataclass(frozen=True)
class Described:
    """What the description is made from.

    Attributes
    ----------
    about : About
    articles : sequence of Article
    third_party : ThirdParty
    runs : sequence of (Chapter, Results)
        The chapters with what their runs found.
    titles : dict of str to str
        The title of each chapter by its number.
    commit : str
        What the archive was made from.
    """

    about: About
    articles: Sequence[Article]
    third_party: ThirdParty
    runs: Sequence[tuple[Chapter, Results]]
    titles: dict[str, str]
    commit: str


def crate_text(described: Described, names: Sequence[str]) -> str:
    """Return ``ro-crate-metadata.json``.

    Nothing in it is random, and no time is that of the call: the same archive has the same
    description.

    Parameters
    ----------
    described : Described
    names : sequence of str
        The files of the archive; it describes those that are there.
    """
    crate = ROCrate(version="1.1")
    _describe_root(crate, described)
    for name, title in _FOLDERS.items():
        if any(file.startswith(name) for file in names):
            crate.add(Dataset(crate, dest_path=name, properties={"name": title}))
    for name, (title, form) in _FILES.items():
        if name in names or name == "SHA256SUMS":
            _file(crate, name, title, form)
    for recording in described.third_party.recorded:
        _describe_recording(crate, recording, names)
    for chapter, results in described.runs:
        _describe_run(crate, described, chapter, results, names)
    _license_files(crate, described.about)
    text = json.dumps(crate.metadata.generate(), indent=1, ensure_ascii=False, allow_nan=False)
    return text + "\n"


def _describe_root(crate: ROCrate, described: Described) -> None:
    about, root = described.about, crate.root_dataset
    root["name"] = about.title
    root["description"] = about.abstract
    root["datePublished"] = about.released
    root["version"] = about.version
    root["keywords"] = ", ".join(about.keywords)
    root["license"] = [_licence(crate, name) for name in (about.licences.code, about.licences.text)]
    root["author"] = [_author(crate, i, author) for i, author in enumerate(about.authors, 1)]
    root["citation"] = [_article(crate, article) for article in described.articles]
    if about.doi is not None:
        root["identifier"] = f"https://doi.org/{about.doi}"
    if about.repository is not None:
        root["url"] = about.repository
    profile = {"@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"}
    root["conformsTo"] = _context(crate, _PROFILE, profile)
    root["mentions"] = []
    library = {
        "@type": "SoftwareApplication",
        "name": "inswsn",
        "softwareVersion": about.version,
        "identifier": described.commit,
        "description": "The library and the command, from the commit that is its identifier.",
        "license": {"@id": _spdx(about.licences.code)},
        "softwareRequirements": [{"@id": "environment.lock"}, {"@id": "environment-torch.lock"}],
    }
    _context(crate, "#inswsn", library)


def _author(crate: ROCrate, number: int, author: Author) -> Any:
    if author.name is not None:
        group = {"@type": "Organization", "name": author.name}
        return _context(crate, f"#author-{number}", group)
    person = {
        "@type": "Person",
        "name": author.shown,
        "familyName": author.family,
        "givenName": author.given,
    }
    if author.affiliation is not None:
        where = {"@type": "Organization", "name": author.affiliation}
        person["affiliation"] = _context(crate, f"#affiliation-{number}", where)
    return _context(crate, author.orcid or f"#author-{number}", person)


def _article(crate: ROCrate, article: Article) -> Any:
    authors = [
        _context(
            crate,
            f"#{article.name}-author-{number}",
            {
                "@type": "Person",
                "name": f"{given} {family}",
                "familyName": family,
                "givenName": given,
            },
        )
        for number, (family, given) in enumerate(article.authors, 1)
    ]
    properties = {
        "@type": "ScholarlyArticle",
        "name": article.title,
        "alternateName": article.name,
        "author": authors,
        "datePublished": str(article.year),
        "identifier": article.address,
        "isPartOf": _context(
            crate,
            f"#{article.name}-journal",
            {"@type": "Periodical", "name": article.journal},
        ),
    }
    return _context(crate, article.address, properties)


def _spdx(name: str) -> str:
    return f"https://spdx.org/licenses/{name}"


def _licence(crate: ROCrate, name: str) -> Any:
    properties = {"@type": "CreativeWork", "name": name, "identifier": name, "url": _spdx(name)}
    return _context(crate, _spdx(name), properties)


def _license_files(crate: ROCrate, about: About) -> None:
    """Say which files are under which licence, where one alone holds."""
    code, text = _spdx(about.licences.code), _spdx(about.licences.text)
    for name, licence in (
        ("inswsn_lib/", code),
        ("tests/", code),
        ("book/", text),
        ("data/claims.yaml", text),
        ("verdicts.json", text),
    ):
        if (entity := crate.get(name)) is not None:
            entity["license"] = {"@id": licence}


def _describe_recording(crate: ROCrate, recording: Recording, names: Sequence[str]) -> None:
    """Add a recording as what results rest on; no part of the archive."""
    properties = {
        "@type": "CreativeWork",
        "name": recording.name,
        "description": f"{recording.what}. Not in this archive. Terms: {recording.stated}.",
        "url": recording.address,
        "creator": _context(
            crate,
            f"#holder-{recording.holder}",
            {"@type": "Organization", "name": recording.holder},
        ),
    }
    if recording.licence is not None:
        properties["license"] = _licence(crate, recording.licence)
    source = _context(crate, recording.address, properties)
    for name in recording.results:
        if name in names:
            _file(crate, name, f"Computed from {recording.name}", _JSON)["isBasedOn"] = source


def _describe_run(
    crate: ROCrate,
    described: Described,
    chapter: Chapter,
    results: Results,
    names: Sequence[str],
) -> None:
    """Add a chapter, its executed notebook, its results, and the run that made them."""
    number, title = chapter.number, described.titles[chapter.number]
    licences = [{"@id": _spdx(name)} for name in vars(described.about.licences).values()]
    code = {
        "@type": ["File", "SoftwareSourceCode"],
        "programmingLanguage": "Python",
        "license": licences,
        "softwareRequirements": {"@id": "#inswsn"},
    }
    source = _file(crate, f"chapters/{chapter.name}.md", title, _MARKDOWN, **code)
    notebook = _file(
        crate, f"executed/{chapter.name}.ipynb", f"{title}, executed", _NOTEBOOK, license=licences
    )
    found = _file(
        crate,
        f"results/{number}.json",
        f"{title}, results",
        _JSON,
        description=f"Results file of schema version {results.schema_version}.",
    )
    read = [
        _file(crate, name, f"Read by chapter {number}", _form(name))
        # what a chapter reads of a part of a file is named file#part
        for name in sorted({name.partition("#")[0] for name in results.data})
        if name in names
    ]
    based = [
        {"@id": recording.address}
        for recording in described.third_party.recorded
        if number in recording.chapters
    ]
    if based:
        found["isBasedOn"] = based
    action = {
        "@type": "CreateAction",
        "name": f"Run of chapter {number}: {title}",
        "instrument": source,
        "object": [
            *_parameters(crate, results),
            *read,
            {"@id": "environment.lock"},
            {"@id": "environment-torch.lock"},
        ],
        "result": [notebook, found],
        "actionStatus": {"@id": "http://schema.org/CompletedActionStatus"},
    }
    if (made := results.provenance) is not None:
        action |= _times(made) | {"description": _machine(made)}
        action["instrument"] = [source, _library_of(crate, made)]
    crate.root_dataset.append_to("mentions", _context(crate, f"#run-{number}", action))


def _parameters(crate: ROCrate, results: Results) -> list[Any]:
    return [
        _context(
            crate,
            f"#{results.chapter}-parameter-{name}",
            {"@type": "PropertyValue", "name": name, "value": value},
        )
        for name, value in results.parameters.items()
    ]


def _times(made: Provenance) -> dict[str, str]:
    """Return when a run began and ended; the provenance has its end to the minute."""
    ended = datetime.strptime(made.finished, "%Y-%m-%d %H:%M UTC").replace(tzinfo=UTC)
    began = ended - timedelta(seconds=round(made.seconds))
    return {"startTime": began.isoformat(), "endTime": ended.isoformat()}


def _library_of(crate: ROCrate, made: Provenance) -> Any:
    """Return the library that a run was made with; runs of one state share it."""
    state = {None: "", True: ", without changes", False: ", with changes not committed"}
    digest = made.sources.get("library", "unknown")
    library = {
        "@type": "SoftwareApplication",
        "name": "inswsn",
        "softwareVersion": made.version,
        "identifier": made.commit or "not a git checkout",
        "description": f"As the run found it{state[made.clean]}; SHA-256 of its sources {digest}.",
    }
    return _context(crate, f"#inswsn-{(made.commit or 'no-git')[:12]}-{digest[:12]}", library)


def _machine(made: Provenance) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in made.packages.items())
    return (
        f"{made.seconds:g} s on {made.cpu}, {made.cores} cores, {made.system}. "
        f"Python {made.python}, {versions}; {'; '.join(made.blas)}."
    )


def _form(name: str) -> str:
    forms = {"json": _JSON, "csv": "text/csv", "yaml": "text/yaml"}
    return forms.get(name.rpartition(".")[2], "text/plain")


def _file(crate: ROCrate, name: str, title: str, form: str, **properties: Any) -> Any:
    """Return the entity of a file of the archive; add it if it is not there yet."""
    if (known := crate.get(name)) is not None:
        return known
    facts = {"name": title, "encodingFormat": form} | properties
    return crate.add(File(crate, dest_path=name, properties=facts))


def _context(crate: ROCrate, identity: str, properties: dict[str, Any]) -> Any:
    """Return an entity that is no file of the archive; add it if it is not there yet."""
    if (known := crate.get(identity)) is not None:
        return known
    return crate.add(ContextEntity(crate, identity, properties))
