"""The site: when it is out of date, what it tells of its origin, that parts make the same whole."""

from __future__ import annotations

import json
import platform
import shutil
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import pytest
from conftest import MiniProject, files_of, git, run_command
from inswsn_book.make import site
from inswsn_book.make.site import footer, require_current_site
from inswsn_book.record.files import seal_folder
from inswsn_book.record.provenance import machine_facts, repository_state
from inswsn_book.run.store import Request, Run
from made_results import results

from inswsn_lib.errors import InswsnError

BARE = results()


@pytest.mark.parametrize(
    "path", ["book/index.md", "book/_templates/macros.md", "data/papers/number.txt",
             "chapters/00-mini.md", "_config.yml", "CITATION.cff", "environment.lock"],
)  # fmt: skip
def test_a_site_is_out_of_date_once_a_source_differs(mini: MiniProject, path: str) -> None:
    def current(run: Run) -> bool:
        try:
            require_current_site(mini, [run])
        except InswsnError:
            return False
        return True

    one = Run(Request("00"), BARE, "{}")
    assert not current(one)
    mini.site.mkdir(parents=True)
    (mini.site / ".inswsn-key").write_text(site._site_key(mini, [one]))
    seal_folder(mini.site)
    assert current(one)
    assert not current(replace(one, notebook="{ }"))
    assert not current(replace(one, results=results(solvers={"CLARABEL": "optimal"})))
    (mini.root / path).write_text((mini.root / path).read_text() + "\n")
    assert not current(one)


@pytest.mark.parametrize(
    ("line", "warns"),
    [
        ("/a/b.md:3: WARNING: undefined label", True),
        ("WARNING: unknown config value", True),
        ("/a/b.md:3: ERROR: unknown directive", True),
        ("Source Folder: /a/ERROR/WARNING/book", False),
        ("copying images... [100%] WARNING.png", False),
    ],
)
def test_what_counts_as_a_warning(line: str, warns: bool) -> None:
    assert bool(site.WARNING.search(line)) is warns


def rendered(project: MiniProject) -> str:
    done = run_command(project.root, "book")
    assert done.returncode == 0, done.stderr
    return done.stderr


@pytest.mark.whole
def test_changed_pages_are_rendered_alone_as_all_are(built: MiniProject, tmp_path: Path) -> None:
    """One word of a chapter, a new heading, and results that another page shows."""
    text, kept = built.source.read_text(), built.build / "pages"
    written = kept / "html" / "claims.html"
    built.page("A page that is read here first, since Sphinx keeps nothing for another place.")
    rendered(built)
    entries = by_index(built)
    assert entries
    for new in ("One word.", "(there)=\n## A heading"):
        before = written.stat().st_mtime_ns
        built.source.write_text(text.replace("The number is", f"{new}\n\nThe number is"))
        assert "00-mini: unchanged" in rendered(built)
        assert new[-9:] in (built.site / "chapters/00-mini.html").read_text()
        # what another page may name has changed with the label alone
        assert (written.stat().st_mtime_ns > before) == new.startswith("(")
        assert by_index(built) == entries
    by_parts = shown(built)
    shutil.rmtree(kept)
    built.build.joinpath("html", ".inswsn-key").unlink()
    rendered(built)
    assert shown(built) == by_parts


def by_index(project: MiniProject) -> list[str]:
    """Return what a search finds by entries of the index, such as the ids of claims."""
    text = (project.site / "searchindex.js").read_text()
    index = json.loads(text.removeprefix("Search.setIndex(").rstrip(");"))
    return sorted(index["indexentries"])


def shown(project: MiniProject) -> dict[str, bytes]:
    """Return a site without its digests, and without the search index.

    There Sphinx keeps a name that nothing has any more.
    """
    without = {".inswsn-key", "SHA256SUMS", "searchindex.js"}
    return {n: c for n, c in files_of(project.site).items() if n not in without}


@pytest.mark.whole
def test_what_a_change_elsewhere_breaks_is_found(built: MiniProject) -> None:
    """A label goes that a page names which has not changed; the next rendering tells it again."""
    text = built.source.read_text()
    built.source.write_text(text + "\n(there)=\n## A heading\n")
    built.page("See {ref}`there`.")
    rendered(built)
    before = files_of(built.site)
    built.source.write_text(text)
    for _ in range(2):
        done = run_command(built.root, "book")
        assert done.returncode == 1
        assert "undefined label: 'there'" in done.stderr
        assert files_of(built.site) == before
    built.page()
    rendered(built)


def test_the_state_of_a_checkout(mini: MiniProject, monkeypatch: pytest.MonkeyPatch) -> None:
    root = mini.root
    assert repository_state(root) == (None, None)
    git(root, "init", "-q")
    assert repository_state(root) == (None, None)  # no commit yet
    assert "from files that are not a git checkout, env" in footer(mini)
    git(root, "add", ".")
    git(root, "commit", "-qm", "first")
    head = git(root, "rev-parse", "HEAD")
    assert repository_state(root) == (head, True)
    assert f"from commit {head[:12]}, environment.lock" in footer(mini)
    mini.number.write_text("1")
    assert repository_state(root) == (head, False)
    assert f"commit {head[:12]} with changes that were not committed, env" in footer(mini)
    # a copy that lies inside another repository has no commit of its own
    assert repository_state(root / "data") == (None, None)
    monkeypatch.setenv("PATH", "")  # no git at all
    assert repository_state(root) == (None, None)


def test_what_is_told_of_the_machine() -> None:
    facts = machine_facts()
    assert facts["python"] == platform.python_version()
    assert facts["packages"]["numpy"] == version("numpy")
    assert "scikit-image" not in facts["packages"]
    assert facts["cores"] >= 1
    assert facts["cpu"].strip()
    # numpy and scipy have a linear algebra each, with the one thread of these tests
    assert len(facts["blas"]) >= 1
    assert all(library.endswith(", 1 thread") for library in facts["blas"])
