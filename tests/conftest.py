"""What many tests share: the checkout, the built book, and a small project to break."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
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

from inswsn_book.project import Project

if TYPE_CHECKING:
    from inswsn_book.review import Findings
    from playwright.sync_api import Browser

# the same examples in every run, and no limit of time that a busy machine could miss
settings.register_profile("inswsn", derandomize=True, deadline=None)
settings.load_profile("inswsn")

ROOT = Path(__file__).resolve().parents[1]

MINI_CHAPTER = """\
---
jupytext:
  text_representation:
    extension: .md
    format_name: myst
kernelspec:
  display_name: Python 3
  language: python
  name: python3
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
missing:
  lost: The page that says so is lost.
claims:
- id: P1-M-twice
  paper: P1
  place: Section 1
  says: Twice the number is 42 m.
  value: "42"
  unit: m
  kind: numeric
  check: {chapter: "00", quantity: twice}
  tolerance: digits
  why: It is printed in whole metres.
- id: P2-M-lost
  paper: P2
  place: Section 2
  says: Something that nobody can read.
  kind: qualitative
  check: {needs: [lost]}
  why: The page would say.
"""

WHOLE = os.environ.get("INSWSN_TESTS") == "whole"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put long tests first, so that no worker runs one at the end while the other has none.

    Those that are marked whole are skipped unless INSWSN_TESTS says whole.
    """
    items.sort(key=lambda item: item.get_closest_marker("long") is None)
    skip = pytest.mark.skip(reason="takes long: executed with INSWSN_TESTS=whole")
    for item in items:
        if not WHOLE and item.get_closest_marker("whole"):
            item.add_marker(skip)


@pytest.fixture(scope="session")
def whole() -> bool:
    """Whether all is asked of the pages, as in the weekly run, or what a push needs."""
    return WHOLE


@pytest.fixture(scope="session")
def root() -> Path:
    """The checkout under test."""
    return ROOT


@pytest.fixture(scope="session")
def project(root: Path) -> Project:
    """The checkout under test as a project."""
    return Project(root)


@pytest.fixture(scope="session")
def known(project: Project) -> dict[str, Any]:
    """What the templates of the book are rendered over, from the published results."""
    from inswsn_book import pages
    from inswsn_book.results import read_results

    files = sorted(project.published.glob("[0-9][0-9].json"))
    return pages.context(project, [read_results(path) for path in files])


@pytest.fixture(scope="session")
def findings(known: dict[str, Any]) -> Findings:
    """What the chapters found, as published."""
    found: Findings = known["findings"]
    return found


@pytest.fixture(scope="session")
def render(project: Project, known: dict[str, Any]) -> Callable[..., str]:
    """Render a page, such as ``"errata"``, with parts of what it is given replaced."""
    from inswsn_book import pages

    templates = pages.environment(project.root)

    def rendered(name: str, **changes: Any) -> str:
        return templates.get_template(f"{name}.md").render(known | changes)

    return rendered


@pytest.fixture(scope="session")
def built_site(project: Project, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The book built from the present sources, by the command that a user calls.

    Workers of pytest-xdist have one session each; the first that asks builds for all of them.
    """
    build_once(project.root, shared_folder(tmp_path_factory) / "book.json")
    return project.site


def shared_folder(factory: pytest.TempPathFactory) -> Path:
    """Return a new folder for this run of tests, the same one in every worker."""
    own = factory.getbasetemp()
    return own.parent if "PYTEST_XDIST_WORKER" in os.environ else own


def build_once(root: Path, told: Path) -> None:
    """Build a book in the first worker that asks; the others wait, and read how it went."""
    with FileLock(told.with_suffix(".lock")):
        if not told.is_file():
            done = run_command(root, "book", timeout=1800)
            told.write_text(json.dumps([done.returncode, done.stdout + done.stderr]))
    status, said = json.loads(told.read_text())
    assert status == 0, said


def run_command(
    root: Path, *words: str, timeout: float = 600, **options: object
) -> subprocess.CompletedProcess[str]:
    """Run ``inswsn`` on a checkout as a process of its own."""
    return subprocess.run(  # type: ignore[call-overload,no-any-return]
        [sys.executable, "-m", "inswsn_book", "--root", str(root), *words],
        check=False,
        capture_output=True,
        text=True,
        timeout=timeout,
        cwd=root,
        **options,
    )


class MiniProject(Project):
    """A project of one small chapter and one page."""

    def chapter(self, body: str = "") -> None:
        """Write the chapter with `body` in its middle."""
        text = MINI_CHAPTER.replace("@BODY@", body)
        (self.root / "chapters" / "00-mini.md").write_text(text, encoding="utf-8")

    def page(self, text: str = "# Mini\n\nA page.\n") -> None:
        """Write the front page."""
        (self.root / "book" / "index.md").write_text(text, encoding="utf-8")


@pytest.fixture
def mini(tmp_path: Path) -> MiniProject:
    """A small project, in order, that a test may break."""
    return make_mini(tmp_path / "mini")


@pytest.fixture
def built(built_mini: Path, tmp_path: Path) -> MiniProject:
    """The small project after a first, good build."""
    shutil.copytree(built_mini, tmp_path / "mini")
    return MiniProject(tmp_path / "mini")


@pytest.fixture(scope="session")
def built_mini(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small project that is built once and copied; nothing changes it."""
    folder = shared_folder(tmp_path_factory) / "built-mini"
    with FileLock(folder.with_suffix(".made")):
        if not folder.exists():
            make_mini(folder)
    build_once(folder, folder.with_suffix(".json"))
    return folder


def make_mini(folder: Path) -> MiniProject:
    """Write a small project."""
    for name in ("book", "chapters", "data/claims", "data/papers"):
        (folder / name).mkdir(parents=True)
    for name in (
        "_config.yml",
        "pyproject.toml",
        "environment.in",
        "environment.lock",
        "environment-torch.lock",
        "CITATION.cff",
        "THIRD-PARTY.md",
        "book/references.bib",
    ):
        shutil.copy(ROOT / name, folder / name)
    for name in ("_static", "_templates"):
        shutil.copytree(ROOT / "book" / name, folder / "book" / name)
    (folder / "book" / "_toc.yml").write_text(
        "format: jb-book\nroot: index\nchapters:\n  - file: chapters/00-mini\n  - file: claims\n",
        encoding="utf-8",
    )
    claims = (ROOT / "book" / "claims.md").read_text(encoding="utf-8")
    # without the links to pages that it does not have
    claims = re.sub(r"\{(doc|prf:ref)\}`([^`]*)`", r"\2", claims)
    (folder / "book" / "claims.md").write_text(claims, encoding="utf-8")
    (folder / "data" / "claims" / "mini.yaml").write_text(MINI_LEDGER, encoding="utf-8")
    (folder / "data" / "papers" / "number.txt").write_text("21", encoding="utf-8")
    made = MiniProject(folder)
    made.chapter()
    made.page()
    return made


@pytest.fixture(scope="session")
def chromium() -> str:
    """The path of Debian's Chromium, or a skip that says how to get it.

    The one without windows if it is there: the same engine, and a page takes a quarter less time.
    """
    path = shutil.which("chromium-headless-shell") or shutil.which("chromium")
    if path is None:
        sentence = "Page tests need Debian's Chromium: apt-get install chromium-headless-shell."
        if os.environ.get("INSWSN_REQUIRE_BROWSER"):
            pytest.fail(sentence)
        pytest.skip(sentence)
    return path


@pytest.fixture(scope="session")
def browser(chromium: str) -> Iterator[Browser]:
    """One headless Chromium for all tests of pages."""
    from playwright.sync_api import sync_playwright  # most tests need none

    flags = [
        "--disable-gpu",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--disable-smooth-scrolling",  # a click would wait for the end of each scroll
        "--no-first-run",
    ]
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        flags.append("--no-sandbox")  # Chromium has no sandbox for root
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=flags)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def served(built_site: Path) -> Iterator[str]:
    """The address at which the built book is served."""
    handler = partial(_Quiet, directory=str(built_site))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/"
        server.shutdown()


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Say nothing for each file."""


@pytest.fixture(scope="session")
def labs(built_site: Path) -> dict[str, Any]:
    """What each lab of the built book computes from, by its kind, and the page that it is on."""
    found = {}
    for page in sorted((built_site / "chapters").glob("7*.html")):
        section = BeautifulSoup(page.read_text(encoding="utf-8"), "html.parser").select_one(".lab")
        assert section is not None, page.name
        content = json.loads(section.script.string)  # type: ignore[union-attr, arg-type]
        found[str(section["data-lab"])] = content | {"page": f"chapters/{page.name}"}
    return found


@pytest.fixture
def displayed(monkeypatch: pytest.MonkeyPatch) -> list[tuple[dict[str, str], dict[str, Any]]]:
    """What a cell would show: the data and metadata of each output, in order."""
    outputs: list[tuple[dict[str, str], dict[str, Any]]] = []

    def display(data: dict[str, str], metadata: dict[str, Any] | None = None, *, raw: bool) -> None:
        assert raw
        outputs.append((data, metadata or {}))

    for module in ("record", "show"):
        monkeypatch.setattr(f"inswsn_book.{module}.display", display)
    return outputs
