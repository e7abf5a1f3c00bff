"""The parameters of a chapter: declared once, in its parameters cell, and enforced from there.

A declaration is an assignment with a type, a literal default, and a comment that gives the unit
and the rule, which ``papermill --help-notebook`` shows; comment lines above it say what the
parameter is::

    # Samples over which Table 2 averages; P1 trains on 100 points.
    training_samples: int = 100  # samples; in [4, 400]

A rule is ``any``, an interval of numbers such as ``in (0, 10]`` or ``in [0, inf)``, ``one of`` a
list of words, ``a file``: the path of a file, or the name of one below ``data/``, or
``a regressor``: the module and the class of a scikit-learn regressor.
"""

from __future__ import annotations

import ast
import io
import math
import re
import tokenize
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jupytext

from inswsn_lib.errors import InswsnError, ParameterError

Value = bool | int | float | str

#: The rule of a parameter that names a file
FILE_RULE = "a file"
#: The rule of a parameter that names a regressor
REGRESSOR_RULE = "a regressor"

_TYPES: dict[str, type] = {"bool": bool, "int": int, "float": float, "str": str}
_KINDS = {"bool": "true or false", "int": "a whole number", "float": "a number", "str": "a word"}
_INTERVAL = re.compile(r"in (?P<left>[\[(])(?P<low>[^,]+), (?P<high>[^,]+)(?P<right>[\])])")


@dataclass(frozen=True)
class Parameter:
    """One declared parameter.

    Attributes
    ----------
    name : str
        Its name, as in the cell.
    kind : {"bool", "int", "float", "str"}
        Its type.
    default : bool, int, float or str
        Its value in the published run.
    unit : str
        Its unit; ``"1"`` for a pure number.
    rule : str
        What it may be: ``"any"``, an interval such as ``"in [0, 1)"``, or ``"one of a, b"``.
    meaning : str
        What it is, one or more sentences.

    Examples
    --------
    >>> from inswsn_book.parameters import Parameter
    >>> steps = Parameter("steps", "int", 100, "periods", "in [1, 500]", "Periods to run.")
    >>> steps.allowed
    'a whole number in [1, 500]'
    """

    name: str
    kind: str
    default: Value
    unit: str
    rule: str
    meaning: str

    @property
    def allowed(self) -> str:
        """What it may be, as the end of the sentence "it may be ..."."""
        kind = _KINDS[self.kind]
        if self.rule == "any":
            return f"any {kind.removeprefix('a ')}" if self.kind != "bool" else kind
        if self.rule == FILE_RULE:
            return "the path of a file, or the name of one below data/"
        if self.rule == REGRESSOR_RULE:
            return "package.module:Class, a scikit-learn regressor"
        if self.rule.startswith("one of "):
            return self.rule
        return f"{kind} {self.rule}"

    def check(self, value: object) -> Value:
        """Return a value in the parameter's type.

        Parameters
        ----------
        value : object
            What somebody set it to. A whole number is taken for a ``float``, and nothing else is
            converted.

        Raises
        ------
        ParameterError
            If it has another type, is not finite, or breaks the rule.

        Examples
        --------
        A whole number is taken for a float, and nothing else is converted:

        >>> from inswsn_book.parameters import Parameter
        >>> level = Parameter("level", "float", 2.0, "1", "in (1, inf)", "The bound.")
        >>> level.check(3)
        3.0
        >>> level.check("3")
        Traceback (most recent call last):
            ...
        inswsn_lib.errors.ParameterError: level is '3'; it may be a number in (1, inf).
        """
        if self.kind == "float" and type(value) is int:
            try:
                value = float(value)
            except OverflowError:
                raise ParameterError(self.name, value, self.allowed) from None
        if type(value) is not _TYPES[self.kind]:
            raise ParameterError(self.name, value, self.allowed)
        if isinstance(value, float) and not math.isfinite(value):
            raise ParameterError(self.name, value, self.allowed)
        if not self._obeys(value):
            raise ParameterError(self.name, value, self.allowed)
        assert isinstance(value, bool | int | float | str)
        return value

    def read(self, text: str) -> Value:
        """Return the value that a text stands for, as on a command line.

        Raises
        ------
        ParameterError
            If the text is not one of this type, or breaks the rule.

        Examples
        --------
        >>> from inswsn_book.parameters import Parameter
        >>> level = Parameter("level", "float", 2.0, "1", "in (1, inf)", "The bound.")
        >>> level.read("1e1")
        10.0
        >>> level.read("1")
        Traceback (most recent call last):
            ...
        inswsn_lib.errors.ParameterError: level is 1.0; it may be a number in (1, inf).
        """
        try:
            value = _READERS[self.kind](text.strip())
        except (ValueError, KeyError):
            raise ParameterError(self.name, text, self.allowed) from None
        return self.check(value)

    def _obeys(self, value: object) -> bool:
        # the run looks for the file, and tries the regressor
        if self.rule in ("any", FILE_RULE, REGRESSOR_RULE):
            return True
        if self.rule.startswith("one of "):
            return value in _words(self.rule)
        assert isinstance(value, int | float)  # such a rule is a number's, or is refused
        low, high, above, below = _ends(self.rule)
        return (low < value if above else low <= value) and (
            value < high if below else value <= high
        )


@dataclass(frozen=True)
class Schema:
    """The parameters of a chapter, in the order of its cell.

    Attributes
    ----------
    parameters : tuple of Parameter
        The declared parameters.

    Examples
    --------
    >>> from inswsn_book.project import find_root
    >>> from inswsn_book.parameters import chapter_schema
    >>> schema = chapter_schema(find_root(), "00")
    >>> schema["about_points"].unit, schema["about_points"].default
    ('points', 2.5)
    """

    parameters: tuple[Parameter, ...]

    def __getitem__(self, name: str) -> Parameter:
        """Return the parameter of that name.

        Raises
        ------
        ParameterError
            If there is none.
        """
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        names = ", ".join(parameter.name for parameter in self.parameters)
        raise ParameterError("parameter", name, f"one of {names}" if names else "none: it has none")

    @property
    def defaults(self) -> dict[str, Value]:
        """The values of the published run."""
        return {parameter.name: parameter.default for parameter in self.parameters}

    def check(self, values: Mapping[str, object]) -> dict[str, Value]:
        """Return all parameters: those given, checked, and the defaults of the others.

        Raises
        ------
        ParameterError
            If a name is not declared or a value may not be.

        Examples
        --------
        What is not given is what the published run has:

        >>> from inswsn_book.parameters import Parameter, Schema
        >>> level = Parameter("level", "float", 2.0, "1", "in (1, inf)", "The bound.")
        >>> steps = Parameter("steps", "int", 100, "periods", "in [1, inf)", "Periods to run.")
        >>> Schema((level, steps)).check({"steps": 7})
        {'level': 2.0, 'steps': 7}
        """
        return self.defaults | {name: self[name].check(value) for name, value in values.items()}


def chapter_schema(root: Path, number: str) -> Schema:
    """Read the parameters of a chapter from its source.

    Raises
    ------
    InswsnError
        If there is no such chapter, or its parameters cell is not one.

    Examples
    --------
    >>> from inswsn_book.project import find_root
    >>> from inswsn_book.parameters import chapter_schema
    >>> sorted(chapter_schema(find_root(), "00").defaults)
    ['about_points', 'outage_samples', 'training_samples']
    """
    sources = sorted((root / "chapters").glob(f"{number}-*.md"))
    if not sources:
        raise InswsnError(f"There is no chapter {number} in {root / 'chapters'}.")
    return source_schema(sources[0].read_text(encoding="utf-8"), sources[0].name)


@cache
def source_schema(source: str, name: str) -> Schema:
    """Read the parameters of a chapter's source; a build asks for the same ones a hundred times."""
    return notebook_schema(jupytext.reads(source, fmt="md:myst"), name)


def notebook_schema(notebook: Any, name: str) -> Schema:
    """Read the parameters of a notebook from its one cell tagged ``parameters``.

    Raises
    ------
    InswsnError
        If it has not exactly one such cell, or the cell holds anything but declarations.

    Examples
    --------
    >>> from nbformat.v4 import new_code_cell, new_notebook
    >>> from inswsn_book.parameters import notebook_schema
    >>> source = '''
    ... # Periods to run.
    ... steps: int = 100  # periods; in (0, inf)
    ... '''
    >>> cell = new_code_cell(source, metadata={"tags": ["parameters"]})
    >>> notebook_schema(new_notebook(cells=[cell]), "00-mine.md").defaults
    {'steps': 100}
    """
    tagged = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", [])]
    if len(tagged) != 1:
        raise InswsnError(
            f"chapters/{name} has {len(tagged)} cells tagged parameters; a chapter has exactly one."
        )
    return read_schema(tagged[0].source)


def read_schema(cell: str) -> Schema:
    """Read the declarations of a parameters cell.

    Raises
    ------
    InswsnError
        If a line is not a declaration, or a default breaks its own rule.

    Examples
    --------
    >>> from inswsn_book.parameters import read_schema
    >>> schema = read_schema('''
    ... # Which filter runs.
    ... method: str = "robust"  # 1; one of plain, robust
    ... ''')
    >>> schema["method"].allowed
    'one of plain, robust'
    >>> schema.check({"method": "best"})
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: method is 'best'; it may be one of plain, robust.
    """
    comments = {
        token.start[0]: token.string.lstrip("#").strip()
        for token in tokenize.generate_tokens(io.StringIO(cell).readline)
        if token.type == tokenize.COMMENT
    }
    parameters = []
    above = 1
    for node in ast.parse(cell).body:
        meaning = " ".join(comments[i] for i in range(above, node.lineno) if i in comments)
        parameters.append(_declared(node, comments.get(node.lineno, ""), meaning))
        above = (node.end_lineno or node.lineno) + 1
    return Schema(tuple(parameters))


def _declared(node: ast.stmt, comment: str, meaning: str) -> Parameter:
    form = "name: type = default  # unit; rule, with its meaning in comment lines above it"
    if (
        not isinstance(node, ast.AnnAssign)
        or not isinstance(node.target, ast.Name)
        or not isinstance(node.annotation, ast.Name)
        or node.annotation.id not in _TYPES
        or node.value is None
        or comment.count(";") != 1
        or not meaning
    ):
        raise InswsnError(f"{ast.unparse(node)!r} is not a declaration of the form {form}.")
    unit, rule = (part.strip() for part in comment.split(";"))
    name, kind = node.target.id, node.annotation.id
    _check_rule(name, kind, rule)
    draft = Parameter(name, kind, ast.literal_eval(node.value), unit, rule, meaning)
    return Parameter(name, kind, draft.check(draft.default), unit, rule, meaning)


def _check_rule(name: str, kind: str, rule: str) -> None:
    words = rule.startswith("one of ") and all(_words(rule))
    if rule == "any" or (kind == "str" and (rule in (FILE_RULE, REGRESSOR_RULE) or words)):
        return
    if kind not in ("int", "float") or not _is_interval(rule):
        raise InswsnError(
            f"The rule of {name} is {rule!r}; it may be any, 'one of' words, 'a file' or "
            "'a regressor' for a str, or an interval for a number, such as in [0, 10)."
        )


def _is_interval(rule: str) -> bool:
    try:
        low, high, _, _ = _ends(rule)
    except ValueError:
        return False
    return low < high


def _ends(rule: str) -> tuple[float, float, bool, bool]:
    """Return the ends of an interval, and whether each of them is outside it."""
    match = _INTERVAL.fullmatch(rule)
    if match is None:
        raise ValueError(rule)
    low, high = float(match["low"]), float(match["high"])
    above, below = match["left"] == "(", match["right"] == ")"
    if (math.isinf(low) and not above) or (math.isinf(high) and not below):
        raise ValueError(rule)
    return low, high, above, below


def _words(rule: str) -> list[str]:
    return [word.strip() for word in rule.removeprefix("one of ").split(",")]


def _read_int(text: str) -> int:
    if not re.fullmatch(r"[+-]?\d+", text):
        raise ValueError(text)
    return int(text)


_READERS: dict[str, Callable[[str], Value]] = {
    "bool": lambda text: {"true": True, "false": False}[text.lower()],
    "int": _read_int,
    "float": float,
    "str": str,
}
