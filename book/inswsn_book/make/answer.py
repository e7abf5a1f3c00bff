"""What a run with other parameters answers: the findings of the chapter, then and now."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from inswsn_book.judge.claims import plain
from inswsn_book.judge.ledger import LEDGER, Claim, QuantityCheck, claims_of, load_claims
from inswsn_book.judge.verdicts import verdicts
from inswsn_book.make.chapters import (
    COMPARISON,
    REPORT,
    chapter_with,
    gather_parameters,
    own_data,
    parameters_in,
    run_chapter,
)
from inswsn_book.record.notebooks import read_notebook
from inswsn_book.record.parameters import Schema, Value
from inswsn_book.record.progress import Progress
from inswsn_book.record.project import Chapter, Project
from inswsn_book.record.provenance import edited
from inswsn_book.record.results import Quantity, Results
from inswsn_book.run.assumptions import ASSUMPTIONS, Headline, load_assumptions, quick_request
from inswsn_book.run.compare import (
    compare_conditions,
    comparison,
    flipped_verdicts,
    pair_quantities,
)
from inswsn_book.run.cores import asked_schema
from inswsn_book.run.part import Part, alone
from inswsn_book.run.store import Request, reference_results
from inswsn_lib.errors import Described, InswsnError, ParameterError
from inswsn_lib.files import read_text

#: The most findings that are told, and the most characters of a line
MOST, WIDTH = 8, 160
#: Seconds of a published run from which a quick one is offered
LONG = 60
# where the page of a run is, without --html and with it
_PAGE = ("page with --html, ", "page html/chapters/{}.html, ")
_ZERO = 1e-5  # per cent that are told as none: less than a solver's accuracy


def ask(
    project: Project,
    name: str,
    settings: Sequence[str],
    file: Path | None,
    *,
    quick: bool,
    only: str | None = None,
    **how: Any,
) -> Iterator[str]:
    """Run a chapter, or the evidence of a lesson, as a user asks; say what comes of it.

    Of a chapter `only` what has that name, see `inswsn_book.run.part`, with what it needs.
    """
    asked = project.find(name)
    names = [setting.partition("=")[0] for setting in settings]
    every = [*names, *(parameters_in(file) if file else ())]
    chapter = chapter_with(project, asked, every, quick=quick or only is not None)
    if chapter != asked:
        why = "the findings" if quick or only else "this parameter"
        yield f"{asked.id} passes this on to its evidence, {chapter.id}, which has {why}."
    schema = asked_schema(project.root, chapter, every)
    values = gather_parameters(schema, settings, file, project.root / "data")
    before, request = reference_results(project, chapter.id), Request(chapter.id, values)
    every_claim = load_claims(project.root / LEDGER)
    claims = claims_of(every_claim, chapter.id)
    part: Part | None = None
    if only is not None:
        other = "--quick, which runs no cell" if quick else "--html, which needs all cells"
        if quick or how["html"]:
            raise ParameterError("--only", Described(f"with {other}"), "given without it")
        _refuse_elsewhere(every_claim, only, chapter.id)
        published = published_cells(chapter)
        source = read_text(chapter.source)
        part = alone(source, chapter.id, only, before.cells, claims, published)
        request = replace(request, overlay={f"chapters/{chapter.name}.md": part.source})
    if quick:
        request = quick_request(project.root, chapter, values)
        if request.core and how["html"]:
            other = "with --quick, which executes no page"
            raise ParameterError("--html", Described(other), "given without it")
    elif only is None and before.provenance and before.provenance.seconds > LONG:
        yield (
            f"The published run took {before.provenance.seconds:.0f} s. --quick computes findings "
            "alone, by fewer runs and so less surely, and judges no sentence and no verdict."
        )
    known, changed = (project.root / ASSUMPTIONS).is_file(), edited(project.root)
    headlines = load_assumptions(project.root).of_chapter(chapter.id) if known else []

    def tell(results: Results, folder: Path) -> tuple[list[str], list[str]]:
        took = results.provenance.seconds if results.provenance else 0
        asked = question(chapter.id, schema, values, changed)
        if request.core:
            runs = [max(q.runs for q in r.quantities) for r in (results, before)]
            lines = [asked, *of_core(headlines, before, results)]
            by = f", with up to {runs[0]} runs (published: {runs[1]})" if runs[0] > 1 else ""
            said = f"It took {took:.0f} s{by}."
            return [*lines, f"{said} Sentences and verdicts are judged without --quick."], []
        if part is not None:
            lines = [
                asked,
                *of_part(part.quantities, before, results, claims),
                places(folder, chapter.name, took),
            ]
            return lines, comparison(part_of(before, results), results, claims)
        lines = [
            asked,
            *findings(headlines, before, results),
            *differences(before, results, claims),
            places(folder, chapter.name, took, _PAGE[how["html"]]),
        ]
        return lines, comparison(before, results, claims)

    with Progress() as progress:
        folder, lines = run_chapter(
            project, request, progress, tell, only=only, changed=changed, **how
        )
    report = folder / REPORT
    if report.is_file() and own_data(schema, values):
        lines = [f"The run is in {folder}", report.read_text(encoding="utf-8").rstrip()]
    yield from lines


def published_cells(chapter: Chapter) -> dict[int, str]:
    """Return the code of a chapter's cells as it was published, by place: that of its twin."""
    twin = chapter.source.with_suffix(".ipynb")
    cells = read_notebook(read_text(twin)).cells if twin.is_file() else []
    numbered = [(cell.id.rpartition("-")[2], cell) for cell in cells if cell.cell_type == "code"]
    return {int(number): cell.source for number, cell in numbered if number.isdecimal()}


def _refuse_elsewhere(claims: Iterable[Claim], name: str, chapter: str) -> None:
    """Refuse a claim that another chapter decides, or none."""
    for claim in claims:
        if claim.id == name and claim.chapter != chapter:
            by = f"chapter {claim.chapter} decides it" if claim.chapter else "it cannot be tested"
            raise ParameterError("--only", name, f"a claim that {chapter} decides; {by}")


def question(
    chapter: str, schema: Schema, values: Mapping[str, Value], changed: Sequence[str] = ()
) -> str:
    """Return what was asked: the chapter, each value beside the published one, and edited files."""
    asked = [
        f"{name} = {value}{unit_of(schema[name].unit)} (published: {schema[name].default})"
        for name, value in values.items()
    ]
    edits = _listed(", edited", changed).rstrip(".") if changed else ""
    return f"{chapter} with {', '.join(asked) or 'its published parameters'}{edits}:"


def findings(headlines: Sequence[Headline], before: Results, after: Results) -> list[str]:
    """Return a line for each finding of a chapter, as published and now.

    They are its headlines; of a chapter that has none the quantities that have changed.
    """
    lines = []
    for headline in headlines:
        words, percent = plain(headline.says).removesuffix(", %"), headline.says.endswith(", %")
        if headline.over:
            unit = ""
            ends: list[tuple[float, float] | None] = [None, None]
        else:
            quantities = [{q.name: q for q in r.quantities} for r in (before, after)]
            found = [each.get(headline.quantity) for each in quantities]
            ends = [q.interval if q else None for q in found]
            unit = "%" if percent else found[0].unit if found[0] else ""
        try:
            values = [headline.value(results) for results in (before, after)]
        except (InswsnError, ZeroDivisionError):
            lines.append(f"- {words}: not computed in this run")
            continue
        then, now = (_said(v, e, unit) for v, e in zip(values, ends, strict=True))
        lines.append(f"- {words}: {then} -> {now}{_turned(headline.turns, values, ends[1])}")
    return lines or moved(before, after)


def moved(before: Results, after: Results, first: Collection[str] = ()) -> list[str]:
    """Return a line for each number that moves by more than its tolerance, some of them first."""
    pairs = [pair for pair in pair_quantities(before, after) if pair.beyond_tolerance]
    pairs = [pair for pair in pairs if value_of(pair.before) != value_of(pair.after)]
    pairs.sort(key=lambda pair: pair.name not in first)
    lines = []
    for pair in pairs[:MOST]:
        what = pair.after or pair.before
        said = f"{pair.name} ({what.how.rstrip('.')})" if what else pair.name
        lines.append(f"- {said}: {value_of(pair.before)} -> {value_of(pair.after)}")
    if len(pairs) > MOST:
        lines.append(f"- and {len(pairs) - MOST} more numbers, which {COMPARISON} has")
    return lines or ["- No number of this chapter moves by more than its tolerance."]


def of_core(headlines: Sequence[Headline], before: Results, after: Results) -> list[str]:
    """Return a line for each finding of a core: as published, by all runs, and now."""
    then, now = ({q.name: q for q in each.quantities} for each in (before, after))
    both = [name for name in now if name in then]
    said = [h for h in headlines if {h.quantity, h.over or h.quantity} <= set(both)]
    others = [name for name in both if name not in {h.key for h in said}]
    return findings(said, before, after) + [
        f"- {now[name].how.rstrip('.')}: {value_of(then[name])} -> {value_of(now[name])}"
        for name in others[: MOST - len(said)]
    ]


def part_of(before: Results, after: Results) -> Results:
    """Return of a chapter's results what a part of it has computed again."""
    names = {quantity.name for quantity in after.quantities}
    kept = [quantity for quantity in before.quantities if quantity.name in names]
    update: dict[str, Any] = {"quantities": tuple(kept)}
    for field in ("sentences", "tables", "solvers", "data"):
        again = getattr(after, field)
        update[field] = {key: x for key, x in getattr(before, field).items() if key in again}
    return before.model_copy(update=update)


def of_part(
    names: Collection[str], before: Results, after: Results, claims: Sequence[Claim]
) -> list[str]:
    """Return what becomes of the claims that the quantities asked for decide, and what changed."""
    own = [c for c in claims if isinstance(c.check, QuantityCheck) and c.check.quantity in names]
    before = part_of(before, after)
    then, now = ({j.claim.id: j for j in verdicts(own, [each])} for each in (before, after))
    lines = []
    for claim in own:
        old, new = then[claim.id], now[claim.id]
        numbers = f"published {value_of(old.quantity)}, now {value_of(new.quantity)}"
        turned = ", as published" if old.verdict == new.verdict else f" (published: {old.words})"
        lines += [
            f"- {claim.id}: holds if {new.published_text}; {numbers}: {new.words}{turned}",
            *([f"  It assumes: {plain(claim.assumption)}"] if claim.assumption else []),
        ]
    made = {quantity.name for quantity in after.quantities}
    judged = [c for c in claims if isinstance(c.check, QuantityCheck) and c.check.quantity in made]
    cells = {after.cells.get(name) for name in names}
    near = [name for name, cell in after.cells.items() if cell in cells]
    told = {claim.check.quantity for claim in own if isinstance(claim.check, QuantityCheck)}
    rest = tuple(q for q in after.quantities if q.name not in told)
    others = after.model_copy(update={"quantities": rest})
    lines += moved(part_of(before, others), others, near) if rest else []
    return lines + differences(before, after, judged, " computed here")


def _turned(turns: float | None, values: Sequence[float], ends: tuple[float, float] | None) -> str:
    """Tell whether a conclusion is undecided or turned, at the value beyond which it is another."""
    if turns is not None and ends and ends[0] <= turns <= ends[1]:
        return f"; undecided, {turns:g} is in the interval"
    turned = turns is not None and (values[0] < turns) != (values[1] < turns)
    return f"; the conclusion turns at {turns:g}" if turned else ""


def differences(
    before: Results, after: Results, claims: Sequence[Claim], which: str = ""
) -> list[str]:
    """Return a line on sentences that are no longer true, and one on verdicts that flip."""
    untrue = [
        said.removeprefix("sentences: ").removesuffix(": True -> False")
        for said in compare_conditions(before, after)
        if said.startswith("sentences: ") and said.endswith(": True -> False")
    ]
    flips = [
        f"{claim.id} ({old.words if old else 'none'} -> {new.words if new else 'none'})"
        for claim, old, new in flipped_verdicts(claims, before, after)
    ]
    said = f"{len(untrue)} of {len(before.sentences)} sentences{which} are no longer true"
    told = f"{len(flips)} of {len(claims)} verdicts{which} differ"
    return [_listed(said, untrue), *([_listed(told, flips)] if claims else [])]


def places(folder: Path, name: str, seconds: float, page: str = "") -> str:
    """Return a line that tells how long it took, and where everything is."""
    return (
        f"It took {seconds:.0f} s. In {folder}: notebook {name.rpartition('/')[2]}.ipynb, "
        f"{page.format(name)}all that differs in {COMPARISON}."
    )


def _listed(said: str, entries: Sequence[str]) -> str:
    """Return a count with the entries behind it, as many as a line holds."""
    line = said
    for place, entry in enumerate(entries):
        longer = f"{line}{'; ' if place else ': '}{entry.rstrip('.')}"
        if len(longer) > WIDTH and place:
            return f"{line}; and {len(entries) - place} more."
        line = longer
    return f"{line}."


def value_of(quantity: Quantity | None) -> str:
    """Return a quantity in words: its value, unit and interval."""
    return "absent" if quantity is None else _said(quantity.value, quantity.interval, quantity.unit)


def _said(value: float, ends: tuple[float, float] | None, unit: str) -> str:
    within = f" ({ends[0]:.3g} to {ends[1]:.3g})" if ends else ""
    value = 0.0 if unit == "%" and abs(value) < _ZERO else value
    return f"{value:.3g}{unit_of(unit)}{within}"


def unit_of(unit: str) -> str:
    """Return a unit as it stands behind a number; nothing for a pure number."""
    return "" if unit in ("", "1") else f" {unit}"
