"""The book as a site: templates over results and ledger, staged and rendered.

Pages in ``book/`` are Jinja templates, which `inswsn_book.sphinx_ext` renders as Sphinx reads them.
What is made for a rendering, executed chapters above all, lies in a staging folder.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import nbformat
from jinja2 import Environment, FileSystemLoader, StrictUndefined

import inswsn_lib
from inswsn_book import files, review
from inswsn_book.imports import code_files
from inswsn_book.judging import judge
from inswsn_book.ledger import KINDS, LEDGER, PAPERS, Claim, claims_of, load_claims
from inswsn_book.notebooks import notebook_text
from inswsn_book.parameters import chapter_schema
from inswsn_book.progress import Progress
from inswsn_book.project import ROOT_VARIABLE, Chapter, Project
from inswsn_book.provenance import repository_state
from inswsn_book.results import Results, write_results
from inswsn_book.runs import Run, code_of, reference_results
from inswsn_book.verdicts import Verdict, count_verdicts
from inswsn_lib.errors import BuildError, InswsnError
from inswsn_lib.files import read_text, read_yaml
from inswsn_lib.scenario import load_scenario

_KEY_FILE = ".inswsn-key"
#: Set for the Sphinx that renders one page of the book
ALONE = "INSWSN_ALONE"
# The trees of all pages live until the end. To look for what is dead among them as often as Python
# does by default takes a quarter of the time; to look seldom takes a tenth more memory. When the
# command ends, however it does, its end of the pipe is closed, and all of this group ends as well.
_JUPYTER_BOOK = """
import gc, os, signal, threading
from jupyter_book.cli.main import main
end = lambda: os.read(0, 1) or os.killpg(0, signal.SIGKILL)
threading.Thread(target=end, daemon=True).start()
gc.set_threshold(100_000, 20, 20)
main()
"""
#: A warning as Sphinx writes it: "place: WARNING: what", or the word first
WARNING = re.compile(r"(^|: )(WARNING|ERROR|CRITICAL|SEVERE): ")
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
        "code": lambda text: f"`` {text} ``" if "`" in text else f"`{text}`",
        "escape_text": review.escape_text,
        "number": _number,
    }
    made.globals |= {
        "all_verdicts": tuple(Verdict),
        "claim_link": review.claim_link,
        "count_verdicts": count_verdicts,
        "judged_anew": review.judged_anew,
        "kinds": KINDS,
        "papers": PAPERS,
        "reference": reference,
    }
    return made


def _number(value: float, form: str = "g") -> str:
    return format(value, form).replace("-", "−")


def _head_of(chapter: Chapter) -> dict[str, str]:
    """Return what the head of a chapter says that it needs, and the minutes to read it."""
    head = _HEAD.search(read_text(chapter.source))
    return head.groupdict() if head else {"need": "", "minutes": ""}


def context(project: Project, results: Sequence[Results]) -> dict[str, Any]:
    """Return what the templates are rendered over."""
    judged = judge(project.root, results)
    findings = review.Findings(results, judged)
    known: dict[str, Any] = {
        "about": project.about(),
        "chapters": [
            {"number": c.number, "name": c.name, "results": findings.results.get(c.number)}
            | _head_of(c)
            for c in project.chapters()
        ],
        "findings": findings,
        "judged": judged,
    }
    published = all(
        found.parameters == chapter_schema(project.root, found.chapter).defaults
        for found in results
    )
    if (project.root / review.ERRATA).is_file():
        errata = review.load_entries(project.root / review.ERRATA, review.Errata)
        readings = review.load_entries(project.root / review.READINGS, review.Readings)
        if published:
            entries = [*errata.errata, *errata.slips, *readings.questions, *readings.computed]
            review.require_evidence(entries, findings)
        known |= {"errata": errata, "readings": readings}
    return known | _kept(project)


def reference() -> list[tuple[str, list[tuple[str, str]]]]:
    """Return titles, each with the directives and names of Sphinx that stand below it.

    First the front door of the library, by what its names are for, which comments of its stub
    tell; then what its rooms have beside, for the chapters.
    """
    package = Path(inswsn_lib.__file__).parent
    front = (package / "__init__.pyi").read_text(encoding="utf-8")
    groups = [part.partition("\n")[::2] for part in front.split("\n# ")[1:]]
    shown = [(title, _stub_names("inswsn_lib", stub)) for title, stub in groups]
    known = {name for _, names in shown for _, name in names}
    for path in sorted(package.glob("*/__init__.pyi")):
        names = _stub_names(f"inswsn_lib.{path.parent.name}", path.read_text(encoding="utf-8"))
        more = sorted(pair for pair in names if pair[1] not in known)
        shown.append((f"More of {path.parent.name}, for the chapters", more))
    return [(title, [_directive(*pair) for pair in names]) for title, names in shown if names]


def _stub_names(package: str, stub: str) -> list[tuple[str, str]]:
    """Return the names that a stub imports from modules, each behind where it comes from."""
    imports = re.findall(r"from \.(\w+) import (\(.*?\)|.*?\n)", stub, re.DOTALL)
    return [
        (f"{package}.{module}", name)
        for module, names in imports
        for name in re.findall(r"(\w+) as", names)
    ]


def _directive(home: str, name: str) -> tuple[str, str]:
    """Return Sphinx's directive for a name, by how it is written, and the name to ask for."""
    if name.isupper():  # its comment is found in its own module alone
        return "autodata", f"{home}.{name}"
    room = ".".join(home.split(".")[:2])
    if name[0].islower():
        return "autofunction", f"{room}.{name}"
    return "autoexception" if name.endswith("Error") else "autoclass", f"{room}.{name}"


def _kept(project: Project) -> dict[str, Any]:
    """Return what the scripts in ``studies`` keep, what they vary, and what has changed since."""
    data = project.root / "data"
    now = {
        "library": project.computing_digest(),
        "locks": files.tree_digest(project.root, project.locks),
        **{f"chapter {c.number}": files.file_digest(c.source) for c in project.chapters()},
        **{f"library of chapter {c.number}": _library(project, c) for c in project.chapters()},
    }
    assumed = data / "assumptions.yaml"
    return {
        **{path.stem: read_json(path) for path in data.glob("*.json")},
        "assumptions": read_yaml(assumed) if assumed.is_file() else {},
        "settings": {path.stem: load_scenario(path) for path in data.glob("scenarios/*.yaml")},
        "schemas": {c.number: chapter_schema(project.root, c.number) for c in project.chapters()},
        "changed_since": lambda sources: [
            name for name, digest in sources.items() if now.get(name, digest) != digest
        ],
    }


def _library(project: Project, chapter: Chapter) -> str:
    return code_of(project, read_text(chapter.source), chapter.source.name)[2]


def read_json(path: Path) -> Any:
    """Read what a study keeps; refuse what is no JSON."""
    text = read_text(path)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InswsnError(f"{path} is not JSON: {error}.") from None


# Staging


def stage_book(project: Project, runs: Sequence[Run], folder: Path) -> None:
    """Write the source folder of a rendering: pages, executed chapters, results, figures."""
    shutil.copytree(
        project.root / "book",
        folder,
        ignore=shutil.ignore_patterns("inswsn_book", "_templates", "pyproject.toml"),
    )
    rendered = [run.results for run in runs]
    here = {results.chapter for results in rendered}
    # what the pages and the verdicts need of chapters that are not rendered
    others = [
        reference_results(project, c.number) for c in project.chapters() if c.number not in here
    ]
    context(project, [*rendered, *others])  # what cannot be shown is refused by it
    for results in (*rendered, *others):
        write_results(results, folder / "generated" / f"{results.chapter}.json")
    templates, claims = environment(project.root), load_claims(project.root / LEDGER)
    for run in runs:
        name, results = project.find(run.request.chapter).name, run.results
        notebook = with_captions(nbformat.reads(run.notebook, as_version=4))
        shown = with_notes(notebook, results, claims_of(claims, results.chapter), templates)
        files.write_whole(folder / "chapters" / f"{name}.ipynb", notebook_text(shown))
    for figure in (project.root / "data").glob("*.svg"):
        shutil.copy(figure, folder / "generated")


def with_captions(notebook: Any) -> Any:
    """Move what `show_figure` says of a figure to where MyST-NB looks for it, and return it all."""
    for cell in notebook.cells:
        shown = [output.get("metadata", {}).get("inswsn") for output in cell.get("outputs", [])]
        for figure in filter(None, shown):
            if "mystnb" in cell.metadata:
                raise RenderingError(f"Cell {cell['id']} shows two figures; a cell shows one.")
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
            cells.append(nbformat.v4.new_markdown_cell(text, id=f"{cell['id']}-claims"))
        cells.append(cell)
    if results.provenance is not None:
        text = templates.get_template("provenance.md").render(
            results=results, made=results.provenance
        )
        cells.append(nbformat.v4.new_markdown_cell(text, id=f"ch{results.chapter}-provenance"))
    notebook.cells = cells
    return notebook


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
    why = "it is asked for" if fresh else _why_due(project, key)
    if not why:
        progress.say("book: unchanged")
        return
    progress.say(f"book: rendering, since {why}")
    project.build.mkdir(parents=True, exist_ok=True)
    with files.temporary_folder(project.build) as stage:
        stage_book(project, runs, stage / "source")
        site = _render(project, stage)
        if _site_key(project, runs) != key:
            raise RenderingError("Something changed while the book was rendered; build it again.")
        files.write_whole(site / _KEY_FILE, key)
        files.seal_folder(site)
        files.replace_folder(project.site, site)


def render_run(project: Project, run: Run, target: Path) -> None:
    """Render the page of a run, with links to the built book; without one they are plain words."""
    chapter = f"chapters/{project.find(run.request.chapter).name}"
    with files.temporary_folder(target.parent) as stage:
        source = stage / "source"
        stage_book(project, [run], source)
        toc = f"format: jb-book\nroot: {chapter}\n"
        if (source / "bibliography.md").is_file():  # citations are resolved there
            toc += "chapters:\n- file: bibliography\n"
        files.write_whole(source / "_toc.yml", toc)
        _render(project, stage, alone=True).rename(target)


def _render(project: Project, stage: Path, *, alone: bool = False) -> Path:
    """Render what is staged; return the folder of the site.

    A page that is alone may lack what it names.
    """
    command = [
        *(sys.executable, "-I", "-X", "utf8", "-c", _JUPYTER_BOOK),
        *("build", str(stage / "source"), "--config", "_config.yml", "--path-output", str(stage)),
        *("--all", "-q", *(() if alone else ("-W", "-n", "--keep-going"))),
    ]
    with subprocess.Popen(
        command,
        cwd=project.root,
        env=os.environ | {ROOT_VARIABLE: str(project.root), ALONE: "yes" if alone else ""},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        start_new_session=True,
    ) as done:
        assert done.stdout is not None
        said = done.stdout.read()
    # without colours, and what is to be edited lies in book/
    said = _COLOUR.sub("", said).replace(str(stage / "source"), "book")
    warnings = [line for line in said.splitlines() if WARNING.search(line)]
    # jupyter-book's exit status alone is not to be trusted: it has been 0 after warnings
    if done.returncode != 0 or (warnings and not alone):
        raise RenderingError(
            "Sphinx could not render the book without warnings:\n"
            + ("\n".join(warnings) if warnings else said.strip())
        )
    return stage / "_build" / "html"


def require_current_site(project: Project, runs: Sequence[Run]) -> None:
    """Raise `InswsnError` if there is no site, or it is not what is rendered of all this."""
    if why := _why_due(project, _site_key(project, runs)):
        raise InswsnError(f"The book in {project.site} is not up to date, since {why}: make book.")


def _why_due(project: Project, key: str) -> str:
    """Return why the site must be rendered; nothing if it need not be."""
    kept = project.site / _KEY_FILE
    if not kept.is_file() or kept.read_bytes() != key.encode():
        return "its sources have changed"
    return files.few(files.damages(project.site))


def _site_key(project: Project, runs: Sequence[Run]) -> str:
    """Return a digest of all that a site is made from; what is made of it is not looked at."""
    root = project.root
    sources = [path for path in (root / "book").rglob("*") if path.is_file()]
    sources += [path for path in (root / "data").rglob("*") if path.is_file()]
    sources += [chapter.source for chapter in project.chapters()]
    sources += [*project.locks, root / "_config.yml", root / "CITATION.cff"]
    kept = [path for path in sources if "__pycache__" not in path.parts and path.is_file()]
    # docstrings and signatures are on the page of the library
    code = [files.tree_digest(p.parent, code_files(p)) for p in project.libraries]
    facts = [files.tree_digest(root, kept), *code, footer(project)]
    facts += [files.text_digest(run.notebook or "") for run in runs]
    facts += [files.text_digest(run.results.model_dump_json()) for run in runs]
    return files.text_digest("\n".join(facts))


def footer(project: Project) -> str:
    """Return the line at the foot of every page: what the site was built from."""
    commit, clean = repository_state(project.root)
    state = "" if clean is None or clean else " with changes that were not committed"
    source = f"commit {commit[:12]}{state}" if commit else "files that are not a git checkout"
    lock = files.file_digest(project.locks[0])
    return (
        f"Built by inswsn {project.about()['version']} from {source}, "
        f"environment.lock SHA-256 {lock[:12]}…"
    )


def check_pages(project: Project) -> None:
    """Refuse a configuration that cannot be read, and a contents list without every chapter."""
    read_yaml(project.root / "_config.yml")
    toc = project.root / "book" / "_toc.yml"
    read_yaml(toc)
    listed = set(re.findall(r"file: *chapters/(\S+)", toc.read_text(encoding="utf-8")))
    for name in sorted(listed ^ {chapter.name for chapter in project.chapters()}):
        lacks = "lists chapters/{}, and there is no such chapter"
        lacks = lacks if name in listed else "does not list chapters/{}; every chapter has a page"
        raise InswsnError(f"book/_toc.yml {lacks.format(name)}.")
