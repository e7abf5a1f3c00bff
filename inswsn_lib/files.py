"""Files that the library reads: those that it carries, YAML, and the folder of recorded data."""

from __future__ import annotations

import json
import os
import re
import stat
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer

from inswsn_lib.errors import InswsnError

#: Set by a user: a local folder with recorded data, ``<owner>__<repo>/<commit>/<path>`` in it.
DATA_VARIABLE = "INSWSN_DATA"

#: Bytes that a file of recorded data may have, and one of parameters or results
RECORDED, WRITTEN = 2 * 10**9, 10**8
_PIECE = 1 << 22  # bytes that are read at once

_PACKAGE = Path(__file__).parent


def data_file(name: str) -> Path:
    """Return the path of a file or folder of the library's data.

    An installed library carries the scenarios and the example recording; one that is used from a
    checkout reads the checkout's own.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> iw.data_file("examples/ins-wsn.csv").name
    'ins-wsn.csv'
    """
    for folder in (_PACKAGE / "data", _PACKAGE.parent / "data"):
        if (folder / name).exists():
            return folder / name
    raise InswsnError(f"There is no data file {name!r}: neither in the package nor in a checkout.")


def data_mirror() -> Path | None:
    """Return the local folder with recorded data that ``INSWSN_DATA`` names; None if there is none.

    Examples
    --------
    >>> import os
    >>> from unittest.mock import patch
    >>> from inswsn_lib.files import DATA_VARIABLE, data_mirror
    >>> with patch.dict(os.environ, {DATA_VARIABLE: ""}):
    ...     data_mirror() is None
    True
    """
    named = os.environ.get(DATA_VARIABLE)
    if not named:
        return None
    folder = Path(named).absolute()
    return folder if folder.is_dir() else None


def read_bytes(path: Path, most: int = RECORDED) -> bytes:
    """Read a file that a user may have named.

    Parameters
    ----------
    path : Path
    most : int
        Bytes that it may have.

    Raises
    ------
    InswsnError
        If it is not there, cannot be read, is no regular file (a device or a pipe may never end),
        or has more.

    Examples
    --------
    >>> from pathlib import Path
    >>> from inswsn_lib.files import read_bytes
    >>> read_bytes(Path("/dev/zero"))
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.InswsnError: /dev/zero is not a regular file.
    """
    return b"".join(read_pieces(path, most))


def read_pieces(path: Path, most: int = RECORDED) -> Iterator[bytes]:
    """Yield what `read_bytes` returns in pieces of some megabytes.

    Examples
    --------
    >>> from inswsn_lib.files import data_file, read_pieces
    >>> next(read_pieces(data_file("examples/ins-wsn.csv")))[:11]
    b'# Simulated'
    """
    left = most
    try:
        found = path.stat()
        kind, size = found.st_mode, min(max(found.st_size + 1, 1 << 16), _PIECE)
        if not stat.S_ISREG(kind):
            word = "a folder, not a file" if stat.S_ISDIR(kind) else "not a regular file"
            raise InswsnError(f"{path} is {word}.")
        with path.open("rb") as stream:  # which takes the memory of all that it is asked for
            while piece := stream.read(size):
                left -= len(piece)
                if left < 0:
                    raise InswsnError(f"{path} has more than {most // 10**6} MB.")
                yield piece
    except InswsnError:
        raise
    except FileNotFoundError:
        raise InswsnError(f"There is no file {path}.") from None
    except (OSError, ValueError) as error:  # ValueError: a path with a zero byte
        said = getattr(error, "strerror", None) or str(error)
        raise InswsnError(f"{path} cannot be read: {said}.") from None


def read_text(path: Path, most: int = RECORDED) -> str:
    """Read a text file, as `read_bytes` does; refuse one that is not UTF-8.

    Examples
    --------
    >>> from inswsn_lib.files import data_file, read_text
    >>> read_text(data_file("examples/ins-wsn.csv"))[:11]
    '# Simulated'
    """
    try:
        text = read_bytes(path, most).decode()
        return text.replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise InswsnError(f"{path} is not UTF-8 text: {error.reason} in line {line}.") from None


# YAML 1.2's core schema, in which a number looks the same as on a command line
_WHOLE = re.compile(r"[-+]?[0-9]+")
_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS = {
    word: value
    for value, word_of_it in ((None, "null"), (True, "true"), (False, "false"))
    for word in (word_of_it, word_of_it.capitalize(), word_of_it.upper())
} | {"": None, "~": None}


def read_scalar(text: str) -> str | float | bool | None:
    """Return what a text without quotes stands for: a number, a truth value, None, or itself.

    Examples
    --------
    >>> from inswsn_lib.files import read_scalar
    >>> [read_scalar(text) for text in ("010", "1e-1", "true", "null", "1:30", "2012-07-07")]
    [10, 0.1, True, None, '1:30', '2012-07-07']
    """
    if text in _WORDS:
        return _WORDS[text]
    if _WHOLE.fullmatch(text):
        with suppress(ValueError):  # thousands of digits
            return int(text)
    return float(text) if _NUMBER.fullmatch(text) else text


# LibYAML finds the tokens several times as fast. The nodes are put together by PyYAML in any case:
# too deep a nesting is then an error of Python, by which LibYAML would crash.
_MOST = 4  # times that a file may be as long with its aliases written out
_PARSERS: tuple[Any, ...] = (
    (Composer, yaml.CSafeLoader) if yaml.__with_libyaml__ else (yaml.SafeLoader,)
)


class _Reader(*_PARSERS):  # type: ignore[misc]
    """Values of YAML, without tags, and with aliases that do not multiply what is written."""

    def __init__(self, text: str) -> None:
        _PARSERS[-1].__init__(self, text)
        Composer.__init__(self)
        self.left = _MOST * len(text)

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node; refuse one that says of which type it is."""
        event = self.peek_event()
        if getattr(event, "tag", None) is not None:
            raise _refused(f"the tag {event.tag} is not read", event)
        return super().compose_node(parent, index)

    def value(self, node: yaml.Node) -> Any:
        """Return what a node stands for; refuse a key that is there already, or is no scalar."""
        self.left -= len(node.value)  # characters, or entries
        if self.left < 0:
            raise _refused(f"its aliases make it {_MOST} times as long", node)
        if isinstance(node, yaml.SequenceNode):
            return [self.value(entry) for entry in node.value]
        if isinstance(node, yaml.ScalarNode):
            return node.value if node.style else read_scalar(node.value)
        made = {}
        for key_node, value_node in node.value:
            key = self.value(key_node)
            if isinstance(key, list | dict):
                raise _refused("a list or a mapping is a key", key_node)
            if key in made:
                raise _refused(f"the key {key} is repeated", key_node)
            made[key] = self.value(value_node)
        return made


def _refused(what: str, place: Any) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=what, problem_mark=place.start_mark)


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) < len(pairs):
        raise ValueError("a key is repeated")
    return made


def read_yaml(path: Path) -> Any:
    """Read a YAML file: mappings, lists, texts (dates too), numbers, truth values and None.

    That is YAML 1.2 without tags.

    Raises
    ------
    InswsnError
        If there is no such file, it is not such YAML, or a key is repeated; the sentence says
        where.

    Examples
    --------
    >>> from inswsn_lib.files import data_file, read_yaml
    >>> read_yaml(data_file("scenarios/p2.yaml"))["spacing"]["value"]
    7
    """
    text = read_text(path, WRITTEN)
    if text.startswith("{"):
        with suppress(ValueError):  # JSON is YAML too, and is read where there is no PyYAML
            return json.loads(text, object_pairs_hook=_without_repeats)
    try:
        reader = _Reader(text)
        node = reader.get_single_node()
        return None if node is None else reader.value(node)
    except RecursionError:
        raise InswsnError(
            f"{path} is not YAML that can be read: it is nested too deeply."
        ) from None
    except (yaml.YAMLError, ValueError) as error:
        said = " ".join(str(error).replace('"<unicode string>", ', "").split())[:300]
        raise InswsnError(f"{path} is not YAML: {said}.") from None
