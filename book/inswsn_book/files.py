"""Files and folders that are written whole or not at all, and the digests of their content."""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path


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


def swap_folder(new: Path, site: Path) -> None:
    """Put a new folder in the place of the old one; put the old one back if that fails."""
    old = _set_aside(site)
    try:
        if site.exists():
            site.rename(old)
        new.rename(site)
    except BaseException:  # an interrupt may fall between the two
        restore_site(site)
        raise
    shutil.rmtree(old, ignore_errors=True)


def restore_site(site: Path) -> None:
    """Undo a swap that was cut short: put the old site back, or clear it away."""
    old = _set_aside(site)
    if old.exists() and not site.exists():
        old.rename(site)
    elif old.exists():
        shutil.rmtree(old)


def _set_aside(site: Path) -> Path:
    # no name that a user would give to a folder of his own
    return site.with_name(f".{site.name}.inswsn-set-aside")
