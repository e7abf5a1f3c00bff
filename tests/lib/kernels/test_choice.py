"""Kernels run compiled where numba is there, and as Python or numpy where it is not."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import inswsn_lib
from inswsn_lib.kernels import PLAIN, choice, choose

ROOM = Path(inswsn_lib.__file__).parent / "kernels"
KERNELS = sorted(p.stem for p in ROOM.glob("*.py") if p.stem not in ("__init__", "choice"))


def plain() -> None:
    """Stand for the numpy form of a kernel."""


@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_runs_compiled_unless_plain_is_asked_for(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for asked in (None, "", "0"):
        monkeypatch.delenv(PLAIN, raising=False)
        if asked is not None:
            monkeypatch.setenv(PLAIN, asked)
        assert hasattr(choose(name, plain).kernel, "py_func")  # numba's mark
    monkeypatch.setenv(PLAIN, "1")
    assert choose(name, plain) is plain


def test_without_another_form_its_own_source_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """In silence, as compiled: of a matrix without an inverse it divides by zero."""
    monkeypatch.setenv(PLAIN, "1")
    run = choose("eliminated")
    assert not hasattr(run, "kernel")
    with warnings.catch_warnings(action="error"):
        assert np.isinf(run(np.zeros((1, 1, 1, 1)))).all()
    monkeypatch.delenv(PLAIN)
    assert choose("eliminated", saves=0.5) is run


def test_small_work_is_plain_and_what_must_compile_pays_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for kept, pays in ((True, 1.0), (False, 8.0)):
        monkeypatch.setattr(choice, "_is_kept", lambda _, kept=kept: kept)
        monkeypatch.delenv(PLAIN, raising=False)
        assert choose("linear_recursion", plain, saves=0.99 * pays) is plain
        assert choose("linear_recursion", plain, saves=pays) is not plain
        monkeypatch.setenv(PLAIN, "0")
        assert choose("linear_recursion", plain, saves=0.0) is not plain


def run(code: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run a script in a process of its own, in which the size of the work decides."""
    return subprocess.run(
        [sys.executable, "-c", code], env=os.environ | {PLAIN: ""} | variables, check=False,
        capture_output=True, text=True,
    )  # fmt: skip


def test_the_first_call_of_a_filter_loads_no_compiler() -> None:
    """One run of 200 steps, and its design: a hundredth of a second, not six."""
    done = run(
        "import sys, numpy as np, inswsn_lib as iw\n"
        "model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)\n"
        "iw.run_kalman(model, np.ones((200, 1, 1)), initial_covariance=[[1]])\n"
        "iw.design_kalman(model, np.ones((200, 1), bool), initial_covariance=[[1]])\n"
        "assert not {'numba', 'pandas'} & sys.modules.keys()"
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_what_must_compile_says_so_once(tmp_path: Path) -> None:
    code = (
        "import numpy as np\n"
        "import sys\n"
        "from inswsn_lib.kernels import choose\n"
        "for k in range(2):\n"
        "    out = np.empty((2, 1, 1))\n"
        "    one = np.ones((1, 1, 1))\n"
        "    choose('linear_recursion', None)(one, one, one[0], one, out)\n"
        "print(out.ravel())"
    )
    for said in (1, 0):  # the second process finds it kept
        done = run(code, NUMBA_CACHE_DIR=str(tmp_path))
        assert (done.returncode, done.stdout) == (0, "[1. 2.]\n"), done.stderr
        assert done.stderr.count("compiles a kernel") == said == len(done.stderr.splitlines())
    assert run(code, NUMBA_CACHE_DIR=str(tmp_path / "other"), **{PLAIN: "0"}).stderr == ""


def test_a_full_disk_loses_nothing_but_what_would_be_kept(tmp_path: Path) -> None:
    """Numba compiles, and then cannot write."""
    done = run(
        "import numpy as np\n"
        "from inswsn_lib.kernels import choose\n"
        "from numba.core.caching import IndexDataCacheFile\n"
        "def full(*_): raise OSError(28, 'No space left on device')\n"
        "IndexDataCacheFile.save = full\n"
        "from inswsn_lib.filters.kalman import _recursion\n"
        "one, out = np.ones((1, 1, 1)), np.empty((2, 1, 1))\n"
        "choose('linear_recursion', _recursion)(one, one, one[0], one, out)\n"
        "print(out.ravel())",
        NUMBA_CACHE_DIR=str(tmp_path),
    )
    assert (done.returncode, done.stdout) == (0, "[1. 2.]\n"), done.stderr


@pytest.mark.parametrize("name", KERNELS)
def test_a_kernel_calls_no_other_file(name: str) -> None:
    """Numba's cache on disk would not see that the other file has changed."""
    tree = ast.parse((ROOM / f"{name}.py").read_text(encoding="utf-8"))
    imported = [n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
    named = [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
    allowed = {"__future__", "numba", "numpy", "math", "typing", "numpy.typing"}
    allowed |= {"inswsn_lib.kernels.choice"}
    assert {*imported, *named} <= allowed


ABSENT = """
import importlib.util as u; found = u.find_spec
u.find_spec = lambda name, *a: None if name == 'numba' else found(name, *a)
"""


@pytest.mark.parametrize("as_it_is", ["", ABSENT], ids=["broken", "absent"])
def test_without_numba_the_plain_form_runs(as_it_is: str) -> None:
    done = run(
        f"import sys; sys.modules['numba'] = None\n{as_it_is}"
        "from inswsn_lib.kernels import choose\n"
        "assert choose('linear_recursion', len) is len"
    )
    assert done.returncode == 0, done.stderr
