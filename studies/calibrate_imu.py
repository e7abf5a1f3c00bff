"""Fit the simulated INS to the INS-only cells of P1's Tables 2 and 3: `make calibrate`.

The cells are the mean absolute errors of four components over four windows (two areas and the
outage after each): sixteen cells. Two of them, the velocities of area 2 in Table 2, are the same
number printed twice and suspect; they are left out. Nine numbers are fitted: the biases of the two
accelerometers, the scale error across, the gyro bias, and the initial errors of heading, velocity
and position. The motion is without noise. The sum of the squared logarithms of rebuilt over printed
is minimised from many starting points within bounds, and the best is kept.

The path, and the times before and between the areas, are not fitted here, but they were chosen with
the same cells in view by `choose_path`: of 2,714 random paths that keep to the printed sizes this
one left the smallest residual. With two corners and two times that makes fifteen numbers for
fourteen cells, and the residual that is left says how far these cells are from one another.

No other cells are looked at.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import yaml
from inswsn_book.record.files import write_whole
from numpy.typing import NDArray
from scipy.optimize import least_squares

from inswsn_lib.checks import Array
from inswsn_lib.papers import read_table
from inswsn_lib.scenario import from_settings, load_scenario
from inswsn_lib.simulation import InertialErrors, Scene, simulate_ins

ROOT = Path(__file__).parent.parent
SEED, STARTS = 2012, 60
# name, unit, largest size
FREE = (
    ("accelerometer_bias", "m/s^2", (0.1, 0.1)),
    ("accelerometer_scale", "1", (0.2,)),  # across; along, nothing accelerates
    ("gyro_bias", "rad/s", (0.02,)),
    ("heading", "rad", (0.2,)),
    ("velocity", "m/s", (2.0, 2.0)),
    ("position", "m", (20.0, 20.0)),
)
LIMITS = np.array([size for *_, sizes in FREE for size in sizes])
CELLS = (("area1", "p1-table2", "1"), ("outage1", "p1-table3", "1"),
         ("area2", "p1-table2", "2"), ("outage2", "p1-table3", "2"))  # fmt: skip
SUSPECT = np.zeros((4, 4), dtype=bool)
SUSPECT[2, 2:] = True


def printed_cells() -> Array:
    """Return the INS-only cells, (windows, components)."""
    tables = {name: read_table(ROOT / f"data/papers/{name}.csv", "method") for _, name, _ in CELLS}
    return np.array(
        [
            [
                float(tables[name].loc["INS-only", f"{axis}{number}"])
                for axis in ("rx", "ry", "vx", "vy")
            ]
            for _, name, number in CELLS
        ]
    )


def errors_of(numbers: Array) -> InertialErrors:
    """Return the errors that the nine numbers stand for."""
    bx, by, scale, gyro, heading, vx, vy, px, py = map(float, numbers)
    return InertialErrors(
        accelerometer_bias=(bx, by), accelerometer_scale=(0.0, scale), gyro_bias=gyro,
        heading=heading, velocity=(vx, vy), position=(px, py),
    )  # fmt: skip


def rebuilt_cells(scene: Scene, errors: InertialErrors) -> Array:
    """Return the same cells of a simulation without noise."""
    motion = scene.motion
    truth = np.hstack([motion.position, motion.velocity])
    error = np.abs(simulate_ins(motion, errors)[:, :, 0] - truth)
    rows = {
        name: np.round(window.times / scene.inertial_interval).astype(int)
        for name, window in scene.windows.items()
    }
    return np.array([error[rows[name]].mean(axis=0) for name, *_ in CELLS])


def fit(scene: Scene, left_out: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the best numbers and the cells that they give."""
    printed = printed_cells()

    def residuals(numbers: Array) -> Array:
        cells = rebuilt_cells(scene, errors_of(numbers * LIMITS))
        return np.asarray(np.log(cells / printed)[~left_out])

    rng = np.random.default_rng(SEED)
    best = None
    for start in rng.uniform(-0.5, 0.5, (STARTS, len(LIMITS))):
        found = least_squares(residuals, start, bounds=(-1, 1), diff_step=1e-5, max_nfev=80)
        if best is None or found.cost < best.cost:
            best = found
    assert best is not None
    numbers = best.x * LIMITS
    return numbers, rebuilt_cells(scene, errors_of(numbers))


def settings(numbers: Array, residual: float, left_out: NDArray[np.bool_]) -> str:
    """Return the scenario entries of the fitted numbers."""
    without = ", without the two suspect ones" if left_out.any() else ", the two suspect ones too"
    entries, place = {}, 0
    for name, unit, sizes in FREE:
        values = [float(f"{x:.5g}") for x in numbers[place : place + len(sizes)]]
        at_bound = any(abs(abs(x) - s) < 1e-3 * s for x, s in zip(values, sizes, strict=True))
        place += len(sizes)
        if name == "accelerometer_scale":
            values = [0.0, *values]
        entries[name] = {
            "value": values if len(values) > 1 else values[0],
            "unit": unit,
            "source": "calibrated",
            "why": f"INS-only cells of Tables 2 and 3{without}."
            + (" At the bound of the search." if at_bound else ""),
        }
    head = (
        "# Made by `make calibrate` (studies/calibrate_imu.py); do not edit.\n"
        f"# Nine numbers, {np.sum(~left_out)} cells; root mean square of the logarithms of rebuilt "
        f"over printed: {residual:.3f}.\n"
    )
    return head + yaml.safe_dump(entries, sort_keys=False)


def main() -> None:
    """Fit without and with the suspect cells, show every cell, and write the scenario files."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "data/scenarios")
    given = parser.parse_args()
    settings = load_scenario(ROOT / "data/scenarios/p1.yaml")
    scene = from_settings(Scene, settings, inertial=InertialErrors())
    printed = printed_cells()
    fits = {"p1-inertial.yaml": SUSPECT, "p1-inertial-all-cells.yaml": SUSPECT & False}
    for name, left_out in fits.items():
        numbers, cells = fit(scene, left_out)
        log = np.log(cells / printed)
        print(f"{name}: numbers {np.round(numbers, 4).tolist()}")
        for (window, *_), row, ratio in zip(CELLS, cells, cells / printed, strict=True):
            shown = np.round(row, 3).tolist(), np.round(ratio, 2).tolist()
            print(f"  {window:8s} rebuilt {shown[0]}, over printed {shown[1]}")
        residual = float(np.sqrt(np.mean(log[~left_out] ** 2)))
        print(f"  root mean square of the logs {residual:.3f}")
        write_whole(given.out / name, settings(numbers, residual, left_out))


if __name__ == "__main__":
    main()
