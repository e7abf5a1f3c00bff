"""A user's run of one chapter: its parameters from the command line, and a folder of its own."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import nbformat
import yaml

from inswsn_book.files import swap_folder, text_digest, write_whole
from inswsn_book.notebooks import notebook_text
from inswsn_book.pages import environment, render_run, with_notes
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
from inswsn_book.project import Project
from inswsn_book.results import Results, write_results
from inswsn_book.runs import SOLVERS, Request, book_runs, chosen_surroundings, run
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import read_yaml

# Lists what a run made. A folder that holds this and no more may be replaced by another run.
_MADE = ".inswsn-run"


def gather_parameters(
    schema: Schema, settings: Iterable[str], file: Path | None, data: Path
) -> dict[str, Value]:
    """Return the parameters that a user sets, checked.

    Parameters
    ----------
    settings : iterable of str
        ``name=value``, as on the command line; each name once. They override the file.
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
    number: str,
    values: Mapping[str, Value],
    progress: Progress,
    *,
    out: Path | None = None,
    html: bool = False,
    fresh: bool = False,
) -> tuple[Path, Results]:
    """Run a chapter and write what comes of it to a folder of its own.

    Parameters
    ----------
    out : Path, optional
        The folder: new, empty, or with nothing but an earlier run in it. Default: one below
        ``runs/`` in the checkout, named for the chapter and its parameters.
    html : bool
        Render the book with this run in the place of the published one, to ``html/`` in the folder.

    Returns
    -------
    folder : Path
        It holds the executed notebook, ``NN.json``, ``parameters.yml``, what the chapter wrote for
        its reader, and ``html/`` if it was rendered.
    results : Results

    Raises
    ------
    ParameterError
        If `out` is another kind of folder, or ``INSWSN_SOLVER`` names no solver.
    ChapterError, RenderingError
        If a cell raises, or the book cannot be rendered. Then nothing is written.
    InswsnError
        If `html` is asked for and the book has not been built.
    """
    name = project.find(number).name
    text = yaml.safe_dump(chapter_schema(project.root, number).check(values), sort_keys=False)
    surroundings = chosen_surroundings()
    suffix = "" if surroundings.solver == SOLVERS[0] else f"-{surroundings.solver}"
    folder = out or project.root / "runs" / f"{name}-{text_digest(text)[:8]}{suffix}"
    _check_folder(folder)
    folder = folder.resolve()
    if html:
        book_runs(project)  # refused before the chapter runs rather than after
    done = run(project, Request(number, values, surroundings), progress, fresh=fresh)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".run-") as temporary:
        made = Path(temporary) / "run"
        notebook = nbformat.reads(done.notebook, as_version=4)
        own = with_notes(notebook, done.results, (), environment(project.root))
        write_whole(made / f"{name}.ipynb", notebook_text(own))
        write_results(done.results, made / f"{number}.json")
        write_whole(made / "parameters.yml", text)
        for written, content in done.files.items():
            write_whole(made / written, content)
        if html:
            progress.say("book: rendering with this run in it")
            render_run(project, done, made / "html")
        listing = sorted(path.name for path in made.iterdir())
        write_whole(made / _MADE, "\n".join(listing) + "\n")
        swap_folder(made, folder)
    return folder, done.results


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
