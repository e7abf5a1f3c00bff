"""The pictures of the lesson on bridging an outage, and what it records."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from inswsn_book.record import ChapterRecord
from inswsn_book.show.moving import Chart, Moving, Slider
from inswsn_lib.checks import Array
from inswsn_lib.navigation.bridged_outages import Passage
from inswsn_lib.papers import read_rows

if TYPE_CHECKING:
    from inswsn_lib.navigation import BridgedOutages

#: What a trained machine answers to inputs
Answer = Callable[[Array], Array]
#: Training: inputs, targets, width and regularisation in, the trained machine out
Machine = Callable[[Array, Array, float, float], Answer]
#: Inputs of all samples, targets of the first of them, width and regularisation in, answers out
Bridge = Callable[[Array, Array, float, float], Array]
#: A filter by hand: measurements, with NaN where there are none, in, estimates out
Filter = Callable[[Array], Array]
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

#: The axes of errors in an outage
SINCE: dict[str, Any] = {
    "title": "Distance from the true position", "x": "time since the loss (s)", "xlim": (0, 10),
}  # fmt: skip
WIDTHS = [
    *(0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 50.0),
    *(100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4),
]
STRENGTHS = [1.0, 1e2, 1e3, 1e6]


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


def show_turn(drives: Mapping[float, Passage]) -> None:
    """Show an outage on the map, by where it begins and by the heading error.

    The INS goes on from the last fix of position and velocity.
    """
    shares, begins = list(drives), [float(b) for b in range(8, 21)]
    t, _, _, heard = _of(drives[1.0])
    longest = len(t) - heard
    since = t[:longest]
    motion = np.asarray(drives[1.0].inputs["motion"])
    true = (motion - drives[1.0].error)[:, :2]
    way = np.unwrap(np.arctan2(*np.diff(true, axis=0).T))
    bends = {b: np.degrees(np.ptp(way[_after(t, b, longest - 1)])) for b in begins}

    @cache
    def left(b: float, share: float) -> Array:
        rows, drive = _after(t, b, longest), drives[share]
        start = drive.y[rows.start - 1]
        gone = since + t[1]  # since the last fix
        return np.asarray(drive.error[rows, :2] - start[:2] - gone[:, None] * start[2:])

    shown = Moving(
        "What a turn does in an outage",
        Slider("b", "network lost at", begins, 20.0, "{:g} s", plays=True),
        Slider("share", "heading error, times", shares, 1.0, "{:g}"),
    )
    drawn = shown.map("The map: drag the outage along it", xlim=(350, 530), ylim=(10, 130))
    shown.draw(drawn, "truth", "true", true.T, at=60)
    shown.draw(
        drawn, "ins", "INS", lambda b, share: (true[_after(t, b, longest)] + left(b, share)).T
    )
    shown.draw(drawn, "ins", "", lambda b: true[_after(t, b, 1)].T, style="handle")
    chart = shown.chart(ylim=(0, 60), **SINCE)
    shown.draw(chart, "ins", "INS", lambda b, share: (since, distances(left(b, share))))
    mean = cache(lambda b, share: f"{off(left(b, share)):.1f} m")
    shown.number("truth", "the road turns by", lambda b: f"{bends[b]:.0f}°")
    shown.number("computed", "mean error of the INS", mean)
    shown.goal(
        "lost at 18 s or later, the mean error is below 2 m",
        lambda b, share: b >= 18 and off(left(b, share)) < 2,
    )
    shown.sentence(lambda b, share: (
        f"The network is lost at {b:g} s, for 10 s, in which the road turns by {bends[b]:.0f} "
        f"degrees. With the heading error times {share:g}, the mean error of the INS is "
        f"{mean(b, share)}."
    ))  # fmt: skip
    shown.show(
        "fig-l4-turn",
        "When the network is lost, the INS is set to the last fix, and goes on alone.",
    )


def _after(t: Array, begin: float, samples: int) -> slice:
    first = round(begin / float(t[1]))
    return slice(first, first + samples)


def show_kernels(machine: Machine) -> None:
    """Show the curve through five samples and the kernels that it is made of."""
    U = np.array([[0.0], [1.0], [2.0], [4.0], [5.0]])
    Y = np.array([[0.0], [1.0], [0.6], [2.0], [1.6]])
    x = np.linspace(-4, 9, 131)
    widths = [0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0]
    shown = Moving(
        "Width and regularisation on one curve",
        Slider("s", "width σ", widths, 0.2, "{:g}"),
        Slider("n", "regularisation η", STRENGTHS, 100.0, "{:,.0f}"),
    )

    def bell(at: float, s: float) -> tuple[Array, Array]:
        return x, np.exp(-((x - at) ** 2) / (2 * s**2))

    axes = {"x": "input u", "xlim": (-4, 9)}
    answers = shown.chart("The answer f(u)", y="f(u)", ylim=(-1, 3), **axes)
    found = {(s, n): machine(U, Y, s, n) for s in widths for n in STRENGTHS}
    middle = float(Y.mean())
    shown.draw(answers, "published", "mean", ([-4, 9], [middle, middle]), at=0)
    shown.draw(answers, "lssvm", "answer", lambda s, n: (x, found[s, n](x[:, None])[:, 0]))
    shown.draw(answers, "network", "", (U[:, 0], Y[:, 0]), style="points")
    alike = shown.chart("How alike u is to each sample", y="k(u, uᵢ)", ylim=(0, 1.25), **axes)
    for at in U[:, 0]:
        shown.draw(alike, "network", "", partial(bell, at))
    missed = {key: float(abs(answer(U) - Y).mean()) for key, answer in found.items()}
    ahead = {key: float(answer(np.array([[8.0]]))[0, 0]) for key, answer in found.items()}
    shown.number("computed", "mean error at the samples", lambda s, n: f"{missed[s, n]:.3f}")
    shown.number("computed", "answer at u = 8", lambda s, n: f"{ahead[s, n]:.2f}")
    shown.sentence(lambda s, n: (
        f"With the width {s:g} and the regularisation {n:,.0f}, the mean error at the samples "
        f"is {missed[s, n]:.3f} and the answer at u = 8 is {ahead[s, n]:.2f}; the mean of the "
        f"samples is {middle:.2f}."
    ))  # fmt: skip
    shown.show(
        "fig-l4-kernels",
        "Five samples. The lower chart shows their kernels, the upper one the answer: a "
        "weighted sum of the kernels plus a constant.",
    )


def show_widths(drive: Passage, machine: Machine) -> None:
    """Show an outage bridged by a machine on time, and its error, by width and regularisation."""
    t, error, y, heard = _of(drive)
    said = {
        (s, n): machine(t[:heard, None], y, s, n)(t[:, None]) for s in WIDTHS for n in STRENGTHS
    }
    train = {key: off(answers[:heard] - y) for key, answers in said.items()}
    bridged = {key: off((error - answers)[heard:]) for key, answers in said.items()}
    shown = Moving(
        "An outage bridged by what was learned before",
        Slider("s", "width of the kernel", WIDTHS, 100.0, "{:,g} s"),
        Slider("n", "regularisation η", STRENGTHS, 1e3, "{:,.0f}"),
    )
    learned = shown.chart("Position error of the INS in y", xlim=(0, 30), ylim=(-20, 45))
    shown.draw(learned, "network", "", (t[:heard:4], y[::4, 1]), style="points")
    shown.draw(learned, "ins", "true", (t, error[:, 1]))
    shown.draw(learned, "lssvm", "learned", lambda s, n: (t, said[s, n][:, 1]))
    axes = {"x": "width of the kernel (s), as a power of ten", "xlim": (-1.1, 4.1)}
    chart = shown.chart("Mean distance, by the width", ylim=(0, 30), **axes)
    _by_width(shown, chart, WIDTHS, {"in training": train, "in the outage": bridged})
    middle, ins = off((error - y.mean(axis=0))[heard:]), off(error[heard:])
    for method, label, level in (("published", "mean", middle), ("ins", "INS alone", ins)):
        shown.draw(chart, method, label, ([-1.1, 4.1], [level, level]))
        shown.number(method, f"{label}, in the outage", f"{level:.1f} m")
    shown.goal("mean error in the outage below 3 m", lambda s, n: bridged[s, n] < 3)
    shown.sentence(lambda s, n: (
        f"With the width {s:,g} s and the regularisation {n:,.0f}, the machine's error is "
        f"{train[s, n]:.2f} m in training and {bridged[s, n]:.1f} m in the outage, where that "
        f"of the mean is {middle:.1f} m and that of the INS {ins:.1f} m."
    ))  # fmt: skip
    shown.show(
        "fig-l4-widths",
        "Until 20 s the machine sees how much the two instruments differ (dots). After "
        "that it has only the clock, and what it has learned.",
    )


def show_rehearsal(drive: Passage, bridge: Bridge) -> None:
    """Show the error in a rehearsed outage and in the real one over the width, by the input."""
    _, error, y, heard = _of(drive)
    half, kinds = heard // 2, ["time", "motion"]
    widths = [round(float(10**p), 3) for p in np.arange(-1, 3.01, 0.25)]
    rehearsed, bridged = {}, {}
    for kind in kinds:
        u = np.asarray(drive.inputs[kind])
        for s in widths:
            losses = {n: off(bridge(u[:heard], y[:half], s, n) - y[half:]) for n in STRENGTHS}
            n = min(losses, key=losses.__getitem__)
            rehearsed[s, kind] = losses[n]
            bridged[s, kind] = off(bridge(u, y, s, n) - error[heard:])
    shown = Moving(
        "Rehearse an outage, then meet one",
        Slider("n", "input", kinds, "motion", "{}"),
        Slider("s", "width (deviations)", widths, 0.1, "{:,.3g}"),
    )
    axes = {"x": "width, as a power of ten", "xlim": (-1.1, 3.1)}
    chart = shown.chart("Mean distance, by the width", ylim=(0, 50), **axes)
    _by_width(shown, chart, widths, {"rehearsed": rehearsed, "in the outage": bridged})
    ins = off(error[heard:])
    shown.draw(chart, "ins", "INS", ([-1.1, 3.1], [ins, ins]))
    shown.number("ins", "INS alone, in the outage", f"{ins:.1f} m")
    shown.sentence(lambda n, s: (
        f"With {n} as the input and a width of {s:.3g} deviations, the machine's error is "
        f"{rehearsed[s, n]:.1f} m in the rehearsal and {bridged[s, n]:.1f} m in the outage."
    ))  # fmt: skip
    shown.show(
        "fig-l4-rehearsal",
        "At each width, the regularisation is the one with the least error in the "
        "rehearsal, which is known before the outage.",
    )


def _by_width(
    shown: Moving, chart: Chart, widths: list[float],
    errors: Mapping[str, Mapping[tuple[float, Any], float]],
) -> None:  # fmt: skip
    """Draw two errors over the width, known before the outage and not, by the sliders s and n."""
    labels = dict(zip(("constant", "lssvm"), errors, strict=True))

    def curve(m: str, n: Any) -> tuple[Array, list[float]]:
        return np.log10(widths), [errors[labels[m]][s, n] for s in widths]

    def now(m: str, s: float, n: Any) -> tuple[list[float], list[float]]:
        return [np.log10(s)], [errors[labels[m]][s, n]]

    shown.draw_each(chart, labels, curve)
    shown.draw_each(chart, dict.fromkeys(labels, ""), now, style="points")
    shown.number_each(labels, lambda m, s, n: f"{errors[labels[m]][s, n]:.2f} m")


def show_oracle(drive: Passage, machine: Machine) -> None:
    """Show what a machine answers that is fed with the true error, by its width."""
    t, error, y, heard = _of(drive)
    said = {s: machine(error[:heard], y, s, 1e3)(error) for s in WIDTHS[5:]}
    shown = Moving("Fed with the answer", Slider("s", "width of the kernel", [*said], 1e3, "{:,g}"))
    for i, title, unit, end in ((1, "Position", "m", 20), (3, "Velocity", "m/s", 3)):
        chart = shown.chart(title, y=f"error in y ({unit})", xlim=(0, 30), ylim=(-end, end))
        shown.draw(chart, "ins", "true", (t, error[:, i]))
        shown.draw(chart, "lssvm", "answer", partial(lambda k, s: (t, said[s][:, k]), i))

    def number(method: str, s: float) -> str:
        left = error - said[s] if method == "lssvm" else error
        return "{1:.1f} m, {3:.1f} m/s".format(*abs(left)[heard:].mean(axis=0))

    words = shown.number_each({"ins": "INS alone, in the outage", "lssvm": "corrected"}, number)
    shown.sentence(lambda s: f"Errors in y with the width {s:,g}: {words(s)}.")
    shown.show("fig-l4-oracle", "The input is the true error of the INS, in the outage, too.")


def show_rivals(
    drive: Passage, coast: Filter, rehearse: Callable[..., Any], bridge: Bridge
) -> Callable[[str, float, int], float]:
    """Show the distance over outages that begin earlier or later and last longer or shorter.

    Returns the mean distance of a method in an outage that begins then and lasts so long.
    """
    t, error, y, heard = _of(drive)
    inputs = {kind: np.asarray(drive.inputs[kind]) for kind in ("time", "motion")}
    begins, longest = [float(b) for b in range(8, 21)], len(error) - heard
    found: dict[str, dict[float, Array]] = {m: {} for m in ("ins", "network", "kalman", "lssvm")}
    for b in begins:
        rows = _after(t, b, longest)
        n, known = rows.start, np.vstack([y, np.full((longest, 4), np.nan)])
        known[n:] = np.nan
        kind, sigma, eta = rehearse(inputs, y[:n])
        found["ins"][b] = distances(error[rows])
        found["network"][b] = distances(error[rows] - y[n - 1])
        found["kalman"][b] = distances((error - coast(known))[rows])
        learned = bridge(inputs[kind], y[:n], sigma, eta)[:longest]
        found["lssvm"][b] = distances(error[rows] - learned)
    labels = dict(zip(found, ("INS alone", "last y held", "Kalman", "LS-SVM"), strict=True))
    shown = Moving(
        "When the network is lost, and for how long",
        Slider("b", "lost at", begins, 20.0, "{:g} s", plays=True),
        Slider("n", "for", [2, 5, 10], 10, "{:g} s"),
    )
    since = t[:longest]
    chart = shown.chart(ylim=(0, 40), **SINCE)

    def first(method: str, b: float, n: int) -> Array:
        return found[method][b][: round(n / float(t[1]))]

    def mean(method: str, b: float, n: int) -> float:
        return float(first(method, b, n).mean())

    shown.draw_each(chart, labels, lambda m, b, n: (since[: len(first(m, b, n))], first(m, b, n)))
    said = shown.number_each(labels, lambda m, b, n: f"{mean(m, b, n):.1f} m")
    shown.sentence(
        lambda b, n: f"Mean errors if the network is lost at {b:g} s for {n} s: {said(b, n)}."
    )
    shown.show(
        "fig-l4-rivals",
        "The Kalman filter has four states and coasts. The LS-SVM is rehearsed again for "
        "each outage.",
    )
    return mean


def show_heading(
    drives: Mapping[float, Passage], coast: Filter, knowing: Callable[..., Array]
) -> float:
    """Show two filters in outages, by when these begin and what error the heading has.

    Returns the mean distance (m) of the four-state filter if it has none, lost at 20 s.
    """
    begins = [10.0, 18.0, 20.0]
    labels = {"ins": "INS alone", "kalman": "4 states", "coloured": "5 states"}
    t, _, _, heard = _of(drives[1.0])
    since, found = t[: len(t) - heard], {}
    for share, drive in drives.items():
        velocity = np.asarray(drive.inputs["motion"])[:, 2:]
        for b in begins:
            rows, y = _after(t, b, len(since)), drive.y.copy()
            y[rows.start :] = np.nan
            said = 0 * drive.error[rows], coast(y)[rows], knowing(y, velocity)[rows, :4]
            for method, answers in zip(labels, said, strict=True):
                found[method, b, share] = distances(drive.error[rows] - answers)
    shown = Moving(
        "A state for the heading",
        Slider("b", "network lost at", begins, 20.0, "{:g} s"),
        Slider("share", "heading error, times", list(drives), 1.0, "{:g}"),
    )
    chart = shown.chart(ylim=(0, 60), **SINCE)
    shown.draw_each(chart, labels, lambda m, b, share: (since, found[m, b, share]))
    means = shown.number_each(labels, lambda m, b, share: f"{found[m, b, share].mean():.1f} m")
    shown.sentence(lambda b, share: (
        f"Mean errors if the network is lost at {b:g} s, with the heading error times {share:g}: "
        f"{means(b, share)}."
    ))  # fmt: skip
    shown.show(
        "fig-l4-heading",
        "Without a heading error, even the four-state Kalman filter bridges the "
        "turn. With a fifth state, the error need not be removed.",
    )
    return float(found["kalman", 20.0, 0.0].mean())


def hold(
    record: ChapterRecord, drive: Passage, said: Mapping[str, Array], machine: Machine,
    bridge: Bridge, rivals: Callable[[str, float, int], float], chosen: tuple[str, float, float],
    *, squares: Array, straight: float,
) -> None:  # fmt: skip
    """Record what the lesson finds, and hold its sentences against that."""
    for name in ("p1", "p1-inertial"):
        record.data(f"scenarios/{name}.yaml")
    t, error, y, heard = _of(drive)
    for name, e in said.items():
        record.note(f"off.{name}", off((error - e)[heard:]), "m", "Mean distance, first outage.")
    record.quote("recorded-data", "learners.mean.lssvm", ".2f", "recorded.lssvm")
    for name in _FAIR:
        record.crossed("p1-outages", name)
    record.crossed("p1-outages", "/".join(_FAIR), ".1f", "ls-svm-over-coasting")
    u, half, (along, across) = np.asarray(drive.inputs[chosen[0]]), heard // 2, squares[:2]
    best = off(error[heard:] - bridge(u, y, *chosen[1:]))
    rehearsed = off(bridge(u[:heard], y[:half], *chosen[1:]) - y[half:])
    record.note("off.rehearsed", best, "m", "Mean distance, LS-SVM.")
    record.note("rehearsed", rehearsed, "m", "Mean distance, LS-SVM, in the rehearsal.")
    record.note("straight", straight, "m", "Kalman filter, no heading error.")
    taken = 100 * along / (along + 1000)
    for name, value in (("along", along), ("across", across), ("taken", taken)):
        record.note(name, value, "1", "Of the first two directions: squares, and %.")
    answers = (machine(t[:heard, None], y, s, 1e3)(t[:, None]) for s in WIDTHS)
    widths = [off((error - answer)[heard:]) for answer in answers]
    mean = off((error - y.mean(axis=0))[heard:])
    record.holds("With some width the error is below 3 m.", min(widths) < 3)
    ends = max(abs(widths[0] - mean), abs(widths[-1] - mean))
    record.holds("At both ends the answer is the mean.", ends < 1)
    record.holds("Rehearsed best, it is worse than no correction.", best > off(error[heard:]))
    held, kalman, learned = (rivals(each, 20.0, 10) for each in ("network", "kalman", "lssvm"))
    early = max(rivals("lssvm", 10.0, 10), rivals("kalman", 10.0, 10))
    record.holds("In an outage from 10 s on, both are good.", early < 1)
    record.holds("From 17 s on, the machine's error is large.", rivals("lssvm", 17.0, 10) > 100)
    record.holds("In the turn the last fix is better than both.", held < min(kalman, learned))
    oracle, ins = (abs(error - said[each])[heard:, 2:].mean() for each in ("oracle", "ins"))
    record.holds("The oracle's velocity is worse than that of the INS.", oracle > ins)
    record.write()


def show_tables(record: ChapterRecord, outages: BridgedOutages) -> None:
    """Show P1's Tables 3 and 1 beside what the scene gives for them."""
    # none of it is there in the page, where all else of this lesson runs
    from inswsn_book.evidence import outage_tables as core  # noqa: PLC0415
    from inswsn_book.lessons.printed import Cell, show_printed  # noqa: PLC0415

    index = {1: "no", 3: "method"}  # the columns that name the rows
    printed = {n: read_rows(record.data(f"papers/p1-table{n}.csv"), i) for n, i in index.items()}
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
