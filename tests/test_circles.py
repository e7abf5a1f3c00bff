"""No module needs itself: not at its head, not inside a function, not by a name on demand."""

from __future__ import annotations

from pathlib import Path

import pytest
from circles import Imports

BACK = "from pack.a import y"
PLANTED = {
    "at the head": {"a": "from pack import b", "b": "import pack.a"},
    "inside a function": {"a": "from pack.b import x", "b": f"def f():\n    {BACK}"},
    "relative": {"a": "from . import b", "b": "from .a import x"},
    "by a name that a package takes over": {
        "a": "from pack.b import x",
        "b/__init__": "from pack.b.inner import x",
        "b/inner": "from pack import a",
    },
    "by a stub of names": {
        "__init__": "from lazy_loader import attach_stub",
        "__init__.pyi": "from .b import x as x",
        "a": "from pack import x",
        "b": BACK,
    },
    "by an attribute of a package": {
        "a": "import pack.b as r\n\ndef f():\n    return r.x",
        "b/__init__": "from pack.b.inner import x",
        "b/inner": "from pack import a",
    },
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
    assert {*found} - {"pack.b"} in ({"pack.a"}, {"pack.a", "pack.b.inner"})


def test_a_circle_across_packages_is_found(tmp_path: Path) -> None:
    one = plant(tmp_path, {"a": "from other.b import x"})
    two = plant(tmp_path, {"b": "def f():\n    import pack.a"}, "other")
    assert Imports([one, two]).circles() == [["other.b", "pack.a"]]


def test_a_line_of_modules_is_no_circle(tmp_path: Path) -> None:
    line = {"a": "from pack import b", "b": "from pack.c import x", "c": "import math"}
    assert Imports([plant(tmp_path, line)]).circles() == []


def test_there_is_no_circle(root: Path) -> None:
    assert Imports([root / "inswsn_lib", root / "book" / "inswsn_book"]).circles() == []
