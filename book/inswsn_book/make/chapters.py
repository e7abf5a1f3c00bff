"""What ``inswsn run`` and ``inswsn book`` do: one chapter into a folder, all into a site."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import yaml

from inswsn_book.make.site import check_pages, render_book, render_run
from inswsn_book.record import parameters
from inswsn_book.record.files import (
    check_folder,
    check_listed,
    made_folder,
    remove_left,
    text_digest,
    tree_digest,
    write_whole,
)
from inswsn_book.record.notebooks import with_answer
from inswsn_book.record.parameters import Parameter, Schema, Value, chapter_schema
from inswsn_book.record.progress import Progress
from inswsn_book.record.project import Chapter, Project
from inswsn_book.record.results import Results, write_results
from inswsn_book.run import store
from inswsn_book.run.compare import check_kept_studies
from inswsn_book.run.cores import asked_schema, evidence_of
from inswsn_lib.errors import Described, InswsnError, ParameterError
from inswsn_lib.files import read_yaml

#: What a chapter may write for a reader with data of their own
REPORT = "report.txt"
#: What `run` writes of everything that differs from the published run
COMPARISON = "comparison.txt"


def own_data(schema: Schema, values: Mapping[str, Value]) -> bool:
    """Tell whether one of the parameters that a user sets names a file or a folder."""
    named = (parameters.FILE_RULE, parameters.FOLDER_RULE)
    return any(schema[name].rule in named for name in values)


def chapter_with(
    project: Project, chapter: Chapter, names: Iterable[str], *, quick: bool = False
) -> Chapter:
    """Return the chapter that has these parameters: itself or else its evidence, if quick this.

    A name that neither has is refused, with the nearest.
    """
    wanted, both = [*names], [c for c in (chapter, evidence_of(project, chapter)) if c]
    own, its = (chapter_schema(project.root, c.id).defaults.keys() for c in (chapter, both[-1]))
    if quick and not (own - its) & {*wanted}:  # of what the evidence has in its scene alone
        both.reverse()
    schemas = [(c, asked_schema(project.root, c, wanted)) for c in both]
    for each, schema in schemas:
        if set(wanted) <= schema.defaults.keys():
            return each
    all_of_them = {p.name: p for _, schema in schemas for p in schema.parameters}
    for name in wanted:
        Schema((*all_of_them.values(),))[name]  # which refuses one that is nowhere
    raise ParameterError("parameters", Described(", ".join(wanted)), "all of one chapter")


def parameters_in(file: Path) -> dict[str, object]:
    """Return what a YAML file of parameters holds."""
    content = read_yaml(file) or {}
    if not isinstance(content, dict) or not all(isinstance(name, str) for name in content):
        raise InswsnError(f"{file} is not a list of parameters; it holds lines such as seed: 7.")
    return content


def gather_parameters(
    schema: Schema, settings: Iterable[str], file: Path | None, data: Path
) -> dict[str, Value]:
    """Return the parameters that a user sets, checked; ``name=value`` overrides the file.

    The path of a file or folder that a parameter names is made absolute, unless it lies in `data`.
    """
    content = {} if file is None else parameters_in(file)
    values = {name: schema[name].check(value) for name, value in content.items()}
    seen: set[str] = set()
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise ParameterError("-p", setting, "of the form name=value")
        if name in seen:
            raise ParameterError("-p", Described("twice"), f"given only once for {name}")
        seen.add(name)
        values[name] = schema[name].read(text)
    return {name: _found(schema[name], value, data) for name, value in values.items()}


def _found(parameter: Parameter, value: Value, data: Path) -> Value:
    """Look for a file that a parameter names, and try a regressor."""
    if parameter.rule == parameters.REGRESSOR_RULE:
        from inswsn_lib.learning import load_regressor  # noqa: PLC0415  # numerics take a second

        load_regressor(parameter.name, str(value))
    kinds = {parameters.FILE_RULE: Path.is_file, parameters.FOLDER_RULE: Path.is_dir}
    if parameter.rule not in kinds:
        return value
    path = Path(os.path.expanduser(str(value)))  # noqa: PTH111  # Path's own may raise
    if kinds[parameter.rule](path):
        return str(path.resolve())
    if kinds[parameter.rule](data / path):
        return path.as_posix()
    what = parameter.rule.removeprefix("a ")
    raise ParameterError(parameter.name, value, f"{parameter.allowed} (there is no such {what})")


def run_chapter(
    project: Project,
    request: store.Request,
    progress: Progress,
    tell: Callable[[Results, Path], tuple[list[str], list[str]]],
    *,
    out: Path | None = None,
    html: bool = False,
    fresh: bool = False,
    only: str | None = None,
    changed: Iterable[str] = (),
) -> tuple[Path, list[str]]:
    """Run a chapter, or `only` a part, into a folder of its own, whole or not at all.

    That is the executed notebook, its results, ``parameters.yml``, what the chapter wrote for its
    reader, and, if asked for, the chapter's page of this run. `tell` gives, of the results and the
    folder, the lines of the answer, which are returned with it, and those of `COMPARISON`. Each
    part, and each state of files that were changed, has a folder of its own.
    """
    number, values = request.chapter, request.parameters
    name = project.by_id(number).source.stem
    schema = asked_schema(project.root, project.by_id(number), values)
    every = schema.check(values).items()
    given = {n: v for n, v in every if n in values or not schema[n].scenario}
    text = yaml.safe_dump(given, sort_keys=False)
    edits = [path for path in map(project.root.joinpath, changed) if path.is_file()]
    key = text_digest(text + (only or "") + (tree_digest(project.root, edits) if edits else ""))
    folder = out or project.root / "runs" / f"{name}-{key[:8]}"
    check_folder(folder)
    done = store.run(project, request, progress, fresh=fresh)
    results = done.results
    if only and results.provenance:
        of_part = results.provenance.model_copy(update={"only": only})
        results = results.model_copy(update={"provenance": of_part})
    answer, lines = tell(results, folder.resolve())
    from inswsn_book.make.pages import plain_notebooks  # noqa: PLC0415  # takes long

    files = {"parameters.yml": text, "answer.txt": "\n".join([*answer, ""]), **done.files}
    if done.notebook:
        (own,) = plain_notebooks(project, [done], folder.resolve()).values()
        files |= {f"{name}.ipynb": own, COMPARISON: "\n".join([*lines, ""])}
    with made_folder(folder) as made:
        for written, content in files.items():
            write_whole(made / written, content)
        write_results(results, made / f"{number}.json")
        if html:
            progress.say(f"{name}: rendering its page")
            page = replace(done, notebook=with_answer(done.notebook or "", answer))
            render_run(project, page, made / "html")
    return folder.resolve(), answer


def build_book(
    project: Project, progress: Progress, *, fresh: bool = False, jobs: int | None = None
) -> None:
    """Execute what is due and render the book; refuse a chapter that may not stand in it."""
    with project.build_lock():
        remove_left(project.build)
        check_pages(project)  # before the chapters, which take long
        check_listed(project.published)
        requests = [store.Request(chapter.id) for chapter in project.chapters()]
        made = store.run_all(project, requests, progress, _check, fresh=fresh, jobs=jobs)
        check_kept_studies(project, made, progress, fresh=fresh)
        render_book(project, made, progress, fresh=fresh)
        for run in made:
            write_results(run.results, project.results / f"{run.request.chapter}.json")


def _check(place: int, outcome: store.Outcome) -> None:
    """Refuse a run in which a sentence of the page does not hold."""
    store.raise_failure(place, outcome)
    assert isinstance(outcome, store.Run)
    untrue = [f"  {said}" for said, held in outcome.results.sentences.items() if not held]
    if untrue:
        raise store.ChapterError(
            f"Chapter {outcome.request.chapter} has sentences that its results do not bear out:\n"
            + "\n".join(untrue)
        )
