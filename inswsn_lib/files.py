"""Files that are written whole or not at all, and the digests that name their content."""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer

from inswsn_lib.errors import InswsnError


def write_whole(path: Path, text: str) -> None:
    """Write a text file in one step: a reader sees the old file or the new one, never a part.

    Parameters
    ----------
    path : Path
        Where to write; the folder is made if it is absent.
    text : str
        The whole content, written as UTF-8.

    Raises
    ------
    OSError
        If the folder cannot be written. Nothing is left behind.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib.files import write_whole
    >>> with TemporaryDirectory() as folder:
    ...     write_whole(Path(folder) / "new" / "name.txt", "whole")
    ...     [path.name for path in (Path(folder) / "new").iterdir()]
    ['name.txt']
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


# LibYAML finds the tokens several times as fast. The nodes are put together by PyYAML in any case:
# too deep a nesting is then an error of Python, by which LibYAML would crash.
_PARSERS: tuple[Any, ...] = (
    (Composer, yaml.CSafeLoader) if yaml.__with_libyaml__ else (yaml.SafeLoader,)
)


class _Loader(*_PARSERS):  # type: ignore[misc]
    """YAML without repeated keys, without dates, and with 1e-1 as a number, as in YAML 1.2."""

    def __init__(self, text: str) -> None:
        _PARSERS[-1].__init__(self, text)
        Composer.__init__(self)

    yaml_implicit_resolvers = {  # noqa: RUF012  # as in the base class
        first: [(tag, pattern) for tag, pattern in resolvers if not tag.endswith(":timestamp")]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """Construct a mapping; refuse a key that is there already."""
        keys = set()
        for key_node, _ in node.value:
            key = key_node.value if isinstance(key_node, yaml.ScalarNode) else None
            if key is not None and key in keys:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key} is repeated", key_node.start_mark
                )
            keys.add(key)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+(\.\d*)?|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


def read_yaml(path: Path) -> Any:
    """Read a YAML file.

    Parameters
    ----------
    path : Path
        The file, UTF-8.

    Returns
    -------
    object
        Mappings, lists, texts, numbers, truth values and None; a date is a text.

    Raises
    ------
    InswsnError
        If there is no such file, it is not YAML, or a key is repeated; the sentence says where.

    Examples
    --------
    A number in powers of ten is a number, and a repeated key is refused:

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib.errors import InswsnError
    >>> from inswsn_lib.files import read_yaml, write_whole
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder) / "values.yaml"
    ...     write_whole(path, "{gamma: 1e-1, steps: 100}")
    ...     read_yaml(path)
    ...     write_whole(path, "{gamma: 1, gamma: 2}")
    ...     try:
    ...         read_yaml(path)
    ...     except InswsnError as error:
    ...         "the key gamma is repeated" in str(error)
    {'gamma': 0.1, 'steps': 100}
    True
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except FileNotFoundError:
        raise InswsnError(f"There is no {path}.") from None
    except RecursionError:
        raise InswsnError(
            f"{path} is not YAML that can be read: it is nested too deeply."
        ) from None
    except (yaml.YAMLError, ValueError) as error:
        said = " ".join(str(error).split())[:300]
        raise InswsnError(f"{path} is not YAML: {said}.") from None


def text_digest(text: str) -> str:
    """Return the SHA-256 of a text's UTF-8 bytes as 64 hexadecimal digits.

    Parameters
    ----------
    text : str
        The text.

    Returns
    -------
    str

    Examples
    --------
    >>> from inswsn_lib.files import text_digest
    >>> text_digest("abc")[:16]  # the example of FIPS 180-2
    'ba7816bf8f01cfea'
    """
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes as 64 hexadecimal digits.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    str

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib.files import file_digest, text_digest, write_whole
    >>> with TemporaryDirectory() as folder:
    ...     write_whole(Path(folder) / "abc.txt", "abc")
    ...     file_digest(Path(folder) / "abc.txt") == text_digest("abc")
    True
    """
    return hashlib.sha256(path.read_bytes()).hexdigest()


def tree_digest(root: Path, paths: Iterable[Path]) -> str:
    """Return one SHA-256 for a set of files: of their names below `root` and their contents.

    Parameters
    ----------
    root : Path
        Folder that the names are relative to.
    paths : iterable of Path
        The files, in any order.

    Returns
    -------
    str
        64 hexadecimal digits.

    Examples
    --------
    The same content below another name has another digest; the folder itself has no part in it:

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib.files import tree_digest, write_whole
    >>> def digest(name):
    ...     with TemporaryDirectory() as folder:
    ...         write_whole(Path(folder) / name, "abc")
    ...         return tree_digest(Path(folder), Path(folder).iterdir())
    >>> digest("a.txt") == digest("a.txt"), digest("a.txt") == digest("b.txt")
    (True, False)
    """
    digest = hashlib.sha256()
    for path in sorted(set(paths)):
        digest.update(f"{path.relative_to(root).as_posix()}\0{file_digest(path)}\n".encode())
    return digest.hexdigest()
