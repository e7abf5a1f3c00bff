"""The whole way on a small project: what a build does, and how it fails."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bs4 import BeautifulSoup
from conftest import MiniProject, run_command
from inswsn_book.results import read_results

CELL = "```{{code-cell}} ipython3\n{}\n```"


def state(site: Path) -> dict[str, bytes]:
    return {str(p.relative_to(site)): p.read_bytes() for p in site.rglob("*") if p.is_file()}


def leftovers(project: MiniProject) -> list[str]:
    return [p.name for p in project.build.iterdir() if p.name.startswith("render-")]


def test_a_build_and_the_builds_after_it(mini: MiniProject) -> None:
    done = run_command(mini.root, "book")
    assert done.returncode == 0, done.stderr
    assert f"Open {mini.site / 'index.html'}" in done.stdout
    assert "00-mini: executed" in done.stderr
    page = (mini.site / "chapters" / "00-mini.html").read_text()
    assert "The number is" in page
    assert ">42<" in page
    assert read_results(mini.results / "00.json")["twice"].value == 42.0
    assert leftovers(mini) == []

    # nothing changed: nothing is executed, nothing rendered, the site is not touched
    before = state(mini.site)
    done = run_command(mini.root, "book")
    assert "00-mini: unchanged" in done.stderr
    assert "book: unchanged" in done.stderr
    assert state(mini.site) == before

    # a page changed: rendered, not executed
    mini.page("# Mini\n\nAnother page.\n")
    done = run_command(mini.root, "book")
    assert "00-mini: unchanged" in done.stderr
    assert "Another page." in (mini.site / "index.html").read_text()

    # the data changed: executed
    (mini.root / "data" / "papers" / "number.txt").write_text("1")
    done = run_command(mini.root, "book")
    assert "00-mini: executed" in done.stderr
    assert read_results(mini.results / "00.json")["twice"].value == 2.0

    # nothing changed, but the user wants all of it anew
    done = run_command(mini.root, "book", "--fresh")
    assert "00-mini: executed" in done.stderr
    assert "book: rendering" in done.stderr


def test_a_raising_cell(built: MiniProject) -> None:
    before = state(built.site)
    built.chapter(CELL.format("reason = 'the sky fell'\nraise RuntimeError(reason)"))
    done = run_command(built.root, "book")
    assert done.returncode == 1
    assert "Chapter 00-mini failed in cell 5 of 6 (ch00-004)" in done.stderr
    assert "raise RuntimeError(reason)" in done.stderr
    assert "RuntimeError" in done.stderr
    assert "the sky fell" in done.stderr
    assert state(built.site) == before
    assert leftovers(built) == []


def test_a_kernel_that_dies(built: MiniProject) -> None:
    before = state(built.site)
    built.chapter(CELL.format("import os\nos._exit(1)"))
    done = run_command(built.root, "book")
    assert done.returncode == 1
    assert "Chapter 00-mini failed in cell 5 of 6 (ch00-004)" in done.stderr
    assert "Traceback" not in done.stderr
    assert state(built.site) == before


def test_a_chapter_that_writes_no_results(mini: MiniProject) -> None:
    (chapter,) = mini.chapters()
    chapter.source.write_text(chapter.source.read_text().replace("record.write()", "pass"))
    done = run_command(mini.root, "book")
    assert done.returncode == 1
    assert "Chapter 00-mini wrote no results file 00.json" in done.stderr


def test_a_chapter_that_changes_while_it_is_executed(mini: MiniProject) -> None:
    (chapter,) = mini.chapters()
    mini.chapter(
        CELL.format(
            "import pathlib\n"
            f"source = pathlib.Path({str(chapter.source)!r})\n"
            "text = source.read_text()\n"
            "_ = source.write_text(text.replace('float = 2.0', 'float = 3.0'))"
        )
    )
    done = run_command(mini.root, "book")
    assert done.returncode == 1
    assert "changed while it was executed, or the library did; run it again." in done.stderr
    assert not any(mini.store.rglob("*.json"))


@pytest.mark.parametrize(
    ("toc", "said"),
    [
        ("format: jb-book\nroot: index\n", "book/_toc.yml does not list chapters/00-mini"),
        (
            "format: jb-book\nroot: index\nchapters:\n"
            "  - file: chapters/00-mini\n  - file: chapters/01-gone\n",
            "book/_toc.yml lists chapters/01-gone, and there is no such chapter",
        ),
        ("format: [", "_toc.yml is not YAML"),
        (None, "There is no"),
    ],
)
def test_a_contents_list_that_does_not_fit(mini: MiniProject, toc: str | None, said: str) -> None:
    path = mini.root / "book" / "_toc.yml"
    path.unlink()
    if toc is not None:
        path.write_text(toc)
    done = run_command(mini.root, "book")
    assert done.returncode == 2
    assert said in done.stderr.splitlines()[-1]
    assert "executing" not in done.stderr  # which would be in vain


def test_a_checkout_with_a_library_of_its_own(mini: MiniProject) -> None:
    (mini.root / "inswsn_lib").mkdir()
    done = run_command(mini.root, "book")
    assert done.returncode == 2
    assert "has a library of its own" in done.stderr


def test_personal_settings_do_not_reach_a_chapter(
    mini: MiniProject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = tmp_path / "settings"
    settings.mkdir()
    (settings / "matplotlibrc").write_text("axes.linewidth: 9\n")
    monkeypatch.setenv("PYTHONPATH", str(settings))
    monkeypatch.setenv("MPLCONFIGDIR", str(settings))
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.setenv("PYTHONHASHSEED", "7")
    mini.chapter(
        CELL.format(
            "import os, sys\n"
            "import matplotlib\n"
            "assert matplotlib.rcParams['axes.linewidth'] == 0.8\n"
            f"assert {str(settings)!r} not in sys.path\n"
            "assert (os.environ['OMP_NUM_THREADS'], os.environ['PYTHONHASHSEED']) == ('1', '0')"
        )
    )
    done = run_command(mini.root, "book")
    assert done.returncode == 0, done.stderr


def test_two_fresh_builds_are_the_same(built: MiniProject) -> None:
    (first,) = built.store.rglob("*.json")
    text = json.loads(first.read_text())["notebook"]
    results = read_results(built.results / "00.json")
    pages = {name: page_without_provenance(built.site / name) for name in PAGES}
    assert run_command(built.root, "book", "--fresh").returncode == 0
    assert json.loads(first.read_text())["notebook"] == text
    assert read_results(built.results / "00.json").found() == results.found()
    for name in PAGES:
        assert page_without_provenance(built.site / name) == pages[name], name


PAGES = ("index.html", "claims.html", "chapters/00-mini.html")


def page_without_provenance(page: Path) -> str:
    soup = BeautifulSoup(page.read_text(), "html.parser")
    for table in soup.select("table.provenance"):
        table.decompose()
    for link in soup.select("a.download"):  # the results file holds the provenance as well
        link.decompose()
    return str(soup)


def test_a_sentence_that_is_not_so(built: MiniProject) -> None:
    before = state(built.site)
    built.chapter(CELL.format("record.holds('Twice the number is odd.', 2 * number % 2 == 1)"))
    done = run_command(built.root, "book")
    assert done.returncode == 1
    assert "has sentences that its results do not bear out" in done.stderr
    assert "Twice the number is odd." in done.stderr
    assert state(built.site) == before


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


def test_a_page_that_does_not_hold_together(built: MiniProject) -> None:
    """One page has all faults, since each rendering takes seconds; each is named."""
    before = state(built.site)
    built.page("# Mini\n\n" + "\n\n".join(FAULTS) + "\n")
    for _ in range(2):  # the second build fails as the first does
        done = run_command(built.root, "book")
        assert done.returncode == 1, done.stdout + done.stderr
        for said in FAULTS.values():
            assert said in done.stderr
    assert "book/index.md:3: WARNING" in done.stderr  # what is to be edited, not what was staged
    assert state(built.site) == before
    assert leftovers(built) == []


def test_a_page_whose_template_fails(built: MiniProject) -> None:
    before = state(built.site)
    built.page("# Mini\n\n{{ nothing.of_the_kind }}\n")
    done = run_command(built.root, "book")
    assert done.returncode == 1
    assert "book/index.md: WARNING: 'nothing' is undefined" in done.stderr
    assert "Traceback" not in done.stderr
    assert state(built.site) == before


def start_slow_build(project: MiniProject) -> tuple[subprocess.Popen[str], list[int]]:
    """Start a build whose chapter sleeps; return it and the ids of its kernel and its worker."""
    marker = project.root / "kernel-pid"
    project.chapter(
        CELL.format(
            "import os, pathlib, time\n"
            f"pathlib.Path({str(marker)!r}).write_text(f'{{os.getpid()}} {{os.getppid()}}')\n"
            "time.sleep(120)"
        )
    )
    # what a shell runs in the background is born deaf to Ctrl-C, what nohup runs to the end of its
    # terminal, and so are their children
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    hangup = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    process = subprocess.Popen(
        [sys.executable, "-m", "inswsn_book", "--root", str(project.root), "book"],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
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


@pytest.mark.parametrize(
    "how",
    [signal.SIGINT, signal.SIGTERM, signal.SIGHUP],
    ids=["Ctrl-C", "terminated", "terminal closed"],
)
def test_an_interrupted_build(built: MiniProject, how: signal.Signals) -> None:
    before = state(built.site)
    process, others = start_slow_build(built)
    process.send_signal(how)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 128 + how, said
    assert said.strip().endswith("inswsn: stopped.")
    assert all(map(ends, others)), "the kernel or its worker was left running"
    assert state(built.site) == before
    assert leftovers(built) == []
    built.chapter()
    assert run_command(built.root, "book").returncode == 0  # and the next build is as good as ever


@pytest.mark.skipif(sys.platform == "win32", reason="There is no such signal on Windows.")
def test_a_killed_build_leaves_nothing_that_stays(built: MiniProject) -> None:
    process, others = start_slow_build(built)
    process.kill()
    process.communicate(timeout=60)
    assert all(map(ends, others)), "the kernel or its worker outlived the build"
    built.chapter()
    assert run_command(built.root, "book").returncode == 0
    assert leftovers(built) == []


def test_two_builds_at_once(built: MiniProject) -> None:
    process, _ = start_slow_build(built)
    try:
        done = run_command(built.root, "book")
        assert done.returncode == 2
        assert "Another build of" in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)


def without_override() -> None:
    """Give up root's right to write where the file mode forbids it; others never had it."""
    drop_from_bounding_set, dac_override, dac_read_search = 24, 1, 2
    libc = ctypes.CDLL(None, use_errno=True)
    for capability in (dac_override, dac_read_search):
        libc.prctl(drop_from_bounding_set, capability, 0, 0, 0)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="file modes are tested on Linux.")
def test_a_read_only_target(built: MiniProject) -> None:
    before = state(built.site)
    built.page("# Mini\n\nAnother page.\n")
    folders = [built.build, *(p for p in built.build.rglob("*") if p.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    try:
        done = run_command(built.root, "book", preexec_fn=without_override)
    finally:
        for folder in folders:
            folder.chmod(0o755)
    assert done.returncode == 2, done.stderr
    (sentence,) = done.stderr.strip().splitlines()[-1:]
    assert sentence.startswith("inswsn: cannot read or write")
    assert "Permission denied" in sentence
    assert "Traceback" not in done.stderr
    assert state(built.site) == before


def test_a_file_where_the_target_should_be(mini: MiniProject) -> None:
    mini.build.write_text("in the way")
    done = run_command(mini.root, "book")
    assert done.returncode == 2
    assert "inswsn: cannot read or write" in done.stderr
    assert mini.build.read_text() == "in the way"


def test_chapters_run_side_by_side(mini: MiniProject) -> None:
    # each of the two waits for the other's mark: one after the other, neither would end
    source = (mini.root / "chapters" / "00-mini.md").read_text()
    for number, other in (("00", "01"), ("01", "00")):
        wait = CELL.format(
            "import pathlib, time\n"
            f"here = pathlib.Path({str(mini.root)!r})\n"
            f"(here / 'mark-{number}').touch()\n"
            "for _ in range(600):\n"
            f"    if (here / 'mark-{other}').exists():\n        break\n"
            "    time.sleep(0.1)\n"
            "else:\n    raise TimeoutError"
        )
        text = source.replace('ChapterRecord("00"', f'ChapterRecord("{number}"')
        text = text.replace("The number is", f"{wait}\n\nThe number is")
        (mini.root / "chapters" / f"{number}-mini.md").write_text(text)
    with (mini.root / "book" / "_toc.yml").open("a") as toc:
        toc.write("  - file: chapters/01-mini\n")
    done = run_command(mini.root, "book", "--jobs", "2", timeout=180)
    assert done.returncode == 0, done.stderr
