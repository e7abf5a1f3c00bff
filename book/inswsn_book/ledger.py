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
from collections.abc import Iterable
from decimal import Decimal, InvalidOperation
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from inswsn_book.files import file_digest, text_digest
from inswsn_book.parameters import Value
from inswsn_book.results import Name, quantity_digest, read_results
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
Printed = str | list[str] | list[list[str]]

_SIZE = r"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?"
_NUMBER = rf"[+-]?{_SIZE}"
_WITHIN = re.compile(rf"^within (?:(?P<share>{_SIZE}) %|(?P<size>{_SIZE})|(?P<name>[a-z]\w*))$")
_BOUND = re.compile(rf"^(?P<word>at least|at most|exactly) (?P<number>{_NUMBER})$")


class _Entry(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class QuantityCheck(_Entry):
    """The quantity that decides a claim.

    Attributes
    ----------
    chapter : str
        The chapter that records it, two digits.
    quantity : str
        Its name there.
    """

    chapter: Annotated[str, Field(pattern=r"^\d\d$")]
    quantity: Name


class MissingCheck(_Entry):
    """What would be needed to decide a claim and cannot be had.

    Attributes
    ----------
    needs : tuple of str
        Names in the ledger's list of what is missing.
    reasons : tuple of str
        What that list says of them; filled in when the ledger is read.
    """

    needs: Annotated[tuple[Name, ...], Field(min_length=1)]
    reasons: tuple[str, ...] = ()


class Claim(_Entry):
    """One claim of a paper.

    Attributes
    ----------
    id : str
        Its name; it never changes.
    paper : {"P1", "P2", "P3"}
    place : str
        Where it stands in the paper.
    says : str
        What the paper says, in our words.
    value : str or list, optional
        The number, or the row or matrix of numbers, exactly as printed.
    unit : str, optional
        The unit of what is compared; ``"1"`` for a pure number.
    kind : {"numeric", "parameter", "qualitative", "formula"}
    check : QuantityCheck or MissingCheck
        What decides it.
    tolerance : str, optional
        What the quantity is held against: ``digits`` (all that rounds to the printed value),
        ``within 0.5`` or ``within 10 %`` of the value, ``within about_points`` (a parameter of the
        chapter), ``at least 8``, ``at most 1``, ``exactly 8``. Not given if the claim cannot be
        tested.
    why : str
        Why this check and this tolerance.
    assumption : str, optional
        What has to be assumed for the check to speak of the claim.
    """

    id: Annotated[str, Field(pattern=r"^P[123](-[A-Za-z0-9.]+)+$", max_length=40)]
    paper: Paper
    place: Text
    says: Text
    value: Printed | None = None
    unit: Annotated[str, Field(min_length=1)] = "1"
    kind: Kind
    check: QuantityCheck | MissingCheck
    tolerance: str | None = None
    why: Text
    assumption: Text | None = None

    @field_validator("tolerance")
    @classmethod
    def _tolerance_is_one(cls, text: str | None) -> str | None:
        if text is None or text == "digits" or _WITHIN.match(text) or _BOUND.match(text):
            return text
        raise ValueError(
            f"{text!r} is no tolerance; it may be digits, within 0.5, within 10 %, within a "
            "parameter, at least 8, at most 1, or exactly 8"
        )

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        if not self.id.startswith(f"{self.paper}-"):
            raise ValueError(f"the id {self.id} does not begin with {self.paper}-")
        if isinstance(self.check, MissingCheck):
            if self.tolerance is not None or self.assumption is not None:
                raise ValueError("a claim that cannot be tested has no tolerance and no assumption")
            return self
        if self.tolerance is None:
            raise ValueError("a claim that is checked has a tolerance")
        if bound := _BOUND.match(self.tolerance):
            self._check_bound(bound["word"], float(bound["number"]))
            return self
        if not isinstance(self.value, str):
            raise ValueError(f"the tolerance {self.tolerance!r} needs one printed value")
        value, within = float(_decimal(self.value)), _WITHIN.match(self.tolerance)
        if within and not within["name"]:
            half = float(self._half_width(_decimal(self.value), {}))
            # a tolerance as wide as the number would reproduce anything: a typed verdict
            if not math.isfinite(half) or (value != 0 and half >= abs(value)):
                raise ValueError(f"the tolerance {self.tolerance!r} is as wide as {self.value}")
        return self

    def _check_bound(self, word: str, number: float) -> None:
        if not math.isfinite(number):
            raise ValueError(f"the tolerance {self.tolerance!r} has no finite bound")
        if word == "exactly" and not number.is_integer():
            raise ValueError(f"the tolerance {self.tolerance!r} is no whole number")
        if isinstance(self.value, str):
            value = float(_decimal(self.value))
            if (word != "at least" and value > number) or (word != "at most" and value < number):
                raise ValueError(f"the tolerance {self.tolerance!r} excludes {self.value} itself")

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
        """The number that widths are measured by: the printed one, or that of the bound."""
        if isinstance(self.value, str):
            return float(_decimal(self.value))
        bound = _BOUND.match(self.tolerance or "")
        return float(bound["number"]) if bound else math.nan

    def published(self, parameters: dict[str, Value]) -> tuple[float, float]:
        """Return the lower and the upper end of what the claim stands for.

        Parameters
        ----------
        parameters : dict
            The parameters of the run; one of them may be the tolerance.

        Returns
        -------
        low, high : float
            In the unit of the claim; infinite where it is a bound on one side.

        Raises
        ------
        InswsnError
            If the tolerance names a parameter that the run does not have, or that is no number.
        """
        tolerance = self.tolerance or ""
        if bound := _BOUND.match(tolerance):
            number = float(bound["number"])
            return (
                -math.inf if bound["word"] == "at most" else number,
                math.inf if bound["word"] == "at least" else number,
            )
        value = _decimal(str(self.value))
        half = self._half_width(value, parameters)
        return float(value - half), float(value + half)

    def _half_width(self, value: Decimal, parameters: dict[str, Value]) -> Decimal:
        within = _WITHIN.match(self.tolerance or "")
        if within is None:  # digits: half a unit of the last digit printed
            return Decimal(5).scaleb(int(value.as_tuple().exponent) - 1)
        if within["share"]:
            return abs(value) * Decimal(within["share"]) / 100
        if within["size"]:
            return Decimal(within["size"])
        size = parameters.get(within["name"])
        if isinstance(size, bool) or not isinstance(size, int | float) or size < 0:
            raise InswsnError(
                f"The tolerance of claim {self.id} is the parameter {within['name']} of chapter "
                f"{self.chapter}, which is {size!r}; it may be a number that is not negative."
            )
        return Decimal(str(size))


class _Ledger(_Entry):
    missing: dict[Name, Text] = {}
    words: dict[str, Any] = {}  # for anchors that families share
    claims: tuple[Claim, ...]

    @model_validator(mode="before")
    @classmethod
    def _families_are_written_out(cls, content: Any) -> Any:
        if not isinstance(content, dict) or not isinstance(content.get("claims"), list):
            return content
        entries = [claim for entry in content["claims"] for claim in written_out(entry)]
        return content | {"claims": entries}

    @model_validator(mode="after")
    def _holds_together(self) -> Self:
        for claim in self.claims:
            if not isinstance(claim.check, MissingCheck):
                continue
            if claim.check.reasons:
                raise ValueError(f"claim {claim.id} gives reasons; they stand in the list missing")
            for need in claim.check.needs:
                if need not in self.missing:
                    raise ValueError(f"claim {claim.id} needs {need}, which is not listed missing")
        return self

    def resolved(self) -> tuple[Claim, ...]:
        """Return the claims, with the reasons of those that cannot be tested."""
        return tuple(
            claim.model_copy(
                update={
                    "check": MissingCheck(
                        needs=claim.check.needs,
                        reasons=tuple(self.missing[need] for need in claim.check.needs),
                    )
                }
            )
            if isinstance(claim.check, MissingCheck)
            else claim
            for claim in self.claims
        )


def written_out(entry: Any) -> list[Any]:
    """Return the claims of a family; any other entry as it is.

    Raises
    ------
    ValueError
        If a family has not a value for each of its places.
    """
    if not isinstance(entry, dict) or "over" not in entry:
        return [entry]
    axes = [
        {str(key): words or {} for key, words in places.items()}
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


def _with_words(field: Any, words: dict[str, str]) -> Any:
    """Put words in the place of their names in braces, in all texts of a field."""
    if isinstance(field, dict):
        return {key: _with_words(value, words) for key, value in field.items()}
    for name, word in words.items() if isinstance(field, str) else ():
        field = field.replace(f"{{{name}}}", str(word))
    return field


def load_claims(path: Path) -> tuple[Claim, ...]:
    """Read and check the ledger of claims.

    Parameters
    ----------
    path : Path
        The folder, ``data/claims`` in a checkout, or one file.

    Raises
    ------
    InswsnError
        If there is no such folder or a file does not fit the schema; the sentence says where. A
        field for a verdict does not fit.
    """
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
        read = _Ledger.model_validate(content)
    except ValidationError as error:
        raise InswsnError(f"{path} is not a ledger of claims: {_first(error, content)}.") from None
    return read.resolved()


def claims_of(claims: Iterable[Claim], chapter: str) -> list[Claim]:
    """Return the claims that a chapter decides."""
    return [claim for claim in claims if claim.chapter == chapter]


def claims_digest(path: Path, chapter: str) -> str:
    """Return the SHA-256 of what the ledger says on the claims that one chapter decides."""
    claims = claims_of(load_claims(path), chapter)
    return text_digest("\n".join(claim.model_dump_json() for claim in claims))


def data_digest(root: Path, name: str) -> str | None:
    """Return the SHA-256 of a file that a chapter reads, or of the part of it that it reads.

    Parameters
    ----------
    name : str
        A path below it, or ``data/claims#NN`` for the claims that chapter NN decides, or
        ``data/published/NN.json#name`` for one quantity of the reference results.
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


def _first(error: ValidationError, content: object) -> str:
    """Return what is wrong first, with the id of the claim rather than its number."""
    first = error.errors()[0]
    place = [str(part) for part in first["loc"]]
    listed = content.get("claims") if isinstance(content, dict) else None
    if len(place) > 1 and place[0] == "claims" and isinstance(listed, list):
        entry = [claim for entry in listed for claim in written_out(entry)][int(place[1])]
        name = entry.get("id", f"number {place[1]}") if isinstance(entry, dict) else place[1]
        place[:2] = [f"claim {name}"]
    return f"{': '.join(place) or 'the file'}: {first['msg'].removeprefix('Value error, ')}"


def _decimal(text: str) -> Decimal:
    try:
        number = Decimal(text)
    except InvalidOperation:
        raise ValueError(f"the value {text!r} is no number") from None
    if not math.isfinite(float(number)):
        raise ValueError(f"the value {text!r} is no finite number")
    return number
