"""What a change of an assumption does to the headline results: differences, and what is chance."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from inswsn_book.judge.review import Findings
from inswsn_book.run.assumptions import Assumption, Assumptions, Headline, Within
from inswsn_book.show import svg_of
from matplotlib.ticker import LogLocator, NullLocator
from scipy.special import stdtrit
from study import BASELINE, Run, Study

from inswsn_lib.plotting import COLOURS, figure

#: From here on a change counts as one that moves a result, as a share of it.
MOVES = 0.1
_BARS = 6  # a panel of the figure
_WIDE = 5  # a panel that spans more has a logarithmic axis
_PLAIN = 2.0  # a change to this factor is written as one
_FINE = 10  # per cent, below which a change is written to a tenth


@dataclass(frozen=True)
class Effect:
    """What one rerun does to one headline, and how far chance reaches, see `band_of`."""

    headline: Headline
    before: float  # in the unchanged run
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
    def ratio(self) -> float | None:
        """The value after over the one before; None unless both are positive."""
        return self.after / self.before if self.before > 0 and self.after > 0 else None

    @property
    def turns(self) -> bool:
        """Whether the result comes to lie on the other side of where its conclusion turns."""
        edge = self.headline.turns
        return edge is not None and (self.before - edge) * (self.after - edge) < 0

    @property
    def turned(self) -> bool:
        """Whether the conclusion turns, beyond chance."""
        return self.turns and self.beyond


@dataclass(frozen=True)
class Row:
    """What one rerun does to all headlines of its chapter."""

    entry: Assumption
    set: str  # what was chosen instead
    run: Run | None  # None if it has not been made
    effects: tuple[Effect, ...]  # one for each headline that the rerun gives
    flipped: Mapping[str, str]  # by the id of a claim: its verdict, where no unchanged run has it

    @property
    def turned(self) -> list[Effect]:
        """The effects with which a conclusion turns."""
        return [effect for effect in self.effects if effect.turned]

    def effect(self, headline: Headline) -> Effect | None:
        """Return the effect on a headline; None if the rerun does not give it."""
        return next((effect for effect in self.effects if effect.headline == headline), None)

    @property
    def size(self) -> float:
        """The largest change beyond chance; zero if there is none."""
        return max((abs(effect.change) for effect in self.effects if effect.beyond), default=0.0)


def band_of(values: list[float]) -> float:
    """Return how far two runs may be from one another by chance, from some with seeds of their own.

    It is the 95 % interval of the difference of two draws from a normal distribution whose
    deviation is known from the values alone: Student's t for n - 1 degrees of freedom times the
    root of two times the sample deviation. A rerun has the seed of the unchanged run, so it differs
    from that by chance less than this.
    """
    if len(values) < 2:  # a deviation takes two
        return 0.0
    quantile = float(stdtrit(len(values) - 1, 0.975))
    return quantile * math.sqrt(2) * statistics.stdev(values)


def chance_band(study: Study, headline: Headline) -> float:
    """Return the band of a headline in the unchanged runs of its chapter."""
    values = [run.headlines.get(headline.key) for run in study.seeds(headline.chapter)]
    return band_of([value for value in values if value is not None])


def rows_of(assumptions: Assumptions, study: Study, chapter: str) -> list[Row]:
    """Return what the study has of a chapter, the largest changes first."""
    reruns: list[tuple[Assumption, str, Run | None]] = []
    for entry in assumptions.assumptions:
        for other in entry.alternatives:
            if chapter in other.chapters:
                reruns.append((entry, other.set, study.run(chapter, f"{entry.id}/{other.id}")))
        if chapter in entry.seeds:
            seeds = [run for run in study.seeds(chapter) if run.id != BASELINE]
            reruns += [(entry, f"seed {run.parameters['seed']}", run) for run in seeds]
    rows = [
        Row(entry, set_, run, tuple(_effects(assumptions, study, run)), _flipped(study, run))
        for entry, set_, run in reruns
    ]
    return sorted(rows, key=lambda row: -row.size)


def _effects(assumptions: Assumptions, study: Study, run: Run | None) -> Iterator[Effect]:
    baseline = study.run(run.chapter, BASELINE) if run else None
    if run is None or baseline is None:
        return
    for headline in assumptions.of_chapter(run.chapter):
        before, after = (r.headlines.get(headline.key) for r in (baseline, run))
        if before is not None and after is not None:
            yield Effect(headline, before, after, chance_band(study, headline))


def _flipped(study: Study, run: Run | None) -> dict[str, str]:
    unchanged = study.seeds(run.chapter) if run else []
    if run is None or run.failed is not None or not unchanged:
        return {}
    return {
        claim: verdict
        for claim, verdict in run.verdicts.items()
        if all(other.verdicts.get(claim) != verdict for other in unchanged)
    }


@dataclass(frozen=True)
class Reading:
    """What another reading gives that a chapter computes in each build."""

    entry: Assumption
    within: Within
    says: str  # what is compared
    before: float  # with the choice of the chapter
    after: float
    turns: bool  # whether a headline comes to lie where its conclusion is another one

    @property
    def change(self) -> float:
        """The change as a share of the value with the choice of the chapter."""
        return self.after / self.before - 1


def readings_of(assumptions: Assumptions, findings: Findings) -> list[Reading]:
    """Return the readings that the chapters compute, the largest changes first."""
    readings = []
    for entry in assumptions.assumptions:
        for within in entry.within:
            after, turns = findings.value(within), False
            if within.headline is not None:
                headline = assumptions.headline(within.chapter, within.headline)
                before, says = findings.value(headline), headline.says
                turns = Effect(headline, before, after, 0.0).turns
            else:
                before = findings.quotient(within.chapter, str(within.against))
                says = str(within.says)
            readings.append(Reading(entry, within, says, before, after, turns))
    return sorted(readings, key=lambda r: -abs(math.log(max(r.after, 1e-9) / r.before)))


def summarise(
    assumptions: Assumptions, tables: Mapping[str, Sequence[Row]], readings: Sequence[Reading]
) -> dict[str, Any]:
    """Return the reruns that were made and that failed, and ids of assumptions by what they do.

    Rows with another seed alone do not count.
    """
    reruns = [row for rows in tables.values() for row in rows if not row.entry.seeds]
    made = [row for row in reruns if row.run is not None]
    moving = {row.entry.id for row in made if any(e.moves for e in row.effects)}
    moving |= {reading.entry.id for reading in readings if abs(reading.change) > MOVES}
    turning = {row.entry.id for row in made if row.turned}
    turning |= {reading.entry.id for reading in readings if reading.turns}
    flipping = {row.entry.id for row in made if row.flipped}
    tried = {row.entry.id for row in made} | {reading.entry.id for reading in readings}
    waiting = {row.entry.id for row in reruns if row.run is None}
    never = {e.id for e in assumptions.assumptions if not (e.alternatives or e.within or e.seeds)}
    return {
        "made": made,
        "failed": [row for row in made if row.run is not None and row.run.failed is not None],
        "turning": turning,
        "moving": moving,
        "flipping": flipping,
        "still": tried - moving - turning - flipping - waiting,
        "untried": never,
        "waiting": waiting,
    }


def change_text(before: float, after: float) -> str:
    """Return a change: in per cent of the value before, or as a factor where it is large."""
    if before == after:
        return "0"
    if before == 0 or after / before < 0:
        return f"{before:.2g} → {after:.2g}"  # a change of sign has no per cent
    ratio = after / before
    if ratio >= _PLAIN:
        return f"× {ratio:,.3g}" if ratio < 1e4 else f"× {ratio:.1e}"
    percent = 100 * (ratio - 1)
    text = f"{percent:+.1f} %" if abs(percent) < _FINE else f"{percent:+.0f} %"
    return text.replace("-", "\N{MINUS SIGN}")


def page_of(assumptions: Assumptions, study: Study, findings: Findings) -> dict[str, Any]:
    """Return what the book's page shows of a study, as plain data: the rows and what follows."""
    tables = {c: rows_of(assumptions, study, c) for c in assumptions.reduced}
    readings = readings_of(assumptions, findings)
    came = summarise(assumptions, tables, readings)
    return {
        "moves": MOVES,
        "made": len(came.pop("made")),
        "failed": len(came.pop("failed")),
        "entries": {what: sorted(ids) for what, ids in came.items()},
        "tables": {c: _table(assumptions, study, c, rows) for c, rows in tables.items()},
        "readings": [
            {
                "id": r.entry.id, "set": r.within.reading, "chapter": r.within.chapter,
                "says": r.says, "before": r.before, "after": r.after,
                "text": change_text(r.before, r.after), "turned": r.turns,
            }
            for r in readings
        ],
        "panels": [
            {
                "chapter": panel[0][1].headline.chapter, "short": panel[0][1].headline.short,
                "bars": [{"name": name, "ratio": effect.ratio} for name, effect in panel],
            }
            for panel in panels_of(tables)
        ],
    }  # fmt: skip


def _table(
    assumptions: Assumptions, study: Study, chapter: str, rows: Sequence[Row]
) -> dict[str, Any]:
    baseline, headlines = study.run(chapter, BASELINE), assumptions.of_chapter(chapter)
    unchanged = [baseline.headlines.get(h.key) if baseline else None for h in headlines]
    bands = [chance_band(study, headline) for headline in headlines]
    return {
        "unchanged": unchanged,
        "chance": [band / abs(v) if v else None for band, v in zip(bands, unchanged, strict=True)],
        "rows": [
            {
                "id": row.entry.id, "set": row.set, "ran": row.run is not None,
                "failed": row.run.failed if row.run else None, "flipped": dict(row.flipped),
                "effects": [_cell(row.effect(headline)) for headline in headlines],
            }
            for row in rows
        ],
    }  # fmt: skip


def _cell(effect: Effect | None) -> dict[str, Any] | None:
    if effect is None:
        return None
    return {
        "before": effect.before, "after": effect.after, "beyond": effect.beyond,
        "text": change_text(effect.before, effect.after), "turned": effect.turned,
    }  # fmt: skip


def panels_of(tables: Mapping[str, Sequence[Row]]) -> list[list[tuple[str, Effect]]]:
    """Return for each chapter the largest effects on its first headline, by what was changed."""
    panels = []
    for rows in tables.values():
        found = [
            (f"{row.entry.id}, {row.set}", row.effects[0])
            for row in rows
            if row.effects and not row.entry.seeds and row.effects[0].ratio is not None
        ]
        found.sort(key=lambda item: -abs(math.log(item[1].ratio or 1.0)))
        if found:
            panels.append(found[:_BARS])
    return panels


def tornado_svg(panels: Sequence[Sequence[tuple[str, Effect]]]) -> str:
    """Draw by what factor the first headline of each chapter moves, as SVG."""
    count = max(len(panels), 1)
    fig, axes = figure(count, 1, height=1.75 * count + 0.3, squeeze=False)
    for ax, found in zip(axes[:, 0], panels, strict=False):
        first = found[0][1]
        ratios = [effect.ratio or 1.0 for _, effect in found]
        colours = [
            COLOURS["contradicted" if e.turned else "rebuilt" if e.beyond else "published"]
            for _, e in found
        ]
        places = range(len(found))[::-1]
        low, high = 1 - first.band / first.before, 1 + first.band / first.before
        if 0 < low < high:
            ax.axvspan(low, high, color=COLOURS["published"], alpha=0.15, lw=0)
        ax.barh(places, [r - 1 for r in ratios], left=1, color=colours, height=0.65)
        ax.axvline(1, color=COLOURS["published"], lw=1)
        if max(ratios) / min(ratios) > _WIDE:
            ax.set_xscale("log")
            ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            ax.xaxis.set_major_formatter("{x:g}")
            ax.xaxis.set_minor_locator(NullLocator())
        ax.set_yticks(places, [name for name, _ in found], fontsize=8.5)
        title = f"chapter {first.headline.chapter}, {first.headline.short}"
        ax.set_title(title, loc="left", fontsize=9.5)
        ax.grid(axis="y", visible=False)
    axes[-1, 0].set_xlabel("result over that of the unchanged run")
    return svg_of(fig)
