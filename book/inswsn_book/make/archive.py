"""A release: one zip of the book and what it was made from, described by an RO-Crate."""

from __future__ import annotations

import io
import json
import os
import subprocess
import zipfile
from collections.abc import Collection, Mapping, Sequence
from datetime import datetime
from hashlib import sha256
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import click
from rocrate.model import ContextEntity, File
from rocrate.rocrate import ROCrate

from inswsn_book.judge.claims import judge, verdicts_text
from inswsn_book.make.cli import run_command
from inswsn_book.make.pages import plain_notebooks
from inswsn_book.make.site import require_current_site
from inswsn_book.record.files import MANIFEST, manifest_text, write_whole
from inswsn_book.record.project import Project, find_root
from inswsn_book.record.provenance import repository_state
from inswsn_book.record.results import results_text
from inswsn_book.run.store import Run, book_runs
from inswsn_lib.errors import InswsnError, ParameterError

#: Whose style sheets, scripts, fonts and icons the site holds; THIRD-PARTY.md says which
SITE_PACKAGES = (
    *("sphinx", "pygments", "pydata-sphinx-theme", "sphinx-book-theme", "sphinx-copybutton"),
    *("sphinx-design", "myst-nb", "sphinx-exercise", "sphinx-proof"),
    "packaging",  # its text of Apache-2.0 stands for sphinx-mathjax-offline, which ships none
)
# What each chapter run is: https://www.researchobject.org/workflow-run-crate/profiles/process_run_crate
_PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
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
    about, runs = project.about(), book_runs(project)
    require_current_site(project, runs)
    content = _kept_files(project) | _made_files(project, runs)
    content["ro-crate-metadata.json"] = _crate_text(project, runs, commit, content).encode()
    digests = {name: sha256(content[name]).hexdigest() for name in content}
    content[MANIFEST] = manifest_text(digests.items()).encode()
    target = target or project.build / f"inswsn-{about['version']}.zip"
    write_whole(target, _zipped(project.root, content, about["date-released"]))
    return target


def _kept_files(project: Project) -> dict[str, bytes]:
    """Return the files that are taken as they are, by their places in the archive."""
    listing = ["git", "-C", str(project.root), "ls-files", "-z"]
    tracked = subprocess.run(listing, capture_output=True, check=True, text=True).stdout
    files = {name: project.root / name for name in tracked.split("\0") if name}
    for path in sorted(project.site.rglob("*")):
        # .buildinfo, the renderer's key and the manifest are notes of the build to itself
        name = path.relative_to(project.site).as_posix()
        if path.is_file() and not name.startswith((".", MANIFEST)):
            files[f"site/{name}"] = path
    return {name: path.read_bytes() for name, path in files.items()}


def _made_files(project: Project, runs: Sequence[Run]) -> dict[str, bytes]:
    """Return the files that are made for the archive, by their places in it."""
    judged = judge(project.root, [run.results for run in runs])
    texts = {"index.html": _INDEX, "verdicts.json": verdicts_text(judged) + "\n"}
    plain = plain_notebooks(project, runs)
    for run in runs:
        name = project.by_id(run.request.chapter).name
        texts[f"executed/{name}.ipynb"] = plain[Path(name).name]
        texts[f"results/{run.request.chapter}.json"] = results_text(run.results)
    for package in SITE_PACKAGES:
        for file in distribution(package).files or []:
            if "LICENSE" in file.name.upper() and ".dist-info" in str(file):
                texts[f"licences/{package}/{file.name}"] = file.read_text(encoding="utf-8")
    return {name: text.encode() for name, text in texts.items()}


def _zipped(root: Path, content: Mapping[str, bytes], day: str) -> bytes:
    """Return a zip in which every file has one time, so that the same files give the same zip."""
    time = datetime.fromisoformat(day).timetuple()[:6]
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in sorted(content):
            entry = zipfile.ZipInfo(name, time)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, wherever it is written, so that the modes count
            entry.external_attr = (0o100755 if os.access(root / name, os.X_OK) else 0o100644) << 16
            archive.writestr(entry, content[name], compresslevel=9)
    return stream.getvalue()


def _crate_text(project: Project, runs: Sequence[Run], commit: str, names: Collection[str]) -> str:
    """Return ``ro-crate-metadata.json``: what was made from what, for programs."""
    crate, about = ROCrate(version="1.1"), project.about()

    def entity(identity: str, **properties: Any) -> Any:
        return crate.add(ContextEntity(crate, identity, properties))

    def file(name: str) -> Any:
        return crate.get(name) or crate.add(File(crate, dest_path=name, properties={"name": name}))

    root = crate.root_dataset
    root["name"], root["description"] = about["title"], about["abstract"]
    root["datePublished"], root["version"] = about["date-released"], about["version"]
    root["license"] = f"https://spdx.org/licenses/{about['license']}"
    root["author"] = about["names"]
    root["conformsTo"] = entity(_PROFILE, **{"@type": "CreativeWork", "name": "Process Run Crate"})
    software = entity("#inswsn", **{
        "@type": "SoftwareApplication", "name": "inswsn", "softwareVersion": about["version"],
        "identifier": commit, "softwareRequirements": [file(path.name) for path in project.locks],
    })  # fmt: skip
    root["mentions"] = []
    for run in runs:
        chapter, results = project.by_id(run.request.chapter), run.results
        # what a chapter reads of a part of a file is named file#part
        read = sorted({name.partition("#")[0] for name in results.data} & set(names))
        action = entity(f"#run-{chapter.id}", **{
            "@type": "CreateAction",
            "name": f"Run of chapter {chapter.name}",
            "instrument": [file(f"chapters/{chapter.name}.md"), software],
            "object": [
                *(
                    entity(f"#{chapter.id}-{name}",
                           **{"@type": "PropertyValue", "name": name, "value": value})
                    for name, value in results.parameters.items()
                ),
                *map(file, read),
                *(file(path.name) for path in project.locks),
            ],
            "result": [
                file(f"executed/{chapter.name}.ipynb"), file(f"results/{chapter.id}.json"),
            ],
        })  # fmt: skip
        root.append_to("mentions", action)
    text = json.dumps(crate.metadata.generate(), indent=1, ensure_ascii=False, allow_nan=False)
    return text + "\n"


@click.command()
@click.option("--output", type=click.Path(dir_okay=False, path_type=Path), help="The zip to write.")
def main(output: Path | None) -> None:
    """Write one zip of the built release."""
    if output is not None and output.suffix != ".zip":
        raise ParameterError("--output", str(output), "a file that ends in .zip")
    project = Project(find_root())
    with project.build_lock():
        written = write_archive(project, output)
    click.echo(f"wrote {written} ({written.stat().st_size / 1e6:.1f} MB)")


if __name__ == "__main__":
    run_command(main)
