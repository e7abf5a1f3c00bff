"""The book as a site: templates over results and ledger, staged and rendered.

Pages in ``book/`` are Jinja templates, which `inswsn_book.sphinx_ext` renders as Sphinx reads them.
What is made for a rendering, executed chapters above all, lies in a staging folder.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import nbformat
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from inswsn_book import effects, elsewhere, review, study
from inswsn_book.charts import contests, front_svg, tornado_svg
from inswsn_book.files import (
    file_digest,
    swap_folder,
    text_digest,
    tree_digest,
    write_whole,
)
from inswsn_book.ledger import KINDS, LEDGER, PAPERS, Claim, claims_of, load_claims
from inswsn_book.notebooks import notebook_text
from inswsn_book.parameters import chapter_schema
from inswsn_book.progress import Progress
from inswsn_book.project import ROOT_VARIABLE, Chapter, Project
from inswsn_book.provenance import repository_state
from inswsn_book.results import Provenance, Results, write_results
from inswsn_book.runs import Run, book_runs
from inswsn_book.verdicts import Verdict, count_verdicts, verdicts
from inswsn_lib.errors import BuildError, InswsnError
from inswsn_lib.files import read_yaml

_KEY_FILE = ".inswsn-key"
# The trees of all pages live until the end. To look for what is dead among them as often as Python
# does by default takes a quarter of the time; to look seldom takes a tenth more memory.
_JUPYTER_BOOK = (
    "import gc; gc.set_threshold(100_000, 20, 20); from jupyter_book.cli.main import main; main()"
)
# as Sphinx writes them: "place: WARNING: what", or the word first
_WARNING = re.compile(r"(^|: )(WARNING|ERROR|CRITICAL|SEVERE): ")
_COLOUR = re.compile(r"\x1b\[[\d;]*m")
_HEAD = re.compile(
    r"\*\*You need\*\*\s+(?P<need>.*?)\.\s+\*\*Reading time\*\*\s+(?P<minutes>\d+)\s+minutes?\.",
    re.DOTALL,
)


class RenderingError(BuildError):
    """The book could not be rendered, or what was rendered does not hold together."""


# Templates


def environment(root: Path) -> Environment:
    """Return the environment of the templates in ``book/`` and ``book/_templates/``."""
    made = Environment(
        loader=FileSystemLoader([root / "book", root / "book" / "_templates"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        extensions=["jinja2.ext.do"],
    )
    made.filters |= {
        "code": _code,
        "escape_text": review.escape_text,
        "number": _number,
        "one_line": lambda text: " ".join(text.split()),
        "quantity": _quantity,
        "slug": lambda word: str(word).lower().replace(" ", "-"),
        "sum_values": lambda mapping: sum(mapping.values()),
    }
    made.globals |= {
        "all_verdicts": tuple(Verdict),
        "change_text": effects.change_text,
        "chance_band": effects.chance_band,
        "claim_link": review.claim_link,
        "count_verdicts": count_verdicts,
        "judged_anew": review.judged_anew,
        "kinds": KINDS,
        "moves": effects.MOVES,
        "other_claims": review.other_claims,
        "papers": PAPERS,
    }
    return made


def _number(value: float, form: str = "g") -> str:
    return format(value, form).replace("-", "−")


def _quantity(given: Any) -> str:
    """Return the value of a setting or the default of a parameter, with its unit."""
    value = given.value if hasattr(given, "value") else given.default
    return _plain(value) + ("" if given.unit == "1" else f" {given.unit}")


def _plain(value: object) -> str:
    if isinstance(value, list):
        return f"({', '.join(map(_plain, value))})"
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _code(text: str) -> str:
    """Return a text as a code span, whatever is in it."""
    fence = "`" * (1 + max((len(run) for run in re.findall("`+", text)), default=0))
    pad = " " if text.startswith("`") or text.endswith("`") else ""
    return f"{fence}{pad}{' '.join(text.split())}{pad}{fence}"


def _facts_of(chapter: Chapter, results: Results | None) -> dict[str, Any]:
    """Return what pages say of a chapter: what it needs, how long it takes, what it found."""
    head = _HEAD.search(chapter.source.read_text(encoding="utf-8"))
    made = results.provenance if results else None
    return {
        "number": chapter.number,
        "name": chapter.name,
        "need": " ".join(head["need"].split()) if head else "",
        "minutes": int(head["minutes"]) if head else None,
        "results": results,
        "seconds": made.seconds if made else 0.0,
    }


def context(project: Project, results: Sequence[Results]) -> dict[str, Any]:
    """Return what the templates are rendered over."""
    judged = verdicts(load_claims(project.root / LEDGER), results)
    findings = review.Findings(results, judged)
    known: dict[str, Any] = {
        "about": project.about(),
        "chapters": [_facts_of(c, findings.results.get(c.number)) for c in project.chapters()],
        "findings": findings,
        "judged": judged,
        "machines": _machines(results),
    }
    published = all(
        found.parameters == chapter_schema(project.root, found.chapter).defaults
        for found in results
    )
    known["contests"] = contests(project.root, findings)
    if (project.root / review.ERRATA).is_file():
        errata, readings = review.load_errata(project.root), review.load_readings(project.root)
        if published:
            review.require_evidence(errata, readings, findings)
        known |= {"errata": errata, "readings": readings}
    if (project.root / review.ASSUMPTIONS).is_file():
        known |= _sensitivity(project, findings)
    if (project.root / elsewhere.ELSEWHERE).is_file():
        kept = elsewhere.read_elsewhere(project.root / elsewhere.ELSEWHERE)
        known["elsewhere"] = kept
        known["elsewhere_changed"] = elsewhere.changed_since(project, kept)
    return known


def _machines(results: Sequence[Results]) -> list[tuple[list[str], Provenance]]:
    """Return the machines, each with the chapters that ran there."""
    groups: dict[tuple[object, ...], tuple[list[str], Provenance]] = {}
    for found in results:
        if (made := found.provenance) is not None:
            key = (made.cpu, made.cores, made.system, made.blas, made.python, str(made.packages))
            groups.setdefault(key, ([], made))[0].append(found.chapter)
    return list(groups.values())


def _sensitivity(project: Project, findings: review.Findings) -> dict[str, Any]:
    assumptions = review.load_assumptions(project.root)
    kept = study.read_study(project.root / study.SENSITIVITY)
    tables = {c: effects.rows_of(assumptions, kept, c) for c in assumptions.reduced}
    readings = effects.readings_of(assumptions, findings)
    return {
        "assumptions": assumptions,
        "changed_sources": lambda sources: _changed_sources(project, sources),
        "schemas": review.load_schemas(project),
        "settings": review.load_settings(project.root),
        "study": kept,
        "study_panels": effects.panels_of(tables),
        "study_readings": readings,
        "study_summary": effects.summarise(assumptions, tables, readings),
        "study_tables": tables,
    }


def _changed_sources(project: Project, sources: dict[str, str]) -> list[str]:
    now = {
        "library": project.computing_digest(),
        "locks": tree_digest(project.root, project.locks),
        **{f"chapter {c.number}": file_digest(c.source) for c in project.chapters()},
    }
    return [name for name, digest in sources.items() if name in now and now[name] != digest]


# Staging


def stage_book(project: Project, runs: Sequence[Run], folder: Path) -> None:
    """Write the source folder of a rendering: pages, executed chapters, results, figures."""
    shutil.copytree(
        project.root / "book",
        folder,
        ignore=shutil.ignore_patterns("inswsn_book", "_templates", "pyproject.toml"),
    )
    templates, claims = environment(project.root), load_claims(project.root / LEDGER)
    for run in runs:
        name, results = project.find(run.request.chapter).name, run.results
        notebook = with_captions(nbformat.reads(run.notebook, as_version=4))
        shown = with_notes(notebook, results, claims_of(claims, results.chapter), templates)
        write_whole(folder / "chapters" / f"{name}.ipynb", notebook_text(shown))
        write_results(results, folder / "generated" / f"{results.chapter}.json")
    known = context(project, [run.results for run in runs])
    if known["contests"]:
        write_whole(folder / "generated" / "front.svg", front_svg(known["contests"]))
    if "study_panels" in known:
        figure = tornado_svg(known["study_panels"])
        write_whole(folder / "generated" / "assumptions-tornado.svg", figure)


def with_captions(notebook: Any) -> Any:
    """Move each figure's name, caption and alternative text to where MyST-NB looks for them.

    `inswsn_book.show.show_figure` leaves them in the metadata of the output; MyST-NB reads the
    metadata of the cell. The notebook is changed in place and returned.
    """
    for cell in notebook.cells:
        shown = [
            output["metadata"]["inswsn"]
            for output in cell.get("outputs", [])
            if "inswsn" in output.get("metadata", {})
        ]
        if len(shown) > 1:
            raise RenderingError(f"Cell {cell['id']} shows {len(shown)} figures; a cell shows one.")
        for figure in shown:
            cell.metadata["mystnb"] = {
                "image": {"alt": figure["alt"]},
                "figure": {"caption": figure["caption"], "name": figure["name"]},
            }
    return notebook


def with_notes(
    notebook: Any, results: Results, claims: Sequence[Claim], templates: Environment
) -> Any:
    """Add to a chapter what the build knows of it, in place, and return it.

    Before each cell that decides claims goes a line that links to them, and is linked to by them;
    after the last cell goes the provenance of the run.
    """
    decided: dict[str, list[Claim]] = {}
    for claim in claims:
        cell_id = results.cells.get(getattr(claim.check, "quantity", ""))
        if cell_id is not None:
            decided.setdefault(cell_id, []).append(claim)
    cells = []
    for cell in notebook.cells:
        if cell["id"] in decided:
            hidden = "remove-cell" in cell.metadata.get("tags", [])
            text = templates.get_template("deciding.md").render(
                cell=cell["id"], claims=decided[cell["id"]], hidden=hidden
            )
            cells.append(_markdown(f"{cell['id']}-claims", text))
        cells.append(cell)
    if results.provenance is not None:
        text = templates.get_template("provenance.md").render(
            results=results, made=results.provenance
        )
        cells.append(_markdown(f"ch{results.chapter}-provenance", text))
    notebook.cells = cells
    return notebook


def _markdown(identity: str, text: str) -> Any:
    cell = nbformat.v4.new_markdown_cell(text)
    cell["id"] = identity
    return cell


# Rendering


def render_book(
    project: Project, runs: Sequence[Run], progress: Progress, *, fresh: bool = False
) -> None:
    """Render the book to ``_build/html`` unless it is up to date.

    The site is built beside the old one, inspected, and only then put in its place: a failure
    leaves the last good site as it was. Every build starts from clean doctrees, since Sphinx does
    not repeat the warnings of pages that it does not read again.
    """
    key = _site_key(project, runs)
    if not fresh and _kept_key(project) == key:
        progress.say("book: unchanged")
        return
    progress.say("book: rendering")
    project.build.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=project.build, prefix="render-") as name:
        site = _render(project, runs, Path(name))
        if _site_key(project, runs) != key:
            raise RenderingError("Something changed while the book was rendered; build it again.")
        write_whole(site / _KEY_FILE, key)
        swap_folder(site, project.site)


def render_run(project: Project, run: Run, target: Path) -> None:
    """Render the book with another run of one chapter in it."""
    shown = [
        run if other.request.chapter == run.request.chapter else other
        for other in book_runs(project)
    ]
    with tempfile.TemporaryDirectory(dir=target.parent, prefix="render-") as name:
        _render(project, shown, Path(name)).rename(target)


def _render(project: Project, runs: Sequence[Run], stage: Path) -> Path:
    """Stage and render a book; return the folder of the site."""
    stage_book(project, runs, stage / "source")
    command = [
        *(sys.executable, "-c", _JUPYTER_BOOK),
        *("build", str(stage / "source"), "--config", "_config.yml", "--path-output", str(stage)),
        *("--all", "-W", "-n", "--keep-going", "-q"),
    ]
    done = subprocess.run(
        command,
        cwd=project.root,
        env=os.environ | {ROOT_VARIABLE: str(project.root)},
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    # without colours, and what is to be edited lies in book/
    said = _COLOUR.sub("", done.stdout + done.stderr).replace(str(stage / "source"), "book")
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


def require_current_site(project: Project, runs: Sequence[Run]) -> None:
    """Raise `InswsnError` if there is no site, or it was rendered from something else."""
    if not (project.site / "index.html").is_file():
        raise InswsnError(f"There is no built book in {project.site}; build it first: make book.")
    if _kept_key(project) != _site_key(project, runs):
        raise InswsnError(
            f"The built book in {project.site} is not up to date; build it again: make book."
        )


def _kept_key(project: Project) -> str | None:
    path = project.site / _KEY_FILE
    return path.read_text(encoding="utf-8") if path.is_file() else None


def _site_key(project: Project, runs: Sequence[Run]) -> str:
    """Return a digest of all that a site is made from; what is made of it is not looked at."""
    root = project.root
    sources = [path for path in (root / "book").rglob("*") if path.is_file()]
    sources += [path for path in (root / "data").rglob("*") if path.is_file()]
    sources += [chapter.source for chapter in project.chapters()]
    sources += [*project.locks, root / "_config.yml", root / "CITATION.cff"]
    kept = [path for path in sources if "__pycache__" not in path.parts and path.is_file()]
    facts = [tree_digest(root, kept), project.library_digest(), footer(project)]
    facts += [text_digest(run.notebook or "") for run in runs]
    facts += [text_digest(run.results.model_dump_json()) for run in runs]
    return text_digest("\n".join(facts))


def footer(project: Project) -> str:
    """Return the line at the foot of every page: what the site was built from."""
    commit, clean = repository_state(project.root)
    state = "" if clean is None or clean else " with changes that were not committed"
    source = f"commit {commit[:12]}{state}" if commit else "files that are not a git checkout"
    lock = file_digest(project.locks[0])
    return (
        f"Built by inswsn {project.about().version} from {source}, "
        f"environment.lock SHA-256 {lock[:12]}…"
    )


def check_pages(project: Project, chapters: Sequence[Chapter]) -> None:
    """Refuse a configuration that cannot be read, and a contents list without every chapter."""
    read_yaml(project.root / "_config.yml")
    toc = project.root / "book" / "_toc.yml"
    read_yaml(toc)
    listed = set(re.findall(r"file: *chapters/(\S+)", toc.read_text(encoding="utf-8")))
    there = {chapter.name for chapter in chapters}
    for name in sorted(listed - there):
        raise InswsnError(f"book/_toc.yml lists chapters/{name}, and there is no such chapter.")
    for name in sorted(there - listed):
        raise InswsnError(f"book/_toc.yml does not list chapters/{name}; every chapter has a page.")
