"""The assumptions crossed, and not one at a time, on the cores with few runs: `make studies`.

    python studies/crossed.py [--jobs 2]
    python studies/crossed.py --into /tmp/look --trajectories 2 --base 8 --points 2 --sampled 8
    python studies/crossed.py --sample p3-vehicle --sample p2-fusion

Two steps for each chapter of `factors.CROSSED`. A screening by Morris tells which of all factors
are strong; then Sobol' indices of the strongest, those of the other factors as one group. So all
factors vary in all points, whose results are the headline results as distributions. Chapters of
`factors.SAMPLED` have no indices: a smaller sample tells the distributions of their results, and
with --sample those of other chapters anew, whose indices stay as they are kept. What comes of it is
kept in data/crossed.json and data/crossed.svg. The whole takes some hours of two cores, a sample
some minutes. It may be stopped at any time: what was found at a point is kept below _build and is
not computed again, for as long as neither the library nor what the study reads changes.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from crossed_figure import crossed_svg
from factors import CROSSED, EVERY, SAMPLED, Crossing, Factor, Point, load_crossing, reasons
from indices import Effect, Share, filled, morris_effects, morris_places, sobol_places, sobol_shares
from inswsn_book.record.files import text_digest, tree_digest, write_whole
from inswsn_book.record.project import Project
from inswsn_book.record.results import Finite, Frozen, read_results
from inswsn_book.run.assumptions import ASSUMPTIONS, Assumptions, Headline, load_assumptions
from points import RUNS, SEARCHED, TRIALS, Outputs, outputs_at, published_starts
from pydantic import Field
from scipy.stats import qmc
from sensitivity import made_from
from study import Made, read_kept

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError

ROOT = Path(__file__).parent.parent
#: Where the study is kept, below the root of a checkout, and its figure
CROSSED_FILE, FIGURE = "data/crossed.json", "data/crossed.svg"
#: How many factors have indices of their own
STRONGEST = 10
#: The group of all other factors
OTHERS = "others"
#: Quantiles of the distributions
QUANTILES = (0.025, 0.25, 0.5, 0.75, 0.975)
SEED = 2012
#: Points of a sample whose results are kept for a test
REPEATED = 16
_SCRIPTS = ("factors.py", "points.py")


class Spread(Frozen):
    """A headline result over all points of the Sobol' sample."""

    chosen: Finite  # at the point where everything is as chosen, with the same few runs
    published: Finite  # in the reference results
    quantiles: tuple[Finite, ...]
    turned: float | None  # share of the points at which the conclusion is not the published one
    failed: int  # points at which it could not be had


class Kept(Frozen):
    """One random point over all factors, for the test that computes it again."""

    places: tuple[float, ...]  # in the order of the factors
    values: tuple[Finite | None, ...]  # in the order of the results


class Varied(Frozen):
    """A factor, and what its ends are."""

    name: str
    chapters: tuple[str, ...]
    says: tuple[str, ...]
    sources: tuple[str, ...]  # the settings and parameters that it moves
    ends: tuple[Any, Any] | None  # of the first of them; None where it has words
    strength: Finite  # largest mean effect over the deviation of a result


class Row(Frozen):
    """One of the strongest factors, with the result of whose variance it has the largest share."""

    factor: str
    says: tuple[str, ...]
    result: str
    effect: Effect
    share: Share


class Sampled(Frozen):
    """Of which chapters ranges are of a sample of their own, and with what it was made."""

    made: Made
    hours: Annotated[float, Field(ge=0)]  # of a processor
    chapters: dict[str, tuple[str, ...]]  # the factors of each
    points: int
    starts: dict[str, tuple[float, ...]]
    kept: dict[str, tuple[Finite | None, ...]]  # the first results by name, in order of the points


class Crossed(Frozen):
    """What the file holds. Results are named ``"chapter headline"``."""

    schema_version: Literal[1] = 1
    made: Made
    hours: Annotated[float, Field(ge=0)]  # of a processor
    seed: int
    trajectories: int
    base: int
    runs: dict[str, dict[str, int]]  # of a point, by chapter
    trials: int
    searched: int
    starts: dict[str, tuple[float, ...]]  # from which filters are tuned at a point
    factors: tuple[Varied, ...]
    left_out: dict[str, str]
    screening: dict[str, dict[str, Effect]]  # by result and factor
    strongest: tuple[str, ...]
    shares: dict[str, dict[str, Share]]  # by result, and by factor or `OTHERS`
    rows: tuple[Row, ...]  # of the strongest, as the page shows them
    points: dict[str, int]  # of the Sobol' sample, by chapter
    spreads: dict[str, Spread]
    kept: tuple[Kept, ...]
    sampled: Sampled | None = None


def read_crossed(path: Path) -> Crossed:
    """Read the study; refuse a file that is none."""
    return read_kept(path, Crossed, "studies")


# Points ------------------------------------------------------------------------------------------


@dataclass
class Lab:
    """Computes what chapters give at points, on several processes, and keeps what was found.

    Attributes
    ----------
    root : Path
        Of the checkout.
    crossing : Crossing
        The factors.
    cache : Path
        A file with a line for each point that has been computed.
    jobs : int
        Processes.
    """

    root: Path
    crossing: Crossing
    cache: Path
    jobs: int
    starts: dict[str, list[float]] = field(default_factory=dict)
    found: dict[str, tuple[Outputs, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.cache.parent.mkdir(parents=True, exist_ok=True)
        lines = self.cache.read_text(encoding="utf-8").splitlines() if self.cache.exists() else []
        for line in lines:
            try:
                key, outputs, seconds = json.loads(line)
            except ValueError:  # the last line of a study that was stopped
                continue
            self.found[key] = (outputs, seconds)
        if "starts" not in self.found:
            began = time.process_time()
            self._keep("starts", published_starts(), time.process_time() - began)
        self.starts = dict(self.found["starts"][0])  # type: ignore[arg-type]

    @property
    def seconds(self) -> float:
        """What all points took, of a processor."""
        return sum(seconds for _, seconds in self.found.values())

    def compute(self, chapter: str, points: Sequence[Point]) -> list[Outputs]:
        """Return what a chapter gives at points."""
        own = [factor.name for factor in self.crossing.of_chapter(chapter)]
        keys = [_key(chapter, [point[name] for name in own]) for point in points]
        due = {k: p for k, p in zip(keys, points, strict=True) if k not in self.found}
        tasks = [(key, chapter, dict(point)) for key, point in due.items()]
        if tasks:
            context = multiprocessing.get_context("spawn")
            with context.Pool(self.jobs, _prepare, (self.root, self.starts)) as pool:
                for count, (key, outputs, seconds) in enumerate(
                    pool.imap_unordered(_compute, tasks), 1
                ):
                    self._keep(key, outputs, seconds)
                    if count % 50 == 0 or count == len(tasks):
                        print(f"chapter {chapter}: {count} of {len(tasks)} points", flush=True)
        return [self.found[key][0] for key in keys]

    def _keep(self, key: str, outputs: Any, seconds: float) -> None:
        self.found[key] = (outputs, seconds)
        with self.cache.open("a", encoding="utf-8") as file:
            file.write(json.dumps([key, outputs, seconds]) + "\n")


def _key(chapter: str, places: Iterable[float]) -> str:
    return " ".join([chapter, *(f"{place:g}" for place in places)])


_here: dict[str, Any] = {}  # of a process of the pool


def _prepare(root: Path, starts: Mapping[str, Sequence[float]]) -> None:
    _here.update(crossing=load_crossing(Project(root), EVERY), starts=starts)


def _compute(task: tuple[str, str, Point]) -> tuple[str, Outputs, float]:
    key, chapter, point = task
    began = time.process_time()
    outputs = outputs_at(_here["crossing"], _here["starts"], chapter, point)
    return key, outputs, time.process_time() - began


def column(found: Sequence[Outputs], key: str) -> Array:
    """Return one result at all points; NaN where it could not be had."""
    return np.array([outputs.get(key, np.nan) for outputs in found])


# The steps ---------------------------------------------------------------------------------------


def headlines_of(assumptions: Assumptions, outputs: Mapping[str, Outputs]) -> list[Headline]:
    """Return the headlines that the points give, by the results at the chosen point."""
    return [h for h in assumptions.headlines if h.key in outputs.get(h.chapter, {})]


def label(headline: Headline) -> str:
    """Return the name of a result in the file."""
    return f"{headline.chapter} {headline.key}"


def screen(
    lab: Lab, headlines: Iterable[Headline], trajectories: int
) -> tuple[dict[str, dict[str, Effect]], dict[str, float]]:
    """Return the effects of all factors on each result, and how strong each factor is.

    The strength is its mean effect over the deviation of the result, the largest of all results.
    """
    effects: dict[str, dict[str, Effect]] = {}
    strengths = {factor.name: 0.0 for factor in lab.crossing.factors}
    words = {factor.name for factor in lab.crossing.factors if not factor.numeric}
    for chapter in CROSSED:
        names = [factor.name for factor in lab.crossing.of_chapter(chapter)]
        places = morris_places(names, trajectories, SEED)
        found = lab.compute(
            chapter, [dict(zip(names, row.tolist(), strict=True)) for row in places]
        )
        for headline in headlines:
            if headline.chapter != chapter:
                continue
            values = column(found, headline.key)
            effects[label(headline)] = morris_effects(names, places, values, SEED, words)
            spread = float(np.std(filled(values))) or 1.0
            for name, effect in effects[label(headline)].items():
                strengths[name] = max(strengths[name], effect.mean / spread)
    return effects, strengths


def strongest_of(strengths: Mapping[str, float]) -> tuple[str, ...]:
    """Return the strongest factors, the strongest first."""
    return tuple(sorted(strengths, key=lambda name: -strengths[name])[:STRONGEST])


def share(
    lab: Lab, headlines: Iterable[Headline], strongest: Sequence[str], base: int
) -> tuple[dict[str, dict[str, Share]], dict[str, Array]]:
    """Return the shares of the variance of each result, and each result at all points."""
    shares, samples = {}, {}
    for chapter in CROSSED:
        names = [factor.name for factor in lab.crossing.of_chapter(chapter)]
        groups = [name if name in strongest else OTHERS for name in names]
        places = sobol_places(names, groups, base, SEED)
        found = lab.compute(
            chapter, [dict(zip(names, row.tolist(), strict=True)) for row in places]
        )
        for headline in headlines:
            if headline.chapter == chapter:
                name = label(headline)
                samples[name] = column(found, headline.key)
                shares[name] = sobol_shares(names, groups, samples[name], SEED)
    return shares, samples


def row_of(
    factor: Factor,
    effects: Mapping[str, Mapping[str, Effect]],
    shares: Mapping[str, Mapping[str, Share]],
) -> Row:
    """Return what the page shows of one of the strongest factors."""
    moved = [result for result, found in shares.items() if factor.name in found]
    result = max(moved, key=lambda name: shares[name][factor.name].total)
    return Row(
        factor=factor.name,
        says=factor.says,
        result=result,
        effect=effects[result][factor.name],
        share=shares[result][factor.name],
    )


def spread_of(headline: Headline, values: Array, chosen: float, published: float) -> Spread:
    """Return a result as a distribution."""
    there, turned = values[~np.isnan(values)], None
    if headline.turns is not None:
        turned = _short(float(np.mean((there < headline.turns) != (published < headline.turns))))
    return Spread(
        chosen=_short(chosen),
        published=_short(published),
        quantiles=tuple(_short(q) for q in np.quantile(there, QUANTILES)),
        turned=turned,
        failed=int(np.isnan(values).sum()),
    )


def places_of(names: Sequence[str], count: int) -> list[dict[str, float]]:
    """Return the points of a sample, those of Sobol's sequence: a power of two."""
    places = np.round(qmc.Sobol(len(names), rng=SEED).random(count), 6)
    return [dict(zip(names, row.tolist(), strict=True)) for row in places]


def sample(
    project: Project, lab: Lab, chapters: Sequence[str], count: int, made: Made
) -> tuple[Sampled, dict[str, Spread]]:
    """Return the ranges of the results of some chapters, from points that have no indices."""
    assumptions, factors, spreads, kept = load_assumptions(project.root), {}, {}, {}
    for chapter in chapters:
        names = factors[chapter] = tuple(f.name for f in lab.crossing.of_chapter(chapter))
        points = [lab.crossing.chosen(), *places_of(names, count)]
        chosen, *found = lab.compute(chapter, points)
        published = read_results(project.published / f"{chapter}.json")
        for h in headlines_of(assumptions, {chapter: chosen}):
            values = column(found, h.key)
            spreads[label(h)] = spread_of(h, values, chosen[h.key], h.value(published))
            kept[label(h)] = tuple(_exact(f.get(h.key)) for f in found[:REPEATED])
    took = sum(s for key, (_, s) in lab.found.items() if key.split()[0] in chapters)
    sampled = Sampled(
        made=made,
        hours=round(took / 3600, 3),
        chapters=factors,
        points=count,
        starts={name: tuple(numbers) for name, numbers in lab.starts.items()},
        kept=kept,
    )
    return sampled, spreads


def kept_points(lab: Lab, headlines: Sequence[Headline], count: int) -> tuple[Kept, ...]:
    """Return random points over all factors with all results."""
    names = [factor.name for factor in lab.crossing.factors]
    places = np.round(np.random.default_rng(SEED).random((count, len(names))), 6).tolist()
    points = [dict(zip(names, row, strict=True)) for row in places]
    found = {chapter: lab.compute(chapter, points) for chapter in CROSSED}
    return tuple(
        Kept(
            places=tuple(row),
            values=tuple(
                _exact(found[h.chapter][i].get(h.key)) for h in headlines
            ),
        )
        for i, row in enumerate(places)
    )  # fmt: skip


def _exact(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.9g}")


def _short(value: float) -> float:
    return float(f"{value:.5g}")


def varied(factor: Factor, strength: float) -> Varied:
    """Return what the file says of a factor."""
    key = next(iter(factor.levels[0]))
    ends = (factor.ends[0][key], factor.ends[1][key]) if factor.numeric else None
    return Varied(
        name=factor.name,
        chapters=factor.chapters,
        says=factor.says,
        sources=tuple(factor.levels[0]),
        ends=ends,
        strength=_short(strength),
    )


# The whole ---------------------------------------------------------------------------------------


def digests(project: Project) -> dict[str, str]:
    """Return what the study depends on, by digests."""
    scenarios = sorted((project.root / "data/scenarios").glob("*.yaml"))
    own = [project.root / "studies" / name for name in _SCRIPTS]
    return {
        "library": project.computing_digest(),
        "locks": tree_digest(project.root, project.locks),
        "assumptions": tree_digest(project.root, [project.root / ASSUMPTIONS, *scenarios]),
        "points": tree_digest(project.root, own),
    }


def open_lab(project: Project, chapters: tuple[str, ...], jobs: int) -> tuple[Lab, Made]:
    """Return what computes points of some chapters, and with what."""
    sources = digests(project)
    made = made_from(project, load_assumptions(project.root)).model_copy(
        update={"sources": sources}
    )
    state = text_digest(json.dumps(sources, sort_keys=True))[:16]
    cache = project.build / "crossed" / f"{state}.jsonl"
    return Lab(project.root, load_crossing(project, chapters), cache, jobs), made


def run_sample(project: Project, before: Crossed, given: argparse.Namespace) -> Crossed:
    """Return a study with the ranges of some chapters anew."""
    lab, made = open_lab(project, EVERY, given.jobs)
    sampled, spreads = sample(project, lab, given.sample, given.sampled, made)
    left_out = reasons(load_assumptions(project.root))
    found = {"sampled": sampled, "spreads": before.spreads | spreads, "runs": RUNS}
    return before.model_copy(update=found | {"left_out": left_out})


def run_crossed(project: Project, given: argparse.Namespace) -> Crossed:
    """Make the study."""
    trajectories, base, points = given.trajectories, given.base, given.points
    assumptions, (lab, made) = (
        load_assumptions(project.root),
        open_lab(project, CROSSED, given.jobs),
    )
    crossing = lab.crossing
    chosen = {chapter: lab.compute(chapter, [crossing.chosen()])[0] for chapter in CROSSED}
    headlines = headlines_of(assumptions, chosen)
    effects, strengths = screen(lab, headlines, trajectories)
    strongest = strongest_of(strengths)
    shares, samples = share(lab, headlines, strongest, base)
    kept = kept_points(lab, headlines, points)
    named = {factor.name: factor for factor in crossing.factors}
    reference = {c: read_results(project.published / f"{c}.json") for c in CROSSED}
    study = Crossed(
        made=made,
        hours=round(lab.seconds / 3600, 3),
        seed=SEED,
        trajectories=trajectories,
        base=base,
        runs=RUNS,
        trials=TRIALS,
        searched=SEARCHED,
        starts={name: tuple(numbers) for name, numbers in lab.starts.items()},
        factors=tuple(varied(factor, strengths[factor.name]) for factor in crossing.factors),
        left_out=reasons(assumptions),
        screening=effects,
        strongest=strongest,
        shares=shares,
        rows=tuple(row_of(named[name], effects, shares) for name in strongest),
        points={h.chapter: len(samples[label(h)]) for h in headlines},
        spreads={
            label(h): spread_of(
                h, samples[label(h)], chosen[h.chapter][h.key], h.value(reference[h.chapter])
            )
            for h in headlines
        },
        kept=kept,
    )
    given.sample = SAMPLED
    return run_sample(project, study, given)


def main() -> None:
    """Make the study and write its file and its figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--trajectories", type=int, default=20, help="of the screening")
    parser.add_argument("--base", type=int, default=256, help="of Sobol', a power of two")
    parser.add_argument("--points", type=int, default=40, help="that are kept for the test")
    parser.add_argument("--sample", action="append", choices=EVERY, help="its ranges alone, anew")
    parser.add_argument("--sampled", type=int, default=256, help="points of a sample")
    parser.add_argument("--into", type=Path, help="write into this folder, and not into data")
    given = parser.parse_args()
    # for the processes of the pool, which import numpy anew
    os.environ.update({f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")})
    project = Project(ROOT.resolve())
    folder = given.into or project.root / "data"
    try:
        if given.sample:
            study = run_sample(project, read_crossed(project.root / CROSSED_FILE), given)
        else:
            study = run_crossed(project, given)
    except InswsnError as error:
        sys.exit(str(error))
    headlines = {label(h): h for h in load_assumptions(project.root).headlines}
    write_whole(folder / Path(CROSSED_FILE).name, study.model_dump_json(indent=None) + "\n")
    write_whole(folder / Path(FIGURE).name, crossed_svg(study, headlines))


if __name__ == "__main__":
    main()
