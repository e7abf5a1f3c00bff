"""`inswsn verify`: what it holds against what, and that it says where they differ."""

from __future__ import annotations

import shutil
import zipfile
from hashlib import sha256
from pathlib import Path

import pytest
from conftest import Command, MiniProject, files_of
from inswsn_book.make.archive import write_archive
from inswsn_book.make.verify import _of_chapter, _read, verify
from inswsn_book.record.files import seal_folder
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import Project
from inswsn_book.run.store import book_runs, keep
from made_results import quantity, results


@pytest.fixture
def built(released_mini: Path, tmp_path: Path) -> MiniProject:
    """The small project, published and built."""
    shutil.copytree(released_mini, tmp_path / "mini", symlinks=True)
    return MiniProject(tmp_path / "mini")


@pytest.fixture
def archive(released_mini: Path, tmp_path: Path) -> Path:
    with zipfile.ZipFile(write_archive(Project(released_mini), tmp_path / "a.zip")) as opened:
        opened.extractall(tmp_path / "archive")
    return tmp_path / "archive"


def differing(folder: Path) -> list[str]:
    return [line for _, lines in verify(folder, [], Quiet()) for line in lines]


def test_what_is_in_order(built: MiniProject, archive: Path, inswsn: Command) -> None:
    before = files_of(built.site)
    done = inswsn(built.root, "verify")
    assert (done.returncode, done.stderr) == (0, "")
    # the number in the text, that there is one, two claims, and what decides one of them
    assert done.stdout.splitlines() == [
        "good     data/published: its digests",
        "good     the pages: 6 numbers, cells of tables and verdicts",
    ]
    assert files_of(built.site) == before
    done = inswsn(archive, "verify", str(archive))
    assert (done.returncode, "good     the folder: its digests" in done.stdout) == (0, True)
    done = inswsn(built.root, "verify", "book")
    assert done.returncode == 2
    assert "PATH must be a checkout or a folder with SHA256SUMS, not " in done.stderr


def test_a_chapter_is_executed_anew(built: MiniProject, inswsn: Command) -> None:
    store = {path: path.read_bytes() for path in built.store.rglob("*") if path.is_file()}
    done = inswsn(built.root, "verify", "--execute", "00")
    assert "executing 5 cells" in done.stderr
    assert "good     chapter 00, executed anew: 1 quantities" in done.stdout
    assert {path: path.read_bytes() for path in store} == store
    # what is in the store says the same and is not asked
    source = built.source.read_text()
    built.source.write_text(source.replace("scale * number", "scale * number + 1"))
    done = inswsn(built.root, "verify", "--execute", "00")
    assert done.returncode == 1
    assert "         twice: 42 m -> 43 m (change +1, tolerance 0.5)\n" in done.stdout


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("chapters/00-mini.html", ">42<", ">43<", "00-mini, twice: '43' for '42'"),
        pytest.param(
            *("chapters/00-mini.html", "pasted-text", "other", "'0 numbers' for '1 numbers'"),
            marks=pytest.mark.whole,
        ),
        pytest.param(
            *("claims.html", ": 42 m.", ": 43 m.", "for ': 42 m.'"), marks=pytest.mark.whole
        ),
        ("claims.html", "<strong>adds up in print<", "<strong>refuted<", "'adds up"),
    ],
)
def test_a_page_that_shows_another_number_is_told_even_if_it_is_sealed_again(
    archive: Path, name: str, old: str, new: str, said: str
) -> None:
    page = archive / "site" / name
    assert old in page.read_text()
    page.write_text(page.read_text().replace(old, new))
    assert differing(archive) == [f"site/{name} is changed"] or said in differing(archive)[1]
    seal_folder(archive)
    (line,) = differing(archive)
    assert said in line


def test_a_file_that_is_changed_added_or_missing_is_told(archive: Path, inswsn: Command) -> None:
    """Each alone, and by the digest of the list also after the folder was sealed again."""
    listed = sha256((archive / "SHA256SUMS").read_bytes()).hexdigest()

    def told(*words: str) -> list[str]:
        said = inswsn(archive, "verify", str(archive), *words).stdout
        return [line.strip() for line in said.splitlines() if line.startswith(" ")]

    assert told("--digest", listed) == []
    page = archive / "THIRD-PARTY.md"
    text = page.read_bytes()
    page.write_bytes(bytes([text[0] ^ 1]) + text[1:])
    assert told() == ["THIRD-PARTY.md is changed"]
    page.unlink()
    assert told() == ["THIRD-PARTY.md is gone"]
    page.write_bytes(text)
    (archive / "more.txt").write_text("")
    assert told() == ["more.txt is not listed"]
    seal_folder(archive)
    assert told() == []
    (line,) = told("--digest", listed)
    assert line.startswith("it is ")
    assert line.endswith(f", not {listed}")


def test_a_site_that_is_not_that_of_the_store(built: MiniProject) -> None:
    (run,) = book_runs(built)
    keep(built, run.request, run.__class__(run.request, run.results.found(), run.notebook))
    assert "is not up to date, since its sources have changed" in differing(built.root)[0]
    shutil.rmtree(built.site)
    assert differing(built.root) == []  # nothing has been built


CELLS = "<div id=tbl><table><tr><td>{}</td><td>{}</td></tr></table></div>"


@pytest.mark.parametrize(
    ("cells", "shown", "right"),
    [
        (["1.50 m", "[P1-2](#claim-p1-2)"], ["1.50 m", "P1-2"], True),
        (["1.50 m", "2, {prf:ref}`thm-x`"], ["1.50 m", "2, Theorem 3"], True),
        (["1.50 m", "2"], ["1.51 m", "2"], False),
        (["1.50 m", "2"], ["1.50 m", ""], False),
        (["−1e-3", "2"], ["−1e-4", "2"], False),
        (["1", "2", "3"], ["1", "2"], False),
    ],
)
def test_cells_of_tables(tmp_path: Path, cells: list[str], shown: list[str], right: bool) -> None:
    (tmp_path / "page.html").write_text(CELLS.format(*shown))
    told = list(_of_chapter(_read(tmp_path / "page.html"), "", results(tables={"tbl": [cells]})))
    assert all(text == expected for _, text, expected in told) is right


@pytest.mark.parametrize(
    ("value", "role", "shown"),
    [(42.0, "x", "42"), (0.1, "x", "0.1"), (1234.5, "x:,.0f", "1,234"), (1e16, "x", "1e+16")],
)
def test_numbers_in_the_text(tmp_path: Path, value: float, role: str, shown: str) -> None:
    (tmp_path / "page.html").write_text(f'<span class="pasted-text">{shown}</span>')
    made = results(quantity("x", value))
    told = list(_of_chapter(_read(tmp_path / "page.html"), f"{{glue:text}}`{role}`", made))
    assert [entry[1:] for entry in told] == [("1 numbers", "1 numbers"), (shown, shown)]
