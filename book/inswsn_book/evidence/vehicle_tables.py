"""The outages of P3's car: what each method does by drive, ratios, tables and drawings."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from inswsn_book.evidence.outage_cells import WORDS, ByDrive, error_sizes
from inswsn_book.show.legible import place_labels
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, cluster_mean, cluster_median
from inswsn_lib.inertial import metres
from inswsn_lib.learning import RBFNetworkRegressor
from inswsn_lib.navigation import RecordedTrials, VehicleOutages, outage_size
from inswsn_lib.navigation.vehicle_hybrid import Machine
from inswsn_lib.navigation.vehicle_outages import LONG, METHODS, OUTAGE
from inswsn_lib.plotting import COLOURS, STROKES, figure, stroke
from inswsn_lib.simulation import Truth
from inswsn_lib.vehicle import yaw

#: All methods in words
WHO = WORDS | {
    "short": "the LS-SVM that learns from simulated outages of 10 s",
    "short rbf": "the RBF network that learns from these",
    "half": "the LS-SVM that learns from simulated outages of 20 s",
    "half rbf": "the RBF network that learns from these",
    "no time": "the LS-SVM without time",
    "linear": "a linear fit",
    "hold": "the last difference held",
    "proven": "an LS-SVM that has to prove itself",
    "on never": "an LS-SVM on the filter that is never aided",
}
#: The filters and the two learners that P3 has
P3_METHODS = ("never", "until", "through", "lssvm", "rbf")
#: Three places that are drawn, as P3 does
DRAWN = (0, 4, 7)
#: RMS and largest errors by method and span, as `VehicleOutages.sizes`
Sizes = Mapping[tuple[str, str], tuple[Array, Array]]
_STYLES = {
    "never": stroke("ins", ":"),
    "until": stroke("kalman", "--"),
    "through": stroke("kalman"),
    "lssvm": stroke("lssvm"),
    "rbf": stroke("rbf"),
}


class Ratios:
    """Ratios of errors that a page puts against one: each has an interval by clusters."""

    def __init__(self) -> None:
        self._pairs: dict[bytes, tuple[Array, Array]] = {}

    def __len__(self) -> int:
        return len(self._pairs)

    def factor(self, one: Array, other: Array, clusters: ArrayLike, how: str) -> Finding:
        """Return the geometric mean of the ratio of two errors, with its 95 % interval."""
        ratio = np.log(one / other)
        pair = ratio.ravel(), np.broadcast_to(clusters, ratio.shape).ravel()
        self._pairs[ratio.tobytes()] = pair
        mean, low, high = map(float, np.exp(cluster_mean(*pair)))
        said = f"{how}; the geometric mean over the outages, with an interval by clusters."
        return Finding(mean, low, high, "1", said)

    def apart(self, level: float) -> list[bool]:
        """Tell of each ratio whether an interval of a level excludes one."""
        ends = (cluster_mean(*pair, level=level)[1:] for pair in self._pairs.values())
        return [bool(low > 0 or high < 0) for low, high in ends]


def written(factor: Finding) -> str:
    """Write a factor and its interval."""
    return f"{factor.value:.2f} ({factor.low:.2f} to {factor.high:.2f})"


def share_of(held: Array, what: str, clusters: Array) -> Finding:
    """Return the share of outages of which something holds of P3's method."""
    mean, low, high = cluster_mean(held.ravel().astype(float), clusters.ravel())
    how = f"The share of outages in which the proposed method has {what}"
    return Finding(mean, low, high, "1", f"{how}; interval by clusters of place and route.")


def medians(drives: Mapping[str, ByDrive], outages: VehicleOutages) -> dict[str, Finding]:
    """Return the medians over the drives, each with its own 95 % interval, by routes."""
    routes = np.repeat(np.arange(outages.routes), outages.draws)
    return {
        name: Finding(
            *cluster_median(values, routes, seed=outages.seed),
            unit,
            f"{how} Median over the drives; interval by routes.",
        )
        for name, (values, unit, how) in drives.items()
    }


def gains_by_drive(outages: VehicleOutages) -> dict[str, ByDrive]:
    """Return by how much methods are below the filter that is never aided, and the growths.

    Those of P3's method, of its rivals, and of the LS-SVM and the network as they learn from
    simulated outages of 10 s and 20 s (``tau10.``, ``tau20.``); the network on ramps that it has
    not seen, and the yaw.
    """
    found = {
        f"sim.40.gain.{name}-never.rms": _gain_over_never(outages, method, words)
        for name, method, words in (
            ("through-over", "through", "aiding alone"),
            ("rbf-over", "rbf", "the RBF network"),
            ("lssvm-on", "on never", "an LS-SVM on the filter that is never aided"),
        )
    }
    found["ratio.lssvm-growth"] = _growth(outages, "lssvm", "LS-SVM")
    for prefix, lssvm, rbf in (
        ("", "lssvm", "rbf"),
        ("tau10.", "short", "short rbf"),
        ("tau20.", "half", "half rbf"),
    ):
        late, near = (_rms(outages, lssvm, s) / _rms(outages, rbf, s) for s in ("late", "40"))
        corrected = 1 - _rms(outages, lssvm, "late") / _rms(outages, "through", "late")
        rivals = {
            "sim.40.gain.proposed-over-never.rms": _gain_over_never(
                outages, lssvm, "the proposed method"
            ),
            "sim.50.gain.lssvm-over-through.late": ByDrive(
                100 * corrected,
                "%",
                "Reduction of the RMS error over the last 10 s of 50 s by the LS-SVM against the "
                "filter that it corrects, RMS over the places.",
            ),
            "ratio.lssvm-over-rbf.late": ByDrive(
                late,
                "1",
                "RMS error over 41 s to 50 s of the LS-SVM over that of the RBF network, RMS over "
                "the places.",
            ),
            "ratio.lssvm-rbf-apart.40": ByDrive(
                np.maximum(near, 1 / near),
                "1",
                "The larger of the RMS errors over 40 s of LS-SVM and RBF network over the "
                "smaller, RMS over the places.",
            ),
            "ratio.rbf-growth": _growth(outages, rbf, "RBF network"),
        }
        found |= {f"{prefix}{name}": each for name, each in rivals.items()}
    how = "RMS error of the RBF network on whole ramps that it has not seen, over that of"
    how = f"{how} predicting zero."
    found["rbf.validation-over-zero"] = ByDrive(unseen_ramps(outages), "1", how)
    with_compass, without = (yaw_rms(outages, name) for name in ("through", "until"))
    how = "RMS yaw error at 40 s of the outage with the compass over that"
    growth, ratio = with_compass[OUTAGE] / with_compass[5], with_compass[OUTAGE] / without[OUTAGE]
    found["yaw.growth"] = ByDrive(growth, "1", f"{how} at 5 s.")
    return found | {"yaw.ratio": ByDrive(ratio, "1", f"{how} without.")}


def _gain_over_never(outages: VehicleOutages, method: str, words: str) -> ByDrive:
    one, never = (outages.sizes[name, "40"][0] for name in (method, "never"))
    against = "" if method == "on never" else " against the filter that is never aided"
    how = f"Reduction of the RMS error by {words}{against}, mean over the eight places."
    return ByDrive((100 * (1 - one / never)).mean(axis=0), "%", how)


def _rms(outages: VehicleOutages, method: str, span: str) -> Array:
    return np.asarray(np.sqrt((outages.sizes[method, span][0] ** 2).mean(axis=0)))


def _growth(outages: VehicleOutages, method: str, words: str) -> ByDrive:
    own, corrected = (
        np.sqrt((errors[LONG] ** 2).mean(axis=0) / (errors[OUTAGE] ** 2).mean(axis=0))
        for errors in (outages.errors[method], outages.errors["through"])
    )
    how = (
        f"Error of the {words} at 50 s over that at 40 s, RMS over the places, over the same of "
        "the filter that it corrects."
    )
    return ByDrive(own / corrected, "1", how)


def unseen_ramps(outages: VehicleOutages) -> Array:
    """Return the RMS error of the network on ramps that it has not seen, over predicting zero.

    For each drive, over all of its ramps but those within the first window.
    """
    found = []
    for trials in outages.trials:
        pairs = trials.ramps["lssvm"]
        begins = [int(b) for b in np.unique(pairs.ramp) if b >= outages.window]
        for run in range(outages.draws):
            each = [outages.hybrids["rbf"].predict_ramp(pairs, run, b) for b in begins]
            missed = sum(np.sum((predicted - came) ** 2) for predicted, came in each)
            found.append(np.sqrt(missed / sum(np.sum(came**2) for _, came in each)))
    return np.array(found)


def last_ramps(outages: VehicleOutages) -> Array:
    """Return the like of the LS-SVM for the last whole ramp before each outage and run."""
    found = []
    for trials in outages.trials:
        pairs = trials.ramps["lssvm"]
        for begin in trials.starts:
            last = int(pairs.ramp[pairs.ramp + outages.tau <= begin].max())
            for run in range(outages.draws):
                predicted, came = outages.hybrids["lssvm"].predict_ramp(pairs, run, last)
                found.append(np.sqrt(np.sum((predicted - came) ** 2) / np.sum(came**2)))
    return np.array(found)


def first_window(outages: VehicleOutages) -> tuple[Array, Array]:
    """Return inputs and targets (m) that train for the first outage of the first drive."""
    pairs, start = outages.trials[0].ramps["lssvm"], outages.starts[0][0]
    within = (pairs.epoch <= start) & (pairs.epoch > start - outages.window)
    rows = np.flatnonzero((pairs.run == 0) & within)
    rows = rows[np.argsort(pairs.epoch[rows], kind="stable")]
    return np.column_stack([pairs.motion, pairs.elapsed])[rows], pairs.difference[rows]


def neurons_in_radians(outages: VehicleOutages) -> int:
    """Return how many neurons P3's network has there if the targets are in radians."""
    inputs, targets = first_window(outages)
    unit = metres(outages.truths[0].reference.position[0])[[1, 0]]
    return len(RBFNetworkRegressor(3.0, 0.01, 40).fit(inputs, targets / unit).centres_)


def lssvm_residual(outages: VehicleOutages) -> float:
    """Return the residual of P3 (34) there, kernel and all rebuilt, over the largest target."""
    machine = outages.trials[0].bridges["lssvm"].machines[0]
    X, y = first_window(outages)
    X, y = machine.inputs.transform(X), machine.targets.transform(y)
    svm = machine.regressor.machine_
    K = np.exp(-((X[:, None] - X[None]) ** 2).sum(axis=2) / (2 * svm.sigma**2))
    rows = np.abs(K @ svm.alpha_ + svm.alpha_ / svm.eta + svm.bias_ - y).max()
    return float(max(rows, np.abs(svm.alpha_.sum(axis=0)).max()) / np.abs(y).max())


def machines(outages: VehicleOutages, method: str) -> list[Machine]:
    """Return what learned for each outage and run."""
    return [m for trials in outages.trials for m in trials.bridges[method].machines]


def selected_at_an_end(outages: VehicleOutages) -> float:
    """Return the share of outages in which leave-one-out chooses an end of the candidates."""
    chosen = [machine.regressor.selection_ for machine in machines(outages, "lssvm")]
    ends = [c.sigma in c.sigmas[[0, -1]] or c.eta in c.etas[[0, -1]] for c in chosen]
    return float(np.mean(ends))


def ramp_ends(outages: VehicleOutages) -> Array:
    """Return where the ramps of each drive end, east and north, (drives, ramps, 2), m."""
    ends = []
    for trials in outages.trials:
        pairs = trials.ramps["lssvm"]
        for run in range(outages.draws):
            rows = np.flatnonzero((pairs.elapsed == outages.tau) & (pairs.run == run))
            ends.append(pairs.difference[rows[np.argsort(pairs.ramp[rows])]])
    return np.array([e[: min(map(len, ends))] for e in ends])


def yaw_rms(outages: VehicleOutages, method: str) -> Array:
    """Return the RMS yaw error of a filter over the places, (51 epochs, drives), rad."""
    parts = []
    for trials, drive in zip(outages.trials, outages.drives, strict=True):
        branch, way = trials.branches[method], drive.reference.attitude
        assert way is not None  # a simulated drive has one
        true = yaw(way)[branch.epochs]
        turned = np.angle(np.exp(1j * (yaw(branch.states.attitude) - true)))
        parts.append(turned.reshape(LONG + 1, 8, outages.draws))
    return np.asarray(np.sqrt((np.concatenate(parts, axis=2) ** 2).mean(axis=1)))


def methods_table(sizes: Sizes, factors: Mapping[str, Finding]) -> pd.DataFrame:
    """Return the errors of all methods, median / mean over the outages."""
    rows = {}
    for name, label in METHODS.items():
        near, late = (sizes[name, span][0] for span in ("40", "late"))
        rows[label] = (
            f"{np.median(near):.1f} / {near.mean():.1f}",
            f"{np.median(late):.1f} / {late.mean():.1f}",
            f"{np.median(sizes[name, '40'][1]):.1f}",
            written(factors[name]) if name in factors else "–",
        )
    columns = ["RMS, 40 s (m)", "RMS, 41–50 s (m)", "largest, 40 s (m)", "÷ aided through"]
    return rows_table(rows, columns, "method")


def places_table(sizes: Sizes, medians: Mapping[str, Array], names: list[str]) -> pd.DataFrame:
    """Return RMS / largest errors at each place, medians over the drives, and their ranges."""
    rows = {}
    for i, place in enumerate(names):
        pairs = [[np.median(x[i]) for x in sizes[name, "40"]] for name in P3_METHODS]
        rows[f"{i + 1} {place}"] = tuple(f"{rms:.1f}\u00a0/\u00a0{top:.1f}" for rms, top in pairs)
    rows["range over the places"] = tuple(
        "{:.0f}–{:.0f} / {:.0f}–{:.0f}".format(*medians[name]) for name in P3_METHODS
    )
    return rows_table(rows, [METHODS[name] for name in P3_METHODS], "place")


def range_ends(sizes: Sizes, method: str) -> Array:
    """Return least and most of RMS, then of largest errors over the places, drives' medians."""
    spread = [(x.min(axis=0), x.max(axis=0)) for x in sizes[method, "40"]]
    return np.array([np.median(end) for pair in spread for end in pair])


def reading_scores(
    ranges: Mapping[str, Array], printed: Mapping[str, list[str]]
) -> dict[tuple[str, str], float]:
    """Return by what factor readings of (KF, proposed) are off P3's ranges, the nearest first.

    Each filter may be the KF, and each of three methods the proposed one. A score is the mean size
    of the logarithm of rebuilt over printed of the eight ends.
    """
    kinds = "kf_rms", "kf_max", "proposed_rms", "proposed_max"
    ends = np.array([float(end) for kind in kinds for end in printed[kind]])
    scores = {}
    for kf, proposed in product(("never", "until", "through"), ("through", "lssvm", "on never")):
        if kf != proposed:
            off = np.log(np.concatenate([ranges[kf], ranges[proposed]]) / ends)
            scores[kf, proposed] = float(np.exp(np.abs(off).mean()))
    return dict(sorted(scores.items(), key=lambda score: score[1]))


def readings_table(
    ranges: Mapping[str, Array], scores: Mapping[tuple[str, str], float]
) -> pd.DataFrame:
    """Return the readings of P3's two methods with their scores and ranges."""
    spans = {n: [f"{x[i]:.0f}–{x[i + 1]:.0f}" for i in (0, 2)] for n, x in ranges.items()}
    rows = [
        [METHODS[proposed], f"{score:.2f}", *spans[kf], *spans[proposed]]
        for (kf, proposed), score in scores.items()
    ]
    sizes = [f"{who} {what} (m)" for who in ("KF", "proposed") for what in ("RMS", "max")]
    index = pd.Index([METHODS[kf] for kf, _ in scores], name="KF is")
    return pd.DataFrame(rows, index, ["proposed is", "off by a factor", *sizes])


def recorded_factors(trials: RecordedTrials, ratios: Ratios) -> dict[str, Finding]:
    """Return the factors over the filter that is aided through the outage, by blocks of two.

    And, as ``through-never``, that of aiding.
    """
    rms = {name: outage_size(error, 1, OUTAGE)[0] for name, error in trials.errors.items()}
    blocks = np.arange(len(trials.starts))[:, None] // 2
    on = "RMS error in 40 s on the recorded drive"
    found = {
        name: ratios.factor(
            one, rms["through"], blocks, f"{on}, {WHO[name]}, over that of {WHO['through']}"
        )
        for name, one in rms.items()
        if name != "through"
    }
    how = f"{on}, {WHO['through']} over the one that is never aided"
    gain = ratios.factor(rms["through"], rms["never"], blocks, how)
    return found | {"through-never": gain}


def trials_apart(one: RecordedTrials, other: RecordedTrials) -> float:
    """Return by how much errors of the filters and of the last difference differ at most, m."""
    names = "never", "until", "through", "hold"
    pairs = [(one.errors[n], other.errors[n]) for n in names]
    pairs += [(x, other.ladder[n]) for n, x in one.ladder.items()]
    return max(float(np.abs(x - y).max()) for x, y in pairs)


def recorded_table(sizes: Sizes, factors: Mapping[str, Finding]) -> pd.DataFrame:
    """Return the errors on the recorded drive, medians over outages and draws."""
    rows = {}
    for name in (name for name in METHODS if (name, "40") in sizes):
        (near, top), (far, most) = sizes[name, "40"], sizes[name, "50"]
        rows[METHODS[name]] = (
            f"{np.median(near):.1f} / {np.median(top):.1f}",
            f"{np.median(far):.1f} / {np.median(most):.1f}",
            f"{top.min():.0f}–{top.max():.0f}",
            written(factors[name]) if name in factors else "–",
        )
    spans = [f"{span} s: median RMS / largest (m)" for span in ("40", "50")]
    columns = [*spans, "range of the largest, 40 s (m)", "÷ aided through"]
    return rows_table(rows, columns, "method")


def rows_table(rows: Mapping[str, tuple[str, ...]], columns: list[str], index: str) -> pd.DataFrame:
    """Return a table of rows by name."""
    frame = pd.DataFrame.from_dict(dict(rows), orient="index", columns=columns)
    return frame.rename_axis(index)


def route_of(truth: Truth) -> Array:
    """Return the route in kilometres from its start, east and north, (epochs, 2)."""
    position = truth.reference.position
    return np.asarray(((position - position[0]) * metres(position[0]))[:, [1, 0]] / 1000)


def draw_route(truth: Truth) -> Figure:
    """Draw a simulated route with its places."""
    track, middle = route_of(truth), LONG // 2
    fig, ax = figure(height=4.6)
    ax.plot(*track.T, lw=1, **stroke("truth"))
    for place in truth.places:
        part = track[place.start : place.start + LONG + 1]
        ax.plot(*part.T, color=STROKES["ins"].colour, lw=3)
    ax.plot(*track[0], "o", color=STROKES["truth"].colour)
    ax.set(xlabel="east (km)", ylabel="north (km)", aspect="equal")
    ax.annotate(
        "N",
        (0.06, 0.7),
        (0.06, 0.88),
        xycoords="axes fraction",
        textcoords="axes fraction",
        ha="center",
        va="center",
        arrowprops={"arrowstyle": "<-", "lw": 1.2},
    )
    labels = [str(i) for i, _ in enumerate(truth.places, 1)]
    middles = np.array([track[place.start + middle] for place in truth.places])
    place_labels(ax, labels, middles, track)
    return fig


def draw_errors(panels: Mapping[str, Mapping[str, Array]]) -> Figure:
    """Draw errors against time, (51,), by title and method."""
    fig, axes = figure(1, len(panels), height=3.2, sharey=True, squeeze=False)
    for ax, (title, errors) in zip(axes[0], panels.items(), strict=True):
        for name in P3_METHODS:
            ax.plot(errors[name], label=METHODS[name], **_STYLES[name])
        ax.axvline(OUTAGE, color=COLOURS["published"], lw=0.7)
        ax.set(title=title, xlabel="time since GPS was lost (s)")
    axes[0, 0].set(ylabel="horizontal error (m)")
    found = axes[0, 0].get_legend_handles_labels()
    fig.legend(*found, loc="outside lower center", ncols=5, columnspacing=1, handlelength=2.5)
    return fig


def said_of(panels: Mapping[str, Mapping[str, Array]]) -> str:
    """Say of each title and method the error at the end."""
    ends = {
        title: ", ".join(f"{METHODS[name]} {x[LONG]:.0f}" for name, x in errors.items())
        for title, errors in panels.items()
    }
    return "; ".join(f"{title}: {said}" for title, said in ends.items())


def ramp_errors(outages: VehicleOutages) -> tuple[Array, Array]:
    """Return the aided filter's error in outage 5 of the first drive, and what is predicted.

    East and north from the first second on, each (50, 2), m.
    """
    trials, start, column = outages.trials[0], outages.starts[0][4], 4 * outages.draws
    true = outages.drives[0].reference.position[start : start + LONG + 1]
    gap = trials.branches["through"].first[1:, :, column] - true[1:]
    error = (gap * metres(true[0]))[:, [1, 0]]
    return error, trials.bridges["lssvm"].predicted[1:, :, column]


def ramps_before(outages: VehicleOutages) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Return the pairs of 200 s before that outage: ramp, epoch from its start, difference."""
    pairs, start = outages.trials[0].ramps["lssvm"], outages.starts[0][4]
    own = (pairs.run == 0) & (pairs.epoch <= start) & (pairs.epoch > start - 200)
    return pairs.ramp[own], pairs.epoch[own] - start, pairs.difference[own]


def draw_ramps(outages: VehicleOutages) -> Figure:
    """Draw what the LS-SVM is given before outage 5 of the first drive, and what it should say."""
    ramp, when, difference = ramps_before(outages)
    time, both = np.arange(1, LONG + 1), ramp_errors(outages)
    fig, axes = figure(2, 1, height=4.4, sharex=True)
    for axis, ax in enumerate(axes):
        for j, begin in enumerate(np.unique(ramp)):
            x, y = when[ramp == begin], difference[ramp == begin, axis]
            label = None if j else "past ramps"
            ax.plot(x, y, color=COLOURS["published"], lw=1, label=label)
        seen = when > -outages.window
        look = {"color": STROKES["lssvm"].colour, "ms": 5, "label": "in the window"}
        ax.plot(when[seen], difference[seen, axis], ".", **look)
        for values, name, label in zip(
            both,
            ("kalman", "lssvm"),
            ("error of the aided filter", "predicted by the LS-SVM"),
            strict=True,
        ):
            ax.plot(time, values[:, axis], label=label, **stroke(name))
        ax.axvline(0, color=COLOURS["published"], lw=0.7)
        ax.axvspan(-outages.window, 0, color=COLOURS["published"], alpha=0.12, lw=0)
        ax.set(ylabel=("east (m)", "north (m)")[axis])
    axes[1].set(xlabel="time before and after GPS was lost (s)")
    found = axes[0].get_legend_handles_labels()
    fig.legend(*found, loc="outside lower center", ncols=2)
    return fig


def recorded_sizes(trials: RecordedTrials) -> dict[tuple[str, str], tuple[Array, Array]]:
    """Return RMS and largest errors on the recorded drive by method and span."""
    sizes = error_sizes(trials.errors)
    spans = {key[:2] for key in sizes}
    return {span: (sizes[*span, "rms"], sizes[*span, "max"]) for span in sorted(spans)}
