"""The pictures of the lesson on errors that last, simulated and recorded, and its record."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from inswsn_book.lessons.nodes import model_of
from inswsn_book.record import ChapterRecord
from inswsn_book.show.moving import Moving, Slider
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import autocorrelation
from inswsn_lib.files import read_text
from inswsn_lib.filters import design_kalman, lasting_ratio, run_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import ExampleRun, TrainingAreas
from inswsn_lib.navigation.training_areas import p1_settings

#: What a filter finds at each sample: the state, and its covariance
Filter = Callable[[ExampleRun, float], tuple[Array, Array]]

#: What the text has of the evidence: its name, the quantity, and its form
EVIDENCE = (
    ("velocity", "room.coloured.velocity", ".2f"), ("lag", "room.lag.position", ".2f"),
    *((n, f"room.kf.starts.{of}", ".2f") for n, of in (
        ("kf", "position-least"), ("kf-most", "position-most"),
        ("kfv", "velocity-least"), ("kfv-most", "velocity-most"),
    )),
    *((n, f"outages.{n}", ".0f") for n in ("p1-ins.least", "p1-ins.most")),
    *((n, f"outages.{n}", ".1f") for n in ("restarted.least", "restarted.most")),
    ("learned", "learners.mean.lssvm", ".2f"),
    ("sure", "room.sure-gain", ".0f"),
    *((f"law.{of}", f"law.{of}", ".0f") for of in ("cases", "recordings")),
)  # fmt: skip
LABELS = {"kalman": "filter that assumes white errors", "coloured": "augmented filter"}
LASTING = (0.0, 0.2, 0.5, 1.0, 2.0, 5.0)  # s
MANY = 50  # runs
COUNTS = np.arange(1, 101)
RATIOS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)  # 2 tau over the hold time
FADING = (0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 20.0)  # s
WHITE = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
RECORDINGS = {"room": "inrol/1", "mower": "plaza/2", "robot": "labyrinth/1"}
METHODS = {
    "fixes": "loosely coupled, coloured fixes", "ranges": "tightly coupled", "smoother": "smoother",
}  # fmt: skip
BRIDGES = {
    "P1's LS-SVM": ("lssvm", "P1's LS-SVM"),
    "stand still": ("network", "stand still at the last fix"),
    "coast": ("kalman", "coasting filter"),
}


@dataclass(frozen=True)
class Table:
    """A table of a study of recordings, as its file keeps it: what is missing is None."""

    index: list[Any]
    columns: list[str]
    data: list[list[Any]]

    def of(self, column: str) -> Array:
        """Return the numbers of a column."""
        return np.array([row[self.columns.index(column)] for row in self.data], dtype=float)

    def row(self, begin: str) -> dict[str, Any]:
        """Return the row whose name begins so, by its columns."""
        (found,) = (i for i, name in enumerate(self.index) if str(name).startswith(begin))
        return dict(zip(self.columns, self.data[found], strict=True))


def recordings(**parameters: Any) -> tuple[ChapterRecord, Mapping[str, Table]]:
    """Return the record of the lesson, and what a study of recordings found."""
    record = ChapterRecord("lesson-8", parameters)
    kept = json.loads(read_text(record.data("recorded/on-recordings.json")))["tables"]
    return record, {name: Table(**each) for name, each in kept.items()}


def off(run: ExampleRun, estimate: Array) -> float:
    """Return the mean distance of the corrected positions from the true ones, cm."""
    return float(100 * run.distances(run.ins - estimate[:, :4]).mean())


def plain(run: ExampleRun, tau: float) -> tuple[Array, Array]:
    """Return what lesson 2's Kalman filter, which assumes white errors, finds; and covariances."""
    y, start = run.ins - run.network, 1e6 * np.eye(4)
    model, heard = model_of(run), np.ones((len(y), 4), bool)
    design = design_kalman(model, heard, initial_covariance=start)
    return run_kalman(model, y, initial_covariance=start), design.filtered


def deviation(count: Any, fade: float) -> Any:
    """Return the standard deviation of a mean of so many errors of size one."""
    lags = np.arange(1, np.max(count) + 1)
    return np.array([
        np.sqrt((n + 2 * np.sum(np.clip(n - lags, 0, None) * fade**lags)) / n**2)
        for n in np.atleast_1d(count)
    ])  # fmt: skip


def show_means(period: float) -> None:
    """Show the error of a mean of fixes by how many there are and how long errors last."""
    fades = {t: float(np.exp(-period / t)) if t else 0.0 for t in LASTING}
    found = {t: deviation(COUNTS, fade) for t, fade in fades.items()}
    worth = {t: float(1 / values[-1] ** 2) for t, values in found.items()}
    shown = Moving("A hundred fixes", Slider("t", "errors last", [*LASTING], 2.0, "{:g} s"))
    axes = {"x": "fixes in the mean", "y": "error", "xlim": (0, 100), "ylim": (0, 1.05)}
    chart = shown.chart("Error of the mean, one fix = 1", **axes)
    shown.draw(chart, "constant", "independent", (COUNTS, COUNTS**-0.5), at=60)
    shown.draw(chart, "coloured", "", lambda t: (COUNTS, found[t]))
    shown.number("coloured", "100 fixes are worth", lambda t: f"{worth[t]:.1f} independent ones")
    shown.sentence(
        lambda t: f"If errors last {t:g} s, 100 fixes are worth {worth[t]:.1f} independent ones."
    )
    shown.show(
        "fig-l8-means",
        "If errors last, a mean of more fixes is hardly better: all have similar errors.",
    )


def misfit(lags: Array, seen: Array, tau: float, white: float) -> float:
    """Return the mean difference of a curve that fades and an autocorrelation, without lag 0."""
    there = np.isfinite(seen) & (lags > 0)
    return float(np.abs(seen - (1 - white) * np.exp(-lags / tau))[there].mean())


def nearest(table: Table, recording: str = "room") -> tuple[float, float]:
    """Return how fast the nearest curve fades, s, and which share of it is white."""
    lags, seen = np.array(table.index, dtype=float), table.of(RECORDINGS[recording])
    _, tau, white = min((misfit(lags, seen, t, w), t, w) for t in FADING for w in WHITE)
    return tau, white


def show_recorded(table: Table) -> None:
    """Show the recorded autocorrelation of three networks' errors, and a curve to be fitted."""
    lags = np.array(table.index, dtype=float)
    seen = {name: table.of(column) for name, column in RECORDINGS.items()}
    fine = np.linspace(0, 10, 101)

    def kept(r: str) -> tuple[Array, Array]:
        there = np.isfinite(seen[r])
        return lags[there], seen[r][there]

    shown = Moving(
        "How long do recorded errors last?",
        Slider("r", "recording", [*RECORDINGS], "room", "{}"),
        Slider("t", "curve fades in", [*FADING], 0.2, "{:g} s"),
        Slider("w", "white share", [*WHITE], 0.0, "{:.0%}"),
    )
    axes = {"x": "lag (s)", "y": "correlation", "xlim": (0, 10), "ylim": (-0.5, 1.05)}
    chart = shown.chart("Autocorrelation of the errors of fixes", **axes)
    shown.draw(chart, "network", "", kept, style="points")
    shown.draw(
        chart, "coloured", "your curve", lambda t, w: (fine, (1 - w) * np.exp(-fine / t)), at=30
    )
    shown.number("coloured", "mean misfit", lambda r, t, w: f"{misfit(lags, seen[r], t, w):.3f}")
    shown.sentence(lambda r, t, w: (
        f"{r}: a curve that fades in {t:g} s, {w:.0%} white, has a mean misfit of "
        f"{misfit(lags, seen[r], t, w):.3f}."
    ))  # fmt: skip
    shown.show(
        "fig-l8-recorded",
        "Dots are recorded. Fit a curve to them: choose how fast it fades, and how much of "
        "the error is white and gone at the next fix.",
    )


def over_many(
    runs: Mapping[float, ExampleRun], knowing: Filter, seed: int
) -> dict[tuple[str, float], tuple[float, float]]:
    """Return position errors over the network's, and shares in the band (%), over `MANY` runs.

    By filter, ``"kalman"`` or ``"coloured"``, and by how long errors last. Covariances are those of
    the run that is given: they do not depend on what is measured.
    """
    found = {}
    for tau, run in runs.items():
        areas = TrainingAreas(p1_settings(), seed=seed, correlation_time=tau, runs=MANY)
        ins, network = (areas.drawn[part]["1"] for part in ("ins", "wsn"))
        model = model_of(run)
        filters: dict[str, Any] = {"kalman": (model, np.full(4, 1e6), plain)}
        if tau:
            wide = model.with_coloured_noise(tau, white=0.01)
            start = np.append(np.full(4, 1e6), 0.99 * np.repeat(run.measurement**2, 2))
            filters["coloured"] = (wide, start, knowing)
        for name, (assumed, start, by_hand) in filters.items():
            states = run_kalman(assumed, ins - network, initial_covariance=np.diag(start))
            error = (ins - states[:, :4])[:, :2]
            variances = np.diagonal(by_hand(run, tau)[1], axis1=1, axis2=2)[:, :2, None]
            sizes = [np.linalg.norm(each[:, :2], axis=1).mean() for each in (error, network)]
            share = 100 * np.mean(error**2 < 4 * variances)
            found[name, tau] = float(sizes[0] / sizes[1]), float(share)
    return found


def show_many(found: Mapping[tuple[str, float], tuple[float, float]]) -> None:
    """Show over many runs the errors of both filters and how often they are in their band."""
    lasting = [tau for name, tau in found if name == "coloured"]
    shown = Moving("Over many runs", Slider("t", "errors of fixes last", lasting, 0.2, "{:g} s"))
    axes = {"x": "errors last (s)", "xlim": (0, 5)}
    ratio = shown.chart("Error", y="fixes = 1", ylim=(0.4, 1.3), **axes)
    band = shown.chart("In its band", y="%", ylim=(0, 105), **axes)
    for at, (chart, level) in enumerate(((ratio, 1.0), (band, 95.0))):
        shown.draw(chart, "published", "", ([0.0, 5.0], [level, level]))
        for name, label in (("kalman", "assumes white"), ("coloured", "augmented")):
            there = [tau for n, tau in found if n == name]
            shown.draw(chart, name, label, (there, [found[name, tau][at] for tau in there]))

    def now(name: str, t: float) -> str:
        form = "{:.2f} of the error of fixes, {:.0f} % in its band"
        return form.format(*found[name, t])

    unnamed = dict.fromkeys(LABELS, "")
    shown.draw_each(ratio, unnamed, lambda n, t: ([t], [found[n, t][0]]), style="points")
    said = shown.number_each(LABELS, now)
    shown.sentence(lambda t: f"If errors of fixes last {t:g} s: {said(t)}.")
    shown.show(
        "fig-l8-many",
        f"{MANY} simulated runs. Beyond what correlation time does the filter that assumes white "
        "errors become worse than the fixes?",
    )


def show_left(seed: int) -> None:
    """Show what a filter leaves of the error of a fix, by formula and simulated."""
    period, holds, shape = 0.2, 2.0, (2000, 2, MANY)
    rng = np.random.default_rng(seed)
    found = {}
    for ratio in RATIOS:
        fade = float(np.exp(-period / (ratio * holds / 2)))
        model = ErrorModel(
            A=np.diag([1.0, fade]), B=np.diag(np.sqrt([period / holds, 1 - fade**2])),
            C=np.ones((1, 2)), D=np.full((1, 1), 1e-3), period=period,
        )  # fmt: skip
        states = np.einsum("ij,sjr->sir", model.B, rng.normal(size=shape))
        states[0, 1] /= np.sqrt(1 - fade**2)
        for k in range(1, len(states)):
            states[k] += model.A @ states[k - 1]
        seen = states.sum(axis=1, keepdims=True)
        off = states - run_kalman(model, seen, initial_covariance=np.diag([1e6, 1.0]))
        found[ratio] = float(np.sqrt(np.mean(off[100:, 0] ** 2)))
    fine = np.geomspace(0.05, 20, 100)
    curve = [lasting_ratio(1e-3, k / 2, 1.0) for k in fine.tolist()]
    shown = Moving("What a filter leaves", Slider("k", "2τ / hold time", [*RATIOS], 1.0, "{:g}"))
    axes = {"x": "2τ / hold time", "y": "error", "xlim": (0, 20), "ylim": (0, 1)}
    chart = shown.chart("Error of the filter, a fix = 1", **axes)
    shown.draw(chart, "coloured", "formula", (fine, curve))
    shown.draw(chart, "kalman", "simulated", ([*found], [*found.values()]), style="points")
    shown.draw(chart, "published", "", lambda k: ([k, k], [0.0, 1.0]))
    shown.number("kalman", "simulated", lambda k: f"{found[k]:.2f}")
    shown.sentence(lambda k: (
        f"If 2τ is {k:g} times the hold time, {found[k]:.2f} of the error of a fix is left."
    ))  # fmt: skip
    shown.show("fig-l8-left", "The formula, and filters in a simulation with five fixes a second.")


def show_gains(gains: Table) -> None:
    """Show what was found of filters on recordings over what was expected, a dot each."""
    rows = [dict(zip(gains.columns, row, strict=True)) for row in gains.data]
    found = {n: row for n, row in zip(gains.index, rows, strict=True) if row["hold"] is not None}
    shown = Moving("On recordings", Slider("n", "series", [*found], next(iter(found)), "{}"))
    ends = (0.0, 1.2)
    axes = {"x": "expected before it ran", "y": "found", "xlim": ends, "ylim": ends}
    chart = shown.chart("Error of a filter over that of the network", equal=True, **axes)
    shown.draw(chart, "published", "as expected", (ends, ends))
    kinds = {"kalman": "position", "coloured": "velocity"}
    for method, of in kinds.items():
        x, y = ([row[name] for row in found.values()] for name in (f"expected_{of}", of))
        shown.draw(chart, method, of, (x, y), style="points", at=int(np.argmax(y)))

    def interval(method: str, n: str) -> tuple[list[float], list[float]]:
        of, row = kinds[method], found[n]
        return [row[f"expected_{of}"]] * 2, [row[f"{of}_low"], row[f"{of}_high"]]

    def number(method: str, n: str) -> str:
        of, row = kinds[method], found[n]
        ends = f"({row[f'{of}_low']:.2f} to {row[f'{of}_high']:.2f})"
        return f"{row[f'expected_{of}']:.2f} expected, {row[of]:.2f} found {ends}"

    shown.draw_each(chart, dict.fromkeys(kinds, ""), interval)
    said = shown.number_each(kinds, number)
    shown.sentence(lambda n: f"{n}: {said(n)}.")
    shown.show(
        "fig-l8-gains",
        "Recordings, as they are and made worse. Across: what is expected before a filter runs. "
        "Upwards: what one of P1's form finds that knows how errors last; the upright lines are "
        "95 % intervals for other stretches of the same series.",
    )


def inside(run: ExampleRun, estimate: Array, covariance: Array) -> float:
    """Return which share of position errors, %, lies within two standard deviations, by axis."""
    error = (run.ins - estimate[:, :4] - run.truth)[:, :2]
    sides = 2 * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, :2])
    return float(100 * np.mean(abs(error) < sides))


def show_errors(runs: Mapping[float, ExampleRun], **filters: Filter) -> None:
    """Show errors in x of fixes and of filters, by method; of two, the bands they believe in."""
    band = len(filters) > 1
    lasting, start = [tau for tau in runs if tau or not band], 2.0 if band else 0.0
    shown = Moving("Errors in x", Slider("t", "errors of fixes last", lasting, start, "{:g} s"))
    found = {(n, t): by(runs[t], t) for n, by in filters.items() for t in lasting}
    fixes = {t: f"{off(run, run.ins - run.network):.1f} cm" for t, run in runs.items()}

    def told(n: str, t: float) -> str:
        mean = f"{off(runs[t], found[n, t][0]):.1f} cm"
        return mean + f", {inside(runs[t], *found[n, t]):.0f} % in its band" * band

    def sides(n: str, t: float) -> tuple[Array, Array, Array]:
        side = np.minimum(2 * np.sqrt(found[n, t][1][:, 0, 0]), 0.6)
        return runs[t].time, -side, side

    def error(n: str, t: float) -> tuple[Array, Array]:
        return runs[t].time, (runs[t].ins - runs[t].truth - found[n, t][0][:, :4])[:, 0]

    def of_fixes(t: float) -> tuple[Array, Array]:
        return runs[t].time, (runs[t].network - runs[t].truth)[:, 0]

    for n in filters:
        chart = shown.chart(LABELS[n].capitalize(), y="m", xlim=(0, 20), ylim=(-0.6, 0.6))
        if band:
            shown.draw(chart, n, "", partial(sides, n), style="band")
        shown.draw(chart, "network", "", of_fixes, style="points")
        shown.draw(chart, n, "", partial(error, n))
    shown.number("network", "fixes", lambda t: fixes[t])
    said = shown.number_each({n: LABELS[n] for n in filters}, told)
    shown.sentence(
        lambda t: f"Mean errors if those of fixes last {t:g} s: fixes: {fixes[t]}; {said(t)}."
    )
    said_of = "Dots are the errors of fixes; their standard deviation is the same at each setting."
    bands = " Bands are two standard deviations to either side, by each filter's covariance. "
    shown.show(
        "fig-l8-honesty" if band else "fig-l8-lasting",
        said_of + bands * band + "Errors should be inside 95 % of the time." * band,
    )


def innovations(run: ExampleRun, states: Array, tau: float) -> Array:
    """Return what each fix says beyond the prediction, from the second on, in x (m)."""
    ahead = states[:-1, :4] @ np.kron([[1, run.period], [0, 1]], np.eye(2)).T
    if states.shape[1] > 4:
        ahead = ahead + np.exp(-run.period / tau) * states[:-1, 4:]
    return np.asarray((run.ins - run.network)[1:, 0] - ahead[:, 0])


def show_innovations(runs: Mapping[float, ExampleRun], knowing: Filter) -> None:
    """Show the autocorrelation of the innovations of two filters, and the bounds of chance."""
    lasting, filters = [tau for tau in runs if tau], {"kalman": plain, "coloured": knowing}
    found = {
        (name, tau): autocorrelation(innovations(run, by(run, tau)[0], tau), range(26))
        for name, by in filters.items() for tau, run in runs.items() if tau
    }  # fmt: skip
    lags = runs[0.0].period * np.arange(26)
    chance = 2 / np.sqrt(len(runs[0.0].truth) - 1)
    shown = Moving(
        "Is anything left to predict?", Slider("t", "errors last", lasting, 0.2, "{:g} s")
    )
    axes = {"x": "lag (s)", "y": "correlation", "xlim": (0, 5), "ylim": (-0.5, 1.05)}
    chart = shown.chart("Autocorrelation of innovations in x", **axes)
    shown.draw(chart, "published", "", ([0.0, 5.0], [-chance] * 2, [chance] * 2), style="band")
    shown.draw_each(chart, dict.fromkeys(filters, ""), lambda n, t: (lags, found[n, t]))
    labels = {"kalman": "next one, assumes white", "coloured": "next one, augmented"}
    shown.number_each(labels, lambda n, t: f"{found[n, t][1]:.2f}")
    shown.sentence(lambda t: (
        f"If errors last {t:g} s, neighbouring innovations have a correlation of "
        f"{found['kalman', t][1]:.2f}; in the augmented filter, {found['coloured', t][1]:.2f}."
    ))  # fmt: skip
    shown.show(
        "fig-l8-innovations",
        "The grey band is the range expected by chance if the innovations are uncorrelated.",
    )


def overtaken(profile: Table) -> float:
    """Return how long coasting has the least error of all bridges, from the first second on, s."""
    time = np.array(profile.index, dtype=float)
    *others, coast = (profile.of(column) for _, column in BRIDGES.values())
    return float(time[np.flatnonzero((np.min(others, axis=0) < coast) & (time > 1))[0]])


def show_bridges(profile: Table) -> None:
    """Show the error as time passes without fixes, in the room."""
    time, top = np.array(profile.index, dtype=float), 5.0
    every = [round(float(t), 1) for t in np.arange(1, 10.1, 0.5)]
    labels = {method: name for name, (method, _) in BRIDGES.items()}
    errors = {method: profile.of(column) for method, column in BRIDGES.values()}
    shown = Moving("Outages", Slider("s", "time without fixes", every, 1.0, "{:g} s", plays=True))
    axes = {"x": "time without fixes (s)", "y": "m", "xlim": (0, 10), "ylim": (0, top)}
    chart = shown.chart("RMS position error (m)", **axes)
    shown.draw(chart, "published", "", lambda s: ([s, s], [0.0, top]))

    def drawn(method: str) -> tuple[Array, Array]:
        values = errors[method]
        last = int(np.argmax(values > top)) or len(values)  # as far as the chart goes
        return time[:last], values[:last]

    shown.draw_each(chart, labels, drawn)
    said = shown.number_each(labels, lambda m, s: f"{np.interp(s, time, errors[m]):.2f} m")
    shown.sentence(lambda s: f"After {s:g} s without fixes: {said(s)}.")
    shown.show(
        "fig-l8-bridges",
        "Outages in the room, emulated in one recording. Standing still at the last fix takes no "
        "computation at all.",
    )


def hold(
    record: ChapterRecord, run: ExampleRun, knowing: Filter,
    many: Mapping[tuple[str, float], tuple[float, float]], tables: Mapping[str, Table],
    lasting: float,
) -> None:  # fmt: skip
    """Record what the lesson found, and hold its sentences against it."""
    for name in ("p1", "p1-inertial"):
        record.data(f"scenarios/{name}.yaml")
    for name, of, form in EVIDENCE:
        record.quote("recorded-data", of, form, name)
    for name, of in (("lag", "room.lag.position"), ("learned", "learners.mean.lssvm")):
        ends = record.reference("recorded-data", of).interval or ()
        record.say(f"{name}.interval", " to ".join(f"{end:.2f}" for end in ends))
    kinds = ("labyrinth.odometry.error", "labyrinth.network.error")
    wheels, fixes = (record.reference("recorded-data", of).value for of in kinds)
    record.say("wheels", f"{wheels / fixes:.2f}")
    for of in ("position", "velocity"):  # of logarithms, about per cent
        record.quote("recorded-data", f"law.{of}.rms", short=f"law.{of}", unit=0.01)
    tau, white = nearest(tables["autocorrelation"])
    record.note("room.lasts", tau, "s", "How fast the nearest curve fades.", basis="recorded")
    record.note("room.white", 100 * white, "%", "Its share that is white.", basis="recorded")
    crossing = np.interp(1, [many["kalman", t][0] for t in LASTING], LASTING)
    record.note("crossing", crossing, "s", "From where on assuming white errors does harm.")
    coasting = overtaken(tables["profiles inrol/1"])
    record.note("coasting", coasting, "s", "How long coasting is best, room.", basis="recorded")
    learned = record.reference("recorded-data", "learners.mean.lssvm").interval or (0.0,)
    record.holds("A learning machine has more error than the filter that coasts.", learned[0] > 1)
    within = [
        (record.reference("recorded-data", f"learners.{place}.lssvm").interval or (0.0,))[0] > 1
        for place in ("room", "second", "walk", "car")
    ]
    record.holds("Within a recording that is sure on one of the four.", sum(within) == 1)
    machine, still, coast = (
        tables["profiles inrol/1"].of(column)[-1] for _, column in BRIDGES.values()
    )
    record.holds("After that, standing still is better.", still < min(coast, machine))
    for place, key in RECORDINGS.items():
        for name, begin in METHODS.items():
            row = tables[key].row(begin)
            told = [row[f"position_{of}"] for of in ("ratio", "low", "high")]
            record.say(f"{place}.{name}", "{:.2f} ({:.2f} to {:.2f})".format(*told))
    highest = tables["inrol/1"].row("tightly coupled")["position_high"]
    record.holds("In the room ranges do not help, either.", highest > 1)
    lost = many["kalman", 0.0][0] < 0.5 and many["kalman", 5.0][0] > 1
    record.holds("The advantage disappears.", lost)
    knows = [many["coloured", t] for t in LASTING if t]
    record.holds("The augmented filter is never worse.", max(ratio for ratio, _ in knows) < 1)
    record.holds("Its error is in its band.", all(90 < share < 99 for _, share in knows))
    record.holds("That of the other is not.", many["kalman", 2.0][1] < 70)
    shorter, right, longer = (knowing(run, lasting * f) for f in (0.1, 1, 10))
    shares = [inside(run, *found) for found in (shorter, right, longer)]
    record.holds("Too short a time is worse in the band.", shares[0] < min(shares[1:]))
    record.holds("Too long a time is less accurate.", off(run, longer[0]) > off(run, right[0]))
    record.write()
