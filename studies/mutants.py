"""Mutate the library, and tell how many of a seeded sample of mutants its tests catch.

    python studies/mutants.py filters lmi learning vehicle

mutmut changes one operator, number, name or text of a function at a time. A mutant is caught if a
test of its room fails. What is not caught is written as a diff to ``_build/mutants/ROOM.diff``.
The exit status is 1 if a room's tests catch fewer than 85 %.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "_build" / "mutants"
ALSO = ("data", "book", "studies", "README.md", "LICENSE")
COPIED = ("inswsn_lib", "tests", "pyproject.toml", *ALSO)
LEAST = 0.85  # share of the mutants that a room's tests are to catch
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
CONFIGURATION = """
[tool.mutmut]
source_paths = ["inswsn_lib"]
only_mutate = ["inswsn_lib/{room}/*.py", "inswsn_lib/{room}.py"]
also_copy = {also}
pytest_add_cli_args_test_selection = {tests}
pytest_add_cli_args = [
    "-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist",
    "-o", "faulthandler_timeout=60", "-o", "faulthandler_exit_on_timeout=true",
]
timeout_multiplier = 5
"""
SURVIVED = (0, 33)  # the tests pass; there is none


def copy_of(room: str) -> Path:
    """Return a copy of the checkout in which one room is to be mutated."""
    copy = FOLDER / room
    shutil.rmtree(copy, ignore_errors=True)
    copy.mkdir(parents=True)
    for name in COPIED:
        source = ROOT / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, copy / name)
    tests = [f"tests/lib/{name}" for name in (room, f"test_{room}.py")]
    there = json.dumps([name for name in tests if (copy / name).exists()])
    with (copy / "pyproject.toml").open("a", encoding="utf-8") as stream:
        stream.write(CONFIGURATION.format(room=room, tests=there, also=json.dumps(ALSO)))
    return copy


def mutmut(copy: Path, *words: str) -> str:
    """Call mutmut in a copy; return what it says."""
    done = subprocess.run(
        [sys.executable, "-m", "mutmut", *words],
        cwd=copy, env=os.environ | ONE_THREAD, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stdout + done.stderr


def codes(copy: Path) -> dict[str, int | None]:
    """Return the exit code of the tests for each mutant, None where they were not run."""
    files = sorted((copy / "mutants").rglob("*.py.meta"))
    found = (json.loads(path.read_text("utf-8"))["exit_code_by_key"] for path in files)
    return {name: code for each in found for name, code in each.items()}


def tried(room: str, number: int, seed: int, processes: int) -> tuple[int, list[str]]:
    """Try a sample of a room's mutants; return how many, and the diffs of those not caught."""
    copy = copy_of(room)
    said = mutmut(copy, "run", "--max-children", str(processes), "none")
    names = sorted(codes(copy))
    if not names:
        raise SystemExit(f"There are no mutants of {room}: {said[-2000:]}")
    chosen = random.Random(seed).sample(names, min(number, len(names)))
    mutmut(copy, "run", "--max-children", str(processes), *chosen)
    results = codes(copy)
    unknown = [name for name in chosen if results[name] is None]
    if unknown:
        raise SystemExit(f"{len(unknown)} mutants of {room} were not tried, such as {unknown[0]}.")
    alive = [name for name in chosen if results[name] in SURVIVED]
    diffs = [mutmut(copy, "show", name) for name in alive]
    (FOLDER / f"{room}.diff").write_text("\n".join(diffs), encoding="utf-8")
    return len(chosen), diffs


def main() -> None:
    """Try the rooms that are named."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("rooms", nargs="+", help="such as filters, or checks")
    parser.add_argument("--number", type=int, default=200, help="of mutants a room")
    parser.add_argument("--seed", type=int, default=2026, help="of the sample")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given = parser.parse_args()
    shares = []
    for room in given.rooms:
        count, alive = tried(room, given.number, given.seed, given.jobs)
        shares.append(1 - len(alive) / count)
        print(
            f"{room}: {count - len(alive)} of {count} mutants caught, {shares[-1]:.0%}", flush=True
        )
    sys.exit(min(shares) < LEAST)


if __name__ == "__main__":
    main()
