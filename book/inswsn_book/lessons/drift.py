"""The pictures of the lesson on drift and fixes, and its record."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from inswsn_book import record as book
from inswsn_book.show.moving import Moving, Slider
from inswsn_lib.navigation import ExampleDrive

Array = NDArray[np.float64]
#: Positions by dead reckoning (samples, 2), of specific forces and turn rates
Navigate = Callable[[Array, Array], Array]
#: A position from nodes (n, 2) and ranges (n,)
Locate = Callable[[Array, Array], Array]

BIASES = np.round(np.arange(0, 1.01, 0.1), 1)  # degrees a second
TILTS = np.round(np.arange(0, 0.051, 0.01), 2)  # m/s²


def felt(drive: ExampleDrive) -> tuple[Array, Array]:
    """Return what perfect sensors measure: accelerations forwards and leftwards, turn rates."""
    pushed = np.diff(drive.velocity, axis=0, append=drive.velocity[-1:]) / drive.period
    forwards = np.column_stack([np.cos(drive.heading), np.sin(drive.heading)])
    leftwards = np.column_stack([-np.sin(drive.heading), np.cos(drive.heading)])
    force = np.column_stack([(pushed * axis).sum(axis=1) for axis in (forwards, leftwards)])
    return force, np.diff(drive.heading, append=drive.heading[-1]) / drive.period


def show_drive(drive: ExampleDrive) -> None:
    """Show the drive on the map: the true path, the INS, and the fixes of the network."""
    times = [*range(7, 93, 3)]
    shown = Moving("A drive", Slider("t", "time", times, 37, "{:d} s"))
    chart = shown.chart("Map", x="x (m)", y="y (m)", xlim=(60, 700), ylim=(-40, 440), equal=True)

    def until(track: Array, t: float) -> Array:
        return track[: int(t / drive.period) + 1 : 5].T

    shown.draw(chart, "truth", "true path", lambda t: until(drive.position, t))
    shown.draw(chart, "ins", "INS", lambda t: until(drive.ins, t))
    shown.draw(
        chart, "network", "", lambda t: drive.fixes[drive.fix_times <= t][::4].T, style="points"
    )
    error, fix = drive.distances(drive.ins), float(np.hypot(*drive.fix_errors.T).mean())
    at = {t: error[int(t / drive.period)] for t in times}
    shown.number("ins", "error of the INS", lambda t: f"{at[t]:.1f} m")
    shown.number("network", "mean error of fixes", f"{fix:.2f} m")
    shown.sentence(
        lambda t: f"After {t} s, the error of the INS is {at[t]:.1f} m, that of a fix {fix:.2f} m."
    )
    shown.show(
        name="fig-l1-drive",
        caption="Drag the time. The INS works along the whole path and drifts. The network covers "
        "only two areas, but its fixes do not drift.",
        alt="A map with the true path, the path according to the INS, and fixes in two areas. The "
        f"error of the INS is {at[37]:.1f} m after 37 s and {at[91]:.0f} m after 91 s; the mean "
        f"error of the fixes is {fix:.2f} m.",
    )


def show_biases(drive: ExampleDrive, navigate: Navigate) -> None:
    """Show the error of the INS over time, by the biases of its two kinds of sensor."""
    shown = Moving(
        "Small errors, integrated",
        Slider("g", "gyro bias", [*BIASES], 0.5, "{:.1f} °/s"),
        Slider("a", "accelerometer bias", [*TILTS], 0.0, "{:.2f} m/s²"),
    )
    force, rate = felt(drive)
    found = {
        (g, a): drive.distances(navigate(force + a, rate + np.radians(g)))
        for g in BIASES
        for a in TILTS
    }
    chart = shown.chart("Position error", x="time (s)", y="error (m)", xlim=(0, 93), ylim=(0, 300))
    shown.draw(chart, "ins", "INS", lambda g, a: (drive.time[::5], found[g, a][::5]), at=12)
    shown.number("ins", "error after 20 s", lambda g, a: f"{found[g, a][200]:.1f} m")
    shown.number("ins", "error after 93 s", lambda g, a: f"{found[g, a][-1]:.0f} m")
    shown.sentence(
        lambda g, a: f"With these biases, the error is {found[g, a][-1]:.0f} m after 93 s."
    )
    shown.show(
        name="fig-l1-biases",
        caption="With an accelerometer bias, the error grows as the square of time from the "
        "start. A gyro bias has no effect on the straight; its effect begins in the first turn.",
        alt="The error of the INS over 93 s. With a gyro bias of half a degree per second it "
        f"is {found[0.5, 0.0][200]:.1f} m after 20 s and {found[0.5, 0.0][-1]:.0f} m after 93 s.",
    )


def show_fix(nodes: Array, place: Array, locate: Locate, rng: np.random.Generator) -> None:
    """Show where fixes lie, by the error of the ranges."""
    sizes = [0.05, 0.1, 0.2, 0.38, 0.6, 0.8, 1.0]
    noise = rng.normal(size=(60, len(nodes)))
    true = np.hypot(*(nodes - place).T)
    found = {s: np.array([locate(nodes, true + s * draw) for draw in noise]) for s in sizes}
    shown = Moving("A fix from ranges", Slider("s", "range error", sizes, 0.38, "{:g} m"))
    chart = shown.chart(
        "Sixty fixes of a position", x="x (m)", y="y (m)", xlim=(-12, 12), ylim=(-8, 8), equal=True
    )
    shown.draw(chart, "published", "nodes", (nodes - place).T, style="points", at=0)
    shown.draw(chart, "network", "fixes", lambda s: (found[s] - place).T, style="points", at=0)
    mean = {s: float(np.hypot(*(f - place).T).mean()) for s, f in found.items()}
    shown.number("network", "mean error of a fix", lambda s: f"{mean[s]:.2f} m")
    shown.sentence(
        lambda s: f"With range errors of {s:g} m, the mean error of a fix is {mean[s]:.2f} m."
    )
    shown.show(
        name="fig-l1-fix",
        caption="Fixes err in all directions. With many nodes they are more accurate than "
        "the ranges.",
        alt=f"{len(nodes)} nodes around a position, and sixty fixes of it. With range errors of "
        f"0.38 m, the mean error of the fixes is {mean[0.38]:.2f} m.",
    )


def hold(drive: ExampleDrive, *, seed: int) -> None:
    """Record what the lesson read, and what it found."""
    record = book.ChapterRecord("lesson-1", {"seed": seed})
    for name in ("p1", "p1-inertial"):
        record.data(f"scenarios/{name}.yaml")
    record.note("off", drive.distances(drive.ins)[-1], "m", "INS at the end of the drive.")
    record.write()
