"""The settings of a scenario: every number with its unit, and where it comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_yaml

_CHANGED = "Set for this run."


class Setting(BaseModel):
    """One number of a scenario, and where it comes from.

    Attributes
    ----------
    value : float, str, or list of floats or of pairs
    unit : str
    source : {"paper", "inferred", "calibrated", "assumed"}
        Printed by the paper; following from what it prints; fitted to its INS-only cells; chosen by
        us.
    why : str
        The place in the paper, or the reason.

    Examples
    --------
    Every number says where it comes from; one that does not is refused.

    >>> from pydantic import ValidationError
    >>> from inswsn_lib.simulation import Setting
    >>> Setting(value=0.2, unit="m", source="paper", why="Section 3.").value
    0.2
    >>> try:
    ...     Setting(value=0.2, unit="m", source="guessed", why="It looks right.")
    ... except ValidationError as error:
    ...     print(error.errors()[0]["loc"])
    ('source',)
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    value: float | str | list[float] | list[list[float]]
    unit: Annotated[str, Field(min_length=1)]
    source: Literal["paper", "inferred", "calibrated", "assumed"]
    why: Annotated[str, Field(min_length=3)]


def load_scenario(path: FilePath) -> dict[str, Setting]:
    """Read a scenario file.

    Parameters
    ----------
    path : Path
        YAML: names, each with value, unit, source and why.

    Returns
    -------
    dict of str to Setting
        By name, in the order of the file.

    Raises
    ------
    InswsnError
        If there is no such file, or an entry is not complete.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_lib.simulation import load_scenario
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder, "small.yaml")
    ...     _ = path.write_text("reach: {value: 12, unit: m, source: paper, why: Section 3.}")
    ...     settings = load_scenario(path)
    >>> settings["reach"].value, settings["reach"].unit, settings["reach"].source
    (12.0, 'm', 'paper')
    """
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise InswsnError(f"{path} is no scenario: it holds no names.")
    settings = {}
    for name, entry in content.items():
        try:
            settings[str(name)] = Setting.model_validate(entry)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            raise InswsnError(f"{path}: {name}: {place}: {first['msg']}.") from None
    return settings


def with_values(settings: Mapping[str, Setting], /, **values: Any) -> dict[str, Setting]:
    """Return settings of which some have other values; those that change become ``assumed``.

    Parameters
    ----------
    settings : mapping of str to Setting
        From `load_scenario`.
    **values
        New values by name: numbers, words, or lists or arrays of numbers. One that equals the old
        value leaves the setting as it is.

    Returns
    -------
    dict of str to Setting

    Raises
    ------
    ParameterError
        If there is no setting of a name, or a value is not of one of these kinds.

    Examples
    --------
    What is changed is no longer the paper's:

    >>> from inswsn_lib.checkout import find_root
    >>> from inswsn_lib.simulation import load_scenario, with_values
    >>> settings = load_scenario(find_root() / "data/scenarios/p2.yaml")
    >>> changed = with_values(settings, reach=20, spacing=7)  # the spacing is 7 m already
    >>> [(changed[name].value, changed[name].source) for name in ("reach", "spacing")]
    [(20.0, 'assumed'), (7.0, 'paper')]
    """
    changed = dict(settings)
    for name, given in values.items():
        if name not in changed:
            raise ParameterError("setting", name, f"one of {', '.join(sorted(changed)) or 'none'}")
        old = changed[name]
        try:
            value = given if isinstance(given, str) else np.asarray(given).tolist()
            if value == old.value:
                continue
            entry = {"value": value, "unit": old.unit, "source": "assumed", "why": _CHANGED}
            changed[name] = Setting.model_validate(entry)
        except ValueError:  # from numpy for lists of unequal length, and a ValidationError is one
            raise ParameterError(name, given, "a number, a word, or a list of numbers") from None
    return changed


def take(values: dict[str, Any], kind: Any) -> Any:
    """Take the fields of a dataclass out of values by name, and return the object they make."""
    names = [f.name for f in fields(kind) if f.name in values]
    return kind(**{name: frozen(values.pop(name)) for name in names})


def frozen(value: Any) -> Any:
    """Return lists, also within lists, as tuples."""
    return tuple(map(frozen, value)) if isinstance(value, list) else value
