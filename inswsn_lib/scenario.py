"""The settings of a scenario: every number with its unit, and where it comes from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from inswsn_lib.checks import array, number, one_of
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_yaml

T = TypeVar("T")
Pair = tuple[float, float]
#: The least and the largest number
Range = Annotated[Pair, "in order"]

SOURCES = ("paper", "inferred", "calibrated", "assumed")
#: Ranges of numbers of which no more is known
POSITIVE, NOT_NEGATIVE, ANY = (1e-9, 1e9), (0.0, 1e9), (-1e9, 1e9)


@dataclass(frozen=True)
class Setting:
    """One number of a scenario, and where it comes from.

    Attributes
    ----------
    value : float, str, or list of floats or of lists of floats
    unit, why : str
        The unit; the place in the paper, or the reason.
    source : {"paper", "inferred", "calibrated", "assumed"}
        Printed; following from what is printed; fitted to printed results; chosen by us.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> iw.Setting(value=2, unit="m", source="paper", why="Section 3.").value
    2.0
    """

    value: Any
    unit: str
    source: str
    why: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", _as_value("value", self.value))
        for name in ("unit", "why"):
            text = getattr(self, name)
            if not isinstance(text, str) or not text:
                raise ParameterError(name, text, "text that is not empty")
        one_of("source", self.source, SOURCES)


def load_scenario(path: Path) -> dict[str, Setting]:
    """Read a scenario file: YAML of names, each with value, unit, source and why.

    The settings are in the order of the file; those of two files may be joined by ``|``.

    Raises
    ------
    InswsnError
        If there is no such file, or an entry is not complete.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> settings = iw.load_scenario(iw.data_file("scenarios/p2.yaml"))
    >>> settings["spacing"]
    Setting(value=7.0, unit='m', source='paper', why='Section 3.')
    """
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise InswsnError(f"{path} is not a scenario: it holds no names.")
    settings = {}
    for name, entry in content.items():
        if not isinstance(entry, dict) or set(entry) != {each.name for each in fields(Setting)}:
            raise InswsnError(f"{path}: {name} must have value, unit, source and why.")
        try:
            settings[str(name)] = Setting(**entry)
        except ParameterError as error:
            raise InswsnError(f"{path}: {name}: {error}") from None
    return settings


def with_values(settings: Mapping[str, Setting], /, **values: Any) -> dict[str, Setting]:
    """Return settings with some values changed; those that change become ``assumed``.

    Parameters
    ----------
    settings : mapping of str to Setting
    **values
        Numbers, words, or lists or arrays of numbers, of settings that are there.

    Examples
    --------
    What is changed is no longer the paper's:

    >>> import inswsn_lib as iw
    >>> settings = iw.load_scenario(iw.data_file("scenarios/p2.yaml"))
    >>> changed = iw.with_values(settings, reach=20, spacing=7)  # the spacing is 7 m already
    >>> [(changed[name].value, changed[name].source) for name in ("reach", "spacing")]
    [(20.0, 'assumed'), (7.0, 'paper')]
    """
    changed = dict(settings)
    for name, given in values.items():
        if name not in changed:
            raise ParameterError("setting", name, f"one of {', '.join(sorted(changed)) or 'none'}")
        old, value = changed[name], _as_value(name, given)
        if value != old.value:
            changed[name] = Setting(value, old.unit, "assumed", "Set for this run.")
    return changed


def _as_value(name: str, value: Any) -> Any:
    """Return numbers as floats, also within lists; refuse what is neither number, word nor list."""
    if isinstance(value, str):
        return value
    try:
        numbers = np.asarray(value)
    except ValueError:  # lists of unequal length
        numbers = np.asarray(None)
    if numbers.ndim > 2 or numbers.dtype.kind not in "iuf":
        raise ParameterError(name, value, "a number, a word, or a list of numbers or of lists")
    return numbers.astype(float).tolist()


def between(least: float, most: float, default: Any = MISSING) -> Any:
    """Return a field of a dataclass whose numbers `from_settings` holds to a range."""
    return field(default=default, metadata={"range": (least, most)})


def from_settings(kind: Callable[..., T], settings: Mapping[str, Setting], **values: Any) -> T:
    """Return a dataclass filled from the settings of its fields; other settings are ignored.

    Parameters
    ----------
    kind : dataclass
        Its fields may have a range, by `between`. The type of a field says what its setting may be:
        ``float``, ``int`` for a whole number, tuples of these, ``Range`` for two numbers in order,
        ``Literal`` for words. A field that is a dataclass is made from the same settings.
    settings : mapping of str to Setting
        From `load_scenario`.
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
    >>> import inswsn_lib as iw
    >>> settings = iw.load_scenario(iw.data_file("scenarios/p2.yaml"))
    >>> iw.from_settings(iw.ClusterScene, iw.with_values(settings, dropout=0.3)).ranging
    Ranging(reach=12.0, noise=0.2, node_bias=0.0, dropout=0.3, outlier=0.0, outlier_scale=3.0)
    """
    hints = get_type_hints(kind, include_extras=True)
    for each in fields(kind):  # type: ignore[arg-type]
        hint = hints[each.name]
        if each.name in values:
            continue
        if is_dataclass(hint):
            values[each.name] = from_settings(hint, settings)  # type: ignore[arg-type]
        elif each.name in settings:
            bounds = each.metadata.get("range", ())
            values[each.name] = _checked(each.name, settings[each.name].value, hint, *bounds)
        else:
            raise InswsnError(f"The scenario lacks the setting {each.name}.")
    return kind(**values)


def _checked(name: str, value: Any, hint: Any, least: Any = None, most: Any = None) -> Any:
    """Return the value of a setting as a field of that type wants it; refuse another."""
    if get_origin(hint) is Literal:
        one_of(name, value, get_args(hint))
    elif hint in (float, int):
        number(name, value, least=least, most=most)
        if hint is int and value != int(value):
            raise ParameterError(name, value, "a whole number")
        return hint(value)
    elif least is not None:
        numbers = array(name, value, _shape(hint))
        if (numbers < least).any() or (numbers > most).any():
            raise ParameterError(name, value, f"numbers between {least:g} and {most:g}")
        if hint == Range and value[0] > value[1]:
            raise ParameterError(name, value, "two numbers in ascending order")
    return _frozen(value)


def _shape(hint: Any) -> tuple[int | str, ...]:
    """Return the shape of arrays that a type of nested tuples stands for."""
    inner = get_args(Pair if hint == Range else hint)
    return ("any" if Ellipsis in inner else len(inner), *_shape(inner[0])) if inner else ()


def _frozen(value: Any) -> Any:
    """Return lists, also within lists, as tuples."""
    return tuple(map(_frozen, value)) if isinstance(value, list) else value
