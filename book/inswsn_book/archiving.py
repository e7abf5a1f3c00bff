"""One zip of a release: the book, what it was made from, and a description of both."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import IO

from inswsn_book.about import About, load_about
from inswsn_book.citation import require_citations
from inswsn_book.claim_ids import new_ids, require_ids_kept, verdicts_text
from inswsn_book.crate import CRATE, Described, crate_text
from inswsn_book.files import file_digest
from inswsn_book.ledger import LEDGER, load_claims
from inswsn_book.pages import require_current_site
from inswsn_book.project import Project
from inswsn_book.provenance import repository_state
from inswsn_book.references import read_articles
from inswsn_book.runs import Run, book_runs
from inswsn_book.third_party import ThirdParty, licence_texts, load_third_party
from inswsn_book.verdicts import verdicts
from inswsn_lib.errors import InswsnError, ParameterError

#: Gives the time of every file in the archive, in seconds since 1970; else it is the day of the
#: release: https://reproducible-builds.org/specs/source-date-epoch/
EPOCH_VARIABLE = "SOURCE_DATE_EPOCH"
_SUMS = "SHA256SUMS"
# what a zip can say of a file's time
_FIRST, _LAST = datetime(1980, 1, 1, tzinfo=UTC), datetime(2107, 12, 31, 23, 59, 58, tzinfo=UTC)
_PLAIN, _EXECUTABLE = 0o100644, 0o100755
_TITLE = re.compile(r"^# +(.+)$", re.MULTILINE)

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

    Parameters
    ----------
    project : Project
        The checkout, built and committed.
    target : Path, optional
        The file to write. Default: ``_build/inswsn-<version>.zip``.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    InswsnError
        If the work tree is not a commit, the book has not been built as it is now, a citation is
        stale, an id of a claim has not been published, or a file is not ours to give.
    OSError
        If the file cannot be written; then nothing is left behind.
    """
    commit = _clean_commit(project)
    about = load_about(project.root)
    time = _time(about)
    require_citations(project)
    _require_ids_published(project)
    runs = book_runs(project)
    third_party = load_third_party(project.root)
    files = _files(project)
    _refuse_recordings(third_party, files)
    require_current_site(project, runs)
    texts = _texts(project, runs, third_party)
    described = Described(
        about=about,
        articles=read_articles(project.root, about),
        third_party=third_party,
        runs=[(project.find(run.request.chapter), run.results) for run in runs],
        titles={c.number: _title(c.source) for c in project.chapters()},
        commit=commit,
    )
    texts[CRATE] = crate_text(described, [*files, *texts])
    texts[_SUMS] = _sums(files, texts)
    target = target or project.build / f"inswsn-{about.version}.zip"
    with _whole(target) as stream:
        _write_zip(stream, files, texts, time)
    return target


def _clean_commit(project: Project) -> str:
    commit, clean = repository_state(project.root)
    if commit is None:
        raise InswsnError(
            f"{project.root} is not a git checkout; an archive is made of what git keeps."
        )
    if not clean:
        raise InswsnError(
            f"{project.root} has changes that are not committed; an archive is made of a commit."
        )
    return commit


def _require_ids_published(project: Project) -> None:
    require_ids_kept(project)
    if new := new_ids(project):
        raise InswsnError(
            f"data/claim-ids.txt lacks {new[0]}, which is in the ledger; add it: make publish."
        )


def _time(about: About) -> datetime:
    """Return the time that every file in the archive has."""
    said = os.environ.get(EPOCH_VARIABLE)
    try:
        if said:
            time = datetime.fromtimestamp(int(said), UTC)
        else:
            time = datetime.fromisoformat(about.released).replace(tzinfo=UTC)
    except (ValueError, OverflowError, OSError):
        time = None
    if time is None or not _FIRST <= time <= _LAST:
        raise ParameterError(
            EPOCH_VARIABLE if said else "released",
            said or about.released,
            "a time from 1980 to 2107" + (" in seconds since 1970" if said else ""),
        )
    return time


def _files(project: Project) -> dict[str, Path]:
    """Return the files that are taken as they are, by their places in the archive."""
    files = {name: project.root / name for name in _tracked(project.root)}
    for path in sorted(project.site.rglob("*")):
        # .buildinfo and the renderer's key are notes of the build to itself
        if path.is_file() and not path.name.startswith("."):
            files[f"site/{path.relative_to(project.site).as_posix()}"] = path
    return files


def _tracked(root: Path) -> list[str]:
    done = subprocess.run(
        ["git", "-C", str(root), "ls-files", "-z"], capture_output=True, check=True
    )
    return [name for name in done.stdout.decode("utf-8").split("\0") if name]


def _texts(project: Project, runs: list[Run], third_party: ThirdParty) -> dict[str, str]:
    """Return the files that are made for the archive, by their places in it."""
    results = [run.results for run in runs]
    judged = verdicts(load_claims(project.root / LEDGER), results)
    texts = {f"licences/{name}": text for name, text in licence_texts(third_party).items()}
    names = {chapter.number: chapter.name for chapter in project.chapters()}
    texts |= {f"executed/{names[r.request.chapter]}.ipynb": r.notebook or "" for r in runs}
    texts |= {f"results/{r.chapter}.json": r.model_dump_json(indent=1) + "\n" for r in results}
    return texts | {"index.html": _INDEX, "verdicts.json": verdicts_text(judged) + "\n"}


def _refuse_recordings(third_party: ThirdParty, files: Mapping[str, Path]) -> None:
    """Refuse a file that is one of the recordings, whatever it is called here."""
    known = {
        digest: recording.name
        for recording in third_party.recorded
        for digest in recording.files.values()
    }
    for name, path in files.items():
        if (owner := known.get(file_digest(path))) is not None:
            raise InswsnError(
                f"{name} is a file of {owner}, which is not ours to give; remove it from git."
            )


def _title(source: Path) -> str:
    found = _TITLE.search(source.read_text(encoding="utf-8"))
    return found[1] if found else source.stem


def _sums(files: Mapping[str, Path], texts: Mapping[str, str]) -> str:
    """Return the digests of all files in the form that ``sha256sum -c`` reads."""
    digests = {name: file_digest(path) for name, path in files.items()}
    digests |= {name: sha256(text.encode()).hexdigest() for name, text in texts.items()}
    return "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))


def _write_zip(
    stream: IO[bytes], files: Mapping[str, Path], texts: Mapping[str, str], time: datetime
) -> None:
    with zipfile.ZipFile(stream, "w") as archive:
        for name in sorted({*files, *texts}):
            entry = zipfile.ZipInfo(name, time.timetuple()[:6])
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, wherever it is written, so that the modes count
            content = texts[name].encode() if name in texts else files[name].read_bytes()
            runs = name in files and files[name].stat().st_mode & 0o100
            entry.external_attr = (_EXECUTABLE if runs else _PLAIN) << 16
            archive.writestr(entry, content, compresslevel=9)


@contextmanager
def _whole(target: Path) -> Iterator[IO[bytes]]:
    """Open a file that appears under its name when it is complete, or not at all."""
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            yield stream
        Path(temporary).chmod(0o644)
        Path(temporary).replace(target)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
