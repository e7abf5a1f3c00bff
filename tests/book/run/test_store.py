"""One request, one key, one store: what makes a run due, what finds it, how one is executed."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from conftest import MiniProject
from inswsn_book.record.files import file_digest, write_whole
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import EXECUTING, MODULES_VARIABLE
from inswsn_book.record.provenance import machine_facts
from inswsn_book.record.results import Provenance, Results
from inswsn_book.run import store
from inswsn_book.run.store import (
    ChapterError,
    Outcome,
    Request,
    Run,
    book_runs,
    keep,
    lookup,
    request_key,
    run,
    run_all,
)
from made_results import results

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import DATA_VARIABLE

PLAIN = Request("00")
EMPTY = results()

# The key -----------------------------------------------------------------------------------------


def append(name: str) -> Callable[[MiniProject], object]:
    def change(mini: MiniProject) -> None:
        with (mini.root / name).open("a") as stream:
            stream.write("\n# changed\n")

    return change


def replace_in(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.fixture
def packaged(mini: MiniProject, monkeypatch: pytest.MonkeyPatch) -> MiniProject:
    """The small project with two small packages in the place of the two of the checkout.

    The chapter takes from two modules of the science, of which one takes from a third.
    """
    folders = mini.root / "inswsn_lib", mini.root / "inswsn_book"
    rooms = [f"{room}/__init__" for room in ("record", "run", "show", "make")]
    executing = [name.partition(".")[2].replace(".", "/") for name in EXECUTING]
    others = ("__init__", "a", "b", "c", "other", "record/chapter", "make/pages")
    for folder in folders:
        for name in (*others, *rooms, *executing):
            path = folder / f"{name}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text("x = 1\n")
    # as in the checkout: a name of a room is taken over on demand
    stub = "from .chapter import ChapterRecord as ChapterRecord\n"
    (folders[1] / "record/__init__.pyi").write_text(stub)
    (folders[0] / "b.py").write_text("from inswsn_lib.c import x\n")
    monkeypatch.setattr(mini, "libraries", folders)
    replace_in(mini.source, "record.write()", "from inswsn_lib import a, b\nrecord.write()")
    return mini


def write(name: str, old: str, new: str) -> Callable[[MiniProject], object]:
    return lambda mini: replace_in(mini.root / name, old, new)


@pytest.mark.parametrize(
    ("change", "counts"),
    [
        (append("environment.lock"), True),
        (append("environment-torch.lock"), True),
        # what the chapter loads, and what that loads
        (write("inswsn_lib/a.py", "1", "2"), True),
        (write("inswsn_lib/c.py", "1", "2"), True),
        (write("inswsn_book/record/chapter.py", "1", "2"), True),
        (write("inswsn_book/run/kernels.py", "1", "2"), True),
        (lambda mini: (mini.root / "inswsn_lib/c.py").rename(mini.root / "inswsn_lib/d.py"), True),
        # what it does not load, and what is no code
        (write("inswsn_lib/other.py", "1", "2"), False),
        (write("inswsn_lib/a.py", "x", '"""A docstring."""\nx'), False),
        (append("inswsn_lib/new.py"), False),
        (append("inswsn_lib/a.py"), False),
        # the pages may change without any chapter being due, and what nobody reads
        (write("inswsn_book/make/pages.py", "1", "2"), False),
        (append("README.md"), False),
        (append("data/papers/other.txt"), False),
        (lambda mini: os.utime(mini.source, (0, 0)), False),
        # a word of prose, but not a comment in a cell, which the page shows
        (append("chapters/00-mini.md"), False),
        (write("chapters/00-mini.md", "record.write()", "record.write()  # ends"), True),
    ],
)
def test_a_change_of_content_changes_the_key(
    packaged: MiniProject, change: Callable[[MiniProject], object], counts: bool
) -> None:
    before = request_key(packaged, PLAIN)
    change(packaged)
    after = request_key(packaged, PLAIN)
    # and the part of the key that tells an entry from another library
    assert (after != before, after[:12] != before[:12]) == (counts, counts)


def test_another_request_has_another_key(mini: MiniProject) -> None:
    others = [
        Request("00", {"scale": 3.0}),
        Request("00", threads=2),
        Request("00", variables={"A": "1"}),
        Request("00", overlay={"data/papers/number.txt": "1"}),
        Request("00", overlay={"data/papers/other.txt": "1"}),
        Request("00", core=True),
    ]
    keys = [request_key(mini, request) for request in (PLAIN, *others)]
    assert len(set(keys)) == len(keys)
    assert len({key[:12] for key in keys}) == 1  # they stand beside one another in the store
    # that a parameter is set to what it is does not count
    assert request_key(mini, Request("00", {"scale": 2})) == keys[0]
    for request in (Request("00", {"scale": 0.0}), Request("00", {"other": 0.0}), Request("07")):
        with pytest.raises(ParameterError):
            request_key(mini, request)


def test_the_machine_of_a_reader_is_a_part_of_the_key(
    mini: MiniProject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its Python, whether there are recorded data, and a regressor of the reader's own."""

    def key(folder: str) -> str:
        monkeypatch.setenv(DATA_VARIABLE, folder)
        return request_key(mini, PLAIN)

    without = key("")
    for name in ("first", "second"):
        write_whole(tmp_path / name / f"{name}.txt", "")
    # which folder it is and what it holds does not count; a name of no folder gives no data
    assert key(str(tmp_path / "first")) == key(str(tmp_path / "second")) != without
    assert key(str(tmp_path / "none")) == key(str(tmp_path / "first/first.txt")) == without
    monkeypatch.setattr("platform.python_version", lambda: "3.99.0")
    assert key("") != without
    declared = "# Which.\nlearner: str = 'sklearn.svm:SVR'  # 1; a regressor\n\n# What the number"
    mini.source.write_text(mini.source.read_text().replace("# What the number", declared))
    monkeypatch.setenv(MODULES_VARIABLE, str(tmp_path))
    own = []
    for text in ("class Mine: ...\n", "class Mine: x = 1\n"):
        (tmp_path / "own.py").write_text(text)
        own.append(request_key(mini, Request("00", {"learner": "own:Mine"})))
    assert own[0] != own[1]


# The store ---------------------------------------------------------------------------------------


def test_an_entry_holds_while_its_data_are_unchanged(mini: MiniProject) -> None:
    read = results(data={"data/papers/number.txt": file_digest(mini.number)})
    kept = Run(PLAIN, read, "{}\n", {"note.csv": "a\r\nb\n"})
    with pytest.raises(InswsnError, match="Chapter 00 has not been built as it is now"):
        book_runs(mini)
    keep(mini, PLAIN, kept)
    assert book_runs(mini) == [kept]
    assert lookup(mini, Request("00", {"scale": 3.0})) is None
    mini.number.write_text("22")
    assert lookup(mini, PLAIN) is None
    mini.number.unlink()
    assert lookup(mini, PLAIN) is None


def test_what_was_run_by_hand_is_the_books_once_it_is_the_default(mini: MiniProject) -> None:
    mini.source.write_text(mini.source.read_text().replace("float = 2.0", "float = 4.0"))
    by_hand = Request("00", {"scale": 4.0})
    keep(mini, by_hand, Run(by_hand, EMPTY))
    assert lookup(mini, PLAIN) == Run(PLAIN, EMPTY)
    assert lookup(mini, Request("00", {"scale": 2.0})) is None


@pytest.mark.parametrize(
    "damage",
    [lambda b: b"", lambda b: b[:-1], lambda b: b + b" ", lambda b: b.replace(b"00", b"01", 1),
     lambda b: b.partition(b"\n")[2], lambda b: b[:64] + b"\n{\xff"],
)  # fmt: skip
def test_an_entry_that_is_damaged_is_none_and_is_told(
    mini: MiniProject, damage: Callable[[bytes], bytes]
) -> None:
    keep(mini, PLAIN, Run(PLAIN, EMPTY))
    (entry,) = (mini.store / "00").iterdir()
    whole, told = entry.read_bytes(), list[str]()
    entry.write_bytes(damage(whole))
    assert lookup(mini, PLAIN, told.append) is None
    assert told == [f"_build/store/00/{entry.name} is damaged: it is computed anew"]
    keep(mini, PLAIN, Run(PLAIN, EMPTY))  # and another takes its place
    assert entry.read_bytes() == whole


def test_old_entries_go_but_for_the_last_few(mini: MiniProject) -> None:
    source = mini.source.read_text()
    several = [PLAIN, *(Request("00", {"scale": float(n)}) for n in range(10, 16))]
    for request in several:
        keep(mini, request, Run(request, EMPTY))
    # of the present source all are kept
    assert len(list((mini.store / "00").iterdir())) == len(several)
    for edit in range(5):
        mini.source.write_text(source.replace("record.write()", f"record.write()  # {edit}"))
        keep(mini, PLAIN, Run(PLAIN, EMPTY))
        # what is written first is oldest
        os.utime(mini.store / "00" / request_key(mini, PLAIN), (edit + 2e9, edit + 2e9))
    there = []
    for edit in range(5):
        mini.source.write_text(source.replace("record.write()", f"record.write()  # {edit}"))
        there.append(lookup(mini, PLAIN) is not None)
    assert there == [False, True, True, True, True]
    assert len(list((mini.store / "00").iterdir())) == 4


# Running -----------------------------------------------------------------------------------------


def test_a_kernel_is_given_nothing_personal_and_gives_its_files_and_tables(
    mini: MiniProject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that one chapter can be asked at once."""
    write_whole(tmp_path / "matplotlibrc", "axes.linewidth: 9\n")
    # recorded data are named from where the command is run; the kernel works elsewhere
    personal = {"PYTHONPATH": str(tmp_path), "MPLCONFIGDIR": str(tmp_path), "OMP_NUM_THREADS": "7",
                "PYTHONHASHSEED": "7", DATA_VARIABLE: "recorded"}  # fmt: skip
    for name, value in personal.items():
        monkeypatch.setenv(name, value)
    monkeypatch.chdir(mini.root)
    mini.chapter(
        "import json, os, sys\nimport matplotlib\nimport pandas as pd\n"
        "from inswsn_book.show import show_table\n\n"
        "names = ('OMP_NUM_THREADS', 'PYTHONHASHSEED', 'INSWSN_DATA')\n"
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
    assert str(tmp_path) not in told.pop("path")
    assert told == {
        "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0",
        "INSWSN_DATA": str(mini.root / "recorded"), "width": 0.8,
    }  # fmt: skip
    assert run(mini, PLAIN, Quiet()) == done  # from the store


def test_an_overlay_is_as_an_edited_checkout(mini: MiniProject) -> None:
    source = mini.source.read_text()
    other = source.replace("scale * number", "scale * number + 1").replace("= 2.0", "= 3.0")
    overlay = {f"chapters/{mini.source.name}": other, "data/papers/number.txt": "5"}
    over = run(mini, Request("00", overlay=overlay), Quiet())
    assert over.results["twice"].value == 16
    assert lookup(mini, over.request) == over
    assert lookup(mini, PLAIN) is None
    assert (mini.source.read_text(), mini.number.read_text()) == (source, "21")
    # the same by hand
    mini.source.write_text(other)
    mini.number.write_text("5")
    edited = run(mini, PLAIN, Quiet())
    assert edited.results.found() == over.results.found()
    assert edited.notebook == over.notebook
    made = over.results.provenance
    assert made.sources["chapter"] == file_digest(mini.source)


@pytest.mark.parametrize(
    ("code", "said"),
    [
        # what another kernel would say of itself
        ("import sys\nsys.executable = '/usr/bin/other'",
         f"was not executed by {sys.executable} with what is installed there: its kernel is "
         "/usr/bin/other"),
        ("import importlib.metadata as m\nfrom inswsn_book.record import provenance\n"
         "provenance.package_versions.cache_clear()\nprovenance.version = lambda name: '2.3.5'",
         "with {'numpy': '2.3.5'"),
        ("import os\nos._exit(1)", "Chapter 00-mini failed in cell 5 of 6 (ch00-004)"),
        ("record.write = lambda: None", "Chapter 00-mini wrote no results file 00.json"),
        ("from pathlib import Path\nw = 'record' + '.write()'\n"
         "_ = Path(SOURCE).write_text(Path(SOURCE).read_text().replace(w, w + '  # ends'))",
         "changed while it was executed, or the library did; run it again."),
    ],
)  # fmt: skip
def test_a_chapter_that_does_not_come_to_its_end(mini: MiniProject, code: str, said: str) -> None:
    mini.chapter(code.replace("SOURCE", repr(str(mini.source))))
    with pytest.raises(ChapterError) as failure:
        run(mini, PLAIN, Quiet())
    assert said in str(failure.value)
    assert "Traceback" not in str(failure.value)
    assert not mini.store.exists()


def test_other_prose_is_woven_around_what_the_cells_gave(mini: MiniProject) -> None:
    """As if the chapter were executed anew, also where a cell with parameters is put in."""
    for request in (PLAIN, Request("00", {"scale": 3.0})):
        first = run(mini, request, Quiet())
        text = mini.source.read_text()
        recording = "```{code-cell} ipython3\nfrom inswsn_book"
        mini.source.write_text(text.replace(recording, f"+++\n\nA word.\n\n+++\n\n{recording}"))
        found, anew = lookup(mini, request), run(mini, request, Quiet(), fresh=True)
        assert found.notebook == anew.notebook != first.notebook
        assert found.results.found() == anew.results.found()
        assert found.results.cells != first.results.cells  # cells are named by their places
        made = [run.results.provenance for run in (first, found, anew)]
        assert [m.sources for m in made if m][1] == [m.sources for m in made if m][2]
        assert found.results.provenance == (
            made[0] and made[0].model_copy(update={"sources": made[2] and made[2].sources})
        )


def test_a_chapter_may_load_only_what_it_names(mini: MiniProject) -> None:
    mini.chapter("from importlib import import_module\nimport_module('inswsn_' + 'lib.models')")
    with pytest.raises(ChapterError, match=r"loads inswsn_lib\.checks, which neither its cells"):
        run(mini, PLAIN, Quiet())


def test_runs_go_side_by_side_and_a_failure_stops_all_or_not(mini: MiniProject) -> None:
    """Each of two waits for the other's mark: one after the other, neither would end."""
    mini.chapter(
        "import pathlib, time\n"
        f"here, end = pathlib.Path({str(mini.root)!r}), time.monotonic() + 600\n"
        "(here / f'mark-{scale}').touch()\n"
        "while not (here / f'mark-{7 - scale}').exists():\n"
        "    assert time.monotonic() < end\n"
        "    time.sleep(0.05)\n"
        "if scale == 4:\n    raise ValueError('It is too much.')"
    )
    asked = [Request("00", {"scale": value}) for value in (3.0, 4.0)]
    ends: dict[int, Outcome] = {}
    (done,) = run_all(mini, asked, Quiet(), ends.__setitem__, jobs=2)
    assert done == ends[0] == lookup(mini, asked[0])
    assert done.results["twice"].value == 63
    assert isinstance(ends[1], ChapterError)
    assert "It is too much." in str(ends[1])
    with pytest.raises(ChapterError, match="It is too much"):  # the other is in the store
        run_all(mini, asked, Quiet())


def test_chapters_that_take_long_begin(mini: MiniProject, monkeypatch: pytest.MonkeyPatch) -> None:
    took = {"00": 1.0, "01": 30.0, "02": None, "03": 30.0, "04": 4.0}  # 02 was never published
    order: list[str] = []

    def instantly(_: Any, request: Request, *__: Any) -> Run:
        order.append(request.chapter)
        return Run(request, EMPTY)

    for number, seconds in took.items():
        mini.source.with_name(f"{number}-mini.md").write_text(mini.source.read_text())
        if seconds is not None:
            facts = {"version": "1", "commit": None, "clean": None, "sources": {}, "finished": ""}
            ran = Provenance(seconds=seconds, **facts, **machine_facts())
            made = EMPTY.model_copy(update={"chapter": number, "provenance": ran})
            mini.publish(made)
    monkeypatch.setattr(store, "_run_and_keep", instantly)
    given = [Request(number) for number in took]
    assert [done.request for done in run_all(mini, given, Quiet(), jobs=1)] == given
    assert order == ["02", "01", "03", "04", "00"]


def test_the_core_of_a_chapter(mini: MiniProject, monkeypatch: pytest.MonkeyPatch) -> None:
    request, calls = Request("00", {"scale": 3.0}, core=True), []
    with pytest.raises(InswsnError, match=r"^Chapter 00 has no core\.$"):
        run(mini, request, Quiet())

    def core(*given: Any, brief: bool) -> tuple[Results, dict[str, str]]:
        calls.append(given[2:])
        return EMPTY, {}

    monkeypatch.setattr(store, "run_core", core)
    done = run(mini, request, Quiet())
    assert (done.notebook, done.results.found()) == (None, EMPTY)
    assert done.results.provenance is not None
    assert run(mini, request, Quiet()) == done  # found, not called again
    assert calls == [({"scale": 3.0}, 1)]
    assert lookup(mini, Request("00", {"scale": 3.0})) is None
