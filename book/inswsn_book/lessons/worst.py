"""The pictures of the lesson on planning for the worst, and what it records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from inswsn_book.lessons.nodes import model_of
from inswsn_book.record import ChapterRecord
from inswsn_book.show.moving import Moving, Slider
from inswsn_lib.checks import Array
from inswsn_lib.filters import run_hinfinity, run_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import ExampleRun

#: What the two filters are called
LABELS = {"kalman": "Kalman", "hinfinity": "H∞"}
#: Of A, B, C, D: a gain at a gamma first, the least gamma, or singular values of a gain first
ByModel = Callable[..., Any]

PUSHED, SEEN = 24, 36  # samples of a disturbance, and of the error that it makes
GAINS = np.unique(np.append(np.round(np.arange(0.4, 1.36, 0.05), 2), 0.618))
BOUNDS = np.round(np.arange(1.3, 2.41, 0.05), 2)
MARGINS = (0.001, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 1.0, 3.0, 10.0)
FACTORS = 10.0 ** np.arange(-4, 5)


def errors_of(g: float, w: Array, v: Array) -> Array:
    """Return the error of the prediction at each sample, from no error on, until it has died."""
    e = np.zeros(len(w) + 200)
    for k in range(len(e) - 1):
        e[k + 1] = (1 - g) * e[k] + (w[k] - g * v[k] if k < len(w) else 0)
    return e


def most(g: float) -> float:
    """Return the largest ratio of energies that any disturbance of `PUSHED` samples reaches."""
    each = np.eye(PUSHED)
    by_drift = np.array([errors_of(g, push, 0 * push) for push in each])
    by_noise = np.array([errors_of(g, 0 * push, push) for push in each])
    return float(np.linalg.norm(np.vstack([by_drift, by_noise]), 2) ** 2)


def disturbance(cycles: float, share: int) -> tuple[Array, Array]:
    """Return a burst of energy one: its drift, and its errors of fixes, by their share in %."""
    k = np.arange(PUSHED)
    wave = np.sin(np.pi * (k + 0.5) / PUSHED) * np.cos(
        2 * np.pi * cycles * (k - (PUSHED - 1) / 2) / PUSHED
    )
    wave /= np.linalg.norm(wave)
    part = abs(share) / 100
    return (1 - part) ** 0.5 * wave, np.sign(share) * part**0.5 * wave


def show_game(*, kalman: float, hinfinity: float) -> None:
    """Show what a disturbance of the reader's does to two filters, and the most that one can."""
    shown = Moving(
        "Energy in, energy out",
        Slider("c", "cycles in 24 samples", [*range(13)], 5, "{:d}"),
        Slider("s", "energy in the fixes", [*range(-100, 101, 20)], 0, "{:+d} %"),
    )
    gains = {"kalman": kalman, "hinfinity": hinfinity}

    @cache
    def out(g: float, c: int, s: int) -> tuple[float, ...]:
        return tuple(errors_of(g, *disturbance(c, s)))

    def ratio(g: float, c: int, s: int) -> float:
        return float(np.sum(np.square(out(g, c, s))))

    time, axes = np.arange(SEEN), {"x": "sample", "xlim": (0, SEEN - 1)}
    put = shown.chart("You put in (energy 1)", y="push", ylim=(-0.6, 0.6), **axes)
    shown.draw(put, "ins", "drift", lambda c, s: (time[:PUSHED], disturbance(c, s)[0]), at=23)
    shown.draw(put, "network", "fixes", lambda c, s: (time[:PUSHED], disturbance(c, s)[1]), at=23)
    got = shown.chart("You get out", y="error", ylim=(-0.6, 0.6), **axes)
    shown.draw_each(got, LABELS, lambda m, c, s: (time, out(gains[m], c, s)[:SEEN]))
    words = {name: f"{LABELS[name]} (at most {most(g):.2f})" for name, g in gains.items()}
    shown.number_each(words, lambda name, c, s: f"{ratio(gains[name], c, s):.2f}")
    shown.sentence(lambda c, s: (
        f"With {c} cycles and {s} % of the energy in the fixes, the Kalman filter's error has the "
        f"energy {ratio(kalman, c, s):.2f}, the H-infinity filter's {ratio(hinfinity, c, s):.2f}."
    ))  # fmt: skip
    shown.goal("Kalman: energy above 3.5", lambda c, s: ratio(kalman, c, s) > 3.5)
    shown.show(
        "fig-l3-game",
        "The energy that you put in is 1. A minus sign means that the fix errors oppose the drift. "
        "In brackets: the most that any disturbance of 24 samples can reach.",
    )


def show_response(*, start: float) -> None:
    """Show the energy ratio over the frequency by the gain, its mean and its peak."""
    frequency = np.linspace(0, 0.5, 101)
    z = np.exp(2j * np.pi * frequency)
    of = {g: (1 + g**2) / abs(z - 1 + g) ** 2 for g in GAINS}
    peak = {g: of[g].max() for g in GAINS}  # at the slowest wave, or at the fastest
    mean = {g: (1 + g**2) / (2 * g - g**2) for g in GAINS}
    shown = Moving("Peak and mean", Slider("g", "gain g", [*GAINS], start, "g = {:.3g}"))
    axes = {"x": "frequency (cycles a sample)", "y": "energy ratio", "xlim": (0, 0.5)}
    chart = shown.chart("Energy out per unit put in", ylim=(0, 8), **axes)
    shown.draw(chart, "constant", "", lambda g: (frequency, np.minimum(of[g], 8)))
    shown.draw(chart, "kalman", "mean", lambda g: ([0.0, 0.5], [mean[g]] * 2))
    shown.draw(
        chart, "hinfinity", "peak", lambda g: ([(g > 1) / 2], [peak[g]]), style="points", at=0
    )
    shown.number("hinfinity", "peak: worst case", lambda g: f"{peak[g]:.2f}")
    shown.number("kalman", "mean: white noise", lambda g: f"{mean[g]:.2f}")
    shown.sentence(
        lambda g: f"With g = {g:.3g} the peak is {peak[g]:.2f} and the mean {mean[g]:.2f}."
    )
    shown.show(
        "fig-l3-response", "Find the gain with the lowest peak, then the one with the lowest mean."
    )


def show_two_curves() -> None:
    """Show the worst case and the variance over the gain, each as a multiple of its least."""
    g = np.round(np.arange(0.1, 1.601, 0.02), 2)
    noises = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0)
    worst, mean, best = {}, {}, {}
    for d in noises:
        above = np.where(g <= 1, g, 2 - g) ** 2
        worst[d], mean[d] = ((1 + g**2 * d**2) / each for each in (above, 2 * g - g**2))
        best[d] = (-1 + (1 + 4 * d**2) ** 0.5) / (2 * d**2)
    shown = Moving(
        "Each filter at its own minimum",
        Slider("d", "noise of fixes / drift", [*noises], 0.25, "{:g}"),
    )
    axes = {"x": "gain g", "y": "multiple", "xlim": (0, 1.6), "ylim": (0.8, 4)}
    chart = shown.chart("Multiples of the least value", **axes)
    shown.draw(chart, "hinfinity", "worst", lambda d: (g, np.minimum(worst[d] / (1 + d**2), 4)))
    least = {d: (1 + best[d] ** 2 * d**2) / (2 * best[d] - best[d] ** 2) for d in noises}
    shown.draw(chart, "kalman", "mean", lambda d: (g, np.minimum(mean[d] / least[d], 4)))
    shown.draw(chart, "hinfinity", "", ([1.0], [1.0]), style="points")
    shown.draw(chart, "kalman", "", lambda d: ([best[d]], [1.0]), style="points")
    shown.number("hinfinity", "least worst case at", "g = 1.00")
    its = {d: (1 / best[d] ** 2 + d**2) / (1 + d**2) for d in noises}
    words = "least mean at (its worst case)"
    shown.number("kalman", words, lambda d: f"g = {best[d]:.2f} ({its[d]:.2f} × the least)")
    shown.sentence(
        lambda d: f"Noise/drift {d:g}: least mean at g = {best[d]:.2f}, least worst case at g = 1."
    )
    shown.show("fig-l3-curves", "Worse fixes lower the Kalman gain. The H∞ gain stays at 1.")


def show_certificate(*, kalman: float, hinfinity: float) -> None:
    """Show for which P the storage inequality holds, by the bound that is asked for."""
    P = np.round(np.arange(0.5, 4.001, 0.025), 3)

    def largest(g: float, bound: float, P: Array) -> Array:
        both = np.array([1 - g, 1, -g])
        matrices = P[:, None, None] * np.outer(both, both) - np.diag([0, bound**2, bound**2])
        matrices[:, 0, 0] += 1 - P
        return np.asarray(np.linalg.eigvalsh(matrices)[:, -1])

    fine = np.linspace(0.5, 4, 3501)

    @cache
    def said(g: float, bound: float) -> str:
        holds = fine[largest(g, bound, fine) < 0]
        return f"P from {holds[0]:.2f} to {holds[-1]:.2f}" if len(holds) else "no P"

    shown = Moving("Is there a certificate?", Slider("b", "bound γ", [*BOUNDS], 2.4, "γ = {:.2f}"))
    axes = {"x": "P", "y": "below 0: proven", "xlim": (0.5, 4), "ylim": (-2, 2)}
    chart = shown.chart("Largest eigenvalue of the matrix", **axes)
    shown.draw(chart, "truth", "", ([0.5, 4], [0, 0]))
    gains = {"kalman": kalman, "hinfinity": hinfinity}
    shown.draw_each(chart, LABELS, lambda m, b: (P, np.clip(largest(gains[m], b, P), -2, 2)))
    shown.number_each(LABELS, lambda m, b: said(gains[m], b))
    shown.sentence(lambda b: (
        f"The bound {b:.2f} is proven for the Kalman filter by {said(kalman, b)}, and for the "
        f"H-infinity filter by {said(hinfinity, b)}."
    ))  # fmt: skip
    shown.show(
        "fig-l3-certificate",
        "Lower γ until no P is left, first for the Kalman filter, then for the H∞ filter.",
    )


#: The steps of P1's proof, by the number of the equation that each comes to
STEPS = ("2.16", "2.18", "2.19", "2.20", "2.21")


def largest_eigenvalues(A: Array, B: Array, P: Array, gamma: float) -> dict[str, float]:
    """Return the largest eigenvalue of the matrix of each step of P1's proof, without jitter."""
    n, p = B.shape
    PA, PB, cost, across = P @ A, P @ B, gamma**2 * np.eye(p), A.T @ P @ B
    theta, both = cost - B.T @ PB, np.hstack([A, B])
    delta = -P + A.T @ PA + np.eye(n)
    schur = delta + across @ np.linalg.solve(theta, across.T)
    none, zero = np.zeros((n, p)), np.zeros((n, n))
    blocks = {
        "2.16": [[schur, none], [none.T, -theta]],
        "2.18": [[delta, across], [across.T, -theta]],
        "2.20": [[delta, none, PA.T], [none.T, -cost, PB.T], [PA, PB, -P]],
        "2.21": [
            [-P, none, PA.T, PA.T, np.eye(n)], [none.T, -cost, PB.T, none.T, none.T],
            [PA, PB, -P, zero, zero], [PA, none, zero, -P, zero],
            [np.eye(n), none, zero, zero, -np.eye(n)],
        ],
    }  # fmt: skip
    matrices = {name: np.block(parts) for name, parts in blocks.items()}
    matrices["2.19"] = np.block([[delta, none], [none.T, -cost]]) + both.T @ P @ both
    return {
        name: float(np.linalg.eigvalsh(matrix).max() / np.abs(matrix).max())
        for name, matrix in matrices.items()
    }


def show_votes(cases: Sequence[tuple[Array, Array, Array, float]]) -> list[int]:
    """Show on random systems whether both sides of each step of P1's proof agree.

    Returns how many systems each step loses.
    """
    votes = [largest_eigenvalues(*case) for case in cases]
    shown = Moving(
        "Which step loses systems?",
        Slider("step", "step of the proof", [1, 2, 3, 4], 1, "{:d} of 4"),
    )
    # so that both small and large numbers are seen; the sign stays
    found = {
        step: np.cbrt([[vote[STEPS[step - 1]], vote[STEPS[step]]] for vote in votes]).T
        for step in (1, 2, 3, 4)
    }
    lost = {step: (pair[0] < 0) & (pair[1] >= 0) for step, pair in found.items()}
    agree = {step: (pair[0] < 0) == (pair[1] < 0) for step, pair in found.items()}
    axes = {"x": "before the step (below 0: holds)", "y": "after the step", "xlim": (-1.2, 1.2)}
    chart = shown.chart("Each dot is a system", ylim=(-1.2, 1.2), **axes)
    ends = {step: f"P1 ({STEPS[step - 1]}) to P1 ({STEPS[step]})" for step in found}
    shown.draw(chart, "truth", "", ([-1.2, 1.2], [0, 0]))
    shown.draw(chart, "truth", "", ([0, 0], [-1.2, 1.2]))
    shown.draw(chart, "hinfinity", "", lambda step: found[step][:, ~lost[step]], style="points")
    shown.draw(chart, "ins", "", lambda step: found[step][:, lost[step]], style="points")
    shown.number("published", "from", lambda step: ends[step])
    shown.number("hinfinity", "both inequalities agree", lambda step: f"{agree[step].sum():d}")
    shown.number("ins", "lost by the step", lambda step: f"{lost[step].sum():d}")
    shown.sentence(lambda step: (
        f"From {ends[step]}, the inequalities agree for {agree[step].sum()} of {len(votes)} "
        f"systems, and {lost[step].sum()} are lost."
    ))  # fmt: skip
    shown.show(
        "fig-l3-votes",
        "A step that is an equivalence has no dot in the upper left or lower right: "
        "both inequalities hold, or neither does. The axes show cube roots.",
    )
    return [int(each.sum()) for each in lost.values()]


def show_recursion() -> None:
    """Show whether the Riccati recursion of a random walk settles, by the gamma asked for."""
    bounds, steps = [1.2, 1.3, 1.35, 1.4, 2**0.5, 1.45, 1.5, 1.6, 1.8, 2.0, 3.0], range(25)
    path = {gamma: [1.0] for gamma in bounds}
    for gamma, M in path.items():
        while len(M) < len(steps) and M[-1] < gamma**2 - 1e-9:
            M.append(1 + 1 / (1 / M[-1] + 1 - gamma**-2))

    def said(b: float) -> str:
        fails = f"fails at step {len(path[b]) - 1}"
        return f"settles at K = {path[b][-1] - 1:.3f}" if len(path[b]) == len(steps) else fails

    shown = Moving("Is this γ possible?", Slider("b", "bound γ", bounds, 1.4, "γ = {:.3f}"))
    chart = shown.chart("M of the random walk", x="step", y="M", xlim=(0, 24), ylim=(0, 4))
    shown.draw(chart, "truth", "γ²", lambda b: ([0, 24], [min(b**2, 4)] * 2), at=1)
    shown.draw(chart, "hinfinity", "", lambda b: (steps[: len(path[b])], np.minimum(path[b], 4)))
    shown.number("hinfinity", "recursion", said)
    shown.goal("the least γ", lambda b: b == 2**0.5)
    shown.sentence(lambda b: f"With γ = {b:.3f}, the recursion of the random walk {said(b)}.")
    shown.show(
        "fig-l3-recursion",
        "M has to stay below γ². If γ is too small, it does not. A large γ gives the gain "
        "of the Kalman filter, 0.618.",
    )


def show_price(response: ByModel, gains: Mapping[float, Array], kalman: Array) -> None:
    """Show worst case, error under white noise and frequency response, by the margin."""
    sizes = {m: response(gain) for m, gain in (*gains.items(), (np.inf, kalman))}
    cost = {m: (each.max(), np.mean((each**2).sum(axis=1)) ** 0.5) for m, each in sizes.items()}
    shown = Moving("What a guarantee costs", Slider("m", "margin m", [*gains], min(gains), "{:g}"))
    axes = {"x": "worst-case gain", "y": "RMS error, white noise", "xlim": (5, 10), "ylim": (2, 6)}
    chart = shown.chart("Two costs", **axes)
    shown.draw(chart, "hinfinity", "H∞", [*zip(*(cost[m] for m in gains), strict=True)], at=2)
    shown.draw(chart, "kalman", "Kalman", np.transpose([cost[np.inf]]), style="points", at=0)
    shown.draw(chart, "hinfinity", "", lambda m: np.transpose([cost[m]]), style="handle")

    def said(m: float) -> str:
        return f"{cost[m][0]:.2f} and {cost[m][1]:.2f}"

    shown.number("hinfinity", "H∞: worst case and RMS error", said)
    shown.number("kalman", "Kalman: worst case and RMS error", said(np.inf))
    shown.sentence(lambda m: (
        f"With margin {m:g}, worst-case gain and RMS error are {said(m)}; those of the Kalman "
        f"filter are {said(np.inf)}."
    ))  # fmt: skip
    shown.show(
        "fig-l3-price",
        "One axis, fixes of position alone. Drag the dot from the lowest worst case to the "
        "Kalman filter. The first steps reduce the error most.",
    )


def models_of(run: ExampleRun, factor: float) -> tuple[ErrorModel, list[Array]]:
    """Return the vehicle's model by the factor on its Q, and A, B, C, D of one axis: both alike."""
    both = model_of(run, factor)
    return both, [each[::2, ::2] for each in (both.A, both.B, both.C, both.D)]


def show_vehicle(
    run: ExampleRun, riccati: ByModel, least: ByModel, response: ByModel, *, start: float
) -> dict[str, float]:
    """Show the error of the vehicle's position over the assumed Q, by the margin.

    Returns the errors (cm) of the Kalman filter and of a margin's, for the matched Q and a
    hundredth of it; for the latter both gains on the position, Kalman's worst case, and the other's
    bound; for 10,000 Q the relative difference, and the Kalman filter's error over the fixes'.
    """
    y, margins, matched, small = run.ins - run.network, sorted({0.01, 0.1, 0.3, start}), 4, 2
    models = [models_of(run, factor) for factor in FACTORS]
    bounds = [least(*axis) for _, axis in models]
    error: dict[float, list[float]] = {m: [] for m in (*margins, np.inf)}  # the last is Kalman's
    for (both, axis), bound in zip(models, bounds, strict=True):
        x = run_kalman(both, y, initial_covariance=1e6 * np.eye(4))
        error[np.inf].append(float(run.distances(run.ins - x).mean()))
        for m in margins:
            gain = np.kron(riccati((1 + m) * bound, *axis), np.eye(2))
            x = run_hinfinity((both, gain), y, initial_state=y[0])
            error[m].append(float(run.distances(run.ins - x).mean()))
    shown = Moving("The vehicle", Slider("m", "margin m", margins, margins[0], "{:g}"))
    axes = {"x": "factor on Q, as a power of ten", "y": "distance (m)", "xlim": (-4.2, 4.2)}
    chart = shown.chart("Mean distance against the assumed Q", ylim=(0, 0.7), **axes)
    powers, fixes = np.log10(FACTORS), float(run.distances(run.network).mean())
    shown.draw(chart, "kalman", "Kalman", (powers, np.minimum(error[np.inf], 0.7)), at=0)
    shown.draw(chart, "network", "fixes", (powers, np.full(len(powers), fixes)), at=7)
    shown.draw(chart, "hinfinity", "H∞", lambda m: (powers, np.minimum(error[m], 0.7)), at=1)

    def said(m: float) -> str:
        return f"{100 * error[m][matched]:.1f} and {100 * error[m][small]:.1f} cm"

    shown.number("kalman", "Kalman: matched Q, and Q/100", said(np.inf))
    shown.number("hinfinity", "H∞: matched Q, and Q/100", said)
    shown.goal(
        "below 10 cm with the matched Q and with Q/100",
        lambda m: max(error[m][matched], error[m][small]) < 0.1,
    )
    shown.sentence(lambda m: (
        f"With the margin {m:g}, the H-infinity filter's error for the matched Q and for a "
        f"hundredth of it is {said(m)}; the Kalman filter's is {said(np.inf)}."
    ))  # fmt: skip
    shown.show(
        "fig-l3-vehicle",
        "With a matched Q the Kalman filter is better. With Q much too small, "
        "an H∞ filter with a small margin is better. Find a margin that is good in both cases.",
    )
    axis, bound = models[small][1], (1 + start) * bounds[small]
    kalman, gain = riccati(np.inf, *axis), riccati(bound, *axis)
    ends = error[np.inf][-1] / fixes, error[start][-1] / fixes
    found = {"kalman.gain": kalman[0, 0], "hinfinity.gain": gain[0, 0], "hinfinity.bound": bound}
    found |= {"kalman.worst": response(kalman, *axis).max(), "end": ends[0]}
    found |= {"merged": abs(ends[1] / ends[0] - 1)}
    for name, m in (("kalman", np.inf), ("hinfinity", start)):
        found[f"{name}.matched"] = 100 * error[m][matched]
        found[f"{name}.small"] = 100 * error[m][small]
    return {name: float(value) for name, value in found.items()}


def hold(
    record: ChapterRecord, *, golden: float, gamma: float, lost: Sequence[int],
    slowest: float, off: dict[str, float], margin: float,
) -> None:  # fmt: skip
    """Record what the lesson finds, and hold its sentences against that."""
    for name in ("p1", "p1-inertial"):
        record.data(f"scenarios/{name}.yaml")
    costs = {"position.exact": 2, "position.printed": 2, "position.percent": 0, "full.percent": 3}
    for name, digits in costs.items():
        record.quote("p1-lmi", f"cost.{name}", f".{digits}f")
    record.crossed("p1-lmi", "cost.position.percent")
    record.note(
        "gamma", gamma, "1", "Least gamma of one axis, position measured, by the recursion."
    )
    for name, value in off.items():
        unit = "cm" if name.endswith(("matched", "small")) else "1"
        how = "Position error" if unit == "cm" else "A number"
        record.note(name, value, unit, f"{how} of the vehicle's filters.")
    record.note("margin", margin, "1", "Margin of the vehicle's filter.")
    record.holds("The Kalman filter's error can have an energy above 3.5.", most(golden) > 3.5)
    record.holds("Nothing gets more than 2 out of the other filter.", most(1.0) < 2 + 1e-9)
    record.holds("Three steps keep every system, one loses some.", sum(n == 0 for n in lost) == 3)
    record.holds("P1's inequality rejects the Kalman filter.", slowest > 0.5**0.5)
    dearer = {q: off[f"hinfinity.{q}"] > off[f"kalman.{q}"] for q in ("matched", "small")}
    record.holds("With a matched Q the guarantee costs accuracy.", dearer["matched"])
    record.holds("With a hundredth of it the guarantee pays.", not dearer["small"])
    record.holds("The Kalman gain breaks the bound.", off["kalman.worst"] > off["hinfinity.bound"])
    record.holds("If much more drift is assumed, both filters are one.", off["merged"] < 0.01)
    record.write()


def show_gammas(record: ChapterRecord, **scene: float) -> None:
    """Show the gamma that P1 prints beside the least one of its inequality and of the exact one."""
    # none of it is there in the page
    from inswsn_book.evidence.filter_gammas import FITTED, rebuild_gammas  # noqa: PLC0415
    from inswsn_book.lessons.printed import Cell, show_printed  # noqa: PLC0415
    from inswsn_lib.papers import read_numbers  # noqa: PLC0415

    filters = read_numbers(record.data("papers/p1.yaml"))["filters"]
    noise = {"alike": "noise of the parameters", "fitted": "noise fitted to it"}

    def cell(kind: str, area: str) -> Cell:
        rebuilt, equal = (f"gamma.{kind}.{form}.{area}" for form in ("printed", "exact"))
        label = rf"$\gamma$, area {area[-1]}, {noise[kind]}"
        return Cell(label, filters[area]["gamma"], rebuilt, equal, "none")

    show_printed(
        record, "p1-lmi",
        [cell(kind, area) for kind in noise for area in filters],
        lambda: rebuild_gammas(filters, **scene),
        by=scene,
        name="tbl-l3-gammas",
        caption=r"The least $\gamma$ that P1 prints. Rebuilt: by P1's inequality. On equal terms: "
        f"by the exact one, for the same noise. The fitted noise, {FITTED[0][0]:g} in all states "
        f"and {FITTED[1][0]:g} m in measured positions alone, is one of many that give it. No "
        r"recording has a $\gamma$.",
        basis="algebra", digits=5,
    )  # fmt: skip
