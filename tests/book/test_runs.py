"""One request, one key, one store: what makes a run due, and what finds it again."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pytest
from conftest import MiniProject, run_command
from inswsn_book import runs
from inswsn_book.compare import comparison
from inswsn_book.files import file_digest
from inswsn_book.progress import Quiet
from inswsn_book.project import _EXECUTING, MODULES_VARIABLE, Project
from inswsn_book.provenance import machine_facts
from inswsn_book.results import Provenance, Results, write_results
from inswsn_book.runs import (
    ChapterError,
    Outcome,
    Request,
    Run,
    Surroundings,
    keep,
    lookup,
    request_key,
    run,
    run_all,
)

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import DATA_VARIABLE

PLAIN = Request("00")
EMPTY = Results(chapter="00", parameters={}, data={}, quantities=())


@pytest.fixture
def packages(mini: Project, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two small packages in the place of the two of the checkout."""
    folders = mini.root / "inswsn_lib", mini.root / "inswsn_book"
    for folder in folders:
        folder.mkdir()
        for name in ("a.py", "rendering.py", *_EXECUTING):
            (folder / name).write_text("x = 1\n")
    monkeypatch.setattr(mini, "libraries", folders)
    return mini.root


def append(name: str) -> Callable[[Path], None]:
    def change(root: Path) -> None:
        with (root / name).open("a") as stream:
            stream.write("\n# changed\n")

    return change


# The key


@pytest.mark.parametrize(
    "change",
    [
        append("chapters/00-mini.md"),
        append("environment.lock"),
        append("environment-torch.lock"),
        append("inswsn_lib/a.py"),
        append("inswsn_book/record.py"),
        lambda root: (root / "inswsn_lib" / "b.py").write_text(""),
        lambda root: (root / "inswsn_lib" / "a.py").rename(root / "inswsn_lib" / "c.py"),
    ],
    ids=["source", "lock", "torch lock", "library", "record", "new module", "renamed module"],
)
def test_a_change_of_content_changes_the_key(
    mini: Project, packages: Path, change: Callable[[Path], None]
) -> None:
    before = request_key(mini, PLAIN)
    change(packages)
    after = request_key(mini, PLAIN)
    # and the part of the key that tells an entry from another library
    assert after[:12] != before[:12]


@pytest.mark.parametrize(
    "other",
    [
        Request("00", {"scale": 3.0}),
        Request("00", surroundings=Surroundings(threads=2)),
        Request("00", surroundings=Surroundings(variables={"A": "1"})),
        Request("00", overlay={"data/papers/number.txt": "1"}),
        Request("00", overlay={"data/papers/other.txt": "1"}),
        Request("00", core=True),
    ],
    ids=["parameter", "threads", "variable", "overlay", "its path", "core"],
)
def test_another_request_has_another_key(mini: Project, other: Request) -> None:
    before, after = request_key(mini, PLAIN), request_key(mini, other)
    assert after != before
    assert after[:12] == before[:12]  # they stand beside one another in the store


def test_another_python_changes_the_key(mini: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    before = request_key(mini, PLAIN)
    monkeypatch.setattr("platform.python_version", lambda: "3.99.0")
    assert request_key(mini, PLAIN) != before


def test_whether_there_are_recorded_data_changes_the_key(
    mini: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    without = request_key(mini, PLAIN)
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
    (tmp_path / "first" / "file").touch()
    keys = set()
    for name in ("first", "second"):  # which folder it is and what it holds does not count
        monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / name))
        keys.add(request_key(mini, PLAIN))
    assert len(keys) == 1
    assert without not in keys
    # a name of no folder gives no data
    for name in ("", str(tmp_path / "none"), str(tmp_path / "first" / "file")):
        monkeypatch.setenv(DATA_VARIABLE, name)
        assert request_key(mini, PLAIN) == without, name


def test_a_readers_own_regressor_is_a_part_of_the_key(
    mini: MiniProject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (chapter,) = mini.chapters()
    declared = "# Which.\nlearner: str = 'sklearn.svm:SVR'  # 1; a regressor\n\n# What the number"
    chapter.source.write_text(chapter.source.read_text().replace("# What the number", declared))
    monkeypatch.setenv(MODULES_VARIABLE, str(tmp_path))
    (tmp_path / "own.py").write_text("class Mine: ...\n")
    request = Request("00", {"learner": "own:Mine"})
    before = request_key(mini, request)
    (tmp_path / "own.py").write_text("class Mine: x = 1\n")
    assert request_key(mini, request) != before


def test_what_does_not_count(mini: Project, packages: Path) -> None:
    (chapter,) = mini.chapters()
    before = request_key(mini, PLAIN)
    os.utime(packages / "inswsn_lib" / "a.py", (0, 0))
    os.utime(chapter.source, (0, 0))
    (mini.root / "README.md").write_text("unrelated")
    (mini.root / "data" / "papers" / "other.txt").write_text("unrelated")
    # the command line and the pages may change without any chapter being due
    append("inswsn_book/rendering.py")(packages)
    assert request_key(mini, PLAIN) == before
    # nor does it count that a parameter is set to what it is
    assert request_key(mini, Request("00", {"scale": 2})) == before


def test_what_may_not_be_asked_for(mini: Project) -> None:
    with pytest.raises(ParameterError, match=r"scale is 0\.0"):
        request_key(mini, Request("00", {"scale": 0.0}))
    with pytest.raises(ParameterError, match="it may be one of scale"):
        request_key(mini, Request("00", {"other": 0.0}))
    with pytest.raises(InswsnError, match="NAME is '07'"):
        request_key(mini, Request("07"))


# The store


def test_an_entry_holds_while_its_data_are_unchanged(mini: Project) -> None:
    data = mini.root / "data" / "papers" / "number.txt"
    read = EMPTY.model_copy(update={"data": {"data/papers/number.txt": file_digest(data)}})
    kept = Run(PLAIN, read, "{}\n", {"note.csv": "a\r\nb\n"})
    assert lookup(mini, PLAIN) is None
    keep(mini, PLAIN, kept)
    assert lookup(mini, PLAIN) == kept
    assert lookup(mini, Request("00", {"scale": 3.0})) is None
    data.write_text("22")
    assert lookup(mini, PLAIN) is None
    data.unlink()
    assert lookup(mini, PLAIN) is None


@pytest.mark.parametrize(
    "content", [b"", b"{", b"{}", b"[]", b'{"results": {\xff', b'{"results": {}}']
)
def test_an_entry_that_cannot_be_read_is_none(mini: Project, content: bytes) -> None:
    keep(mini, PLAIN, Run(PLAIN, EMPTY, "{}\n"))
    (entry,) = (mini.store / "00").iterdir()
    whole = entry.read_bytes()
    entry.write_bytes(content)
    assert lookup(mini, PLAIN) is None
    keep(mini, PLAIN, Run(PLAIN, EMPTY, "{}\n"))  # and another takes its place
    assert entry.read_bytes() == whole
    assert lookup(mini, PLAIN) is not None


def test_a_kill_while_an_entry_is_written_leaves_none(
    mini: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", killed)
    with pytest.raises(KeyboardInterrupt):
        keep(mini, PLAIN, Run(PLAIN, EMPTY, "{}\n"))
    assert list((mini.store / "00").iterdir()) == []


def _keep_often(root: Path, times: int) -> None:
    for _ in range(times):
        keep(Project(root), PLAIN, Run(PLAIN, EMPTY, "{}\n", {"note.csv": "a\n"}))


def test_two_processes_keep_the_same(mini: Project) -> None:
    context = get_context("spawn")
    writers = [context.Process(target=_keep_often, args=(mini.root, 40)) for _ in range(2)]
    for writer in writers:
        writer.start()
    seen = set()
    while any(writer.is_alive() for writer in writers):
        found = lookup(mini, PLAIN)
        seen.add(None if found is None else (found.notebook, found.files["note.csv"]))
        time.sleep(0.001)
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    assert seen <= {None, ("{}\n", "a\n")}
    assert lookup(mini, PLAIN) == Run(PLAIN, EMPTY, "{}\n", {"note.csv": "a\n"})
    assert len(list((mini.store / "00").iterdir())) == 1


def test_old_entries_go_but_for_the_last_few(mini: Project) -> None:
    (chapter,) = mini.chapters()
    source = chapter.source.read_text()

    def entries() -> set[str]:
        return {path.name for path in (mini.store / "00").iterdir()}

    several = [PLAIN, *(Request("00", {"scale": float(n)}) for n in range(10, 16))]
    for request in several:
        keep(mini, request, Run(request, EMPTY, "{}\n"))
    assert len(entries()) == len(several)  # of the present source all are kept
    for edit in range(5):
        chapter.source.write_text(f"{source}\nEdit {edit}.\n")
        keep(mini, PLAIN, Run(PLAIN, EMPTY, "{}\n"))
        for path in (mini.store / "00").iterdir():  # what is written first is oldest
            if path.stem == request_key(mini, PLAIN):
                os.utime(path, (edit + 2e9, edit + 2e9))
    assert len(entries()) == 4
    for edit, there in enumerate([False, True, True, True, True]):
        chapter.source.write_text(f"{source}\nEdit {edit}.\n")
        assert (lookup(mini, PLAIN) is not None) == there


# Running


def test_what_the_book_has_executed_a_run_finds_and_the_other_way_round(
    built: MiniProject, tmp_path: Path
) -> None:
    done = run_command(built.root, "run", "00", "-p", "scale=2", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines() == ["00-mini: unchanged"]
    assert (tmp_path / "out" / "00-mini.ipynb").is_file()
    done = run_command(built.root, "run", "00", "--fresh", "--out", str(tmp_path / "out"))
    assert "executed" in done.stderr
    # another default: what was run by hand is the book's
    (chapter,) = built.chapters()
    chapter.source.write_text(chapter.source.read_text().replace("float = 2.0", "float = 4.0"))
    assert "executed" in run_command(built.root, "run", "00").stderr
    done = run_command(built.root, "book")
    assert done.returncode == 0, done.stderr
    assert "00-mini: unchanged" in done.stderr
    assert ">84<" in (built.site / "chapters" / "00-mini.html").read_text()
    # and of all that was there before, only what has another key is executed
    assert "executed" in run_command(built.root, "run", "00", "-p", "scale=3").stderr
    assert "unchanged" in run_command(built.root, "run", "00", "-p", "scale=3").stderr


def test_a_run_that_the_book_refuses_is_refused_from_the_store_too(built: MiniProject) -> None:
    built.chapter(
        "```{code-cell} ipython3\nrecord.holds('Twice it is odd.', 2 * number % 2 == 1)\n```"
    )
    assert run_command(built.root, "run", "00").returncode == 0
    done = run_command(built.root, "book")
    assert done.returncode == 1
    assert "00-mini: unchanged" in done.stderr
    assert "has sentences that its results do not bear out:\n  Twice it is odd." in done.stderr


def test_a_table_is_recorded_as_it_is_shown(mini: MiniProject) -> None:
    mini.chapter(
        "```{code-cell} ipython3\nimport pandas as pd\nfrom inswsn_book.show import show_table\n\n"
        "frame = pd.DataFrame({'a (m)': [f'{scale:.2f}']}, index=pd.Index(['x'], name='row'))\n"
        "show_table(frame, name='tbl-mini', caption='A table.')\n```"
    )
    done = run(mini, PLAIN, Quiet())
    assert done.results.tables == {"tbl-mini": [["row", "a (m)"], ["x", "2.00"]]}
    other = run(mini, Request("00", {"scale": 3.0}), Quiet()).results
    assert other.tables["tbl-mini"][1] == ["x", "3.00"]
    assert "table tbl-mini: 1 of 4 cells differ" in comparison(done.results, other, [])


def test_an_overlay_is_as_an_edited_checkout(mini: MiniProject) -> None:
    (chapter,) = mini.chapters()
    source = chapter.source.read_text()
    other = source.replace("scale * number", "scale * number + 1").replace(
        "float = 2.0", "float = 3.0"
    )
    overlay = {f"chapters/{chapter.source.name}": other, "data/papers/number.txt": "5"}
    request = Request("00", overlay=overlay)
    over = run(mini, request, Quiet())
    assert over.results["twice"].value == 16
    assert lookup(mini, request) == over
    assert lookup(mini, PLAIN) is None
    assert chapter.source.read_text() == source
    assert (mini.root / "data" / "papers" / "number.txt").read_text() == "21"
    # the same by hand
    chapter.source.write_text(other)
    (mini.root / "data" / "papers" / "number.txt").write_text("5")
    edited = run(mini, PLAIN, Quiet())
    assert edited.results.found() == over.results.found()
    assert edited.notebook == over.notebook
    made = over.results.provenance
    assert made is not None
    assert made.sources["chapter"] == file_digest(chapter.source)


def test_a_failure_is_told_and_stops_all_or_not(mini: MiniProject) -> None:
    mini.chapter(
        "```{code-cell} ipython3\nif scale > 50:\n    raise ValueError('It is too much.')\n```"
    )
    asked = [Request("00", {"scale": value}) for value in (60.0, 3.0)]
    ends: dict[int, Outcome] = {}
    run_all(mini, asked, Quiet(), ends.__setitem__, jobs=1)
    assert isinstance(ends[0], ChapterError)
    assert "It is too much." in str(ends[0])
    assert ends[1] == lookup(mini, asked[1])
    assert lookup(mini, asked[0]) is None
    with pytest.raises(ChapterError, match="It is too much"):
        run_all(mini, asked, Quiet())


def test_chapters_that_take_long_come_first(
    mini: MiniProject, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = (mini.root / "chapters" / "00-mini.md").read_text()
    took = {"00": 1.0, "01": 30.0, "02": None, "03": 30.0, "04": 4.0}  # 02 was never published
    machine = machine_facts()
    for number, seconds in took.items():
        (mini.root / "chapters" / f"{number}-mini.md").write_text(source)
        made = EMPTY.model_copy(update={"chapter": number})
        if seconds is not None:
            facts = Provenance(
                version="1", commit=None, clean=None, sources={}, finished="", seconds=seconds,
                **machine,
            )  # fmt: skip
            made = made.model_copy(update={"provenance": facts})
            write_results(made, mini.published / f"{number}.json")

    def instantly(_: Any, request: Request, *__: Any) -> Run:
        order.append(request.chapter)
        return Run(request, EMPTY)

    order: list[str] = []
    monkeypatch.setattr(runs, "_run_and_keep", instantly)
    given = [Request(number) for number in took]
    assert [done.request for done in run_all(mini, given, Quiet(), jobs=1)] == given
    assert order == ["02", "01", "03", "04", "00"]


def test_the_core_of_a_chapter(mini: MiniProject, monkeypatch: pytest.MonkeyPatch) -> None:
    request = Request("00", {"scale": 3.0}, core=True)
    with pytest.raises(InswsnError, match=r"^Chapter 00 has no core\.$"):
        run(mini, request, Quiet())
    calls = []

    def core(*given: Any) -> tuple[Results, dict[str, str]]:
        calls.append(given[2:])
        return EMPTY, {}

    monkeypatch.setattr(runs, "run_core", core)
    done = run(mini, request, Quiet())
    assert done.notebook is None
    assert done.results.found() == EMPTY
    assert done.results.provenance is not None
    assert run(mini, request, Quiet()) == done  # found, not called again
    assert calls == [({"scale": 3.0}, 1)]
    assert lookup(mini, Request("00", {"scale": 3.0})) is None
