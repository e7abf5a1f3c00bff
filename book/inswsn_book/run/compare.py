"""How results differ from others, and from the reference; and making a build the reference."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, zip_longest
from pathlib import Path

from inswsn_book.judge.ledger import Claim
from inswsn_book.judge.verdicts import Judged, verdicts
from inswsn_book.record.files import write_listed
from inswsn_book.record.progress import Progress
from inswsn_book.record.project import Project
from inswsn_book.record.results import Quantity, Results, results_text
from inswsn_book.run.store import Run, book_runs, reference_results, run_all
from inswsn_lib.errors import BuildError, InswsnError
from inswsn_lib.files import DATA_VARIABLE

# What a quantity is, beside its numbers: a reference that had its tolerance widened would vouch for
# anything
_KIND = ("unit", "interval_kind", "runs", "basis", "role", "tolerance", "share")
_OF_RECORDINGS = ("recorded", "emulation")
# How quantities of a method of the reader's own begin
_OWN = "own."
#: A number as a table shows it
NUMBER = re.compile(r"[-−+]?\d[\d.,]*(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Change:
    """One quantity in two results files; None where it is absent."""

    name: str
    before: Quantity | None
    after: Quantity | None

    @property
    def kind(self) -> list[str]:
        """What differs in what the quantity is, a text for each field."""
        return self._differing(_KIND)

    def moved(self, by: float = 0.0, share: float = 0.0) -> bool:
        """Tell whether it appeared, vanished, became another quantity, or moved by more."""
        return bool(self.kind) or self.apart(by, share)

    def apart(self, by: float = 0.0, share: float = 0.0) -> bool:
        """Tell whether its numbers are farther apart than that, or one of them is not there.

        The ends of its interval may move as its value may.
        """
        if self.before is None or self.after is None:
            return True
        old = (self.before.value, *(self.before.interval or ()))
        new = (self.after.value, *(self.after.interval or ()))
        near = [abs(b - a) <= by + share * abs(a) for a, b in zip(old, new, strict=False)]
        return not (all(near) and len(old) == len(new))

    @property
    def beyond_tolerance(self) -> bool:
        """Whether it is more than the tolerance that it states away, or another quantity."""
        return self.moved(by=self.before.slack if self.before else 0.0)

    @property
    def beyond_rounding(self) -> bool:
        """Whether it moved by more than another order of the same sums may move it."""
        return self.moved(by=1e-6 * self.before.slack if self.before else 0.0, share=1e-12)

    @property
    def is_rounding(self) -> bool:
        """Whether nothing but its numbers differs, within the tolerance that it states."""
        return not self.beyond_tolerance and not self._differing(["how"])

    def _differing(self, fields: Iterable[str]) -> list[str]:
        if self.before is None or self.after is None:
            return []
        return [
            f"{field} {getattr(self.before, field)} -> {getattr(self.after, field)}"
            for field in fields
            if getattr(self.before, field) != getattr(self.after, field)
        ]

    def __str__(self) -> str:
        """Return one line: the name, the value before, the value after, the difference."""
        before, after = (
            "absent" if quantity is None else f"{quantity.value:.10g} {quantity.unit}"
            for quantity in (self.before, self.after)
        )
        line = f"{self.name}: {before} -> {after}"
        if self.before is None or self.after is None:
            return line
        difference = self.after.value - self.before.value
        line += f" (change {difference:+.3g}, tolerance {self.before.slack:.3g})"
        others = [f for f in Quantity.model_fields if f not in ("name", "value", "unit")]
        return "; ".join([line, *self._differing(others)])


def pair_quantities(before: Results, after: Results) -> list[Change]:
    """Return every quantity of two results; those that `before` lacks come last."""
    old = {quantity.name: quantity for quantity in before.quantities}
    new = {quantity.name: quantity for quantity in after.quantities}
    return [Change(name, old.get(name), new.get(name)) for name in dict.fromkeys([*old, *new])]


#: A claim, and its verdict by two results; None where nothing decides it
Flip = tuple[Claim, Judged | None, Judged | None]


def flipped_verdicts(claims: Iterable[Claim], before: Results, after: Results) -> list[Flip]:
    """Return the claims of a chapter whose verdict differs between two results of it."""
    judged = [(claim, _judge(claim, before), _judge(claim, after)) for claim in claims]
    return [(c, old, new) for c, old, new in judged if _word(old) != _word(new)]


def _judge(claim: Claim, results: Results) -> Judged | None:
    try:
        return verdicts([claim], [results])[0]
    except InswsnError:  # the other version of the chapter did not record what decides it
        return None


def _word(judged: Judged | None) -> str:
    return judged.words if judged else "without a verdict"


def compare_conditions(before: Results, after: Results) -> list[str]:
    """Return a line for each parameter, data file, sentence, solver and cell that differs."""
    fields = ("parameters", "data", "sentences", "solvers", "cells")
    return [
        f"{field}: {line}"
        for field in fields
        for line in differing(getattr(before, field), getattr(after, field))
    ]


def differing(before: Mapping[str, object], after: Mapping[str, object]) -> list[str]:
    """Return a line for each name that stands for something else, is new, or is gone."""
    return [
        f"{name}: {before.get(name, 'absent')} -> {after.get(name, 'absent')}"
        for name in dict.fromkeys([*after, *before])
        if before.get(name) != after.get(name)
    ]


def comparison(before: Results, after: Results, claims: Sequence[Claim]) -> list[str]:
    """Return a line for each thing that differs between two results, and a summary.

    What differs by rounding alone is left out. First stands what was set, and what came of a method
    of the reader's own.
    """
    pairs = pair_quantities(before, after)
    changed = [pair for pair in pairs if pair.beyond_rounding]
    changed.sort(key=lambda pair: not pair.name.startswith(_OWN))
    conditions = compare_conditions(before, after)
    flips = flipped_verdicts(claims, before, after)
    overturned = sum(line.startswith("sentences: ") for line in conditions)
    sentences = len(before.sentences.keys() | after.sentences.keys())
    return [
        *(line for line in conditions if line.startswith("parameters: ")),
        *map(str, changed),
        *(line for line in conditions if not line.startswith(("cells: ", "parameters: "))),
        *_tables_that_differ(before, after),
        *(
            f"verdict {claim.id}: {_word(old)} -> {_word(new)}"
            + (f" ({new.reason})" if new else "")
            for claim, old, new in flips
        ),
        f"{len(changed)} of {len(pairs)} quantities changed, {overturned} of {sentences} sentences "
        f"overturned, {len(flips)} of {len(claims)} verdicts flipped.",
    ]


def _tables_that_differ(before: Results, after: Results) -> Iterator[str]:
    for name in sorted(before.tables.keys() | after.tables.keys()):
        old, new = (list(chain(*results.tables.get(name, ()))) for results in (before, after))
        if changed := sum(a != b for a, b in zip_longest(old, new)):
            yield f"table {name}: {changed} of {max(len(old), len(new))} cells differ"


def _changes(before: Results, after: Results) -> list[str]:
    """Return a line for each thing that differs between the reference of a chapter and a build.

    There is none if numbers have moved within their tolerances alone, as on another machine. Those
    of a table are recorded as quantities; by itself it counts where its words differ, or its form.
    """
    pairs = [pair for pair in pair_quantities(before, after) if pair.before != pair.after]
    conditions = compare_conditions(before, after)
    same_words = _without_numbers(before) == _without_numbers(after)
    words = differing(*_words(before, after))
    if not (conditions or words) and same_words and all(pair.is_rounding for pair in pairs):
        return []
    return [
        *(f"{'!' if p.beyond_tolerance else ' '} {after.chapter} {p}" for p in pairs),
        *(f"! {after.chapter} {condition}" for condition in conditions),
        *(f"  {after.chapter} {line}" for line in _tables_that_differ(before, after)),
        *(f"  {after.chapter} words: {line}" for line in words),
    ]


def _without_numbers(results: Results) -> dict[str, list[list[str]]]:
    """Return the tables of results with a sign in the place of each number."""
    return {
        name: [[NUMBER.sub("#", cell) for cell in row] for row in table]
        for name, table in results.tables.items()
    }


def _words(before: Results, after: Results) -> list[dict[str, str]]:
    """Return what results say in words, with a sign in the place of each number.

    Where one run has computed a study and the other has taken it as it is kept, words may differ.
    """
    made = [r.provenance.studies if r.provenance else {} for r in (before, after)]
    said = [{n: NUMBER.sub("#", w) for n, w in r.words.items()} for r in (before, after)]
    return said if made[0] == made[1] else [dict.fromkeys(words, "said") for words in said]


def changes_to_publish(project: Project) -> list[str]:
    """Return a line for each thing that publishing changes; what a build may not change has a !."""
    lines = []
    for run in book_runs(project):
        lines += _changes(reference_results(project, run.request.chapter), run.results)
    left = [f"! data/published/{p.name} belongs to no chapter, and goes." for p in _left(project)]
    return lines + left


def check_kept_studies(
    project: Project, made: Iterable[Run], progress: Progress, *, fresh: bool = False
) -> None:
    """Refuse a kept study of recordings by which a chapter does not find the reference.

    A chapter that was computed on the recordings is run again on what is kept.
    """
    kept = [run for run in made if _studies(run)]
    nowhere = {DATA_VARIABLE: os.devnull}
    again = [replace(r.request, variables=nowhere) for r in kept if any(_studies(r).values())]
    kept = [run for run in kept if not any(_studies(run).values())]
    for run in kept + run_all(project, again, progress, fresh=fresh):
        chapter = run.request.chapter
        before = reference_results(project, chapter)
        far = [
            f"  {pair}"
            for pair in pair_quantities(before, run.results)
            if pair.before and pair.before.basis in _OF_RECORDINGS and pair.apart(pair.before.slack)
        ]
        if far:
            studies = " and ".join(_studies(run))
            raise BuildError(
                f"{studies}, a study that is kept, and data/published/{chapter}.json, the "
                f"reference, disagree:\n" + "\n".join(far) + "\nWhere the recordings are at hand, "
                "make the study anew by `make recorded`, then the reference by `make publish`."
            )


def _studies(run: Run) -> dict[str, bool]:
    return run.results.provenance.studies if run.results.provenance else {}


def _left(project: Project) -> list[Path]:
    numbers = {chapter.id for chapter in project.chapters()}
    return [p for p in sorted(project.published.glob("*.json")) if p.stem not in numbers]


def publish_build(project: Project) -> list[str]:
    """Make the present build the reference; return the files that were written.

    Nothing is written if a chapter has not been built as it is now. A chapter in which numbers have
    moved within their tolerances alone keeps its reference.
    """
    changed = {
        f"{run.request.chapter}.json": results_text(run.results)
        for run in book_runs(project)
        if _changes(reference_results(project, run.request.chapter), run.results)
    }
    for path in _left(project):
        path.unlink()
    write_listed(project.published, changed)
    return [f"data/published/{name}" for name in changed]
