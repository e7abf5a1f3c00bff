"""A run of one chapter with other parameters, in a folder of its own, beside the published run."""

from __future__ import annotations

import copy
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml
from rich.console import Console
from rich.table import Table

from inswsn_book.compare import (
    Change,
    compare_conditions,
    flipped_verdicts,
    pair_quantities,
)
from inswsn_book.execution import SOLVERS, chosen_surroundings, execute_once
from inswsn_book.files import text_digest, write_whole
from inswsn_book.ledger import LEDGER, Claim, claims_of, load_claims
from inswsn_book.notebooks import notebook_text
from inswsn_book.pages import with_links_and_provenance
from inswsn_book.parameters import (
    FILE_RULE,
    REGRESSOR_RULE,
    Parameter,
    Schema,
    Value,
    chapter_schema,
)
from inswsn_book.plugins import load_regressor
from inswsn_book.progress import Progress
from inswsn_book.project import Chapter, Project
from inswsn_book.rendering import render_run, require_built, swap_folder
from inswsn_book.results import Quantity, Results, write_results
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_yaml

_PARAMETERS = "parameters.yml"
# Lists what a run made. A folder that holds this and no more may be replaced by another run.
_MADE = ".inswsn-run"


@dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes
    ----------
    chapter : Chapter
        The chapter.
    folder : Path
        Where its files are: the executed notebook, ``NN.json``, ``parameters.yml``, what the
        chapter wrote for its reader, and ``html/`` if it was rendered.
    results : Results
        What it recorded.
    """

    chapter: Chapter
    folder: Path
    results: Results


def find_chapter(project: Project, word: str) -> Chapter:
    """Return the chapter of a number or a name.

    Parameters
    ----------
    project : Project
        The checkout.
    word : str
        A number such as ``"02"`` or ``"2"``, or the whole name.

    Raises
    ------
    ParameterError
        If there is no such chapter.
    """
    chapters = project.chapters()
    for chapter in chapters:
        if word in (chapter.number, str(int(chapter.number)), chapter.name):
            return chapter
    raise ParameterError(
        "NAME", word, "one of " + ", ".join(chapter.number for chapter in chapters)
    )


def gather_parameters(
    schema: Schema, settings: Iterable[str], file: Path | None, data: Path
) -> dict[str, Value]:
    """Return the parameters that a user sets, checked.

    Parameters
    ----------
    schema : Schema
        The declared parameters.
    settings : iterable of str
        ``name=value``, as on the command line; each name once. They override the file.
    file : Path, optional
        A YAML file of names and values.
    data : Path
        The folder ``data`` of the checkout. The path of a file that a parameter names is made
        absolute, unless the file lies there.

    Raises
    ------
    ParameterError
        If a name is not declared or set twice, a value may not be, or there is no such file or
        regressor.
    InswsnError
        If the file cannot be read.
    """
    values: dict[str, Value] = {}
    if file is not None:
        values = {name: schema[name].check(value) for name, value in _read_file(file).items()}
    seen: set[str] = set()
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise ParameterError("-p", setting, "name=value")
        if name in seen:
            raise ParameterError("-p", setting, f"given once: {name} is set twice")
        seen.add(name)
        values[name] = schema[name].read(text)
    return {name: _found(schema[name], value, data) for name, value in values.items()}


def _found(parameter: Parameter, value: Value, data: Path) -> Value:
    """Look for a file that a parameter names, and try a regressor."""
    if parameter.rule == REGRESSOR_RULE:
        load_regressor(parameter.name, str(value))
    if parameter.rule != FILE_RULE:
        return value
    try:
        path = Path(str(value)).expanduser()
    except RuntimeError:  # ~name, and there is no such user
        path = Path(str(value))
    if path.is_file():
        return str(path.resolve())
    if (data / path).is_file():
        return path.as_posix()
    raise ParameterError(parameter.name, value, f"{parameter.allowed}, and there is no such file")


def _read_file(path: Path) -> Mapping[str, object]:
    content = read_yaml(path)
    content = {} if content is None else content
    if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
        raise InswsnError(f"{path} is not a list of parameters; it holds lines such as seed: 7.")
    return content


def run_chapter(
    project: Project,
    chapter: Chapter,
    values: Mapping[str, Value],
    progress: Progress,
    *,
    out: Path | None = None,
    html: bool = False,
) -> Run:
    """Execute a chapter with other parameters into a folder of its own.

    Parameters
    ----------
    project : Project
        The checkout.
    chapter : Chapter
        The chapter.
    values : mapping of str to value
        Checked values; the others keep their defaults.
    progress : Progress
        Told of each cell.
    out : Path, optional
        The folder: new, empty, or with nothing but an earlier run in it. Default: one below
        ``runs/`` in the checkout, named for the chapter and its parameters.
    html : bool
        Render the book with this run in the place of the published one, to ``html/`` in the folder.

    Raises
    ------
    ParameterError
        If `out` is another kind of folder, or ``INSWSN_SOLVER`` names no solver.
    ChapterError, RenderingError
        If a cell raises, or the book cannot be rendered. Then nothing is written.
    InswsnError
        If `html` is asked for and the book has not been built.
    """
    schema = chapter_schema(project.root, chapter.number)
    text = yaml.safe_dump(schema.check(values), sort_keys=False)
    surroundings = chosen_surroundings()
    suffix = "" if surroundings.solver == SOLVERS[0] else f"-{surroundings.solver}"
    folder = out or project.root / "runs" / f"{chapter.name}-{text_digest(text)[:8]}{suffix}"
    _check_folder(folder)
    folder = folder.resolve()
    if html:
        require_built(project)
    executed, results, files = execute_once(project, chapter, values, progress, surroundings)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".run-") as name:
        made = Path(name) / "run"
        own = with_links_and_provenance(copy.deepcopy(executed), results, ())
        write_whole(made / f"{chapter.name}.ipynb", notebook_text(own))
        write_results(results, made / f"{chapter.number}.json")
        write_whole(made / _PARAMETERS, text)
        for written, content in files.items():
            write_whole(made / written, content)
        if html:
            progress.say("book: rendering with this run in it")
            render_run(project, chapter, executed, results, made / "html")
        listing = sorted(path.name for path in made.iterdir())
        write_whole(made / _MADE, "\n".join(listing) + "\n")
        swap_folder(made, folder)
    return Run(chapter, folder, results)


def _check_folder(folder: Path) -> None:
    held = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    made = folder / _MADE
    listed = set(made.read_text(encoding="utf-8").split("\n")) if made.is_file() else set()
    if (folder.exists() and not folder.is_dir()) or not held <= listed | {_MADE}:
        raise ParameterError(
            "--out", str(folder), "a new or empty folder, or one that holds an earlier run alone"
        )
    # told before the chapter runs rather than after
    above = next(path for path in (folder.resolve(), *folder.resolve().parents) if path.exists())
    if not above.is_dir() or not os.access(above, os.W_OK):
        raise ParameterError("--out", str(folder), f"where one can write, and {above} is not")


def claims_of_chapter(project: Project, chapter: str) -> list[Claim]:
    """Return the claims of the checkout's ledger that a chapter decides."""
    return claims_of(load_claims(project.root / LEDGER), chapter)


def show_comparison(
    before: Results,
    after: Results,
    claims: Sequence[Claim],
    names: tuple[str, str],
    console: Console,
) -> None:
    """Write two results side by side: quantities, sentences that differ, verdicts that flipped.

    Parameters
    ----------
    before, after : Results
        Two results of one chapter.
    claims : sequence of Claim
        The claims that the chapter decides.
    names : tuple of two str
        What they are, for the headings.
    console : rich.console.Console
        Where to write.
    """
    table = Table("quantity", *names, "change", "unit", box=None, pad_edge=False)
    changes = [(pair, _difference(pair)) for pair in pair_quantities(before, after)]
    for pair, difference in changes:
        table.add_row(pair.name, _value(pair.before), _value(pair.after), difference, pair.unit)
    console.print(table)
    changed = sum(bool(difference) for _, difference in changes)

    def say(line: str) -> None:
        console.print(line, markup=False, soft_wrap=True)

    for pair, _ in changes:
        if pair.details:
            say(f"{pair.name}: {'; '.join(pair.details)}")
    for line in compare_conditions(before, after):
        if not line.startswith(("sentences: ", "cells: ")):
            say(line)
    overturned = _overturned(before.sentences, after.sentences)
    for line in overturned:
        say(line)
    flips = flipped_verdicts(claims, before, after)
    for flip in flips:
        say(f"verdict {flip}")
    sentences = len(set(before.sentences) | set(after.sentences))
    say(
        f"{changed} of {len(changes)} quantities changed, "
        f"{len(overturned)} of {sentences} sentences overturned, "
        f"{len(flips)} of {len(claims)} verdicts flipped."
    )


def _overturned(before: Mapping[str, bool], after: Mapping[str, bool]) -> list[str]:
    """Return a line for each sentence that holds in one run and not in the other."""
    lines = []
    for sentence in dict.fromkeys([*before, *after]):
        old, new = before.get(sentence), after.get(sentence)
        if old != new and False in (old, new):
            lines.append(f"{'no longer holds' if new is False else 'holds now'}: {sentence}")
        elif old != new:
            lines.append(f"{'gone' if new is None else 'new'}: {sentence}")
    return lines


def _value(quantity: Quantity | None) -> str:
    return "absent" if quantity is None else f"{quantity.value:.6g}"


def _difference(pair: Change) -> str:
    if pair.before is None or pair.after is None:
        return "new" if pair.before is None else "gone"
    difference = pair.after.value - pair.before.value
    if abs(difference) > 1e-12 * abs(pair.before.value):
        return f"{difference:+.3g}"
    return "otherwise" if pair.details else ""
