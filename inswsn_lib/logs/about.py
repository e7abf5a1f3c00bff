"""What a folder says of a recording, and of how its files are to be read: ``recording.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from inswsn_lib.checks import array, number
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_yaml
from inswsn_lib.logs.columns import Layout, Named, units_of
from inswsn_lib.logs.rows import reading
from inswsn_lib.streams import Recording

ABOUT = "recording.yaml"
_WORDS = ("name", "licence", "source")
_HEIGHT = "height_m"
_VECTORS = {"lever_arm_m": "lever_arm", "origin_rad_m": "origin"}


class Source(NamedTuple):
    """Which file a stream is in, and what its columns are called there, with their units."""

    file: str
    columns: Named


def read_about(
    path: Path, layouts: Mapping[str, Layout]
) -> tuple[dict[str, Any], dict[str, Source]]:
    """Return what the file says: attributes of a recording, and where streams are.

    Parameters
    ----------
    path : Path
    layouts : mapping of str to Layout
        The columns of each file that there may be.
    """
    with reading(path):
        said = read_yaml(path)
        if said is not None and not isinstance(said, dict):
            raise InswsnError("it is not a mapping; it must have lines such as 'name: my walk'.")
        items = (said or {}).items()
        sources = {key: _source(key, value, layouts[key]) for key, value in items if key in layouts}
        known = ", ".join((*_WORDS, *_VECTORS, _HEIGHT, *layouts))
        others = [item for item in items if item[0] not in layouts]
        return dict(_attribute(key, value, known) for key, value in others), sources


def _attribute(key: Any, value: Any, known: str) -> tuple[str, Any]:
    if key in _VECTORS:
        return _VECTORS[key], array(key, value, (3,))
    if key == _HEIGHT:
        return "height", number(key, value)
    if key not in _WORDS:
        raise InswsnError(f"the key {key!r} is not known; it must be one of {known}.")
    if not isinstance(value, str):
        raise ParameterError(key, value, "text")
    return key, value


def _source(name: str, value: Any, layout: Layout) -> Source:
    """Return where a stream is: of its file, and of each column the name, or name and unit."""
    if not isinstance(value, dict):
        raise ParameterError(name, value, "a mapping such as {time_s: [Timestamp, ms]}")
    columns = {}
    for column, said in value.items():
        if column == "file":
            continue
        if column not in layout.names:
            raise ParameterError(name, column, f"of columns {', '.join(layout.names)}, or file")
        called, unit = (*said, "")[:2] if isinstance(said, list) and said else (said, "")
        if not isinstance(called, str) or (isinstance(said, list) and len(said) > 2):
            raise ParameterError(f"{name}: {column}", said, "a name, or [name, unit]")
        if unit and unit not in units_of(column):
            known = ", ".join(units_of(column)) or "left out"
            raise ParameterError(f"{name}: the unit of {column}", unit, f"one of {known}")
        columns[column] = called, str(unit)
    file = value.get("file", name)
    if not isinstance(file, str):
        raise ParameterError(f"{name}: file", file, "the name of a file in the folder")
    return Source(file, columns)


def write_about(recording: Recording, path: Path) -> None:
    """Write what a recording says about itself beside its streams.

    Parameters
    ----------
    recording : Recording
    path : Path
        Of the file.
    """
    words = {key: getattr(recording, key) for key in _WORDS}
    lines = [f"{key}: {quoted(word)}" for key, word in words.items() if word]
    for key, attribute in _VECTORS.items():
        if (vector := getattr(recording, attribute)) is not None:
            lines.append(f"{key}: [{', '.join(map(repr, vector.tolist()))}]")
    if recording.height is not None:
        lines.append(f"{_HEIGHT}: {recording.height!r}")
    path.write_text("\n".join([*lines, ""]), encoding="utf-8", newline="\n")


def quoted(word: str) -> str:
    """Return a text within quotes, where it is never taken for a number."""
    return str(yaml.safe_dump(word, default_style='"', allow_unicode=True, width=10**6)).strip()
