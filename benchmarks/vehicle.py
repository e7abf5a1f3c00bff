"""The vehicle's filter against that of pyins on the same drive, and the price of learning.

P3's simulated drive, made half an hour long, is run by this library and by pyins' feedback filter,
from the same start and with the same noises; both errors against the truth, and how far their
standard deviations are apart, are compared first and written beside the times. pyins makes two
passes: each takes minutes. Its time for many runs is that of a pass times their number; ours is
measured, all runs in one process, a block that fits in memory after the other. A refit of the
LS-SVM that chooses its own parameters is held against one epoch of the filter. The figures go to
data/benchmarks-vehicle.yaml: `make bench`. Times are those of the processor, because the passes of
pyins are too long to be repeated until nothing else disturbs them.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from inswsn_book.evidence.vehicle_model import run_pyins
from inswsn_book.record.files import write_whole
from inswsn_book.record.provenance import machine_facts
from throughput import Row, row

from inswsn_lib.checks import Array
from inswsn_lib.inertial import metres
from inswsn_lib.learning import SelectedLSSVM
from inswsn_lib.navigation.vehicle_outages import p3_settings
from inswsn_lib.scenario import with_values
from inswsn_lib.simulation import Drive, simulate_sensors, true_motion
from inswsn_lib.vehicle import FilterSettings, VehicleRun, position_error, run_vehicle_filter

OUT = Path(__file__).parent.parent / "data" / "benchmarks-vehicle.yaml"
DURATION, RUNS = 1800, 8
#: Runs of the large comparison, and how many of them are in memory at once; passes of pyins
MANY, BLOCK, PASSES = 200, 10, 2
SCENARIO = with_values(p3_settings(), duration=float(DURATION))
SETTINGS = FilterSettings.from_settings(SCENARIO)
TRUTH = true_motion(SCENARIO)


def least(work: Callable[[], object], repeats: int) -> float:
    """Return the least processor time of several repetitions, s."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return min(times)


def make_drive(runs: int, seed: int) -> Drive:
    """Return the drive with sensors, of some runs."""
    return simulate_sensors(TRUTH, SCENARIO, runs=runs, seed=seed)


def by_pyins(drive: Drive) -> tuple[float, Array, pd.DataFrame]:
    """Return pyins' processor time (s), and its positions and deviations at the epochs."""
    began = time.process_time()
    places, deviations = run_pyins(drive, SETTINGS, len(drive.time) - 1, step=0.1)
    taken = time.process_time() - began
    return taken, places[:-1], deviations.iloc[:-1]  # it leaves out the last fix


def compare(
    drives: list[Drive], ours: list[VehicleRun], passes: list[tuple[Array, pd.DataFrame]]
) -> Row:
    """Return how good both are, and how far apart their positions and deviations are at most.

    Raises
    ------
    SystemExit
        If one is better than the other by 2 %: then times say nothing.
    """
    squares, apart = [], []
    for drive, run, (lla, sd) in zip(drives, ours, passes, strict=True):
        steps = slice(60, len(lla))  # once both have settled
        states = run.states[: len(lla), 0]
        true = drive.reference.position[: len(lla)]
        theirs = ((lla - true) * metres(true))[steps]
        mine = position_error(run, drive)[steps, :, 0]
        squares.append([(mine**2).sum(axis=1).mean(), (theirs**2).sum(axis=1).mean()])
        deviation = np.sqrt(np.diagonal(states.covariance, axis1=1, axis2=2))[steps]
        of_position = deviation[:, :3] * metres(true)[steps]
        names = ("north", "east", "down"), ("VE", "VN", "VD")
        ratios = [
            own / sd[list(columns)].to_numpy()[steps]
            for own, columns in zip((of_position, deviation[:, 3:6]), names, strict=True)
        ]
        yaws = np.rad2deg(deviation[:, 8]) / sd.heading.to_numpy()[steps]
        away = (states.position - lla) * metres(true)
        found = [np.abs(away[steps] / of_position), *(np.abs(x - 1) for x in (*ratios, yaws))]
        apart.append([x.max() for x in found])
    ours_rms, pyins_rms = np.sqrt(np.mean(squares, axis=0))
    if abs(ours_rms / pyins_rms - 1) > 0.02:
        raise SystemExit(f"The accuracy differs: {ours_rms:.3f} m and {pyins_rms:.3f} m.")
    position, *deviations = np.max(apart, axis=0)
    return {
        "rms_ours_m": f"{ours_rms:.3f}",
        "rms_pyins_m": f"{pyins_rms:.3f}",
        "positions_apart_of_deviation": f"{position:.4f}",
        **{
            f"deviations_apart_{name}": f"{x:.4f}"
            for name, x in zip(("position", "velocity", "yaw"), deviations, strict=True)
        },
    }


def many_runs(settings: FilterSettings) -> float:
    """Return the processor time of all runs, s; making their sensors is not timed."""
    taken = 0.0
    for block in range(MANY // BLOCK):
        drive = make_drive(BLOCK, 100 + block)
        _ = drive.increments, drive.measurements  # as a simulated drive has them at once
        began = time.process_time()
        run_vehicle_filter(drive, settings, aiding=False)
        taken += time.process_time() - began
    return taken


def refit(epoch: float) -> Row:
    """Return the row of one refit on a window of 40 s."""
    rng = np.random.default_rng(8)
    X, y = rng.standard_normal((40, 4)), rng.standard_normal((40, 2))
    machine = SelectedLSSVM()
    taken = least(lambda: machine.fit(X, y), 20)
    trials = machine.selection_.errors.size
    return row(
        "p3-vehicle",
        f"one refit of the LS-SVM, 40 samples, 4 inputs, 2 outputs, {trials} candidate pairs "
        f"({1000 * taken:.3g} ms)",
        f"one epoch of the filter, one run ({1000 * epoch:.2g} ms); ours over that",
        taken / epoch,
    )


def main() -> None:
    """Time everything and write the figures."""
    warnings.simplefilter("ignore")  # of pyins
    drive = make_drive(RUNS, 7)
    drives = [make_drive(1, k) for k in range(PASSES)]
    run_vehicle_filter(drives[0], SETTINGS, last=3)  # compiles the loop, or loads it
    run_pyins(drives[0], SETTINGS, 3, step=0.1)
    ours = [run_vehicle_filter(each, SETTINGS, aiding=False) for each in drives]
    times, *passes = zip(*(by_pyins(each) for each in drives), strict=True)
    accuracy = compare(drives, ours, list(zip(*passes, strict=True)))
    taken = float(np.mean(times))
    alone = drives[0]
    single = least(partial(run_vehicle_filter, alone, SETTINGS, aiding=False), 3)
    fine = FilterSettings(**{**vars(SETTINGS), "substeps": 10})
    tenth = least(partial(run_vehicle_filter, alone, fine, aiding=False), 3)
    together = least(partial(run_vehicle_filter, drive, SETTINGS, aiding=False), 2)
    many, many_fine = many_runs(SETTINGS), many_runs(fine)
    peer = f"pyins' run_feedback_filter, time_step 0.1 s ({taken:.0f} s); theirs over ours"
    drove = f"{DURATION // 60} minutes at {1 / TRUTH.period:.0f} Hz"
    rows = [
        row("p3-vehicle", f"filter, {drove}, one run ({single:.2g} s)", peer, taken / single, 10),
        row("p3-vehicle", f"the same with steps of 0.1 s ({tenth:.2g} s)", peer, taken / tenth, 10),
        row(
            "p3-vehicle", f"the same, {RUNS} runs at once ({together:.2g} s)",
            f"{peer}, times {RUNS}", RUNS * taken / together,
        ),
        refit(single / (len(alone.time) - 1)),
        row(
            "p3-vehicle", f"the filter, {drove}, {MANY} runs ({many:.3g} s)",
            f"{peer}, times {MANY}", MANY * taken / many, 2000,
        ),
        row(
            "p3-vehicle", f"the same with steps of 0.1 s ({many_fine:.3g} s)",
            f"{peer}, times {MANY}", MANY * taken / many_fine, 2000,
        ),
    ]  # fmt: skip
    for line in rows:
        print(f"{line['work']}, against {line['against']}: {line['ratio']} (aim: {line['aim']})")
    print(accuracy)
    facts = machine_facts()
    content = {
        "machine": f"{facts['cpu']}, {facts['cores']} cores, {facts['system']}, "
        f"Python {facts['python']}, numpy {np.__version__}, pyins {version('python-ins')}",
        "date": datetime.now(UTC).date().isoformat(),
        "rows": rows,
        "accuracy": accuracy,
    }
    head = "# Made by `make bench` (benchmarks/vehicle.py); do not edit.\n"
    write_whole(OUT, head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
    print(f"Wrote {OUT.relative_to(OUT.parent.parent)}.")


if __name__ == "__main__":
    main()
