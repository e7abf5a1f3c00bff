"""What many tests share: the checkout, the built book, and a small project to break."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from bs4 import BeautifulSoup
from filelock import FileLock
from hypothesis import settings

# Before numpy is imported: one thread a process, as when the book is built. Workers that run tests
# side by side would else have more threads than there are cores.
os.environ.update({f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")})

# compiled kernels, as when the book is built, whatever the size of the work
os.environ.setdefault("INSWSN_PLAIN", "0")

from inswsn_book.record.project import Project

if TYPE_CHECKING:
    from click import Command
    from inswsn_book.judge.review import Findings
    from inswsn_book.judge.verdicts import Judged
    from inswsn_book.record.results import Results
    from playwright.sync_api import Browser
    from visiting import Visit

# the same examples in every run, and no limit of time that a busy machine could miss
settings.register_profile("inswsn", derandomize=True, deadline=None)
settings.load_profile("inswsn")

Render = Callable[..., str]
ROOT = Path(__file__).resolve().parents[1]
WHOLE = os.environ.get("INSWSN_TESTS") == "whole"


def weekly_but(daily: Iterable[str], names: Iterable[str]) -> list[Any]:
    """Return names as parameters of a test: but for some, those are left to the weekly run."""
    kept, every = set(daily), list(names)
    assert kept <= set(every)
    return [pytest.param(name, marks=[] if name in kept else [pytest.mark.whole]) for name in every]


#: How long a page may take for what a test waits for, ms; a busy machine has time enough
PATIENCE = 300_000


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put long tests first, so that no worker runs one at the end while the other has none.

    Those that are marked whole are skipped unless INSWSN_TESTS says whole.
    """
    items.sort(key=lambda item: item.get_closest_marker("long") is None)
    skip = pytest.mark.skip(reason="takes long: executed with INSWSN_TESTS=whole")
    for item in items:
        if not WHOLE and item.get_closest_marker("whole"):
            item.add_marker(skip)
        for name in {name for mark in item.iter_markers("recorded") for name in mark.args}:
            from made_folders import is_at_hand  # loads the readers of recordings

            if not is_at_hand(name):
                reason = f"INSWSN_DATA names no mirror with {name}"
                item.add_marker(pytest.mark.skip(reason=reason))


# The checkout, its results and its book ----------------------------------------------------------


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout under test."""
    return ROOT


@pytest.fixture(scope="session")
def project(root: Path) -> Project:
    """The checkout under test as a project."""
    return Project(root)


@pytest.fixture(scope="session")
def published(project: Project) -> dict[str, Results]:
    """The reference results, by chapter."""
    from inswsn_book.record.results import read_results

    return {path.stem: read_results(path) for path in sorted(project.published.glob("*.json"))}


@pytest.fixture(scope="module")
def results(request: pytest.FixtureRequest, built_site: Path, project: Project) -> Results:
    """What the CHAPTER of a module of tests has found, as it is built."""
    from inswsn_book.record.results import read_results

    return read_results(project.results / f"{request.module.CHAPTER}.json")


@pytest.fixture(scope="module")
def judged(results: Results, project: Project) -> dict[str, Judged]:
    """Its claims, by their ids, judged by that."""
    from inswsn_book.judge.ledger import LEDGER, claims_of, load_claims
    from inswsn_book.judge.verdicts import verdicts

    own = claims_of(load_claims(project.root / LEDGER), results.chapter)
    return {entry.claim.id: entry for entry in verdicts(own, [results])}


@pytest.fixture(scope="session")
def known(project: Project, published: dict[str, Results]) -> dict[str, Any]:
    """What the templates of the book are rendered over, from the published results."""
    from inswsn_book.make.pages import context

    return context(project, list(published.values()))


@pytest.fixture(scope="session")
def findings(known: dict[str, Any]) -> Findings:
    """What the chapters found, as published."""
    found: Findings = known["findings"]
    return found


@pytest.fixture(scope="session")
def render(project: Project, known: dict[str, Any]) -> Render:
    """Render a page, such as ``"errata"``, with parts of what it is given replaced."""
    from inswsn_book.make.pages import environment

    templates = environment(project.root)

    def rendered(name: str, **changes: Any) -> str:
        return templates.get_template(f"{name}.md").render(known | changes)

    return rendered


def shared_folder(factory: pytest.TempPathFactory) -> Path:
    """Return a new folder for this run of tests, the same one in every worker."""
    own = factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


def build_once(root: Path, told: Path) -> str:
    """Build a book in the first worker that asks; return what the command said to it."""
    with FileLock(told.with_suffix(".lock")):
        if not told.is_file():
            done = run_command(root, "book", timeout=1800)
            told.write_text(json.dumps([done.returncode, done.stdout + done.stderr]))
    status, said = json.loads(told.read_text())
    assert status == 0, said
    return str(said)


@pytest.fixture(scope="session")
def built_site(project: Project, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The book built from the present sources, by the command that a user calls."""
    build_once(project.root, shared_folder(tmp_path_factory) / "book.json")
    return project.site


# The command -------------------------------------------------------------------------------------


@pytest.fixture
def as_in_a_terminal() -> Iterator[None]:
    """Let what a test starts hear Ctrl-C and the end of its terminal.

    What a shell runs in the background is born deaf to the one, what nohup runs to the other, and
    so are their children: these tests, and what they start.
    """
    heard = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: signal.SIG_DFL}
    before = {number: signal.signal(number, handler) for number, handler in heard.items()}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


Done = subprocess.CompletedProcess[str]
Command = Callable[..., Done]


def run_command(
    root: Path, *words: str, timeout: float = 600, before: Sequence[str] = (), **options: Any
) -> Done:
    """Run ``inswsn`` on a checkout as a process of its own."""
    return subprocess.run(
        [*before, sys.executable, "-m", "inswsn_book", "--root", str(root), *words],
        check=False, capture_output=True, text=True, timeout=timeout, cwd=root, **options,
    )  # fmt: skip


def unprivileged() -> list[str]:
    """Return the words before a command that has it write only where anybody may.

    Root writes everywhere, so what starts as root goes on as uid 65534, which reads everything.
    """
    if os.geteuid() != 0:
        return []
    if shutil.which("setpriv") is None:
        pytest.skip("A test of what cannot be written is not run as root without setpriv.")
    reads = "+dac_read_search"
    own = "--reuid=65534", "--regid=65534", "--clear-groups"
    return ["setpriv", *own, f"--inh-caps={reads}", f"--ambient-caps={reads}"]


@pytest.fixture
def inswsn(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Command]:
    """Run ``inswsn``, or another command, on a checkout in this process: a second less each."""
    from inswsn_book.make.cli import cli, run_command as run_here

    handlers = {each: signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGHUP)}

    def call(root: Path, *words: str, command: Command = cli) -> Done:
        monkeypatch.chdir(root)
        named = ["--root", str(root)] if command is cli else []
        monkeypatch.setattr(sys, "argv", ["inswsn", *named, *words])
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            run_here(command)
        return Done(words, int(ended.value.code or 0), *capsys.readouterr())

    yield call
    for each, handler in handlers.items():
        signal.signal(each, handler)


# A small project ---------------------------------------------------------------------------------

MINI_CHAPTER = """\
---
jupytext: {text_representation: {extension: .md, format_name: myst}}
kernelspec: {display_name: Python 3, language: python, name: python3}
---

# A small chapter

```{code-cell} ipython3
:tags: [parameters]

# What the number is multiplied by.
scale: float = 2.0  # 1; in (0, 100]
```

```{code-cell} ipython3
from inswsn_book.record import ChapterRecord

record = ChapterRecord("00", parameters={"scale": scale})
number = float(record.data("papers/number.txt").read_text())
record.quantity(
    "twice", scale * number, "m", how="The number in the file, scaled.",
    basis="printed", tolerance=0.5,
)
```

The number is {glue:text}`twice`.

@BODY@

```{code-cell} ipython3
record.write()
```
"""
MINI_LEDGER = """\
missing: {lost: The page that says so is lost.}
claims:
- {id: P1-M-twice, paper: P1, place: Section 1, says: Twice the number is 42 m., value: "42",
   unit: m, kind: numeric, check: {chapter: "00", quantity: twice}, tolerance: digits,
   why: It is printed in whole metres.}
- {id: P2-M-lost, paper: P2, place: Section 2, says: Something that nobody can read.,
   kind: qualitative, check: {needs: [lost]}, why: The page would say.}
"""
REPOSITORY = "https://github.com/someone/some-name"
_TAKEN_OVER = (
    *("_config.yml", "pyproject.toml", "environment.in", "environment.lock"),
    *("environment-torch.lock", "CITATION.cff", "THIRD-PARTY.md", "book/references.bib"),
    *("book/conf.py", "book/_static", "book/_templates"),
)


class MiniProject(Project):
    """A project of one small chapter, its claims and one page."""

    def publish(self, results: Results) -> None:
        """Make results the reference of their chapter."""
        from inswsn_book.record.files import write_listed
        from inswsn_book.record.results import results_text

        write_listed(self.published, {f"{results.chapter}.json": results_text(results)})

    @property
    def source(self) -> Path:
        """The source of the chapter."""
        return self.root / "chapters" / "00-mini.md"

    @property
    def number(self) -> Path:
        """The file that the chapter reads."""
        return self.root / "data" / "papers" / "number.txt"

    @property
    def ledger(self) -> Path:
        """The claims on the chapter."""
        return self.root / "data" / "claims" / "mini.yaml"

    def chapter(self, code: str = "") -> None:
        """Write the chapter, with a cell of that code in its middle."""
        cell = f"```{{code-cell}} ipython3\n{code}\n```" if code else ""
        self.source.write_text(MINI_CHAPTER.replace("@BODY@", cell), encoding="utf-8")

    def page(self, text: str = "A page.") -> None:
        """Write the front page."""
        (self.root / "book" / "index.md").write_text(f"# Mini\n\n{text}\n", encoding="utf-8")


def make_mini(folder: Path) -> MiniProject:
    """Write a small project."""
    for name in ("book", "chapters", "data/claims", "data/papers"):
        (folder / name).mkdir(parents=True)
    for name in _TAKEN_OVER:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    (folder / "book" / "_toc.yml").write_text(
        "format: jb-book\nroot: index\nchapters:\n  - file: chapters/00-mini\n  - file: claims\n",
        encoding="utf-8",
    )
    claims = (ROOT / "book" / "claims.md").read_text(encoding="utf-8")
    # without the links to pages that it does not have
    claims = re.sub(r"\{(doc|prf:ref)\}`([^`]*)`", r"\2", claims)
    (folder / "book" / "claims.md").write_text(claims, encoding="utf-8")
    (folder / "_build").mkdir()
    shutil.copy(_what_code_says(), folder / "_build")
    made = MiniProject(folder)
    made.ledger.write_text(MINI_LEDGER, encoding="utf-8")
    made.number.write_text("21", encoding="utf-8")
    made.chapter()
    made.page()
    return made


@cache
def _what_code_says() -> Path:
    """Return where a project keeps what it has read of all code, which takes seconds to read."""
    project = Project(ROOT)
    project.imports()
    project.memory.save()
    return project.build / "memory"


@pytest.fixture
def mini(tmp_path: Path) -> MiniProject:
    """A small project, in order, that a test may break."""
    return make_mini(tmp_path / "mini")


@pytest.fixture(scope="session")
def built_mini(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small project that is built once and copied; nothing changes it."""
    folder = shared_folder(tmp_path_factory) / "built-mini"
    with FileLock(folder.with_suffix(".made")):
        if not folder.exists():
            make_mini(folder)
    build_once(folder, folder.with_suffix(".json"))
    return folder


@pytest.fixture
def built(built_mini: Path, tmp_path: Path) -> MiniProject:
    """The small project after a first, good build."""
    shutil.copytree(built_mini, tmp_path / "mini")
    return MiniProject(tmp_path / "mini")


# A core that takes its time, and tells each time that it is called
SWEEP_CORE = """
import os, time
from dataclasses import dataclass
import numpy as np
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import Scores, quotient

@dataclass
class Core:
    scale: float = 2.0

    def scores(self):
        with open(os.environ["MINI_LOG"], "a") as log:
            log.write(f"{self.scale}\\n")
        if self.scale == 13:
            raise InswsnError("Thirteen has no design.")
        time.sleep(float(os.environ.get("MINI_SECONDS", "0")))
        spread = np.linspace(0.9, 1.1, 41)
        scale = min(self.scale, 5)
        over = quotient([scale * spread], [spread], "1", "The old one over the new.")
        return Scores(
            findings={"ratio.old-over-new": over},
            methods={"old": "the old one", "new": "the new one", "none": "nothing"},
            columns={"error": "m"},
            values={
                "old.error": scale * spread, "new.error": spread, "none.error": 99 * spread,
            },
            headline="error",
            baselines=frozenset({"none"}),
        )
"""


class SweepProject:
    """A small project whose chapter has a core; sweeps of it are written to one folder."""

    def __init__(self, mini: MiniProject) -> None:
        text = mini.source.read_text(encoding="utf-8")
        mini.source.write_text(text.replace("\n---\n", "\ncore: minicore:Core\n---\n", 1))
        (mini.root / "minicore.py").write_text(SWEEP_CORE, encoding="utf-8")
        self.project, self.folder, self.log = mini, mini.root / "made", mini.root / "log.txt"

    def words(self, scales: str, *more: str) -> list[str]:
        return ["sweep", "00", "--grid", f"scale={scales}", "--out", str(self.folder), *more]

    def calls(self) -> Counter[float]:
        """How often the core was called, by its parameter."""
        return Counter(map(float, self.log.read_text().split())) if self.log.exists() else Counter()

    def table(self, name: str = "sweep") -> list[dict[str, str]]:
        with (self.folder / f"{name}.csv").open(encoding="utf-8", newline="") as stream:
            return list(csv.DictReader(stream))


@pytest.fixture
def sweep_project(tmp_path: Path) -> Callable[[str], SweepProject]:
    """Make a small project with a core, in a folder of that name."""
    return lambda name: SweepProject(make_mini(tmp_path / name))


def assert_plain(notebook: str) -> None:
    """Refuse what a reader outside the book would see of MyST in the text of a notebook."""
    first, *cells = json.loads(notebook)["cells"]
    assert "`make environment` in a checkout of inswsn" in "".join(first["source"])
    shown = [o.get("data", {}) for cell in cells for o in cell.get("outputs", [])]
    texts = ["".join(data.get("text/markdown", "")) for data in shown]
    texts += ["".join(c["source"]) for c in (first, *cells) if c["cell_type"] == "markdown"]
    for text in texts:
        left = re.search(r"\{[\w:-]+\}`|^:::|^[`~]{3,}\{|^\(\S+\)=$|\(#|<span", text, re.M)
        assert left is None, text
    assert not any("text/html" in data for data in shown)


def git(root: Path, *words: str) -> str:
    """Run git on a folder, as somebody; return what it says."""
    who = ["-c", "user.name=a", "-c", "user.email=a@b.example", "-c", "commit.gpgsign=false"]
    return subprocess.run(
        ["git", "-C", str(root), *who, *words], check=True, capture_output=True, text=True
    ).stdout.strip()


@pytest.fixture(scope="session")
def released_mini(built_mini: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small project before `make archive`: of a repository, published, committed, built."""
    from inswsn_book.run.compare import publish_build

    folder = shared_folder(tmp_path_factory) / "released-mini"
    with FileLock(folder.with_suffix(".made")):
        if not folder.exists():
            shutil.copytree(built_mini, folder)
            released = MiniProject(folder)
            publish_build(released)
            released.page("Another page.")
            with (folder / "CITATION.cff").open("a", encoding="utf-8") as file:
                file.write(f"repository-code: {REPOSITORY}\n")
            (folder / ".gitignore").write_text("/_build/\n/results/\n", encoding="utf-8")
            git(folder, "init", "-q")
            git(folder, "add", "-A")
            git(folder, "commit", "-q", "-m", "all of it")
    build_once(folder, folder.with_suffix(".json"))
    return folder


@pytest.fixture(scope="session")
def what_stays() -> Callable[[Project], list[object]]:
    """Return what two builds of the small project have in common: results, notebook and pages."""
    from inswsn_book.record.results import read_results
    from inswsn_book.run.store import book_runs

    def found(project: Project) -> list[object]:
        texts: list[object] = [read_results(project.results / "00.json").found()]
        texts += [run.notebook for run in book_runs(project)]
        for name in ("index.html", "claims.html", "chapters/00-mini.html"):
            soup = BeautifulSoup((project.site / name).read_text(), "html.parser")
            for part in soup.select("table.provenance, a.download"):  # of the results file
                part.decompose()
            texts.append(str(soup))
        return texts

    return found


def files_of(folder: Path) -> dict[str, bytes]:
    """Return all that is in a folder: to see that nothing has changed."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def same(here: Any, there: Any) -> bool:
    """Whether two contents differ by no more than rounding: compiled loops round otherwise."""
    if isinstance(here, dict):
        return here.keys() == there.keys() and all(same(here[k], there[k]) for k in here)
    if isinstance(here, list):
        return len(here) == len(there) and all(map(same, here, there))
    if isinstance(here, float | int) and not isinstance(here, bool):
        return abs(here - there) <= 1e-3 * (1 + abs(there))
    return bool(here == there)


# A browser ---------------------------------------------------------------------------------------


FLAGS = [
    *("--disable-gpu", "--disable-background-networking", "--disable-component-update"),
    # a click would wait for the end of each scroll
    *("--disable-sync", "--disable-smooth-scrolling", "--no-first-run"),
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",  # no other host
    # Chromium has no sandbox for root
    *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []),
]


@pytest.fixture(scope="session")
def chromium() -> str:
    """The path of Debian's Chromium, or a skip that says how to get it.

    The one without windows if it is there: the same engine, and a page takes a quarter less time.
    INSWSN_BROWSER names another one.
    """
    named = os.environ.get("INSWSN_BROWSER")
    if named and shutil.which(named) is None:
        pytest.fail(f"INSWSN_BROWSER must be the name or the path of a Chromium, not {named}.")
    for name in [named] if named else ["chromium-headless-shell", "chromium"]:
        if path := shutil.which(name):
            return path
    sentence = "Page tests need Debian's Chromium: apt-get install chromium-headless-shell."
    if os.environ.get("INSWSN_REQUIRE_BROWSER"):
        pytest.fail(sentence)
    pytest.skip(sentence)


@pytest.fixture(scope="session")
def browser(chromium: str) -> Iterator[Browser]:
    """One headless Chromium for all tests of pages."""
    from playwright.sync_api import expect, sync_playwright  # most tests need none

    expect.set_options(timeout=PATIENCE)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        browser.on("context", lambda context: context.set_default_timeout(PATIENCE))
        yield browser
        browser.close()


class QuietHandler(SimpleHTTPRequestHandler):
    """Says nothing for each file."""

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def serving(folder: Path, handler: type[QuietHandler] = QuietHandler) -> Iterator[str]:
    """Serve a folder; give its address."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(handler, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, args=[0.01], daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()


@pytest.fixture(scope="session")
def served(built_site: Path) -> Iterator[str]:
    """The address at which the built book is served."""
    with serving(built_site) as address:
        yield address


@pytest.fixture
def open_page(browser: Browser, served: str) -> Iterator[Callable[..., Visit]]:
    """Open pages of the built book, which are closed when the test ends."""
    from visiting import opening

    with opening(browser, served) as opened:
        yield opened


# What a cell shows -------------------------------------------------------------------------------


@pytest.fixture
def displayed(monkeypatch: pytest.MonkeyPatch) -> list[tuple[dict[str, str], dict[str, Any]]]:
    """What a cell would show: the data and metadata of each output, in order."""
    outputs: list[tuple[dict[str, str], dict[str, Any]]] = []

    def display(data: dict[str, str], metadata: dict[str, Any] | None = None, *, raw: bool) -> None:
        assert raw
        outputs.append((data, metadata or {}))

    for module in ("show.moving", "record.chapter", "show"):
        monkeypatch.setattr(f"inswsn_book.{module}.display", display)
    return outputs
