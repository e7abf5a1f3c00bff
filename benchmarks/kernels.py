"""What a compiled Kalman filter saves over plain numpy, and what it costs to have it compiled.

Each figure is of whole processes, in turn: plain numpy, compiled and kept on disk, compiled anew.
The coefficients in `inswsn_lib.filters.kalman` and the thresholds in `inswsn_lib.kernels.choice`
are read off these lines: a kernel pays where the second column is below the first.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

_CODE = """
import sys, time, numpy as np, inswsn_lib as iw
steps, runs, gaps = map(int, sys.argv[1:])
model = iw.ErrorModel.p1(0.1, process_noise=(0.001, 0.01), measurement_noise=(0.2, 0.1))
y = np.random.default_rng(0).normal(size=(steps, 4, runs))
if gaps:
    y[np.random.default_rng(1).random(steps) < 0.3] = np.nan
begin = time.process_time()
iw.run_kalman(model, y, initial_covariance=np.eye(4))
print(time.process_time() - begin)
"""
_SIZES = [(200, 1, 1), (20_000, 1, 1), (200_000, 1, 1), (2000, 1000, 0), (2000, 20_000, 0)]


def seconds(size: tuple[int, int, int], plain: str, cache: str) -> float:
    """Return the processor time of a first call in a process of its own."""
    words = [sys.executable, "-c", _CODE, *map(str, size)]
    surroundings = os.environ | {"INSWSN_PLAIN": plain, "NUMBA_CACHE_DIR": cache}
    done = subprocess.run(words, env=surroundings, check=True, capture_output=True, text=True)
    return float(done.stdout)


def main() -> None:
    """Print a line for each size."""
    print("steps, runs, gaps: plain, kept, compiled anew (s); kept over plain")
    for size in _SIZES:
        with tempfile.TemporaryDirectory() as cache:
            anew, kept = (seconds(size, "0", cache) for _ in range(2))
        plain = seconds(size, "1", cache)
        print(f"{size}: {plain:.2f}, {kept:.2f}, {anew:.2f}; {kept / plain:.2f}")


if __name__ == "__main__":
    main()
