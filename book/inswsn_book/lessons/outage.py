"""The pictures of the lesson on bridging an outage by what was learned before it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inswsn_book.moving import Chart, Moving, Slider
from inswsn_lib.navigation.bridged_outages import Passage

Array = NDArray[np.float64]
#: What a trained machine answers to inputs
Answer = Callable[[Array], Array]
#: Training: inputs, targets, width and regularisation in, the trained machine out
Machine = Callable[[Array, Array, float, float], Answer]
#: Inputs of all samples, targets of the first of them, width and regularisation in, answers out
Bridge = Callable[[Array, Array, float, float], Array]
#: A filter by hand: measurements, with NaN where there are none, in, estimates out
Filter = Callable[[Array], Array]

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
        "An outage, bridged by what was learned before",
        Slider("s", "width of the kernel", WIDTHS, start, "{:g} s"),
    )
    time = {"x": "time (s)", "xlim": (0, 30)}
    learned = shown.chart(
        "Position error of the INS in y", y="error (m)",
        ylim=(-20, 45), **time,
    )  # fmt: skip
    shown.draw(learned, "network", "", (t[:heard:4], y[::4, 1]), style="points")
    shown.draw(learned, "ins", "true", (t, error[:, 1]))
    shown.draw(learned, "lssvm", "learned", lambda s: (t, said[s][:, 1]))
    distance = shown.chart("Distance from the true position", y="off by (m)", ylim=(0, 45), **time)
    shown.draw(distance, "ins", "INS", (t, distances(error)))
    shown.draw(distance, "lssvm", "corrected", lambda s: (t, distances(error - said[s])))
    mean = {s: off((error - answers)[heard:]) for s, answers in said.items()}
    ins = off(error[heard:])
    shown.number("network", "measured", "until 20 s")
    shown.number("ins", "INS alone, in the outage", f"{ins:.1f} m")
    shown.number("lssvm", "corrected, in the outage", lambda s: f"{mean[s]:.1f} m")
    shown.sentence(
        lambda s: (
            f"With the width {s:g} s the corrected position is off by {mean[s]:.1f} m in the "
            f"outage, the INS alone by {ins:.1f} m."
        )
    )
    shown.show(
        name="fig-l4-bridge",
        caption="Up to 20 s a machine sees by how much the two instruments differ, the dots. From "
        "there on it has the clock alone, and what it learned.",
        alt=f"Two charts over 30 seconds. The error of the INS in y grows to "
        f"{error[:heard, 1].max():.0f} m at 20 s and comes back after a turn. With the width "
        f"{start:g} s the learned curve goes on where it was heading: it is off by "
        f"{mean[start]:.1f} m in the outage, the INS alone by {ins:.1f} m.",
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
    shown.number("lssvm", "misses the samples by", lambda s, n: f"{missed[s, n]:.3f}")
    shown.number("lssvm", "says at u = 8", lambda s, n: f"{ahead[s, n]:.2f}")
    shown.sentence(
        lambda s, n: (
            f"With the width {s:g} and the regularisation {n:,.0f} the curve misses the samples by "
            f"{missed[s, n]:.3f} on average, and says {ahead[s, n]:.2f} at u = 8; the mean of the "
            f"samples is {middle:.2f}."
        )
    )
    shown.show(
        name="fig-l4-kernels",
        caption="Five samples. Below, their kernels; above, the answer, a sum of these with "
        "weights, and a constant.",
        alt=f"Two charts. With the width 0.2 the answer has a peak or a dip at each of five "
        f"samples and is {ahead[0.2, 10.0]:.2f} away from them; below, five narrow bells.",
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
    known = shown.chart("While it learns: off from the fixes", y="off by (m)", ylim=(0, 8), **axes)
    lost = shown.chart("In the outage: off from the truth", y="off by (m)", ylim=(0, 30), **axes)

    def add(chart: Chart, of: Mapping[tuple[float, float], float]) -> None:
        shown.draw(chart, "lssvm", "", lambda n: (x, [of[s, n] for s in _WIDE]))
        shown.draw(chart, "truth", "", lambda s, n: _upright(s, of[s, n]))

    add(known, train)
    add(lost, bridged)
    middle, ins = off((error - y.mean(axis=0))[heard:]), off(error[heard:])
    for method, label, level in (("published", "mean", middle), ("ins", "INS", ins)):
        shown.draw(lost, method, label, (x, np.full(len(x), level)))
    shown.number("lssvm", "while it learns", lambda s, n: f"{train[s, n]:.2f} m")
    shown.number("lssvm", "in the outage", lambda s, n: f"{bridged[s, n]:.1f} m")
    shown.number("published", "the mean of the fixes, held", f"{middle:.1f} m")
    shown.sentence(
        lambda s, n: (
            f"With the width {s:,g} s and the regularisation {n:,.0f} the machine is off by "
            f"{train[s, n]:.2f} m where it learned and by {bridged[s, n]:.1f} m in the outage; the "
            f"mean of what it learned is off by {middle:.1f} m."
        )
    )
    best = min(bridged, key=bridged.__getitem__)
    shown.show(
        name="fig-l4-widths",
        caption="The same machine on the same drive. A small error where it learned says nothing "
        "of the outage.",
        alt="Two charts over the width. With η = 1000 the error in training rises from "
        f"{train[0.1, 1e3]:.2f} m to {train[1e4, 1e3]:.1f} m. In the outage it is "
        f"{bridged[0.1, 1e3]:.1f} m at 0.1 s, {bridged[3.0, 1e3]:.1f} m at 3 s, "
        f"{bridged[30.0, 1e3]:.1f} m at 30 s and {bridged[1e4, 1e3]:.1f} m at 10,000 s; the least "
        f"of all pairs is {bridged[best]:.1f} m.",
    )


def _upright(width: float, level: float) -> tuple[list[float], list[float]]:
    """Return a line from nought up to a curve at a width."""
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
    axes = {"x": "width, as a power of ten", "y": "off by (m)", "xlim": (-1.1, 3.1)}
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
    shown.sentence(
        lambda kind, s: (
            f"On {kind}, with a width of {s:.3g} deviations, the machine is off by "
            f"{rehearsed[kind, s]:.1f} m in the rehearsal and by {bridged[kind, s]:.1f} m in the "
            f"outage."
        )
    )
    best = min(rehearsed, key=rehearsed.__getitem__)
    shown.show(
        name="fig-l4-rehearsal",
        caption="At each width the regularisation is the one that rehearses best. What is known "
        "before the outage stands above, what comes of it below.",
        alt=f"Two charts over the width. The least rehearsed error, {rehearsed[best]:.1f} m on "
        f"{best[0]}, becomes {bridged[best]:.1f} m in the outage. The INS alone has {ins:.1f} m.",
    )


def show_oracle(drive: Passage, machine: Machine) -> None:
    """Show what a machine says that is fed with the true error, by its width."""
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
    shown.sentence(
        lambda s: (
            f"With the width {s:g} the corrected y is off by {left[s][1]:.1f} m and "
            f"{left[s][3]:.1f} m/s in the outage; the INS alone by {ins[1]:.1f} m and "
            f"{ins[3]:.1f} m/s."
        )
    )
    shown.show(
        name="fig-l4-oracle",
        caption="The input is the true error of the INS, in training and in the outage, as P1 has "
        "it. Subtract the input itself, and nothing remains.",
        alt=f"Two charts over 30 seconds. With the width 1000 the answer in position follows the "
        f"true error, {left[1000.0][1]:.1f} m off; that in velocity does not, "
        f"{left[1000.0][3]:.1f} m/s off, where the INS alone has {ins[3]:.1f} m/s.",
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
        "When the network goes, and for how long",
        Slider("b", "lost at", begins, 20.0, "{:g} s"),
        Slider("n", "for", lengths, 10, "{:g} s"),
    )
    since = period * np.arange(longest)
    chart = shown.chart(
        "Distance from the true position", x="time since it was lost (s)", y="off by (m)",
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
        off_by = {method: mean(method, b, n) for method in found}
        return (
            f"Lost at {b:g} s for {n} s: the INS alone is off by {off_by['ins']:.1f} m on average, "
            f"the last fix held by {off_by['network']:.1f} m, the Kalman filter by "
            f"{off_by['kalman']:.1f} m, the LS-SVM by {off_by['lssvm']:.1f} m."
        )

    shown.sentence(say)
    shown.show(
        name="fig-l4-rivals",
        caption="Move the outage to before the turn, and into it. The LS-SVM is rehearsed anew for "
        "each.",
        alt=f"Two charts. {say(20.0, 2)} {say(20.0, 10)} {say(10.0, 10)} The velocity in y is "
        "steady until 18 s; then comes a turn.",
    )
    return mean


def show_heading(
    drives: Mapping[float, Passage], coast: Filter, knowing: Callable[..., Array]
) -> None:
    """Show two filters in the outage, by what part of the heading's errors the INS has."""
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
        "Distance from the true position", x="time since it was lost (s)",
        y="off by (m)", xlim=(0, 10), ylim=(0, 40),
    )  # fmt: skip
    since = t[heard:] - t[heard]

    def add(method: str, label: str, of: Mapping[float, Array], at: int) -> None:
        shown.draw(chart, method, label, lambda share: (since, of[share]), at=at)
        shown.number(method, label, lambda share: f"{of[share].mean():.1f} m")

    add("ins", "INS alone", alone, 8)
    add("kalman", "4 states", plain, -1)
    add("coloured", "5 states", turning, -1)
    shown.sentence(
        lambda share: (
            f"With the heading error times {share:g} the filter of four states is off by "
            f"{plain[share].mean():.1f} m, that of five by {turning[share].mean():.1f} m, the INS "
            f"alone by {alone[share].mean():.1f} m."
        )
    )
    shown.show(
        name="fig-l4-heading",
        caption="Take the error of the heading away, and the Kalman filter of four states bridges "
        "the turn, too. One state more, and it need not be taken away.",
        alt=f"Over ten seconds of outage the filter of four states is off by "
        f"{plain[1.0].mean():.1f} m on average, that of five by {turning[1.0].mean():.1f} m. "
        f"Without an error of the heading they are off by {plain[0.0].mean():.1f} and "
        f"{turning[0.0].mean():.1f} m.",
    )
