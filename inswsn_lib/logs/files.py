"""Where the files of a recording are: in a folder, or fetched once from a public repository.

Of those that are fetched the digests are checked, so that who reads them need not examine them.
"""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from inswsn_lib.errors import InswsnError
from inswsn_lib.extras import need
from inswsn_lib.files import DATA_VARIABLE

#: A folder or a file, or files by their names
Place = str | Path | Mapping[str, Path]

_TIMEOUT = (10.0, 30.0)  # s: to connect, and between two pieces of an answer


class RecordingUnavailableError(InswsnError):
    """The files of a recording are unavailable: no network, and no local mirror that has them."""


@dataclass(frozen=True)
class Known:
    """A known recording: its licence, how many coordinates it has, and where its files are.

    They are in a folder of a GitHub repository (``owner/name``), with the SHA-256 of each.
    """

    licence: str
    dimension: int
    repository: str
    commit: str
    folder: str
    digests: Mapping[str, str]


def locate(known: Known, cache: Path | None = None) -> dict[str, Path]:
    """Return where the files are, by name; fetch those that are not there.

    If ``INSWSN_DATA`` is set, it names a local mirror, and nothing is fetched. Else the files come
    from GitHub once and stay in the cache (the user's by default), which has a mirror's layout.
    """
    place = Path(known.repository.replace("/", "__"), known.commit, known.folder)
    if mirror := os.environ.get(DATA_VARIABLE):
        found = {name: Path(mirror) / place / name for name in known.digests}
        for name, path in found.items():
            if not path.is_file():
                raise RecordingUnavailableError(
                    f"There is no file {path}; {DATA_VARIABLE} may name a mirror that has it."
                )
            if _digest(path) != (digest := known.digests[name]):
                raise InswsnError(
                    f"{path} is not the original: its SHA-256 does not begin {digest[:12]}."
                )
        return found
    with warnings.catch_warnings():
        # pooch imports tqdm, which in a notebook without widgets warns on stderr
        warnings.simplefilter("ignore")
        pooch = need("pooch", "To fetch a recording")
    store = pooch.create(
        path=(cache or pooch.os_cache("inswsn")) / place,
        base_url=f"https://raw.githubusercontent.com/{known.repository}/{known.commit}/{known.folder}/",
        registry={name: f"sha256:{digest}" for name, digest in known.digests.items()},
    )
    logger, level = pooch.get_logger(), pooch.get_logger().level
    logger.setLevel("ERROR")  # else it tells on stderr what it fetches
    try:
        fetch = pooch.HTTPDownloader(timeout=_TIMEOUT)
        return {name: Path(store.fetch(name, downloader=fetch)) for name in known.digests}
    except (OSError, ValueError) as error:  # requests' errors are OSErrors; ValueError: the digest
        said = type(error).__name__ if isinstance(error, OSError) else "its SHA-256 is another"
        raise RecordingUnavailableError(
            f"{', '.join(known.digests)} could not be fetched from {store.base_url} ({said}); "
            f"{DATA_VARIABLE} may name a local mirror of it."
        ) from None
    finally:
        logger.setLevel(level)


def files_of(place: Place) -> dict[str, Path]:
    """Return the files of a folder by their names; a file alone is one of them."""
    if isinstance(place, Mapping):
        return dict(place)
    path = Path(place)
    if not path.exists():
        raise InswsnError(f"There is no folder {path}.")
    found = sorted(path.iterdir()) if path.is_dir() else [path]
    return {each.name: each for each in found if each.is_file()}


def pick(files: Mapping[str, Path], pattern: str) -> Path:
    """Return the one file whose name fits a pattern, such as ``*.mat``."""
    fitting = [name for name in files if fnmatchcase(name, pattern)]
    if len(fitting) == 1:
        return files[fitting[0]]
    where = f" in {next(iter(files.values())).parent}" if files else ""
    if fitting:
        raise InswsnError(f"There are {', '.join(fitting)}{where}; there must be one {pattern}.")
    raise InswsnError(f"There is no file {pattern}{where}.")


def digests_of(*paths: Path) -> dict[str, str]:
    """Return the SHA-256 of files by their names."""
    return {path.name: _digest(path) for path in paths}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
