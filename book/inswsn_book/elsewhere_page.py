"""The texts of the page of other surroundings, made from ``data/elsewhere.json``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from typing import Annotated

from pydantic import Field

from inswsn_book.elsewhere import (
    AGAIN,
    DESCRIPTIONS,
    ELSEWHERE,
    MACHINE,
    Cell,
    Moved,
    Study,
    read_elsewhere,
)
from inswsn_book.evidence import (
    Entry,
    Prose,
    chapter_link,
    escape_text,
    read_entries,
    refuse_repeated,
)
from inswsn_book.files import file_digest, tree_digest
from inswsn_book.project import Project
from inswsn_book.tables import list_table
from inswsn_lib.errors import InswsnError

#: Why something moved, by hand.
EXPLANATIONS = "data/elsewhere.yaml"

_SMALL = 0.001  # tolerances below which a deviation is written as below it


class Explanation(Entry):
    """Why something is not the same elsewhere.

    Attributes
    ----------
    id : str
    variants : tuple of str
    chapter : str
    names : tuple of str
        Patterns, as of file names, of quantities, sentences and claims.
    why : str
    """

    id: Annotated[str, Field(pattern=r"^[a-z0-9]+(-[a-z0-9]+)*$")]
    variants: Annotated[tuple[str, ...], Field(min_length=1)]
    chapter: Annotated[str, Field(pattern=r"^\d\d$")]
    names: Annotated[tuple[str, ...], Field(min_length=1)]
    why: Prose

    def covers(self, cell: Cell, name: str) -> bool:
        """Tell whether it speaks of something in a cell."""
        return (
            cell.chapter == self.chapter
            and cell.variant in self.variants
            and any(fnmatchcase(name, pattern) for pattern in self.names)
        )


class Explanations(Entry):
    """What ``data/elsewhere.yaml`` holds."""

    explanations: tuple[Explanation, ...]

    def model_post_init(self, context: object) -> None:
        """Refuse an id that is used twice."""
        refuse_repeated([entry.id for entry in self.explanations])


def elsewhere_texts(project: Project) -> dict[str, str]:
    """Return the texts that the page includes, by the names of their files.

    Parameters
    ----------
    project : Project
        The checkout.

    Returns
    -------
    dict of str to str
        Empty if the checkout has no ``data/elsewhere.yaml``.

    Raises
    ------
    InswsnError
        If the study or the explanations cannot be read, something moved and no explanation says
        why, or an explanation speaks of what did not move.
    """
    if not (project.root / EXPLANATIONS).is_file():
        return {}
    explained = read_entries(
        project.root / EXPLANATIONS, Explanations, "a list of explanations", ("explanations",)
    ).explanations
    study = read_elsewhere(project.root / ELSEWHERE)
    chapters = [chapter.number for chapter in project.chapters()]
    refuse_unexplained(study, explained)
    return {
        "elsewhere-summary.md": summary(study, len(chapters)),
        "elsewhere-variants.md": variants_list(study),
        "elsewhere-table.md": variants_table(study, len(chapters)),
        "elsewhere-chapters.md": chapters_table(study, chapters),
        "elsewhere-moved.md": moved_list(study, explained),
        "elsewhere-solvers.md": solvers_list(study),
        "elsewhere-made.md": made_note(project, study),
    }


def moved_names(cell: Cell) -> list[str]:
    """Return the names of all that is not the same: quantities, sentences and claims."""
    return [
        *(moved.name for moved in cell.beyond),
        *cell.overturned,
        *(flip.claim for flip in cell.flipped),
    ]


def refuse_unexplained(study: Study, explained: Sequence[Explanation]) -> None:
    """Refuse a study in which something moved and nothing says why, or the other way round.

    Raises
    ------
    InswsnError
        The sentence names it.
    """
    for cell in study.cells:
        for name in moved_names(cell):
            if not any(entry.covers(cell, name) for entry in explained):
                raise InswsnError(
                    f"{ELSEWHERE}: chapter {cell.chapter}, {cell.variant}: {name!r} is not as in "
                    f"the reference, and {EXPLANATIONS} does not say why."
                )
    for entry in explained:
        for variant in entry.variants:
            for pattern in entry.names:
                one = entry.model_copy(update={"variants": (variant,), "names": (pattern,)})
                if not any(
                    one.covers(cell, name) for cell in study.cells for name in moved_names(cell)
                ):
                    raise InswsnError(
                        f"{EXPLANATIONS}: {entry.id}: nothing like {pattern!r} moved in chapter "
                        f"{entry.chapter}, {variant}."
                    )


def summary(study: Study, chapters: int) -> str:
    """Return what came of it all in a few sentences; the book has so many chapters."""
    ran = [cell for cell in study.cells if cell.failed is None]
    others = [cell for cell in ran if cell.variant != AGAIN]
    ways = len({cell.variant for cell in others})
    total, same = sum(c.compared for c in others), sum(c.identical for c in others)
    beyond = sum(len(cell.beyond) for cell in others)
    flips = sum(len(cell.flipped) for cell in others)
    overturned = sum(len(cell.overturned) for cell in others)
    parts = [
        f"In {_count(ways, 'way')} of changing the surroundings, {_count(len(others), 'execution')}"
        f" of chapters {_were(len(others))} held against the reference results, of "
        f"{ways * chapters} that {_count(chapters, 'chapter')} would make. "
        f"Of {total} comparisons of a quantity with its own "
        f"tolerance, {same} agreed to the last bit, {total - same - beyond} moved within the "
        f"tolerance, and **{beyond or 'none'}** went beyond it.",
        f"Of {sum(c.judged for c in others)} verdicts, **{flips or 'none'}** changed. Of "
        f"{sum(c.sentences for c in others)} sentences that are bound to a result, "
        f"**{overturned or 'none'}** {_were(overturned)} overturned.",
    ]
    again = [cell for cell in ran if cell.variant == AGAIN]
    if again:
        parts.append(
            f"With nothing changed, {sum(c.identical for c in again)} of "
            f"{sum(c.compared for c in again)} quantities came out the same to the last bit."
            + _processors(again)
        )
    missing = [cell for cell in study.cells if cell.failed is not None]
    if missing:
        parts.append(f"What could not be run: {_failures(missing)}.")
    return " ".join(parts) + "\n"


def _were(number: int) -> str:
    return "was" if number in (0, 1) else "were"


def _failures(missing: Iterable[Cell]) -> str:
    """Return the reasons, each with its chapters."""
    found: dict[str, list[str]] = {}
    for cell in missing:
        found.setdefault(reason(cell), []).append(chapter_link(cell.chapter))
    return "; ".join(
        f"{' and '.join(chapters)} ({why.rstrip('.')})" for why, chapters in found.items()
    )


def _processors(again: list[Cell]) -> str:
    """Return a sentence on the processors of the reference and of runs with nothing changed."""
    pairs = sorted({(cell.reference_cpu, cell.cpu) for cell in again})
    if all(before == now for before, now in pairs):
        return ""
    said = " and ".join(f"{now} (reference: {before})" for before, now in pairs if before != now)
    return f" Some were made on another processor than the reference: {said}."


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"


def title_of(study: Study, variant: str) -> str:
    """Return the title of a variant of a study, with the version of another Python."""
    title, _ = DESCRIPTIONS[_family(variant)]
    return title.format(version=study.of(variant)[0].python)


def _family(variant: str) -> str:
    return "python" if variant.startswith("python-") else variant


def variants_list(study: Study) -> str:
    """Return what was changed and why, a line for each variant."""
    usual = _libraries(study.of(AGAIN))
    lines = [f"Linear algebra, as the runs found it: {usual}, if nothing else is said.", ""]
    for name in study.variants:
        found = _libraries(study.of(name))
        lines.append(
            f"- **{title_of(study, name)}** (`{name}`). {DESCRIPTIONS[_family(name)][1]}"
            + (f" Here: {found}." if found not in ("", usual) else "")
            + (f" {_machines(study.of(name))}" if name == MACHINE else "")
        )
    return "\n".join(lines if usual else lines[2:]) + "\n"


def _libraries(cells: list[Cell]) -> str:
    """Return which linear algebra computed, as the runs found it."""
    return "; ".join(sorted({library for cell in cells for library in cell.blas}))


def _machines(cells: list[Cell]) -> str:
    """Return on which processors runs and their references were made, a sentence for each pair."""
    pairs = sorted({(cell.cpu, cell.reference_cpu) for cell in cells})
    return " ".join(
        f"Runs are from {run}, their references from {made}."
        if run != made
        else f"Runs and their references are from two unlike processors that are called {run}."
        for run, made in pairs
    )


def variants_table(study: Study, chapters: int) -> str:
    """Return the table with one row for each variant; the book has so many chapters."""
    rows = [
        [
            "changed", "chapters", "verdicts flipped", "sentences overturned", "beyond tolerance",
            "same to the last bit", "farthest",
        ]
    ]  # fmt: skip
    for name in study.variants:
        cells = [cell for cell in study.of(name) if cell.failed is None]
        quantities = sum(cell.compared for cell in cells)
        rows.append(
            [
                title_of(study, name),
                f"{len(cells)} of {chapters}",
                _part(sum(len(c.flipped) for c in cells), sum(c.judged for c in cells)),
                _part(sum(len(c.overturned) for c in cells), sum(c.sentences for c in cells)),
                _part(sum(len(c.beyond) for c in cells), quantities),
                _part(sum(c.identical for c in cells), quantities),
                _farthest(cells),
            ]
        )
    return list_table(
        "What moves when one thing of the surroundings is changed. A quantity is beyond its "
        "tolerance if its value or an end of its interval is. The last column is the quantity that "
        "moved most, in its tolerances, and its chapter.",
        "tbl-elsewhere",
        rows,
    )


def _part(number: int, whole: int) -> str:
    return f"{number} of {whole}" if whole else "there are none"


def _farthest(cells: Iterable[Cell]) -> str:
    found = [(cell.chapter, cell.farthest) for cell in cells if cell.farthest is not None]
    if not found:
        return "none moved"
    chapter, moved = max(found, key=lambda pair: pair[1].size)
    return f"{tolerances(moved)}, {chapter_link(chapter)}"


def tolerances(moved: Moved) -> str:
    """Return how far a quantity moved, in tolerances, as a word."""
    if moved.deviation is None:
        return "another quantity"
    if moved.deviation < _SMALL:
        return f"below {_SMALL:g}"
    return f"{moved.deviation:.2g}"


def chapters_table(study: Study, chapters: Sequence[str]) -> str:
    """Return the table with one row for each chapter and one column for each variant."""
    names = study.variants
    rows = [["chapter", "quantities", *(title_of(study, name) for name in names)]]
    for chapter in chapters:
        cells = [study.cell(name, chapter) for name in names]
        counts = sorted({cell.compared for cell in cells if cell and cell.compared})
        rows.append(
            [chapter_link(chapter), " or ".join(map(str, counts)) or "–", *map(_in_short, cells)]
        )
    return list_table(
        "By chapter: *same* where every quantity came out the same to the last bit, else how far "
        "the farthest moved, in its tolerances; and where quantities went beyond their tolerance, "
        "sentences were overturned or verdicts flipped, how many.",
        "tbl-elsewhere-chapters",
        rows,
    )


def _in_short(cell: Cell | None) -> str:
    if cell is None or cell.failed is not None:
        return "not run"
    parts = ["same" if cell.farthest is None else tolerances(cell.farthest)]
    if cell.beyond:
        parts.append(f"{len(cell.beyond)} beyond")
    if cell.overturned:
        parts.append(_count(len(cell.overturned), "sentence"))
    if cell.flipped:
        parts.append(_count(len(cell.flipped), "verdict"))
    return ", ".join(parts)


def reason(cell: Cell) -> str:
    """Return why a chapter could not be executed."""
    said = cell.failed or ""
    module = re.search(r"No module named '(\w+)'", said)
    if module:
        return f"{module[1]} for Python {cell.python} could not be had here"
    return escape_text(said)


def moved_list(study: Study, explained: Sequence[Explanation]) -> str:
    """Return all that is not the same, with both values, and the reasons."""
    blocks = []
    for entry in explained:
        rows = [["changed", "quantity", "reference", "here", "in tolerances"]]
        lines = []
        for cell in study.cells:
            title = title_of(study, cell.variant)
            for moved in cell.beyond:
                if entry.covers(cell, moved.name):
                    rows.append([title, *_row(moved)])
            lines += [
                f"- With {title} this sentence does not hold: “{escape_text(text)}”"
                for text in cell.overturned
                if entry.covers(cell, text)
            ]
            lines += [
                f"- With {title} {flip.claim} is {flip.after or 'not judged'}, and was "
                f"{flip.before}."
                for flip in cell.flipped
                if entry.covers(cell, flip.claim)
            ]
        block = [f"**{_capital(chapter_link(entry.chapter))}.**", "", *lines, ""]
        if len(rows) > 1:
            caption = f"Beyond their tolerance in chapter {entry.chapter}, and how far."
            block += [list_table(caption, f"tbl-elsewhere-{entry.id}", rows)]
        blocks.append("\n".join([*block, entry.why.strip()]) + "\n")
    return "\n".join(blocks) or "Nothing: no quantity, no sentence and no verdict.\n"


def _capital(link: str) -> str:
    return link.replace("`chapter", "`Chapter", 1)


def _row(moved: Moved) -> list[str]:
    part = "" if moved.part == "value" else f", {moved.part} of its interval"
    values = [_value(number, moved.unit) for number in (moved.before, moved.after)]
    far = "; ".join([tolerances(moved), *moved.other])
    return [f"`{moved.name}`{part}", *values, far]


def _value(number: float | None, unit: str) -> str:
    if number is None:
        return "absent"
    shown = f"{number:.7g}".replace("-", "−")
    return shown if unit == "1" else f"{shown} {unit}"


def solvers_list(study: Study) -> str:
    """Return how many designs each solver made, in the chapters with another solver."""
    lines = [
        f"- {_capital(chapter_link(cell.chapter))}: "
        + "; ".join(f"{name.removesuffix(', all designs')} {told}" for name, told in counts)
        + "."
        for cell in study.of("scs")
        if (counts := [(n, t) for n, t in cell.solvers.items() if n.endswith(", all designs")])
    ]
    without = [cell.chapter for cell in study.of("scs") if not cell.failed and not cell.solvers]
    if without:
        links = ", ".join(map(chapter_link, without))
        lines += ["", f"These solve no design, so that SCS changes nothing in them: {links}."]
    return "\n".join(lines) + "\n"


def made_note(project: Project, study: Study) -> str:
    """Return when, from what and on what the cells were made, and what has changed since."""
    lines = []
    for name in study.variants:
        cells = study.of(name)
        days, commits = ({getattr(cell, field) for cell in cells} for field in ("day", "commit"))
        seconds = sum(cell.seconds for cell in cells)
        lines.append(
            f"- {title_of(study, name)}: {', '.join(sorted(days))}, "
            f"{' and '.join(sorted(_commit(commit) for commit in commits))}"
            f"{'' if all(cell.clean for cell in cells) else ', with changes not committed'}, "
            f"Python {', '.join(sorted({cell.python for cell in cells}))} on "
            f"{', '.join(sorted({f'{cell.cpu}, {cell.system}' for cell in cells}))}; "
            f"{seconds / 60:.0f} minutes."
        )
    return "\n".join([*lines, "", _since(project, study)]) + "\n"


def _commit(commit: str | None) -> str:
    return "an unknown commit" if commit is None else f"commit `{commit[:12]}`"


def _since(project: Project, study: Study) -> str:
    """Return a sentence on what the cells were not made from any more."""
    chapters = {chapter.number: chapter for chapter in project.chapters()}
    library, locks = project.computing_digest(), tree_digest(project.root, project.locks)
    changed = sorted(
        {
            cell.chapter
            for cell in study.cells
            if cell.chapter in chapters
            and cell.sources["chapter"] != file_digest(chapters[cell.chapter].source)
        }
    )
    words = [f"chapter {number}" for number in changed]
    words += ["the library"] * any(cell.sources["library"] != library for cell in study.cells)
    words += ["the locks"] * any(cell.sources["locks"] != locks for cell in study.cells)
    if not words:
        return "Nothing that they were made from has changed since."
    return f"Since then, these have changed: {', '.join(words)}."
