"""The pictures of the lesson on drift and fixes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from inswsn_book.moving import Moving, Slider
from inswsn_lib.navigation import ExampleDrive

Array = NDArray[np.float64]
#: Positions by dead reckoning (samples, 2), of specific forces and turn rates
Navigate = Callable[[Array, Array], Array]
#: A position from nodes (n, 2) and ranges (n,)
Locate = Callable[[Array, Array], Array]

BIASES = np.round(np.arange(0, 1.01, 0.1), 1)  # degrees a second
TILTS = np.round(np.arange(0, 0.051, 0.01), 2)  # m/s²


def felt(drive: ExampleDrive) -> tuple[Array, Array]:
    """Return what sensors without errors feel: forces forwards and leftwards, and turn rates."""
    pushed = np.diff(drive.velocity, axis=0, append=drive.velocity[-1:]) / drive.period
    forwards = np.column_stack([np.cos(drive.heading), np.sin(drive.heading)])
    leftwards = np.column_stack([-np.sin(drive.heading), np.cos(drive.heading)])
    force = np.column_stack([(pushed * axis).sum(axis=1) for axis in (forwards, leftwards)])
    return force, np.diff(drive.heading, append=drive.heading[-1]) / drive.period


def show_drive(drive: ExampleDrive) -> None:
    """Show the drive on the map: the true path, the INS, and the fixes of the network."""
    times = [*range(7, 93, 3)]
    shown = Moving("A drive", Slider("t", "time", times, 37, "{:d} s"))
    chart = shown.chart(
        "P1's scene", x="x (m)", y="y (m)", xlim=(60, 700), ylim=(-40, 440), equal=True
    )

    def until(track: Array, t: float) -> Array:
        return track[: int(t / drive.period) + 1 : 5].T

    shown.draw(chart, "truth", "true path", lambda t: until(drive.position, t))
    shown.draw(chart, "ins", "INS", lambda t: until(drive.ins, t))
    shown.draw(
        chart, "network", "", lambda t: drive.fixes[drive.fix_times <= t][::4].T, style="points"
    )
    error, fix = drive.distances(drive.ins), float(np.hypot(*drive.fix_errors.T).mean())
    at = {t: error[int(t / drive.period)] for t in times}
    shown.number("ins", "INS off by", lambda t: f"{at[t]:.1f} m")
    shown.number("network", "fixes off by", f"{fix:.2f} m")
    shown.sentence(
        lambda t: f"After {t} s the INS is off by {at[t]:.1f} m; a fix is off by {fix:.2f} m."
    )
    shown.show(
        name="fig-l1-drive",
        caption="Drag the time. The INS sees the whole way and drifts. The network sees two areas "
        "of it, and does not drift.",
        alt=f"A map of 700 by 450 m with the true path, the path by the INS, and fixes in two "
        f"areas. The INS is off by {at[37]:.1f} m after 37 s and by {at[91]:.0f} m after 91 s, "
        f"the fixes by {fix:.2f} m.",
    )


def show_biases(drive: ExampleDrive, navigate: Navigate) -> None:
    """Show how far the INS is off over time, by the biases of its two kinds of sensor."""
    shown = Moving(
        "Small errors, added up",
        Slider("g", "gyro off by", [*BIASES], 0.5, "{:.1f} °/s"),
        Slider("a", "accelerometers off by", [*TILTS], 0.0, "{:.2f} m/s²"),
    )
    force, rate = felt(drive)
    found = {
        (g, a): drive.distances(navigate(force + a, rate + np.radians(g)))
        for g in BIASES
        for a in TILTS
    }
    chart = shown.chart("Off by", x="time (s)", y="off by (m)", xlim=(0, 93), ylim=(0, 300))
    shown.draw(chart, "ins", "INS", lambda g, a: (drive.time[::5], found[g, a][::5]), at=12)
    shown.number("ins", "off by after 20 s", lambda g, a: f"{found[g, a][200]:.1f} m")
    shown.number("ins", "at the end", lambda g, a: f"{found[g, a][-1]:.0f} m")
    shown.sentence(
        lambda g, a: (
            f"With {g:.1f} degrees a second and {a:.2f} m/s² the INS is off by "
            f"{found[g, a][-1]:.0f} m after 93 s."
        )
    )
    shown.show(
        name="fig-l1-biases",
        caption="An error of the accelerometers grows with the square of time from the start. "
        "One of the gyro does nothing on the straight, and comes in with the first turn.",
        alt=f"The error of the INS over 93 s. With a gyro that is off by half a degree a second it "
        f"is {found[0.5, 0.0][200]:.1f} m after 20 s and {found[0.5, 0.0][-1]:.0f} m after 93 s.",
    )


def show_fix(nodes: Array, place: Array, locate: Locate, rng: np.random.Generator) -> None:
    """Show where fixes fall, by the error of the ranges."""
    sizes = [0.05, 0.1, 0.2, 0.38, 0.6, 0.8, 1.0]
    noise = rng.normal(size=(60, len(nodes)))
    true = np.hypot(*(nodes - place).T)
    found = {s: np.array([locate(nodes, true + s * draw) for draw in noise]) for s in sizes}
    shown = Moving("A fix from ranges", Slider("s", "error of a range", sizes, 0.38, "{:g} m"))
    chart = shown.chart(
        "Sixty fixes of one place", x="x (m)", y="y (m)", xlim=(-12, 12), ylim=(-8, 8), equal=True
    )
    shown.draw(chart, "published", "nodes", (nodes - place).T, style="points", at=0)
    shown.draw(chart, "network", "fixes", lambda s: (found[s] - place).T, style="points", at=0)
    mean = {s: float(np.hypot(*(f - place).T).mean()) for s, f in found.items()}
    shown.number("network", "a fix is off by", lambda s: f"{mean[s]:.2f} m")
    shown.sentence(
        lambda s: (
            f"With ranges that are off by {s:g} m, fixes from {len(nodes)} nodes are off by "
            f"{mean[s]:.2f} m."
        )
    )
    shown.show(
        name="fig-l1-fix",
        caption="Each fix is off in another direction. Many nodes make it better than one range.",
        alt=f"{len(nodes)} nodes around a place, and sixty fixes of it. With ranges off by 0.38 m "
        f"the fixes are off by {mean[0.38]:.2f} m on average.",
    )
