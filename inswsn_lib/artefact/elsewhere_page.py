"""The texts of the page of other surroundings, made from ``data/elsewhere.json``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from typing import Annotated

from pydantic import Field

from inswsn_lib.artefact.elsewhere import (
    AGAIN,
    DESCRIPTIONS,
    ELSEWHERE,
    Cell,
    Moved,
    Study,
    read_elsewhere,
)
from inswsn_lib.artefact.evidence import (
    Entry,
    Prose,
    chapter_link,
    escape_text,
    read_entries,
    refuse_repeated,
)
from inswsn_lib.artefact.project import Project
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import file_digest, tree_digest

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
    refuse_unexplained(study, explained)
    return {
        "elsewhere-summary.md": summary(study, len(project.chapters())),
        "elsewhere-variants.md": variants_list(study),
        "elsewhere-table.md": variants_table(study),
        "elsewhere-chapters.md": chapters_table(study),
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
    total, same = sum(c.compared for c in others), sum(c.identical for c in others)
    beyond = sum(len(cell.beyond) for cell in others)
    flips = sum(len(cell.flipped) for cell in others)
    overturned = sum(len(cell.overturned) for cell in others)
    parts = [
        f"In {_count(len({c.variant for c in others}), 'way')} of changing the surroundings, "
        f"{_count(len(others), 'execution')} of {len(study.chapters)} of this book's "
        f"{_count(chapters, 'chapter')} were held against the reference results. "
        f"Of {total} comparisons of a quantity with its own "
        f"tolerance, {same} agreed to the last bit, {total - same - beyond} moved within the "
        f"tolerance, and **{beyond or 'none'}** went beyond it.",
        f"**{_none(flips, 'verdict')}** of {sum(c.judged for c in others)} changed, and "
        f"**{_none(overturned, 'sentence')}** of {sum(c.sentences for c in others)} that are bound "
        f"to a result {'was' if overturned in (0, 1) else 'were'} overturned.",
    ]
    again = [cell for cell in ran if cell.variant == AGAIN]
    moved = sum(cell.compared - cell.identical for cell in again)
    if again:
        parts.append(
            f"With nothing changed, {sum(c.compared for c in again) - moved} of "
            f"{sum(c.compared for c in again)} quantities came out the same to the last bit."
            + _processors(again)
        )
    missing = [cell for cell in study.cells if cell.failed is not None]
    if missing:
        parts.append(
            f"{_count(len(missing), 'execution')} could not be made; {{numref}}`tbl-elsewhere-"
            "chapters` says why."
        )
    return " ".join(parts) + "\n"


def _processors(again: list[Cell]) -> str:
    """Return a sentence if runs with nothing changed were made on other processors."""
    pairs = {(cell.reference_cpu, cell.cpu) for cell in again if cell.reference_cpu != cell.cpu}
    if not pairs:
        return ""
    before, now = (" and ".join(sorted(set(names))) for names in zip(*pairs, strict=True))
    return (
        f" The reference was made on {before}, and these runs on {now}: nothing else is changed, "
        "but the machine is another one."
    )


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"


def _none(number: int, word: str) -> str:
    return f"{number} {word}s" if number > 1 else f"One {word}" if number else f"No {word}"


def title_of(study: Study, variant: str) -> str:
    """Return the title of a variant of a study, with the version of another Python."""
    title, _ = DESCRIPTIONS[_family(variant)]
    return title.format(version=study.of(variant)[0].python)


def _family(variant: str) -> str:
    return "python" if variant.startswith("python-") else variant


def variants_list(study: Study) -> str:
    """Return what was changed and why, a line for each variant."""
    lines = [
        f"- **{title_of(study, name)}** (`{name}`). {DESCRIPTIONS[_family(name)][1]}"
        + _as_run(study.of(name))
        for name in study.variants
    ]
    return "\n".join(lines) + "\n"


def _as_run(cells: list[Cell]) -> str:
    """Return which linear algebra computed, as the runs found it."""
    found = sorted({library for cell in cells for library in cell.blas})
    return f" Linear algebra, as the runs found it: {'; '.join(found)}." if found else ""


def variants_table(study: Study) -> str:
    """Return the table with one row for each variant."""
    rows = [
        [
            "changed", "chapters", "quantities", "same to the last bit", "beyond tolerance",
            "farthest, in tolerances", "sentences overturned", "verdicts flipped",
        ]
    ]  # fmt: skip
    for name in study.variants:
        cells = [cell for cell in study.of(name) if cell.failed is None]
        rows.append(
            [
                title_of(study, name),
                f"{len(cells)} of {len(study.chapters)}",
                str(sum(cell.compared for cell in cells)),
                str(sum(cell.identical for cell in cells)),
                str(sum(len(cell.beyond) for cell in cells)),
                _farthest(cells),
                f"{sum(len(c.overturned) for c in cells)} of {sum(c.sentences for c in cells)}",
                f"{sum(len(c.flipped) for c in cells)} of {sum(c.judged for c in cells)}",
            ]
        )
    return list_table(
        "What moves when one thing of the surroundings is changed. A quantity is beyond its "
        "tolerance if its value or an end of its interval is.",
        "tbl-elsewhere",
        rows,
    )


def _farthest(cells: Iterable[Cell]) -> str:
    found = [(cell.chapter, cell.farthest) for cell in cells if cell.farthest is not None]
    if not found:
        return "none moved"
    chapter, moved = max(found, key=lambda pair: _size(pair[1]))
    return f"{tolerances(moved)} ({chapter_link(chapter)}, `{moved.name}`)"


def _size(moved: Moved) -> float:
    return float("inf") if moved.deviation is None else moved.deviation


def tolerances(moved: Moved) -> str:
    """Return how far a quantity moved, in tolerances, as a word."""
    if moved.deviation is None:
        return "not to be measured"
    if moved.deviation < _SMALL:
        return f"below {_SMALL:g}"
    return f"{moved.deviation:.2g}"


def chapters_table(study: Study) -> str:
    """Return the table with one row for each chapter and one column for each variant."""
    names = study.variants
    rows = [["chapter", *(title_of(study, name) for name in names)]]
    for chapter in study.chapters:
        cells = [study.cell(name, chapter) for name in names]
        rows.append([chapter_link(chapter), *map(_in_short, cells)])
    return list_table(
        "By chapter: the farthest quantity in tolerances, how many of the quantities are beyond "
        "their tolerance, and where sentences or verdicts changed, how many.",
        "tbl-elsewhere-chapters",
        rows,
    )


def _in_short(cell: Cell | None) -> str:
    if cell is None:
        return "not run"
    if cell.failed is not None:
        return f"not run: {reason(cell)}"
    far = "none moved" if cell.farthest is None else tolerances(cell.farthest)
    parts = [f"{far}; {len(cell.beyond)} of {cell.compared} beyond"]
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
    """Return all that is not the same, with both values, under the reasons."""
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
                f"- {title}: no longer true: {escape_text(text)}"
                for text in cell.overturned
                if entry.covers(cell, text)
            ]
            lines += [
                f"- {title}: {flip.claim} is {flip.after or 'not judged'}, and was {flip.before}."
                for flip in cell.flipped
                if entry.covers(cell, flip.claim)
            ]
        block = [f"**{_capital(chapter_link(entry.chapter))}.** {entry.why.strip()}", "", *lines]
        if len(rows) > 1:
            caption = f"Beyond their tolerance in chapter {entry.chapter}: {len(rows) - 1}."
            block += ["", list_table(caption, f"tbl-elsewhere-{entry.id}", rows)]
        blocks.append("\n".join(block) + "\n")
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
    return (
        "\n".join(lines) + "\n" if lines else "No chapter that was run with SCS designs a filter.\n"
    )


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
    """Return a sentence on what the cells were not made from any more, and what is missing."""
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
    said = "Since then, these have changed: " + ", ".join(words) + "." if words else (
        "Nothing that they were made from has changed since."
    )  # fmt: skip
    absent = sorted(set(chapters) - set(study.chapters))
    if absent:
        said += " Not run elsewhere yet: " + ", ".join(f"chapter {n}" for n in absent) + "."
    return said


def list_table(caption: str, name: str, rows: Sequence[Sequence[str]]) -> str:
    """Return a table of MyST Markdown whose first row is its head."""
    lines = [f"```{{list-table}} {caption}", f":name: {name}", ":header-rows: 1", ""]
    lines += ["* - " + "\n  - ".join(row) for row in rows]
    return "\n".join([*lines, "```\n"])
