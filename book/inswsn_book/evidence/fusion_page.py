"""What evidence p2-fusion draws and disturbs, and residuals of P2's equations written out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.linalg import block_diag

from inswsn_book.evidence import slug
from inswsn_book.show.legible import label_lines, place_labels
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, monte_carlo
from inswsn_lib.filters import patterns_of, run_distributed
from inswsn_lib.lmi import FilterDesign, fusion_system
from inswsn_lib.navigation.cluster_fusion import (
    METHODS,
    ClusterFusion,
    Estimator,
    Pattern,
    planar_rms,
)
from inswsn_lib.plotting import COLOURS, STROKES, figure, stroke
from inswsn_lib.simulation import ClusterScene, coloured

_TITLES = ("position $x$", "position $y$", "velocity $x$", "velocity $y$")
_STYLES = {"INS-only": "ins", "FKF": "federated", "DHF": "distributed"}
_RULES = {
    "constant": ("DHF, constant weights as printed", ("distributed", "-.")),
    "restart": ("DHF, restart", ("distributed", "-")),
    "fading": ("DHF, fading", ("distributed", ":")),
    "FKF": ("FKF", ("federated",)),
    "KF with bias": ("KF with bias", ("kalman",)),
}


def name_set(pattern: Pattern) -> str:
    """Return the letters of the clusters that hear the node."""
    return "".join("ABC"[c] for c, there in enumerate(pattern) if there)


def draw_scene(scene: ClusterScene, changes: Mapping[int, str]) -> Figure:
    """Draw nodes, heads, the centre and the path, marked where the set in reach changes."""
    colours = [COLOURS[name] for name in ("rebuilt", "contradicted", "reproduced")]
    path, nodes = scene.motion.position, scene.nodes
    fig, ax = figure(height=4.4)
    for c, colour in enumerate(colours):
        mine = nodes[scene.labels == c]
        ax.plot(*mine.T, "o", ms=4, color=colour, label=f"cluster {'ABC'[c]}")
        ax.plot(*nodes[scene.heads[c]], "s", ms=10, mfc="none", color=colour)
    centre = nodes[scene.centre]
    ax.plot(*centre, "*", ms=15, color=COLOURS["rival"], label="fusion centre")
    ax.plot(*path.T, lw=1.5, **stroke("truth"))
    marks = path[list(changes)]
    ax.plot(*marks.T, "|", ms=12, mew=2, color=COLOURS["published"])
    ax.set(xlabel="$x$ (m)", ylabel="$y$ (m)", aspect="equal", ylim=(-3, 45))
    fig.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    star = centre + 1.6 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    place_labels(ax, [*changes.values()], marks, np.concatenate([path, nodes, star]), mark=7)
    return fig


def draw_courses(elapsed: Array, changes: Sequence[int], errors: Mapping[str, Array]) -> Figure:
    """Draw the absolute errors of four components over time: median and 95 % of the runs."""
    fig, axes = figure(2, 2, height=5.6)
    for part, ax in enumerate(axes.flat):
        for method, error in errors.items():
            size, style = np.abs(error[::10, part]), _STYLES[method]
            ax.plot(elapsed[::10], np.median(size, axis=1), label=method, **stroke(style))
            if method != "INS-only":
                band = np.quantile(size, [0.025, 0.975], axis=1)
                ax.fill_between(elapsed[::10], *band, color=STROKES[style].colour, alpha=0.18, lw=0)
        _mark(ax, elapsed, changes)
        unit, top = ("m", 60) if part < 2 else ("m/s", 6)
        ax.set(title=_TITLES[part], xlabel="time (s)", ylabel=f"absolute error ({unit})")
        ax.set(yscale="log", ylim=(1e-3, top))
    for ax in axes.flat:
        label_lines(ax, fontsize=9.5)
    return fig


def draw_handover(
    elapsed: Array, changes: Sequence[int], courses: Mapping[str, Mapping[str, Array]]
) -> Figure:
    """Draw RMS position errors over time, a panel for each reading."""
    fig, axes = figure(1, 2, height=3.4)
    for ax, (title, each) in zip(axes, courses.items(), strict=True):
        for name, course in each.items():
            label, look = _RULES[name]
            ax.plot(elapsed, course, lw=1.6, label=label, **stroke(*look))
        _mark(ax, elapsed, changes)
        ax.set(title=title, xlabel="time (s)", ylabel="RMS position error (m)")
        ax.set(yscale="log", ylim=(0.01, 20))
    fig.legend(*axes[1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return fig


def _mark(ax: object, elapsed: Array, changes: Sequence[int]) -> None:
    for k in changes:
        ax.axvline(elapsed[k], color=COLOURS["published"], lw=0.7, alpha=0.6)  # type: ignore[attr-defined]


def stacked_residuals(
    designs: Sequence[FilterDesign], weights: Array, seed: int
) -> tuple[float, float]:
    """Return residuals of P2 (6) and (13), two filters written out, over the size of the state."""
    rng, steps = np.random.default_rng(seed), 100
    w, xi = rng.standard_normal((steps, 4)), rng.standard_normal((steps, 2, 4))
    A, B, _ = fusion_system(designs, weights, "common")
    truth, local, stack = np.zeros(4), np.zeros((2, 4)), np.zeros(8)
    y, fused, away = np.empty((2, steps, 4)), [], 0.0
    for k in range(steps):
        fused.append(sum(M @ x for M, x in zip(weights, local, strict=True)))
        for c, (model, gain) in enumerate((d.model, d.gain) for d in designs):
            y[c, k] = model.C @ truth + model.D @ xi[k, c]
            local[c] = model.A @ local[c] + gain @ (y[c, k] - model.C @ local[c])
        truth = designs[0].model.A @ truth + designs[0].model.B @ w[k]
        stack = A @ stack + B @ np.concatenate([w[k], *xi[k]])
        away = max(away, float(np.abs((truth - local).ravel() - stack).max()))
    size = max(np.abs(truth).max(), np.abs(local).max())
    ours = run_distributed(designs, y, weights=weights, handover="constant", predicted=True)
    return float(np.abs(ours - np.array(fused)).max() / size), float(away / size)


def linearity_residual(designs: Sequence[FilterDesign], seed: int) -> float:
    """Return how far P2 (9) is from linear in P, M and the squared level, over its entries."""
    At, Kt = (block_diag(*[d.error_system[part] for d in designs]) for part in (0, 1))
    (n, p), size, rng = Kt.shape, len(designs[0].model.L), np.random.default_rng(seed)

    def inequality(P: Array, M: Array, squared: float) -> Array:
        return np.block([
            [-P, np.zeros((n, p)), At.T @ P, M.T],
            [np.zeros((p, n)), -squared * np.eye(p), Kt.T @ P, np.zeros((p, size))],
            [P @ At, P @ Kt, -P, np.zeros((n, size))],
            [M, np.zeros((size, p)), np.zeros((size, n)), -np.eye(size)],
        ])  # fmt: skip

    def draw() -> tuple[Array, Array, float]:
        root = rng.standard_normal((n, n))
        return root @ root.T, rng.standard_normal((size, n)), float(rng.random())

    (P, M, a), (Q, N, b) = draw(), draw()
    middle = inequality((P + Q) / 2, (M + N) / 2, (a + b) / 2)
    mean = (inequality(P, M, a) + inequality(Q, N, b)) / 2
    return float(np.abs(middle - mean).max() / np.abs(middle).max())


def disturbed_data(fusion: ClusterFusion) -> dict[str, tuple[Array, Array]]:
    """Return INS and network errors of the tuned scene in each case of disturbed noise."""
    scene, runs, seed = fusion.scene, fusion.other_runs, fusion.seed
    ranging, inertial, period = scene.ranging, scene.inertial, scene.period
    lie = np.zeros((len(scene.clusters), 1, 2, 1))
    lie[-1, 0, 0] = 1.0

    def case(scene: ClusterScene = scene, added: Array | float = 0.0) -> tuple[Array, Array]:
        data = monte_carlo(scene.simulate, runs, seed + 2)
        fixes = data["fixes"] + added
        normal = np.random.default_rng(seed + 3).standard_normal(fixes.shape)
        return data["ins"], scene.with_velocities(fixes, normal)

    fixes = (len(scene.clusters), len(scene.motion.time), 2, runs)
    normal = np.random.default_rng(seed + 4).standard_normal(fixes)
    wander = 0.3 * np.stack([coloured(each, period, 5.0) for each in normal])
    x, y = inertial.accelerometer_bias
    late = replace(ranging, outlier=0.1, outlier_scale=3.0)
    return {
        "undisturbed": case(),
        "range noise doubled": case(
            replace(scene, ranging=replace(ranging, noise=2 * ranging.noise))
        ),
        "a tenth of the ranges late, 3 m in the mean": case(replace(scene, ranging=late)),
        "30 % of the ranges lost": case(replace(scene, ranging=replace(ranging, dropout=0.3))),
        "fixes correlated over 1 s": case(replace(scene, correlation_time=1.0)),
        "fixes wander by 0.3 m in 5 s": case(added=wander),
        "the last cluster lies by 1 m": case(added=lie),
        "bias of the accelerometers doubled": case(
            replace(scene, inertial=replace(inertial, accelerometer_bias=(2 * x, 2 * y)))
        ),
    }


def disturbed_errors(fusion: ClusterFusion) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return RMS errors of position and velocity, medians, of each tuned filter in each case."""
    data, filters = disturbed_data(fusion), filters_for_all_sets(fusion)
    middle = {
        case: {
            name: np.median(planar_rms(ins - run(ins[None] - wsn)), axis=1)
            for name, run in filters.items()
        }
        for case, (ins, wsn) in data.items()
    }
    frame = pd.DataFrame.from_dict(middle, orient="index").rename_axis("case")
    return frame.map(lambda both: both[0]), frame.map(lambda both: both[1])


def filters_for_all_sets(fusion: ClusterFusion) -> dict[str, Estimator]:
    """Return each tuned filter, with gains for every set of clusters that may be in reach."""
    sets = [p for p in product((False, True), repeat=len(fusion.scene.clusters)) if any(p)]
    dhf = fusion.chosen["dhf"]
    complete = {
        "dhf": fusion.distributed(*dhf, for_sets=sets),
        "dhf-one-ins": fusion.distributed(*dhf, noise="common", for_sets=sets),
        "hf-centralised": fusion.central_hf(*fusion.chosen["hf-centralised"], for_sets=sets),
    }
    return {name: complete.get(key, fusion.filters[key]) for key, name in METHODS.items()}


def first_pair(fusion: ClusterFusion) -> list[int]:
    """Return the clusters of the first set of two that hear the node."""
    pairs = (p for p in patterns_of(fusion.measurements) if sum(p) == 2)
    pattern = next(pairs, (True, True, False))
    return [c for c, there in enumerate(pattern) if there]


def with_ends(found: Finding) -> str:
    """Return a number with the ends of its interval, as a cell of a table."""
    return f"{found.value:.3f} ({found.low:.3f} to {found.high:.3f})"


def tabulate_methods(fusion: ClusterFusion, found: Mapping[str, Finding]) -> pd.DataFrame:
    """Return the methods with their numbers, the trials that chose them, and their RMS errors."""
    rows = {}
    for key, name in METHODS.items():
        given = ", ".join(f"{number:.3g}" for number in fusion.chosen.get(key, ())) or "–"
        trials = f"; {fusion.tuned[key].trials}" if key in fusion.tuned else ""
        errors = [with_ends(found[f"{slug(name)}.{part}"]) for part in ("position", "velocity")]
        rows[name] = [given + trials, *errors]
    columns = ["chosen numbers; trials", "position (m)", "velocity (m/s)"]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("method")
