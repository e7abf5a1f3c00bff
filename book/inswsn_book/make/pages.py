"""The pages of the book: templates over results and ledger, staged with the executed chapters.

Pages in ``book/`` are Jinja templates. `inswsn_book.make.site` renders what is staged here.
"""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import nbformat
from jinja2 import (
    Environment,
    FileSystemBytecodeCache,
    FileSystemLoader,
    StrictUndefined,
    TemplateError,
)

import inswsn_lib
from inswsn_book.judge import review
from inswsn_book.judge.claims import judge
from inswsn_book.judge.ledger import KINDS, LEDGER, PAPERS, Claim, claims_of, load_claims
from inswsn_book.judge.verdicts import OUTCOMES, Verdict, count_verdicts
from inswsn_book.make.glossary import FirstUses, terms_of
from inswsn_book.make.plain import PlainBook
from inswsn_book.record import files
from inswsn_book.record.chapter import MOST_TURNED, told_turning
from inswsn_book.record.notebooks import cell_prefix, notebook_text, read_notebook
from inswsn_book.record.parameters import chapter_schema
from inswsn_book.record.project import Chapter, Project
from inswsn_book.record.results import Results, results_text
from inswsn_book.record.timing import slowest
from inswsn_book.run.store import Run, code_of, reference_results
from inswsn_lib.errors import BuildError, InswsnError
from inswsn_lib.files import read_text, read_yaml
from inswsn_lib.scenario import load_scenario

_MOVES = 'class="moving"'
_UNSTAGED = re.compile(r"inswsn_book/|_templates/|pyproject\.toml|renamed\.yaml|(.*/)?\.")
#: In the head of a chapter: for which words a search is to lead to it
_INDEX = re.compile(r"\A---\n(?:.*\n)*?index: *(.+)\n")
#: There: which symbols have a colour of their own; see ``book/_static/inswsn.css``
_SYMBOLS = re.compile(r"\A---\n(?:.*\n)*?symbols: *(.+)\n---\n")
_HEAD = re.compile(
    r"\*\*You need\*\*\s+(?P<need>.*?)\.\s+\*\*(?:You will learn to.*?)?"
    r"Reading time\*\*\s+(?P<minutes>\d+)\s+minutes?\.",
    re.DOTALL,
)


# Templates


def environment(root: Path, compiled: Path | None = None) -> Environment:
    """Return the environment of the templates in ``book/`` and ``book/_templates/``.

    Compiled templates are kept in a folder if one is given.
    """
    if compiled is not None:
        compiled.mkdir(parents=True, exist_ok=True)
    made = Environment(
        loader=FileSystemLoader([root / "book", root / "book" / "_templates"]),
        bytecode_cache=FileSystemBytecodeCache(str(compiled)) if compiled else None,
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
        "outcomes": OUTCOMES,
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
    findings = review.Findings(review.with_reruns(project.root, results), judged)
    by_chapter = {found.chapter: found for found in results}
    known: dict[str, Any] = {
        "about": project.about(),
        "chapters": [
            {"number": c.id, "name": c.name, "lesson": c.lesson}
            | {"results": by_chapter.get(c.id)}
            | _head_of(c)
            for c in project.chapters()
        ],
        "findings": findings,
        "judged": judged,
        "moving": {},
        "slowest": slowest(results),
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
        **{f"chapter {c.id}": files.file_digest(c.source) for c in project.chapters()},
        **{f"library of chapter {c.id}": _library(project, c) for c in project.chapters()},
    }
    assumed = data / "assumptions.yaml"
    return {
        **{path.stem: read_json(path) for path in data.glob("*.json")},
        "most_turned": MOST_TURNED,
        "told_turning": told_turning,
        "ladders": _ladders(data / "recorded/on-recordings.json"),
        "reruns": {p.stem: read_json(p)["provenance"] for p in data.glob("reruns/*.json")},
        "benchmarks": {path.stem: read_yaml(path) for path in data.glob("benchmarks*.yaml")},
        "assumptions": read_yaml(assumed) if assumed.is_file() else {},
        "settings": {path.stem: load_scenario(path) for path in data.glob("scenarios/*.yaml")},
        "schemas": {c.id: chapter_schema(project.root, c.id) for c in project.chapters()},
        "changed_since": lambda sources: [
            name for name, digest in sources.items() if now.get(name, digest) != digest
        ],
    }


def _ladders(path: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the tables of a study of recordings, each row by its columns."""
    tables = read_json(path)["tables"] if path.is_file() else {}
    return {
        name: [
            {"name": label, **dict(zip(table["columns"], row, strict=True))}
            for label, row in zip(table["index"], table["data"], strict=True)
        ]
        for name, table in tables.items()
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


def stage_book(project: Project, runs: Sequence[Run], folder: Path) -> list[str]:
    """Write the source folder of a rendering: pages, executed chapters, results, figures.

    What is there and as it should be is left alone, what should not be there goes. Returns what is
    wrong with templates, a line each as Sphinx warns.
    """
    rendered = [run.results for run in runs]
    here = {results.chapter for results in rendered}
    # what the pages and the verdicts need of chapters that are not rendered
    others = [reference_results(project, c.id) for c in project.chapters() if c.id not in here]
    known = context(project, [*rendered, *others])
    # as they are, since they were valid when they were kept, and Sphinx looks again
    notebooks = [nbformat.from_dict(json.loads(run.notebook or "")) for run in runs]
    known["moving"] = moving = _moving_figures(notebooks)
    templates = environment(project.root, folder.parent / "templates")
    texts, problems = _pages(project, templates, known)
    for results in (*rendered, *others):
        texts[f"generated/{results.chapter}.json"] = results_text(results).encode()
    claims = load_claims(project.root / LEDGER)
    notation = project.root / "book" / "notation.md"
    terms = terms_of(read_text(notation)) if notation.is_file() else {}
    taught, order = set[str](), [c.id for c in project.chapters() if c.lesson]
    pairs = list(zip(runs, notebooks, strict=True))
    pairs.sort(key=lambda pair: [*order, pair[0].request.chapter].index(pair[0].request.chapter))
    for run, notebook in pairs:
        chapter, results = project.by_id(run.request.chapter), run.results
        name = chapter.name
        notebook = with_captions(with_pictures(notebook))  # noqa: PLW2901
        uses = FirstUses(terms)
        for cell in notebook.cells:
            if cell.cell_type == "markdown":
                cell.source = uses.link("".join(cell.source))
        source = read_text(chapter.source)
        notebook.metadata |= {"symbols": found[1]} if (found := _SYMBOLS.match(source)) else {}
        words = _INDEX.findall(source)
        if chapter.id in order:  # the first lesson that uses a term is where a search leads
            words += [entry for entry in uses.used if entry not in taught]
            taught.update(uses.used)
        entries = [f"```{{index}} ! {word}\n```" for word in ", ".join(words).split(", ") if word]
        notebook.cells.insert(1, _words(f"{cell_prefix(chapter.id)}-index", "\n".join(entries)))
        shown = with_notes(notebook, results, claims_of(claims, results.chapter), templates)
        texts[f"chapters/{name}.ipynb"] = json.dumps(shown, ensure_ascii=False).encode()
    texts |= {f"generated/{name}.svg": found["picture"].encode() for name, found in moving.items()}
    texts |= _redirects(project, templates, texts, [*rendered, *others])
    for figure in (project.root / "data").glob("*.svg"):
        texts[f"generated/{figure.name}"] = figure.read_bytes()
    files.fill_folder(folder, texts)
    return problems


def _pages(
    project: Project, templates: Environment, known: dict[str, Any]
) -> tuple[dict[str, bytes], list[str]]:
    """Return what lies in ``book/``, pages rendered, and what is wrong with templates."""
    book, texts, problems = project.root / "book", dict[str, bytes](), list[str]()
    for path in sorted(book.rglob("*")):
        name = path.relative_to(book).as_posix()
        if not path.is_file() or _UNSTAGED.match(name):
            continue
        texts[name] = path.read_bytes()
        if path.suffix == ".md":
            try:
                texts[name] = templates.get_template(name).render(known).encode()
            except (TemplateError, InswsnError) as error:
                problems.append(f"book/{name}: WARNING: {error}")
    return texts, problems


def _redirects(
    project: Project, templates: Environment, texts: Iterable[str], known: Iterable[Results]
) -> dict[str, bytes]:
    """Return pages at old addresses, which lead to the new ones, each place to its own.

    An old cell that decided claims leads to where what it recorded is recorded today.
    """
    there = {name.partition(".")[0] for name in texts}
    ids = {f"chapters/{c.name}": c.id for c in project.chapters()}
    page, found = templates.get_template("redirect.html"), {}
    today = {results.chapter: results.cells for results in known}
    cells = {
        chapter: {old: f"cell-{today[chapter][quantity]}" for old, quantity in of_old.items()}
        for chapter, of_old in project.renamed()["cells"].items()
        if chapter in today
    }
    for old, new in project.renamed()["pages"].items():
        name, mark, place = new.removesuffix("!").partition("#")
        if name in there:
            words = {
                "target": posixpath.relpath(f"{name}.html", posixpath.dirname(old)),
                "place": mark + place,
                "kept": not new.endswith("!"),
                "number": posixpath.basename(old)[:2],
                "now": ids.get(name, ""),
                "cells": cells.get(ids.get(name, ""), {}),
            }
            found[f"moved/{old}.html"] = page.render(words).encode()
    return found


def _moving_figures(notebooks: Sequence[Any]) -> dict[str, dict[str, str]]:
    """Return the figures that move, for pages that are no chapters: section, picture and words."""
    found = {}
    for outputs in (cell.get("outputs", []) for book in notebooks for cell in book.cells):
        shown = [o for o in outputs if "inswsn" in o.get("metadata", {})]
        moving = [html for html in map(_html, outputs) if _MOVES in html]
        for output, section in zip(shown, moving, strict=False):  # a cell shows one
            words, picture = output["metadata"]["inswsn"], output["data"]["image/svg+xml"]
            found[words["name"]] = {
                "section": section, "picture": "".join(picture), "alt": words["alt"]
            }  # fmt: skip
    return found


def _html(output: Any) -> str:
    return "".join(output.get("data", {}).get("text/html", ""))


def with_pictures(notebook: Any) -> Any:
    """Give the still picture of a figure that moves a cell of its own, and return it all."""
    cells = []
    for cell in notebook.cells:
        cells.append(cell)
        outputs = cell.get("outputs", [])
        moves = [_MOVES in _html(output) for output in outputs]
        if any(moves):
            picture = nbformat.from_dict(
                cell | {"id": f"{cell['id']}-picture", "source": "# in print"}
            )
            picture.metadata = nbformat.from_dict({"tags": ["remove-input"]})
            picture.outputs = [o for o, moving in zip(outputs, moves, strict=True) if not moving]
            cell.outputs = [o for o, moving in zip(outputs, moves, strict=True) if moving]
            cells.append(picture)
    notebook.cells = cells
    return notebook


def with_captions(notebook: Any) -> Any:
    """Move what `show_figure` says of a figure to where MyST-NB looks for it, and return it all."""
    for cell in notebook.cells:
        shown = [output.get("metadata", {}).get("inswsn") for output in cell.get("outputs", [])]
        for figure in filter(None, shown):
            if "mystnb" in cell.metadata:
                raise BuildError(f"Cell {cell['id']} shows two figures; a cell shows one.")
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
            cells.append(_words(f"{cell['id']}-claims", text))
        cells.append(cell)
    if results.provenance is not None:
        text = templates.get_template("provenance.md").render(
            results=results, made=results.provenance
        )
        cells.append(_words(f"{cell_prefix(results.chapter)}-provenance", text))
    notebook.cells = cells
    return notebook


def plain_notebooks(
    project: Project, runs: Iterable[Run], folder: Path | None = None
) -> dict[str, str]:
    """Return executed notebooks as they leave the book, with their provenance, by name.

    What they link to lies where it does in the repository, as seen from a folder.
    """
    book, templates, found = PlainBook(project), environment(project.root), {}
    for run in runs:
        chapter = project.by_id(run.request.chapter)
        notebook = with_notes(read_notebook(run.notebook or ""), run.results, (), templates)
        notebook = book.notebook(chapter, notebook, run.results, folder)
        found[chapter.source.stem] = notebook_text(notebook)
    return found


def _words(name: str, text: str) -> Any:
    cell = {"cell_type": "markdown", "id": name, "metadata": {}, "source": text}
    return nbformat.from_dict(cell)
