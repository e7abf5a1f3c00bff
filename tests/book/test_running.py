"""`inswsn run` and `inswsn book` on a small project: what they leave, and how they fail or end."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from bs4 import BeautifulSoup
from conftest import MINI_LEDGER, Done, MiniProject, build_once, files_of, run_command
from inswsn_book import running
from inswsn_book.pages import RenderingError
from inswsn_book.parameters import chapter_schema, read_schema
from inswsn_book.project import MODULES_VARIABLE
from inswsn_book.results import read_results
from inswsn_book.running import gather_parameters

from inswsn_lib.errors import InswsnError, ParameterError

# The parameters of a run -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scale: [", "is not YAML"),
        ("- scale", "is not a list of parameters"),
        ("7: 1", "is not a list of parameters"),
        ("scale: '3'", "scale is '3'"),
        ("scale: .nan", "scale is nan"),
        ("scale: true", "scale is True"),
        ("other: 1", "parameter is 'other'"),
    ],
)
def test_a_bad_file_of_parameters(mini: MiniProject, tmp_path: Path, text: str, said: str) -> None:
    file, schema = tmp_path / "params.yml", chapter_schema(mini.root, "00")
    file.write_text(text)
    with pytest.raises(InswsnError, match=said.replace("[", r"\[")):
        gather_parameters(schema, [], file, tmp_path)
    file.write_text("")
    assert gather_parameters(schema, [], file, tmp_path) == {}
    file.write_text("scale: 5\n")
    assert gather_parameters(schema, [], file, tmp_path) == {"scale": 5.0}
    assert gather_parameters(schema, ["scale=4"], file, tmp_path) == {"scale": 4.0}


def test_a_file_that_a_parameter_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    schema = read_schema("# A file.\nname: str = 'given.csv'  # 1; a file")
    data = tmp_path / "data"
    data.mkdir()
    for path in (data / "given.csv", tmp_path / "own.csv"):
        path.touch()
    monkeypatch.chdir(tmp_path)
    # one of the project's stays a name, so that a results file is the same on every machine
    assert gather_parameters(schema, ["name=given.csv"], None, data) == {"name": "given.csv"}
    own = str((tmp_path / "own.csv").resolve())
    assert gather_parameters(schema, ["name=own.csv"], None, data) == {"name": own}
    with pytest.raises(ParameterError, match="there is no such file"):
        gather_parameters(schema, ["name=none.csv"], None, data)


def test_a_regressor_that_a_parameter_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    schema = read_schema("# A method.\nlearner: str = 'no.such:Thing'  # 1; a regressor")
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delenv(MODULES_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    # the default is not tried: the published run has
    assert gather_parameters(schema, [], None, tmp_path) == {}
    name, file = "sklearn.linear_model:LinearRegression", tmp_path / "params.yml"
    with pytest.raises(ParameterError, match=r"learner is 'nonsense'; it may be package\.module:C"):
        gather_parameters(schema, ["learner=nonsense"], None, tmp_path)
    # one in a file is tried as well, unless the command line overrides it
    file.write_text("learner: sklearn.linear_model:Nobody\n")
    with pytest.raises(ParameterError, match=r"sklearn\.linear_model has no class Nobody"):
        gather_parameters(schema, [], file, tmp_path)
    found = gather_parameters(schema, [f"learner={name}"], file, tmp_path)
    assert found == {"learner": name}


# One chapter into a folder -----------------------------------------------------------------------


def test_a_run_and_its_comparison(
    built: MiniProject, tmp_path: Path, inswsn: Callable[..., Done]
) -> None:
    assert inswsn(built.root, "publish").returncode == 0
    kept = {path: files_of(path) for path in (built.published, built.results, built.site)}
    out, file = tmp_path / "out", tmp_path / "params.yml"
    done = inswsn(built.root, "run", "0", "-p", "scale=3", "--out", str(out), "--html")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        "twice: 42 m -> 63 m (change +21, tolerance 0.5)",
        "parameters: scale: 2.0 -> 3.0",
        "verdict P1-M-twice: reproduced -> contradicted by the paper itself (No numbers that round "
        "to the printed cells allow it.)",
        "1 of 1 quantities changed, 0 of 0 sentences overturned, 1 of 1 verdicts flipped.",
        f"The run is in {out}",
    ]
    assert read_results(out / "00.json").parameters == {"scale": 3.0}
    assert (out / "parameters.yml").read_text() == "scale: 3.0\n"
    assert "## Provenance" in (out / "00-mini.ipynb").read_text()
    # the pages of the run are of that run, that of claims too
    assert ">63<" in (out / "html" / "chapters" / "00-mini.html").read_text()
    assert "63 m" in (out / "html" / "claims.html").read_text()
    # the published results, the last build and its site are what they were
    assert kept == {path: files_of(path) for path in kept}
    assert "00-mini: unchanged" in inswsn(built.root, "book").stderr

    # a file of parameters; the folder of an earlier run may be used again
    file.write_text("scale: 5\n")
    done = inswsn(built.root, "run", "00-mini", "-f", str(file), "--out", str(out))
    assert done.returncode == 0
    assert read_results(out / "00.json")["twice"].value == 105
    assert not (out / "html").exists()  # a page of the earlier run would belie this one
    # overridden, into a folder of its own: it is found
    done = inswsn(built.root, "run", "00", "-f", str(file), "-p", "scale=3")
    assert done.stderr == "00-mini: unchanged\n"
    (folder,) = (built.root / "runs").iterdir()
    assert done.stdout.splitlines()[-1] == f"The run is in {folder}"
    done = inswsn(built.root, "compare", str(out / "00.json"), str(folder / "00.json"))
    assert "parameters: scale: 5.0 -> 3.0" in done.stdout


def test_a_run_that_fails_writes_nothing(
    built: MiniProject, inswsn: Callable[..., Done], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise RenderingError("Sphinx could not render the book without warnings: so.")

    monkeypatch.setattr(running, "render_run", fail)
    done = inswsn(built.root, "run", "00", "--html")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.endswith("inswsn: Sphinx could not render the book without warnings: so.\n")
    # what the library refuses in a cell is one sentence
    built.chapter(
        "from inswsn_lib.errors import ParameterError\n"
        "raise ParameterError('scale', scale, 'at most 50 here')"
    )
    done = inswsn(built.root, "run", "00", "-p", "scale=60")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.splitlines()[-1] == "inswsn: scale is 60.0; it may be at most 50 here."
    assert "Traceback" not in done.stderr
    assert list((built.root / "runs").iterdir()) == []


# All chapters into a site ------------------------------------------------------------------------

PAGES = ("index.html", "claims.html", "chapters/00-mini.html")


def pages_without_provenance(built: MiniProject) -> list[str]:
    texts = []
    for name in PAGES:
        soup = BeautifulSoup((built.site / name).read_text(), "html.parser")
        # the results file, which a page offers, holds the provenance as well
        for part in soup.select("table.provenance, a.download"):
            part.decompose()
        texts.append(str(soup))
    return texts


def leftovers(project: MiniProject) -> list[Path]:
    return list(project.build.glob("render-*"))


def test_a_build_and_the_builds_after_it(
    built: MiniProject, built_mini: Path, released_mini: Path, inswsn: Callable[..., Done]
) -> None:
    said = build_once(built_mini, built_mini.with_suffix(".json"))
    assert "00-mini: executed in" in said
    assert f"Open {built_mini / '_build' / 'html' / 'index.html'}" in said
    assert ">42<" in (built.site / "chapters" / "00-mini.html").read_text()
    results = read_results(built.results / "00.json")
    assert results["twice"].value == 42.0
    assert leftovers(built) == []

    # nothing changed: nothing is executed, nothing rendered, the site is not touched
    before = files_of(built.site)
    assert inswsn(built.root, "book").stderr == "00-mini: unchanged\nbook: unchanged\n"
    assert files_of(built.site) == before

    # all of it anew, in a process of its own: the same, but for what it was made with
    (entry,) = built.store.rglob("*.json")
    notebook, pages = json.loads(entry.read_text())["notebook"], pages_without_provenance(built)
    done = run_command(built.root, "book", "--fresh")
    assert "00-mini: executed in" in done.stderr
    assert "book: rendering" in done.stderr
    assert json.loads(entry.read_text())["notebook"] == notebook
    again = read_results(built.results / "00.json")
    assert (again.found(), again == results) == (results.found(), False)
    assert pages_without_provenance(built) == pages

    # a page changed: rendered, not executed
    said = build_once(released_mini, released_mini.with_suffix(".json"))
    assert "00-mini: unchanged\nbook: rendering\n" in said
    assert "Another page." in (released_mini / "_build" / "html" / "index.html").read_text()


def edit(name: str, old: str, new: str) -> Callable[[MiniProject], object]:
    """Return a change of a file below the root."""

    def change(project: MiniProject) -> None:
        path = project.root / name
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new), encoding="utf-8")

    return change


TOC = "book/_toc.yml"
IN_VAIN: dict[str, Callable[[MiniProject], object]] = {
    "book/_toc.yml does not list chapters/00-mini": edit(TOC, "- file: chapters/00-mini", ""),
    "lists chapters/01-gone, and there is no such": edit(TOC, "claims", "chapters/01-gone"),
    "_toc.yml is not YAML": edit(TOC, "format: jb-book", "format: ["),
    "There is no": lambda project: (project.root / TOC).unlink(),
    "_config.yml is not YAML": edit("_config.yml", "\n", "\n["),
    "CITATION.cff is no citation file: it lacks 'title'": edit("CITATION.cff", "\ntitle:", "\nt:"),
    "P1-M-twice: verdict: Extra inputs are not permitted": lambda project: (
        project.ledger.write_text(MINI_LEDGER.replace("digits,", "digits, verdict: reproduced,"))
    ),
    "decided by the quantity thrice, which chapter 00 does not record": lambda project: (
        project.ledger.write_text(MINI_LEDGER.replace("quantity: twice", "quantity: thrice"))
    ),
}  # fmt: skip


@pytest.mark.parametrize("said", IN_VAIN)
def test_what_is_wrong_by_hand_stops_a_build_before_anything_runs(
    built: MiniProject, inswsn: Callable[..., Done], said: str
) -> None:
    IN_VAIN[said](built)
    before = files_of(built.site)
    done = inswsn(built.root, "book")
    assert done.returncode == 2
    assert said in done.stderr.splitlines()[-1]
    assert "executing" not in done.stderr
    assert (files_of(built.site), leftovers(built)) == (before, [])


def test_a_cell_that_raises_fails_the_build(built: MiniProject) -> None:
    before = files_of(built.site)
    built.chapter("reason = 'the sky fell'\nraise RuntimeError(reason)")
    done = run_command(built.root, "book")
    assert done.returncode == 1
    for said in (
        "Chapter 00-mini failed in cell 5 of 6 (ch00-004)", "raise RuntimeError(reason)",
        "RuntimeError: the sky fell",
    ):  # fmt: skip
        assert said in done.stderr
    assert (files_of(built.site), leftovers(built)) == (before, [])


def test_a_sentence_that_is_not_so_fails_the_build(
    built: MiniProject, inswsn: Callable[..., Done]
) -> None:
    """A run by hand goes on; the book refuses it, also from the store."""
    before = files_of(built.site)
    built.chapter("record.holds('Twice it is odd.', 2 * number % 2 == 1)")
    assert inswsn(built.root, "run", "00").returncode == 0
    done = inswsn(built.root, "book")
    assert done.returncode == 1
    assert "00-mini: unchanged" in done.stderr
    assert "has sentences that its results do not bear out:\n  Twice it is odd." in done.stderr
    assert files_of(built.site) == before


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
    for said in FAULTS.values():
        assert said in done.stderr
    # what is to be edited is named, not what was staged
    assert "book/index.md:3: WARNING" in done.stderr
    assert "book/claims.md: WARNING: 'nothing' is undefined" in done.stderr
    assert "Traceback" not in done.stderr
    # with the site its key is what it was: the next build renders again
    assert (files_of(built.site), leftovers(built)) == (before, [])


# What ends a build from outside ------------------------------------------------------------------


def start_slow_build(project: MiniProject) -> tuple[subprocess.Popen[str], list[int]]:
    """Start a build whose chapter sleeps; return it and the ids of its kernel and its worker."""
    marker = project.root / "kernel-pid"
    project.chapter(
        "import os, pathlib, time\n"
        f"pathlib.Path({str(marker)!r}).write_text(f'{{os.getpid()}} {{os.getppid()}}')\n"
        "time.sleep(120)"
    )
    # what a shell runs in the background is born deaf to Ctrl-C, what nohup runs to the end of its
    # terminal, and so are their children
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    hangup = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    process = subprocess.Popen(
        [sys.executable, "-m", "inswsn_book", "--root", str(project.root), "book"],
        stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    signal.signal(signal.SIGINT, before)
    signal.signal(signal.SIGHUP, hangup)
    for _ in range(600):
        if marker.is_file() and (text := marker.read_text()):
            return process, [int(word) for word in text.split()]
        time.sleep(0.1)
    process.kill()
    raise AssertionError("the chapter did not start within a minute")


def ends(pid: int, seconds: float = 15.0) -> bool:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.1)
    return False


@pytest.mark.parametrize("how", ["SIGINT", "SIGTERM", "SIGHUP", "SIGKILL"])
def test_a_build_that_is_ended_leaves_nothing_that_stays(
    built: MiniProject, inswsn: Callable[..., Done], how: str
) -> None:
    before, number = files_of(built.site), getattr(signal, how)
    process, others = start_slow_build(built)
    meanwhile = inswsn(built.root, "book")
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert meanwhile.returncode == 2
    assert meanwhile.stderr.startswith(f"inswsn: Another build of {built.root} is running")
    if how != "SIGKILL":
        assert process.returncode == 128 + number, said
        assert said.strip().endswith("inswsn: stopped.")
        assert leftovers(built) == []
    assert all(map(ends, others)), "the kernel or its worker was left running"
    assert files_of(built.site) == before
    (built.build / "render-killed").mkdir()
    built.chapter()
    assert inswsn(built.root, "book").returncode == 0  # the next build is as good as ever
    assert (files_of(built.site), leftovers(built)) == (before, [])


def without_override() -> None:
    """Give up root's right to write where the file mode forbids it; others never had it."""
    drop_from_bounding_set, dac_override, dac_read_search = 24, 1, 2
    libc = ctypes.CDLL(None, use_errno=True)
    for capability in (dac_override, dac_read_search):
        libc.prctl(drop_from_bounding_set, capability, 0, 0, 0)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="file modes are tested on Linux.")
def test_a_read_only_target(built: MiniProject) -> None:
    before = files_of(built.site)
    built.page("Another page.")
    folders = [built.build, *(p for p in built.build.rglob("*") if p.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    try:
        done = run_command(built.root, "book", preexec_fn=without_override)
    finally:
        for folder in folders:
            folder.chmod(0o755)
    assert done.returncode == 2, done.stderr
    sentence = done.stderr.strip().splitlines()[-1]
    assert sentence.startswith("inswsn: cannot read or write")
    assert "Permission denied" in sentence
    assert files_of(built.site) == before


def test_a_file_where_the_target_should_be(mini: MiniProject, inswsn: Callable[..., Done]) -> None:
    mini.build.write_text("in the way")
    done = inswsn(mini.root, "book")
    assert done.returncode == 2
    assert "inswsn: cannot read or write" in done.stderr
    assert mini.build.read_text() == "in the way"
