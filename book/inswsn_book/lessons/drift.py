"""The pictures of the lesson on drift and fixes, and its record."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from inswsn_book import record as book
from inswsn_book.show.moving import Moving, Slider, ellipse
from inswsn_lib.checks import Array
from inswsn_lib.navigation import ExampleDrive

#: Positions (samples, 2) of specific forces and turn rates, or one of nodes (n, 2) and ranges (n,)
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
    shown = Moving("A drive", Slider("t", "time", times, 37, "{:d} s", plays=True))
    chart = shown.map("Map", xlim=(60, 700), ylim=(-40, 440))

    def until(track: Array, t: float) -> Array:
        return track[: int(t / drive.period) + 1 : 5].T

    shown.draw(chart, "truth", "", lambda t: until(drive.position, t))
    shown.draw(chart, "ins", "INS", lambda t: until(drive.ins, t))
    shown.draw(
        chart, "network", "", lambda t: drive.fixes[drive.fix_times <= t][::4].T, style="points"
    )
    shown.draw(chart, "truth", "true", lambda t: until(drive.position, t)[:, -1:], style="handle")
    error, fix = drive.distances(drive.ins), float(np.hypot(*drive.fix_errors.T).mean())
    at = {t: error[int(t / drive.period)] for t in times}
    shown.number("ins", "error of the INS", lambda t: f"{at[t]:.1f} m")
    shown.number("network", "mean error of fixes", f"{fix:.2f} m")
    shown.sentence(
        lambda t: f"After {t} s, the error of the INS is {at[t]:.1f} m, that of a fix {fix:.2f} m."
    )
    shown.show(
        "fig-l1-drive",
        "Drag the vehicle, or play the drive. The INS works along the whole path and "
        "drifts. The network covers only two areas, but its fixes do not drift.",
    )


def show_biases(drive: ExampleDrive, navigate: Locate) -> None:
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
    chart = shown.chart("Position error", xlim=(0, 93), ylim=(0, 300))
    shown.draw(chart, "ins", "INS", lambda g, a: (drive.time[::5], found[g, a][::5]), at=12)

    def said(g: float, a: float) -> str:
        return f"{found[g, a][200]:.1f} m after 20 s, {found[g, a][-1]:.0f} m after 93 s"

    shown.number("ins", "error", said)
    shown.sentence(lambda g, a: f"With these biases, the error is {said(g, a)}.")
    shown.show(
        "fig-l1-biases",
        "With an accelerometer bias, the error grows as the square of time from the "
        "start. A gyro bias has no effect on the straight; its effect begins in the first turn.",
    )


def show_walks(time: Array, walks: dict[str, Array], sizes: dict[str, Array]) -> None:
    """Show errors (runs, samples), m/s and m, run by run, in bands of their typical sizes."""
    shown = Moving("Noise, integrated", Slider("n", "run", range(1, 13), 1, "{:d}", plays=True))

    def add(name: str, unit: str) -> None:
        found, size, end = walks[name][:, ::10], sizes[name][::10], 3 * float(sizes[name][-1])
        axes = {"y": f"error ({unit})", "xlim": (0, 93), "ylim": (-end, end)}
        chart = shown.chart(f"Error of the {name}", **axes)
        shown.draw(chart, "ins", "", (time[::10], -size, size), style="band")
        shown.draw(chart, "ins", "", lambda n: (time[::10], found[n - 1]))
        shown.number("ins", f"{name} in the end", lambda n: f"{walks[name][n - 1, -1]:.1f} {unit}")

    add("velocity", "m/s")
    add("position", "m")
    ends = walks["position"][:, -1]
    shown.sentence(lambda n: f"In run {n}, the position error in the end is {ends[n - 1]:.1f} m.")
    shown.show(
        "fig-l1-walks",
        "White noise of the accelerometers alone. The bands are one standard deviation: "
        "they grow as the time to the powers 0.5 and 1.5.",
    )


def show_fix(nodes_at: Callable[[float], Array], locate: Locate, rng: np.random.Generator) -> None:
    """Show fixes of the origin by the angle between three nodes 10 m away, and their ellipse."""
    angles, sizes, noise = [*range(10, 171, 10)], [0.1, 0.38, 1.0], rng.normal(size=(60, 3))
    shown = Moving(
        "A fix from three ranges",
        Slider("a", "angle between nodes", angles, 20, "{:d}°"),
        Slider("s", "error of a range", sizes, 1.0, "{:g} m"),
    )
    # U'U is diagonal: along the first node, and across
    sigma = {a: np.linalg.inv(nodes_at(a).T @ nodes_at(a) / 100).diagonal() ** 0.5 for a in angles}
    dilution = {a: float(np.hypot(*sigma[a])) for a in angles}
    chart = shown.map("Map", xlim=(-14, 14), ylim=(-10, 10))
    shown.draw(
        chart, "published", "", lambda a, s: (*nodes_at(a).T, 10 + s * noise[0]), style="circle"
    )
    shown.draw(chart, "truth", "vehicle", ([0], [0]), style="points")
    shown.draw(chart, "published", "node", lambda a: nodes_at(a).T[:, 1:2], style="handle", at=0)
    shown.draw(chart, "published", "", lambda a: nodes_at(a).T[:, ::2], style="points")

    def fixes(a: float, s: float) -> Array:
        return np.array([locate(nodes_at(a), 10 + s * draw) for draw in noise]).T

    shown.draw(chart, "network", "", fixes, style="points")
    shown.draw(chart, "kalman", "", lambda a, s: s * ellipse(np.diag(sigma[a] ** 2)))

    def said(a: float, s: float) -> str:
        return f"{s * sigma[a][0]:.2f} m and {s * sigma[a][1]:.2f} m"

    shown.number("network", "standard deviation in x and y", said)
    shown.number("network", "dilution of precision", lambda a: f"{dilution[a]:.2f}")
    shown.goal("dilution of precision below 1.2", lambda a: dilution[a] < 1.2)
    shown.sentence(
        lambda a, s: f"With nodes {a}° apart, the standard deviations in x and y are {said(a, s)}."
    )
    shown.show(
        "fig-l1-fix",
        "Drag a node. Each measured range is a circle, and the circles nearly meet at the "
        "vehicle. The dots are sixty fixes; about 86 % lie in the ellipse of 2σ.",
    )


def hold(drive: ExampleDrive, *, seed: int) -> None:
    """Record what the lesson read, and what it found."""
    record = book.ChapterRecord("lesson-1", {"seed": seed})
    for name in ("p1", "p1-inertial"):
        record.data(f"scenarios/{name}.yaml")
    record.note("off", drive.distances(drive.ins)[-1], "m", "INS at the end of the drive.")
    record.write()
