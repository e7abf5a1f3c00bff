"""Recordings by name, and other files of the same kinds."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from inswsn_book.record.files import file_digest
from made_folders import MADE, needs, values_of

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.registry import KNOWN, READERS


@pytest.mark.parametrize("kind", MADE)
def test_a_folder_of_a_kind_is_read_and_its_digests_are_kept(tmp_path: Path, kind: str) -> None:
    MADE[kind](tmp_path / "seq")
    read = logs.load(kind, tmp_path / "seq")
    assert read.name == {"csv": "a walk"}.get(kind, f"{kind}/seq")
    assert read.source == str(tmp_path / "seq")
    assert read.digests == {path.name: file_digest(path) for path in (tmp_path / "seq").iterdir()}
    # other files beside them do not matter, nor does which recording of the kind is named
    (tmp_path / "seq" / "notes.md").write_text("a note")
    for name in [name for name in KNOWN if name.startswith(kind)]:
        again = values_of(logs.load(name, str(tmp_path / "seq")))
        np.testing.assert_equal(again, values_of(read))


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("walk",), 'name must be one of "inrol/1", "inrol/2", "plaza/1", '),
        (("walk", "here"), '"rtklib/walk-0827", "inrol", "plaza", "labyrinth", "rtklib", "csv", '),
        (("csv",), "folder must be a folder with files of the kind csv, not None."),
        ((["inrol/1"],), "name must be one of "),
        (("csv", "here"), "There is no folder here."),
    ],
)
def test_what_is_not_known_is_told_with_what_is(asked: tuple[str, ...], said: str) -> None:
    with pytest.raises(InswsnError, match=re.escape(said)):
        logs.load(*asked)


def test_all_that_is_known_has_a_reader_a_source_and_a_licence() -> None:
    assert logs.names() == tuple(KNOWN)
    assert READERS.keys() == MADE.keys()
    for name, known in KNOWN.items():
        assert name.partition("/")[0] in READERS
        assert len(known.commit) == 40
        assert all(re.fullmatch(r"[0-9a-f]{64}", d) for d in known.digests.values())
        assert known.licence


#: Rows of the streams of each, and how long it lasts, s
ROWS: dict[str, tuple[dict[str, int], float]] = {
    "inrol/1": ({"imu": 19139, "ranges": 32422, "reference": 22496}, 191.25),
    "inrol/2": ({"imu": 18931, "ranges": 32289, "reference": 22200}, 189.17),
    "plaza/1": ({"odometry": 9657, "ranges": 3529, "reference": 9658}, 1933.44),
    "plaza/2": ({"odometry": 4090, "ranges": 1816, "reference": 4091}, 409.52),
    "labyrinth/1": ({"odometry": 233, "ranges": 233, "reference": 233}, 29.77),
    "rtklib/drive-0708": ({"imu": 54858, "fixes": 2197}, 551.93),
    "rtklib/walk-0827": ({"imu": 20455, "fixes": 536}, 135.33),
}


@pytest.mark.parametrize("name", [pytest.param(name, marks=needs(name)) for name in KNOWN])
def test_each_that_is_known_has_its_dimension_and_is_exported(tmp_path: Path, name: str) -> None:
    read = logs.load(name)
    assert read.digests == KNOWN[name].digests
    rows, duration = ROWS[name]
    assert {what: len(stream) for what, stream in read.streams.items()} == rows
    assert read.duration == pytest.approx(duration, abs=0.01)
    for stream in (read.ranges and read.ranges.anchors, read.fixes and read.fixes.position):
        assert stream is None or stream.shape[1] == KNOWN[name].dimension
    logs.write_csv(read, tmp_path / "exported")
    again = logs.load("csv", tmp_path / "exported")
    assert (again.name, again.licence, again.source) == (name, read.licence, read.source)
    np.testing.assert_equal(values_of(again), values_of(read))


JUNK = st.sampled_from([b"", b"\0", b"\xff", b"nan", b"-", b"1e999", b"\n", b"x", b" ", b",", b"9"])


@pytest.mark.parametrize("kind", MADE)
@given(data=st.data())
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_spoilt_file_is_read_or_told_in_a_sentence_that_names_a_file(
    tmp_path_factory: pytest.TempPathFactory, kind: str, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("spoilt")
    MADE[kind](folder)
    path = data.draw(st.sampled_from(sorted(folder.iterdir())))
    content = path.read_bytes()
    begin = data.draw(st.integers(0, len(content)))
    end = data.draw(st.sampled_from([begin, begin + 1, begin + 8, len(content)]))
    path.write_bytes(content[:begin] + data.draw(JUNK) + content[end:])
    said = ""
    try:
        logs.load(kind, folder)
    except InswsnError as error:
        said = str(error)
    assert not said or any(each.name in said for each in folder.iterdir())
    assert not said or said.endswith(".")
    assert "\n" not in said


@pytest.mark.parametrize("kind", MADE)
def test_a_file_that_is_not_there_or_twice_is_told(tmp_path: Path, kind: str) -> None:
    MADE[kind](tmp_path)
    for path in sorted(tmp_path.iterdir()):
        content = path.read_bytes()
        path.unlink()
        if kind != "csv" or path.name == "anchors.csv":
            with pytest.raises(InswsnError, match=r"There is no file |needs anchors.csv beside it"):
                logs.load(kind, tmp_path)
        path.write_bytes(content)


def test_two_files_that_fit_are_told(tmp_path: Path) -> None:
    MADE["plaza"](tmp_path)
    (tmp_path / "Other_.mat").write_bytes(b"")
    with pytest.raises(InswsnError, match=r"There are Other_.mat, Some_.mat in .*; there must be "):
        logs.load("plaza", tmp_path)
    assert logs.load("plaza", tmp_path / "Some_.mat").name == "plaza/Some_.mat"
