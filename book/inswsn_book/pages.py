"""The pages of the book: templates over results and ledger, staged for Sphinx and rendered."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import nbformat
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from inswsn_book import effects, elsewhere, review, study
from inswsn_book.about import About, load_about
from inswsn_book.files import file_digest, swap_folder, text_digest, tree_digest, write_whole
from inswsn_book.front import chapter_head, contests, front_svg
from inswsn_book.ledger import KINDS, LEDGER, PAPERS, Claim, QuantityCheck, claims_of, load_claims
from inswsn_book.notebooks import notebook_text
from inswsn_book.progress import Progress
from inswsn_book.project import Chapter, Project
from inswsn_book.provenance import repository_state
from inswsn_book.results import Provenance, Results, write_results
from inswsn_book.runs import Run, book_runs
from inswsn_book.verdicts import Judged, Verdict, count_verdicts, verdicts
from inswsn_lib import __version__
from inswsn_lib.errors import BuildError, InswsnError
from inswsn_lib.files import read_yaml

#: Set by the renderer for Sphinx's process: the line at the foot of every page, in plain text.
FOOTER_VARIABLE = "INSWSN_FOOTER"
_KEY_FILE = ".inswsn-key"
# What of book/ is no page, and nothing that a page shows
_NO_PAGES = ("inswsn_book", "_templates", "pyproject.toml", "*.egg-info", "__pycache__")
# The trees of all pages live until the end. To look for what is dead among them as often as Python
# does by default takes a quarter of the time; to look seldom takes a tenth more memory.
_JUPYTER_BOOK = (
    "import gc; gc.set_threshold(100_000, 20, 20); from jupyter_book.cli.main import main; main()"
)
# as Sphinx writes them: "place: WARNING: what", or the word first
_WARNING = re.compile(r"(^|: )(WARNING|ERROR|CRITICAL|SEVERE): ")


class RenderingError(BuildError):
    """The book could not be rendered, or what was rendered does not hold together."""


# What the templates are given ---------------------------------------------------------------------


@dataclass(frozen=True)
class Listed:
    """A chapter as templates list it.

    Attributes
    ----------
    number, name : str
    need : str
        What it asks of its reader, by its own words; empty if it does not say.
    minutes : int or None
        To read it.
    results : Results or None
        What it recorded.
    """

    number: str
    name: str
    need: str
    minutes: int | None
    results: Results | None

    @property
    def seconds(self) -> float:
        """What its run took; zero if that is unknown."""
        made = self.results.provenance if self.results else None
        return made.seconds if made else 0.0


def environment(root: Path) -> Environment:
    """Return the Jinja environment of the pages: ``book/*.md`` and ``book/_templates``.

    Parameters
    ----------
    root : Path
        The checkout.
    """
    made = Environment(
        loader=FileSystemLoader([root / "book", root / "book" / "_templates"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        extensions=["jinja2.ext.do"],
    )
    made.filters |= {
        "claim_link": review.claim_link,
        "code": code,
        "escape_text": review.escape_text,
        "latex": latex,
        "number": lambda value, form="g": format(value, form).replace("-", "−"),
        "one_line": lambda text: " ".join(text.split()),
        "quantity": quantity,
        "slug": slug,
    }
    made.globals |= {
        "all_verdicts": list(Verdict),
        "claim_link": review.claim_link,
        "count_verdicts": count_verdicts,
        "kinds": KINDS,
        "papers": PAPERS,
    }
    return made


def context(project: Project, results: Sequence[Results]) -> dict[str, Any]:
    """Return what the templates of the pages are rendered with.

    Parameters
    ----------
    project : Project
        The checkout.
    results : sequence of Results
        What the chapters that are shown have recorded.

    Raises
    ------
    InswsnError
        If a source cannot be read or does not fit the results.
    """
    by_chapter = {found.chapter: found for found in results}
    claims = load_claims(project.root / LEDGER)
    judged = verdicts(claims, results)
    return {
        "project": project,
        "about": about(project),
        "chapters": [_listed(chapter, by_chapter) for chapter in project.chapters()],
        "results": by_chapter,
        "machines": _machines(results),
        "claims": claims,
        "judged": judged,
        "contests": contests(project.root, by_chapter),
        **_reviewed(project, results, judged),
    }


def about(project: Project) -> About:
    """Return what the book is called, whose it is, and where it can be had."""
    return load_about(project.root)


def _listed(chapter: Chapter, results: dict[str, Results]) -> Listed:
    need, minutes = chapter_head(chapter)
    return Listed(chapter.number, chapter.name, need, minutes, results.get(chapter.number))


def _machines(results: Sequence[Results]) -> list[tuple[list[str], Provenance]]:
    """Return the chapters that were computed alike, with what they were computed with."""
    groups: dict[str, tuple[list[str], Provenance]] = {}
    for found in results:
        made = found.provenance
        if made is not None:
            alike = repr((made.cpu, made.cores, made.system, made.blas, made.python, made.packages))
            groups.setdefault(alike, ([], made))[0].append(found.chapter)
    return list(groups.values())


def quantity(setting: Any) -> str:
    """Return the value of a setting or a parameter with its unit."""
    value = _plain(setting.value if hasattr(setting, "value") else setting.default)
    return value if setting.unit == "1" else f"{value} {setting.unit}"


def _plain(value: object) -> str:
    if isinstance(value, list | tuple):
        return f"({', '.join(map(_plain, value))})"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def slug(word: str) -> str:
    """Return a word as part of a CSS class, as docutils writes it: ``"not-decided"``."""
    return word.lower().replace(" ", "-")


def code(text: str) -> str:
    """Return a text as a code span of Markdown, whatever is in it."""
    fence = "`" * (1 + max((len(run) for run in re.findall("`+", text)), default=0))
    pad = " " if text.startswith("`") or text.endswith("`") else ""
    return f"{fence}{pad}{' '.join(text.split())}{pad}{fence}"


def latex(text: str) -> str:
    """Return a text with the signs escaped that LaTeX takes for commands."""
    return re.sub(r"([&%$#_{}])", r"\\\1", text)


# What the build adds to a chapter -----------------------------------------------------------------


def chapter_page(project: Project, run: Run, claims: Sequence[Claim] = ()) -> str:
    """Return the notebook of a run as a page shows it: with captions, links and provenance.

    Before each cell that decides claims goes a line that links to them, and is linked to by them;
    after the last cell goes the provenance of the run. MyST-NB reads a figure's name, caption and
    alternative text from the metadata of its cell, and `inswsn_book.show.show_figure` leaves them
    in the metadata of the output.

    Parameters
    ----------
    project : Project
        The checkout, for its templates.
    run : Run
        With its executed notebook.
    claims : sequence of Claim
        The claims that the chapter decides; without them it has no links.

    Raises
    ------
    RenderingError
        If a cell shows more than one figure: they would share one caption.
    """
    templates, results = environment(project.root), run.results
    notebook = nbformat.reads(run.notebook, as_version=4)
    decided: dict[str, list[Claim]] = {}
    for claim in claims:
        if isinstance(claim.check, QuantityCheck) and claim.check.quantity in results.cells:
            decided.setdefault(results.cells[claim.check.quantity], []).append(claim)
    cells = []
    for cell in notebook.cells:
        if cell["id"] in decided:
            text = templates.get_template("deciding.md").render(
                cell=cell["id"],
                claims=decided[cell["id"]],
                hidden="remove-cell" in cell.metadata.get("tags", []),
            )
            cells.append(_markdown(f"{cell['id']}-claims", text))
        cells.append(_with_caption(cell))
    if results.provenance is not None:
        text = templates.get_template("provenance.md").render(
            results=results, made=results.provenance
        )
        cells.append(_markdown(f"ch{results.chapter}-provenance", text))
    notebook.cells = cells
    return notebook_text(notebook)


def _markdown(identity: str, text: str) -> Any:
    cell = nbformat.v4.new_markdown_cell(text)
    cell["id"] = identity
    return cell


def _with_caption(cell: Any) -> Any:
    outputs = [output.get("metadata", {}) for output in cell.get("outputs", [])]
    shown = [metadata["inswsn"] for metadata in outputs if "inswsn" in metadata]
    if len(shown) > 1:
        raise RenderingError(f"Cell {cell['id']} shows {len(shown)} figures; a cell shows one.")
    for figure in shown:
        cell.metadata["mystnb"] = {
            "image": {"alt": figure["alt"]},
            "figure": {"caption": figure["caption"], "name": figure["name"]},
        }
    return cell


# Rendering ----------------------------------------------------------------------------------------


def render_book(
    project: Project, runs: Sequence[Run], progress: Progress, *, fresh: bool = False
) -> None:
    """Render the book to ``_build/html`` unless it is up to date.

    The site is built beside the old one, checked, and only then put in its place: a failure leaves
    the last good site as it was. Every build starts from clean doctrees, since Sphinx does not
    repeat the warnings of pages that it does not read again.

    Parameters
    ----------
    project : Project
        The checkout.
    runs : sequence of Run
        Those of all chapters.
    progress : Progress
        Told whether it is rendered or up to date.
    fresh : bool
        Render even if nothing has changed.

    Raises
    ------
    RenderingError
        If Sphinx warns, a link inside the site leads nowhere, an image is missing or has no
        alternative text, or a page takes a part of itself from another host.
    InswsnError
        If a source cannot be read, or what is said on a page rests on evidence that does not hold.
    OSError
        If a folder cannot be written.
    """
    key = site_key(project, runs)
    if not fresh and _kept_key(project) == key:
        progress.say("book: unchanged")
        return
    progress.say("book: rendering")
    made = context(project, [run.results for run in runs])
    review.require_evidence(made.get("errata"), made.get("readings"), made["findings"])
    source = project.build / "source"
    shutil.rmtree(source, ignore_errors=True)
    _stage(project, source, runs, made)
    with tempfile.TemporaryDirectory(dir=project.build, prefix="render-") as name:
        site = _run_jupyter_book(project, source, Path(name))
        if site_key(project, runs) != key:
            raise RenderingError("Something changed while the book was rendered; build it again.")
        write_whole(site / _KEY_FILE, key)
        swap_folder(site, project.site)


def render_run(project: Project, run: Run, target: Path) -> None:
    """Render the book with another run of one chapter in it.

    Parameters
    ----------
    project : Project
        The checkout, with all chapters built: the others stand beside the run.
    run : Run
        Of one chapter.
    target : Path
        Where the site goes, in a folder that is there; nothing is there yet.

    Raises
    ------
    RenderingError
        If Sphinx warns or the site does not hold together.
    InswsnError
        If the book has not been built as it is now.
    """
    chapter = run.results.chapter
    runs = [run if kept.results.chapter == chapter else kept for kept in book_runs(project)]
    with tempfile.TemporaryDirectory(dir=target.parent, prefix="render-") as name:
        stage = Path(name)
        _stage(project, stage / "source", runs, context(project, [run.results for run in runs]))
        _run_jupyter_book(project, stage / "source", stage).rename(target)


def require_current_site(project: Project, runs: Sequence[Run]) -> None:
    """Raise `InswsnError` if there is no site, or it was rendered from something else."""
    if not (project.site / "index.html").is_file():
        raise InswsnError(f"There is no built book in {project.site}; build it first: make book.")
    if _kept_key(project) != site_key(project, runs):
        raise InswsnError(
            f"The built book in {project.site} is not up to date; build it again: make book."
        )


def site_key(project: Project, runs: Sequence[Run]) -> str:
    """Return the digest of all that the site is made from."""
    root = project.root
    folders = [
        *(root / "data").rglob("*"),
        *(root / "book").rglob("*"),
        *root.glob("chapters/*.md"),
    ]
    package = root / "book" / "inswsn_book"  # the library's digest has it
    sources = [path for path in folders if path.is_file() and package not in path.parents]
    single = ["_config.yml", "pyproject.toml", "CITATION.cff"]
    sources += [root / name for name in single if (root / name).is_file()]
    facts = [tree_digest(root, sources), project.library_digest(), footer_text(project)]
    for run in runs:
        facts += [run.results.model_dump_json(), run.notebook or ""]
    return text_digest("\n".join(facts))


def _kept_key(project: Project) -> str | None:
    path = project.site / _KEY_FILE
    return path.read_text(encoding="utf-8") if path.is_file() else None


def footer_text(project: Project) -> str:
    """Return what stands below every page: version, commit, whether that is all, and the lock."""
    commit, clean = repository_state(project.root)
    state = "" if clean is None or clean else " with changes that were not committed"
    origin = f"commit {commit[:12]}{state}" if commit else "files that are not a git checkout"
    lock = file_digest(project.locks[0])
    return f"Built by inswsn {__version__} from {origin}, environment.lock SHA-256 {lock[:12]}…"


def _stage(project: Project, source: Path, runs: Sequence[Run], made: dict[str, Any]) -> None:
    """Put what Sphinx reads into a new folder: pages, executed chapters, results and figures."""
    shutil.copytree(project.root / "book", source, ignore=shutil.ignore_patterns(*_NO_PAGES))
    names = {chapter.number: chapter.name for chapter in project.chapters()}
    for run in runs:
        number = run.results.chapter
        text = chapter_page(project, run, claims_of(made["claims"], number))
        write_whole(source / "chapters" / f"{names[number]}.ipynb", text)
        write_results(run.results, source / "results" / f"{number}.json")
    if made["contests"]:
        write_whole(source / "figures" / "front.svg", front_svg(made["contests"]))
    if "study_panels" in made:
        write_whole(
            source / "figures" / "assumptions.svg", effects.tornado_svg(made["study_panels"])
        )


def _run_jupyter_book(project: Project, source: Path, stage: Path) -> Path:
    """Render a staged book; return the folder of the site."""
    command = [
        *(sys.executable, "-c", _JUPYTER_BOOK),
        *("build", str(source), "--config", "_config.yml", "--path-output", str(stage)),
        *("--all", "-W", "-n", "--keep-going", "-q"),
    ]
    done = subprocess.run(
        command,
        cwd=project.root,  # where inswsn_book.sphinx_ext looks for the checkout
        env=os.environ | {FOOTER_VARIABLE: footer_text(project)},
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    # what is to be edited lies in book/
    said = (done.stdout + done.stderr).replace(str(source), "book")
    warnings = warnings_in(said)
    # jupyter-book's exit status alone is not to be trusted: it has been 0 after warnings
    if done.returncode != 0 or warnings:
        raise RenderingError(
            "Sphinx could not render the book without warnings:\n"
            + ("\n".join(warnings) if warnings else said.strip())
        )
    return stage / "_build" / "html"


def warnings_in(said: str) -> list[str]:
    """Return the lines of Sphinx's output that are warnings or errors."""
    return [line for line in said.splitlines() if _WARNING.search(line)]


def check_contents(project: Project, chapters: Sequence[Chapter]) -> None:
    """Refuse a configuration that cannot be read, and a contents list without every chapter.

    Raises
    ------
    InswsnError
        If ``_config.yml`` or ``book/_toc.yml`` cannot be read, or chapters and contents differ.
    """
    read_yaml(project.root / "_config.yml")
    named = _files(read_yaml(project.root / "book" / "_toc.yml"))
    listed = {name.removeprefix("chapters/") for name in named if name.startswith("chapters/")}
    there = {chapter.name for chapter in chapters}
    for name in sorted(listed - there):
        raise InswsnError(f"book/_toc.yml lists chapters/{name}, and there is no such chapter.")
    for name in sorted(there - listed):
        raise InswsnError(f"book/_toc.yml does not list chapters/{name}; every chapter has a page.")


def _files(node: Any) -> Iterator[str]:
    """Return every name of a file in a contents list."""
    if isinstance(node, list):
        for value in node:
            yield from _files(value)
    elif isinstance(node, dict):
        for key, value in node.items():
            if key in ("file", "root") and isinstance(value, str):
                yield value
            else:
                yield from _files(value)


def _reviewed(project: Project, results: Sequence[Results], judged: list[Judged]) -> dict[str, Any]:
    """Return what the templates on errata, readings and assumptions use."""
    if hasattr(review, "context"):  # to be called directly once it is there
        return dict(review.context(project, results, judged))
    root, findings = project.root, review.Findings(results, judged)
    made: dict[str, Any] = {"findings": findings}
    if not (root / review.ASSUMPTIONS).is_file():
        return made
    assumptions = review.load_assumptions(root)
    kept = study.read_study(root / study.SENSITIVITY)
    tables = {
        chapter: effects.rows_of(assumptions, kept, chapter) for chapter in assumptions.reduced
    }
    readings = effects.readings_of(assumptions, findings)
    now = {
        "library": project.computing_digest(),
        "locks": tree_digest(root, project.locks),
        **{f"chapter {c.number}": file_digest(c.source) for c in project.chapters()},
    }

    def chance_band(of: study.Study, headline: review.Headline) -> float:
        values = [run.headlines.get(headline.key) for run in of.seeds(headline.chapter)]
        return effects.band_of([value for value in values if value is not None])

    return made | {
        "errata": review.load_errata(root),
        "readings": review.load_readings(root),
        "judged_anew": review.judged_anew,
        "other_claims": review.other_claims,
        "assumptions": assumptions,
        "study": kept,
        "study_tables": tables,
        "study_readings": readings,
        "study_summary": effects.summarise(assumptions, tables, readings),
        "study_panels": effects.panels_of(tables),
        "moves": effects.MOVES,
        "change_text": effects.change_text,
        "chance_band": chance_band,
        "changed_sources": lambda digests: [
            name for name, digest in digests.items() if now.get(name, digest) != digest
        ],
        "settings": review.load_settings(root),
        "schemas": review.load_schemas(project),
        "elsewhere": elsewhere.read_elsewhere(root / elsewhere.ELSEWHERE),
    }
