"""YAML is read as PyYAML reads it, but for what is refused; files and folders are written whole."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import files_of
from inswsn_book import files
from inswsn_book.files import (
    check_folder,
    file_digest,
    made_folder,
    replace_folder,
    text_digest,
    tree_digest,
    write_whole,
)

import inswsn_lib.files
from inswsn_lib.errors import InswsnError, ParameterError

# YAML --------------------------------------------------------------------------------------------


@pytest.fixture(params=[True, False], ids=["with LibYAML", "without LibYAML"])
def read_yaml(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Callable:
    """`inswsn_lib.files.read_yaml` of a module that found LibYAML, or did not."""
    monkeypatch.setattr(yaml, "__with_libyaml__", request.param)
    return runpy.run_path(inswsn_lib.files.__file__)["read_yaml"]  # type: ignore[no-any-return]


def told(value: object) -> object:
    """Return what was read with numbers in powers of ten and dates as texts, in both ways."""
    if isinstance(value, dict):
        return {key: told(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [told(entry) for entry in value]
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return str(value)


def test_our_files_hold_what_pyyaml_finds_in_them(root: Path) -> None:
    paths = sorted((root / "data").rglob("*.yaml"))
    assert len(paths) > 10
    for path in paths:
        theirs = yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
        assert told(inswsn_lib.files.read_yaml(path)) == told(theirs), path.name


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\na: 2\n", "the key a is repeated"),
        ("a: [", "is not YAML"),
        ("\x01", "is not YAML"),
        ("[" * 5_000 + "]" * 5_000, "is not YAML that can be read: it is nested too deeply"),
        ("- " * 100_000, "is not YAML"),
    ],
    ids=lambda text: text[:12],
)
def test_what_is_no_yaml_is_one_sentence(
    read_yaml: Callable[[Path], Any], tmp_path: Path, text: str, said: str
) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InswsnError) as refusal:
        read_yaml(path)
    assert str(refusal.value).startswith(f"{path} is not YAML")
    assert said in str(refusal.value)


def test_a_number_in_powers_of_ten_is_one_and_a_day_a_text(
    read_yaml: Callable[[Path], Any], tmp_path: Path
) -> None:
    path = tmp_path / "good.yaml"
    path.write_text("{a: 1e-1, b: -2.5E3, c: 2026-11-22, d: '1e3', e: yes}")
    assert read_yaml(path) == {"a": 0.1, "b": -2500.0, "c": "2026-11-22", "d": "1e3", "e": True}


# Digests -----------------------------------------------------------------------------------------


def test_digests(tmp_path: Path) -> None:
    """SHA-256 of "abc" as FIPS 180-2 prints it; of a tree, names and contents count."""
    known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    one, two = tmp_path / "one", tmp_path / "two"
    one.write_text("abc")
    two.write_text("x")
    assert text_digest("abc") == file_digest(one) == known
    before = tree_digest(tmp_path, [one, two])
    assert tree_digest(tmp_path, [two, one, one]) == before
    assert tree_digest(tmp_path, [one]) != before
    one.write_text("x")
    two.write_text("abc")
    assert tree_digest(tmp_path, [one, two]) != before


# Whole or not at all -----------------------------------------------------------------------------


def test_a_file_is_written_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "new" / "a.txt"
    write_whole(path, "old")
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("old", 0o644)

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(files.os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert [entry.name for entry in path.parent.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("error", [None, OSError, KeyboardInterrupt])
def test_a_folder_takes_the_place_of_another_or_the_old_one_is_put_back(
    tmp_path: Path, error: type[BaseException] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    new, site = tmp_path / "temporary" / "new", tmp_path / "html"
    write_whole(new / "index.html", "new")
    write_whole(site / "index.html", "old")
    if error is None:
        replace_folder(site, new)
        assert (site / "index.html").read_text() == "new"
        assert not new.exists()
        return
    rename = Path.rename

    def cut_short(path: Path, target: Path) -> Path:
        if path == new:
            raise error
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", cut_short)
    with pytest.raises(error):
        replace_folder(site, new)
    assert (site / "index.html").read_text() == "old"


def test_no_folder_but_an_earlier_run_is_replaced(tmp_path: Path) -> None:
    out, neighbour = tmp_path / "keep", tmp_path / "keep.old" / "thesis.txt"
    write_whole(neighbour, "mine")
    for content in ("first", "second"):  # an earlier run may be replaced
        with made_folder(out) as made:
            write_whole(made / f"{content}.txt", content)
    assert (out / "second.txt").read_text() == "second"
    assert not (out / "first.txt").exists()
    with suppress(KeyboardInterrupt), made_folder(out) as made:
        write_whole(made / "third.txt", "third")
        raise KeyboardInterrupt
    assert not (out / "third.txt").exists()
    # not with anything else in it, and no file
    write_whole(out / "note.txt", "mine")
    for path in (out, neighbour):
        with pytest.raises(ParameterError, match="one that holds an earlier run alone"):
            check_folder(path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["keep", "keep.old"]
    with pytest.raises(ParameterError, match=r"where one can write, and .* is not"):
        check_folder(neighbour / "below")
    assert files_of(neighbour.parent) == {"thesis.txt": b"mine"}
