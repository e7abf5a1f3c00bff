"""What ``inswsn verify`` holds against each other: digests, results, and what the pages show."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from bs4 import BeautifulSoup

from inswsn_book.judge.claims import judge
from inswsn_book.judge.review import Findings, with_reruns
from inswsn_book.make.site import require_current_site
from inswsn_book.record.chapter import plain
from inswsn_book.record.files import MANIFEST, damages, file_digest
from inswsn_book.record.progress import Progress
from inswsn_book.record.project import Project, is_checkout
from inswsn_book.record.results import Results, read_results
from inswsn_book.run.compare import NUMBER, pair_quantities
from inswsn_book.run.store import Request, book_runs, reference_results, run
from inswsn_lib.errors import InswsnError, ParameterError

_GLUED = re.compile(r"\{glue:text\}`([^`:]*):?([^`]*)`")
# In the cell of a table: where a link leads, and a role, which the page shows in words of its own
_UNSHOWN = re.compile(r"(?<=\])\([^)]*\)|\{[\w:]+\}`[^`]*`.*")
# Nobody reads it: it only asks for a run beside the one that the book has
_ANEW = {"INSWSN_VERIFY": "1"}


def verify(
    folder: Path, numbers: Sequence[str], progress: Progress, digest: str | None = None
) -> Iterator[tuple[str, list[str]]]:
    """Yield what is checked, and what differs there.

    The folder is a checkout, an unpacked archive, or what a run or a sweep has written. Chapters of
    the numbers are executed anew, and held against the reference results. Who has changed a file
    may have changed the manifest as well: its own SHA-256, `digest`, stands elsewhere.
    """
    if digest is not None:
        there = (folder / MANIFEST).is_file() and file_digest(folder / MANIFEST)
        yield (
            f"the list of digests, {MANIFEST}: its own",
            ([] if there == digest.lower() else [f"it is {there or 'missing'}, not {digest}"]),
        )
    archived = (folder / MANIFEST).exists() or (folder / "ro-crate-metadata.json").exists()
    if archived:
        yield "the folder: its digests", damages(folder)
    elif not is_checkout(folder):
        raise ParameterError("PATH", str(folder), f"a checkout or a folder with {MANIFEST}")
    if not is_checkout(folder):
        return
    project = Project(folder)
    yield "data/published: its digests", damages(project.published)
    site = folder / "site" if archived else project.site
    if site.exists():
        try:
            kept = sorted((folder / "results").glob("[!l]*.json"))
            found = [read_results(path) for path in kept]
            if not archived:
                require_current_site(project, made := book_runs(project))
                if [run.results for run in made] != found:
                    raise InswsnError("The folder results is not what was built: make book.")
            shown = list(_shown(project, site, found))
            differing = [f"{at}: {text!r} for {of!r}" for at, text, of in shown if text != of]
        except InswsnError as error:
            shown, differing = [], [str(error)]
        yield f"the pages: {len(shown)} numbers, cells of tables and verdicts", differing
    for number in numbers:
        done = run(project, Request(number, variables=_ANEW), progress, fresh=True).results
        pairs = pair_quantities(reference_results(project, number), done)
        differing = [str(pair) for pair in pairs if pair.beyond_tolerance]
        differing += [f"not so: {said}" for said, held in done.sentences.items() if not held]
        yield f"chapter {number}, executed anew: {len(pairs)} quantities", differing


def _shown(project: Project, site: Path, found: Sequence[Results]) -> Iterator[tuple[str, ...]]:
    """Yield where a page shows a result, what stands there, and what should."""
    judged = judge(project.root, found)
    for results in found:
        chapter = project.by_id(results.chapter)
        page = _read(site / "chapters" / f"{chapter.name}.html")
        for where, *texts in _of_chapter(page, chapter.source.read_text("utf-8"), results):
            yield f"{chapter.name}, {where}", *texts
    findings = Findings(with_reruns(project.root, found), judged)
    page = _read(site / "claims.html")
    for entry in judged:
        text = " ".join(tag.get_text() for tag in page.select(f"#{entry.claim.anchor}"))
        for word in (entry.label, f": {entry.rebuilt_text}." if entry.quantity else ""):
            yield f"claim {entry.claim.id}", word if word in text else text[:80], word
    for path in sorted(site.glob("*.html")):
        for tag in _read(path).select("[data-quantity]"):  # of `Findings.fill`
            filled = BeautifulSoup(findings.fill(f"{{{tag['data-quantity']}}}"), "html.parser")
            yield path.name, f"**{tag.get_text()}**", filled.get_text()


def _read(path: Path) -> BeautifulSoup:
    return BeautifulSoup(path.read_bytes() if path.is_file() else b"", "html.parser")


def _of_chapter(page: BeautifulSoup, source: str, results: Results) -> Iterator[tuple[str, ...]]:
    """Yield the numbers in the text and in the tables of a chapter, in the order of its source."""
    values = {quantity.name: quantity.value for quantity in results.quantities}
    roles, pasted = _GLUED.findall(source), [t.get_text() for t in page.select(".pasted-text")]
    yield "in its text", f"{len(pasted)} numbers", f"{len(roles)} numbers"
    for (name, form), text in zip(roles, pasted, strict=False):
        if name in values:
            yield name, text, format(plain(values[name]), form)
    for label, rows in results.tables.items():
        cells = [tag.get_text() for tag in page.select(f'[id="{label}"] :is(td, th)')]
        recorded = [cell for row in rows for cell in row]
        yield label, f"{len(cells)} cells", f"{len(recorded)} cells"
        for text, cell in zip(cells, recorded, strict=False):
            expected = NUMBER.findall(_UNSHOWN.sub("", cell))
            yield label, " ".join(NUMBER.findall(text)[: len(expected)]), " ".join(expected)
