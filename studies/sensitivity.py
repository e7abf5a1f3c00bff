"""How much each headline result moves when an assumption changes, by reruns: `make studies`.

    python studies/sensitivity.py [--only P1-M-B] [--jobs 2]
    python studies/sensitivity.py --page

Runs the chapters again with one assumption of data/assumptions.yaml changed, everything else as
published but for fewer runs, and keeps what comes of it in data/sensitivity.json, from which the
book's page of assumptions is made. The unchanged chapters are run with the same settings and with
other seeds, which tells what is chance. It takes about an hour and a half of one core. It may be
stopped at any time: what has finished is in the store of runs and is not run again.

With --only the alternatives of one assumption are run and take their place in the file, whose
provenance then tells of the last run alone: good for a look, and the whole for keeps. With --page
nothing is run: what the page shows is computed again from the runs that are kept and from the
reference results.
"""

from __future__ import annotations

import argparse
import datetime
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from effects import page_of, panels_of, rows_of, tornado_svg
from inswsn_book.judge.ledger import LEDGER, claims_of, load_claims
from inswsn_book.judge.review import Findings
from inswsn_book.judge.verdicts import verdicts
from inswsn_book.record.files import file_digest, tree_digest, write_whole
from inswsn_book.record.parameters import Value
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import Project
from inswsn_book.record.provenance import machine_facts, repository_state
from inswsn_book.record.results import Results, read_results
from inswsn_book.run.assumptions import (
    ASSUMPTIONS,
    Alternative,
    Assumptions,
    Headline,
    load_assumptions,
    load_schemas,
    load_settings,
    without_sections,
)
from inswsn_book.run.cores import changed_scenario
from inswsn_book.run.store import Outcome, Request, Run as ChapterRun, request_key, run_all
from study import BASELINE, SENSITIVITY, Made, Run, Study, read_study

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import data_mirror
from inswsn_lib.scenario import Setting, load_scenario

ROOT = Path(__file__).parent.parent

#: The figure of the page, below the root of a checkout
FIGURE = "data/sensitivity.svg"


def write_study(study: Study, path: Path) -> None:
    """Write a study, whole or not at all."""
    write_whole(path, study.model_dump_json(indent=1) + "\n")


def with_page(project: Project, assumptions: Assumptions, study: Study) -> Study:
    """Return a study with what its page shows, by the reference results of the readings."""
    results = [read_results(path) for path in sorted(project.published.glob("*.json"))]
    page = page_of(assumptions, study, Findings(results, []))
    return study.model_copy(update={"page": page})


def merged(runs: Iterable[Run], before: Mapping[tuple[str, str], Run]) -> tuple[Run, ...]:
    """Return runs together with earlier ones that they do not replace."""
    together = dict(before) | {(run.chapter, run.id): run for run in runs}
    return tuple(together[key] for key in sorted(together))


@dataclass(frozen=True)
class Cell:
    """One run of the study that is to be made."""

    id: str  # ``"baseline"``, ``"seed-2"`` or such as ``"P1-M-B/small"``
    chapter: str  # two digits
    # all that differ from the published run
    parameters: dict[str, Value] = field(default_factory=dict)
    change: Alternative | None = None  # what is changed beside parameters
    skips: tuple[str, ...] = ()  # titles of sections of the chapter that are left out


def cells_of(assumptions: Assumptions, only: Iterable[str] = ()) -> list[Cell]:
    """Return the cells of the study, the unchanged runs of each chapter first."""
    wanted = set(only)
    missing = wanted - {entry.id for entry in assumptions.assumptions}
    if missing:
        raise InswsnError(f"There is no assumption {min(missing)}.")
    entries = [entry for entry in assumptions.assumptions if not wanted or entry.id in wanted]
    changed = [
        Cell(
            f"{entry.id}/{other.id}",
            chapter,
            assumptions.reduced[chapter].parameters | other.parameters.get(chapter, {}),
            other,
            assumptions.reduced[chapter].skips,
        )
        for entry in entries
        for other in entry.alternatives
        for chapter in other.chapters
    ]
    chapters = {cell.chapter for cell in changed} | {c for entry in entries for c in entry.seeds}
    unchanged = []
    for chapter, reduced in assumptions.reduced.items():
        if chapter in chapters:
            runs: dict[str, dict[str, Value]] = {BASELINE: {}}
            runs |= {f"seed-{seed}": {"seed": seed} for seed in reduced.seeds}
            unchanged += [
                Cell(name, chapter, reduced.parameters | chance, skips=reduced.skips)
                for name, chance in runs.items()
            ]
    return unchanged + changed


def request_of(project: Project, cell: Cell) -> Request:
    """Return the request of a cell."""
    overlay: dict[str, str] = {}
    if cell.change is not None:
        overlay |= _changed_scenarios(project.root, cell.change)
    chapter = project.by_id(cell.chapter)
    before = chapter.source.read_text(encoding="utf-8")
    after = before if cell.change is None else _edited(before, cell.chapter, cell.change)
    after = without_sections(after, cell.skips, chapter.source.name)
    if after != before:
        overlay[f"chapters/{chapter.name}.md"] = after
    return Request(cell.chapter, cell.parameters, overlay=overlay)


def _changed_scenarios(root: Path, change: Alternative) -> dict[str, str]:
    """Return the texts of the scenario files that an alternative changes, by their paths."""
    scenarios = {*change.files, *change.values, *change.factors}
    texts = {}
    for scenario in scenarios:
        file = change.files.get(scenario)
        values = dict(change.values.get(scenario, {}))
        for key, factor in change.factors.get(scenario, {}).items():
            settings = load_scenario(root / f"data/scenarios/{file or scenario}.yaml")
            values[key] = (np.asarray(settings[key].value) * factor).tolist()
        path, texts[path] = changed_scenario(root, scenario, values, file)
    return texts


def _edited(source: str, chapter: str, change: Alternative) -> str:
    for edit in change.edits:
        if edit.chapter != chapter:
            continue
        if source.count(edit.old) != 1:
            raise InswsnError(
                f"The passage that {change.id} replaces does not stand in chapter {chapter} "
                "exactly once."
            )
        source = source.replace(edit.old, edit.new)
    return source


def run_of(project: Project, cell: Cell, headlines: Iterable[Headline], outcome: Outcome) -> Run:
    """Return what came of a cell.

    A run that fails is a result: a design that is not feasible, or a scene that cannot be.
    """
    bare = Run(
        id=cell.id,
        chapter=cell.chapter,
        parameters=cell.parameters,
        seconds=0,
        key=request_key(project, request_of(project, cell)),
    )
    if not isinstance(outcome, ChapterRun):
        return bare.model_copy(update={"failed": plain_sentence(outcome)})
    results = outcome.results
    made = results.provenance
    return bare.model_copy(
        update={
            "headlines": _headlines(results, headlines),
            "verdicts": _verdicts(project, results),
            "overturned": sum(not held for held in results.sentences.values()),
            "seconds": made.seconds if made else 0,
        }
    )


def _headlines(results: Results, headlines: Iterable[Headline]) -> dict[str, float]:
    found = {}
    for headline in headlines:
        try:
            value = headline.value(results)
        except (InswsnError, ZeroDivisionError):
            continue
        if np.isfinite(value):
            found[headline.key] = value
    return found


def _verdicts(project: Project, results: Results) -> dict[str, str]:
    found = {}
    for claim in claims_of(load_claims(project.root / LEDGER), results.chapter):
        try:
            found[claim.id] = verdicts([claim], [results])[0].words
        except InswsnError:  # this run did not record what decides it
            continue
    return found


def plain_sentence(failure: BaseException) -> str:
    """Return the last line of a failure, without the colours of a terminal and folders."""
    plain = re.sub(r"\x1b\[[0-9;]*m", "", str(failure))
    plain = re.sub(r"/\S*/(?=(chapters|data)/)", "", plain)  # of the checkout or an overlay
    lines = [line.strip() for line in plain.splitlines() if line.strip()]
    return lines[-1][:300] if lines else "It ended without a word."


def problems_of(project: Project, assumptions: Assumptions) -> list[str]:
    """Return all in which the assumptions do not fit the checkout, a sentence each.

    Every setting of a scenario whose source is not the paper, and every parameter of a chapter, has
    an entry or a reason why it needs none; and what an entry names is there.
    """
    settings = load_settings(project.root)
    parameters = {number: set(s.defaults) for number, s in load_schemas(project).items()}
    return [
        *_names_that_are_nowhere(assumptions, settings, parameters),
        *_without_an_entry(assumptions, settings, parameters),
        *_edits_that_do_not_fit(project, assumptions),
    ]


def _names_that_are_nowhere(
    assumptions: Assumptions,
    settings: Mapping[str, Mapping[str, Setting]],
    parameters: Mapping[str, set[str]],
) -> Iterator[str]:
    for entry in assumptions.assumptions:
        named = [(c.scenario, c.setting) for c in entry.chosen if c.scenario and c.setting]
        set_ = [(c.chapter, c.parameter) for c in entry.chosen if c.chapter and c.parameter]
        for other in entry.alternatives:
            for by_scenario in (other.values, other.factors):
                named += [(s, key) for s, keys in by_scenario.items() for key in keys]
            set_ += [(c, key) for c, keys in other.parameters.items() for key in keys]
            for scenario, file in other.files.items():
                if scenario not in settings or file not in settings:
                    yield f"{entry.id}: there is no scenario {scenario} or {file}."
        for scenario, key in named:
            if key not in settings.get(scenario, {}):
                yield f"{entry.id}: the scenario {scenario} has no setting {key}."
        for chapter, key in set_:
            if key not in parameters.get(chapter, set()):
                yield f"{entry.id}: chapter {chapter} has no parameter {key}."


def _without_an_entry(
    assumptions: Assumptions,
    settings: Mapping[str, Mapping[str, Setting]],
    parameters: Mapping[str, set[str]],
) -> Iterator[str]:
    chosen = [choice for entry in assumptions.assumptions for choice in entry.chosen]
    covered = {(choice.scenario, choice.setting) for choice in chosen}
    # the fit to all cells has the same numbers, fitted otherwise
    covered |= {("p1-inertial-all-cells", key) for s, key in covered if s == "p1-inertial"}
    for scenario, keys in settings.items():
        for key, setting in keys.items():
            if setting.source != "paper" and (scenario, key) not in covered:
                yield f"The setting {key} of the scenario {scenario} has no entry."
    stand = {(choice.chapter, choice.parameter) for choice in chosen}
    for chapter, names in parameters.items():
        printed = set(assumptions.printed.get(chapter, {}))
        for name in sorted(printed - names):
            yield f"printed: chapter {chapter} has no parameter {name}."
        for name in sorted(names):
            entry, reason = (chapter, name) in stand, name in printed
            if entry and reason:
                yield (
                    f"The parameter {name} of chapter {chapter} has an entry and a reason for "
                    "having none."
                )
            elif not entry and not reason:
                yield f"The parameter {name} of chapter {chapter} has no entry."


def _edits_that_do_not_fit(project: Project, assumptions: Assumptions) -> Iterator[str]:
    sources = {c.id: c.source.read_text(encoding="utf-8") for c in project.chapters()}
    for entry in assumptions.assumptions:
        for other in entry.alternatives:
            for edit in other.edits:
                if sources.get(edit.chapter, "").count(edit.old) != 1:
                    yield (
                        f"{entry.id}/{other.id}: the passage that it replaces does not stand in "
                        f"chapter {edit.chapter} exactly once."
                    )


def made_from(project: Project, assumptions: Assumptions) -> Made:
    """Return what the study is made with."""
    machine = machine_facts()
    commit, clean = repository_state(project.root)
    return Made(
        version=project.about()["version"],  # that of the checkout
        day=datetime.datetime.now(datetime.UTC).date().isoformat(),
        commit=commit,
        clean=clean,
        sources={
            "library": project.computing_digest(),
            "locks": tree_digest(project.root, project.locks),
            "assumptions": file_digest(project.root / ASSUMPTIONS),
            **{
                f"chapter {chapter.id}": file_digest(chapter.source)
                for chapter in project.chapters()
                if chapter.id in assumptions.reduced
            },
        },
        recorded=data_mirror() is not None,
        python=machine["python"],
        system=machine["system"],
        cpu=machine["cpu"],
        packages=machine["packages"],
    )


def run_study(
    project: Project, assumptions: Assumptions, only: list[str], jobs: int | None
) -> list[Run]:
    """Run the cells of the study and return what came of them."""
    cells = cells_of(assumptions, only)
    runs: list[Run] = []
    with Quiet() as progress:

        def ended(place: int, outcome: Outcome) -> None:
            cell = cells[place]
            run = run_of(project, cell, assumptions.of_chapter(cell.chapter), outcome)
            runs.append(run)
            how = f"failed: {run.failed}" if run.failed else f"{run.seconds:.0f} s"
            progress.say(f"{len(runs)} of {len(cells)}: chapter {run.chapter}, {run.id}: {how}")

        requests = [request_of(project, cell) for cell in cells]
        run_all(project, requests, progress, ended, jobs=jobs)
    return runs


def main() -> None:
    """Run what is due and write the file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", action="append", default=[], metavar="ID")
    parser.add_argument("--jobs", type=int, default=1, help="chapters at once")
    parser.add_argument("--page", action="store_true", help="compute what the page shows again")
    given = parser.parse_args()
    project = Project(ROOT.resolve())
    try:
        assumptions = load_assumptions(project.root)
        problems = problems_of(project, assumptions)
        if problems:
            raise InswsnError("\n".join(problems))
        path = project.root / SENSITIVITY
        if given.page:
            study = read_study(path)
        else:
            made = made_from(project, assumptions)
            runs = run_study(project, assumptions, given.only, given.jobs)
            before = {(r.chapter, r.id): r for r in read_study(path).runs} if given.only else {}
            study = Study(made=made, runs=merged(runs, before))
        write_study(with_page(project, assumptions, study), path)
        panels = panels_of({c: rows_of(assumptions, study, c) for c in assumptions.reduced})
        write_whole(project.root / FIGURE, tornado_svg(panels))
    except InswsnError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
