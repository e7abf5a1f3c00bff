"""The ``inswsn`` command: what a user asks for, and how mistakes are reported.

Code that computes is imported where it is called, so that a mistake is reported at once.
"""

from __future__ import annotations

import re
import signal
import sys
import textwrap
from pathlib import Path
from typing import Any

import click

from inswsn_book.record.project import Project, find_root, is_checkout
from inswsn_lib import __version__
from inswsn_lib.errors import BuildError, Described, InswsnError, ParameterError

_PATH = click.Path(path_type=Path)
_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
_FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)
_settings = click.option(
    "-p", "settings", multiple=True, metavar="NAME=VALUE", help="Set a parameter."
)
_out = click.option("--out", type=_PATH, help="The folder to write. Default: one in runs/.")
_jobs = click.option("--jobs", type=click.IntRange(min=1), help="Processes. Default: one per core.")


@click.group()
@click.version_option(__version__, prog_name="inswsn")
@click.option("--root", type=_PATH, help="The checkout. Default: searched for from here upward.")
@click.pass_context
def cli(context: click.Context, root: Path | None) -> None:
    """Rebuild three papers on integrated navigation, chapter by chapter."""
    context.obj = root


def _project(root: Path | None) -> Project:
    # found when a command runs, so that its help needs no checkout
    if root is not None and not is_checkout(root):
        raise InswsnError(f"--root must be the folder of a checkout of inswsn, not {str(root)!r}.")
    project = Project(root.resolve() if root else find_root())
    library = project.libraries[0]
    own = project.root / library.name
    if own.is_dir() and own.resolve() != library.resolve():
        raise InswsnError(
            f"{project.root} has a library of its own, and this is the command of "
            f"{library.parent}; call the one in {project.root / '.venv'}."
        )
    return project


@cli.command()
@click.option("--fresh", is_flag=True, help="Ignore what is kept: execute and render everything.")
@_jobs
@click.pass_obj
def book(root: Path | None, fresh: bool, jobs: int | None) -> None:
    """Execute the chapters that changed and render the book.

    For example: inswsn book --jobs 1
    """
    from inswsn_book.make.chapters import build_book
    from inswsn_book.record.progress import Progress

    project = _project(root)
    with Progress() as progress:
        build_book(project, progress, fresh=fresh, jobs=jobs)
    click.echo(f"Open {project.site / 'index.html'} in a browser, or run: make serve")


@cli.command()
@click.argument("entry")
@click.argument("recording")
def judge(entry: str, recording: str) -> None:
    """Put an entry, a class in a file, on the ladder of a recording.

    RECORDING is a published one, such as inrol/1, or a folder with your logs. The file is run as it
    is, with your rights.

    For example: inswsn judge mine.py:Mine my-logs
    """
    from inswsn_lib import logs

    there = Path(recording).is_dir()
    read = logs.load("csv", recording) if there else logs.load(recording)
    click.echo(logs.judge(entry, read).round(3).to_string())


@cli.command()
@click.argument("name", required=False)
@click.pass_obj
def chapters(root: Path | None, name: str | None) -> None:
    """List the chapters with their parameters; of one chapter all that a run of it may set.

    That is its own parameters, those of its evidence, and the settings of their scenario files.

    For example: inswsn chapters 2
    """
    from inswsn_book.run.cores import asked_schema, evidence_of

    project, every = _project(root), [""] if name else []
    listed = project.chapters()
    if name:
        asked = project.find(name)
        listed = [chapter for chapter in (asked, evidence_of(project, asked)) if chapter]
    for chapter in listed:
        click.echo(chapter.source.stem)
        for parameter in asked_schema(project.root, chapter, every).parameters:
            unit = "" if parameter.unit == "1" else f" {parameter.unit}"
            click.echo(f"    {parameter.name} = {parameter.default}{unit}; {parameter.allowed}")
            click.echo(textwrap.indent(textwrap.fill(parameter.meaning, 88), "        "))


@cli.command()
@click.argument("name")
@_settings
@click.option("-f", "file", type=_FILE, help="A YAML file of parameters; -p overrides it.")
@_out
@click.option("--html", is_flag=True, help="Also render the chapter's page for this run.")
@click.option("--fresh", is_flag=True, help="Execute it even if the same run is kept.")
@click.option("--quick", is_flag=True, help="The findings of the core alone, by fewer runs.")
@click.option(
    "--only", metavar="NAME", help="A claim, number, table or figure, with the cells that it needs."
)
@click.pass_obj
def run(
    root: Path | None, /, name: str, settings: tuple[str, ...], file: Path | None, **how: Any
) -> None:
    """Ask a chapter: execute it with other parameters and tell what becomes of its findings.

    `inswsn chapters` lists the names; what a chapter's scenario files set can be set as well. A
    lesson passes on what it does not have to its evidence. A run on data of your own is not
    compared; what the chapter reports about them is printed.

    For example: inswsn run 2 -p range_noise=0.5
    """
    from inswsn_book.make.answer import ask

    for line in ask(_project(root), name, settings, file, **how):
        click.echo(line)


@cli.command()
@click.argument("name")
@click.option(
    "--grid",
    "axes",
    multiple=True,
    required=True,
    metavar="NAME=VALUE,VALUE,...",
    help="A parameter and the values that it takes. Give one --grid for each parameter.",
)
@click.option("--of", metavar="NAME", help="The finding or column that is told and drawn.")
@_settings
@_jobs
@click.option("--dask", metavar="ADDRESS", help="Compute on the Dask cluster of this scheduler.")
@_out
@click.option("--fresh", is_flag=True, help="Ignore what is kept: compute all cells.")
@click.pass_obj
def sweep(
    root: Path | None,
    /,
    name: str,
    axes: tuple[str, ...],
    of: str | None,
    settings: tuple[str, ...],
    **how: Any,
) -> None:
    """Run a chapter at each cell of a grid of its parameters.

    For example: inswsn sweep p1-training --grid q_scale=0.1,1,10 -p runs=1000

    If a chapter has a core, the function that computes its runs, each cell calls that; otherwise
    each cell executes the notebook. Finished cells are kept however the command ends, and the same
    command goes on from there; it also tries failed cells again.
    """
    from inswsn_book.make.sweep import read_sweep, run_sweep
    from inswsn_book.record.progress import Progress

    project = _project(root)
    wanted = read_sweep(project, project.find(name), axes, settings, of)
    with Progress() as progress:
        lines, failed = run_sweep(project, wanted, progress, **how)
    click.echo("\n".join(lines))
    if failed:
        raise BuildError(
            f"{failed} of {len(wanted.places)} cells failed, with the reasons in failed.csv; the "
            "same command tries them again."
        )


@cli.command()
@click.argument("before", type=_FILE)
@click.argument("after", type=_FILE)
@click.pass_obj
def compare(root: Path | None, before: Path, after: Path) -> None:
    """Compare two results files of one chapter.

    For example: inswsn compare data/published/p1-training.json results/p1-training.json
    """
    from inswsn_book.judge.ledger import LEDGER, claims_of, load_claims
    from inswsn_book.make.answer import part_of
    from inswsn_book.record.results import read_results
    from inswsn_book.run.compare import comparison

    first, second = read_results(before), read_results(after)
    if first.chapter != second.chapter:
        raise InswsnError(
            f"{before} is of chapter {first.chapter} and {after} of chapter {second.chapter}; "
            "two runs of one chapter can be compared."
        )
    claims = claims_of(load_claims(_project(root).root / LEDGER), first.chapter)
    parts = [r.provenance.only for r in (first, second) if r.provenance and r.provenance.only]
    if parts:
        first, second = part_of(first, second), part_of(second, first)
        click.echo(f"Compared is what both hold, since one is a run of a part: --only {parts[0]}.")
    click.echo("\n".join(comparison(first, second, claims)))


@cli.command()
@click.argument("name", metavar="[ID]", required=False)
@click.option("--paper", help="Only claims of this paper: P1, P2 or P3.")
@click.option("--kind", help="Only claims of this kind, such as numeric.")
@click.option(
    "--verdict",
    help="Only claims with this verdict, such as 'not reproduced'; 'not reproduced under a stated "
    "assumption' has only those that rest on one.",
)
@click.option("--json", "as_json", is_flag=True, help="Print a list of objects, for a program.")
@click.option("--results", type=_FOLDER, help="Results files to use before data/published.")
@click.option("--against", type=_FILE, help="Show what differs from earlier output of --json.")
@click.pass_obj
def claims(
    root: Path | None,
    /,
    name: str | None,
    as_json: bool,
    results: Path | None,
    against: Path | None,
    **wanted: str | None,
) -> None:
    """Print what the papers claim and what became of it; of one claim, all that is known.

    For example: inswsn claims P1-Z-01
    """
    from inswsn_book.judge import claims as judging
    from inswsn_book.run.compare import differing

    if name and any(wanted.values()):
        raise ParameterError("ID", name, "given without --paper, --kind and --verdict")
    if against is not None and (as_json or name or any(wanted.values())):
        alone = "given without an ID, --paper, --kind, --verdict and --json"
        raise ParameterError("--against", Described("with them"), alone)
    selected = judging.judge_claims(_project(root), results, name, **wanted)
    if against is not None:
        now = {entry.claim.id: entry.words for entry in selected}
        for line in differing(judging.read_verdicts(against), now):
            click.echo(line)
    elif as_json:
        click.echo(judging.verdicts_text(selected))
    elif name:
        click.echo(judging.entry_text(selected[0]))
    else:
        judging.show_claims(selected)


@cli.command()
@click.option("--check", is_flag=True, help="Only show what would change.")
@click.pass_obj
def publish(root: Path | None, check: bool) -> None:
    """Make the results of the last build the reference results.

    For example: inswsn publish --check
    """
    from inswsn_book.run.compare import changes_to_publish, publish_build

    project = _project(root)
    for line in changes_to_publish(project):
        click.echo(line)
    if not check:
        for name in publish_build(project):
            click.echo(f"wrote {name}")


@cli.command()
@click.argument("folder", type=_PATH)
def suggest(folder: Path) -> None:
    """Say what a folder of logs seems to hold, and write a recording.yaml to edit.

    For example: inswsn suggest logs
    """
    from inswsn_lib import logs

    click.echo(logs.suggest(folder))


@cli.command()
@click.argument("path", type=_FOLDER, required=False)
@click.option(
    "--execute", "names", multiple=True, metavar="NAME", help="A chapter to execute again."
)
@click.option("--digest", help="The SHA-256 that the list of digests has, by a release's text.")
@click.pass_obj
def verify(
    root: Path | None, path: Path | None, names: tuple[str, ...], digest: str | None
) -> None:
    """Check a checkout, an unpacked archive, or the folder of a run or a sweep.

    For example: inswsn verify --execute 62

    Files are checked against their digests, numbers on the pages against the results, and chapters
    that are executed again against the reference results, within their tolerances.
    """
    from inswsn_book.make.verify import verify as checks
    from inswsn_book.record.progress import Progress

    folder, differing = path.resolve() if path else _project(root).root, 0
    numbers = [_project(folder).find(name).id for name in names]
    with Progress() as progress:
        for what, differences in checks(folder, numbers, progress, digest):
            click.echo(f"{'differs' if differences else 'good':8} {what}")
            for line in differences:
                click.echo(f"         {line}")
            differing += bool(differences)
    if differing:
        raise BuildError(f"{differing} of the checks found differences.")


def _stop(number: int, _: object) -> None:
    raise KeyboardInterrupt(number)


def run_command(command: click.Command) -> None:
    """Run a command; a user's mistake is one sentence and exit status 2."""
    # a job that is cancelled, or whose terminal is closed, ends as cleanly as an interrupted one
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        # nohup has it ignored, and that is meant
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)
    try:
        for word in sys.argv[1:]:  # a name of other bytes fits into no file of results
            if re.search(r"[\ud800-\udfff]", word):
                raise InswsnError(f"the word {word!r} is not UTF-8.")
        sys.exit(command.main(standalone_mode=False, prog_name="inswsn") or 0)
    except (click.exceptions.Abort, KeyboardInterrupt) as stopped:
        cause = stopped.__cause__ if isinstance(stopped, click.exceptions.Abort) else stopped
        status, said = 128 + (cause.args[0] if cause and cause.args else signal.SIGINT), "stopped."
    except click.ClickException as error:
        error.show()
        sys.exit(2)
    except (InswsnError, BuildError) as error:
        status, said = 1 if isinstance(error, BuildError) else 2, str(error)
    except UnicodeDecodeError as error:
        status, said = 2, f"a text file of the checkout is not UTF-8: {error.reason}."
    except OSError as error:
        what = f" {error.filename}" if error.filename else ""
        status, said = 2, f"cannot read or write{what}: {error.strerror or error}."
    click.echo(f"inswsn: {said}", err=True)
    sys.exit(status)
