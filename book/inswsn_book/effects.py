"""What a change of an assumption does to the headline results: differences, and what is chance."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from scipy.stats import t as student

from inswsn_book.assumptions import Assumption, Assumptions, Headline, Within, quotient
from inswsn_book.results import Results
from inswsn_book.study import BASELINE, Run, Study

#: From here on a change counts as one that moves a result, as a share of it.
MOVES = 0.1


@dataclass(frozen=True)
class Effect:
    """What one rerun does to one headline.

    Attributes
    ----------
    headline : Headline
    before, after : float
        Its value in the unchanged run and in the rerun.
    band : float
        How far two unchanged runs that differ in their seed may be from one another, see `band_of`;
        in the unit of the headline.
    """

    headline: Headline
    before: float
    after: float
    band: float

    @property
    def change(self) -> float:
        """The change as a share of the unchanged value; infinite where that is zero."""
        difference = self.after - self.before
        if difference == 0:
            return 0.0
        return difference / abs(self.before) if self.before else math.copysign(math.inf, difference)

    @property
    def beyond(self) -> bool:
        """Whether the change is larger than chance makes it."""
        return abs(self.after - self.before) > self.band

    @property
    def moves(self) -> bool:
        """Whether the change is larger than chance makes it and than a tenth of the result."""
        return self.beyond and abs(self.change) > MOVES

    @property
    def turns(self) -> bool:
        """Whether the result comes to lie on the other side of where its conclusion turns."""
        edge = self.headline.turns
        return edge is not None and (self.before - edge) * (self.after - edge) < 0


@dataclass(frozen=True)
class Row:
    """What one rerun does to all headlines of its chapter.

    Attributes
    ----------
    entry : Assumption
    set : str
        What was chosen instead.
    run : Run or None
        The rerun; None if it has not been made.
    effects : tuple of Effect
        One for each headline that the rerun gives.
    flipped : dict of str to str
        By the id of a claim: its verdict, where no unchanged run has it.
    """

    entry: Assumption
    set: str
    run: Run | None
    effects: tuple[Effect, ...]
    flipped: Mapping[str, str]

    @property
    def size(self) -> float:
        """The largest change beyond chance; zero if there is none."""
        return max((abs(effect.change) for effect in self.effects if effect.beyond), default=0.0)


def band_of(values: list[float]) -> float:
    """Return how far two runs may be from one another by chance.

    It is the 95 % interval of the difference of two draws from a normal distribution whose
    deviation is known from `values` alone: Student's t for n - 1 degrees of freedom times the root
    of two times the sample deviation. A rerun has the seed of the unchanged run, so it differs from
    that by chance less than this.

    Parameters
    ----------
    values : list of float
        A headline in the unchanged runs, each with a seed of its own.

    Returns
    -------
    float
        Zero for fewer than two values: a chapter without chance.
    """
    if len(values) < 2:  # a deviation takes two
        return 0.0
    quantile = float(student.ppf(0.975, len(values) - 1))
    return quantile * math.sqrt(2) * statistics.stdev(values)


def rows_of(assumptions: Assumptions, study: Study, chapter: str) -> list[Row]:
    """Return what the study has of a chapter, the largest changes first.

    Parameters
    ----------
    assumptions : Assumptions
    study : Study
    chapter : str
        Two digits.
    """
    rows = [
        Row(entry, set_, run, tuple(_effects(assumptions, study, run)), _flipped(study, run))
        for entry, set_, run in _reruns(assumptions, study, chapter)
    ]
    return sorted(rows, key=lambda row: -row.size)


def _reruns(
    assumptions: Assumptions, study: Study, chapter: str
) -> Iterator[tuple[Assumption, str, Run | None]]:
    for entry in assumptions.assumptions:
        for other in entry.alternatives:
            if chapter in other.chapters:
                yield entry, other.set, study.run(chapter, f"{entry.id}/{other.id}")
        if chapter in entry.seeds:
            for run in study.seeds(chapter):
                if run.id != BASELINE:
                    yield entry, f"seed {run.parameters['seed']}", run


def _effects(assumptions: Assumptions, study: Study, run: Run | None) -> Iterator[Effect]:
    if run is None:
        return
    unchanged = study.seeds(run.chapter)
    baseline = study.run(run.chapter, BASELINE)
    for headline in assumptions.of_chapter(run.chapter):
        if baseline and headline.key in baseline.headlines and headline.key in run.headlines:
            values = [r.headlines[headline.key] for r in unchanged if headline.key in r.headlines]
            yield Effect(
                headline,
                baseline.headlines[headline.key],
                run.headlines[headline.key],
                band_of(values),
            )


def _flipped(study: Study, run: Run | None) -> dict[str, str]:
    if run is None or run.failed is not None:
        return {}
    unchanged = study.seeds(run.chapter)
    return {
        claim: verdict
        for claim, verdict in run.verdicts.items()
        if unchanged and all(other.verdicts.get(claim) != verdict for other in unchanged)
    }


@dataclass(frozen=True)
class Reading:
    """What another reading gives that a chapter computes in each build.

    Attributes
    ----------
    entry : Assumption
    within : Within
    says : str
        What is compared.
    before, after : float
        With the choice of the chapter, and with the other reading.
    turns : bool
        Whether a headline comes to lie where its conclusion is another one.
    """

    entry: Assumption
    within: Within
    says: str
    before: float
    after: float
    turns: bool

    @property
    def change(self) -> float:
        """The change as a share of the value with the choice of the chapter."""
        return self.after / self.before - 1


def readings_of(assumptions: Assumptions, results: Mapping[str, Results]) -> list[Reading]:
    """Return the readings that the chapters compute, from the results of a build.

    Parameters
    ----------
    assumptions : Assumptions
    results : mapping of str to Results
        By chapter.

    Raises
    ------
    InswsnError
        If the results lack a quantity.
    """
    readings = []
    for entry in assumptions.assumptions:
        for within in entry.within:
            of = results[within.chapter]
            after = quotient(of, within.quantity, within.over)
            if within.headline is not None:
                headline = assumptions.headline(within.chapter, within.headline)
                effect = Effect(headline, headline.value(of), after, 0.0)
                says, before, turns = headline.says, effect.before, effect.turns
            else:
                assert within.against is not None
                assert within.says is not None
                says, before, turns = within.says, quotient(of, within.against, None), False
            readings.append(Reading(entry, within, says, before, after, turns))
    return readings
