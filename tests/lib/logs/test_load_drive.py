"""The recorded drive: made files that are read, and how the original ones are had."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pooch
import pytest
import requests
from inswsn_book.record.files import file_digest
from made_folders import make_rtklib, values_of

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import DATA_VARIABLE
from inswsn_lib.logs import RecordingUnavailableError, load_drive
from inswsn_lib.logs.files import locate
from inswsn_lib.logs.registry import KNOWN
from inswsn_lib.logs.rtklib import read_rtklib

NAME = "rtklib/drive-0708"
IMU, TAG, POSITIONS = NAMES = ("imu_1934.csv", "imu_1934.csv.tag", "gnss_1934_sf.pos")
MIRROR = "rtklibexplorer__GNSS_IMU/8235ee6c5f349db529bf43ad556a3769b346b5a1/data/drive_0708"


def take(monkeypatch: pytest.MonkeyPatch, *paths: Path) -> None:
    """Take files for the originals."""
    digests = {path.name: file_digest(path) for path in paths}
    monkeypatch.setitem(KNOWN, NAME, replace(KNOWN[NAME], digests=digests))


def test_the_axes_are_forward_right_down(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_rtklib(tmp_path / MIRROR)
    take(monkeypatch, *(tmp_path / MIRROR).iterdir())
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path))
    read = load_drive()
    assert (read.name, read.licence, read.digests) == (
        NAME, KNOWN[NAME].licence, KNOWN[NAME].digests,
    )  # fmt: skip
    assert read.source.endswith("8235ee6c5f349db529bf43ad556a3769b346b5a1/data/drive_0708")
    found, logged = values_of(read), values_of(read_rtklib(tmp_path / MIRROR))
    for name in ("imu.rate", "imu.force"):
        x, y, z = np.transpose(logged.pop(name))
        assert np.array_equal(found.pop(name), np.column_stack([-x, y, -z]))
    np.testing.assert_equal(found, logged)


# --- where the files are ---


@pytest.fixture
def known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A mirror of small files whose digests are taken for those of the originals."""
    folder = tmp_path / "mirror" / MIRROR
    folder.mkdir(parents=True)
    for name in NAMES:
        (folder / name).write_text(f"content of {name}\n")
    take(monkeypatch, *(folder / name for name in NAMES))
    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    return tmp_path / "mirror"


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, known: Path) -> list[str]:
    """The URLs that are asked for; the network has what the mirror has."""
    urls: list[str] = []

    def give(self: Any, url: str, output: str, pooch: object, check_only: bool = False) -> None:
        urls.append(url)
        assert self.kwargs["timeout"][0] <= 10
        Path(output).write_bytes((known / MIRROR / url.rsplit("/", 1)[1]).read_bytes())

    monkeypatch.setattr(pooch.HTTPDownloader, "__call__", give)
    return urls


def fetched(cache: Path | None = None) -> dict[str, Path]:
    return locate(KNOWN[NAME], cache)


def test_a_mirror_is_taken_instead_of_the_network_and_has_each_file_as_it_is(
    known: Path, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(DATA_VARIABLE, str(known))
    assert fetched() == {name: known / MIRROR / name for name in NAMES}
    (known / MIRROR / POSITIONS).write_text("another\n")
    with pytest.raises(InswsnError, match=rf"{POSITIONS} is not the original"):
        fetched()
    (known / MIRROR / IMU).unlink()
    with pytest.raises(InswsnError, match=rf"There is no file .*{IMU}; INSWSN_DATA may name"):
        fetched()
    assert asked == []


def test_files_are_fetched_once_in_silence_and_mended(
    tmp_path: Path,
    asked: list[str],
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said: list[logging.LogRecord] = []  # pooch writes to the stderr that was there at its import
    listener = logging.Handler()
    listener.emit = said.append
    pooch.get_logger().addHandler(listener)
    level = pooch.get_logger().level
    files = fetched(tmp_path / "cache")
    base = f"https://raw.githubusercontent.com/{MIRROR.replace('__', '/', 1)}/"
    assert asked == [base + name for name in NAMES]
    assert {n: p.read_text() for n, p in files.items()} == {n: f"content of {n}\n" for n in NAMES}
    assert fetched(tmp_path / "cache") == files
    assert len(asked) == 3
    files[TAG].write_text("spoilt")
    assert fetched(tmp_path / "cache")[TAG].read_text() == f"content of {TAG}\n"
    assert len(asked) == 4
    pooch.get_logger().removeHandler(listener)
    assert (said, tuple(capfd.readouterr())) == ([], ("", ""))
    assert pooch.get_logger().level == level
    monkeypatch.setenv(DATA_VARIABLE, str(tmp_path / "cache"))  # a cache is a mirror
    assert fetched() == files
    monkeypatch.delenv(DATA_VARIABLE)
    monkeypatch.setattr(pooch, "os_cache", lambda project: tmp_path / project)
    assert all(path.is_relative_to(tmp_path / "inswsn") for path in fetched().values())


@pytest.mark.parametrize(
    "cause",
    [
        requests.exceptions.ConnectTimeout("HTTPSConnectionPool: timed out.\nMax retries."),
        PermissionError(13, "Permission denied"),
    ],
)
def test_no_network_is_told_in_one_sentence(
    tmp_path: Path, known: Path, monkeypatch: pytest.MonkeyPatch, cause: Exception
) -> None:
    tried: list[str] = []

    def fail(self: object, url: str, *rest: object, **more: object) -> None:
        tried.append(url)
        raise cause

    monkeypatch.setattr(pooch.HTTPDownloader, "__call__", fail)
    with pytest.raises(
        RecordingUnavailableError, match=r"imu_1934.csv, .*could not .*\.$"
    ) as error:
        load_drive(tmp_path / "cache")
    assert f"({type(cause).__name__})" in str(error.value)
    assert "\n" not in str(error.value)
    assert len(tried) == 1


def test_a_file_that_is_not_what_was_asked_for_is_not_taken(
    tmp_path: Path, known: Path, asked: list[str]
) -> None:
    (known / MIRROR / POSITIONS).write_text("<html>log in</html>")
    with pytest.raises(RecordingUnavailableError, match=r"pos could not .*its SHA-256 is another"):
        fetched(tmp_path / "cache")
    assert not list((tmp_path / "cache").rglob("*.pos"))
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(RecordingUnavailableError, match="could not be fetched"):
        fetched(tmp_path / "taken")
