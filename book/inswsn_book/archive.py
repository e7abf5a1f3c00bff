"""A release: one zip of the book and what it was made from, described by an RO-Crate.

``python -m inswsn_book.archive`` writes the zip; with ``tag v2.0.0`` it tells whether a tag names
this version, with ``assets`` it gathers what is attached to a release.
"""

from __future__ import annotations

import io
import json
import re
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from hashlib import sha256
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import click
from rocrate.model import ContextEntity, Dataset, File
from rocrate.rocrate import ROCrate

from inswsn_book.cli import run_command
from inswsn_book.files import file_digest, swap_folder, write_whole
from inswsn_book.judging import verdicts_text
from inswsn_book.ledger import LEDGER, load_claims
from inswsn_book.pages import require_current_site
from inswsn_book.project import Project, find_root
from inswsn_book.provenance import repository_state
from inswsn_book.publishing import CLAIM_IDS, compare_ids
from inswsn_book.runs import Run, book_runs
from inswsn_book.verdicts import verdicts
from inswsn_lib.errors import InswsnError, ParameterError

#: Whose style sheets, scripts, fonts and icons the site holds; THIRD-PARTY.md says which
SITE_PACKAGES = (
    *("sphinx", "pygments", "pydata-sphinx-theme", "sphinx-book-theme", "sphinx-copybutton"),
    *("sphinx-togglebutton", "sphinx-design", "myst-nb", "sphinx-exercise", "sphinx-proof"),
    "packaging",  # its text of Apache-2.0 stands for sphinx-mathjax-offline, which ships none
)
_PLAIN, _EXECUTABLE = 0o100644, 0o100755
_LOCKS = ("environment.lock", "environment-torch.lock")
_DIGEST = re.compile(r"\b[0-9a-f]{64}\b")
_TITLE = re.compile(r"^# +(.+)$", re.MULTILINE)
# What each chapter run is: https://www.researchobject.org/workflow-run-crate/profiles/process_run_crate
_PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
_FOLDERS = {
    "site/": "The rendered book; index.html opens it without a network",
    "executed/": "The executed chapters with their outputs",
    "results/": "What each chapter found, with the parameters and the provenance of its run",
    "licences/": "The licences of what the site holds of the programs that made it",
    "inswsn_lib/": "The science library",
    "book/": "The pages around the chapters, and the machinery of the book",
    "chapters/": "The chapters, as MyST notebooks and as notebooks without outputs",
    "data/": "What the papers print and claim, scenarios, reference results",
    "tests/": "The tests",
}
_INDEX = """\
<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta http-equiv="refresh" content="0; url=site/index.html">
<title>inswsn</title>
<p><a href="site/index.html">Open the book</a>
</html>
"""


def write_archive(project: Project, target: Path | None = None) -> Path:
    """Write the archive of the present release.

    It holds every file that git keeps, the built site, the executed notebooks, the results, the
    verdicts, the licences of what the site holds of others, and the description of it all. Two
    archives of one build are the same, byte for byte.
    """
    commit, clean = repository_state(project.root)
    if commit is None or not clean:
        state = "has changes that are not committed" if commit else "is no git checkout"
        raise InswsnError(f"{project.root} {state}; an archive is made of a commit.")
    about = project.about()
    lost, new = compare_ids(project)
    if lost or new:
        raise InswsnError(f"{CLAIM_IDS} and the ledger differ, in {(lost + new)[0]}: make publish.")
    runs = book_runs(project)
    require_current_site(project, runs)
    files = _files(project)
    texts = _texts(project, runs)
    _refuse_recordings(project, files)
    texts["ro-crate-metadata.json"] = _crate_text(project, runs, commit, [*files, *texts])
    texts["SHA256SUMS"] = _sums(files, texts)
    target = target or project.build / f"inswsn-{about.version}.zip"
    write_whole(target, _zipped(files, texts, about.released))
    return target


def _files(project: Project) -> dict[str, Path]:
    """Return the files that are taken as they are, by their places in the archive."""
    done = subprocess.run(
        ["git", "-C", str(project.root), "ls-files", "-z"], capture_output=True, check=True
    )
    files = {name: project.root / name for name in done.stdout.decode().split("\0") if name}
    for path in sorted(project.site.rglob("*")):
        # .buildinfo and the renderer's key are notes of the build to itself
        if path.is_file() and not path.name.startswith("."):
            files[f"site/{path.relative_to(project.site).as_posix()}"] = path
    return files


def _texts(project: Project, runs: Sequence[Run]) -> dict[str, str]:
    """Return the files that are made for the archive, by their places in it."""
    judged = verdicts(load_claims(project.root / LEDGER), [run.results for run in runs])
    texts = {"index.html": _INDEX, "verdicts.json": verdicts_text(judged) + "\n"}
    for run in runs:
        name = project.find(run.request.chapter).name
        texts[f"executed/{name}.ipynb"] = run.notebook or ""
        texts[f"results/{run.request.chapter}.json"] = run.results.model_dump_json(indent=1) + "\n"
    for package in SITE_PACKAGES:
        for file in distribution(package).files or []:
            if "LICENSE" in file.name.upper() and ".dist-info" in str(file):
                texts[f"licences/{package}/{file.name}"] = file.read_text(encoding="utf-8")
    return texts


def _refuse_recordings(project: Project, files: Mapping[str, Path]) -> None:
    """Refuse a file that is one of the recordings of THIRD-PARTY.md, whatever it is called here."""
    others = set(_DIGEST.findall((project.root / "THIRD-PARTY.md").read_text(encoding="utf-8")))
    for name, path in files.items():
        if file_digest(path) in others:
            raise InswsnError(f"{name} is not ours to give (THIRD-PARTY.md); remove it from git.")


def _sums(files: Mapping[str, Path], texts: Mapping[str, str]) -> str:
    """Return the digests of all files in the form that ``sha256sum -c`` reads."""
    digests = {name: file_digest(path) for name, path in files.items()}
    digests |= {name: sha256(text.encode()).hexdigest() for name, text in texts.items()}
    return "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))


def _zipped(files: Mapping[str, Path], texts: Mapping[str, str], day: str) -> bytes:
    """Return a zip in which every file has one time, so that the same files give the same zip."""
    time = datetime.fromisoformat(day).timetuple()[:6]
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in sorted({*files, *texts}):
            entry = zipfile.ZipInfo(name, time)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, wherever it is written, so that the modes count
            content = texts[name].encode() if name in texts else files[name].read_bytes()
            runs = name in files and files[name].stat().st_mode & 0o100
            entry.external_attr = (_EXECUTABLE if runs else _PLAIN) << 16
            archive.writestr(entry, content, compresslevel=9)
    return stream.getvalue()


# The description


def _crate_text(project: Project, runs: Sequence[Run], commit: str, names: Sequence[str]) -> str:
    """Return ``ro-crate-metadata.json``; nothing in it is random or of the time of the call."""
    crate, about = ROCrate(version="1.1"), project.about()
    root = crate.root_dataset
    root["name"], root["description"] = about.title, about.abstract
    root["datePublished"], root["version"] = about.released, about.version
    root["keywords"] = ", ".join(about.keywords)
    root["license"] = [_licence(crate, name) for name in (about.licence, "CC-BY-4.0")]
    root["author"] = [
        _entity(crate, f"#author-{i}", {"@type": "Organization", "name": name})
        for i, name in enumerate(about.authors, 1)
    ]
    root["citation"] = [_article(crate, reference) for reference in about.references]
    if about.doi is not None:
        root["identifier"] = f"https://doi.org/{about.doi}"
    if about.repository is not None:
        root["url"] = about.repository
    root["conformsTo"] = _entity(
        crate, _PROFILE, {"@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"}
    )
    root["mentions"] = []
    _entity(crate, "#inswsn", {
        "@type": "SoftwareApplication", "name": "inswsn", "softwareVersion": about.version,
        "identifier": commit, "description": "The library and the command, from that commit.",
        "softwareRequirements": [{"@id": name} for name in _LOCKS],
    })  # fmt: skip
    for folder, title in _FOLDERS.items():
        if any(name.startswith(folder) for name in names):
            crate.add(Dataset(crate, dest_path=folder, properties={"name": title}))
    for name in (*_LOCKS, "verdicts.json", "SHA256SUMS"):
        _file(crate, name, name)
    for run in runs:
        _describe_run(crate, project, run, names)
    text = json.dumps(crate.metadata.generate(), indent=1, ensure_ascii=False, allow_nan=False)
    return text + "\n"


def _article(crate: ROCrate, reference: Mapping[str, Any]) -> Any:
    authors = [f"{a['given-names']} {a['family-names']}" for a in reference["authors"]]
    facts = {"name": reference["title"], "datePublished": str(reference["year"])}
    return _entity(
        crate,
        f"https://doi.org/{reference['doi']}",
        {"@type": "ScholarlyArticle", "author": ", ".join(authors), **facts},
    )


def _licence(crate: ROCrate, name: str) -> Any:
    address = f"https://spdx.org/licenses/{name}"
    return _entity(crate, address, {"@type": "CreativeWork", "name": name, "identifier": name})


def _describe_run(crate: ROCrate, project: Project, run: Run, names: Sequence[str]) -> None:
    """Add a chapter, its executed notebook, its results, and the run that made them."""
    chapter, results = project.find(run.request.chapter), run.results
    title = _TITLE.search(chapter.source.read_text(encoding="utf-8"))
    name = title[1] if title else chapter.name
    code = {"@type": ["File", "SoftwareSourceCode"], "programmingLanguage": "Python"}
    source = _file(crate, f"chapters/{chapter.name}.md", name, **code)
    # what a chapter reads of a part of a file is named file#part
    read = {entry.partition("#")[0] for entry in results.data}
    action: dict[str, Any] = {
        "@type": "CreateAction",
        "name": f"Run of chapter {chapter.number}: {name}",
        "instrument": [source, {"@id": "#inswsn"}],
        "object": [
            *(
                _entity(crate, f"#{chapter.number}-parameter-{parameter}",
                        {"@type": "PropertyValue", "name": parameter, "value": value})
                for parameter, value in results.parameters.items()
            ),
            *(_file(crate, file, f"Read by chapters: {file}") for file in sorted(read)
              if file in names),
            *({"@id": name} for name in _LOCKS),
        ],
        "result": [
            _file(crate, f"executed/{chapter.name}.ipynb", f"{name}, executed"),
            _file(crate, f"results/{chapter.number}.json", f"{name}, results"),
        ],
        "actionStatus": {"@id": "http://schema.org/CompletedActionStatus"},
    }  # fmt: skip
    if (made := results.provenance) is not None:  # which has its end to the minute
        ended = datetime.strptime(made.finished, "%Y-%m-%d %H:%M UTC").replace(tzinfo=UTC)
        action |= {
            "startTime": (ended - timedelta(seconds=round(made.seconds))).isoformat(),
            "endTime": ended.isoformat(),
            "description": (
                f"{made.seconds:g} s on {made.cpu}, {made.system}, Python {made.python}; "
                f"commit {made.commit or 'unknown'}."
            ),
        }
    crate.root_dataset.append_to("mentions", _entity(crate, f"#run-{chapter.number}", action))


def _file(crate: ROCrate, name: str, title: str, **properties: Any) -> Any:
    """Return the entity of a file of the archive; add it if it is not there yet."""
    if (known := crate.get(name)) is not None:
        return known
    return crate.add(File(crate, dest_path=name, properties={"name": title} | properties))


def _entity(crate: ROCrate, identity: str, properties: dict[str, Any]) -> Any:
    """Return an entity that is no file of the archive; add it if it is not there yet."""
    if (known := crate.get(identity)) is not None:
        return known
    return crate.add(ContextEntity(crate, identity, properties))


# A release on the public host


def check_tag(project: Project, tag: str) -> None:
    """Refuse a tag that does not name the version of the checkout, or a version without notes."""
    version = project.about().version
    if tag != f"v{version}":
        raise ParameterError("TAG", tag, f"v{version}, since CITATION.cff has that version")
    release_notes(project)


def release_notes(project: Project) -> str:
    """Return what CHANGELOG.md says of the version; `InswsnError` if it says nothing."""
    version = project.about().version
    text = (project.root / "CHANGELOG.md").read_text(encoding="utf-8")
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        title, _, body = section.partition("\n")
        if title.split()[:1] == [version] and body.strip():
            return f"{body.strip()}\n"
    raise InswsnError(f"CHANGELOG.md has no section on {version}, the version in CITATION.cff.")


def gather_assets(project: Project) -> Path:
    """Put what is attached to the release into ``_build/release``, and return that folder.

    It holds ``NOTES.md`` and, in ``assets/``, the archive, the executed notebooks, and
    ``SHA256SUMS`` of all of them.
    """
    notes = release_notes(project)
    archive = project.build / f"inswsn-{project.about().version}.zip"
    if not archive.is_file():
        raise InswsnError(f"There is no {archive.name} in {archive.parent}; make it: make archive.")
    folder = project.build / "release"
    with tempfile.TemporaryDirectory(dir=project.build, prefix="release-") as name:
        made = Path(name) / "release"
        assets = made / "assets"
        for run in book_runs(project):
            chapter = project.find(run.request.chapter)
            write_whole(assets / f"{chapter.name}.ipynb", run.notebook or "")
        shutil.copy(archive, assets)
        sums = [f"{file_digest(path)}  {path.name}\n" for path in sorted(assets.iterdir())]
        write_whole(assets / "SHA256SUMS", "".join(sums))
        write_whole(made / "NOTES.md", notes)
        swap_folder(made, folder)
    return folder


@click.group(invoke_without_command=True)
@click.option("--output", type=click.Path(dir_okay=False, path_type=Path), help="The zip to write.")
@click.pass_context
def main(context: click.Context, output: Path | None) -> None:
    """Write one zip of the built release."""
    if context.invoked_subcommand is None:
        if output is not None and output.suffix != ".zip":
            raise ParameterError("--output", str(output), "a file that ends in .zip")
        project = Project(find_root())
        with project.build_lock():
            written = write_archive(project, output)
        click.echo(f"wrote {written} ({written.stat().st_size / 1e6:.1f} MB)")


@main.command()
@click.argument("name", metavar="TAG")
def tag(name: str) -> None:
    """Tell whether TAG names this version, and whether CHANGELOG.md speaks of it."""
    check_tag(Project(find_root()), name)


@main.command()
def assets() -> None:
    """Gather what is attached to a release: archive, executed notebooks, notes."""
    project = Project(find_root())
    with project.build_lock():
        click.echo(f"The files are in {gather_assets(project)}")


if __name__ == "__main__":
    run_command(main)
