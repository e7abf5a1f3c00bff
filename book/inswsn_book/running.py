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
    """Return the parameters that a user sets, checked; ``name=value`` overrides the file.

    The path of a file that a parameter names is made absolute, unless the file lies in `data`.
    """
    content = {} if file is None else read_yaml(file) or {}
    if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
        raise InswsnError(f"{file} is not a list of parameters; it holds lines such as seed: 7.")
    values = {name: schema[name].check(value) for name, value in content.items()}
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
        from inswsn_lib.learning import load_regressor  # noqa: PLC0415  # numerics take a second

        load_regressor(parameter.name, str(value))
    if parameter.rule != FILE_RULE:
        return value
    path = Path(os.path.expanduser(str(value)))  # noqa: PTH111  # Path's own may raise
    if path.is_file():
        return str(path.resolve())
    if (data / path).is_file():
        return path.as_posix()
    raise ParameterError(parameter.name, value, f"{parameter.allowed}, and there is no such file")


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
    """Run a chapter and write what comes of it to a folder of its own, whole or not at all.

    The folder `out` is new, empty, or has nothing but an earlier run in it; by default it is one
    below ``runs/`` named for the chapter and its parameters. It holds the executed notebook, its
    results, ``parameters.yml``, what the chapter wrote for its reader, and, if asked for, the book
    rendered with this run in it.
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
        files = {f"{name}.ipynb": notebook_text(own), "parameters.yml": text, **done.files}
        for written, content in files.items():
            write_whole(made / written, content)
        write_results(done.results, made / f"{number}.json")
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
