"""The claims of the papers: what each says, which quantity decides it, and within what.

``data/claims/`` holds them, a file for each paper. A claim has no field for a verdict: `verdicts`
computes it. A *family* is an entry that stands for a whole table of claims: ``over`` gives its
axes, each with the words that its places put into the texts, and ``values`` the cells, row by row::

    - id: P1-T2-INS-{c}-{a}
      says: "In area {a} the mean {what} error in ${axis}$ of INS-only is {value} {unit}."
      over:
        c: {rx: {what: position, axis: x, unit: m}, ry: {what: position, axis: y, unit: m}}
        a: [1, 2]
      values: |
        7.8315 40.6179
        4.7923 36.0891

and so on for the other fields of a claim. ``-`` leaves a cell out.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from decimal import Decimal
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import Field, ValidationError, model_validator

from inswsn_book.record.files import file_digest, text_digest
from inswsn_book.record.parameters import Value
from inswsn_book.record.results import Frozen, Name, first_problem, quantity_digest, read_results
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

#: The ledger below the root of a checkout.
LEDGER = "data/claims"

Paper = Literal["P1", "P2", "P3"]
Kind = Literal["numeric", "parameter", "qualitative", "formula"]
#: The papers and the kinds of claims, in the order in which pages list them
PAPERS: tuple[str, ...] = get_args(Paper)
KINDS: tuple[str, ...] = get_args(Kind)
Text = Annotated[str, Field(min_length=3, pattern=r"^[^\n]+$")]

#: A number, to the digit
Printed = Annotated[str, Field(pattern=r"^[+-]?\d+(\.\d+)?([eE][+-]?\d\d?)?$")]
#: The tolerance of a claim that prints one draw, which `verdicts` holds against single runs
DRAWN = "drawn"
_SIZE = r"\d+(?:\.\d+)?(?:[eE][+-]?\d\d?)?"
_TOLERANCE = re.compile(
    rf"digits|{DRAWN}|within (?:(?P<share>{_SIZE}) %|(?P<size>{_SIZE})|(?P<name>[a-z]\w*))"
    rf"|(?P<word>at least|at most|exactly) (?P<bound>[+-]?{_SIZE})"
)


class QuantityCheck(Frozen):
    """The quantity of a chapter that decides a claim."""

    chapter: Name
    quantity: Name


class MissingCheck(Frozen):
    """What would be needed to decide a claim and cannot be had, by its names in ``missing``."""

    needs: Annotated[tuple[Name, ...], Field(min_length=1)]
    reasons: tuple[str, ...]  # what that list says of them, see `load_claims`


class Claim(Frozen):
    """One claim of a paper; its id never changes.

    `value` is what is printed, to the digit, and `unit` that of what is compared. `tolerance` is
    what the quantity is held against: ``digits`` (all that rounds to the printed value), ``drawn``
    (the same, of a value that is one draw: the runs have to reach it), ``within 0.5`` or ``within
    10 %`` of it, ``within about_points`` (a parameter of the chapter), ``at least 8``, ``at most
    1`` or ``exactly 8``; `why` says why, and `assumption` what has to be assumed for
    the check to speak of the claim. A claim that cannot be tested has neither.
    """

    id: Annotated[str, Field(pattern=r"^P[123](-[A-Za-z0-9.]+)+$", max_length=40)]
    paper: Paper
    place: Text
    says: Text
    value: Printed | list[str] | list[list[str]] | None = None
    unit: Annotated[str, Field(min_length=1)] = "1"
    kind: Kind
    check: QuantityCheck | MissingCheck
    tolerance: str | None = None
    why: Text
    assumption: Text | None = None

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        if not self.id.startswith(f"{self.paper}-"):
            raise ValueError(f"the id {self.id} does not begin with {self.paper}-")
        if isinstance(self.check, MissingCheck):
            if self.tolerance is not None or self.assumption is not None:
                raise ValueError("a claim that cannot be tested has no tolerance and no assumption")
        elif self.tolerance is None:
            raise ValueError("a claim that is checked has a tolerance")
        else:
            self._check_tolerance(self.tolerance)
        return self

    def _check_tolerance(self, tolerance: str) -> None:
        """Refuse one that is none, and one that vouches for anything or for nothing."""
        parts = _TOLERANCE.fullmatch(tolerance)
        if parts is None:
            raise ValueError(
                f"{tolerance!r} is not a tolerance; one is digits, drawn, within 0.5, within 10 %, "
                "within a parameter, at least 8, at most 1, or exactly 8"
            )
        if not isinstance(self.value, str):
            if not parts["bound"]:
                raise ValueError(f"the tolerance {tolerance!r} needs one printed value")
            return
        value, (low, high) = float(self.value), self.published({parts["name"]: 0})
        if not low <= value <= high:
            raise ValueError(f"the tolerance {tolerance!r} excludes {self.value} itself")
        # a tolerance as wide as the number would reproduce anything: a typed verdict
        if not parts["bound"] and low <= 0 <= high and value != 0:
            raise ValueError(f"the tolerance {tolerance!r} is as wide as {self.value}")

    @property
    def chapter(self) -> str | None:
        """The chapter that decides it, two digits; None if it cannot be tested."""
        return self.check.chapter if isinstance(self.check, QuantityCheck) else None

    @property
    def anchor(self) -> str:
        """The label of its place on the claims page."""
        return "claim-" + re.sub(r"[^a-z0-9]+", "-", self.id.lower())

    @property
    def reference(self) -> float:
        """The number that widths are measured by, the printed one or that of the bound."""
        if isinstance(self.value, str):
            return float(self.value)
        return float(self._tolerance_parts().get("bound") or math.nan)

    def published(self, parameters: Mapping[str, Value]) -> tuple[float, float]:
        """Return the ends of what the claim stands for, infinite where it bounds one side alone.

        One of the parameters of the run may be the tolerance; one that is no size is refused.
        """
        parts = self._tolerance_parts()
        if parts.get("bound"):
            number = float(parts["bound"])
            return (
                -math.inf if parts["word"] == "at most" else number,
                math.inf if parts["word"] == "at least" else number,
            )
        value = Decimal(str(self.value))
        if parts.get("share"):
            half = abs(value) * Decimal(parts["share"]) / 100
        elif parts.get("size"):
            half = Decimal(parts["size"])
        elif name := parts.get("name"):
            size = parameters.get(name)
            if isinstance(size, bool) or not isinstance(size, int | float) or size < 0:
                raise InswsnError(
                    f"The tolerance of claim {self.id} is the parameter {name} of chapter "
                    f"{self.chapter}, which is {size!r}; it must be a number that is not negative."
                )
            half = Decimal(str(size))
        else:  # digits or drawn: half a unit of the last digit printed
            half = Decimal(5).scaleb(int(value.as_tuple().exponent) - 1)
        return float(value - half), float(value + half)

    def _tolerance_parts(self) -> dict[str, str]:
        parts = _TOLERANCE.fullmatch(self.tolerance or "")
        return parts.groupdict() if parts else {}


class _Ledger(Frozen):
    missing: dict[Name, Text] = {}
    words: dict[str, Any] = {}  # for anchors that families share
    claims: tuple[Claim, ...]


def written_out(entry: Any) -> list[Any]:
    """Return the claims of a family, which has a value for each place; another entry as it is."""
    if not isinstance(entry, dict) or "over" not in entry:
        return [entry]
    axes = [
        {str(key): places[key] or {} for key in places}
        if isinstance(places, dict)
        else {str(key): {} for key in places}
        for places in entry["over"].values()
    ]
    values, places = str(entry.get("values", "")).split(), list(product(*axes))
    if len(values) != len(places):
        raise ValueError(f"{entry.get('id')} has {len(values)} values for {len(places)} places")
    rest = {key: field for key, field in entry.items() if key not in ("over", "values")}
    claims = []
    for place, value in zip(places, values, strict=True):
        if value != "-":
            words = {"value": value, **dict(zip(entry["over"], place, strict=True))}
            for axis, key in zip(axes, place, strict=True):
                words |= axis[key]
            claims.append(_with_words(rest, words) | {"value": value})
    return claims


def _with_words(field: Any, words: Mapping[str, str]) -> Any:
    """Put words in the place of their names in braces, in all texts of a field."""
    if isinstance(field, dict):
        return {key: _with_words(value, words) for key, value in field.items()}
    for name, word in words.items() if isinstance(field, str) else ():
        field = field.replace(f"{{{name}}}", str(word))
    return field


def load_claims(path: Path) -> tuple[Claim, ...]:
    """Read the ledger: the folder ``data/claims``, or one file; what is wrong is refused."""
    paths = sorted(path.glob("*.yaml")) if path.is_dir() else [path]
    if not paths:
        raise InswsnError(f"There is no ledger of claims in {path}.")
    claims = tuple(claim for file in paths for claim in _read_ledger(file))
    anchors = [claim.anchor for claim in claims]
    if twice := sorted({c.id for c in claims if anchors.count(c.anchor) > 1}):
        raise InswsnError(
            f"{path}: the ids {', '.join(twice)} are used twice or differ in signs alone."
        )
    return claims


def _read_ledger(path: Path) -> tuple[Claim, ...]:
    content = read_yaml(path)
    try:
        if isinstance(content, dict) and isinstance(content.get("claims"), list):
            content["claims"] = [c for entry in content["claims"] for c in written_out(entry)]
            for entry in content["claims"]:
                _add_reasons(entry, content.get("missing", {}))
        return _Ledger.model_validate(content).claims
    except ValidationError as error:
        said = first_problem(error, content=content)
    except (ValueError, TypeError, AttributeError) as error:  # such as an axis that is a number
        said = str(error)
    raise InswsnError(f"{path} is not a ledger of claims: {said}.")


def _add_reasons(entry: Any, missing: Mapping[str, str]) -> None:
    """Add to a claim that cannot be tested what is listed of what it needs."""
    if not isinstance(entry, dict) or not isinstance(check := entry.get("check"), dict):
        return
    for need in check.get("needs") or ():
        if need not in missing:
            raise ValueError(f"{entry.get('id')} needs {need}, which is not listed missing")
        check["reasons"] = [*check.get("reasons", ()), missing[need]]


def claims_of(claims: Iterable[Claim], chapter: str) -> list[Claim]:
    """Return the claims that a chapter decides."""
    return [claim for claim in claims if claim.chapter == chapter]


def claims_digest(path: Path, chapter: str) -> str:
    """Return the SHA-256 of what the ledger says on the claims that one chapter decides."""
    claims = claims_of(load_claims(path), chapter)
    return text_digest("\n".join(claim.model_dump_json() for claim in claims))


def data_digest(root: Path, name: str) -> str | None:
    """Return the SHA-256 of a file that a chapter reads, or of the part of it that it reads.

    A name is a path, or ``data/claims#NN`` for the claims that chapter NN decides, or
    ``data/published/NAME.json#name`` for one quantity of the reference results.
    """
    path, _, part = name.partition("#")
    if not part:
        return file_digest(root / path) if (root / path).is_file() else None
    try:
        if path == LEDGER:
            return claims_digest(root / path, part)
        return quantity_digest(read_results(root / path)[part])
    except (InswsnError, KeyError):
        return None
