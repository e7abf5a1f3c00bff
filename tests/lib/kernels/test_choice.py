"""Kernels run compiled where numba is there, and as plain numpy where it is not."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import inswsn_lib
from inswsn_lib.kernels import PLAIN, choose

ROOM = Path(inswsn_lib.__file__).parent / "kernels"
KERNELS = sorted(p.stem for p in ROOM.glob("*.py") if p.stem not in ("__init__", "choice"))


def plain() -> None:
    """Stand for the numpy form of a kernel."""


@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_runs_compiled_unless_plain_is_asked_for(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(PLAIN, raising=False)
    assert hasattr(choose(name, plain), "py_func")  # numba's mark
    monkeypatch.setenv(PLAIN, "1")
    assert choose(name, plain) is plain


@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_calls_no_other_file(name: str) -> None:
    """Numba's cache on disk would not see that the other file has changed."""
    tree = ast.parse((ROOM / f"{name}.py").read_text(encoding="utf-8"))
    imported = [n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    named = [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    allowed = {"__future__", "numba", "numpy", "math", "typing", "numpy.typing"}
    assert {*imported, *named} <= allowed


def test_without_numba_the_plain_form_runs() -> None:
    code = (
        "import sys; sys.modules['numba'] = None\n"
        "import importlib.util as u; found = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'numba' else found(name, *a)\n"
        "from inswsn_lib.kernels import choose\n"
        "assert choose('any', len) is len"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {PLAIN: ""}, check=False,
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
