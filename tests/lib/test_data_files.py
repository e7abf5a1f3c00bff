"""What the library reads: its own files, YAML, and the folder that a user names."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from inswsn_book.judge.claims import read_verdicts
from inswsn_book.record.results import read_results

import inswsn_lib as iw
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import DATA_VARIABLE, data_file, data_mirror, read_bytes, read_yaml
from inswsn_lib.navigation import read_tables, read_trials


def test_a_file_of_the_checkout(root: Path) -> None:
    assert data_file("scenarios/p1.yaml") == root / "data" / "scenarios" / "p1.yaml"
    with pytest.raises(InswsnError, match="no data file 'scenarios/p9"):
        data_file("scenarios/p9.yaml")


def test_the_folder_of_recorded_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recorded").mkdir()
    (tmp_path / "file").touch()
    for named, found in (
        ("recorded", tmp_path / "recorded"), (str(tmp_path), tmp_path), ("file", None),
        ("absent", None), ("", None),
    ):  # fmt: skip
        monkeypatch.setenv(DATA_VARIABLE, named)
        assert data_mirror() == found
    monkeypatch.delenv(DATA_VARIABLE)
    assert data_mirror() is None


def test_numbers_dates_and_keys_of_yaml(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("{a: 1e-1, b: -2E+3, c: .5e1, d: 1.e2, e: 2012-07-07, f: 1e, g: 10, h: yes}")
    assert read_yaml(path) == {
        "a": 0.1, "b": -2000.0, "c": 5.0, "d": 100.0, "e": "2012-07-07", "f": "1e", "g": 10,
        "h": "yes",
    }  # fmt: skip
    for text, said in (
        ("a: 1\nb: {c: 1, c: 2}", "the key c is repeated.*line 2"),
        ("a: [", "is not YAML"),
    ):
        path.write_text(text)
        with pytest.raises(InswsnError, match=said):
            read_yaml(path)
    path.write_bytes(b"a: 1\n\xff")
    with pytest.raises(InswsnError, match=r"a\.yaml is not UTF-8 text: .* in line 2\.$"):
        read_yaml(path)
    with pytest.raises(InswsnError, match=r"^There is no file .*absent\.yaml\.$"):
        read_yaml(tmp_path / "absent.yaml")


def test_a_file_that_a_user_names_is_regular_and_of_bounded_size(tmp_path: Path) -> None:
    """A device or a pipe may never end, and a file be larger than memory."""
    path, pipe = tmp_path / "a.csv", tmp_path / "pipe"
    path.write_bytes(b"x" * 3_000_001)
    assert len(read_bytes(path)) == 3_000_001
    os.mkfifo(pipe)
    for wrong, said in (
        (path, "has more than 3 MB"), (pipe, r"^[^:]*pipe is not a regular file\.$"),
        (Path("/dev/zero"), "^/dev/zero is not a regular"), (path / "below", "cannot be read"),
        (tmp_path, "is a folder"),
    ):  # fmt: skip
        with pytest.raises(InswsnError, match=said):
            read_bytes(wrong, 3_000_000)
    for read in (iw.read_recording, read_verdicts, read_results, read_tables, read_trials):
        for endless in (pipe, Path("/dev/zero")):
            with pytest.raises(InswsnError, match=re.escape(str(endless))):
                read(endless)
