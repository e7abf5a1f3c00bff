"""The vehicle's filter against that of pyins on the same drive, and the price of learning.

A drive of half an hour, made by the simulator of pyins, with errors of a cheap IMU and GPS once a
second, is run by this library and by `pyins.filters.run_feedback_filter`, from the same start and
with the same noises; both errors against the truth, and how far their standard deviations are
apart, are compared first and written beside the times. pyins makes two passes: each takes minutes.
Its time for many runs is that of a pass times their number; ours is measured, all runs in one
process, a block that fits in memory after the other. A refit of the LS-SVM that chooses its own
parameters is held against one epoch of the filter. The figures go to data/benchmarks-vehicle.yaml:
`make bench`. Times are those of the processor, because the passes of pyins are too long to be
repeated until nothing else disturbs them.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from inswsn_book.record.files import write_whole
from inswsn_book.record.provenance import machine_facts
from pyins import filters, inertial_sensor, measurements, sim, strapdown, transform
from pyins.util import DV_COLS, LLA_COLS, RPH_COLS, THETA_COLS, TRAJECTORY_COLS, VEL_COLS
from throughput import Row, row

from inswsn_lib.inertial import metres
from inswsn_lib.learning import SelectedLSSVM
from inswsn_lib.simulation import Drive, DriveReference
from inswsn_lib.vehicle import FilterSettings, VehicleRun, align, position_error, run_vehicle_filter

OUT = Path(__file__).parent.parent / "data" / "benchmarks-vehicle.yaml"
DURATION, PERIOD, RUNS = 1800, 0.01, 8
#: Runs of the large comparison, and how many of them are in memory at once; passes of pyins
MANY, BLOCK, PASSES = 200, 10, 2
#: North-east-down to east-north-up
TURN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
SETTINGS = FilterSettings(
    accelerometer_noise=0.01, gyro_noise=float(np.deg2rad(0.05)),
    accelerometer_walk=1e-5, gyro_walk=1e-7,
    position=3.0, velocity=0.05, tilt=float(np.deg2rad(2)), yaw=float(np.deg2rad(5)),
    accelerometer_bias=0.05, gyro_drift=float(np.deg2rad(0.1)),
    compass=float(np.deg2rad(0.15)), lateral=0.05, gps_position=3.0, gps_velocity=0.05,
)  # fmt: skip


def least(work: Callable[[], object], repeats: int) -> float:
    """Return the least processor time of several repetitions, s."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return min(times)


@cache
def trajectory() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return a winding drive that begins at rest, and its increments without error."""
    t = np.arange(DURATION * 100 + 1) * PERIOD
    begun = np.clip(t - 2, 0, None)
    speed = 10 * (1 - np.exp(-(begun**2) / 50)) + 2 * np.sin(begun / 7) * (1 - np.exp(-begun / 5))
    heading = 0.5 + 1.2 * np.sin(begun / 11) * (1 - np.exp(-begun / 5)) + begun / 300
    zero = np.zeros_like(t)
    velocity = speed[:, None] * np.stack([np.cos(heading), np.sin(heading), zero], axis=-1)
    rph = np.rad2deg(np.stack([zero, zero, heading], axis=-1))
    driven, imu = sim.generate_imu(t, [32.0, 118.8, 20.0], rph, velocity, "increment")
    return driven, strapdown.compute_increments_from_imu(imu, "increment")


def make_drive(runs: int = RUNS, seed: int = 7) -> Drive:
    """Return the drive with sensors, of some runs."""
    rng = np.random.default_rng(seed)
    driven, increments = trajectory()
    size, samples, root = (3, runs), len(increments), np.sqrt(PERIOD)
    gyro = rng.normal(0, SETTINGS.gyro_drift, size)
    accel = rng.normal(0, SETTINGS.accelerometer_bias, size)
    theta = increments[THETA_COLS].to_numpy()[:, :, None] + gyro * PERIOD
    theta += rng.normal(0, SETTINGS.gyro_noise * root, (samples, *size))
    dv = increments[DV_COLS].to_numpy()[:, :, None] + accel * PERIOD
    dv += rng.normal(0, SETTINGS.accelerometer_noise * root, (samples, *size))
    at = driven.iloc[::100]
    position = np.column_stack([np.deg2rad(at.lat), np.deg2rad(at.lon), at.alt])
    velocity = at[VEL_COLS].to_numpy() @ TURN
    wide = (len(at), *size)
    compass = np.deg2rad(at.heading.to_numpy())[:, None]
    compass = compass + rng.normal(0, SETTINGS.compass, (len(at), runs))
    return Drive(
        time=np.arange(len(at), dtype=float),
        period=PERIOD,
        rotation_increments=theta,
        velocity_increments=dv,
        gps_position=position[:, :, None]
        + rng.normal(0, SETTINGS.gps_position, wide) / metres(position)[:, :, None],
        gps_velocity=velocity[:, :, None] + rng.normal(0, SETTINGS.gps_velocity, wide),
        compass=np.angle(np.exp(1j * compass)),
        reference=DriveReference(
            position, velocity, TURN @ transform.mat_from_rph(at[RPH_COLS]), gyro, accel
        ),
        places=(),
        origin="simulated",
    )


def one_run(drive: Drive, run: int) -> Drive:
    """Return the drive with one of its runs alone."""
    names = (
        "rotation_increments", "velocity_increments", "gps_position", "gps_velocity", "compass",
    )  # fmt: skip
    rest = {
        name: getattr(drive, name) for name in ("time", "period", "reference", "places", "origin")
    }
    return Drive(**rest, **{name: getattr(drive, name)[..., run : run + 1] for name in names})


def by_pyins(drive: Drive) -> tuple[float, pd.DataFrame, pd.DataFrame]:
    """Return pyins' processor time (s), and its track and deviations at the epochs."""
    start = align(drive, SETTINGS)[0]
    lla = np.append(np.rad2deg(start.position[:2]), start.position[2])
    rph = transform.mat_to_rph(TURN @ start.attitude)
    pva = pd.Series(np.concatenate([lla, TURN @ start.velocity, rph]), TRAJECTORY_COLS, name=0.0)
    samples = len(drive.rotation_increments)
    data = np.column_stack([
        np.full(samples, PERIOD), drive.rotation_increments[..., 0],
        drive.velocity_increments[..., 0],
    ])  # fmt: skip
    index = pd.Index(np.arange(1, samples + 1) * PERIOD, name="time")
    increments = pd.DataFrame(data, index, columns=["dt", *THETA_COLS, *DV_COLS])
    epochs = np.arange(len(drive.time)) * 100 * PERIOD  # the same floats as in the index
    gps = drive.gps_position[..., 0] * [180 / np.pi, 180 / np.pi, 1.0]
    heard = [
        measurements.Position(pd.DataFrame(gps, epochs, LLA_COLS), SETTINGS.gps_position),
        measurements.NedVelocity(
            pd.DataFrame(drive.gps_velocity[..., 0] @ TURN, epochs, VEL_COLS),
            SETTINGS.gps_velocity,
        ),
    ]
    for measurement in heard:
        measurement.data = measurement.data.iloc[1:]  # epoch 0 made the first state
    gyro = inertial_sensor.EstimationModel(
        SETTINGS.gyro_drift, SETTINGS.gyro_noise, SETTINGS.gyro_walk
    )
    accel = inertial_sensor.EstimationModel(
        SETTINGS.accelerometer_bias, SETTINGS.accelerometer_noise, SETTINGS.accelerometer_walk
    )

    def run(until: pd.DataFrame) -> object:
        return filters.run_feedback_filter(
            pva, SETTINGS.position, SETTINGS.velocity, np.rad2deg(SETTINGS.tilt),
            np.rad2deg(SETTINGS.yaw), until, gyro, accel, heard, time_step=0.1,
        )  # fmt: skip

    run(increments.iloc[:300])  # compiles its loop
    began = time.process_time()
    found = run(increments)
    taken = time.process_time() - began
    within = epochs[:-1]  # it ends before the last update
    return taken, found.trajectory.loc[within], found.trajectory_sd.loc[within]  # type: ignore[attr-defined]


def compare(
    drives: list[Drive], ours: list[VehicleRun], passes: list[tuple[pd.DataFrame, pd.DataFrame]]
) -> Row:
    """Return how good both are, and how far apart their positions and deviations are at most.

    Raises
    ------
    SystemExit
        If one is better than the other by 2 %: then times say nothing.
    """
    squares, apart = [], []
    for drive, run, (track, sd) in zip(drives, ours, passes, strict=True):
        steps = slice(60, len(track))  # once both have settled
        states = run.states[:, 0]
        lla = np.column_stack([np.deg2rad(track[["lat", "lon"]]), track.alt])
        true = drive.reference.position[: len(track)]
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
        away = (states.position[: len(track)] - lla) * metres(true)
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
        drive = make_drive(BLOCK, seed=100 + block)
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
    drive = make_drive()
    drives = [one_run(drive, k) for k in range(PASSES)]
    run_vehicle_filter(drives[0], SETTINGS, last=3)  # compiles the loop, or loads it
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
    drove = f"{DURATION // 60} minutes at {1 / PERIOD:.0f} Hz"
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
