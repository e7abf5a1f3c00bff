"""`inswsn run` and `inswsn book` on a small project: what they leave, and how they fail or end."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from conftest import (
    Command,
    MiniProject,
    assert_plain,
    build_once,
    files_of,
    run_command,
    unprivileged,
    weekly_but,
)  # fmt: skip
from inswsn_book.make import chapters
from inswsn_book.make.chapters import gather_parameters
from inswsn_book.make.live import main as live
from inswsn_book.make.site import RenderingError
from inswsn_book.record.files import damages, write_whole
from inswsn_book.record.parameters import read_schema
from inswsn_book.record.project import MODULES_VARIABLE
from inswsn_book.record.results import read_results

from inswsn_lib.errors import InswsnError

# The parameters of a run -------------------------------------------------------------------------

SCHEMA = read_schema("""\
# A number.
scale: float = 2.0  # 1; in (0, 100]
# A file.
name: str = 'given.csv'  # 1; a file
# A method, of which the default is not tried: the published run has.
learner: str = 'no.such:Thing'  # 1; a regressor
""")
LINEAR = "sklearn.linear_model:LinearRegression"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a file of the reader's own, and one of the project's below data."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delenv(MODULES_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    for name in ("own.csv", "data/given.csv"):
        (tmp_path / name).touch()
    return tmp_path


@pytest.mark.parametrize(
    ("text", "settings", "found"),
    [
        ("", [], {}),
        ("scale: 5\n", [], {"scale": 5.0}),
        ("scale: 5\n", ["scale=4"], {"scale": 4.0}),
        # one of the project's stays a name, so that a results file is the same on every machine
        ("", ["name=given.csv"], {"name": "given.csv"}),
        ("name: own.csv\n", [], {"name": "HERE/own.csv"}),
        ("learner: sklearn.linear_model:Nobody\n", [f"learner={LINEAR}"], {"learner": LINEAR}),
        ("scale: [", [], "is not YAML"),
        ("- scale", [], "is not a list of parameters"),
        ("7: 1", [], "is not a list of parameters"),
        ("scale: '3'", [], "scale must be a number in (0, 100], not '3'"),
        ("scale: true", [], "scale must be a number in (0, 100], not True"),
        ("other: 1", [], "parameter must be one of "),
        ("", ["name=none.csv"], "there is no such file"),
        ("", ["learner=nonsense"], "learner must be the package.module:name"),
        ("learner: sklearn.linear_model:Nobody\n", [], "has no attribute 'Nobody'"),
    ],
)
def test_the_parameters_of_a_file_and_of_the_command_line(
    here: Path, text: str, settings: list[str], found: dict | str
) -> None:
    file, said = here / "params.yml", ""
    file.write_text(text)
    try:
        assert gather_parameters(SCHEMA, settings, file, here / "data") == {
            name: value.replace("HERE", str(here.resolve())) if isinstance(value, str) else value
            for name, value in dict(found).items()
        }
    except InswsnError as error:
        said = str(error)
    assert (found in said) if isinstance(found, str) else said == ""


# One chapter into a folder -----------------------------------------------------------------------


def test_a_run_and_its_comparison(built: MiniProject, tmp_path: Path, inswsn: Command) -> None:
    assert inswsn(built.root, "publish").returncode == 0
    kept = {path: files_of(path) for path in (built.published, built.results, built.site)}
    out, file = tmp_path / "out", tmp_path / "params.yml"
    done = inswsn(built.root, "run", "00", "-p", "scale=3", "--out", str(out), "--html")
    assert done.returncode == 0, done.stderr
    *answer, where = done.stdout.splitlines()
    assert answer == [
        "00 with scale = 3.0 (published: 2.0):",
        "- twice (The number in the file, scaled): 42 m -> 63 m",
        "0 of 0 sentences are no longer true.",
        "1 of 1 verdicts differ: P1-M-twice (adds up in print -> contradicted by the paper "
        "itself).",
    ]
    assert f"In {out}: notebook 00-mini.ipynb, page html/chapters/00-mini.html" in where
    assert (out / "answer.txt").read_text() == done.stdout
    assert (out / "comparison.txt").read_text().splitlines() == [
        "parameters: scale: 2.0 -> 3.0",
        "twice: 42 m -> 63 m (change +21, tolerance 0.5)",
        "verdict P1-M-twice: adds up in print -> contradicted by the paper itself (No numbers that "
        "round to the printed cells allow it.)",
        "1 of 1 quantities changed, 0 of 0 sentences overturned, 1 of 1 verdicts flipped.",
    ]
    assert read_results(out / "00.json").parameters == {"scale": 3.0}
    assert (out / "parameters.yml").read_text() == "scale: 3.0\n"
    notebook = (out / "00-mini.ipynb").read_text()
    assert "## Provenance" in notebook
    assert "The number is **63**." in notebook
    assert_plain(notebook)
    (download,) = (built.site / "_sources").rglob("*.ipynb")
    assert "The number is **42**." in download.read_text()
    assert_plain(download.read_text())
    # its page alone, in the style of the book, to which its links lead
    page = (out / "html" / "chapters" / "00-mini.html").read_text()
    assert ">63<" in page
    assert f'href="{(built.site / "claims.html").as_uri()}' in page
    assert (out / "html" / "_static" / "inswsn.css").is_file()
    assert not (out / "html" / "claims.html").exists()
    # the published results, the last build and its site are what they were
    assert kept == {path: files_of(path) for path in kept}
    assert "00-mini: unchanged" in inswsn(built.root, "book").stderr

    # a file of parameters; the folder of an earlier run may be used again
    file.write_text("scale: 5\n")
    assert inswsn(built.root, "run", "00-mini", "-f", str(file), "--out", str(out)).returncode == 0
    assert read_results(out / "00.json")["twice"].value == 105
    assert not (out / "html").exists()  # a page of the earlier run would belie this one
    # overridden, into a folder of its own: it is found
    done = inswsn(built.root, "run", "00", "-f", str(file), "-p", "scale=3")
    assert done.stderr == "00-mini: unchanged\n"
    (folder,) = (built.root / "runs").iterdir()
    assert f"In {folder}: " in done.stdout.splitlines()[-1]


def test_the_page_of_a_run_needs_no_book(
    mini: MiniProject, tmp_path: Path, inswsn: Command
) -> None:
    done = inswsn(mini.root, "run", "00", "--html", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "out" / "html" / "chapters" / "00-mini.html").read_text()
    assert ">42<" in page
    assert "P1-M-twice" in page  # named, and there is no page to link to
    assert "claims.html" not in page
    _, _, rest = page.partition("</h1>")
    assert rest.index("verdicts differ") < rest.index(">42<")


def test_a_run_that_fails_writes_nothing(
    built: MiniProject, inswsn: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RenderingError("Sphinx has warned.")

    monkeypatch.setattr(chapters, "render_run", fail)
    done = inswsn(built.root, "run", "00", "--html")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.endswith("inswsn: Sphinx has warned.\n")
    # what the library refuses in a cell is one sentence
    built.chapter(
        "from inswsn_lib.errors import ParameterError\n"
        "raise ParameterError('scale', scale, 'at most 50 here')"
    )
    done = inswsn(built.root, "run", "00", "-p", "scale=60")
    assert (done.returncode, done.stdout, "Traceback" in done.stderr) == (2, "", False)
    assert done.stderr.splitlines()[-1] == "inswsn: scale must be at most 50 here, not 60.0."
    assert list((built.root / "runs").iterdir()) == []


# All chapters into a site ------------------------------------------------------------------------


def test_a_build_and_the_builds_after_it(
    built: MiniProject,
    built_mini: Path,
    released_mini: Path,
    inswsn: Command,
    what_stays: Callable[[MiniProject], list[object]],
) -> None:
    said = build_once(built_mini, built_mini.with_suffix(".json"))
    assert "00-mini: executed in" in said
    assert f"Open {built_mini / '_build' / 'html' / 'index.html'}" in said
    assert ">42<" in (built.site / "chapters" / "00-mini.html").read_text()
    first = read_results(built.results / "00.json")
    assert first["twice"].value == 42.0

    # nothing changed: nothing is executed, nothing rendered, the site is not touched
    before, stays = files_of(built.site), what_stays(built)
    assert inswsn(built.root, "book").stderr == "00-mini: unchanged\nbook: unchanged\n"
    assert files_of(built.site) == before

    # all of it anew, in a process of its own: the same, but for what it was made with
    done = run_command(built.root, "book", "--fresh")
    assert "00-mini: executed in" in done.stderr
    assert "book: rendering" in done.stderr
    assert what_stays(built) == stays
    assert read_results(built.results / "00.json") != first

    # a page changed: rendered, not executed
    said = build_once(released_mini, released_mini.with_suffix(".json"))
    assert "00-mini: unchanged\nbook: rendering, since its sources have changed\n" in said
    assert "Another page." in (released_mini / "_build" / "html" / "index.html").read_text()


TOC, LEDGER = "book/_toc.yml", "data/claims/mini.yaml"
BY_HAND = [
    (TOC, "- file: chapters/00-mini", "", "book/_toc.yml does not list chapters/00-mini"),
    (TOC, "claims", "chapters/01-gone", "lists chapters/01-gone, and there is no such chapter"),
    (TOC, "format: jb-book", "format: [", "_toc.yml is not YAML"),
    ("_config.yml", "\n", "\n[", "_config.yml is not YAML"),
    ("CITATION.cff", "\ntitle:", "\nt:", "CITATION.cff is not a citation file: it lacks 'title'"),
    (LEDGER, "digits,", "digits, verdict: reproduced,", "P1-M-twice: verdict: Extra inputs are"),
    (LEDGER, "quantity: twice", "quantity: thrice", "thrice, which chapter 00 does not record"),
]


@pytest.mark.parametrize(("name", "old", "new", "said"), BY_HAND)
def test_what_is_wrong_by_hand_stops_a_build_before_anything_runs(
    built: MiniProject, inswsn: Command, name: str, old: str, new: str, said: str
) -> None:
    before, path = files_of(built.site), built.root / name
    path.write_text(path.read_text().replace(old, new))
    done = inswsn(built.root, "book")
    assert done.returncode == 2
    assert said in done.stderr.splitlines()[-1]
    assert "executing" not in done.stderr
    it_is_as_before(built, before)


def it_is_as_before(built: MiniProject, site: dict[str, bytes]) -> None:
    assert files_of(built.site) == site  # with its key: the next build renders again
    assert list(built.build.glob(".inswsn-*")) == []


def test_a_cell_that_raises_fails_the_build(built: MiniProject) -> None:
    before = files_of(built.site)
    built.chapter("reason = 'the sky fell'\nraise RuntimeError(reason)")
    done = run_command(built.root, "book")
    assert done.returncode == 1
    assert "Chapter 00-mini failed in cell 5 of 6 (ch00-004)" in done.stderr
    assert "raise RuntimeError(reason)" in done.stderr
    assert "RuntimeError: the sky fell" in done.stderr
    it_is_as_before(built, before)


def test_a_sentence_that_is_not_so_fails_the_build(built: MiniProject, inswsn: Command) -> None:
    """A run by hand goes on; the book refuses it, also from the store."""
    before = files_of(built.site)
    built.chapter("record.holds('Twice it is odd.', 2 * number % 2 == 1)")
    assert inswsn(built.root, "run", "00").returncode == 0
    done = inswsn(built.root, "book")
    assert done.returncode == 1
    assert "00-mini: unchanged" in done.stderr
    assert "has sentences that its results do not bear out:\n  Twice it is odd." in done.stderr
    it_is_as_before(built, before)


# what Sphinx warns of, and what is found when the pages are written
FAULTS = {
    "See {ref}`nowhere`.": "undefined label: 'nowhere'",
    "See {numref}`fig-nowhere`.": "undefined label: 'fig-nowhere'",
    "See {py:func}`inswsn_lib.nothing`.": "inswsn_lib.nothing",
    "See [there](nothing.md).": "nothing.md",
    "```{figure} _static/missing.png\nA figure.\n```": "missing.png",
    '<img src="_static/nothing.png" alt="A figure">': "nothing.png leads to no file",
    '<a href="chapters/00-mini.html#nothing">there</a>': "#nothing leads to no element",
    "![](_static/favicon.svg)": "no alternative text",
    '<script src="https://a.example/x.js"></script>': "takes https://a.example/x.js from another",
}


def test_pages_that_do_not_hold_together_fail_the_build(built: MiniProject) -> None:
    """One build has all faults, since each rendering takes seconds; each is named."""
    before = files_of(built.site)
    built.page("\n\n".join(FAULTS))
    claims = built.root / "book" / "claims.md"
    claims.write_text(claims.read_text() + "\n{{ nothing.of_the_kind }}\n")
    done = run_command(built.root, "book")
    assert done.returncode == 1, done.stdout + done.stderr
    # what is to be edited is named, not what was staged
    said = ["book/index.md:3: WARNING", "book/claims.md: WARNING: 'nothing' is undefined"]
    assert [words for words in (*FAULTS.values(), *said) if words not in done.stderr] == []
    assert "Traceback" not in done.stderr
    it_is_as_before(built, before)


# What ends a build from outside ------------------------------------------------------------------


def start_slow_build(project: MiniProject) -> tuple[subprocess.Popen[str], list[int]]:
    """Start a build whose chapter sleeps; return it and the ids of its kernel and its worker."""
    marker = project.root / "kernel-pid"
    project.chapter(
        "import os, pathlib, time\n"
        f"pathlib.Path({str(marker)!r}).write_text(f'{{os.getpid()}} {{os.getppid()}}')\n"
        "time.sleep(120)"
    )
    process = subprocess.Popen(
        [sys.executable, "-m", "inswsn_book", "--root", str(project.root), "book"],
        stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    assert waited(600, lambda: marker.is_file() and marker.read_text()), "it did not start"
    return process, [int(word) for word in marker.read_text().split()]


def waited(seconds: float, for_what: Callable[[], object]) -> bool:
    end = time.monotonic() + seconds
    while not (came := for_what()) and time.monotonic() < end:
        time.sleep(0.1)
    return bool(came)


@pytest.mark.usefixtures("as_in_a_terminal")
@pytest.mark.parametrize("how", weekly_but({"SIGHUP"}, ["SIGINT", "SIGTERM", "SIGHUP", "SIGKILL"]))
def test_a_build_that_is_ended_leaves_nothing(
    built: MiniProject, inswsn: Command, how: str
) -> None:
    before, number = files_of(built.site), getattr(signal, how)
    process, others = start_slow_build(built)
    meanwhile = inswsn(built.root, "book")
    process.send_signal(number)
    _, said = process.communicate(timeout=600)
    assert meanwhile.returncode == 2
    assert meanwhile.stderr.startswith(f"inswsn: Another build of {built.root} is running")
    for pid in others:
        assert waited(300, lambda pid=pid: not psutil.pid_exists(pid)), "it was left running"
    if how != "SIGKILL":
        assert process.returncode == 128 + number, said
        assert said.strip().endswith("inswsn: stopped.")
        it_is_as_before(built, before)
    built.chapter()
    assert inswsn(built.root, "book").returncode == 0  # the next build is as good as ever
    it_is_as_before(built, before)


@pytest.mark.parametrize("how", weekly_but(set(), ["SIGTERM", "SIGKILL"]))
def test_the_rendering_ends_with_the_command(built: MiniProject, inswsn: Command, how: str) -> None:
    built.page("Another page.")
    process = subprocess.Popen(
        [sys.executable, "-m", "inswsn_book", "--root", str(built.root), "book"],
        stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip
    command = psutil.Process(process.pid)

    def rendering() -> bool:
        words = [" ".join(child.cmdline()) for child in command.children(recursive=True)]
        return any("jupyter_book" in said for said in words)

    assert waited(600, rendering), "it did not render"
    others = command.children(recursive=True)
    process.send_signal(getattr(signal, how))
    process.wait(600)
    assert psutil.wait_procs(others, timeout=300)[1] == []
    assert inswsn(built.root, "book").returncode == 0
    assert list(built.build.glob(".inswsn-*")) == []
    assert "Another page." in (built.site / "index.html").read_text()


@pytest.mark.whole
def test_a_live_book_stays_live(built: MiniProject, inswsn: Command) -> None:
    """What `make live` switches on is kept by each build, sealed, until it is switched off."""
    page = built.site / "chapters" / "00-mini.html"
    failed = inswsn(built.root, command=live)
    assert (failed.returncode, "make wasm makes it" in failed.stderr) == (1, True)
    assert built.site.is_dir()
    write_whole(built.root / "data" / "examples" / "ins-wsn.csv", "")
    write_whole(built.build / "live" / "python.js", "// stands for Python")
    for text in ("The first.", "The second."):
        built.page(text)
        assert inswsn(built.root, "book").returncode == 0
        assert "live.js" in page.read_text()
        assert (built.site / "_static/live/python.js").is_file()
        assert "unchanged" in inswsn(built.root, "book").stderr.splitlines()[-1]
        assert damages(built.site) == []
    assert inswsn(built.root, "--off", command=live).returncode == 0
    assert "live.js" not in page.read_text()


def test_where_nothing_can_be_written(built: MiniProject, inswsn: Command) -> None:
    before = files_of(built.site)
    with tempfile.TemporaryDirectory() as folder:  # those of pytest are for their owner alone
        Path(folder).chmod(0o755)
        there = MiniProject(shutil.copytree(built.root, Path(folder, "mini")))
        there.page("Another page.")
        for path in (there.build, *there.build.rglob("*")):
            path.chmod(0o555 if path.is_dir() else 0o444)
        done = run_command(there.root, "book", before=unprivileged())
        for path in (there.build, *(p for p in there.build.rglob("*") if p.is_dir())):
            path.chmod(0o755)
        assert done.returncode == 2, done.stderr
        sentence = done.stderr.strip().splitlines()[-1]
        assert sentence.startswith("inswsn: cannot read or write")
        assert "Permission denied" in sentence
        it_is_as_before(there, before)
    shutil.rmtree(built.build)
    built.build.write_text("in the way")
    done = inswsn(built.root, "book")
    assert (done.returncode, "inswsn: cannot read or write" in done.stderr) == (2, True)
    assert built.build.read_text() == "in the way"
