"""Files that the library reads: those that it carries, YAML, and the folder of recorded data."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import yaml
from yaml.composer import Composer

from inswsn_lib.errors import InswsnError

#: Set by a user: a local folder with recorded data, ``<owner>__<repo>/<commit>/<path>`` in it.
DATA_VARIABLE = "INSWSN_DATA"

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

    yaml_implicit_resolvers = {  # as in the base class
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
    """Read a YAML file: mappings, lists, texts (dates too), numbers, truth values and None.

    Raises
    ------
    InswsnError
        If there is no such file, it is not YAML, or a key is repeated; the sentence says where.

    Examples
    --------
    >>> from inswsn_lib.files import data_file, read_yaml
    >>> read_yaml(data_file("scenarios/p2.yaml"))["spacing"]["value"]
    7
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
