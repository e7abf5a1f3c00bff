"""The texts of the page of assumptions: what is unsaid, what was chosen, and what a change does."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence

from matplotlib import pyplot as plt
from matplotlib.ticker import LogLocator, NullLocator

from inswsn_book.assumptions import (
    Assumption,
    Assumptions,
    Chosen,
    Headline,
    load_assumptions,
    load_settings,
)
from inswsn_book.effects import MOVES, Effect, Reading, Row, band_of, readings_of, rows_of
from inswsn_book.files import file_digest, tree_digest
from inswsn_book.ledger import LEDGER, PAPERS, Claim, load_claims
from inswsn_book.parameters import Schema, chapter_schema
from inswsn_book.project import Project
from inswsn_book.results import Results
from inswsn_book.study import BASELINE, SENSITIVITY, Run, Study, read_study
from inswsn_book.tables import list_table
from inswsn_lib.plotting import COLOURS, figure
from inswsn_lib.simulation import Setting

#: The file of the figure, below ``book/generated``
FIGURE = "assumptions-tornado.svg"

_BARS = 6  # a panel of the figure
_PLAIN = 2.0  # a change to this factor is written as one
_WIDE = 5  # a panel of the figure that spans more has a logarithmic axis
_FINE = 10  # per cent, below which a change is written to a tenth


def assumption_texts(project: Project, results: Sequence[Results]) -> dict[str, str]:
    """Return the texts that the page of assumptions includes, by the names of their files.

    Parameters
    ----------
    project : Project
        The checkout.
    results : sequence of Results
        What the chapters that are shown have recorded.

    Returns
    -------
    dict of str to str

    Raises
    ------
    InswsnError
        If the assumptions, the study or a scenario cannot be read, or the results lack a quantity.
    """
    assumptions = load_assumptions(project.root)
    study = read_study(project.root / SENSITIVITY)
    by_chapter = {result.chapter: result for result in results}
    tables = {chapter: rows_of(assumptions, study, chapter) for chapter in assumptions.reduced}
    readings = readings_of(assumptions, by_chapter)
    return {
        **{
            f"assumptions-{paper.lower()}.md": unsaid_list(project, assumptions, paper)
            for paper in PAPERS
        },
        "assumptions-headlines.md": headlines_table(assumptions, by_chapter),
        "assumptions-summary.md": summary(assumptions, tables, readings),
        "assumptions-verdicts.md": verdicts_list(load_claims(project.root / LEDGER), tables),
        "assumptions-reruns.md": "\n".join(
            rerun_table(assumptions, study, chapter, rows) for chapter, rows in tables.items()
        ),
        "assumptions-readings.md": readings_table(readings),
        "assumptions-study.md": study_note(project, assumptions, study),
        "assumptions-figure.md": figure_text(tables),
        FIGURE: figure_svg(tables),
    }


def link(entry: Assumption) -> str:
    """Return a link to an entry."""
    return f"[{entry.id}](#{entry.anchor})"


def chapter_link(chapter: str) -> str:
    """Return a link to a chapter."""
    return f"{{ref}}`chapter {chapter} <chapter-{chapter}>`"


# What is unsaid, and what was chosen


def unsaid_list(project: Project, assumptions: Assumptions, paper: str) -> str:
    """Return what a paper leaves unsaid, each with the choices and their reasons in a table.

    Parameters
    ----------
    project : Project
        The checkout, from whose scenarios and chapters the values are read.
    assumptions : Assumptions
    paper : {"P1", "P2", "P3"}
    """
    settings = load_settings(project.root)
    schemas = {chapter: chapter_schema(project.root, chapter) for chapter in assumptions.reduced}
    blocks = []
    for entry in assumptions.assumptions:
        if entry.paper == paper:
            choices = [_choice(choice, entry, settings, schemas) for choice in entry.chosen]
            blocks.append(_entry_text(entry) + "\n" + _choices_table(choices))
    return "\n".join(blocks)


def _entry_text(entry: Assumption) -> str:
    """Return what is unsaid, where one would look, what bounds it, and how it is varied."""
    lines = [
        f"({entry.anchor})=",
        f"**{link(entry)}** {entry.unsaid}",
        "",
        f"*One would look in* {entry.place}. *What the print says of it:* {entry.bounds}",
        "",
    ]
    if entry.alternatives:
        reruns = " ".join(f"*{other.set}*: {other.why}" for other in entry.alternatives)
        lines += [f"Reruns with {reruns}", ""]
    if entry.varied:
        lines += [f"Reruns: {entry.varied}", ""]
    return "\n".join(lines)


def _choices_table(choices: Sequence[Sequence[str]]) -> str:
    head = ("chosen", "source", "why")
    return list_table("", "", [head, *choices], widths="34 12 54", style="assumptions")


def _choice(
    choice: Chosen,
    entry: Assumption,
    settings: Mapping[str, Mapping[str, Setting]],
    schemas: Mapping[str, Schema],
) -> list[str]:
    """Return what was chosen, its source and the reason for it."""
    if choice.text is not None:
        return [choice.text, "assumed", entry.why or ""]
    if choice.scenario is not None:
        assert choice.setting is not None
        setting = settings[choice.scenario][choice.setting]
        value = _quantity(setting.value, setting.unit)
        return [f"`{choice.setting}` = {value}", setting.source, setting.why]
    assert choice.chapter is not None
    assert choice.parameter is not None
    parameter = schemas[choice.chapter][choice.parameter]
    value = _quantity(parameter.default, parameter.unit)
    where = f"`{choice.parameter}` = {value}, {chapter_link(choice.chapter)}"
    worded = any(other.text for other in entry.chosen)
    reason = "" if worded or entry.why is None else f" {entry.why}"
    return [where, "parameter", parameter.meaning + reason]


def _quantity(value: object, unit: str) -> str:
    return _plain(value) + ("" if unit == "1" else f" {unit}")


def _plain(value: object) -> str:
    if isinstance(value, list):
        return f"({', '.join(map(_plain, value))})"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


# What the study watches


def headlines_table(assumptions: Assumptions, results: Mapping[str, Results]) -> str:
    """Return the table of the results that the study watches, with their values in this build."""
    rows = [["chapter", "short", "result", "in this build", "turns at"]]
    for headline in assumptions.headlines:
        value = headline.value(results[headline.chapter])
        edge = "–" if headline.turns is None else f"{headline.turns:g}"
        chapter = f"{{ref}}`{headline.chapter} <chapter-{headline.chapter}>`"
        rows.append([chapter, headline.short, headline.says, f"{value:.3g}", edge])
    return list_table(
        "The results that the study watches. Beyond the last column a conclusion would be another "
        "one.",
        "tbl-assumptions-headlines",
        rows,
    )


# What reruns do


def rerun_table(assumptions: Assumptions, study: Study, chapter: str, rows: Sequence[Row]) -> str:
    """Return the table of a chapter's reruns: by how much each headline moves.

    Parameters
    ----------
    assumptions : Assumptions
    study : Study
    chapter : str
    rows : sequence of Row
        From `rows_of`.
    """
    headlines = assumptions.of_chapter(chapter)
    baseline = study.run(chapter, BASELINE)
    head = ["changed", "to", *(h.short for h in headlines), "verdicts"]
    table = [head]
    if baseline is not None:
        values = [f"{baseline.headlines[h.key]:.3g}" if h.key in baseline.headlines else "–"
                  for h in headlines]  # fmt: skip
        table.append(["*unchanged*", "", *values, ""])
        table.append(["*chance*", "", *(_chance(study, baseline, h) for h in headlines), ""])
    table += [_rerun_cells(row, headlines) for row in rows]
    return list_table(
        f"Chapter {chapter}: change of each result when one assumption changes. Bold: beyond what "
        "another seed does. ⇄: with it the conclusion turns. Last column: verdicts that no "
        "unchanged run has.",
        f"tbl-assumptions-{chapter}",
        table,
        style="assumptions",
    )


def _chance(study: Study, baseline: Run, headline: Headline) -> str:
    """Return the band of chance in per cent of the unchanged value."""
    values = [run.headlines.get(headline.key) for run in study.seeds(baseline.chapter)]
    band = band_of([value for value in values if value is not None])
    value = baseline.headlines.get(headline.key)
    return f"±\N{NO-BREAK SPACE}{100 * band / abs(value):.2g}\N{NO-BREAK SPACE}%" if value else "–"


def _rerun_cells(row: Row, headlines: Sequence[Headline]) -> list[str]:
    if row.run is None:
        return [link(row.entry), row.set, *("not run" for _ in headlines), ""]
    if row.run.failed is not None:
        return [link(row.entry), f"{row.set}: {row.run.failed}", *("–" for _ in headlines), ""]
    found = {effect.headline: effect for effect in row.effects}
    cells = [_shown(found[h]) if h in found else "–" for h in headlines]
    return [link(row.entry), row.set, *cells, str(len(row.flipped) or "")]


def _shown(effect: Effect) -> str:
    text = change_text(effect.before, effect.after)
    if effect.beyond:
        text = f"**{text}**"
    text = f"{text} ⇄" if effect.turns and effect.beyond else text
    return text.replace(" ", "\N{NO-BREAK SPACE}")


def change_text(before: float, after: float) -> str:
    """Return a change in words: in per cent of the value before, or as a factor where it is large.

    Parameters
    ----------
    before, after : float
    """
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


def readings_table(readings: Sequence[Reading]) -> str:
    """Return the table of the readings that the chapters compute in each build."""
    rows = [["changed", "to", "result", "from", "to", "change"]]
    for reading in sorted(readings, key=lambda r: -abs(math.log(max(r.after, 1e-9) / r.before))):
        change = change_text(reading.before, reading.after) + (" ⇄" if reading.turns else "")
        rows.append(
            [link(reading.entry), reading.within.reading,
             f"chapter {reading.within.chapter}: {reading.says}",
             f"{reading.before:.3g}", f"{reading.after:.3g}", change]
        )  # fmt: skip
    return list_table(
        "Other readings that the chapters compute in this build, with all runs.",
        "tbl-assumptions-readings",
        rows,
        style="assumptions",
    )


# What follows


def summary(
    assumptions: Assumptions, tables: Mapping[str, Sequence[Row]], readings: Sequence[Reading]
) -> str:
    """Return what the tables say, in sentences that are computed from them.

    Parameters
    ----------
    assumptions : Assumptions
    tables : mapping of str to sequence of Row
        By chapter.
    readings : sequence of Reading
    """
    reruns = [row for rows in tables.values() for row in rows if not row.entry.seeds]
    made = [row for row in reruns if row.run is not None]
    failed = [row for row in made if row.run is not None and row.run.failed is not None]
    counts = ", ".join(
        f"{sum(entry.paper == paper for entry in assumptions.assumptions)} by {paper}"
        for paper in PAPERS
    )
    moving = {row.entry.id for row in made if any(e.moves for e in row.effects)}
    moving |= {reading.entry.id for reading in readings if abs(reading.change) > MOVES}
    turning = {row.entry.id for row in made if any(e.turns and e.beyond for e in row.effects)}
    turning |= {reading.entry.id for reading in readings if reading.turns}
    flipping = {row.entry.id for row in made if row.flipped}
    tried = {row.entry.id for row in made} | {reading.entry.id for reading in readings}
    waiting = {row.entry.id for row in reruns if row.run is None}
    still = tried - moving - turning - flipping - waiting
    untried = [
        entry
        for entry in assumptions.assumptions
        if not (entry.alternatives or entry.within or entry.seeds)
    ]
    lines = [
        f"The papers leave {len(assumptions.assumptions)} things unsaid that this book had to "
        f"settle: {counts}. {len(made)} reruns with one of them changed were made"
        + (f"; {len(failed)} failed, which the tables tell" if failed else "")
        + f", and {len(readings)} other readings are computed by the chapters themselves.",
        "",
        f"- **A conclusion turns** with {_named(assumptions, turning)}.",
        f"- **A result moves by more than {100 * MOVES:.0f} %**, beyond chance, with "
        f"{_named(assumptions, moving)}.",
        f"- **A verdict is another one**, which no unchanged run has, with "
        f"{_named(assumptions, flipping)}.",
        f"- **None of these** with {_named(assumptions, still)}.",
    ]
    if untried:
        names = _named(assumptions, {entry.id for entry in untried})
        lines.append(f"- **Neither rerun nor reading varies** {names}; the entries say why.")
    if waiting:
        names = _named(assumptions, waiting)
        lines.append(f"- **Not all reruns have been made yet** of {names}.")
    turned = [
        f"{link(row.entry)}, {row.set}: {effect.headline.says} "
        f"(chapter {effect.headline.chapter}), {effect.before:.3g} → {effect.after:.3g}"
        for row in made
        for effect in row.effects
        if effect.turns and effect.beyond
    ] + [
        f"{link(reading.entry)}, {reading.within.reading}: {reading.says} "
        f"(chapter {reading.within.chapter}), {reading.before:.3g} → {reading.after:.3g}"
        for reading in readings
        if reading.turns
    ]
    if turned:
        lines += ["", "The conclusions that turn:", "", *(f"- {line}." for line in turned)]
    return "\n".join(lines) + "\n"


def verdicts_list(claims: Sequence[Claim], tables: Mapping[str, Sequence[Row]]) -> str:
    """Return the verdicts that a rerun changes and no unchanged run does, as a folded list.

    Parameters
    ----------
    claims : sequence of Claim
        The ledger.
    tables : mapping of str to sequence of Row
        By chapter.
    """
    anchors = {claim.id: claim.anchor for claim in claims}
    lines = []
    for chapter, rows in tables.items():
        for row in rows:
            if row.flipped and not row.entry.seeds:
                told = "; ".join(
                    f"[{claim}](#{anchors[claim]}) {verdict}"
                    if claim in anchors
                    else f"{claim} {verdict}"
                    for claim, verdict in row.flipped.items()
                )
                lines.append(f"- {link(row.entry)}, {row.set}, chapter {chapter}: {told}.")
    if not lines:
        return "No rerun gives a verdict that no unchanged run gives.\n"
    count = sum(len(row.flipped) for rows in tables.values() for row in rows if not row.entry.seeds)
    return "\n".join([f":::{{dropdown}} The {count} verdicts that change", *lines, ":::", ""])


def _named(assumptions: Assumptions, ids: set[str]) -> str:
    """Return links to entries in their order, or that there is none."""
    links = [link(entry) for entry in assumptions.assumptions if entry.id in ids]
    return ", ".join(links) if links else "none of the alternatives tried"


def study_note(project: Project, assumptions: Assumptions, study: Study) -> str:
    """Return how the study was made, and what has changed since.

    Parameters
    ----------
    project : Project
    assumptions : Assumptions
    study : Study
    """
    made = study.made
    state = {None: "", True: ", without changes", False: ", with changes that were not committed"}
    commit = "an unknown commit" if made.commit is None else f"commit `{made.commit[:12]}`"
    seconds = sum(run.seconds for run in study.runs)
    lines = [
        f"The study was made on {made.day} with inswsn {made.version} at {commit}"
        f"{state[made.clean]}, Python {made.python} on {made.cpu}, {made.system}; "
        f"its {len(study.runs)} runs took {seconds / 60:.0f} minutes, "
        + ("with" if made.recorded else "without")
        + " the recorded drive of chapter 05. "
        + _since(project, study),
        "",
    ]
    rows = [["chapter", "set for the study", "other seeds", "left out"]]
    for chapter, reduced in assumptions.reduced.items():
        settings = ", ".join(f"`{name} = {value}`" for name, value in reduced.parameters.items())
        seeds = ", ".join(map(str, reduced.seeds)) or "none: no chance in it"
        rows.append([chapter, settings or "nothing", seeds, ", ".join(reduced.skips) or "nothing"])
    lines.append(
        list_table(
            "How the chapters are run in the study. Left out are sections on which no headline and "
            "no verdict rests.",
            "tbl-assumptions-reduced",
            rows,
        )
    )
    return "\n".join(lines)


def _since(project: Project, study: Study) -> str:
    """Return a sentence on which sources are not those of the study any more."""
    now = {
        "library": project.computing_digest(),
        "locks": tree_digest(project.root, project.locks),
        **{f"chapter {c.number}": file_digest(c.source) for c in project.chapters()},
    }
    changed = [
        name for name, digest in study.made.sources.items() if name in now and now[name] != digest
    ]
    if not changed:
        return "Neither the library nor a chapter has changed since."
    return f"Since then have changed: {', '.join(changed)}. `make studies` makes it anew."


# The figure


def _panels(tables: Mapping[str, Sequence[Row]]) -> list[tuple[Effect, list[tuple[str, Effect]]]]:
    """Return for each chapter its first headline with the largest effects on it."""
    panels = []
    for rows in tables.values():
        found = [
            (f"{row.entry.id}, {row.set}", row.effects[0])
            for row in rows
            if row.effects and not row.entry.seeds and _ratio(row.effects[0]) is not None
        ]
        found.sort(key=lambda item: -abs(math.log(_ratio(item[1]) or 1.0)))
        if found:
            panels.append((found[0][1], found[:_BARS]))
    return panels


def _ratio(effect: Effect) -> float | None:
    if effect.before > 0 and effect.after > 0:
        return effect.after / effect.before
    return None


def figure_svg(tables: Mapping[str, Sequence[Row]]) -> str:
    """Return the figure: by what factor the first headline of each chapter moves, as SVG.

    Parameters
    ----------
    tables : mapping of str to sequence of Row
        By chapter.
    """
    panels = _panels(tables)
    rows = max(len(panels), 1)
    fig, axes = figure(rows, 1, height=1.75 * rows + 0.3, squeeze=False)
    for ax, (first, found) in zip(axes[:, 0], panels, strict=False):
        ratios = [_ratio(effect) or 1.0 for _, effect in found]
        colours = [
            COLOURS["contradicted"] if effect.turns and effect.beyond
            else COLOURS["rebuilt"] if effect.beyond else COLOURS["published"]
            for _, effect in found
        ]  # fmt: skip
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
        ax.set_title(
            f"chapter {first.headline.chapter}, {first.headline.short}", loc="left", fontsize=9.5
        )
        ax.grid(axis="y", visible=False)
    if panels:
        axes[-1, 0].set_xlabel("result over that of the unchanged run")
    stream = io.StringIO()
    fig.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    plt.close(fig)
    return stream.getvalue()


def figure_text(tables: Mapping[str, Sequence[Row]]) -> str:
    """Return the directive that shows the figure, with its alternative text."""
    told = "; ".join(
        f"chapter {first.headline.chapter}, {first.headline.short}: "
        + ", ".join(
            f"{name.replace('$', '')} {_ratio(effect) or 1.0:.3g}" for name, effect in found
        )
        for first, found in _panels(tables)
    )
    alt = (
        f"Bars, a panel a chapter; the number is the result over that of the unchanged run. {told}."
    )
    return (
        f":::{{figure}} generated/{FIGURE}\n:name: fig-assumptions\n:alt: {alt}\n\n"
        "The first result of each chapter when one assumption changes, over that of the unchanged "
        "run: the largest changes. Blue: beyond chance; grey: within it; orange: the conclusion "
        "turns. The grey band is what another seed may do.\n:::\n"
    )
