"""YAML is read as PyYAML reads it, but for what is refused; files and folders are written whole."""

from __future__ import annotations

import os
import re
import runpy
import shutil
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import files_of
from inswsn_book.record import files
from inswsn_book.record.files import (
    check_folder,
    check_listed,
    damages,
    file_digest,
    made_folder,
    read_listed,
    replace_folder,
    seal_folder,
    temporary_folder,
    text_digest,
    tree_digest,
    write_listed,
    write_whole,
)

import inswsn_lib.files
from inswsn_lib.errors import InswsnError, ParameterError


@pytest.fixture(params=[True, False], ids=["with LibYAML", "without LibYAML"])
def read(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Read a text by `read_yaml` of a module that found LibYAML, or did not."""
    monkeypatch.setattr(yaml, "__with_libyaml__", request.param)
    reader, path = runpy.run_path(inswsn_lib.files.__file__)["read_yaml"], tmp_path / "a.yaml"
    return lambda text: (path.write_text(text), reader(path))[1]


def test_a_number_in_powers_of_ten_is_one_and_a_day_a_text(read: Callable[[str], Any]) -> None:
    found = read("{a: 1e-1, b: -2.5E3, c: 2026-11-22, d: '1e3', e: yes, f: 010, g: 1:30, h: True}")
    assert found == {
        "a": 0.1, "b": -2500.0, "c": "2026-11-22", "d": "1e3", "e": "yes", "f": 10, "g": "1:30",
        "h": True,
    }  # fmt: skip


#: Each line stands for nine times the one before: 4e8 letters in 400
BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join(9 * [f'*{a}'])}]\n" for a, b in pairwise("abcdefgh")
)


def test_an_alias_is_what_it_names_and_does_not_multiply(read: Callable[[str], Any]) -> None:
    assert read("{a: &x [1, 2], b: *x}") == {"a": [1, 2], "b": [1, 2]}
    assert len(BOMB) < 400
    tracemalloc.start()
    with pytest.raises(InswsnError, match="its aliases make it 4 times as long in line 1"):
        read(BOMB)
    assert tracemalloc.get_traced_memory()[1] < 2e6
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\na: 2\n", "a.yaml is not YAML: the key a is repeated"),
        ("a: [", "a.yaml is not YAML"),
        ("\x01", "a.yaml is not YAML"),
        ("[" * 5_000 + "]" * 5_000, "a.yaml is not YAML that can be read: it is nested too deeply"),
        ("- " * 100_000, "a.yaml is not YAML"),
        ("&a [*a]", "a.yaml is not YAML"),
        ("b: *a", "a.yaml is not YAML: found undefined alias"),
        (
            "a: 1\nb: !!int ''",
            "a.yaml is not YAML: the tag tag:yaml.org,2002:int is not read.*line 2",
        ),
        ("!!bool x", "a.yaml is not YAML: the tag"),
        ("- !!timestamp x", "a.yaml is not YAML: the tag"),
        ("a: ! 7", "a.yaml is not YAML: the tag"),
        ("[1, 2]: 3", "a.yaml is not YAML: a list or a mapping is a key"),
        ("7: 1\n7.0: 2", "a.yaml is not YAML: the key 7.0 is repeated"),
    ],
    ids=lambda text: text[:12],
)
def test_what_is_no_yaml_is_one_sentence(read: Callable[[str], Any], text: str, said: str) -> None:
    with pytest.raises(InswsnError, match=said) as refusal:
        read(text)
    assert "\n" not in str(refusal.value)


def test_our_files_hold_what_pyyaml_finds_in_them(root: Path) -> None:
    def told(value: object) -> object:
        """Return what was read with numbers in powers of ten and dates as texts, in both ways."""
        if isinstance(value, dict):
            return {key: told(entry) for key, entry in value.items()}
        if isinstance(value, list):
            return [told(entry) for entry in value]
        with suppress(TypeError, ValueError):
            return float(value)
        return str(value)

    paths = sorted((root / "data").rglob("*.yaml"))
    assert len(paths) > 10
    for path in paths:
        theirs = yaml.load(path.read_text(encoding="utf-8"), Loader=yaml.CSafeLoader)
        assert told(inswsn_lib.files.read_yaml(path)) == told(theirs), path.name


def test_digests(tmp_path: Path) -> None:
    """SHA-256 of "abc" as FIPS 180-2 prints it; of a tree, names and contents count."""
    known = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    one, two = tmp_path / "one", tmp_path / "two"
    one.write_text("abc")
    two.write_text("x")
    assert text_digest("abc") == file_digest(one) == known
    before = tree_digest(tmp_path, [one, two])
    assert tree_digest(tmp_path, [two, one, one]) == before != tree_digest(tmp_path, [one])
    one.write_text("x")
    two.write_text("abc")
    assert tree_digest(tmp_path, [one, two]) != before


def test_a_file_is_written_whole_or_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    path = tmp_path / "new" / "a.txt"
    write_whole(path, "old")
    assert (path.read_text(), path.stat().st_mode & 0o777) == ("old", 0o644)
    monkeypatch.setattr(files.os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_whole(path, "new")
    assert files_of(path.parent) == {"a.txt": b"old"}


def test_a_manifest_is_what_sha256sum_writes(tmp_path: Path) -> None:
    for name in ("b.txt", "below/a b.txt", ".key"):
        write_whole(tmp_path / name, name)
    seal_folder(tmp_path)
    names = sorted(files_of(tmp_path).keys() - {"SHA256SUMS"})
    theirs = subprocess.run(
        ["sha256sum", "--", *names], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert (tmp_path / "SHA256SUMS").read_text() == theirs.stdout
    assert damages(tmp_path) == []
    write_whole(tmp_path / ".DS_Store", "of the system")  # hidden: nobody reads it
    assert damages(tmp_path) == []
    write_whole(tmp_path / ".b.txt.a1b2c3d_", "what a killed write leaves")
    assert damages(tmp_path) == []
    write_whole(tmp_path / "b.txt", "other")
    write_whole(tmp_path / "c.txt", "new")
    (tmp_path / "below" / "a b.txt").unlink()
    said = ["below/a b.txt is gone", "b.txt is changed", "c.txt is not listed"]
    assert damages(tmp_path) == said
    with pytest.raises(InswsnError, match=r"b\.txt is not the one in SHA256SUMS beside it"):
        read_listed(tmp_path / "b.txt")
    with pytest.raises(InswsnError, match=r"b\.txt is changed; c\.txt is not listed; restore the"):
        check_listed(tmp_path)
    check_listed(tmp_path / "none")  # there is nothing yet


def test_what_may_lie_beside_what_is_listed_is_a_closed_list_at_the_root(tmp_path: Path) -> None:
    write_listed(tmp_path, {"index.html": "page"})
    write_whole(tmp_path / "lib" / "one.py", "x = 1")
    seal_folder(tmp_path)
    beside = ["_build/x", "runs/mine/x", ".venv/x", ".git/x", "lib/__pycache__/one.cpython-311.pyc"]
    for name in (*beside, "lib/__pycache__/one.run-7.py311.nbi"):
        write_whole(tmp_path / name, "made while one works here")
    assert damages(tmp_path) == []
    others = [".hidden", "lib/.hidden", "lib/__pycache__/two.cpython-311.pyc", "site/_build/x.html",
              "site/__pycache__/x.html", "site/runs/x.html"]  # fmt: skip
    for name in others:
        write_whole(tmp_path / name, "of nobody")
    assert damages(tmp_path) == [f"{name} is not listed" for name in sorted(others)]


@pytest.mark.parametrize("writes", range(5))
def test_files_and_their_manifest_survive_a_kill(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, writes: int
) -> None:
    """After any number of the four writes each file is the old or the new one, and vouched for."""
    whole, done = files.write_whole, []

    def killed(*write: Any) -> None:
        if len(done) == writes:
            raise KeyboardInterrupt
        done.append(whole(*write))

    write_listed(tmp_path, {"a": "1", "b": "1", "c": "1"})
    monkeypatch.setattr(files, "write_whole", killed)
    with suppress(KeyboardInterrupt):
        write_listed(tmp_path, {"a": "2", "b": "2"})
    found = [read_listed(tmp_path / name).decode() for name in "abc"]
    assert found == [["1", "1"], ["1", "1"], ["2", "1"], ["2", "2"], ["2", "2"]][writes] + ["1"]
    assert damages(tmp_path) == []
    monkeypatch.undo()
    write_listed(tmp_path, {"a": "3"})
    assert len((tmp_path / "SHA256SUMS").read_text().splitlines()) == 3
    assert damages(tmp_path) == []


def test_folders_of_killed_processes_go(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    with temporary_folder(tmp_path) as first:
        prefix = first.name.rpartition("-")[0].removesuffix(str(os.getpid()))
        left = tmp_path / f"{prefix}{ended.pid}-x"
        for folder in (left / "below", tmp_path / "others", tmp_path / f"{prefix}nobody-x"):
            folder.mkdir(parents=True)
        with temporary_folder(tmp_path) as second:
            assert first.is_dir()
            assert second.is_dir()
            assert not left.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["others"]


@pytest.mark.parametrize("error", [None, OSError, KeyboardInterrupt])
def test_a_folder_takes_the_place_of_another_or_the_old_one_is_put_back(
    tmp_path: Path, error: type[BaseException] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    new, site, rename = tmp_path / "temporary" / "new", tmp_path / "html", Path.rename
    write_whole(new / "index.html", "new")
    write_whole(site / "index.html", "old")

    def cut_short(path: Path, target: Path) -> Path:
        if path == new and error is not None:
            raise error
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", cut_short)
    with suppress(*[error] if error else []):
        replace_folder(site, new)
    assert files_of(site) == {"index.html": b"old" if error else b"new"}


def test_no_folder_but_an_earlier_run_is_replaced(tmp_path: Path) -> None:
    out, neighbour = tmp_path / "keep", tmp_path / "keep.old" / "thesis.txt"
    write_whole(neighbour, "mine")
    for content in ("first", "second"):  # an earlier run may be replaced
        with made_folder(out) as made:
            write_whole(made / f"{content}.txt", content)
    kept = files_of(out)
    assert set(kept) == {"second.txt", ".inswsn-run", "SHA256SUMS"}
    with suppress(KeyboardInterrupt), made_folder(out) as made:
        write_whole(made / "third.txt", "third")
        raise KeyboardInterrupt
    assert files_of(out) == kept
    # a folder of somebody else's with such a manifest is none, nor one with a manifest alone
    for content in ({"data.csv": "mine"}, {}):
        write_listed(other := tmp_path / f"other-{len(content)}", content)
        with pytest.raises(ParameterError, match="one that holds only an unchanged earlier run"):
            check_folder(other)
        shutil.rmtree(other)
    # not with what has been edited, put or linked there
    for name in ("second.txt", ".inswsn-run", "note.txt", ".ipynb_checkpoints/second.txt"):
        before = files_of(out).get(name)
        write_whole(out / name, "mine")
        word = "not listed" if before is None else "changed"
        with pytest.raises(ParameterError, match=rf"{re.escape(name)} is {word}"):
            check_folder(out)
        assert (out / name).read_text() == "mine"
        if before is None:
            (out / name).unlink()
        else:
            (out / name).write_bytes(before)
    (out / "mine").symlink_to(neighbour)
    with pytest.raises(ParameterError, match="mine is not listed"):
        check_folder(out)
    (out / "mine").unlink()
    (out / "second.txt").unlink()  # nothing is lost with what the reader has removed
    check_folder(out)
    # not with anything else in it, and no file
    write_whole(out / "note.txt", "mine")
    for path in (out, neighbour):
        with pytest.raises(ParameterError, match="one that holds only an unchanged earlier run"):
            check_folder(path)
    with pytest.raises(ParameterError, match=r"must be somewhere writable \(.* is not\)"):
        check_folder(neighbour / "below")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["keep", "keep.old"]
