"""What a folder says about a recording as a whole, in ``recording.yaml``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from inswsn_lib.checks import array
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_yaml
from inswsn_lib.recordings.rows import reading
from inswsn_lib.streams import Recording

ABOUT = "recording.yaml"
_WORDS = ("name", "licence", "source")
_VECTORS = {"lever_arm_m": "lever_arm", "origin_rad_m": "origin"}


def read_about(path: Path) -> dict[str, Any]:
    """Return what the file says, by the attributes of a recording."""
    with reading(path):
        said = read_yaml(path)
        if said is not None and not isinstance(said, dict):
            raise InswsnError("it is not a mapping; it must have lines such as 'name: my walk'.")
        return dict(_attribute(key, value) for key, value in (said or {}).items())


def _attribute(key: Any, value: Any) -> tuple[str, Any]:
    if key in _VECTORS:
        return _VECTORS[key], array(key, value, (3,))
    if key not in _WORDS:
        known = ", ".join((*_WORDS, *_VECTORS))
        raise InswsnError(f"the key {key!r} is not known; it must be one of {known}.")
    if not isinstance(value, str):
        raise ParameterError(key, value, "text")
    return key, value


def write_about(recording: Recording, path: Path) -> None:
    """Write what a recording says about itself beside its streams.

    Parameters
    ----------
    recording : Recording
    path : Path
        Of the file.
    """
    words = {key: getattr(recording, key) for key in _WORDS}
    lines = [f"{key}: {_quoted(word)}" for key, word in words.items() if word]
    for key, attribute in _VECTORS.items():
        if (vector := getattr(recording, attribute)) is not None:
            lines.append(f"{key}: [{', '.join(map(repr, vector.tolist()))}]")
    path.write_text("\n".join([*lines, ""]), encoding="utf-8", newline="\n")


def _quoted(word: str) -> str:
    # within quotes a text is never taken for a number
    return str(yaml.safe_dump(word, default_style='"', allow_unicode=True, width=10**6)).strip()
