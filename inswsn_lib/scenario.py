"""The settings of a scenario: every number with its unit, and where it comes from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_yaml

T = TypeVar("T")
#: The least and the largest number
Range = tuple[float, float]

SOURCES = ("paper", "inferred", "calibrated", "assumed")
_CHANGED = "Set for this run."
_FIELDS = {"value", "unit", "source", "why"}


@dataclass(frozen=True)
class Setting:
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

    Raises
    ------
    ParameterError
        If a field is of another kind.

    Examples
    --------
    Every number says where it comes from; one that does not is refused.

    >>> from inswsn_lib.scenario import Setting
    >>> Setting(value=0.2, unit="m", source="paper", why="Section 3.").value
    0.2
    >>> Setting(value=0.2, unit="m", source="guessed", why="So.")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: source is 'guessed'; it may be one of paper, inferred, ...
    """

    value: Any
    unit: str
    source: str
    why: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", _as_value(self.value))
        for name in ("unit", "why"):
            text = getattr(self, name)
            if not isinstance(text, str) or not text:
                raise ParameterError(name, text, "a text that is not empty")
        if self.source not in SOURCES:
            raise ParameterError("source", self.source, f"one of {', '.join(SOURCES)}")


def _as_value(value: Any) -> Any:
    """Return numbers as floats, also within lists; refuse what is neither number, word nor list."""
    if isinstance(value, str):
        return value
    try:
        numbers = np.asarray(value)
    except ValueError:  # lists of unequal length
        numbers = np.asarray(None)
    if numbers.ndim > 2 or numbers.dtype.kind not in "iuf":
        raise ParameterError("value", value, "a number, a word, or a list of numbers or of pairs")
    return numbers.astype(float).tolist()


def load_scenario(path: Path) -> dict[str, Setting]:
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
    >>> from inswsn_lib.scenario import load_scenario
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
        if not isinstance(entry, dict) or set(entry) != _FIELDS:
            raise InswsnError(f"{path}: {name} has to have value, unit, source and why.")
        try:
            settings[str(name)] = Setting(**entry)
        except ParameterError as error:
            raise InswsnError(f"{path}: {name}: {error}") from None
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

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> settings = load_scenario(data_file("scenarios/p2.yaml"))
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
            value = _as_value(given)
        except ParameterError:
            raise ParameterError(name, given, "a number, a word, or a list of numbers") from None
        if value != old.value:
            changed[name] = Setting(value, old.unit, "assumed", _CHANGED)
    return changed


def take(values: dict[str, Any], kind: Any) -> Any:
    """Take the fields of a dataclass out of values by name, and return the object they make."""
    names = [f.name for f in fields(kind) if f.name in values]
    return kind(**{name: frozen(values.pop(name)) for name in names})


def frozen(value: Any) -> Any:
    """Return lists, also within lists, as tuples."""
    return tuple(map(frozen, value)) if isinstance(value, list) else value


def between(least: float, most: float) -> Any:
    """Return a field of a dataclass whose numbers `from_settings` holds to a range."""
    return field(metadata={"range": (least, most)})


def from_settings(kind: Callable[..., T], settings: Mapping[str, Setting], **values: Any) -> T:
    """Return the dataclass that the settings of its fields make; other settings do not matter.

    Parameters
    ----------
    kind : dataclass
        Its fields may have a range, by `between`. One of type ``int`` is a whole number, one of
        type ``Range`` two numbers in order; lists become tuples.
    settings : mapping of str to Setting
    **values
        Fields that do not come from the settings.

    Raises
    ------
    InswsnError
        If a setting is missing.
    ParameterError
        If a value is of another form, or outside its range.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from inswsn_lib.scenario import Setting, between, from_settings
    >>> @dataclass
    ... class Radio:
    ...     reach: float = between(0, 1000)
    >>> from_settings(Radio, {"reach": Setting(12, "m", "paper", "Section 3.")})
    Radio(reach=12.0)
    """
    for each in fields(kind):  # type: ignore[arg-type]
        if each.name in values:
            continue
        if each.name not in settings:
            raise InswsnError(f"The scenario lacks the setting {each.name}.")
        values[each.name] = frozen(_checked(each, settings[each.name].value))
    return kind(**values)


def _checked(each: Any, value: Any) -> Any:
    """Return a value as the field of a dataclass wants it; refuse others."""
    pair, whole = each.type in ("Range", Range), each.type in ("int", int)
    least, most = each.metadata.get("range", (None, None))
    if least is None:
        return value
    single = whole or each.type in ("float", float)
    kind = "two numbers in order" if pair else "a whole number" if whole else "a number"
    words = f"{kind if pair or single else 'numbers'} from {least:g} to {most:g}"
    numbers = np.asarray(value)
    fits = numbers.dtype.kind == "f" and np.isfinite(numbers).all()
    fits = fits and (numbers >= least).all() and (numbers <= most).all()
    if pair:
        fits = fits and numbers.shape == (2,) and numbers[0] <= numbers[1]
    if single:
        fits = fits and numbers.shape == ()
    if not fits or (whole and numbers != int(numbers)):
        raise ParameterError(each.name, value, words)
    return int(numbers) if whole else value
