"""The pictures of the lesson on many clusters of nodes and one INS."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inswsn_book.lessons.blend import nis_interval
from inswsn_book.moving import Moving, Slider
from inswsn_lib.evaluation import normalised_squares
from inswsn_lib.filters import federated_covariance, patterns_of, run_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation import ClusterFusion, ExampleRun

Array = NDArray[np.float64]
Point = tuple[float, float]

FACTORS = (1, 1.5, 2, 3, 4, 6, 8, 12, 16)
DRIFTS = (0.001, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # variance of a step over that of a fix
MOST = 12  # clusters
#: Accelerations that the filters of P2's scene may assume, m/s^2; the first is what P2 prints
ACCELERATIONS = {"fkf": (0.017, 0.05, 0.15, 0.5, 2.0, 10.0), "dhf": (0.017, 0.15, 10.0)}
COMPONENTS = ("rx", "ry", "vx", "vy")
_UNKNOWN = 1e6 * np.eye(4)


def model_of(run: ExampleRun, factor: float = 1.0) -> ErrorModel:
    """Return the model of a cluster's filter, with a factor on Q."""
    drift, noise = run.process * factor**0.5, run.measurement
    return ErrorModel.p1(
        run.period,
        process_noise=(drift[0], drift[1]),
        measurement_noise=(noise[0], noise[1]),
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
    return nis_interval(round(len(run.truth) * 4 / (4 + 2 * lasting)))


def _count(n: int) -> str:
    return f"{n} cluster" + "s" * (n > 1)


def show_band(run: ExampleRun, fixes: Array) -> None:
    """Show the error of the fused velocity in its band, by clusters and factor."""
    numbers = [*range(1, len(fixes) + 1)]
    shown = Moving(
        "How sure may many be?",
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

    def light(n: int, f: float) -> str:
        low, high = fits[n]
        return (
            "too sure" if square(n, f) > high else "too cautious" if square(n, f) < low else "fits"
        )

    chart = shown.chart(
        "Error of the fused velocity in x", x="time (s)", y="error (m/s)", xlim=(0, 20),
        ylim=(-0.25, 0.25),
    )  # fmt: skip
    shown.draw(
        chart, "independent", "", lambda n, f: (run.time, -band(n, f), band(n, f)), style="band"
    )
    shown.draw(chart, "independent", "error", lambda n, f: (run.time, off(n, f)[:, 0]))

    def sure(n: int, f: float) -> str:
        return f"± {100 * band(n, f)[-1]:.1f} cm/s"

    def inside(n: int, f: float) -> str:
        return f"{np.mean(abs(off(n, f)) < band(n, f)[:, None]):.0%} of the time"

    def normalised(n: int, f: float) -> str:
        return f"{square(n, f):.1f} (fits: {fits[n][0]:.1f} to {fits[n][1]:.1f})"

    shown.number("independent", "sure to, at the end", sure)
    shown.number("independent", "inside, both axes", inside)
    shown.number("independent", "normalised square", normalised)
    shown.number("independent", "the light says", light)
    shown.sentence(
        lambda n, f: (
            f"With {_count(n)} and {f:g} times Q the fused velocity is inside its band for "
            f"{inside(n, f)}; the mean normalised square is {square(n, f):.1f}: {light(n, f)}."
        )
    )
    shown.show(
        name="fig-l5-band",
        caption="The mean of all clusters, and the band of two standard deviations that it has if "
        "their errors have nothing to do with one another.",
        alt="The error of the velocity in x over 20 seconds in a band. With one cluster it is "
        f"inside for {inside(1, 1)}; with {numbers[-1]} clusters, taken as independent, for "
        f"{inside(numbers[-1], 1)}.",
    )


#: Who sends what: what the clusters send, what the centre does, what goes back, and its drawing
SCHEMES = {
    "all fixes": ("fixes", "one Kalman filter", "nothing", "kalman"),
    "as if independent": ("x̂, P", "adds up 1/P", "nothing", "independent"),
    "federated": ("x̂, P, made with N Q", "adds up 1/P", "nothing", "federated"),
    "with reset": ("x̂, P, made with N Q", "adds up 1/P", "fused x̂, N P", "federated"),
}


def show_flow() -> None:
    """Show the nodes of P2's scene, the heads of its clusters, and what goes to whom."""
    shown = Moving(
        "Who sends what to whom",
        Slider("s", "scheme", [*SCHEMES], "as if independent", "{}"),
    )
    chart = shown.chart(
        "Three clusters and one INS", x="x (m)", y="y (m)", xlim=(-6, 70), ylim=(-4, 56), equal=True
    )
    boxes = {"A": (0, 28, 0, 14), "B": (35, 63, 0, 14), "C": (0, 63, 21, 42)}
    every = [
        (x, y)
        for left, right, low, high in boxes.values()
        for x in range(left, right + 1, 7)
        for y in range(low, high + 1, 7)
    ]
    shown.draw(chart, "network", "", np.transpose(every), style="points")
    vehicle, centre = (31.5, 5.0), (31.5, 51.0)
    heads: dict[str, Point] = {"A": (14, 10.5), "B": (49, 10.5), "C": (31.5, 31.5)}

    def between(one: Point, other: Point, aside: float = 0.0) -> tuple[list[float], list[float]]:
        return [one[0], other[0]], [one[1] + aside, other[1] + aside]

    def sent(head: Point, method: str) -> Callable[[str], Any]:
        return lambda s: between(head, centre if SCHEMES[s][3] == method else head)

    def back(head: Point) -> Callable[[str], Any]:
        return lambda s: between(centre, head if s == "with reset" else centre, 1.5)

    def told(place: int) -> Callable[[str], str]:
        return lambda s: SCHEMES[s][place]

    for name, head in heads.items():
        shown.draw(chart, "ins", "INS" if name == "A" else "", between(vehicle, head), at=0)
        for method in ("kalman", "independent", "federated"):
            shown.draw(chart, method, "", sent(head, method))
        shown.draw(chart, "federated", "", back(head))
        shown.draw(chart, "truth", name, ([head[0]], [head[1]]), style="points", at=0)
    shown.draw(chart, "truth", "centre", ([centre[0]], [centre[1]]), style="points", at=0)
    for place, label in enumerate(("each cluster sends", "the centre", "goes back")):
        shown.number("truth", label, told(place))
    shown.sentence(
        lambda s: (
            f"{s.capitalize()}: each cluster sends {SCHEMES[s][0]}. The centre: {SCHEMES[s][1]}. "
            f"What goes back: {SCHEMES[s][2]}."
        )
    )
    shown.show(
        name="fig-l5-flow",
        caption="Clusters A, B and C of nodes, with a head each. The INS of the vehicle goes to "
        "all heads: that is what their filters share.",
        alt="A map of nodes in three clusters. Lines lead from the INS of the vehicle to the head "
        "of each cluster, and from each head to a centre.",
    )


def settled(drift: float, noise: float = 1.0) -> tuple[float, float, float]:
    """Return the gain, the variance and the covariance of two clusters that follow a random walk.

    All settled, after a fix, by the variances of a step of the walk and of a fix.
    """
    M = (drift + (drift**2 + 4 * drift * noise) ** 0.5) / 2
    K = M / (M + noise)
    return K, K * noise, (1 - K) ** 2 * drift / (1 - (1 - K) ** 2)


def _ellipse(covariance: Any, sigmas: float = 2.0) -> tuple[Array, Array]:
    angle = np.linspace(0, 2 * np.pi, 73)
    x, y = sigmas * np.linalg.cholesky(covariance) @ [np.cos(angle), np.sin(angle)]
    return x, y


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
        "Two clusters, one drift", Slider("q", "drift / noise of a fix", [*DRIFTS], start, "{:g}")
    )
    chart = shown.chart(
        "Errors after each fix (1 = noise of a fix)",
        x="error of cluster A", y="error of cluster B", xlim=(-3, 3), ylim=(-2.2, 2.2), equal=True,
    )  # fmt: skip
    shown.draw(chart, "truth", "", errors, style="points")

    def shape(q: float, share: float) -> tuple[Array, Array]:
        _, P, C = settled(q)
        return _ellipse([[P, share * C], [share * C, P]])

    shown.draw(chart, "independent", "if independent", lambda q: shape(q, 0), at=63)
    shown.draw(chart, "correlated", "by the formula", lambda q: shape(q, 1), at=9)
    shown.number("correlated", "gain K", lambda q: f"{settled(q)[0]:.2f}")
    shown.number("correlated", "correlation", lambda q: f"{settled(q)[2] / settled(q)[1]:.2f}")
    shown.number("truth", "of these points", lambda q: f"{np.corrcoef(*errors(q))[0, 1]:.2f}")
    shown.sentence(
        lambda q: (
            f"With a drift of {q:g} times the variance of a fix the errors of two clusters have "
            f"the correlation {settled(q)[2] / settled(q)[1]:.2f}."
        )
    )
    shown.show(
        name="fig-l5-cloud",
        caption="Each point is a run: the error of one cluster against that of the other. The "
        "less the INS drifts, the longer the filters remember, and the more alike they err.",
        alt="A cloud of points along a rising ellipse. With a drift of "
        f"{start:g} the correlation is {settled(start)[2] / settled(start)[1]:.2f}.",
    )


def show_many(*, start: float = 1.0) -> None:
    """Show what the mean of many clusters is sure of, and what it is off by, by the drift."""
    numbers = np.arange(1, MOST + 1)
    shown = Moving(
        "More clusters, the same drift",
        Slider("q", "drift / noise of a fix", [*DRIFTS], start, "{:g}"),
        Slider("n", "clusters", [*range(1, MOST + 1)], 3, "{:d}"),
    )

    def says(q: float, n: Any) -> Any:
        return (settled(q)[1] / n) ** 0.5

    def true(q: float, n: Any) -> Any:
        _, P, C = settled(q)
        return ((P + (n - 1) * C) / n) ** 0.5

    @cache
    def least(q: float, n: int) -> float:
        return float(settled(q, 1 / n)[1] ** 0.5)

    chart = shown.chart(
        "Size of the error (1 = noise of a fix)", x="clusters", y="deviation", xlim=(1, MOST),
        ylim=(0, 1),
    )  # fmt: skip
    shown.draw(chart, "independent", "believed", lambda q: (numbers, says(q, numbers)))
    shown.draw(chart, "correlated", "true", lambda q: (numbers, true(q, numbers)))
    shown.draw(
        chart, "kalman", "all fixes", lambda q: (numbers, [least(q, int(n)) for n in numbers])
    )
    for method, of in (("independent", says), ("correlated", true)):
        shown.draw(chart, method, "", _at(of), style="points")
    shown.number("independent", "mean, believed", lambda q, n: f"{says(q, n):.2f}")
    shown.number("correlated", "mean, true", lambda q, n: f"{true(q, n):.2f}")
    shown.number("kalman", "one filter, all fixes", lambda q, n: f"{least(q, n):.2f}")
    shown.sentence(
        lambda q, n: (
            f"{_count(n)}, drift {q:g}: the mean is believed to be off by {says(q, n):.2f} and is "
            f"off by {true(q, n):.2f}; one filter of all fixes by {least(q, n):.2f}."
        )
    )
    shown.show(
        name="fig-l5-many",
        caption="Believed: one over the root of the number. True: it stops at what the clusters "
        "have in common.",
        alt=f"Three curves over the number of clusters, drift {start:g}. With {MOST} the mean is "
        f"believed to be off by {says(start, MOST):.2f}, is off by {true(start, MOST):.2f}, and "
        f"one filter of all fixes by {least(start, MOST):.2f}.",
    )


def _at(of: Callable[[float, Any], Any]) -> Callable[..., Any]:
    return lambda q, n: ([n], [of(q, n)])


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
    f = np.linspace(1, 12, 111)
    shown = Moving(
        "The factor that makes it honest",
        Slider("f", "factor on Q and P", [*range(1, 13)], 1, "{:d}"),
        Slider("n", "clusters", [2, 3, 4, 6, 8], 3, "{:d}"),
        Slider("r", "reset", ["none", "each step"], "each step", "{}"),
    )

    @cache
    def found(f: float, n: int, r: str) -> tuple[float, float]:
        return with_factor(f, n, drift, reset=r != "none")

    curves = cache(lambda n, r: np.array([found(one, n, r) for one in f]).T)
    chart = shown.chart(
        "Size of the fused error (1 = noise of a fix)", x="factor", y="deviation", xlim=(1, 12),
        ylim=(0, 0.7),
    )  # fmt: skip
    shown.draw(chart, "independent", "believed", lambda n, r: (f, curves(n, r)[0]))
    shown.draw(chart, "federated", "true", lambda n, r: (f, curves(n, r)[1]))

    def here(place: int) -> Callable[..., Any]:
        return lambda f, n, r: ([f], [found(f, n, r)[place]])

    shown.draw(chart, "independent", "", here(0), style="points")
    shown.draw(chart, "federated", "", here(1), style="points")
    least = {n: settled(drift, 1 / n)[1] ** 0.5 for n in (2, 3, 4, 6, 8)}
    shown.number("independent", "believed", lambda f, n, r: f"{found(f, n, r)[0]:.3f}")
    shown.number("federated", "true", lambda f, n, r: f"{found(f, n, r)[1]:.3f}")
    shown.number("kalman", "one filter, all fixes", lambda n: f"{least[n]:.3f}")
    shown.sentence(
        lambda f, n, r: (
            f"{n} clusters, factor {f}, reset {r}: believed "
            f"{found(f, n, r)[0]:.3f}, true "
            f"{found(f, n, r)[1]:.3f}; one filter of all fixes {least[n]:.3f}."
        )
    )
    says, true = with_factor(1, 3, drift, reset=True)
    shown.show(
        name="fig-l5-factor",
        caption=f"Drift {drift:g}. The curves cross at the lowest point of one of them.",
        alt=f"Two curves over the factor, three clusters with reset. At 1 the fusion believes "
        f"{says:.2f} and is off by {true:.2f}; at 3 both are {least[3]:.2f}.",
    )


def show_weights() -> None:
    """Show the joint error of two clusters, and the size of their blend over the weight of one."""
    correlations = [round(0.1 * k, 1) for k in range(9)]
    sizes = [1.0, 1.25, 1.5, 2.0, 2.5]
    shown = Moving(
        "Weights for errors that go together",
        Slider("r", "correlation", correlations, 0.5, "{:g}"),
        Slider("s", "B is off by", sizes, 1.5, "{:g} × A"),
    )
    joint = shown.chart(
        "Joint error", x="error of A", y="error of B", xlim=(-3, 3), ylim=(-3, 3), equal=True
    )
    shown.draw(joint, "independent", "", lambda s: _ellipse([[1, 0], [0, s**2]], 1))
    shown.draw(joint, "correlated", "", lambda r, s: _ellipse([[1, r * s], [r * s, s**2]], 1))
    m = np.linspace(0, 1.5, 76)

    def size(m: Any, r: float, s: float) -> Any:
        return (m**2 + (1 - m) ** 2 * s**2 + 2 * m * (1 - m) * r * s) ** 0.5

    def best(r: float, s: float) -> float:
        return (s**2 - r * s) / (1 + s**2 - 2 * r * s)

    chart = shown.chart(
        "Size of the blend", x="weight of A", y="off by", xlim=(0, 1.5), ylim=(0.4, 1.6)
    )

    def curve(r: float, s: float) -> tuple[Array, Array]:
        seen = size(m, r, s) <= 1.6
        return m[seen], size(m, r, s)[seen]

    shown.draw(chart, "independent", "believed", lambda s: curve(0, s), at=0)
    shown.draw(chart, "correlated", "true", curve)
    shown.draw(
        chart, "independent", "", lambda s: ([best(0, s)], [size(best(0, s), 0, s)]), style="points"
    )
    shown.draw(
        chart, "independent", "", lambda r, s: ([best(0, s)], [size(best(0, s), r, s)]),
        style="points",
    )  # fmt: skip
    shown.draw(
        chart, "correlated", "", lambda r, s: ([best(r, s)], [size(best(r, s), r, s)]),
        style="points",
    )  # fmt: skip
    shown.number("independent", "weight of A, if independent", lambda s: f"{best(0, s):.2f}")
    shown.number(
        "independent",
        "believed, and true",
        lambda r, s: f"{size(best(0, s), 0, s):.2f}, {size(best(0, s), r, s):.2f}",
    )
    shown.number("correlated", "best weight of A", lambda r, s: f"{best(r, s):.2f}")
    shown.number("correlated", "off by", lambda r, s: f"{size(best(r, s), r, s):.2f}")
    shown.sentence(
        lambda r, s: (
            f"Correlation {r:g}, B off by {s:g} times as much as A: the best weight of A is "
            f"{best(r, s):.2f}, and the blend is off by {size(best(r, s), r, s):.2f}."
        )
    )
    shown.show(
        name="fig-l5-weights",
        caption="Left of 1 both clusters have a share. Drag the correlation until the weight of A "
        "passes 1: then B is subtracted.",
        alt="An ellipse of the joint error of two clusters, and the size of their blend over the "
        f"weight of A, least at {best(0.5, 1.5):.2f}; at {best(0, 1.5):.2f} if the "
        "errors were independent.",
    )


def show_promise() -> None:
    """Show the worst-case gain that P2's inequality promises and the true one, over clusters."""
    numbers = np.arange(1, MOST + 1)
    noises = (0.25, 0.5, 1.0, 2.0, 4.0)
    shown = Moving(
        "A promise that falls with the number",
        Slider("n", "clusters", [*range(1, MOST + 1)], 1, "{:d}"),
        Slider("d", "noise of a fix / drift", [*noises], 1.0, "{:g}"),
    )

    def promised(n: Any, d: float) -> Any:
        return ((1 + d**2) / n) ** 0.5

    def true(n: Any, d: float) -> Any:
        return (1 + d**2 / n) ** 0.5

    chart = shown.chart(
        "Worst-case gain of the fusion", x="clusters", y="gain", xlim=(1, MOST), ylim=(0, 3)
    )

    def all_of(of: Callable[[Any, float], Any]) -> Callable[..., Any]:
        return lambda d: (numbers, np.minimum(of(numbers, d), 3))

    def one_of(of: Callable[[Any, float], Any]) -> Callable[..., Any]:
        return lambda n, d: ([n], [min(of(n, d), 3)])

    for method, label, of in (("independent", "promised", promised), ("distributed", "true", true)):
        shown.draw(chart, method, label, all_of(of))
        shown.draw(chart, method, "", one_of(of), style="points")
    shown.number("independent", "promised", lambda n, d: f"{promised(n, d):.2f}")
    shown.number("distributed", "true", lambda n, d: f"{true(n, d):.2f}")
    shown.sentence(
        lambda n, d: (
            f"{_count(n)}, noise {d:g}: the gain promised is {promised(n, d):.2f}, the true one "
            f"{true(n, d):.2f}."
        )
    )
    shown.show(
        name="fig-l5-promise",
        caption="Clusters alike, each with a filter of gain 1. The promise falls without end; the "
        "truth stops at 1, where the drift is.",
        alt=f"Two curves over the number of clusters, noise 1. With three the promise is "
        f"{promised(3, 1):.2f} and the truth {true(3, 1):.2f}.",
    )


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
    chart = shown.chart(
        "Taken off the federated filter's error",
        x="1, 2: position; 3, 4: velocity", y="%", xlim=(0.4, 4.6),
        ylim=(-200, 100),
    )  # fmt: skip
    places = np.arange(1.0, 5.0)
    shown.draw(
        chart, "distributed", "here", lambda f, d: (places, less(f, d).clip(-200)), style="bars",
        at=0,
    )  # fmt: skip
    for place, name in zip(places, COMPONENTS, strict=True):
        told = float(printed[name]["vs_fkf"])
        label = "P2" if place == places[-1] else ""
        ends = [place - 0.45, place + 0.45]
        shown.draw(chart, "published", label, (ends, [told, told]), at=0)

    def words(f: float, d: float, part: slice) -> str:
        return " and ".join(f"{value:.0f} %".replace("-", "−") for value in less(f, d)[part])

    shown.number("distributed", "position, x and y", lambda f, d: words(f, d, slice(0, 2)))
    shown.number("distributed", "velocity, x and y", lambda f, d: words(f, d, slice(2, 4)))
    shown.sentence(
        lambda f, d: (
            f"With {f:g} and {d:g} m/s² the distributed filter takes {words(f, d, slice(0, 2))} "
            f"off the position errors and {words(f, d, slice(2, 4))} off the velocity errors."
        )
    )
    shown.show(
        name="fig-l5-reductions",
        caption="Bars: P2's scene here; below 0 the federated filter is better. Dashes: P2's "
        "own numbers.",
        alt="Bars of the reduction in four components, and what P2 prints. Both filters at "
        f"{first:g} m/s²: "
        f"{words(first, first, slice(0, 4))}.",
    )
    return off
