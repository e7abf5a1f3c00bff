"""The pictures of the lesson on bridging an outage, and what it records."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from inswsn_book.lessons.dots import show_dots
from inswsn_book.record import ChapterRecord
from inswsn_book.show.moving import Chart, Moving, Slider
from inswsn_lib.navigation.bridged_outages import Passage
from inswsn_lib.papers import read_rows

if TYPE_CHECKING:
    from inswsn_lib.navigation import BridgedOutages

Array = NDArray[np.float64]
#: What a trained machine answers to inputs
Answer = Callable[[Array], Array]
#: Training: inputs, targets, width and regularisation in, the trained machine out
Machine = Callable[[Array, Array, float, float], Answer]
#: Inputs of all samples, targets of the first of them, width and regularisation in, answers out
Bridge = Callable[[Array, Array, float, float], Array]
#: A filter by hand: measurements, with NaN where there are none, in, estimates out
Filter = Callable[[Array], Array]
#: The columns that name the rows of P1's tables, by their numbers
_INDEX = {1: "no", 3: "method"}
#: The columns of Table 1 by what P1 calls them: the name in findings, and for a reader
_TABLE1 = {
    "drx": ("rx", "$r_x$"),
    "dry": ("ry", "$r_y$"),
    "mean_position": ("mean-position", "mean of positions"),
    "dvx": ("vx", "$v_x$"),
    "dvy": ("vy", "$v_y$"),
    "mean_velocity": ("mean-velocity", "mean of velocities"),
}
#: Parameters on which the tables depend
_SCENE = ("seed", "outage_samples", "range_noise", "inertial_scale", "correlation_time")
#: What is left of the error of the INS on equal terms, by the names of the evidence
_FAIR = ("fair.ls-svm.motion", "fair.kalman-filter-coasting.state")

WIDTHS = [
    *(0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 50.0, 70.0, 100.0),
]
_WIDE = [0.1, 0.2, *WIDTHS, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4]
STRENGTHS = [1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6]


def distances(error: Array) -> Array:
    """Return how far positions are off, m, of errors (samples, 4)."""
    return np.asarray(np.hypot(error[:, 0], error[:, 1]))


def off(error: Array) -> float:
    """Return the mean of that."""
    return float(distances(error).mean())


def _of(drive: Passage) -> tuple[Array, Array, Array, int]:
    """Return the clock, the error of the INS, what is measured, and in how many samples it is."""
    heard = drive.heard
    return np.asarray(drive.inputs["time"])[:, 0], drive.error, drive.y[:heard], heard


def _by_time(t: Array, y: Array, sigma: float, eta: float) -> Array:
    """Return what an LS-SVM on time says at all times, trained on the first."""
    n = len(y)
    system, like = np.ones((n + 1, n + 1)), np.exp(-((t[:, None] - t[:n]) ** 2) / (2 * sigma**2))
    system[0, 0], system[1:, 1:] = 0, like[:n] + np.eye(n) / eta
    b, *alpha = np.linalg.solve(system, np.vstack([0 * y[:1], y]))
    return np.asarray(like @ alpha + b)


def show_bridge(drive: Passage, eta: float, *, start: float) -> None:
    """Show an outage bridged by an LS-SVM on time, by its width."""
    t, error, y, heard = _of(drive)
    said = {s: _by_time(t, y, s, eta) for s in WIDTHS}
    shown = Moving(
        "An outage bridged by what was learned before",
        Slider("s", "width of the kernel", WIDTHS, start, "{:g} s"),
    )
    time = {"x": "time (s)", "xlim": (0, 30)}
    learned = shown.chart("Position error of the INS in y", y="error (m)", ylim=(-20, 45), **time)
    shown.draw(learned, "network", "", (t[:heard:4], y[::4, 1]), style="points")
    shown.draw(learned, "ins", "true", (t, error[:, 1]))
    shown.draw(learned, "lssvm", "learned", lambda s: (t, said[s][:, 1]))
    distance = shown.chart("Distance from the true position", y="error (m)", ylim=(0, 45), **time)
    shown.draw(distance, "ins", "INS", (t, distances(error)))
    shown.draw(distance, "lssvm", "corrected", lambda s: (t, distances(error - said[s])))
    mean = {s: off((error - answers)[heard:]) for s, answers in said.items()}
    ins = off(error[heard:])
    shown.number("network", "measured", "until 20 s")
    shown.number("ins", "INS alone, in the outage", f"{ins:.1f} m")
    shown.number("lssvm", "corrected, in the outage", lambda s: f"{mean[s]:.1f} m")
    shown.sentence(lambda s: (
        f"With a width of {s:g} s, the mean error of the corrected position in the outage is "
        f"{mean[s]:.1f} m, and that of the INS alone {ins:.1f} m."
    ))  # fmt: skip
    shown.show(
        name="fig-l4-bridge",
        caption="Until 20 s the machine sees how much the two instruments differ (dots). After "
        "that it has only the clock, and what it has learned.",
        alt=f"Two charts over 30 seconds. The error of the INS in y grows to "
        f"{error[:heard, 1].max():.0f} m at 20 s and comes back after a turn. With the width "
        f"{start:g} s the learned curve continues in its old direction: its mean error in the "
        f"outage is {mean[start]:.1f} m, and that of the INS alone {ins:.1f} m.",
    )


def show_kernels(machine: Machine) -> None:
    """Show the curve through five samples and the kernels that it is made of."""
    U = np.array([[0.0], [1.0], [2.0], [4.0], [5.0]])
    Y = np.array([[0.0], [1.0], [0.6], [2.0], [1.6]])
    x = np.linspace(-4, 9, 131)
    widths = [0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0]
    shown = Moving(
        "Width and regularisation on one curve",
        Slider("s", "width σ", widths, 0.2, "{:g}"),
        Slider("n", "regularisation η", STRENGTHS[:5], 10.0, "{:,.0f}"),
    )
    axes = {"x": "input u", "xlim": (-4, 9)}
    answers = shown.chart("The answer f(u)", y="f(u)", ylim=(-1, 3), **axes)
    found = {(s, n): machine(U, Y, s, n) for s in widths for n in STRENGTHS[:5]}
    middle = float(Y.mean())
    shown.draw(answers, "published", "mean", ([-4, 9], [middle, middle]), at=0)
    shown.draw(answers, "lssvm", "answer", lambda s, n: (x, found[s, n](x[:, None])[:, 0]))
    shown.draw(answers, "network", "", (U[:, 0], Y[:, 0]), style="points")
    alike = shown.chart("How alike u is to each sample", y="k(u, uᵢ)", ylim=(0, 1.25), **axes)
    for at in U[:, 0]:
        shown.draw(alike, "network", "", _bell(x, float(at)))
    missed = {key: float(abs(answer(U) - Y).mean()) for key, answer in found.items()}
    ahead = {key: float(answer(np.array([[8.0]]))[0, 0]) for key, answer in found.items()}
    shown.number("lssvm", "mean error at the samples", lambda s, n: f"{missed[s, n]:.3f}")
    shown.number("lssvm", "answer at u = 8", lambda s, n: f"{ahead[s, n]:.2f}")
    shown.sentence(lambda s, n: (
        f"With the width {s:g} and the regularisation {n:,.0f}, the mean error at the samples "
        f"is {missed[s, n]:.3f} and the answer at u = 8 is {ahead[s, n]:.2f}; the mean of the "
        f"samples is {middle:.2f}."
    ))  # fmt: skip
    shown.show(
        name="fig-l4-kernels",
        caption="Five samples. The lower chart shows their kernels, the upper one the answer: a "
        "weighted sum of the kernels plus a constant.",
        alt=f"Two charts. With the width 0.2, the answer has a peak or a dip at each of the five "
        f"samples and is {ahead[0.2, 10.0]:.2f} away from them. Below are five narrow bells.",
    )


def _bell(x: Array, at: float) -> Callable[[float], tuple[Array, Array]]:
    """Return the kernel of a sample, by its width, as `Moving.draw` wants it."""
    return lambda s: (x, np.exp(-((x - at) ** 2) / (2 * s**2)))


def show_widths(drive: Passage, machine: Machine) -> None:
    """Show the error in training and in the outage over the width, by the regularisation."""
    t, error, y, heard = _of(drive)
    train, bridged = {}, {}
    for n in STRENGTHS:
        for s in _WIDE:
            answers = machine(t[:heard, None], y, s, n)(t[:, None])
            train[s, n] = off(answers[:heard] - y)
            bridged[s, n] = off((error - answers)[heard:])
    shown = Moving(
        "Too narrow or too wide",
        Slider("s", "width of the kernel", _WIDE, 0.1, "{:,g} s"),
        Slider("n", "regularisation η", STRENGTHS, 1e3, "{:,.0f}"),
    )
    axes = {"x": "width of the kernel (s), as a power of ten", "xlim": (-1.1, 4.1)}
    x = np.log10(_WIDE)
    known = shown.chart("Training: distance from the fixes", y="error (m)", ylim=(0, 8), **axes)
    lost = shown.chart("Outage: distance from the truth", y="error (m)", ylim=(0, 30), **axes)

    def add(chart: Chart, of: Mapping[tuple[float, float], float]) -> None:
        shown.draw(chart, "lssvm", "", lambda n: (x, [of[s, n] for s in _WIDE]))
        shown.draw(chart, "truth", "", lambda s, n: _upright(s, of[s, n]))

    add(known, train)
    add(lost, bridged)
    middle, ins = off((error - y.mean(axis=0))[heard:]), off(error[heard:])
    for method, label, level in (("published", "mean", middle), ("ins", "INS", ins)):
        shown.draw(lost, method, label, (x, np.full(len(x), level)))
    shown.number("lssvm", "in training", lambda s, n: f"{train[s, n]:.2f} m")
    shown.number("lssvm", "in the outage", lambda s, n: f"{bridged[s, n]:.1f} m")
    shown.number("published", "the mean, in the outage", f"{middle:.1f} m")
    shown.sentence(lambda s, n: (
        f"With the width {s:,g} s and the regularisation {n:,.0f}, the machine's error is "
        f"{train[s, n]:.2f} m in training and {bridged[s, n]:.1f} m in the outage, where that "
        f"of the mean is {middle:.1f} m."
    ))  # fmt: skip
    best = min(bridged, key=bridged.__getitem__)
    shown.show(
        name="fig-l4-widths",
        caption="The same machine on the same drive. A small error in training says nothing "
        "about the outage.",
        alt="Two charts over the width. With η = 1000 the error in training rises from "
        f"{train[0.1, 1e3]:.2f} m to {train[1e4, 1e3]:.1f} m. In the outage it is "
        f"{bridged[0.1, 1e3]:.1f} m at 0.1 s, {bridged[3.0, 1e3]:.1f} m at 3 s, "
        f"{bridged[30.0, 1e3]:.1f} m at 30 s and {bridged[1e4, 1e3]:.1f} m at 10,000 s; the least "
        f"of all pairs is {bridged[best]:.1f} m.",
    )


def _upright(width: float, level: float) -> tuple[list[float], list[float]]:
    """Return a line from zero up to a curve at a width."""
    return [float(np.log10(width))] * 2, [0.0, level]


def show_rehearsal(drive: Passage, bridge: Bridge) -> None:
    """Show the error in a rehearsed outage and in the real one over the width, by the input."""
    _, error, y, heard = _of(drive)
    half, kinds = heard // 2, ["time", "motion"]
    widths = [round(float(10**p), 3) for p in np.arange(-1, 3.01, 0.25)]
    rehearsed, bridged = {}, {}
    for kind in kinds:
        u = np.asarray(drive.inputs[kind])
        for s in widths:
            losses = {n: off(bridge(u[:heard], y[:half], s, n) - y[half:]) for n in STRENGTHS[::2]}
            n = min(losses, key=losses.__getitem__)
            rehearsed[kind, s] = losses[n]
            bridged[kind, s] = off(bridge(u, y, s, n) - error[heard:])
    shown = Moving(
        "Rehearse an outage, then meet one",
        Slider("kind", "input", kinds, "motion", "{}"),
        Slider("s", "width (deviations)", widths, 0.1, "{:,.3g}"),
    )
    axes = {"x": "width, as a power of ten", "y": "error (m)", "xlim": (-1.1, 3.1)}
    charts = (
        shown.chart("The rehearsal", ylim=(0, 30), **axes),
        shown.chart("The outage", ylim=(0, 50), **axes),
    )
    x = np.log10(widths)

    def add(chart: Chart, of: Mapping[tuple[str, float], float]) -> None:
        shown.draw(chart, "lssvm", "", lambda kind: (x, [of[kind, s] for s in widths]))
        shown.draw(chart, "truth", "", lambda kind, s: _upright(s, of[kind, s]))

    add(charts[0], rehearsed)
    add(charts[1], bridged)
    ins = off(error[heard:])
    shown.draw(charts[1], "ins", "INS", (x, np.full(len(x), ins)))
    shown.number("lssvm", "rehearsed", lambda kind, s: f"{rehearsed[kind, s]:.1f} m")
    shown.number("lssvm", "in the outage", lambda kind, s: f"{bridged[kind, s]:.1f} m")
    shown.number("ins", "INS alone, in the outage", f"{ins:.1f} m")
    shown.sentence(lambda kind, s: (
        f"With {kind} as the input and a width of {s:.3g} deviations, the machine's error is "
        f"{rehearsed[kind, s]:.1f} m in the rehearsal and {bridged[kind, s]:.1f} m in the outage."
    ))  # fmt: skip
    best = min(rehearsed, key=rehearsed.__getitem__)
    shown.show(
        name="fig-l4-rehearsal",
        caption="At each width, the regularisation is the one with the least error in the "
        "rehearsal. The upper chart is known before the outage, the lower one only after it.",
        alt=f"Two charts over the width. The least error in the rehearsal is {rehearsed[best]:.1f} "
        f"m, with {best[0]} as the input. In the outage the error of the same machine is "
        f"{bridged[best]:.1f} m, and that of the INS alone {ins:.1f} m.",
    )


def show_oracle(drive: Passage, machine: Machine) -> None:
    """Show what a machine answers if it is fed with the true error, by its width."""
    t, error, y, heard = _of(drive)
    widths = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0]
    said = {s: machine(error[:heard], y, s, 1e3)(error) for s in widths}
    shown = Moving("Fed with the answer", Slider("s", "width of the kernel", widths, 1.0, "{:g}"))
    time = {"x": "time (s)", "xlim": (0, 30)}

    def add(i: int, title: str, unit: str, ends: tuple[float, float]) -> None:
        chart = shown.chart(title, y=f"error ({unit})", ylim=ends, **time)
        shown.draw(chart, "ins", "true", (t, error[:, i]))
        shown.draw(chart, "lssvm", "answer", lambda s: (t, said[s][:, i]))

    add(1, "Position error in y", "m", (-10.0, 20.0))
    add(3, "Velocity error in y", "m/s", (-3.0, 3.0))
    left = {s: abs(error - answers)[heard:].mean(axis=0) for s, answers in said.items()}
    ins = abs(error)[heard:].mean(axis=0)
    shown.number("ins", "INS alone, in the outage", f"{ins[1]:.1f} m, {ins[3]:.1f} m/s")
    shown.number("lssvm", "corrected", lambda s: f"{left[s][1]:.1f} m, {left[s][3]:.1f} m/s")
    shown.sentence(lambda s: (
        f"With the width {s:g}, the errors in y after correction are {left[s][1]:.1f} m and "
        f"{left[s][3]:.1f} m/s in the outage; those of the INS alone are {ins[1]:.1f} m and "
        f"{ins[3]:.1f} m/s."
    ))  # fmt: skip
    shown.show(
        name="fig-l4-oracle",
        caption="The input is the true error of the INS, in training and in the outage, as in P1. "
        "Subtract the input itself, and no error remains.",
        alt=f"Two charts over 30 seconds. With the width 1000, the answer in position follows the "
        f"true error to within {left[1000.0][1]:.1f} m on average. The answer in velocity does not:"
        f" its error is {left[1000.0][3]:.1f} m/s, and that of the INS alone {ins[3]:.1f} m/s.",
    )


def show_rivals(
    drive: Passage, coast: Filter, rehearse: Callable[..., Any], bridge: Bridge
) -> Callable[[str, float, int], float]:
    """Show the distance over outages that begin earlier or later and last longer or shorter.

    Returns the mean distance of a method in an outage that begins then and lasts so long.
    """
    t, error, y, heard = _of(drive)
    inputs = {kind: np.asarray(drive.inputs[kind]) for kind in ("time", "motion")}
    period = float(t[1] - t[0])
    begins, longest = [float(b) for b in range(8, 21)], len(error) - heard
    lengths = [1, 2, 3, 5, 7, 10]

    def samples(seconds: float) -> int:
        return round(seconds / period)

    found: dict[str, dict[float, Array]] = {m: {} for m in ("ins", "network", "kalman", "lssvm")}
    for b in begins:
        n = samples(b)
        known, rows = np.vstack([y, np.full((longest, 4), np.nan)]), slice(n, n + longest)
        known[n:] = np.nan
        kind, sigma, eta = rehearse(inputs, y[:n])
        found["ins"][b] = distances(error[rows])
        found["network"][b] = distances(error[rows] - y[n - 1])
        found["kalman"][b] = distances((error - coast(known))[rows])
        found["lssvm"][b] = distances(
            error[rows] - bridge(inputs[kind], y[:n], sigma, eta)[:longest]
        )
    shown = Moving(
        "When the network is lost, and for how long",
        Slider("b", "lost at", begins, 20.0, "{:g} s"),
        Slider("n", "for", lengths, 10, "{:g} s"),
    )
    since = period * np.arange(longest)
    chart = shown.chart(
        "Distance from the true position", x="time since the loss (s)", y="error (m)",
        xlim=(0, 10), ylim=(0, 40),
    )  # fmt: skip
    labels = {
        "ins": "INS alone", "network": "last fix held", "kalman": "Kalman, coasting",
        "lssvm": "LS-SVM, rehearsed",
    }  # fmt: skip

    def mean(method: str, b: float, n: int) -> float:
        return float(found[method][b][: samples(n)].mean())

    def add(method: str, label: str) -> None:
        of, short = found[method], label.partition(",")[0]
        shown.draw(chart, method, short, lambda b, n: (since[: samples(n)], of[b][: samples(n)]))
        shown.number(method, label, lambda b, n: f"{mean(method, b, n):.1f} m")

    for method, label in labels.items():
        add(method, label)
    indicated = inputs["motion"][:, 3]
    turn = shown.chart(
        "Velocity in y; dots: the outage", x="time (s)", y="m/s", xlim=(0, 30), ylim=(0, 8)
    )
    shown.draw(turn, "truth", "", (t, indicated), at=30)

    def lost(b: float, n: int) -> tuple[Array, Array]:
        rows = slice(samples(b), samples(b + n))
        return t[rows], indicated[rows]

    shown.draw(turn, "ins", "", lost, style="points")

    def say(b: float, n: int) -> str:
        means = {method: mean(method, b, n) for method in found}
        return (
            f"If the network is lost at {b:g} s for {n} s, the mean error of the INS alone is "
            f"{means['ins']:.1f} m, of the last fix held {means['network']:.1f} m, of the Kalman "
            f"filter {means['kalman']:.1f} m, and of the LS-SVM {means['lssvm']:.1f} m."
        )

    shown.sentence(say)
    shown.show(
        name="fig-l4-rivals",
        caption="Move the outage to a time before the turn, then into the turn. The LS-SVM is "
        "rehearsed again for each outage.",
        alt=f"Two charts. {say(20.0, 2)} {say(20.0, 10)} {say(10.0, 10)} The velocity in y is "
        "steady until a turn begins at 18 s.",
    )
    return mean


def show_heading(
    drives: Mapping[float, Passage], coast: Filter, knowing: Callable[..., Array]
) -> float:
    """Show two filters in the outage, by what part of the heading's errors the INS has.

    Returns the mean distance (m) of the four-state filter if it has none.
    """
    shares = list(drives)
    plain, turning, alone = {}, {}, {}
    for share, drive in drives.items():
        t, error, _, heard = _of(drive)
        y, velocity = drive.y, np.asarray(drive.inputs["motion"])[:, 2:]
        alone[share] = distances(error[heard:])
        plain[share] = distances((error - coast(y))[heard:])
        turning[share] = distances((error - knowing(y, velocity)[:, :4])[heard:])
    shown = Moving(
        "What a turn does",
        Slider("share", "heading error of the INS, as a factor", shares, 1.0, "{:g}"),
    )
    chart = shown.chart(
        "Distance from the true position", x="time since the loss (s)",
        y="error (m)", xlim=(0, 10), ylim=(0, 40),
    )  # fmt: skip
    since = t[heard:] - t[heard]

    def add(method: str, label: str, of: Mapping[float, Array], at: int) -> None:
        shown.draw(chart, method, label, lambda share: (since, of[share]), at=at)
        shown.number(method, label, lambda share: f"{of[share].mean():.1f} m")

    add("ins", "INS alone", alone, 8)
    add("kalman", "4 states", plain, -1)
    add("coloured", "5 states", turning, -1)
    shown.sentence(lambda share: (
        f"With the heading error times {share:g}, the mean error of the filter with four "
        f"states is {plain[share].mean():.1f} m, with five {turning[share].mean():.1f} m, and "
        f"of the INS alone {alone[share].mean():.1f} m."
    ))  # fmt: skip
    shown.show(
        name="fig-l4-heading",
        caption="Without a heading error, even the four-state Kalman filter bridges the "
        "turn. With a fifth state, the error need not be removed.",
        alt=f"Over ten seconds of outage, the mean error of the filter with four states is "
        f"{plain[1.0].mean():.1f} m, and with five {turning[1.0].mean():.1f} m. Without an error "
        f"in the heading it is {plain[0.0].mean():.1f} m and {turning[0.0].mean():.1f} m.",
    )
    return float(plain[0.0].mean())


def hold(
    record: ChapterRecord, drive: Passage, said: Mapping[str, Array], machine: Machine,
    bridge: Bridge, rivals: Callable[[str, float, int], float], chosen: tuple[str, float, float],
    *, squares: Array, straight: float,
) -> Any:  # fmt: skip
    """Record what the lesson finds, hold its sentences against that, and return P1 Table 3."""
    for name in ("p1", "p1-inertial"):
        record.data(f"scenarios/{name}.yaml")
    printed = read_rows(record.data("papers/p1-table3.csv"), index="method")
    t, error, y, heard = _of(drive)
    for name, e in said.items():
        record.note(f"off.{name}", off((error - e)[heard:]), "m", "Mean distance, first outage.")
    record.say("seeds.spread", f"{record.reference('p1-outages', 'seeds.spread').value:.0f}")
    recorded = record.reference("recorded-data", "learners.mean.lssvm").value
    record.say("recorded.lssvm", f"{recorded:.2f}")
    for name in _FAIR:
        record.crossed("p1-outages", name)
    record.crossed("p1-outages", "/".join(_FAIR), ".1f", "ls-svm-over-coasting")
    record.note("short.straight", 100 * rivals("kalman", 10.0, 2), "cm", "Mean distance, 2 s.")
    for name, rival in (("turn", "kalman"), ("held", "network")):
        record.note(f"short.{name}", rivals(rival, 20.0, 2), "m", "Mean distance, 2 s.")
    u, half, (along, across) = np.asarray(drive.inputs[chosen[0]]), heard // 2, squares[:2]
    best = off(error[heard:] - bridge(u, y, *chosen[1:]))
    rehearsed = off(bridge(u[:heard], y[:half], *chosen[1:]) - y[half:])
    for name, value in (("off.rehearsed", best), ("rehearsed", rehearsed)):
        record.note(name, value, "m", "Mean distance, LS-SVM.")
    record.note("straight", straight, "m", "Kalman filter, no error of the heading.")
    taken = 100 * along / (along + 1000)
    for name, value in (("along", along), ("across", across), ("taken", taken)):
        record.note(name, value, "1", "Of the first two directions: squares, and %.")
    answers = (machine(t[:heard, None], y, s, 1e3)(t[:, None]) for s in (0.1, *WIDTHS, 1e4))
    widths = [off((error - answer)[heard:]) for answer in answers]
    mean = off((error - y.mean(axis=0))[heard:])
    record.holds("With some width the error is below 3 m.", min(widths) < 3)
    ends = max(abs(widths[0] - mean), abs(widths[-1] - mean))
    record.holds("At both ends the answer is the mean.", ends < 1)
    record.holds("Rehearsed best, it is worse than no correction.", best > off(error[heard:]))
    held, kalman, learned = (rivals(each, 20.0, 10) for each in ("network", "kalman", "lssvm"))
    early = max(rivals("lssvm", 10.0, 10), rivals("kalman", 10.0, 10))
    record.holds("In an outage from 10 s on, both are good.", early < 1)
    record.holds("The mean is better than the filter in the turn.", mean < kalman)
    record.holds("From 17 s on, the machine's error is large.", rivals("lssvm", 17.0, 10) > 100)
    record.holds("In the turn the last fix is better than both.", held < min(kalman, learned))
    oracle, ins = (abs(error - said[each])[heard:, 2:].mean() for each in ("oracle", "ins"))
    record.holds("The oracle's velocity is worse than that of the INS.", oracle > ins)
    record.write()
    return printed


def show_table3(printed: Any, sizes: Mapping[str, Array]) -> None:
    """Show mean errors over those of the INS alone, as P1 prints them and in this run."""
    cells = {"x": "rx1", "y": "ry1", "velocity in x": "vx1", "velocity in y": "vy1"}
    p1, ins = (printed[method] for method in ("LS-SVM", "INS-only"))
    shares = {name: dict(zip(cells, of / sizes["ins"], strict=True)) for name, of in sizes.items()}
    rows = {
        "LS-SVM, P1": ("published", {of: float(p1[c]) / float(ins[c]) for of, c in cells.items()}),
        "LS-SVM, fed with the answer": ("lssvm", shares["oracle"]),
        "Kalman, 4 states": ("kalman", shares["kalman"]),
        "Kalman, 5 states": ("coloured", shares["knowing"]),
    }
    show_dots(
        "P1 Table 3, and this run", "error in", rows, x="mean error over that of the INS alone",
        xlim=(0, 2), name="fig-l4-table3",
        caption="The first outage: P1's printed errors divided by those of its INS, and the "
        "same ratios in this run.",
    )  # fmt: skip


def show_tables(record: ChapterRecord, outages: BridgedOutages) -> None:
    """Show P1's Tables 3 and 1 beside what the scene gives for them."""
    # none of it is there in the page, where all else of this lesson runs
    from inswsn_book.evidence import outage_tables as core  # noqa: PLC0415
    from inswsn_book.lessons.printed import Cell, show_printed  # noqa: PLC0415

    printed = {n: read_rows(record.data(f"papers/p1-table{n}.csv"), i) for n, i in _INDEX.items()}
    equal = {name: slug for slug, name in core.EQUAL.items()}
    slugs = {name: slug for slug, name in core.METHODS.items()}

    def cell3(method: str, column: str, text: str) -> Cell:
        what = f"{method}, ${column[0]}_{column[1]}$, outage {column[2]}"
        fair = f"fair.cells.{equal[method]}.{column}" if method in equal else "the same"
        return Cell(what, text, f"table3.{slugs[method]}.{column}", fair, "none")

    def cell1(row: str, of: Mapping[str, str], column: str) -> Cell:
        what = f"No. {row}, $\\sigma$ {of['sigma']}, $\\eta$ {of['eta']}: {_TABLE1[column][1]}"
        name = f"table1.row{int(row):02d}.{_TABLE1[column][0]}"
        return Cell(what, of[column], name, "one method", "none")

    show_printed(
        record, "p1-outages",
        [cell3(m, c, text) for m, of in printed[3].items() for c, text in of.items()],
        lambda: core.rebuild_table3(outages),
        by=_SCENE,
        name="tbl-l4-table3",
        caption="P1's Table 3, mean absolute errors (m, m/s), medians and 95 % of runs. Rebuilt: "
        "BP of a toolbox, and the printed LS-SVM, both fed with the oracle. On equal terms: both "
        "rehearsed alike, fed with the motion. Recorded: none; the recorded outages of lesson 8 "
        "are other ones.",
        first=(*_FAIR, "fair.bp.motion"),
    )  # fmt: skip
    pairs = {int(n): (float(of["sigma"]), float(of["eta"])) for n, of in printed[1].items()}
    show_printed(
        record, "p1-outages",
        [cell1(n, of, c) for n, of in printed[1].items() for c in _TABLE1],
        lambda: core.rebuild_table1(outages, pairs),
        by=_SCENE,
        name="tbl-l4-table1",
        caption="P1's Table 1, mean absolute errors (m, m/s) on the 50 points that trained the "
        "LS-SVM, fed with the oracle, medians and 95 % of runs. There is no rival in it, and no "
        "recording has these points.",
        fold="P1's Table 1, from which it chose the width and η",
    )  # fmt: skip
