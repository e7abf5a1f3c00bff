"""One request, one key, one store: what makes a run due, what finds it, how one is executed."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from conftest import MiniProject
from inswsn_book import runs
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
    book_runs,
    chosen_surroundings,
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

# The key -----------------------------------------------------------------------------------------


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


def append(name: str) -> Callable[[Path], object]:
    def change(root: Path) -> None:
        with (root / name).open("a") as stream:
            stream.write("\n# changed\n")

    return change


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
    mini: Project, packages: Path, change: Callable[[Path], object]
) -> None:
    before = request_key(mini, PLAIN)
    change(packages)
    # and the part of the key that tells an entry from another library
    assert request_key(mini, PLAIN)[:12] != before[:12]


@pytest.mark.parametrize(
    "other",
    [
        Request("00", {"scale": 3.0}),
        Request("00", surroundings=Surroundings(threads=2)),
        Request("00", surroundings=Surroundings(solver="scs")),
        Request("00", surroundings=Surroundings(variables={"A": "1"})),
        Request("00", overlay={"data/papers/number.txt": "1"}),
        Request("00", overlay={"data/papers/other.txt": "1"}),
        Request("00", core=True),
    ],
    ids=["parameter", "threads", "solver", "variable", "overlay", "its path", "core"],
)
def test_another_request_has_another_key(mini: Project, other: Request) -> None:
    before, after = request_key(mini, PLAIN), request_key(mini, other)
    assert after != before
    assert after[:12] == before[:12]  # they stand beside one another in the store


def test_the_python_and_whether_there_are_recorded_data_change_the_key(
    mini: Project, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def key(folder: str) -> str:
        monkeypatch.setenv(DATA_VARIABLE, folder)
        return request_key(mini, PLAIN)

    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    without = request_key(mini, PLAIN)
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
    (tmp_path / "first" / "file").touch()
    # which folder it is and what it holds does not count; a name of no folder gives no data
    assert key(str(tmp_path / "first")) == key(str(tmp_path / "second")) != without
    for name in ("", str(tmp_path / "none"), str(tmp_path / "first" / "file")):
        assert key(name) == without, name
    monkeypatch.setattr("platform.python_version", lambda: "3.99.0")
    assert request_key(mini, PLAIN) != without


def test_a_readers_own_regressor_is_a_part_of_the_key(
    mini: MiniProject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    declared = "# Which.\nlearner: str = 'sklearn.svm:SVR'  # 1; a regressor\n\n# What the number"
    mini.source.write_text(mini.source.read_text().replace("# What the number", declared))
    monkeypatch.setenv(MODULES_VARIABLE, str(tmp_path))
    request = Request("00", {"learner": "own:Mine"})
    (tmp_path / "own.py").write_text("class Mine: ...\n")
    before = request_key(mini, request)
    (tmp_path / "own.py").write_text("class Mine: x = 1\n")
    assert request_key(mini, request) != before


def test_what_does_not_count(mini: MiniProject, packages: Path) -> None:
    before = request_key(mini, PLAIN)
    for path in (packages / "inswsn_lib" / "a.py", mini.source):
        os.utime(path, (0, 0))
    for name in ("README.md", "data/papers/other.txt"):
        (mini.root / name).write_text("unrelated")
    # the command line and the pages may change without any chapter being due
    append("inswsn_book/rendering.py")(packages)
    assert request_key(mini, PLAIN) == before
    # nor does it count that a parameter is set to what it is
    assert request_key(mini, Request("00", {"scale": 2})) == before


def test_what_may_not_be_asked_for(mini: Project) -> None:
    for request, said in (
        (Request("00", {"scale": 0.0}), r"scale is 0\.0"),
        (Request("00", {"other": 0.0}), "it may be one of scale"),
        (Request("07"), "NAME is '07'"),
    ):
        with pytest.raises(ParameterError, match=said):
            request_key(mini, request)


# The store ---------------------------------------------------------------------------------------


def test_an_entry_holds_while_its_data_are_unchanged(mini: MiniProject) -> None:
    read = EMPTY.model_copy(update={"data": {"data/papers/number.txt": file_digest(mini.number)}})
    kept = Run(PLAIN, read, "{}\n", {"note.csv": "a\r\nb\n"})
    assert lookup(mini, PLAIN) is None
    with pytest.raises(InswsnError, match="Chapter 00 has not been built as it is now"):
        book_runs(mini)
    keep(mini, PLAIN, kept)
    assert lookup(mini, PLAIN) == kept
    assert book_runs(mini) == [kept]
    assert lookup(mini, Request("00", {"scale": 3.0})) is None
    mini.number.write_text("22")
    assert lookup(mini, PLAIN) is None
    mini.number.unlink()
    assert lookup(mini, PLAIN) is None


def test_what_was_run_by_hand_is_the_books_once_it_is_the_default(mini: MiniProject) -> None:
    """The key tells another source; what it holds is found by what it was made from alone."""
    mini.source.write_text(mini.source.read_text().replace("float = 2.0", "float = 4.0"))
    by_hand = Request("00", {"scale": 4.0})
    keep(mini, by_hand, Run(by_hand, EMPTY))
    assert lookup(mini, PLAIN) == Run(PLAIN, EMPTY)
    assert lookup(mini, Request("00", {"scale": 2.0})) is None


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


def test_two_writers_keep_the_same(mini: Project) -> None:
    kept, seen = Run(PLAIN, EMPTY, "{}\n", {"note.csv": "a\n"}), []

    def keep_often() -> None:
        for _ in range(40):
            keep(mini, PLAIN, kept)

    with ThreadPoolExecutor(2) as pool:
        writers = [pool.submit(keep_often) for _ in range(2)]
        while not all(writer.done() for writer in writers):
            seen.append(lookup(mini, PLAIN))
    assert all(writer.exception() is None for writer in writers)
    assert all(found in (None, kept) for found in seen)
    assert lookup(mini, PLAIN) == kept
    assert len(list((mini.store / "00").iterdir())) == 1


def test_old_entries_go_but_for_the_last_few(mini: MiniProject) -> None:
    source = mini.source.read_text()

    def entries() -> list[Path]:
        return list((mini.store / "00").iterdir())

    several = [PLAIN, *(Request("00", {"scale": float(n)}) for n in range(10, 16))]
    for request in several:
        keep(mini, request, Run(request, EMPTY, "{}\n"))
    assert len(entries()) == len(several)  # of the present source all are kept
    for edit in range(5):
        mini.source.write_text(f"{source}\nEdit {edit}.\n")
        keep(mini, PLAIN, Run(PLAIN, EMPTY, "{}\n"))
        for path in entries():  # what is written first is oldest
            if path.stem == request_key(mini, PLAIN):
                os.utime(path, (edit + 2e9, edit + 2e9))
    assert len(entries()) == 4
    for edit, there in enumerate([False, True, True, True, True]):
        mini.source.write_text(f"{source}\nEdit {edit}.\n")
        assert (lookup(mini, PLAIN) is not None) == there


# Running -----------------------------------------------------------------------------------------


def test_a_kernel_is_given_nothing_personal_and_gives_its_files_and_tables(
    mini: MiniProject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that one chapter can be asked at once."""
    settings = tmp_path / "settings"
    settings.mkdir()
    (settings / "matplotlibrc").write_text("axes.linewidth: 9\n")
    monkeypatch.setenv("PYTHONPATH", str(settings))
    monkeypatch.setenv("MPLCONFIGDIR", str(settings))
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.setenv("PYTHONHASHSEED", "7")
    # named from where the command is run; the kernel works in a folder of its own
    monkeypatch.setenv(DATA_VARIABLE, "recorded")
    monkeypatch.chdir(mini.root)
    mini.chapter(
        "import json, os, sys\nimport matplotlib\nimport pandas as pd\n"
        "from inswsn_book.show import show_table\n\n"
        "names = ('OMP_NUM_THREADS', 'PYTHONHASHSEED', 'INSWSN_SOLVER', 'INSWSN_DATA')\n"
        "told = {name: os.environ[name] for name in names}\n"
        "told |= {'width': matplotlib.rcParams['axes.linewidth'], 'path': sys.path}\n"
        "record.write_file('told.json', json.dumps(told))\n"
        "frame = pd.DataFrame({'a (m)': [f'{scale:.2f}']}, index=pd.Index(['x'], name='row'))\n"
        "show_table(frame, name='tbl-mini', caption='A table.')"
    )
    done = run(mini, PLAIN, Quiet())
    assert done.results.tables == {"tbl-mini": [["row", "a (m)"], ["x", "2.00"]]}
    assert done.results.cells == {"twice": "ch00-002"}
    told = json.loads(done.files["told.json"])
    assert str(settings) not in told.pop("path")
    assert told == {
        "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0", "INSWSN_SOLVER": "clarabel",
        "INSWSN_DATA": str(mini.root / "recorded"), "width": 0.8,
    }  # fmt: skip
    assert run(mini, PLAIN, Quiet()) == done  # from the store


def test_an_overlay_is_as_an_edited_checkout(mini: MiniProject) -> None:
    source = mini.source.read_text()
    other = source.replace("scale * number", "scale * number + 1").replace("= 2.0", "= 3.0")
    overlay = {f"chapters/{mini.source.name}": other, "data/papers/number.txt": "5"}
    request = Request("00", overlay=overlay)
    over = run(mini, request, Quiet())
    assert over.results["twice"].value == 16
    assert lookup(mini, request) == over
    assert lookup(mini, PLAIN) is None
    assert (mini.source.read_text(), mini.number.read_text()) == (source, "21")
    # the same by hand
    mini.source.write_text(other)
    mini.number.write_text("5")
    edited = run(mini, PLAIN, Quiet())
    assert edited.results.found() == over.results.found()
    assert edited.notebook == over.notebook
    made = over.results.provenance
    assert made is not None
    assert made.sources["chapter"] == file_digest(mini.source)


# its words where they stand, and what is said of it
FAILURES = {
    "import os\nos._exit(1)": "Chapter 00-mini failed in cell 5 of 6 (ch00-004)",
    "record.write = lambda: None": "Chapter 00-mini wrote no results file 00.json",
    "import pathlib\nsource = pathlib.Path(SOURCE)\n"
    "_ = source.write_text(source.read_text().replace('= 2.0', '= 3.0'))": (
        "changed while it was executed, or the library did; run it again."
    ),
}


@pytest.mark.parametrize("code", FAILURES, ids=["dies", "writes nothing", "changes"])
def test_a_chapter_that_does_not_come_to_its_end(mini: MiniProject, code: str) -> None:
    mini.chapter(code.replace("SOURCE", repr(str(mini.source))))
    with pytest.raises(ChapterError) as failure:
        run(mini, PLAIN, Quiet())
    assert FAILURES[code] in str(failure.value)
    assert "Traceback" not in str(failure.value)
    assert not any(mini.store.rglob("*.json"))


def test_a_failure_is_told_and_stops_all_or_not(mini: MiniProject) -> None:
    mini.chapter("if scale > 50:\n    raise ValueError('It is too much.')")
    asked = [Request("00", {"scale": value}) for value in (60.0, 3.0)]
    ends: dict[int, Outcome] = {}
    run_all(mini, asked, Quiet(), ends.__setitem__, jobs=1)
    assert isinstance(ends[0], ChapterError)
    assert "It is too much." in str(ends[0])
    assert ends[1] == lookup(mini, asked[1])
    assert lookup(mini, asked[0]) is None
    with pytest.raises(ChapterError, match="It is too much"):
        run_all(mini, asked, Quiet())


def test_chapters_run_side_by_side(mini: MiniProject) -> None:
    """Each of the two waits for the other's mark: one after the other, neither would end."""
    wait = (
        "import pathlib, time\n"
        f"here = pathlib.Path({str(mini.root)!r})\n"
        "(here / f'mark-{scale}').touch()\n"
        "end = time.monotonic() + 60\n"
        "while not (here / f'mark-{7 - scale}').exists():\n"
        "    assert time.monotonic() < end\n"
        "    time.sleep(0.05)"
    )
    mini.chapter(wait)
    asked = [Request("00", {"scale": value}) for value in (3.0, 4.0)]
    found = run_all(mini, asked, Quiet(), jobs=2)
    assert [done.results["twice"].value for done in found] == [63, 84]


def test_chapters_that_take_long_come_first(
    mini: MiniProject, monkeypatch: pytest.MonkeyPatch
) -> None:
    took = {"00": 1.0, "01": 30.0, "02": None, "03": 30.0, "04": 4.0}  # 02 was never published
    for number, seconds in took.items():
        mini.source.with_name(f"{number}-mini.md").write_text(mini.source.read_text())
        if seconds is not None:
            facts = Provenance(
                version="1", commit=None, clean=None, sources={}, finished="", seconds=seconds,
                **machine_facts(),
            )  # fmt: skip
            made = EMPTY.model_copy(update={"chapter": number, "provenance": facts})
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
    assert (done.notebook, done.results.found()) == (None, EMPTY)
    assert done.results.provenance is not None
    assert run(mini, request, Quiet()) == done  # found, not called again
    assert calls == [({"scale": 3.0}, 1, "clarabel")]
    assert lookup(mini, Request("00", {"scale": 3.0})) is None


def test_only_a_run_of_ones_own_listens_to_the_variable(
    mini: MiniProject, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("INSWSN_SOLVER", "scs")
    for surroundings, solver in ((Surroundings(), "clarabel"), (chosen_surroundings(), "scs")):
        assert runs._environment(mini, surroundings)["INSWSN_SOLVER"] == solver
    monkeypatch.setenv("INSWSN_SOLVER", "")
    assert chosen_surroundings() == Surroundings()
    monkeypatch.setenv("INSWSN_SOLVER", "mosek")
    with pytest.raises(ParameterError, match=r"INSWSN_SOLVER is .mosek.; it may be one of"):
        chosen_surroundings()
