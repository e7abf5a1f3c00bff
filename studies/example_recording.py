"""Make data/examples/ins-wsn.csv, the recording that the chapter on your own data runs on.

    python studies/example_recording.py [FILE]

A walker turns through two bends. The INS integrates the true acceleration with a constant bias and
white noise. The network gives positions and velocities with white noise, and is silent twice. Time
stamps are rounded to 1 ms and jitter, and a few rows are missing, as in a real recording.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from inswsn_book.record.files import write_whole

from inswsn_lib.logs import INS, REFERENCE, TIME, WSN

SEED = 20120707
PERIOD, STEPS = 0.2, 301
SPEED = 1.4  # m/s
BIAS = (0.012, -0.009)  # m/s^2
ACCELERATION_NOISE = 0.05  # m/s^2, of each sample
FIX_NOISE = (0.2, 0.1)  # m, m/s
SILENT = ((20.0, 32.0), (46.0, 54.0))  # s
MISSING_ROWS = (37, 38, 120)


def make() -> str:
    """Return the text of the file."""
    rng = np.random.default_rng(SEED)
    time = PERIOD * np.arange(STEPS)
    heading = 0.3 + 0.9 * np.sin(2 * np.pi * time / 40)
    velocity = SPEED * np.column_stack([np.cos(heading), np.sin(heading)])
    steps = (velocity[1:] + velocity[:-1]) / 2 * PERIOD
    position = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    wrong = np.array(BIAS) + ACCELERATION_NOISE * rng.standard_normal((STEPS - 1, 2))
    drift = np.vstack([np.zeros(2), np.cumsum(wrong * PERIOD, axis=0)]) + np.array([0.05, -0.03])
    lost = np.vstack([np.zeros(2), np.cumsum((drift[1:] + drift[:-1]) / 2 * PERIOD, axis=0)])
    reference = np.hstack([position, velocity])
    ins = reference + np.hstack([lost + np.array([0.5, 0.3]), drift])
    wsn = reference + np.repeat(FIX_NOISE, 2) * rng.standard_normal((STEPS, 4))
    for first, last in SILENT:
        wsn[(time >= first) & (time < last)] = np.nan
    stamps = time + 0.002 * rng.standard_normal(STEPS)
    lines = [
        "# Simulated: a walker with an INS and a sensor network that is silent twice.",
        f"# Made by studies/example_recording.py, seed {SEED}.",
        ",".join((TIME, *INS, *WSN, *REFERENCE)),
    ]
    for k in range(STEPS):
        if k not in MISSING_ROWS:
            cells = [f"{stamps[k]:.3f}", *map(_cell, (*ins[k], *wsn[k], *reference[k]))]
            lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def _cell(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.4f}"


if __name__ == "__main__":
    default = Path(__file__).parent.parent / "data" / "examples" / "ins-wsn.csv"
    write_whole(Path(sys.argv[1]) if len(sys.argv) > 1 else default, make())
