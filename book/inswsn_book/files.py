"""Files and folders that are written whole or not at all, and the digests of their content."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from inswsn_lib.errors import ParameterError

# Lists what a command made in a folder. One that holds this and no more may be replaced.
_MADE = ".inswsn-run"


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
    held = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    made = folder / _MADE
    listed = set(made.read_text(encoding="utf-8").split("\n")) if made.is_file() else set()
    if (folder.exists() and not folder.is_dir()) or not held <= listed | {_MADE}:
        raise ParameterError(
            "--out", str(folder), "a new or empty folder, or one that holds an earlier run alone"
        )
    above = next(path for path in (folder.resolve(), *folder.resolve().parents) if path.exists())
    if not above.is_dir() or not os.access(above, os.W_OK):
        raise ParameterError("--out", str(folder), f"where one can write, and {above} is not")


@contextmanager
def made_folder(folder: Path) -> Iterator[Path]:
    """Give a new folder that takes the place of `folder` once all is in it."""
    check_folder(folder)
    folder = folder.resolve()
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".run-") as temporary:
        made = Path(temporary) / "run"
        made.mkdir()
        yield made
        listing = sorted(path.name for path in made.iterdir())
        write_whole(made / _MADE, "\n".join(listing) + "\n")
        replace_folder(folder, made)
