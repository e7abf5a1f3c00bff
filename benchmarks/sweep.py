"""What a sweep costs over the calls that it makes: `inswsn sweep p1-training` on one worker.

Four values at 1,000 runs each, by the command, as a process of its own with all that it starts and
writes, and by four calls of the core in this process: half of them before it and half after, so
that both meet the same load of the machine. Both have to give the same numbers. Beside the times by
the clock stand those of the processor, which know of no other process.
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

from inswsn_lib.navigation import TrainingAreas

ROOT = Path(__file__).parent.parent
VALUES, RUNS, AIM = (0.1, 1.0, 10.0, 100.0), 1000, 2.0


def by_calls(values: tuple[float, ...]) -> tuple[float, float, pd.DataFrame]:
    """Return the time of the calls by clock and processor, s, and what they find."""
    clock, processor = time.perf_counter(), time.process_time()
    tables = [
        TrainingAreas(runs=RUNS, q_scale=q).scores().table().assign(q_scale=q) for q in values
    ]
    found = pd.concat(tables, ignore_index=True)
    return time.perf_counter() - clock, time.process_time() - processor, found


def by_command() -> tuple[float, float, pd.DataFrame]:
    """Return the time of the sweep by clock and processor, s, and its table."""
    with tempfile.TemporaryDirectory() as name:
        grid = "q_scale=" + ",".join(map(str, VALUES))
        command = [sys.executable, "-m", "inswsn_book", "--root", str(ROOT), "sweep", "p1-training"]
        options = ["--grid", grid, "-p", f"runs={RUNS}", "--jobs", "1", "--fresh", "--out", name]
        clock, before = time.perf_counter(), os.times()
        subprocess.run([*command, *options], check=True, stdout=subprocess.DEVNULL)
        clock, after = time.perf_counter() - clock, os.times()
        processor = sum(after[2:4]) - sum(before[2:4])  # of processes that have ended
        return clock, processor, pd.read_csv(Path(name) / "sweep.csv")


if __name__ == "__main__":
    TrainingAreas(runs=40, other_runs=40).scores()  # compiles the problems
    *first, before = by_calls(VALUES[:2])
    *swept, found = by_command()
    *last, after = by_calls(VALUES[2:])
    expected = pd.concat([before, after])["median"]
    assert (expected.to_numpy() == found["value"].to_numpy()).all()
    for name, sweep, one, two in zip(("clock", "processor"), swept, first, last, strict=True):
        print(
            f"by the {name}: sweep of {len(VALUES)} cells of {RUNS} runs {sweep:.1f} s, the calls "
            f"{one:.1f} and {two:.1f} s; ratio {sweep / (one + two):.2f}"
        )
    met = swept[0] <= AIM * (first[0] + last[0])
    print(f"aim: {AIM:g} or less, {'met' if met else 'missed'}")
