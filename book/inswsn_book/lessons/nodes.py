"""The pictures and the record of the lesson on many clusters of nodes and one INS."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

from inswsn_book import record as book
from inswsn_book.show.moving import Moving, Slider, ellipse
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import mean_bounds, normalised_squares
from inswsn_lib.filters import federated_covariance, patterns_of, run_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import ClusterFusion, ExampleRun
from inswsn_lib.papers import read_numbers
from inswsn_lib.scenario import Setting, load_scenario

FACTORS = (1, 1.5, 2, 3, 4, 6, 8, 12, 16)
DRIFTS = (0.001, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # variance of a step over that of a fix
MOST = 12  # clusters
#: Accelerations that the filters of P2's scenario may assume, m/s^2; the first is what P2 prints
ACCELERATIONS = {"fkf": (0.017, 0.05, 0.15, 0.5, 2.0, 10.0), "dhf": (0.017, 0.15, 10.0)}
COMPONENTS = {"rx": "position in x", "ry": "position in y"}  # by their names in P2's numbers
COMPONENTS |= {"vx": "velocity in x", "vy": "velocity in y"}
_UNKNOWN = 1e6 * np.eye(4)


def model_of(run: ExampleRun, factor: float = 1.0) -> ErrorModel:
    """Return the model of a cluster's filter, with a factor on Q."""
    drift, noise = run.process * factor**0.5, run.measurement
    return ErrorModel.p1(
        run.period, process_noise=(drift[0], drift[1]), measurement_noise=(noise[0], noise[1])
    )


def locals_of(run: ExampleRun, fixes: Array, factor: float) -> tuple[Array, Array]:
    """Return what a Kalman filter in each cluster estimates, (samples, 4, clusters), and its P.

    Each takes a factor on Q.
    """
    model, y = model_of(run, factor), np.moveaxis(run.ins - fixes, 0, 2)
    found = run_kalman(model, y, initial_covariance=_UNKNOWN)
    own = federated_covariance(
        model, np.ones((len(y), 1), bool), initial_covariance=_UNKNOWN,
        measurement_covariance=model.measurement_covariance[None],
    )  # fmt: skip
    return found, own


def nees(run: ExampleRun, estimates: Array, covariances: Array) -> float:
    """Return the mean of e' P^-1 e over all samples: 4 if the covariances are right."""
    return float(normalised_squares(run.ins - run.truth - estimates, covariances).mean())


def nees_interval(run: ExampleRun, clusters: int) -> tuple[float, float]:
    """Return what 95 % of such means lie in, for the Kalman filter of the fixes of all clusters.

    Its errors last from sample to sample, so that they count as fewer.
    """
    model = model_of(run)
    R, P = model.measurement_covariance / clusters, _UNKNOWN
    for _ in range(200):
        M = model.A @ P @ model.A.T + model.B @ model.B.T
        P = M - M @ np.linalg.solve(M + R, M)
    root = np.linalg.cholesky(P)
    onward = np.linalg.solve(root, P @ np.linalg.solve(M, model.A @ root))  # (I - K) A, whitened
    lasting = sum(float(np.square(np.linalg.matrix_power(onward, k)).sum()) for k in range(1, 60))
    return mean_bounds(round(len(run.truth) * 4 / (4 + 2 * lasting)), 4)


def _count(n: int) -> str:
    return f"{n} cluster" + "s" * (n > 1)


def show_band(run: ExampleRun, fixes: Array) -> None:
    """Show the error of the fused velocity in its band, by clusters and factor."""
    numbers = [*range(1, len(fixes) + 1)]
    shown = Moving(
        "How certain the mean of many may be",
        Slider("n", "clusters", numbers, 1, "{:d}"),
        Slider("f", "factor on Q", [*FACTORS], 1, "{:g}"),
    )
    each = {f: locals_of(run, fixes, f) for f in FACTORS}
    # if independent: the mean, and its covariance
    fused = cache(lambda n, f: (each[f][0][:, :, :n].mean(axis=2), each[f][1] / n))
    off = cache(lambda n, f: (run.ins - run.truth - fused(n, f)[0])[:, 2:])
    band = cache(lambda n, f: 2 * np.sqrt(fused(n, f)[1][:, 2, 2]))  # on both axes
    square = cache(lambda n, f: nees(run, *fused(n, f)))
    fits = {n: nees_interval(run, n) for n in numbers}

    def verdict(n: int, f: float) -> str:
        low, high = fits[n]
        if square(n, f) > high:
            return "overconfident"
        return "too cautious" if square(n, f) < low else "fits"

    axes = {"x": "time (s)", "y": "error (m/s)", "xlim": (0, 20), "ylim": (-0.25, 0.25)}
    chart = shown.chart("Error of the fused velocity in x", **axes)
    shown.draw(
        chart, "independent", "", lambda n, f: (run.time, -band(n, f), band(n, f)), style="band"
    )
    shown.draw(chart, "independent", "error", lambda n, f: (run.time, off(n, f)[:, 0]))

    def inside(n: int, f: float) -> str:
        return f"{np.mean(abs(off(n, f)) < band(n, f)[:, None]):.0%} of the time"

    def consistency(n: int, f: float) -> str:
        return f"{square(n, f):.1f}, {verdict(n, f)} ({fits[n][0]:.1f} to {fits[n][1]:.1f})"

    shown.number("computed", "inside it, both axes", inside)
    shown.number("computed", "mean NEES", consistency)
    shown.goal(
        f"the claim of {numbers[-1]} clusters fits",
        lambda n, f: n == numbers[-1] and verdict(n, f) == "fits",
    )
    shown.sentence(lambda n, f: (
        f"With {_count(n)} and {f:g} times Q, the fused velocity is inside its band "
        f"{inside(n, f)}; the mean NEES is {consistency(n, f)}."
    ))  # fmt: skip
    shown.show(
        "fig-l5-band",
        "The error of the mean of all clusters, and the band of two standard "
        "deviations that it would have if the errors of the clusters were independent.",
    )


def settled(drift: float, noise: float = 1.0) -> tuple[float, float, float]:
    """Return the gain, the variance and the covariance of two clusters that follow a random walk.

    All settled, after a fix, by the variances of a step of the walk and of a fix.
    """
    M = (drift + (drift**2 + 4 * drift * noise) ** 0.5) / 2
    K = M / (M + noise)
    return K, K * noise, (1 - K) ** 2 * drift / (1 - (1 - K) ** 2)


def show_cloud(*, start: float = 0.1, points: int = 250) -> None:
    """Show the errors of two clusters of a random walk against one another, by the drift."""
    rng = np.random.default_rng(1)
    w, v, u = rng.standard_normal((3, 300, points))  # samples, runs

    @cache
    def errors(q: float) -> tuple[Array, Array]:
        K, a, b = settled(q)[0], np.zeros(points), np.zeros(points)
        for drift, one, other in zip(q**0.5 * w, v, u, strict=True):
            a, b = (1 - K) * (a + drift) - K * one, (1 - K) * (b + drift) - K * other
        return a, b

    shown = Moving(
        "Two clusters, one drift", Slider("q", "drift / noise variance", [*DRIFTS], start, "{:g}")
    )
    axes = {"x": "error of cluster A", "y": "error of cluster B", "equal": True}
    title = "Errors after a fix (unit: noise of a fix)"
    chart = shown.chart(title, xlim=(-3, 3), ylim=(-2.2, 2.2), **axes)
    shown.draw(chart, "truth", "", errors, style="points")

    def shape(q: float, share: float) -> Array:
        _, P, C = settled(q)
        return ellipse([[P, share * C], [share * C, P]])

    shown.draw(chart, "independent", "if independent", lambda q: shape(q, 0), at=0)
    shown.draw(chart, "correlated", "by the formula", lambda q: shape(q, 1), at=9)
    shown.number("computed", "gain K", lambda q: f"{settled(q)[0]:.2f}")
    correlation = {q: f"{settled(q)[2] / settled(q)[1]:.2f}" for q in DRIFTS}
    shown.number("correlated", "correlation", lambda q: correlation[q])
    shown.number("truth", "of these points", lambda q: f"{np.corrcoef(*errors(q))[0, 1]:.2f}")
    shown.sentence(lambda q: (
        f"With a drift of {q:g} times the variance of a fix, the errors of two clusters have a "
        f"correlation of {correlation[q]}."
    ))  # fmt: skip
    shown.show(
        "fig-l5-cloud",
        "Each point is a run: the error of one cluster against that of the other. The "
        "less the INS drifts, the longer the filters remember, and the more similar their errors.",
    )


def _by_clusters(
    title: str, what: str, slider: Slider, top: float,
    curves: Mapping[str, tuple[str, Callable[[float, int], float]]],
) -> Moving:  # fmt: skip
    """Return a figure of some sizes over the number of clusters, by a slider named q.

    By their methods, each has a label and a function of q and of the number; the first is what is
    claimed, and the second what is true of it.
    """
    numbers = [*range(1, MOST + 1)]
    shown = Moving(title, slider, Slider("n", "clusters", numbers, 3, "{:d}"))
    chart = shown.chart(what, x="clusters", y="size", xlim=(1, MOST), ylim=(0, top))
    labels = {method: label for method, (label, _) in curves.items()}
    short = {method: label.partition(": ")[2] for method, label in labels.items()}

    def curve(method: str, q: float) -> tuple[list[int], list[float]]:
        return numbers, [curves[method][1](q, n) for n in numbers]

    shown.draw_each(chart, short, curve)
    said = shown.number_each(labels, lambda m, q, n: f"{curves[m][1](q, n):.2f}")
    (_, claimed), (_, true), *_ = curves.values()
    shown.draw(chart, "truth", "", lambda q, n: ([n, n], [claimed(q, n), true(q, n)]))
    shown.sentence(lambda q, n: f"{_count(n)}, {slider.label} {q:g}: {said(q, n)}.")
    return shown


def show_many(*, start: float = 1.0) -> None:
    """Show what the mean of many clusters is sure of, and what it is off by, by the drift."""

    def true(q: float, n: int) -> float:
        _, P, C = settled(q)
        return float(((P + (n - 1) * C) / n) ** 0.5)

    _by_clusters(
        "More clusters, the same drift", "Size of the error (unit: noise of a fix)",
        Slider("q", "drift / noise variance", [*DRIFTS], start, "{:g}"), 1.0,
        {
            "independent": ("mean: claimed", lambda q, n: (settled(q)[1] / n) ** 0.5),
            "correlated": ("mean: true", true),
            "kalman": ("one filter: all fixes", lambda q, n: settled(q, 1 / n)[1] ** 0.5),
        },
    ).show(
        "fig-l5-many",
        "The claimed error falls with the square root of the number of clusters. The true "
        "error levels off at what the clusters have in common.",
    )  # fmt: skip


def with_factor(f: float, n: int, drift: float, *, reset: bool) -> tuple[float, float]:
    """Return what the fusion of n clusters is sure of and what it is off by, settled.

    Each takes f times the drift; with reset each goes on from f times the fused variance.
    """
    if reset:  # 1/P = n / (f (P + drift)) + n, with fixes of variance 1
        a, b, c = n, n / f + n * drift - 1, -drift
        says = (-b + (b**2 - 4 * a * c) ** 0.5) / (2 * a)
        K = n * says
    else:
        K, P, _ = settled(f * drift)
        says = P / n
    true = ((1 - K) ** 2 * drift + K**2 / n) / (1 - (1 - K) ** 2)
    return says**0.5, true**0.5


def show_factor(*, drift: float = 0.1) -> None:
    """Show what a fusion is sure of and is off by over the factor that each cluster takes."""
    f, counts = np.linspace(1, 12, 111), [2, 3, 5, 8]
    shown = Moving(
        "The factor that makes the claim true",
        Slider("f", "factor on Q and P", [*range(1, 13)], 1, "{:d}"),
        Slider("n", "clusters", counts, 3, "{:d}"),
        Slider("r", "reset", ["none", "each step"], "each step", "{}"),
    )

    found = cache(lambda f, n, r: with_factor(f, n, drift, reset=r != "none"))
    curves = cache(lambda n, r: np.array([found(one, n, r) for one in f]).T)
    axes = {"x": "factor", "y": "error", "xlim": (1, 12), "ylim": (0, 0.7)}
    chart = shown.chart("Size of the fused error (unit: noise of a fix)", **axes)
    labels = {"independent": "claimed", "federated": "true"}
    row = {method: i for i, method in enumerate(labels)}
    shown.draw_each(chart, labels, lambda m, n, r: (f, curves(n, r)[row[m]]))

    def below(n: int, r: str) -> tuple[Array, Array, Array]:
        says, true = curves(n, r)
        return f, np.minimum(says, true), true

    def verdict(f: int, n: int, r: str) -> str:
        says, true = found(f, n, r)
        if says < true * (1 - 1e-9):
            return f"overconfident: {true / says:.1f} times what it claims"
        return "right" if says < true * (1 + 1e-9) else "too cautious"

    shown.draw(chart, "independent", "", below, style="band")
    shown.draw(chart, "truth", "", lambda f, n, r: ([f, f], found(f, n, r)))
    least = {n: settled(drift, 1 / n)[1] ** 0.5 for n in counts}
    shown.number("computed", "the claim is", verdict)
    said = shown.number_each(labels, lambda m, f, n, r: f"{found(f, n, r)[row[m]]:.3f}")
    shown.number("computed", "one filter, all fixes", lambda n: f"{least[n]:.3f}")
    shown.goal("the claim is right", lambda f, n, r: verdict(f, n, r) == "right")
    shown.sentence(lambda f, n, r: (
        f"{n} clusters, factor {f}, reset: {r}. Errors: {said(f, n, r)}; one filter of all fixes: "
        f"{least[n]:.3f}."
    ))  # fmt: skip
    shown.show(
        "fig-l5-factor",
        f"Drift {drift:g}. In the band the fusion is overconfident. The two curves cross "
        "where the true error is smallest.",
    )


def show_weights() -> None:
    """Show the joint error of two clusters, and the size of their blend over the weight of one."""
    shown = Moving(
        "Weights for correlated errors",
        Slider("r", "correlation", [round(0.1 * k, 1) for k in range(9)], 0.5, "{:g}"),
        Slider("s", "error of B over that of A", [1.0, 1.25, 1.5, 2.0], 1.5, "{:g}"),
    )
    axes: dict[str, Any] = {"x": "error of A", "y": "error of B", "xlim": (-3, 3), "ylim": (-2, 2)}
    joint = shown.chart("Joint error", equal=True, **axes)
    shown.draw(joint, "independent", "", lambda s: ellipse([[1, 0], [0, s**2]], 1))
    shown.draw(joint, "correlated", "", lambda r, s: ellipse([[1, r * s], [r * s, s**2]], 1))
    m = np.linspace(0, 1.5, 76)

    def size(m: Any, r: float, s: float) -> Any:
        return (m**2 + (1 - m) ** 2 * s**2 + 2 * m * (1 - m) * r * s) ** 0.5

    def best(r: float, s: float) -> float:
        return (s**2 - r * s) / (1 + s**2 - 2 * r * s)

    def least(r: float, s: float) -> tuple[list[float], list[float]]:
        return [best(r, s)], [size(best(r, s), r, s)]

    axes = {"x": "weight of A", "y": "error", "xlim": (0, 1.5), "ylim": (0.4, 2.1)}
    chart = shown.chart("Size of the blended error", **axes)
    shown.draw(chart, "independent", "claimed", lambda s: (m, size(m, 0, s)))
    shown.draw(chart, "correlated", "true", lambda r, s: (m, size(m, r, s)))
    shown.draw(chart, "correlated", "", least, style="points")
    shown.number("computed", "if independent, weight of A", lambda s: f"{best(0, s):.2f}")
    claims = cache(lambda r, s: f"{size(best(0, s), 0, s):.2f}, {size(best(0, s), r, s):.2f}")
    shown.number("computed", "its error: claimed, true", claims)
    found = cache(lambda r, s: f"{best(r, s):.2f}, {size(best(r, s), r, s):.2f}")
    shown.number("correlated", "best weight of A, its error", found)
    shown.goal("B is subtracted", lambda r, s: best(r, s) > 1)
    shown.sentence(lambda r, s: (
        f"Correlation {r:g}, error of B {s:g} times that of A: the best weight of A and the "
        f"blended error are {found(r, s)}. As if independent, the weight is {best(0, s):.2f}; the "
        f"claimed error and the true one are {claims(r, s)}."
    ))  # fmt: skip
    shown.show(
        "fig-l5-weights", "The dot is the best weight. Left of 1, both weights are positive."
    )


def show_promise() -> None:
    """Show the worst-case gain that P2's inequality promises and the true one, over clusters."""
    _by_clusters(
        "A promise that improves with every cluster", "Worst-case gain of the fusion",
        Slider("q", "noise of a fix / drift", [0.5, 1.0, 2.0, 4.0], 1.0, "{:g}"), 4.2,
        {
            "independent": ("gain: promised", lambda q, n: ((1 + q**2) / n) ** 0.5),
            "distributed": ("gain: true", lambda q, n: (1 + q**2 / n) ** 0.5),
        },
    ).show(
        "fig-l5-promise",
        "Identical clusters, each with a filter of gain 1. The promise keeps falling; "
        "the true gain levels off at 1, which is due to the drift.",
    )  # fmt: skip


def show_reductions(
    scene: ClusterFusion, printed: Mapping[str, Mapping[str, str]]
) -> dict[tuple[str, float], Array]:
    """Show by how much P2's filter is better than a federated one, by what each assumes.

    Returns
    -------
    dict
        Mean absolute errors in `COMPONENTS`, (4,), median over the runs: of "ins" at 0, and of
        "fkf" and "dhf" at each of `ACCELERATIONS`.
    """
    y, ins = scene.measurements, scene.drawn["ins"]
    sets = patterns_of(y)

    def size(error: Array) -> Array:
        return np.asarray(np.median(abs(error).mean(axis=0), axis=1))

    off = {("ins", 0.0): size(ins)}
    for a in ACCELERATIONS["fkf"]:
        off["fkf", a] = size(ins - scene.federated(a, 1.0)(y))
    for a in ACCELERATIONS["dhf"]:
        off["dhf", a] = size(ins - scene.distributed(a, 1.0, 1.0, for_sets=sets)(y))
    first = ACCELERATIONS["dhf"][0]

    def less(f: float, d: float) -> Array:
        return 100 * (1 - off["dhf", d] / off["fkf", f])

    shown = Moving(
        "Choose your rival",
        Slider("f", "federated assumes", [*ACCELERATIONS["fkf"]], first, "{:g} m/s²"),
        Slider("d", "distributed assumes", [*ACCELERATIONS["dhf"]], first, "{:g} m/s²"),
    )
    axes: dict[str, Any] = {"x": "1, 2: position; 3, 4: velocity", "y": "%", "xlim": (0.4, 4.6)}
    chart = shown.chart("Reduction of the federated filter's error", ylim=(-200, 100), **axes)
    places = np.arange(1.0, 5.0)

    def bars(f: float, d: float) -> tuple[Array, Array]:
        return places, less(f, d).clip(-200)

    shown.draw(chart, "distributed", "here", bars, style="bars", at=0)
    for place, name in zip(places, COMPONENTS, strict=True):
        told = float(printed[name]["vs_fkf"])
        label = "P2" if place == places[-1] else ""
        ends = [place - 0.45, place + 0.45]
        shown.draw(chart, "published", label, (ends, [told, told]), at=0)

    def words(f: float, d: float, part: slice) -> str:
        return " and ".join(f"{value:.0f} %" for value in less(f, d)[part])

    shown.number("computed", "position, x and y", lambda f, d: words(f, d, slice(0, 2)))
    shown.number("computed", "velocity, x and y", lambda f, d: words(f, d, slice(2, 4)))
    shown.sentence(lambda f, d: (
        f"With {f:g} m/s² in the federated and {d:g} m/s² in the distributed filter, the latter "
        f"reduces position errors by {words(f, d, slice(0, 2))} and velocity errors by "
        f"{words(f, d, slice(2, 4))}."
    ))  # fmt: skip
    shown.show(
        "fig-l5-reductions",
        "Bars: P2's scenario, simulated here; below 0, the federated filter is better. "
        "Dashes: the numbers that P2 prints.",
    )
    return off


def show_percentages(record: book.ChapterRecord, printed: Any, fusion: ClusterFusion) -> None:
    """Show P2's percentages beside what a scene gives for them."""
    # what shows tables is not there in the page
    from inswsn_book.evidence.fusion_percentages import (  # noqa: PLC0415
        FirstReading,
        rebuild_percentages,
    )
    from inswsn_book.lessons.printed import Cell, show_printed  # noqa: PLC0415

    results = {**printed["results"]}
    for part in ("position", "velocity"):
        results[part] = {"vs_fkf": printed["abstract"][f"{part}_vs_fkf"]}
    labels = COMPONENTS | {part: f"{part}, mean of x and y" for part in ("position", "velocity")}
    rivals = {"vs_ins": "the INS", "vs_fkf": "FKF"}

    def cell(part: str, rival: str, text: str) -> Cell:
        name = f"{part}.{rival.replace('_', '-')}"
        label = f"{labels[part]}, against {rivals[rival]}"
        return Cell(label, text, f"percent.{name}", f"fair.cells.{name}", "none")

    show_printed(
        record, "p2-fusion",
        [cell(part, rival, text) for part, row in results.items() for rival, text in row.items()],
        lambda: rebuild_percentages(FirstReading(fusion)),
        by=("seed", "range_noise", "correlation_time", "accelerometer_bias", "speed"),
        name="tbl-l5-p2",
        caption="Error reduction by P2's distributed filter against the INS and against the "
        "federated filter (FKF), %, medians and 95 % of runs; below 0, it increases the error. The "
        "last two are from P2's abstract. Rebuilt: both filters assume the noise that P2 prints. "
        "On equal terms: both tuned alike. Recorded: none; of two recorded clusters the fixes were "
        "fused, but neither P2's filter nor an INS alone was run.",
    )  # fmt: skip


def read_p2(parameters: dict[str, float]) -> tuple[book.ChapterRecord, Any, dict[str, Setting]]:
    """Return the record of the lesson, and the numbers and the scene of P2."""
    record = book.ChapterRecord("lesson-5", {**parameters})
    for name in ("p1", "p1-inertial"):
        record.data(f"scenarios/{name}.yaml")
    printed = read_numbers(record.data("papers/p2.yaml"))
    return record, printed, load_scenario(record.data("scenarios/p2.yaml"))


def hold(
    record: book.ChapterRecord, printed: Any, run: ExampleRun, fixes: Array,
    square: Mapping[tuple[bool, int], float], agreement: float, naive: tuple[Array, Array],
    off: Mapping[tuple[str, float], Array], weights: Mapping[str, Array],
) -> None:  # fmt: skip
    """Note the numbers of the text, hold its sentences against them, and write the record."""
    clusters, (K, _, C) = len(fixes), settled(1.0)
    estimate, P = naive  # with a reset and without the factor
    low, high = nees_interval(run, clusters)
    ins, fkf = (100 - float(printed["results"]["vx"][rival]) for rival in ("vs_ins", "vs_fkf"))
    record.note("implied.vx", ins / fkf, "1", "Federated over INS, of P2's cells.")
    for name in ("position", "velocity"):
        record.say(f"p2.{name}", printed["abstract"][f"{name}_vs_fkf"])
        record.crossed("p2-fusion", f"fair.dhf-over-fkf.{name}", ".2f")
        record.quote("p2-fusion", f"fair.dhf-over-fkf.{name}", ".4f", f"fair.{name}")
    for name in ("theorem.free-scene", "theorem.true-scene", "search.pairings"):
        record.quote("p2-fusion", name, ".4f")
    back, alone = with_factor(1, 3, 0.1, reset=True)[1], settled(0.1)[1] ** 0.5
    record.note("reset.naive", back, "1", "Size of the error, three clusters, drift 0.1.")
    record.note("alone", alone, "1", "The same, one cluster.")
    record.note("intersection", square[False, 1] / clusters, "1", "NEES, mean and P.")
    for noise, each in weights.items():
        record.note(f"weight.{noise}", each.max(), "1", "Of the best cluster, by the LMI.")
    true, fix = run.distances(run.ins - estimate).mean(), run.distances(fixes[0]).mean()
    for name, value in (("believed", P[-1][:2, :2].trace() ** 0.5), ("fix", fix), ("true", true)):
        record.note(f"back.{name}", 100 * value, "cm", "Position, reset without the factor.")
    level = {a: off["dhf", a] / off["fkf", a] for a in ACCELERATIONS["dhf"]}
    for sentence, holds in {
        "Without the factor it is too sure.": square[False, 1] > high,
        "With it the NEES fits.": all(low < square[r, clusters] < high for r in (False, True)),
        "Back and without it, worse than before.": square[True, 1] > square[False, 1],
        "It is worse than a fix.": true > fix,
        "Intersection is too cautious.": square[False, 1] / clusters < low,
        "The clusters agree too well.": agreement < 4,
        "At 0.017 it wins in position.": (level[0.017][:2] < 1).all(),
        "And loses in velocity.": (level[0.017][2:] > 1).all(),
        "At 0.15 the federated one wins everywhere.": (off["dhf", 0.017] > off["fkf", 0.15]).all(),
        "Both at 0.15 it is ahead in position.": (level[0.15][:2] < 1).all(),
        "At 10 they differ by less than a tenth.": (abs(1 - level[10.0]) < 0.1).all(),
        "By P2's cells the federated one is worse than the INS.": ins > fkf,
        "Here it is better than that.": (off["fkf", 0.017] < off["ins", 0]).all(),
        "Three are worse than one.": back > alone,
        "By hand: 0.618, 0.171, 0.28.": f"{K:.3f} {C:.3f} {C / K:.2f}" == "0.618 0.171 0.28",
    }.items():
        record.holds(sentence, holds)
    record.write()
