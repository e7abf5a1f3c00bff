"""What a chapter calls to say what it read and what it found."""

from __future__ import annotations

import ast
import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from IPython import get_ipython
from IPython.display import display
from pydantic import ValidationError

from inswsn_book.record.files import file_digest, write_whole
from inswsn_book.record.parameters import chapter_schema
from inswsn_book.record.project import RESULTS_VARIABLE, find_root, results_folder
from inswsn_book.record.provenance import MACHINE, machine_facts
from inswsn_book.record.results import (
    Quantity,
    Results,
    first_problem,
    quantity_digest,
    read_results,
    write_results,
)
from inswsn_book.record.timing import Sampler
from inswsn_lib.errors import InswsnError

#: Share of the points of the crossed study at which a headline may not hold: beyond it, it is none
MOST_TURNED = 0.25
_PACKAGES = ("inswsn_lib", "inswsn_book")
# MyST-NB pastes outputs of this type into the text by the role {glue:text}.
_GLUE_TYPE = "application/papermill.record/text/plain"


def told_turning(turned: float) -> str:
    """Return at what share of the points of the crossed study a conclusion does not hold.

    Behind it stands what that makes of the conclusion, if the share is more than `MOST_TURNED`.
    """
    told = f"fails at {100 * turned:.0f} % of the points"
    if turned <= MOST_TURNED:
        return told
    return f"{told}, so it is {'undecided' if turned <= 1 - MOST_TURNED else 'the exception'}"


class ChapterRecord:
    """The record that a chapter keeps while it runs, and writes at its end.

    It is made from the chapter's id and a mapping in which its parameters are, as ``globals()``.
    """

    def __init__(
        self, chapter: str, parameters: Mapping[str, Any], root: Path | None = None
    ) -> None:
        self._root = find_root() if root is None else root
        self._chapter = chapter
        #: The declared parameters of the chapter
        self.schema = chapter_schema(self._root, chapter)
        for name in _injected():
            self.schema[name]  # refuses one that is not declared
        missing = [name for name in self.schema.defaults if name not in parameters]
        if missing:
            raise InswsnError(f"Chapter {chapter} keeps no record of its parameter {missing[0]}.")
        #: Their values
        self.parameters: dict[str, Any] = self.schema.check(
            {n: parameters[n] for n in self.schema.defaults}
        )
        self._data: dict[str, str] = {}
        self._quantities: dict[str, Quantity] = {}
        self._sentences: dict[str, bool] = {}
        self._solvers: dict[str, str] = {}
        self._studies: dict[str, bool] = {}
        # where nobody reads how long it took, nobody looks
        self._sampler = Sampler() if RESULTS_VARIABLE in os.environ else None

    def as_published(self, names: Iterable[str]) -> bool:
        """Tell whether these parameters have the values of the published run."""
        return all(self.parameters[name] == self.schema[name].default for name in names)

    def data(self, name: str) -> Path:
        """Return the path of a file and note that this chapter reads it.

        The name is its path below ``data/`` with forward slashes, or the absolute path of a
        reader's own file. The build executes the chapter again when its content changes.
        """
        if Path(name).is_absolute():
            path, key = Path(name), name
        else:
            path, key = self._root / "data" / name, f"data/{name}"
        if not path.is_file():
            raise InswsnError(f"There is no file {key}.")
        self._data[key] = file_digest(path)
        return path

    def reference(self, chapter: str, name: str) -> Quantity:
        """Return a quantity of a chapter's reference results and note that this chapter reads it.

        The build executes the chapter again when the reference says something else of this
        quantity; other quantities, and what the reference was made with, make no chapter due.
        """
        key = f"data/published/{chapter}.json"
        try:
            found = read_results(self._root / key)[name]
        except KeyError:
            raise InswsnError(f"{key} has no quantity {name!r}.") from None
        self._data[f"{key}#{name}"] = quantity_digest(found)
        return found

    def quantity(self, name: str, value: float, unit: str, **fields: Any) -> Quantity:
        """Record a number, and make it known to the text as ``{glue:text}`name```.

        The fields are those of `Quantity`, which refuses what does not fit. An interval is a
        rounding interval of a number computed from printed cells, else a confidence interval,
        unless ``interval_kind`` says otherwise.
        """
        if fields.get("interval") is not None and fields.get("interval_kind") is None:
            printed = fields.get("basis") == "printed"
            fields["interval_kind"] = "rounding" if printed else "confidence 95 %"
        try:
            quantity = Quantity(name=name, value=value, unit=unit, **fields)
        except ValidationError as error:
            said = first_problem(error, "interval")
            raise InswsnError(f"The quantity {name!r} cannot be recorded: {said}.") from None
        if name in self._quantities:
            raise InswsnError(f"The quantity {name!r} is recorded already.")
        self._quantities[name] = quantity
        _glue(name, quantity.value, quantity=name)  # by which the build finds the cell
        return quantity

    def note(
        self,
        name: str,
        value: float,
        unit: str,
        how: str,
        *,
        relative: float = 1e-3,
        absolute: float = 1e-6,
        tolerance: float | None = None,
        kind: str = "runs 95 %",
        **fields: Any,
    ) -> Quantity:
        """Record a number that may differ by a share of it, or a little, on other machines.

        It is one of a simulation, and an interval that of the runs, unless kind and fields, as for
        `quantity`, say otherwise. A tolerance that is given stands in the place of both.
        """
        bounds = {"tolerance": absolute, "share": relative}
        if tolerance is not None:
            bounds = {"tolerance": tolerance}
        fields = {"basis": "simulation"} | bounds | fields
        if fields.get("interval") is not None:
            fields["interval_kind"] = kind
        return self.quantity(name, float(value), unit, how=how, **fields)

    def say(self, name: str, text: str) -> None:
        """Make a word known to the text as ``{glue:text}`name```, without recording it."""
        _glue(name, str(text))

    def quote(
        self, chapter: str, name: str, form: str = ".0f", short: str = "", *, unit: float = 1
    ) -> None:
        """Make a number of another chapter's reference results known to the text, in a unit.

        It has its own name here, or a short one.
        """
        self.say(short or name, f"{self.reference(chapter, name).value / unit:{form}}")

    def crossed(self, chapter: str, name: str, form: str = ".0f", short: str = "") -> None:
        """Make known as ``crossed.NAME`` where a number lies if all assumptions vary at once.

        That is the range of 95 % of the points of the crossed study, such as ``57 to 112``; as
        ``crossed.NAME.turned`` what `told_turning` says, if a value of the result turns a
        conclusion. A name may be made known by a short one.
        """
        spreads = json.loads(self.data("crossed.json").read_text(encoding="utf-8"))["spreads"]
        spread = spreads[f"{chapter} {name}"]
        low, *_, high = (max(end, 0.0) for end in spread["quantiles"])
        self.say(f"crossed.{short or name}", f"{low:{form}} to {high:{form}}")
        if spread["turned"] is not None:
            self.say(f"crossed.{short or name}.turned", told_turning(spread["turned"]))

    def holds(self, sentence: str, condition: object) -> None:
        """Bind a sentence of the page, or its gist, to the condition that makes it true.

        The build of the book fails if the condition is false. A rerun with other parameters goes
        on, and its results file tells which sentences no longer hold.
        """
        # also numpy's truth value; a number or a text would always vouch for the sentence
        if type(condition).__name__ not in ("bool", "bool_"):
            raise InswsnError(
                f"The condition of {sentence!r} is {condition!r}; it must be true or false."
            )
        if sentence in self._sentences:
            raise InswsnError(f"The sentence {sentence!r} is bound already.")
        self._sentences[sentence] = bool(condition)

    def solver(self, name: str, status: str) -> None:
        """Record a solver that the chapter called, and the status that it ended with."""
        self._solvers[name] = status

    def study(self, name: str, *, computed: bool) -> None:
        """Record of a study of recordings, kept in a file of ``data/``, if it was computed here.

        Where not all recordings are at hand it is taken as it is kept. The build holds what is kept
        against the reference in either case.
        """
        self._studies[f"data/{name}"] = computed

    def write_file(self, name: str, text: str) -> None:
        """Write a file such as ``corrected.csv`` beside the results file, for whoever reruns."""
        write_whole(results_folder(self._root) / name, text)

    def results(self) -> Results:
        """Return what has been recorded so far, without provenance, which the executor adds."""
        return Results(
            chapter=self._chapter,
            parameters=self.parameters,
            data=dict(sorted(self._data.items())),
            quantities=tuple(self._quantities.values()),
            sentences=self._sentences,
            solvers=self._solvers,
        )

    def write(self) -> Results:
        """Write the results file ``NAME.json``, whole or not at all, and return what it holds.

        What the chapter was computed with goes beside it, for the executor.
        """
        results, folder = self.results(), results_folder(self._root)
        own = [name for name in sys.modules if name.partition(".")[0] in _PACKAGES]
        facts = machine_facts() | {"executable": sys.executable, "modules": own}
        facts["studies"] = self._studies
        facts["functions"] = self._sampler.end() if self._sampler else {}
        write_whole(folder / MACHINE, json.dumps(facts))
        write_results(results, folder / f"{self._chapter}.json")
        return results


def _injected() -> Iterator[str]:
    """Yield the names that papermill has set: it puts a cell below that of the parameters."""
    shell = get_ipython()
    for cell in shell.user_ns.get("In", ()) if shell else ():
        if cell.startswith("# Parameters\n"):
            for statement in ast.parse(cell).body:
                targets = statement.targets if isinstance(statement, ast.Assign) else []
                yield from (target.id for target in targets if isinstance(target, ast.Name))


def plain(value: float) -> int | float:
    """Return a whole number as one: as text shows it."""
    return int(value) if float(value).is_integer() and abs(value) < 1e15 else value


def _glue(name: str, value: float | str, **details: str) -> None:
    display(
        # a text in quotes, since what is glued is evaluated
        {_GLUE_TYPE: repr(value if isinstance(value, str) else plain(value))},
        metadata={
            "scrapbook": {"name": name, "mime_prefix": "application/papermill.record/"} | details
        },
        raw=True,
    )
