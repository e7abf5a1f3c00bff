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
from dataclasses import dataclass, replace
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

_FORM = "name: type = default  # unit; rule, with its meaning in comment lines above it"
_TYPES: dict[str, type] = {"bool": bool, "int": int, "float": float, "str": str}
_KINDS = {"bool": "true or false", "int": "a whole number", "float": "a number", "str": "a word"}
_INTERVAL = re.compile(r"in (?P<left>[\[(])(?P<low>[^,]+), (?P<high>[^,]+)(?P<right>[\])])")


@dataclass(frozen=True)
class Parameter:
    """One declared parameter: its type, default, unit, rule, and what it is.

    Examples
    --------
    A whole number is taken for a float, and nothing else is converted:

    >>> from inswsn_book.parameters import Parameter
    >>> level = Parameter("level", "float", 2.0, "1", "in (1, inf)", "The bound.")
    >>> level.check(3), level.read("1e1")
    (3.0, 10.0)
    >>> level.check("3")
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: level is '3'; it may be a number in (1, inf).
    """

    name: str
    kind: str  # "bool", "int", "float" or "str"
    default: Value
    unit: str  # "1" for a pure number
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
        return self.rule if self.rule.startswith("one of ") else f"{kind} {self.rule}"

    def check(self, value: object) -> Value:
        """Return a value in the parameter's type; refuse one that may not be."""
        if self.kind == "float" and type(value) is int and abs(value) < 10**300:
            value = float(value)
        finite = not isinstance(value, float) or math.isfinite(value)
        if type(value) is not _TYPES[self.kind] or not finite or not self._obeys(value):
            raise ParameterError(self.name, value, self.allowed)
        assert isinstance(value, bool | int | float | str)
        return value

    def read(self, text: str) -> Value:
        """Return the value that a text stands for, as on a command line; refuse another one."""
        try:
            value = _READERS[self.kind](text.strip())
        except (ValueError, KeyError):
            raise ParameterError(self.name, text, self.allowed) from None
        return self.check(value)

    def _obeys(self, value: object) -> bool:
        if self.rule.startswith("one of "):
            return value in _words(self.rule)
        ends = _ends(self.rule)
        if ends is None:  # any; the run looks for the file, and tries the regressor
            return True
        low, high, above, below = ends
        assert isinstance(value, int | float)  # such a rule is a number's, or is refused
        return (low < value if above else low <= value) and (
            value < high if below else value <= high
        )


@dataclass(frozen=True)
class Schema:
    """The parameters of a chapter, in the order of its cell.

    Examples
    --------
    >>> from inswsn_book.project import find_root
    >>> from inswsn_book.parameters import chapter_schema
    >>> schema = chapter_schema(find_root(), "00")
    >>> schema["about_points"].unit, schema.check({"about_points": 3})["about_points"]
    ('points', 3.0)
    """

    parameters: tuple[Parameter, ...]

    def __getitem__(self, name: str) -> Parameter:
        """Return the parameter of that name; refuse a name that is not declared."""
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
        """Return all parameters: those given, checked, and the defaults of the others."""
        return self.defaults | {name: self[name].check(value) for name, value in values.items()}


def chapter_schema(root: Path, number: str) -> Schema:
    """Read the parameters of a chapter from its source."""
    sources = sorted((root / "chapters").glob(f"{number}-*.md"))
    if not sources:
        raise InswsnError(f"There is no chapter {number} in {root / 'chapters'}.")
    return source_schema(sources[0].read_text(encoding="utf-8"), sources[0].name)


@cache
def source_schema(source: str, name: str) -> Schema:
    """Read the parameters of a chapter's source; a build asks for the same ones a hundred times."""
    return notebook_schema(jupytext.reads(source, fmt="md:myst"), name)


def notebook_schema(notebook: Any, name: str) -> Schema:
    """Read the parameters of a notebook from its one cell tagged ``parameters``."""
    tagged = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", [])]
    if len(tagged) != 1:
        raise InswsnError(
            f"chapters/{name} has {len(tagged)} cells tagged parameters; a chapter has exactly one."
        )
    return read_schema(tagged[0].source)


def read_schema(cell: str) -> Schema:
    """Read the declarations of a parameters cell; refuse a line that is none.

    Examples
    --------
    >>> from inswsn_book.parameters import read_schema
    >>> schema = read_schema('''
    ... # Which filter runs.
    ... method: str = "robust"  # 1; one of plain, robust
    ... ''')
    >>> schema["method"].allowed
    'one of plain, robust'
    """
    try:
        body = ast.parse(cell).body
    except SyntaxError as error:
        raise InswsnError(
            f"A parameters cell is not Python: {error.msg}, line {error.lineno}."
        ) from None
    comments = {
        token.start[0]: token.string.lstrip("#").strip()
        for token in tokenize.generate_tokens(io.StringIO(cell).readline)
        if token.type == tokenize.COMMENT
    }
    parameters = []
    above = 1
    for node in body:
        meaning = " ".join(comments[i] for i in range(above, node.lineno) if i in comments)
        parameters.append(_declared(node, comments.get(node.lineno, ""), meaning))
        above = (node.end_lineno or node.lineno) + 1
        if parameters[-1].name in [earlier.name for earlier in parameters[:-1]]:
            raise InswsnError(f"The parameter {parameters[-1].name} is declared twice.")
    return Schema(tuple(parameters))


def _declared(node: ast.stmt, comment: str, meaning: str) -> Parameter:
    if (
        not isinstance(node, ast.AnnAssign)
        or not isinstance(node.target, ast.Name)
        or not isinstance(node.annotation, ast.Name)
        or node.annotation.id not in _TYPES
        or node.value is None
        or comment.count(";") != 1
        or not meaning
    ):
        raise InswsnError(f"{ast.unparse(node)!r} is not a declaration of the form {_FORM}.")
    unit, rule = (part.strip() for part in comment.split(";"))
    name, kind = node.target.id, node.annotation.id
    of_words = rule in (FILE_RULE, REGRESSOR_RULE) or (
        rule.startswith("one of ") and all(_words(rule))
    )
    of_numbers = _ends(rule) is not None
    if not (
        rule == "any" or (of_words and kind == "str") or (of_numbers and kind in ("int", "float"))
    ):
        raise InswsnError(
            f"The rule of {name} is {rule!r}; it may be any, 'one of' words, 'a file' or "
            "'a regressor' for a str, or an interval for a number, such as in [0, 10)."
        )
    try:
        default = ast.literal_eval(node.value)
    except ValueError:
        raise InswsnError(f"The default of {name} is no literal.") from None
    draft = Parameter(name, kind, default, unit, rule, meaning)
    return replace(draft, default=draft.check(default))


def _ends(rule: str) -> tuple[float, float, bool, bool] | None:
    """Return the ends of an interval, and whether each of them is outside it; None for no one."""
    match = _INTERVAL.fullmatch(rule)
    try:
        low, high = (float(match["low"]), float(match["high"])) if match else (0.0, 0.0)
    except ValueError:
        return None
    if match is None or not low < high:
        return None
    above, below = match["left"] == "(", match["right"] == ")"
    if (math.isinf(low) and not above) or (math.isinf(high) and not below):
        return None
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
