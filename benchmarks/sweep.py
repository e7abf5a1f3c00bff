"""What a sweep costs over the calls that it makes: `inswsn sweep` of chapter 02 on one worker.

Four values at 1,000 runs each, once by the command, as a process of its own with all that it starts
and writes, and once by four calls of the core in this process. Both are timed in one run, one after
the other, and have to give the same numbers.
"""

from __future__ import annotations

import os

# as in a worker: one thread
os.environ.update({f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")})

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd

from inswsn_lib.navigation import training_areas

ROOT = Path(__file__).parent.parent
VALUES, RUNS, AIM = (0.1, 1.0, 10.0, 100.0), 1000, 2.0


def by_calls() -> tuple[float, pd.DataFrame]:
    """Return the time of the calls, s, and what they find."""
    began = time.perf_counter()
    tables = [training_areas(runs=RUNS, q_scale=q).table().assign(q_scale=q) for q in VALUES]
    return time.perf_counter() - began, pd.concat(tables, ignore_index=True)


def by_command() -> tuple[float, pd.DataFrame]:
    """Return the time of the sweep, s, and its table."""
    with tempfile.TemporaryDirectory() as name:
        grid = "q_scale=" + ",".join(map(str, VALUES))
        command = [sys.executable, "-m", "inswsn_book", "--root", str(ROOT), "sweep", "02"]
        options = ["--grid", grid, "-p", f"runs={RUNS}", "--jobs", "1", "--fresh", "--out", name]
        began = time.perf_counter()
        subprocess.run([*command, *options], check=True, stdout=subprocess.DEVNULL)
        return time.perf_counter() - began, pd.read_csv(Path(name) / "sweep.csv")


if __name__ == "__main__":
    training_areas(runs=40, other_runs=40)  # compiles the problems, as a build has done
    direct, expected = by_calls()
    swept, found = by_command()
    assert (expected["median"].to_numpy() == found["value"].to_numpy()).all()
    ratio = swept / direct
    print(
        f"sweep of {len(VALUES)} cells of {RUNS} runs: {swept:.1f} s; the calls: {direct:.1f} s; "
        f"ratio {ratio:.2f} (aim: {AIM:g} or less, {'met' if ratio <= AIM else 'missed'})"
    )
