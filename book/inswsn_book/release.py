"""A release on the public host: the tag that names it, and the files that are attached to it."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

from inswsn_book.about import load_about
from inswsn_book.files import file_digest, swap_folder, write_whole
from inswsn_book.pages import chapter_page
from inswsn_book.project import Project
from inswsn_book.runs import book_runs
from inswsn_lib.errors import InswsnError, ParameterError

#: What the release says, beside its files in ``_build/release``.
NOTES = "NOTES.md"


def check_tag(project: Project, tag: str) -> None:
    """Refuse a tag that does not name the version of the checkout, or a version without notes.

    Parameters
    ----------
    project : Project
        The checkout.
    tag : str
        For example ``"v1.0.0"``.

    Raises
    ------
    InswsnError
        If the tag is another one, or CHANGELOG.md has no section on the version.
    """
    wanted = f"v{load_about(project.root).version}"
    if tag != wanted:
        raise ParameterError("TAG", tag, f"{wanted}, since pyproject.toml has that version")
    release_notes(project)


def release_notes(project: Project) -> str:
    """Return what CHANGELOG.md says of the version of the checkout.

    Parameters
    ----------
    project : Project
        The checkout.

    Raises
    ------
    InswsnError
        If it has no section on the version, or says nothing there.
    """
    version = load_about(project.root).version
    text = (project.root / "CHANGELOG.md").read_text(encoding="utf-8")
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        title, _, body = section.partition("\n")
        if title.split()[:1] == [version] and body.strip():
            return f"{body.strip()}\n"
    raise InswsnError(f"CHANGELOG.md has no section on {version}, the version in pyproject.toml.")


def gather_assets(project: Project) -> Path:
    """Put what is attached to the release into ``_build/release``, and return that folder.

    It holds `NOTES` and, in ``assets/``, the archive, the executed notebooks with their provenance,
    and ``SHA256SUMS`` of all of them.

    Parameters
    ----------
    project : Project
        The checkout, after `make book` and `make archive`.

    Raises
    ------
    InswsnError
        If a chapter has not been built as it is now, there is no archive, or no notes.
    OSError
        If a folder cannot be written; then the last one stays as it was.
    """
    notes = release_notes(project)
    archive = project.build / f"inswsn-{load_about(project.root).version}.zip"
    if not archive.is_file():
        raise InswsnError(f"There is no {archive.name} in {archive.parent}; make it: make archive.")
    runs = book_runs(project)
    folder = project.build / "release"
    with tempfile.TemporaryDirectory(dir=project.build, prefix="release-") as name:
        made = Path(name) / "release"
        assets = made / "assets"
        for run in runs:
            chapter = project.find(run.request.chapter)
            write_whole(assets / f"{chapter.name}.ipynb", chapter_page(project, run))
        shutil.copy(archive, assets)
        write_whole(assets / "SHA256SUMS", _digests(sorted(assets.iterdir())))
        write_whole(made / NOTES, notes)
        swap_folder(made, folder)
    return folder


def _digests(files: Sequence[Path]) -> str:
    # the form that sha256sum --check reads
    return "".join(f"{file_digest(path)}  {path.name}\n" for path in files)
