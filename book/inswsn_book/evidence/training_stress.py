"""The filters of P1's areas where something is other than they assume."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from inswsn_book.evidence.training_table import with_recorded
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, monte_carlo, normalised_squares, quotient
from inswsn_lib.filters import design_kalman
from inswsn_lib.navigation.filter_contest import (
    PARTS,
    Estimator,
    FilterContest,
    kalman,
    relative_loss,
    root_mean_square,
)
from inswsn_lib.navigation.training_areas import (
    AREAS,
    UNKNOWN,
    ByArea,
    TrainingAreas,
    errors_by_area,
    run_coloured,
)
from inswsn_lib.scenario import from_settings, with_values
from inswsn_lib.simulation import Scene, drifting, heavy_tailed, losing

HF = "HF, exact LMI"
LEAST = "HF, exact LMI, 1.01 γ"
#: The cases by what is broken: those that were named first, of measurements and of the process;
#: then those in which errors of the network last, and more of a drift that no filter knows of
NOISE = (
    "network 3 times noisier",
    "network 3 times more precise",
    "heavy tails, Student's t with 3 degrees",
    "one range in ten late, 3 m on average",
    "30 % of the fixes lost",
)
FIRST_DRIFT = ("coloured drift, 0.3 m/s², 2 s", "jitter of 0.05 s")
LASTING = (
    "fixes correlated over 1 s",
    "fixes correlated over 3 s",
    "errors of nodes, half of the variance",
    "fixes off by 0.2 m",
    "velocities of the network off by 0.2 m/s",
)
DRIFT = (
    *FIRST_DRIFT,
    "acceleration error of 1 m/s²",
    "acceleration error of 3 m/s²",
    "velocity of the INS jumps by 1 m/s",
)
NAMED_FIRST = (*NOISE, *FIRST_DRIFT)
BROKEN = (*NOISE, *DRIFT, *LASTING)
UNDISTURBED = "as assumed"
PUBLISHED, MATCHED = "HF, published", "Kalman, matched"
Drawn = Mapping[str, ByArea]
#: RMS errors by case and part, then by filter, from `stress`
Stressed = Mapping[tuple[str, str], Mapping[str, float]]


def rms_by_part(errors: ByArea) -> dict[str, float]:
    """Return the RMS errors of position and velocity, means of both areas."""
    return {
        part: float(np.mean([root_mean_square(e[:, rows]) for e in errors.values()]))
        for part, rows in PARTS.items()
    }


def table_of_tuned(contest: FilterContest) -> pd.DataFrame:
    """Return the tuned filters on equal terms: errors, loss, and the two numbers of each."""
    network = contest.areas.drawn["wsn"]
    rows = {"network (published HF, filtered)": (*_told(rms_by_part(network)), "1", "–", "–")}
    for name, errors in tuned_errors(contest).items():
        loss = f"{relative_loss(errors, network):.3f}"
        best = (f"{number:.2g}" for number in contest.tunings[name].best)
        rows[f"{name}, tuned"] = *_told(rms_by_part(errors)), loss, *best
    columns = ["RMS $r$ (m)", "RMS $v$ (m/s)", "loss", "$Q$ ratio", "second"]
    return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("filter")


def tuned_ratios(errors: Mapping[str, ByArea]) -> dict[str, Finding]:
    """Return ``fair.hf-over-kalman.PART``, ratios of the RMS errors of tuned filters.

    Parameters
    ----------
    errors : mapping
        As `tuned_errors` gives them.
    """

    def by_run(name: str, rows: slice) -> list[Array]:
        squares = (np.square(e[:, rows]) for e in errors[name].values())
        return [np.sqrt(np.nanmean(each, axis=(0, 1))) for each in squares]

    return {
        f"fair.hf-over-kalman.{part}": quotient(
            by_run(HF, rows), by_run("Kalman", rows), "1",
            f"RMS {part} error of HF, exact LMI, over that of the Kalman filter, both tuned, "
            "sums over both areas of medians of the runs.",
        )
        for part, rows in PARTS.items()
    }  # fmt: skip


def tuned_errors(contest: FilterContest) -> dict[str, ByArea]:
    """Return the errors of the tuned filters on the runs of the tables."""
    drawn = contest.areas.drawn
    return {name: contest.errors(each, drawn) for name, each in contest.tuned.items()}


def _told(sizes: Mapping[str, float]) -> list[str]:
    return [f"{sizes[part]:.3f}" for part in PARTS]


def stress(contest: FilterContest) -> dict[tuple[str, str], dict[str, float]]:
    """Return RMS errors by case and part, then by filter, where assumptions are broken.

    The filters keep theirs: the published HF, the Kalman filter with matched noise, and those of
    the contest as they are tuned. The first case is as they assume.
    """
    tuned, estimate = contest.tuned, contest.areas.estimate
    filters: dict[str, Estimator] = {
        PUBLISHED: partial(estimate, "hf-printed-filtered"),
        MATCHED: partial(estimate, "kf-matched-filtered"),
        HF: tuned[HF],
        "Kalman": tuned["Kalman"],
        "two more states": tuned["Kalman, acceleration states"],
        "gating": tuned["Kalman with gating"],
        "Huber": tuned["Kalman with Huber update"],
        "adaptive R": tuned["Kalman with adaptive R"],
    }
    found: dict[tuple[str, str], dict[str, float]] = {}
    for case, drawn in _cases(contest.areas).items():
        for name, filter_ in filters.items():
            ins, network = drawn["ins"], drawn["wsn"]
            errors = {a: ins[a] - filter_(a, ins[a] - network[a]) for a in AREAS}
            for part, error in rms_by_part(errors).items():
                found.setdefault((case, part), {})[name] = error
    return found


def table_of_positions(stressed: Stressed) -> pd.DataFrame:
    """Return the position errors by case and filter, the least of a case in bold."""
    rows = {}
    for (case, part), errors in stressed.items():
        if part == "position":
            least = min(errors.values())
            rows[case] = {
                name: f"**{error:.3f}**" if error == least else f"{error:.3f}"
                for name, error in errors.items()
            }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("case")


def wins(
    stressed: Stressed,
    name: str = PUBLISHED,
    rival: str = MATCHED,
    among: Iterable[str] = NAMED_FIRST,
) -> int:
    """Return how many comparisons, of position and of velocity, a filter wins against a rival."""
    return sum(
        stressed[case, part][name] < stressed[case, part][rival] for case in among for part in PARTS
    )


def rises(stressed: Stressed) -> dict[str, float]:
    """Return by what factor the errors of filters rise in the cases named first that are worse.

    They are geometric means over cases, position and velocity.
    """
    worse = [case for case in NAMED_FIRST if case != "network 3 times more precise"]
    start = {part: stressed[UNDISTURBED, part] for part in PARTS}
    logs = {
        name: [np.log(stressed[c, part][name] / start[part][name]) for c in worse for part in PARTS]
        for name in start["position"]
    }
    return {name: float(np.exp(np.mean(each))) for name, each in logs.items()}


def robust_numbers(stressed: Stressed) -> dict[str, float]:
    """Return what the comparisons under broken assumptions amount to, by quantity."""
    undisturbed = stressed[UNDISTURBED, "position"]
    pairs = [stressed[case, part] for case in BROKEN for part in PARTS]
    drifting_ones = [stressed[case, part] for case in DRIFT for part in PARTS]
    best = [min(errors, key=errors.__getitem__) for errors in drifting_ones]
    won, of_process = wins(stressed), wins(stressed, among=FIRST_DRIFT)
    of_all = wins(stressed, among=BROKEN)
    return {
        "robust.cases-won": won,
        "robust.all-won": of_all,
        "robust.wider-won": len(NAMED_FIRST) * of_all / len(BROKEN),
        "robust.process-won": of_process,
        "robust.measurement-won": won - of_process,
        "robust.lasting-won": wins(stressed, among=LASTING),
        "robust.drift-won": wins(stressed, among=DRIFT),
        "robust.exact-won": wins(stressed, HF),
        "robust.exact-against-tuned": wins(stressed, HF, "Kalman", BROKEN),
        "robust.exact-apart": 100 * np.median([abs(np.log(e[HF] / e["Kalman"])) for e in pairs]),
        "robust.states-best": best.count("two more states"),
        "robust.start": undisturbed[PUBLISHED] / undisturbed[MATCHED],
    }


def _cases(areas: TrainingAreas) -> dict[str, Drawn]:
    """Return errors of INS and network by what is broken."""

    def simulated(**changes: Any) -> Drawn:
        scene = from_settings(Scene, with_values(areas.settings, **changes))
        return errors_by_area(monte_carlo(scene.simulate, areas.other_runs, areas.seed + 4))

    base = simulated()

    def disturbed(
        key: int, part: str, change: Callable[[Array, np.random.Generator, str], Array]
    ) -> Drawn:
        rng = {a: np.random.default_rng([areas.seed, key, int(a)]) for a in AREAS}
        return {**base, part: {a: change(base[part][a], rng[a], a) for a in AREAS}}

    def added(key: int, part: str, *, start: float = 0.0, **sizes: float) -> Drawn:
        """Add errors along x and y from a time on, in m, m/s and m/s^2."""
        return disturbed(
            key, part, lambda e, _, a: e + _ramp(areas.models[a].period, len(e), start, **sizes)
        )

    def wander(e: Array, rng: np.random.Generator, a: str) -> Array:
        return drifting(e, areas.models[a].period, rng, deviation=0.3, correlation_time=2.0)

    def lose(e: Array, rng: np.random.Generator, _: str) -> Array:
        # the first fix is kept, so that all filters start alike
        return np.concatenate([e[:1], losing(e[1:], 0.3, rng)])

    sizes = {"noise": areas.range_noise, "velocity_noise": areas.velocity_noise}
    noisier, precise, tails, late, lost = NOISE
    coloured, jitter, slow, fast, jump = DRIFT
    one, three, nodes, offset, velocities = LASTING
    return {
        UNDISTURBED: base,
        noisier: simulated(**{name: 3 * size for name, size in sizes.items()}),
        precise: simulated(**{name: size / 3 for name, size in sizes.items()}),
        tails: disturbed(5, "wsn", lambda e, rng, _: heavy_tailed(e, 3.0, rng)),
        late: simulated(outlier=0.1, outlier_scale=3.0),
        coloured: disturbed(6, "ins", wander),
        jitter: simulated(jitter=[0.05, 0.05]),
        lost: disturbed(7, "wsn", lose),
        one: simulated(correlation_time=1.0),
        three: simulated(correlation_time=3.0),
        nodes: simulated(node_bias=0.5),
        offset: added(8, "wsn", position=0.14),
        velocities: disturbed(9, "wsn", lambda e, *_: e + np.array([0, 0, 0.14, 0.14])[:, None]),
        slow: added(10, "ins", acceleration=0.7),
        fast: added(11, "ins", acceleration=2.1),
        jump: added(12, "ins", velocity=0.7, start=10.0),
    }


def _ramp(
    period: float,
    steps: int,
    start: float,
    position: float = 0.0,
    velocity: float = 0.0,
    acceleration: float = 0.0,
) -> Array:
    time = np.maximum(period * np.arange(steps) - start, 0)[:, None]
    on = (time > 0) | (start == 0)
    way = on * (position + velocity * time + acceleration * time**2 / 2)
    pace = on * (velocity + acceleration * time)
    return np.concatenate([way, way, pace, pace], axis=1)[:, :, None]


def other_ins(
    areas: TrainingAreas, filters: Mapping[str, Estimator], fitted: Mapping[str, Any]
) -> dict[str, Array]:
    """Return RMS position errors of filters with twenty other INS, (20,), and of the network.

    The errors of another INS are the fitted ones, each times a standard normal number.
    """
    rng = np.random.default_rng([areas.seed, 11])
    found: dict[str, list[float]] = {name: [] for name in ("network", *filters)}
    for _ in range(20):
        values = {name: areas.settings[name].value for name in fitted}
        changed = {
            name: (np.array(v) * rng.standard_normal(np.shape(v))).tolist()
            for name, v in values.items()
        }
        scene = from_settings(Scene, with_values(areas.settings, **changed))
        drawn = errors_by_area(monte_carlo(scene.simulate, 40, areas.seed + 5))
        ins, network = drawn["ins"], drawn["wsn"]
        found["network"].append(rms_by_part(network)["position"])
        for name, estimate in filters.items():
            errors = {a: ins[a] - estimate(a, ins[a] - network[a]) for a in AREAS}
            found[name].append(rms_by_part(errors)["position"])
    return {name: np.array(errors) for name, errors in found.items()}


def losses_by_ratio(contest: FilterContest, ratios: Array) -> dict[str, Array]:
    """Return the losses on the tuning runs of filters that assume these ratios of Q.

    Their second numbers are as tuned, but for `LEAST`, which is 1 % above its least gamma.
    """
    drawn = contest.areas.others
    own = {name: contest.tunings[name].best[1] for name in ("Kalman", HF, "HF, printed LMI")}
    return {
        name: np.array(
            [
                relative_loss(
                    contest.errors(contest.build(HF if name == LEAST else name, q, second), drawn),
                    drawn["wsn"],
                )
                for q in ratios
            ]
        )
        for name, second in (own | {LEAST: 0.01}).items()
    }


def rise_if_mistuned(losses: Array) -> float:
    """Return the larger rise of a loss two places from its least, as a share."""
    best = int(np.argmin(losses))
    off = [losses[i] for i in (best - 2, best + 2) if 0 <= i < len(losses)]
    return float(max(off) / losses[best] - 1)


def mean_nees(contest: FilterContest, ratio: float) -> float:
    """Return the mean NEES of a component of the Kalman filter with this ratio of Q."""
    models = contest.kalman_models(ratio, contest.tunings["Kalman"].best[1])
    errors = contest.errors(kalman(models), contest.areas.drawn)
    there = np.ones((contest.areas.scene.training_samples, 4), dtype=bool)
    return float(
        np.mean(
            [
                np.nanmean(
                    normalised_squares(
                        errors[a],
                        design_kalman(models[a], there, initial_covariance=UNKNOWN).filtered,
                    )
                )
                / 4
                for a in AREAS
            ]
        )
    )


def position_share(contest: FilterContest, estimate: Estimator, drawn: Drawn) -> float:
    """Return the mean absolute position error over that of the network, both areas."""
    errors = contest.errors(estimate, drawn)
    own, its = (
        np.nanmean([np.abs(e[a][:, :2]).mean() for a in AREAS]) for e in (errors, drawn["wsn"])
    )
    return float(own / its)


def with_fixes(areas: TrainingAreas, runs: int, **changes: Any) -> TrainingAreas:
    """Return the areas with other runs, whose fixes are white but for what is changed."""
    white = replace(areas, runs=runs, seed=areas.seed + 7, correlation_time=0.0, node_bias=0.0)
    return replace(white, **changes)


def knowing(contest: FilterContest, lasting: TrainingAreas) -> dict[str, Estimator]:
    """Return filters that know of the correlation time of an area's fixes, or are tuned again."""
    again, time = FilterContest(lasting), lasting.correlation_time
    model = lasting.assuming(contest.tunings["Kalman"].best[0])
    return {
        "Kalman, coloured state": lambda a, y: run_coloured(model[a], time, y),
        "Schmidt": lambda a, y: run_coloured(model[a], time, y, consider=True),
        "Kalman, tuned again": again.build("Kalman", *again.tune("Kalman").best),
        "HF, tuned again": again.build(HF, *again.tune(HF).best),
    }


def knowing_recorded(contest: FilterContest, fits: Sequence[tuple[float, float]]) -> Estimator:
    """Return a filter that knows white share and correlation time of recorded fixes, by axis.

    The fits are those of `fit_correlation`. Velocities are white.
    """
    model = contest.areas.assuming(contest.tunings["Kalman"].best[0])
    times = [*(time for _, time in fits), 0.0, 0.0]
    white = [*(1 - share for share, _ in fits), 1.0, 1.0]
    return lambda a, y: run_coloured(model[a], times, y, white=white)


def on_recorded(
    contest: FilterContest, filters: Mapping[str, Estimator], recorded: Array, runs: int
) -> dict[tuple[str, str], float]:
    """Return `position_share` with the errors of recorded fixes, in order and shuffled."""
    areas = contest.areas
    rng = np.random.default_rng([areas.seed, 14])
    white = with_fixes(areas, runs)
    found = {}
    for label in ("recorded", "shuffled"):
        source = rng.permutation(recorded) if label == "shuffled" else recorded
        drawn = with_recorded(white.drawn, source, rng)
        for name, estimate in filters.items():
            found[label, name] = position_share(contest, estimate, drawn)
    return found
