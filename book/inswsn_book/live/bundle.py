"""The Python files that a page loads: the library, what lessons show, and data as JSON."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from inswsn_book.project import Project
from inswsn_lib.files import read_yaml

# of the book's package: what lessons import, what shows it, and this room
_BOOK = ("__init__.py", "legible.py", "moving.py", "parameters.py", "show.py", "lessons", "live")
_TIME = (1980, 1, 1, 0, 0, 0)  # of every file, so that the same files make the same archive


def contents(project: Project) -> Iterator[tuple[str, bytes]]:
    """Give the files by the names that they have there."""
    for path in _modules(project.root / "inswsn_lib"):
        yield path.relative_to(project.root).as_posix(), path.read_bytes()
    book = project.root / "book" / "inswsn_book"
    for name in _BOOK:
        for path in _modules(book / name):
            yield f"inswsn_book/{path.relative_to(book).as_posix()}", path.read_bytes()
    for path in sorted((project.root / "data" / "scenarios").glob("*.yaml")):
        text = json.dumps(read_yaml(path), ensure_ascii=False, separators=(",", ":"))
        yield f"inswsn_lib/data/scenarios/{path.name}", text.encode()
    for path in sorted((project.root / "data" / "examples").glob("*.csv")):
        yield f"inswsn_lib/data/examples/{path.name}", path.read_bytes()
    found = find_spec("lazy_loader")
    assert found is not None
    assert found.origin is not None
    yield "lazy_loader/__init__.py", Path(found.origin).read_bytes()
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
