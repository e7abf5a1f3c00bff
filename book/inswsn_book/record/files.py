"""Files and folders that are written whole or not at all, with digests that are held when read.

A file of the store begins with the digest of the rest. A folder that readers see has a manifest,
which ``sha256sum -c`` reads as well.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import WRITTEN, read_bytes

#: The manifest: lists the files of its folder with their digests
MANIFEST = "SHA256SUMS"
# Marks a folder that a command made. One that holds this and what is listed alone may be replaced.
_MADE = ".inswsn-run"
_RESTORE = "restore the folder, such as by git checkout"
_LISTED = re.compile(r"([0-9a-f]{64})  (.+)\n")
# What may lie beside what is listed, at the root of an unpacked archive in which one works
_UNLISTED = (
    *("_build", "runs", ".git", ".venv", ".venvs", ".hypothesis", ".DS_Store"),
    *(".import_linter_cache", ".mypy_cache", ".pytest_cache", ".ruff_cache"),
)
# and what Python and numba keep of a module that is listed, and what a killed `write_whole` leaves
_COMPILED = re.compile(r"(.*/|)__pycache__/([^/.]+)\.[^/]*\.(pyc|nbi|nbc)")
_LEFT = re.compile(r"\.(.+)\.[a-z0-9_]{8}")


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file in one step: a reader sees the old file or the new one, never a part.

    The folder is made if it is absent; nothing is left behind if it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content.encode("utf-8") if isinstance(content, str) else content)
            stream.flush()
            os.fsync(stream.fileno())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def fill_folder(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Make a folder hold these files and no others; one that is as it should be is not touched."""
    for name, content in contents.items():
        path = folder / name
        if not path.is_file() or path.read_bytes() != content:
            write_whole(path, content)
    for path in folder.rglob("*"):
        if path.is_file() and path.relative_to(folder).as_posix() not in contents:
            path.unlink()


def text_digest(text: str) -> str:
    """Return the SHA-256 of a text's UTF-8 bytes as 64 hexadecimal digits."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes as 64 hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def tree_digest(root: Path, paths: Iterable[Path]) -> str:
    """Return one SHA-256 for a set of files: of their names below `root` and their contents."""
    digest = hashlib.sha256()
    for path in sorted(set(paths)):
        digest.update(f"{path.relative_to(root).as_posix()}\0{file_digest(path)}\n".encode())
    return digest.hexdigest()


def write_sealed(path: Path, text: str) -> None:
    """Write a file that `read_sealed` reads, whole or not at all."""
    write_whole(path, f"{text_digest(text)}\n{text}")


def read_sealed(path: Path) -> str | None:
    """Return the text of a sealed file; None if the file is not as it was written."""
    digest, _, content = path.read_bytes().partition(b"\n")
    return content.decode() if hashlib.sha256(content).hexdigest().encode() == digest else None


class Memory:
    """What has been found of texts, as plain data by their digests, kept in a file if one is given.

    A damaged file counts as none. Once there is too much, what was not asked for goes.
    """

    _MOST = 2000

    def __init__(self, path: Path | None = None) -> None:
        self._path, self._asked = path, dict[str, Any]()
        self._known: dict[str, Any] = {}
        with suppress(OSError, ValueError):
            self._known = json.loads((read_sealed(path) if path else None) or "{}")

    def of(self, key: str, find: Callable[..., Any], *arguments: Any) -> Any:
        """Return what is known by a key; it is found if nothing is."""
        if key not in self._asked:
            known = self._known
            self._asked[key] = known[key] if key in known else find(*arguments)
        return self._asked[key]

    def save(self) -> None:
        """Write what is known, unless the file has it; it need not be writable."""
        if self._path is None or self._asked.keys() <= self._known.keys():
            return
        known = self._known | self._asked
        self._known = known if len(known) <= self._MOST else dict(self._asked)
        with suppress(OSError):
            write_sealed(self._path, json.dumps(self._known))


def manifest_text(digests: Iterable[tuple[str, str]]) -> str:
    """Return a manifest of files, given by their names and digests."""
    return "".join(f"{digest}  {name}\n" for name, digest in sorted(digests))


def read_manifest(folder: Path) -> dict[str, set[str]]:
    """Return the digests that each file of a folder may have; refuse a manifest that is none."""
    path, listed = folder / MANIFEST, dict[str, set[str]]()
    if not path.is_file():
        raise InswsnError(f"There is no {path}; {_RESTORE}.")
    for line in read_bytes(path, WRITTEN).decode(errors="replace").splitlines(keepends=True):
        if not (entry := _LISTED.fullmatch(line)):
            raise InswsnError(f"{path} is damaged: {line[:80]!r} is not a digest and a name.")
        listed.setdefault(entry[2], set()).add(entry[1])
    return listed


def seal_folder(folder: Path) -> None:
    """Write the manifest of all that is in a folder."""
    digests = [(name, file_digest(folder / name)) for name in _files_below(folder)]
    write_whole(folder / MANIFEST, manifest_text(digests))


def write_listed(folder: Path, texts: Mapping[str, str]) -> None:
    """Write files into a folder with a manifest, which gets one if it has none.

    Until all are written the manifest allows both old and new, so that a kill spoils none.
    """
    listed = read_manifest(folder) if (folder / MANIFEST).exists() else {}
    old = [(name, digest) for name, digests in listed.items() for digest in digests]
    new = [(name, text_digest(text)) for name, text in texts.items()]
    write_whole(folder / MANIFEST, manifest_text({*old, *new}))
    for name, text in texts.items():
        write_whole(folder / name, text)
    seal_folder(folder)


def read_listed(path: Path) -> bytes:
    """Return the content of a file; refuse it if a manifest beside it does not vouch for it."""
    content, vouched = read_bytes(path, WRITTEN), (path.parent / MANIFEST).exists()
    digest = hashlib.sha256(content).hexdigest()
    if vouched and digest not in read_manifest(path.parent).get(path.name, ()):
        raise InswsnError(f"{path} is not the one in {MANIFEST} beside it; {_RESTORE}.")
    return content


def damages(folder: Path, *, alone: bool = False) -> list[str]:
    """Return what in a folder is not as its manifest says, a phrase each.

    What comes to lie beside it where one works in an unpacked archive counts only if what is listed
    has to be `alone`.
    """
    try:
        listed, there = read_manifest(folder), _files_below(folder)
    except InswsnError as error:
        return [str(error).rstrip(".")]
    gone, more = sorted(listed.keys() - there), sorted(there - listed.keys())
    known = [(name, folder / name) for name in sorted(there & listed.keys())]
    changed = [n for n, p in known if not p.is_file() or file_digest(p) not in listed[n]]
    return [
        *(f"{name} is gone" for name in gone),
        *(f"{name} is changed" for name in changed),
        *(f"{name} is not listed" for name in more if alone or not _is_beside(name, listed)),
    ]


def _is_beside(name: str, listed: Collection[str]) -> bool:
    if compiled := _COMPILED.fullmatch(name):
        return f"{compiled[1]}{compiled[2]}.py" in listed
    left = _LEFT.fullmatch(name)
    return name.partition("/")[0] in _UNLISTED or (left is not None and left[1] in listed)


def check_listed(folder: Path) -> None:
    """Refuse a folder that is there and is not as its manifest says."""
    if folder.exists() and (damaged := damages(folder)):
        raise InswsnError(f"{folder}: {few(damaged)}; {_RESTORE}.")


def few(phrases: Sequence[str]) -> str:
    """Return the first of many phrases, and how many more there are."""
    more = f" and {len(phrases) - 3} more" if len(phrases) > 3 else ""
    return "; ".join(phrases[:3]) + more


def _files_below(folder: Path) -> set[str]:
    paths = (path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir())
    return {path.relative_to(folder).as_posix() for path in paths} - {MANIFEST}


@contextmanager
def temporary_folder(parent: Path | None = None) -> Iterator[Path]:
    """Give a temporary folder; those of killed processes go first."""
    remove_left(parent := parent or Path(tempfile.gettempdir()))
    with tempfile.TemporaryDirectory(dir=parent, prefix=f"{_temporary()}{os.getpid()}-") as name:
        yield Path(name)


def remove_left(parent: Path) -> None:
    """Remove the temporary folders of processes of this machine that were killed."""
    for left in parent.glob(f"{_temporary()}*") if Path("/proc").is_dir() else ():
        if not Path("/proc", left.name.split("-")[2]).exists():
            shutil.rmtree(left, ignore_errors=True)


def _temporary() -> str:
    return f".inswsn-{text_digest(platform.node())[:6]}-"


def replace_folder(old: Path, new: Path) -> None:
    """Put a new folder in the place of an old one, which goes where the new one was made.

    The new one lies in a temporary folder of the same disk.
    """
    aside = new.parent / "replaced"
    if old.exists():
        old.rename(aside)
    try:
        new.rename(old)
    except BaseException:  # an interrupt may fall between the two
        if aside.exists():
            aside.rename(old)
        raise


def check_folder(folder: Path) -> None:
    """Refuse a folder that `made_folder` may not replace or make: told before anything runs."""
    must_be = "a new or empty folder, or one that holds only an unchanged earlier run"
    held = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    if (folder.exists() and not folder.is_dir()) or (held and not {_MADE, MANIFEST} <= held):
        raise ParameterError("--out", str(folder), must_be)
    own = [said for said in damages(folder, alone=True) if not said.endswith(" is gone")]
    if held and own:
        raise ParameterError("--out", str(folder), f"{must_be} ({few(own)})")
    above = next(path for path in (folder.resolve(), *folder.resolve().parents) if path.exists())
    if not above.is_dir() or not os.access(above, os.W_OK):
        raise ParameterError("--out", str(folder), f"somewhere writable ({above} is not)")


@contextmanager
def made_folder(folder: Path) -> Iterator[Path]:
    """Give a new folder that takes the place of `folder` once all is in it."""
    check_folder(folder)
    folder = folder.resolve()
    folder.parent.mkdir(parents=True, exist_ok=True)
    with temporary_folder(folder.parent) as temporary:
        made = temporary / "run"
        made.mkdir()
        yield made
        write_whole(made / _MADE, "")
        seal_folder(made)
        replace_folder(folder, made)
