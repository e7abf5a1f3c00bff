"""The parameters of a chapter: declared once, in its parameters cell, and enforced from there.

A declaration is an assignment with a type, a literal default, and a comment that gives the unit
and the rule, which ``papermill --help-notebook`` shows; comment lines above it say what the
parameter is::

    # Samples over which Table 2 averages; P1 trains on 100 points.
    training_samples: int = 100  # samples; in [4, 400]

A rule is ``any``, an interval of numbers such as ``in (0, 10]`` or ``in [0, inf)``, ``one of`` a
list of words, ``a file`` or ``a folder``: its path, or the name of one below ``data/``, or
``a regressor``: the module and the name of a scikit-learn regressor.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_scalar, read_text

Value = bool | int | float | str | list[Any]

#: The rule of a parameter that names a file
FILE_RULE = "a file"
#: The rule of a parameter that names a folder
FOLDER_RULE = "a folder"
#: The rule of a parameter that names a regressor
REGRESSOR_RULE = "a regressor"

_FORM = "name: type = default  # unit; rule, with its meaning in comment lines above it"
_DECLARED = re.compile(r"(\w+): (bool|int|float|str) = (.+?)  # ([^;]+); ([^;]+)")
_KINDS = {"bool": "true or false", "int": "a whole number", "float": "a number", "str": "a word"}
_INTERVAL = re.compile(r"in ([\[(])([^,]+), ([^,]+)([\])])")
_TAGGED = re.compile(r"^:tags:.*\bparameters\b", re.MULTILINE)
_CELL = re.compile(
    r"^```\{code-cell\}[^\n]*\n:tags: \[parameters\]\n\n(.*?)^```$", re.MULTILINE | re.DOTALL
)


@dataclass(frozen=True)
class Parameter:
    """One declared parameter: its type, default, unit, rule, and what it is."""

    name: str
    kind: str  # "bool", "int", "float", "str" or, in a scenario, "list"
    default: Value
    unit: str  # "1" for a pure number
    rule: str
    meaning: str
    scenario: str = ""  # the file that has it, if it is the scene's and not the chapter's

    @property
    def allowed(self) -> str:
        """What it must be, as in the sentence "scale must be ..."."""
        if self.kind == "list":
            return f"a list of the form {self.default}"
        kind = _KINDS[self.kind]
        if self.rule == "any":
            return "a finite number" if self.kind == "float" else kind
        if self.rule == FILE_RULE:
            return "the path of a file, or the name of one below data/"
        if self.rule == FOLDER_RULE:
            return "the path of a folder, or the name of one below data/"
        if self.rule == REGRESSOR_RULE:
            return "the package.module:name of a scikit-learn regressor"
        return self.rule if self.rule.startswith("one of ") else f"{kind} {self.rule}"

    def check(self, value: object) -> Value:
        """Return a value in the parameter's type; refuse one that may not be.

        A whole number is taken for a float, and nothing else is converted.
        """
        if self.kind == "float" and type(value) is int and abs(value) < 10**300:
            value = float(value)
        if self.kind == "list" and _form(value) == _form(self.default) != "":
            return value  # type: ignore[return-value]
        if isinstance(value, bool | int | float | str) and type(value).__name__ == self.kind:
            finite = not isinstance(value, float) or math.isfinite(value)
            if finite and _obeys(value, self.rule):
                return value
        hint = re.search(r"For another [^.]*", self.meaning)
        raise ParameterError(self.name, value, self.allowed + (f" ({hint[0]})" if hint else ""))

    def read(self, text: str) -> Value:
        """Return the value that a text stands for, as in a file; refuse another one."""
        text = text.strip()
        if self.kind == "list":
            try:
                return self.check(yaml.safe_load(text))
            except yaml.YAMLError:
                raise ParameterError(self.name, text, self.allowed) from None
        return self.check(text if self.kind == "str" else read_scalar(text))


def nearest(name: str, names: Iterable[str], least: float = 0.6) -> str:
    """Return a hint at the name that is most like one that is none, if one is like it enough."""
    found = get_close_matches(name, [*names], 1, least)
    return f" (the nearest is {found[0]})" if found else ""


@dataclass(frozen=True)
class Schema:
    """The parameters of a chapter, in the order of its cell."""

    parameters: tuple[Parameter, ...]

    def __getitem__(self, name: str) -> Parameter:
        """Return the parameter of that name; refuse a name that is not declared."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        names = [parameter.name for parameter in self.parameters]
        must_be = f"one of {', '.join(names) or 'those of the chapter, which has none'}"
        raise ParameterError("parameter", name, must_be + nearest(name, names))

    @property
    def defaults(self) -> dict[str, Value]:
        """The values of the published run."""
        return {parameter.name: parameter.default for parameter in self.parameters}

    def check(self, values: Mapping[str, object]) -> dict[str, Value]:
        """Return all parameters: those given, checked, and the defaults of the others."""
        return self.defaults | {name: self[name].check(value) for name, value in values.items()}


def chapter_schema(root: Path, identity: str) -> Schema:
    """Read the parameters of a chapter from its source."""
    folder, number = root / "chapters", identity.removeprefix("lesson-")
    name = f"{number}-*.md" if number.isdigit() else f"{identity}.md"
    sources = [*folder.glob(f"evidence/{name}"), *folder.glob(name)]
    if not sources:
        raise InswsnError(f"There is no chapter {identity} in {folder}.")
    return source_schema(read_text(sources[0]), sources[0].name)


@cache
def source_schema(source: str, name: str) -> Schema:
    """Read the parameters of a chapter's source; a build asks for the same ones a hundred times."""
    cells = _CELL.findall(source)
    if len(cells) == len(_TAGGED.findall(source)) == 1:
        return _named_schema(cells[0], name)  # to parse all of a chapter takes long
    return notebook_schema(read_myst(source, name), name)


def read_myst(source: str, name: str) -> Any:
    """Return the notebook that a chapter's source is; refuse one that is none."""
    import jupytext  # noqa: PLC0415  # takes half a second

    try:
        return jupytext.reads(source, fmt="md:myst")
    except Exception as error:  # jupytext has no error class of its own for a broken source
        said = (str(error).strip() or repr(error)).splitlines()[0]
        raise InswsnError(f"chapters/{name} is not a MyST notebook: {said}.") from None


def notebook_schema(notebook: Any, name: str) -> Schema:
    """Read the parameters of a notebook from its one cell tagged ``parameters``."""
    tagged = [cell for cell in notebook.cells if "parameters" in cell.metadata.get("tags", [])]
    if len(tagged) != 1:
        raise InswsnError(
            f"chapters/{name} has {len(tagged)} cells tagged parameters; a chapter has exactly one."
        )
    return _named_schema(tagged[0].source, name)


def _named_schema(cell: str, name: str) -> Schema:
    try:
        return read_schema(cell)
    except InswsnError as error:
        raise InswsnError(f"chapters/{name}: {error}") from None


def read_schema(cell: str) -> Schema:
    """Read the declarations of a parameters cell; refuse a line that is none."""
    parameters: dict[str, Parameter] = {}
    meaning: list[str] = []
    for line in filter(None, map(str.strip, cell.splitlines())):
        if line.startswith("#"):
            meaning.append(line.lstrip("#").strip())
            continue
        declared = _DECLARED.fullmatch(line)
        if declared is None or not meaning:
            raise InswsnError(f"{line!r} is not a declaration of the form {_FORM}.")
        name, kind, default, unit, rule = declared.groups()
        if name in parameters:
            raise InswsnError(f"The parameter {name} is declared twice.")
        if not _fits(rule, kind):
            raise InswsnError(
                f"The rule of {name} is {rule!r}; it must be any, 'one of' words, 'a file', "
                "'a folder' or 'a regressor' for a str, or an interval for a number, such as "
                "in [0, 10)."
            )
        try:
            value = ast.literal_eval(default)
        except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError):
            raise InswsnError(f"The default of {name} is not a literal.") from None
        draft = Parameter(name, kind, value, unit, rule, " ".join(meaning))
        parameters[name] = replace(draft, default=draft.check(value))
        meaning = []
    return Schema(tuple(parameters.values()))


def _fits(rule: str, kind: str) -> bool:
    """Tell whether a rule is one, and one for values of that kind."""
    named = rule in (FILE_RULE, FOLDER_RULE, REGRESSOR_RULE)
    if kind == "str" and (named or rule.startswith("one of ")):
        return True
    return rule == "any" or (kind in ("int", "float") and ends(rule) is not None)


def _form(value: object) -> str:
    """Return how the rows of a list look, such as ``..`` for two numbers; else nothing."""
    if not isinstance(value, list) or not value:
        return ""
    if isinstance(value[0], list):
        forms = {_form(row) for row in value}
        return f"[{forms.pop()}]" if len(forms) == 1 else ""
    numbers = all(type(n) in (int, float) and math.isfinite(n) for n in value)
    return "." * len(value) if numbers else ""


def _obeys(value: Value, rule: str) -> bool:
    if rule.startswith("one of "):
        return value in rule.removeprefix("one of ").split(", ")
    found = ends(rule)
    if found is None or isinstance(
        value, str | list
    ):  # the run looks for a file, and tries a regressor
        return True
    low, high, above, below = found
    return (low < value if above else low <= value) and (value < high if below else value <= high)


def ends(rule: str) -> tuple[float, float, bool, bool] | None:
    """Return the ends of an interval, and whether each of them is outside it; None for no one."""
    match = _INTERVAL.fullmatch(rule)
    try:
        low, high = (float(match[2]), float(match[3])) if match else (0.0, 0.0)
    except ValueError:
        return None
    if match is None or not low < high:
        return None
    above, below = match[1] == "(", match[4] == ")"
    closed_at_infinity = (math.isinf(low) and not above) or (math.isinf(high) and not below)
    return None if closed_at_infinity else (low, high, above, below)
