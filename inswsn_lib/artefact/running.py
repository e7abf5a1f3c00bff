"""A run of one chapter with other parameters, in a folder of its own, beside the published run."""

from __future__ import annotations

import copy
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml
from rich.console import Console
from rich.table import Table

from inswsn_lib.artefact.execution import execute_once
from inswsn_lib.artefact.notebooks import notebook_text
from inswsn_lib.artefact.pages import with_links_and_provenance
from inswsn_lib.artefact.progress import Progress
from inswsn_lib.artefact.project import Chapter, Project
from inswsn_lib.artefact.rendering import render_run, require_built, swap_folder
from inswsn_lib.claims import (
    LEDGER,
    Change,
    Claim,
    Quantity,
    Results,
    claims_of,
    flipped_verdicts,
    load_claims,
    pair_quantities,
    write_results,
)
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_yaml, text_digest, write_whole
from inswsn_lib.parameters import FILE_RULE, Parameter, Schema, Value, chapter_schema

# A folder with this file in it is a run, and may be replaced by another.
_PARAMETERS = "parameters.yml"


@dataclass(frozen=True)
class Run:
    """A finished run.

    Attributes
    ----------
    chapter : Chapter
        The chapter.
    folder : Path
        Where its files are: the executed notebook, ``NN.json``, ``parameters.yml``, and ``html/``
        if it was rendered.
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
        If a name is not declared or set twice, a value may not be, or there is no such file.
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
    return {name: _found_file(schema[name], value, data) for name, value in values.items()}


def _found_file(parameter: Parameter, value: Value, data: Path) -> Value:
    if parameter.rule != FILE_RULE:
        return value
    path = Path(str(value)).expanduser()
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
        The folder: new, empty, or of an earlier run. Default: one below ``runs/`` in the checkout,
        named for the chapter and its parameters.
    html : bool
        Render the book with this run in the place of the published one, to ``html/`` in the folder.

    Raises
    ------
    ParameterError
        If `out` is another kind of folder.
    ChapterError, RenderingError
        If a cell raises, or the book cannot be rendered. Then nothing is written.
    InswsnError
        If `html` is asked for and the book has not been built.
    """
    schema = chapter_schema(project.root, chapter.number)
    text = yaml.safe_dump(schema.check(values), sort_keys=False)
    folder = out or project.root / "runs" / f"{chapter.name}-{text_digest(text)[:8]}"
    _check_folder(folder)
    folder = folder.resolve()
    if html:
        require_built(project)
    executed, results = execute_once(project, chapter, values, progress)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".run-") as name:
        made = Path(name) / "run"
        own = with_links_and_provenance(copy.deepcopy(executed), results, ())
        write_whole(made / f"{chapter.name}.ipynb", notebook_text(own))
        write_results(results, made / f"{chapter.number}.json")
        write_whole(made / _PARAMETERS, text)
        if html:
            progress.say("book: rendering with this run in it")
            render_run(project, chapter, executed, results, made / "html")
        swap_folder(made, folder)
    return Run(chapter, folder, results)


def _check_folder(folder: Path) -> None:
    if folder.is_dir() and (not any(folder.iterdir()) or (folder / _PARAMETERS).is_file()):
        return
    if folder.exists():
        raise ParameterError(
            "--out", str(folder), "a new or empty folder, or one of an earlier run"
        )


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
    for name in dict.fromkeys([*before.parameters, *after.parameters]):
        a_value, b_value = before.parameters.get(name), after.parameters.get(name)
        if a_value != b_value:
            console.print(f"parameter {name}: {a_value} -> {b_value}", markup=False)
    overturned = [
        sentence
        for sentence, held in before.sentences.items()
        if held != after.sentences.get(sentence, held)
    ]
    for sentence in overturned:
        state = "no longer holds" if before.sentences[sentence] else "holds now"
        console.print(f"{state}: {sentence}", markup=False, soft_wrap=True)
    flips = flipped_verdicts(claims, before, after)
    for flip in flips:
        console.print(f"verdict {flip}", markup=False, soft_wrap=True)
    console.print(
        f"{changed} of {len(changes)} quantities changed, "
        f"{len(overturned)} of {len(before.sentences)} sentences overturned, "
        f"{len(flips)} of {len(claims)} verdicts flipped.",
        markup=False,
    )


def _value(quantity: Quantity | None) -> str:
    return "absent" if quantity is None else f"{quantity.value:.6g}"


def _difference(pair: Change) -> str:
    if pair.before is None or pair.after is None:
        return "new" if pair.before is None else "gone"
    difference = pair.after.value - pair.before.value
    return f"{difference:+.3g}" if abs(difference) > 1e-12 * abs(pair.before.value) else ""
