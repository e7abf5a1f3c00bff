"""The grid of a sweep: its axes as a user gives them, checked before anything runs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from inswsn_book.parameters import Schema, Value
from inswsn_book.running import gather_parameters
from inswsn_lib.errors import ParameterError

MOST_CELLS = 10_000


@dataclass(frozen=True)
class Grid:
    """The cells of a sweep.

    Attributes
    ----------
    axes : mapping of str to tuple of value
        Parameters and the values that they go through.
    values : mapping of str to value
        All parameters; those of the axes have their defaults here.
    """

    axes: Mapping[str, tuple[Value, ...]]
    values: Mapping[str, Value]

    def places(self) -> list[dict[str, Value]]:
        """Return for each cell its values on the axes; the last axis goes fastest."""
        return [
            dict(zip(self.axes, values, strict=True))
            for values in itertools.product(*self.axes.values())
        ]

    def cells(self) -> list[dict[str, Value]]:
        """Return all parameters of each cell."""
        return [dict(self.values) | place for place in self.places()]


def read_grid(schema: Schema, axes: Iterable[str], settings: Iterable[str], data: Path) -> Grid:
    """Return the grid that a user asks for.

    Parameters
    ----------
    schema : Schema
        The declared parameters.
    axes : iterable of str
        ``name=value,value,...``, each name once.
    settings : iterable of str
        ``name=value``, for parameters that are no axis.
    data : Path
        The folder ``data`` of the checkout, for parameters that name a file.

    Raises
    ------
    ParameterError
        If a name is not declared or given twice, a value may not be or stands twice on an axis, or
        there are more than `MOST_CELLS` cells.
    """
    found: dict[str, tuple[Value, ...]] = {}
    for axis in axes:
        name, equals, text = axis.partition("=")
        if not equals:
            raise ParameterError("--grid", axis, "name=value,value,...")
        if name in found:
            raise ParameterError("--grid", axis, f"given once for each name: {name} is there twice")
        found[name] = _values_of(schema, axis, name, text, data)
    chosen = gather_parameters(schema, settings, None, data)
    for name in chosen:
        if name in found:
            raise ParameterError("-p", f"{name}={chosen[name]}", f"left out: --grid varies {name}")
    count = math.prod(map(len, found.values()))
    if count > MOST_CELLS:
        raise ParameterError("--grid", f"of {count} cells", f"of {MOST_CELLS} cells at most")
    return Grid(found, schema.check(chosen))


def _values_of(schema: Schema, axis: str, name: str, text: str, data: Path) -> tuple[Value, ...]:
    values: list[Value] = []
    for part in text.split(","):
        value = gather_parameters(schema, (f"{name}={part}",), None, data)[name]
        if value in values:
            raise ParameterError("--grid", axis, f"a list without repetitions: {value} is repeated")
        values.append(value)
    return tuple(values)
