"""Chapters 61 to 65: ten lines of numpy each, run by themselves, against what is known."""

from __future__ import annotations

import ast
import io
import json
import subprocess
import sys
import tokenize
from functools import cache
from pathlib import Path
from typing import Any

import jupytext
import numpy as np
import pytest
from inswsn_book.record.project import Project
from inswsn_book.record.results import read_results

from inswsn_lib.lmi import hinf_norm

PAGES = ("61", "62", "63", "64", "65")

# What each page's lines leave behind, as an expression in their own names.
LEAVES = {
    "61": "[own_row.sum(), row_below.sum(), rank]",
    "62": "[least[1], least[2]]",
    "63": "[100 * np.mean(abs(np.array(error).view(float))) / (0.2 / np.pi**0.5)]",
    "64": "peaks",
    "65": "[np.exp(np.log(ratio).mean())]",
}

# The chapter that each page names, its quantities, and how far the lines may be from them. These
# are the pages' own tolerances, stated and justified there.
T1 = "table1.position.rows-own table1.position.rows-shifted table1.selected.position-rank"
NAMED: dict[str, tuple[str, str, dict[str, float]]] = {
    "61": ("printed-numbers", T1, {"abs": 0.0}),
    "62": ("p1-lmi", "cost.position.exact cost.position.printed", {"rel": 0.003}),
    "63": ("p1-training", "headline.kf-share", {"abs": 3.0}),
    "64": ("p2-fusion", "theorem.free-identity theorem.true-identity", {"rel": 0.001}),
    "65": ("p3-vehicle", "methods.lssvm", {"abs": 0.15}),
}


@cache
def cells(root: Path, number: str) -> list[Any]:
    (source,) = (root / "chapters" / "evidence").glob(f"{number}-*.md")
    return list(jupytext.read(source, fmt="md:myst").cells)


def lines_of(root: Path, number: str) -> str:
    """Return the source of the one code cell of a page that is shown and has no tag."""
    (cell,) = (
        c for c in cells(root, number) if c.cell_type == "code" and not c.metadata.get("tags")
    )
    return str(cell.source)


def run(source: str, expression: str, folder: Path) -> list[float]:
    """Run lines in a process of their own, without the library, and return what they leave."""
    script = (
        f"{source}\n"
        "import json, sys\n"
        "assert not any(name.split('.')[0] == 'inswsn_lib' for name in sys.modules)\n"
        f"print(json.dumps([float(value) for value in {expression}]))\n"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-c", script],
        cwd=folder, capture_output=True, text=True, check=False, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return list(json.loads(done.stdout.splitlines()[-1]))


@pytest.fixture(scope="module")
def left(project: Project, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[float]]:
    folder = tmp_path_factory.mktemp("ten")
    return {n: run(lines_of(project.root, n), LEAVES[n], folder) for n in PAGES}


def changed(source: str, *pairs: tuple[str, str]) -> str:
    for old, new in pairs:
        assert source.count(old) == 1, old
        source = source.replace(old, new)
    return source


@pytest.mark.parametrize("number", PAGES)
def test_ten_lines_of_numpy_that_can_be_read(number: str, root: Path) -> None:
    """Blank lines, comments and imports do not count; no two statements stand on one line."""
    source = lines_of(root, number)
    tree = ast.parse(source)
    imports = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    of_imports = {n for node in imports for n in range(node.lineno, (node.end_lineno or 0) + 1)}
    counted = [
        line for n, line in enumerate(source.splitlines(), 1)
        if n not in of_imports and line.strip() and not line.strip().startswith("#")
    ]  # fmt: skip
    assert 1 <= len(counted) <= 10
    assert max(map(len, source.splitlines())) <= 88
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    assert not [token for token in tokens if token.string == ";"]
    starts = [node.lineno for node in ast.walk(tree) if isinstance(node, ast.stmt)]
    assert len(starts) == len(set(starts))
    names = {
        name.split(".")[0]
        for node in imports
        for name in (
            [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module]
        )
        if name
    }
    assert "numpy" in names
    assert names - {"numpy"} <= sys.stdlib_module_names
    # and no way around an import
    assert not any(word in source for word in ("__import__", "exec(", "eval("))


@pytest.mark.parametrize("number", PAGES)
def test_the_chapter_that_the_page_names_and_what_the_page_shows(
    number: str, left: dict[str, list[float]], project: Project
) -> None:
    chapter, names, tolerance = NAMED[number]
    reference = read_results(project.published / f"{chapter}.json")
    expected = [reference[name].value for name in names.split()]
    assert left[number] == pytest.approx(expected, **tolerance)
    text = "".join(cell.source for cell in cells(project.root, number))
    assert f'record.reference("{chapter}", ' in text
    assert f"<{chapter}" in text
    # the reference results of the page are what the lines give by themselves
    found = read_results(project.published / f"{number}.json").quantities
    for value in left[number]:
        assert any(abs(value - q.value) <= q.slack for q in found), value


def least_gamma_by_riccati(A: np.ndarray, C: np.ndarray) -> float:
    """Return the least gamma of a predictor, B = D = L = I, by the filter's Riccati equation."""
    low, high = 1.0, 100.0
    identity = np.eye(len(A))
    while high / low > 1 + 1e-7:
        gamma, P = (low * high) ** 0.5, identity
        for _ in range(3000):
            if np.linalg.eigvalsh(P).max() >= gamma**2:
                break
            inner = np.linalg.inv(P) + C.T @ C - identity / gamma**2
            P = A @ np.linalg.inv(inner) @ A.T + identity
        else:
            high = gamma
            continue
        low = gamma
    return high


def test_62_against_a_riccati_equation_and_another_solver(left: dict[str, list[float]]) -> None:
    A = np.array([[1, 0.2], [0, 1]])
    assert left["62"][0] == pytest.approx(least_gamma_by_riccati(A, np.eye(2)[:1]), rel=3e-3)
    # the printed inequality by an ellipsoid method on its nine rows, to the digits given
    assert left["62"] == pytest.approx([5.63494, 8.45515], rel=3e-3)


@pytest.mark.long
def test_63_in_two_limits(root: Path, tmp_path: Path) -> None:
    source = lines_of(root, "63")
    # a drift that nothing can follow: the filter is the fix
    wild = run(changed(source, ("drift = 2.81", "drift = 2810.0")), LEAVES["63"], tmp_path)
    assert wild[0] == pytest.approx(100, abs=1)
    # no drift: least squares through all fixes so far, of position and velocity
    calm = run(changed(source, ("drift = 2.81", "drift = 0.0")), LEAVES["63"], tmp_path)
    shares = []
    for T in (0.20, 0.21):
        information = np.zeros((2, 2))
        back = np.linalg.inv(np.array([[1, T], [0, 1]]))
        for _ in range(100):
            information = back.T @ information @ back + np.diag([1 / 0.02, 1 / 0.126**2])
            shares.append((np.linalg.inv(information)[0, 0] / 0.02) ** 0.5)
    assert calm[0] == pytest.approx(100 * np.mean(shares), rel=0.02)


def test_64_by_symmetry(left: dict[str, list[float]]) -> None:
    """The mean of three errors with one gain is one error whose fixes are three times as many."""
    A = np.array([[1, 0.02], [0, 1]])
    promised, true = left["64"]
    least = least_gamma_by_riccati(A, np.eye(2))
    assert promised * 3**0.5 == pytest.approx(least, rel=1e-3)
    # the gain of that least gamma, by the Riccati equation at 0.01 % more
    P = np.eye(2)
    for _ in range(3000):
        X = np.linalg.inv(np.linalg.inv(P) + (1 - (1.0001 * least) ** -2) * np.eye(2))
        P = A @ X @ A.T + np.eye(2)
    K = A @ X
    one = hinf_norm(A - K, np.hstack([np.eye(2), -K / 3**0.5]), np.eye(2))
    assert true == pytest.approx(one, rel=1e-3)
    assert (4 / 3) ** 0.5 < true < promised * 3**0.5


def test_65_one_past_outage_learned_exactly(root: Path, tmp_path: Path) -> None:
    """The difference of two independent Gaussian drifts: the root of two."""
    source = changed(
        lines_of(root, "65"),
        ("rng.integers(0, 40, n)", "np.zeros(n)"),
        ("20_000, 100", "20_000, 1e9"),
    )
    # the logarithm of a ratio has a deviation of 1 here: four standard errors
    assert run(source, LEAVES["65"], tmp_path)[0] == pytest.approx(2**0.5, rel=4 / 20_000**0.5)
