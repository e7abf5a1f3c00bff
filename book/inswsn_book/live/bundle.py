"""The Python files that a page loads: the library, what lessons show, and data as JSON."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from importlib.metadata import files, version
from pathlib import Path

from inswsn_book.record.project import Project
from inswsn_book.record.results import read_results
from inswsn_lib.files import read_yaml

# of the book's package: what lessons import, and it, what shows it, and this room
_BOOK = (
    "__init__.py", "record/parameters.py", "show", "evidence", "lessons", "live",
)  # fmt: skip
_DATA = (
    "examples/*.csv", "papers/*.csv", "papers/*.yaml", "scenarios/*.yaml",
    "recorded/on-recordings.json", "recorded/p3-drive.json",
)  # fmt: skip
_PACKAGES = ("lazy_loader", "mpmath")  # that others made, of Python alone
_TIME = (1980, 1, 1, 0, 0, 0)  # of every file, so that the same files make the same archive


def contents(project: Project) -> Iterator[tuple[str, bytes]]:
    """Give the files by the names that they have there."""
    library, book = project.libraries
    for path in _modules(library):
        yield path.relative_to(library.parent).as_posix(), path.read_bytes()
    for name in _BOOK:
        for path in _modules(book / name):
            yield f"inswsn_book/{path.relative_to(book).as_posix()}", path.read_bytes()
    yield "inswsn_book/record/__init__.py", (book / "live" / "unrecorded.py").read_bytes()
    results = [read_results(path) for path in sorted(project.published.glob("*.json"))]
    found = {
        each.chapter: {q.name: [q.value, *(q.interval or ())] for q in each.quantities}
        for each in results
    }
    yield "inswsn_lib/data/published.json", json.dumps(found, separators=(",", ":")).encode()
    for pattern in _DATA:
        for path in sorted((project.root / "data").glob(pattern)):
            content = path.read_bytes()
            if path.suffix == ".yaml":  # there is no parser of YAML, and JSON is YAML
                text = json.dumps(read_yaml(path), ensure_ascii=False, separators=(",", ":"))
                content = text.encode()
            yield f"inswsn_lib/{path.relative_to(project.root).as_posix()}", content
    for name in _PACKAGES:
        for file in sorted(files(name) or ()):
            licence = file.name.startswith("LICENSE")
            if licence or (file.suffix == ".py" and "tests" not in file.parts):
                yield file.as_posix(), file.read_binary()
    said = f"Metadata-Version: 2.1\nName: inswsn\nVersion: {version('inswsn')}\n"
    yield "inswsn.dist-info/METADATA", said.encode()


def _modules(place: Path) -> list[Path]:
    if place.is_file():
        return [place]
    return sorted(p for p in place.rglob("*.*") if p.suffix in (".py", ".pyi", ".json"))


def archive(project: Project) -> bytes:
    """Return them as one zip file."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in contents(project):
            packed.writestr(zipfile.ZipInfo(name, _TIME), content, zipfile.ZIP_DEFLATED)
    return stream.getvalue()
