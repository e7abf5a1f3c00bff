"""No module needs itself: not at its head, not inside a function, not by a name in a table."""

from __future__ import annotations

from pathlib import Path

import pytest
from circles import Imports

PLANTED = {
    "at the head": {"a": "from pack import b", "b": "import pack.a"},
    "inside a function": {"a": "from pack.b import x", "b": "def f():\n    from pack.a import y"},
    "relative": {"a": "from . import b", "b": "from .a import x"},
    "by a name that a package takes over": {
        "a": "from pack.room import x",
        "room/__init__": "from pack.room.inner import x",
        "room/inner": "from pack import a",
    },
    "by a table of names": {
        "__init__": "_WHERE = {'x': 'pack.b'}\n\ndef __getattr__(name):\n    ...",
        "a": "from pack import x",
        "b": "from pack.a import y",
    },
    "by a table that leaves out the package": {
        "__init__": "_WHERE = {'x': 'b'}\n\ndef __getattr__(name):\n    ...",
        "a": "from pack import x",
        "b": "from pack.a import y",
    },
    "by a stub of names": {
        "__init__": "from lazy_loader import attach_stub",
        "__init__.pyi": "from .b import x as x",
        "a": "from pack import x",
        "b": "from pack.a import y",
    },
    "by an attribute of a package": {
        "a": "import pack.room as r\n\ndef f():\n    return r.x",
        "room/__init__": "from pack.room.inner import x",
        "room/inner": "from pack import a",
    },
    "by a relative text": {"a": "load('.b', 'pack')", "b": "from pack.a import y"},
    "by a text": {"a": "load('pack.b:x')", "b": "from pack.a import y"},
}


def plant(folder: Path, files: dict[str, str], package: str = "pack") -> Path:
    root = folder / package
    for name, text in ({"__init__": ""} | files).items():
        path = root / (name if "." in name else f"{name}.py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n", encoding="utf-8")
    return root


@pytest.mark.parametrize("kind", PLANTED)
def test_a_planted_circle_is_found(tmp_path: Path, kind: str) -> None:
    (found,) = Imports([plant(tmp_path, PLANTED[kind])]).circles()
    assert {*found} - {"pack.room"} in ({"pack.a", "pack.b"}, {"pack.a", "pack.room.inner"})


def test_a_circle_across_packages_is_found(tmp_path: Path) -> None:
    one = plant(tmp_path, {"a": "from other.b import x"})
    two = plant(tmp_path, {"b": "def f():\n    import pack.a"}, "other")
    assert Imports([one, two]).circles() == [["other.b", "pack.a"]]


def test_a_line_of_modules_is_no_circle(tmp_path: Path) -> None:
    line = {"a": "from pack import b", "b": "from pack.c import x", "c": "import math"}
    assert Imports([plant(tmp_path, line)]).circles() == []


def test_there_is_no_circle(root: Path) -> None:
    assert Imports([root / "inswsn_lib", root / "book" / "inswsn_book"]).circles() == []
