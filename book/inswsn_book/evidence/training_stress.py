"""The filters of P1's areas where something is other than they assume."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from inswsn_book.evidence.training_table import with_recorded
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import monte_carlo, normalised_squares
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
Drawn = Mapping[str, ByArea]


def rms_by_part(errors: ByArea) -> dict[str, float]:
    """Return the RMS errors of position and velocity, means of both areas."""
    return {
        part: float(np.mean([root_mean_square(e[:, rows]) for e in errors.values()]))
        for part, rows in PARTS.items()
    }


def stress(contest: FilterContest) -> dict[tuple[str, str], dict[str, float]]:
    """Return RMS errors by case and part, then by filter, where assumptions are broken.

    The filters keep theirs: the published HF, the Kalman filter with matched noise, and those of
    the contest as they are tuned. The first case is as they assume.
    """
    tuned, estimate = contest.tuned, contest.areas.estimate
    filters: dict[str, Estimator] = {
        "HF, published": partial(estimate, "hf-printed-filtered"),
        "Kalman, matched": partial(estimate, "kf-matched-filtered"),
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
            key,
            part,
            lambda e, _, a: e + _ramp(areas.models[a].period, len(e), start, **sizes),
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
        "as assumed": base,
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


def on_recorded(
    contest: FilterContest,
    filters: Mapping[str, Estimator],
    recorded: Array,
    runs: int,
) -> dict[tuple[str, str], float]:
    """Return `position_share` with the errors of recorded fixes, in order and shuffled."""
    areas = contest.areas
    rng = np.random.default_rng([areas.seed, 14])
    white = replace(areas, runs=runs, seed=areas.seed + 7, correlation_time=0.0, node_bias=0.0)
    found = {}
    for label in ("recorded", "shuffled"):
        source = rng.permutation(recorded) if label == "shuffled" else recorded
        drawn = with_recorded(white.drawn, source, rng)
        for name, estimate in filters.items():
            found[label, name] = position_share(contest, estimate, drawn)
    return found
