"""Choose the path of P1's scene, and when its areas begin, by the INS-only cells.

    python studies/choose_path.py [--paths N]

P1 shows its path in a figure that is lost. Random paths from its start to its end with two or three
corners are tried, with random times before the first area and between the areas. A candidate that
leaves the scene, is shorter than its windows, or does not cross the areas within their printed
sizes is dropped. To each of the others the nine numbers of `calibrate_imu` are fitted from four
starting points, and each candidate that is better than all before it is printed.

The path of data/scenarios/p1.yaml is candidate 1427 of the first 2,714, to one decimal. All of them
take a quarter of an hour. A test draws that candidate again and compares.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from calibrate_imu import SUSPECT, errors_of, printed_cells
from numpy.typing import NDArray
from scipy.optimize import least_squares

from inswsn_lib.checks import Array
from inswsn_lib.errors import ParameterError
from inswsn_lib.simulation import Motion, Path, simulate_ins

SEED = 1
START, END = np.array([650.0, 0.0]), np.array([130.0, 400.0])
SCENE, AREAS = (700.0, 450.0), (150.0, 100.0)  # m
RADIUS, SPEED = 20.0, 7.5  # m, m/s
AREA_SECONDS, OUTAGE_SECONDS = (20.0, 21.0), (10.0, 10.5)
INTERVAL = 0.03  # s
COARSE = 50  # points of the path for each at which it is looked at first
MARGIN = 2.0  # m, by which the path stays inside an area
STARTS = 4
LIMITS = np.array([0.3, 0.3, 0.2, 0.02, 0.2, 2.0, 2.0, 20.0, 20.0])


@dataclass(frozen=True, eq=False)
class Candidate:
    """A path with the times of its areas, and the points from which its fit starts."""

    waypoints: Array
    lead: float
    between: float
    motion: Motion
    windows: list[NDArray[np.bool_]]
    starts: Array


def windows_of(motion: Motion, spans: list[Array]) -> list[NDArray[np.bool_]]:
    """Return which times are in each span."""
    return [(motion.time >= a) & (motion.time < b) for a, b in spans]


def keeps_to_areas(motion: Motion, spans: list[Array]) -> bool:
    """Tell whether the areas, the first and the third span, are crossed within their sizes."""
    windows = windows_of(motion, spans)
    crossed = [np.ptp(motion.position[windows[i]], axis=0) for i in (0, 2)]
    return all((c <= size - MARGIN).all() for c, size in zip(crossed, AREAS, strict=True))


def candidates() -> Iterator[Candidate]:
    """Draw one candidate after the other; each is the same in every run."""
    rng = np.random.default_rng(SEED)
    while True:
        corners = rng.integers(2, 4)
        share = np.sort(rng.uniform(0.1, 0.95, corners))[:, None]
        middle = START + share * (END - START) + rng.normal(scale=90, size=(corners, 2))
        waypoints = np.vstack([START, middle, END])
        if (waypoints < 0).any() or (waypoints > SCENE).any():
            continue
        try:
            path = Path.through(waypoints, RADIUS)
        except ParameterError:  # the corners are too near to one another
            continue
        lead, between = rng.uniform(2, 20), rng.uniform(2, 25)
        edges = lead + np.cumsum(
            [0, AREA_SECONDS[0], OUTAGE_SECONDS[0], between, AREA_SECONDS[1], OUTAGE_SECONDS[1]]
        )
        if SPEED * edges[-1] > path.length + 1:
            continue
        spans = [edges[0:2], edges[1:3], edges[3:5], edges[4:6]]
        time = np.arange(0, edges[-1] + INTERVAL, INTERVAL)
        # most are dropped by a few of their points already
        if not keeps_to_areas(path.drive(SPEED, time[::COARSE]), spans):
            continue
        motion = path.drive(SPEED, time)
        if not keeps_to_areas(motion, spans):
            continue
        windows = windows_of(motion, spans)
        starts = 0.3 * rng.uniform(-LIMITS, LIMITS, (STARTS, len(LIMITS)))
        yield Candidate(waypoints, lead, between, motion, windows, starts)


def residual(candidate: Candidate) -> float:
    """Return the smallest sum of squared logarithms of rebuilt over printed cells."""
    motion, printed = candidate.motion, printed_cells()
    truth = np.hstack([motion.position, motion.velocity])

    def logs(numbers: Array) -> Array:
        error = np.abs(simulate_ins(motion, errors_of(numbers))[:, :, 0] - truth)
        cells = np.array([error[window].mean(axis=0) for window in candidate.windows])
        return np.asarray(np.log(cells / printed)[~SUSPECT])

    fits = (
        least_squares(logs, start, bounds=(-LIMITS, LIMITS), max_nfev=60, diff_step=1e-4)
        for start in candidate.starts
    )
    return float(min(2 * fit.cost for fit in fits))


def main() -> None:
    """Search, and print each candidate that is better than all before it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--paths", type=int, default=2714)
    best = np.inf
    for number, candidate in enumerate(islice(candidates(), parser.parse_args().paths), start=1):
        left = residual(candidate)
        if left < best:
            best = left
            print(
                f"{number}: {left:.4f}, waypoints {candidate.waypoints.round(1).tolist()}, "
                f"lead {candidate.lead:.2f} s, between {candidate.between:.2f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
