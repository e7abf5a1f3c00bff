"""A run of one chapter with other parameters, in a folder of its own, beside the published run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.table import Table

from inswsn_lib.artefact.execution import execute_once
from inswsn_lib.artefact.notebooks import notebook_text
from inswsn_lib.artefact.progress import Progress
from inswsn_lib.artefact.project import Chapter, Project
from inswsn_lib.artefact.rendering import render_run
from inswsn_lib.claims import Quantity, Results, write_results
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import text_digest, write_whole
from inswsn_lib.parameters import Schema, Value, chapter_schema

# A run writes this file last; a folder with it is a run, and may be written over by another.
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
    schema: Schema, settings: Iterable[str], file: Path | None
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

    Raises
    ------
    ParameterError
        If a name is not declared or set twice, or a value may not be.
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
    return values


def _read_file(path: Path) -> Mapping[str, object]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InswsnError(f"{path} is not YAML: {' '.join(str(error).split())}.") from None
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
    ChapterError
        If a cell raises. Then nothing is written.
    """
    schema = chapter_schema(project.root, chapter.number)
    complete = schema.check(values)
    text = yaml.safe_dump(complete, sort_keys=False)
    folder = out or project.root / "runs" / f"{chapter.name}-{text_digest(text)[:8]}"
    _check_folder(folder)
    executed, results = execute_once(project, chapter, values, progress)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / f"{chapter.name}.ipynb", notebook_text(executed))
    write_results(results, folder / f"{chapter.number}.json")
    if html:
        progress.say("book: rendering with this run in it")
        render_run(project, chapter, executed, folder / "html")
    write_whole(folder / _PARAMETERS, text)
    return Run(chapter, folder, results)


def _check_folder(folder: Path) -> None:
    if folder.is_dir() and (not any(folder.iterdir()) or (folder / _PARAMETERS).is_file()):
        return
    if folder.exists():
        raise ParameterError(
            "--out", str(folder), "a new or empty folder, or one of an earlier run"
        )


def show_comparison(
    before: Results, after: Results, names: tuple[str, str], console: Console
) -> None:
    """Write every quantity of two results side by side, and the sentences that differ.

    Parameters
    ----------
    before, after : Results
        Two results of one chapter.
    names : tuple of two str
        What they are, for the headings.
    console : rich.console.Console
        Where to write.
    """
    old = {quantity.name: quantity for quantity in before.quantities}
    new = {quantity.name: quantity for quantity in after.quantities}
    table = Table("quantity", *names, "change", "unit", box=None, pad_edge=False)
    changed = 0
    for name in dict.fromkeys([*old, *new]):
        a, b = old.get(name), new.get(name)
        change = _change(a, b)
        changed += bool(change)
        unit = (b or a).unit if (b or a) else ""  # type: ignore[union-attr]
        table.add_row(name, _value(a), _value(b), change, unit)
    console.print(table)
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
    console.print(
        f"{changed} of {table.row_count} quantities changed, "
        f"{len(overturned)} of {len(before.sentences)} sentences overturned.",
        markup=False,
    )


def _value(quantity: Quantity | None) -> str:
    return "absent" if quantity is None else f"{quantity.value:.6g}"


def _change(before: Any, after: Any) -> str:
    if before is None or after is None:
        return "new" if before is None else "gone"
    difference = after.value - before.value
    return f"{difference:+.3g}" if abs(difference) > 1e-12 * abs(before.value) else ""
