"""No module needs itself, however it takes what it takes; code needs what it names."""

from __future__ import annotations

import ast
from pathlib import Path

import networkx as nx
import pytest
from inswsn_book.record.files import Memory
from inswsn_book.record.imports import Imports, Named

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


def circles(imports: Imports) -> list[list[str]]:
    """Return the circles, each as the sorted names of its modules."""
    found = nx.strongly_connected_components(nx.DiGraph(imports.edges()))
    return sorted(sorted(group) for group in found if len(group) > 1)


def plant(folder: Path, files: dict[str, str], package: str = "pack") -> Path:
    root = folder / package
    for name, text in ({"__init__": ""} | files).items():
        path = root / (name if "." in name else f"{name}.py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n", encoding="utf-8")
    return root


@pytest.mark.parametrize("kind", PLANTED)
def test_a_planted_circle_is_found(tmp_path: Path, kind: str) -> None:
    (found,) = circles(Imports([plant(tmp_path, PLANTED[kind])]))
    assert {*found} - {"pack.b"} in ({"pack.a"}, {"pack.a", "pack.b.inner"})


def test_a_circle_across_packages_is_found(tmp_path: Path) -> None:
    one = plant(tmp_path, {"a": "from other.b import x"})
    two = plant(tmp_path, {"b": "def f():\n    import pack.a"}, "other")
    assert circles(Imports([one, two])) == [["other.b", "pack.a"]]


def test_a_line_of_modules_is_no_circle(tmp_path: Path) -> None:
    line = {"a": "from pack import b", "b": "from pack.c import x", "c": "import math"}
    assert circles(Imports([plant(tmp_path, line)])) == []


def test_there_is_no_circle(root: Path) -> None:
    assert circles(Imports([root / "inswsn_lib", root / "book" / "inswsn_book"])) == []


# What a piece of code needs -----------------------------------------------------------------------

FILES = {
    "__init__": "from lazy_loader import attach_stub",
    "__init__.pyi": "from . import room as room\nfrom .one import first as first",
    "one": "def first():\n    import pack.deep",
    "two": "",
    "deep": "",
    "room/__init__": "from pack.room.choice import choose",
    "room/choice": "def choose(name): ...",
    "room/kernel": "",
}


@pytest.mark.parametrize(
    ("code", "modules"),
    [
        ("import math", set()),
        ("from pack import first", {"pack", "pack.one", "pack.deep"}),
        ("import pack as p\np.first()", {"pack", "pack.one", "pack.deep"}),
        ("import pack.two", {"pack", "pack.two"}),
        ("run(['-m', 'pack.two'])", {"pack", "pack.two"}),
        (
            "from pack.room import choose\nchoose('kernel', f)",
            {"pack", "pack.room", "pack.room.choice", "pack.room.kernel"},
        ),
        ("from pack import room", {"pack", "pack.room", "pack.room.choice"}),
    ],
)
def test_code_needs_what_it_names(tmp_path: Path, code: str, modules: set[str]) -> None:
    found = Imports([plant(tmp_path, FILES)])
    assert found.needs(Named.of(ast.parse(code))) == modules


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ('"""Another."""\n\ndef f(x):\n    # why\n    """Doc."""\n    return x + 1', True),
        ('"""One."""\ndef f(x):\n    return x + 2', False),
        ('"""One."""\ndef f(x):\n    "value"\n    return "value"', False),
    ],
)
def test_comments_and_docstrings_do_not_count(tmp_path: Path, text: str, same: bool) -> None:
    digests = []
    for code in ('"""One."""\ndef f(x): return x + 1', text):
        memory = Memory(tmp_path / "memory")
        digests.append(Imports([plant(tmp_path, {"a": code})], memory).digest(["pack.a"]))
        memory.save()
        # what is remembered of a file is what is read of it
        assert Imports([tmp_path / "pack"]).digest(["pack.a"]) == digests[-1]
    assert (digests[0] == digests[1]) == same
