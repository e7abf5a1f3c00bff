"""What P1's Kalman filter may have been: hypotheses, and what each predicts of a printed row."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import pandas as pd

from inswsn_book.evidence.drift_family import Correction, DriftFamily, fit_drifts
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Prediction, Score, score_hypothesis, tune
from inswsn_lib.filters import design_kalman, run_hinfinity, run_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation.filter_contest import Estimator, kalman
from inswsn_lib.navigation.training_areas import (
    AREAS,
    ByArea,
    TrainingAreas,
    noise_sizes,
    table2_cells,
)
from inswsn_lib.papers import COLUMNS

#: An axis in an area and the outage after it
PASSAGES = ("x1", "x2", "y1", "y2")
#: The degrees of the two families of drifts
DEGREES = (3, 5)
SET_TO_ZERO = "$Q = R = P_0 = I$, state set to zero, INS never corrected"
STARTS = 200
#: Hypotheses of which the text tells, by the names of their numbers
TOLD = {
    "zero": SET_TO_ZERO,
    "one-step": "the same, carried one step",
    "q": "the same, $Q = qI$",
    "diagonal": "the same, diagonal of the last gain alone",
    "share": "a share of INS-only",
    "large-r": "$R$ larger than matched by a factor",
}
_UNIT = np.eye(4)
_Models = Mapping[str, ErrorModel]


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A filter, made from a number where it has one that is free."""

    build: Callable[[float], Estimator]
    grid: Array | None = None  # from which its number is chosen
    first: int = 0  # samples without an estimate
    noise: float = 1.0  # factor on that of the network


def unit_gains(models: _Models, samples: int = 100) -> dict[str, Array]:
    """Return the gains in every step of Kalman filters that begin with P_0 = I, by area."""
    return {
        a: design_kalman(
            model, np.ones((samples, len(model.C)), dtype=bool), initial_covariance=_UNIT
        ).gains
        for a, model in models.items()
    }


def kalman_hypotheses(areas: TrainingAreas) -> tuple[dict[str, Hypothesis], dict[str, Hypothesis]]:
    """Return hypotheses of P1's Kalman filter: those without memory, and those with it."""
    steady, matched, samples = areas.identity, areas.matched, areas.scene.training_samples
    gains = unit_gains(steady, samples)
    slow = dict.fromkeys(AREAS, ErrorModel.p1(1.0))
    positions = {a: replace(steady[a], C=_UNIT[:2], D=np.eye(2)) for a in AREAS}
    at_positions = {a: gain @ _UNIT[:2] for a, gain in unit_gains(positions, samples).items()}

    def assuming(q: float) -> dict[str, ErrorModel]:
        return {a: model.with_covariances(q * _UNIT, _UNIT) for a, model in steady.items()}

    def carried_on(a: str, y: Array) -> Array:
        return np.concatenate([0 * y[:1], (steady[a].A @ (gains[a] @ y))[:-1]])

    def noisier(factor: float) -> Estimator:
        return kalman(
            {
                a: m.with_covariances(m.process_covariance, factor * m.measurement_covariance)
                for a, m in matched.items()
            }
        )

    diagonal = {a: np.diag(np.diag(gain[-1])) for a, gain in gains.items()}
    set_to_zero = {
        SET_TO_ZERO: _fixed(_reset(gains)),
        "the same, carried one step": _fixed(carried_on, 1),
        "the same, $Q = qI$": Hypothesis(
            lambda q: _reset(unit_gains(assuming(q), samples)), np.geomspace(0.5, 2, 21)
        ),
        "the same, diagonal of the last gain alone": _fixed(_reset(diagonal)),
        "the same, covariance set back to $Q$ as well": _fixed(
            _reset(dict.fromkeys(AREAS, 0.5 * _UNIT))
        ),
        "the same, $T = 1$ s in the model": _fixed(_reset(unit_gains(slow, samples))),
        "the same, positions alone": _fixed(_reset(at_positions)),
        "a share of INS-only": Hypothesis(
            lambda c: lambda a, y: (1 - c) * y, np.linspace(0.3, 0.45, 31), noise=0.0
        ),
    }
    begun = partial(kalman, covariance=_UNIT)
    return set_to_zero, {
        "$Q = R = P_0 = I$, carried on, filtered": _fixed(begun(steady)),
        "$Q = R = P_0 = I$, carried on, predicted": _fixed(begun(steady, predicted=True), 1),
        "matched noise, filtered": _fixed(kalman(matched)),
        "matched noise, predicted": _fixed(kalman(matched, predicted=True), 1),
        "positions alone, $Q = R = I$": _fixed(
            lambda a, y: run_kalman(positions[a], y[:, :2], initial_covariance=_UNIT)
        ),
        "$T = 1$ s in the model, $Q = R = I$": _fixed(begun(slow)),
        "$Q = 10^{-8} I$, $R = I$": _fixed(begun(assuming(1e-8))),
        "$Q = qI$ too small, $R = I$": Hypothesis(
            lambda q: begun(assuming(q)), np.logspace(-10, 0, 21)
        ),
        "$R$ larger than matched by a factor": Hypothesis(noisier, np.logspace(0, 12, 25)),
    }


@dataclass(frozen=True, eq=False)
class RowPredictions:
    """What hypotheses predict of a printed row, from drifts that meet the cells of INS-only.

    Attributes
    ----------
    areas : TrainingAreas
    ins_cells : mapping
        By passage: position and velocity in the area, then in the outage.
    row : mapping
        The printed cells of a filter, by column of Table 2.
    """

    areas: TrainingAreas
    ins_cells: Mapping[str, Array]
    row: Mapping[str, float]

    @cached_property
    def families(self) -> dict[tuple[int, str], DriftFamily]:
        """The drifts by degree and passage."""
        scene = self.areas.scene
        return {
            (degree, p): DriftFamily(
                scene.periods[AREAS.index(p[1])],
                scene.training_samples,
                scene.outage_samples,
                degree,
            )
            for degree in DEGREES
            for p in PASSAGES
        }

    @cached_property
    def _fitted(self) -> dict[tuple[int, str], tuple[Array, Array, Array]]:
        """Starts, the drifts that meet the cells, and 400 of these; the nearest if none does."""
        found = {}
        for degree in DEGREES:
            rng = np.random.default_rng([self.areas.seed, 8, degree])
            for p in PASSAGES:
                family, cells = self.families[degree, p], self.ins_cells[p]
                starts = family.draw_starts(cells, STARTS, rng)
                fits = fit_drifts(family, cells, starts)
                nearest = np.abs(fits.ratios - 1).max(axis=1).min()
                met = fits.meeting(max(1e-4, 1.01 * nearest))
                found[degree, p] = starts, met, met[rng.integers(len(met), size=400)]
        return found

    def distinct(self, passage: str) -> int:
        """Return how many cubic drifts meet the cells of a passage, without their negatives."""
        met = self._fitted[3, passage][1]
        start = np.sort(met[:, 0] * np.sign(met[:, -1]))
        return 1 + int(np.sum(np.diff(start) > 1e-3 * np.abs(start).max()))

    def predict(self, hypothesis: Hypothesis) -> tuple[float | None, dict[int, Prediction]]:
        """Return the free number with the best score by cubics, and the prediction by degree."""
        number = None
        if hypothesis.grid is not None:
            loss = lambda number: self._predict(hypothesis, number, 3).score  # noqa: E731
            number = float(tune("number", hypothesis.grid.tolist(), loss).best)
        return number, {d: self._predict(hypothesis, number, d) for d in DEGREES}

    def worst_fit(self, hypothesis: Hypothesis) -> float:
        """Return by how much the worst cell is off where cubics are fitted to the row as well, %.

        For a hypothesis without a free number.
        """
        maps, ratios = self._maps(hypothesis, None), []
        for p in PASSAGES:
            cells = np.append(self.ins_cells[p], [self.row[kind + p] for kind in "rv"])
            starts, family = self._fitted[3, p][0][:30], self.families[3, p]
            ratios.append(fit_drifts(family, cells, starts, maps[p[1]], most=100).best())
        return float(100 * np.abs(np.array(ratios) - 1).max())

    def _maps(self, hypothesis: Hypothesis, number: float | None) -> dict[str, Correction]:
        estimate = hypothesis.build(np.nan if number is None else number)
        samples, noise = self.areas.scene.training_samples, self.areas.noise
        sizes = {a: hypothesis.noise * np.array(noise_sizes(noise[a].measurement)) for a in AREAS}
        return {
            a: Correction.of(partial(estimate, a), samples, sizes[a], hypothesis.first)
            for a in AREAS
        }

    def _predict(self, hypothesis: Hypothesis, number: float | None, degree: int) -> Prediction:
        maps, rng = self._maps(hypothesis, number), np.random.default_rng([self.areas.seed, 9])
        drawn = [
            maps[p[1]].draw_cells(self.families[degree, p], self._fitted[degree, p][2], rng)
            for p in PASSAGES
        ]
        # from passages, drifts, kinds to the order of the columns
        cells = np.moveaxis(np.array(drawn), 2, 0).reshape(len(COLUMNS), -1)
        return Prediction(cells / np.array([self.row[c] for c in COLUMNS])[:, None])


Predicted = Mapping[str, tuple[float | None, dict[int, Prediction]]]


def plainly(name: str) -> str:
    """Return the name of a hypothesis without the signs of formulas."""
    return name.replace("$", "").replace("P_0", "P₀")


def table_of_predictions(predicted: Predicted) -> pd.DataFrame:
    """Return how the hypotheses of `RowPredictions` do, the best by cubics first."""
    rows = {}
    for name, (number, by_degree) in predicted.items():
        rows[name] = {"free number": "–" if number is None else f"{number:.2g}"}
        for family, each in zip(("cubic", "degree 5"), by_degree.values(), strict=True):
            rows[name] |= {
                f"cells in the interval, {family}": f"{each.inside} of 8",
                f"width, {family}": f"{each.width:.2f}",
                f"score, {family}": f"{each.score:.3f}",
            }
    ranked = sorted(predicted, key=lambda name: predicted[name][1][DEGREES[0]].score)
    return pd.DataFrame.from_dict(rows, orient="index").loc[ranked].rename_axis("hypothesis")


def score_without(prediction: Prediction, column: str) -> float:
    """Return the mean score of all printed cells but one."""
    return float(np.delete(prediction.scores, COLUMNS.index(column)).mean())


def hinfinity_hypotheses(
    areas: TrainingAreas, printed: Mapping[str, float]
) -> dict[str, tuple[str, Score]]:
    """Return what P1's H-infinity filter may have been fed: a fitted number, and the score.

    Parameters
    ----------
    areas : TrainingAreas
    printed : mapping
        The printed cells of HF, by column of Table 2.
    """
    ins, wsn, scene = areas.drawn["ins"], areas.drawn["wsn"], areas.scene
    y = {a: ins[a] - wsn[a] for a in AREAS}
    one_second = ErrorModel.p1(1.0).A
    velocity = {
        a: scene.path.drive(scene.speed, scene.windows[f"area{a}"].times).velocity[:, :, None]
        for a in AREAS
    }
    offset = np.random.default_rng([areas.seed, 3]).standard_normal((2, areas.runs))

    def fed(change: Callable[[str, Array], Array]) -> ByArea:
        """Return errors of the published filter with changed positions of the fixes."""
        found = {}
        for a in AREAS:
            fixes = wsn[a].copy()
            fixes[:, :2] = change(a, fixes[:, :2])
            estimate = areas.estimate("hf-printed-predicted", a, ins[a] - fixes)
            found[a] = (ins[a] - estimate)[1:]
        return found

    def rate(errors: ByArea, free: int) -> Score:
        """Score a hypothesis; the velocity noise is one more number that was chosen."""
        cells = table2_cells(errors)
        middle = [float(np.median(cells[c])) for c in COLUMNS]
        return score_hypothesis(middle, [printed[c] for c in COLUMNS], free + 1)

    fixed = {
        "printed matrices, predicted": areas.errors("hf-printed-predicted"),
        "printed matrices, filtered": areas.errors("hf-printed-filtered"),
        "the same, from a zero state, first step kept": {
            a: ins[a] - run_hinfinity(areas.deadbeat[a], y[a], predicted=True) for a in AREAS
        },
        "exact LMI, identities, predicted": areas.errors("hf-exact-identity-predicted"),
        "measurement one step late, not carried": {a: ins[a][1:] - y[a][:-1] for a in AREAS},
        "carried by $T = 1$ s": {a: ins[a][1:] - (one_second @ y[a])[:-1] for a in AREAS},
    }
    fitted: dict[str, tuple[Array, Callable[[float], ByArea]]] = {
        "fixes that are late (s)": (
            np.linspace(0, 0.4, 41),
            lambda late: fed(lambda a, p: p - late * velocity[a]),
        ),
        "fixes worse by a factor": (
            np.linspace(1, 8, 36),
            lambda factor: fed(lambda _, p: factor * p),
        ),
        "fixes with a constant offset (m, 1 sigma)": (
            np.linspace(0, 1.5, 31),
            lambda size: fed(lambda _, p: p + size * offset),
        ),
    }
    found = {name: ("–", rate(errors, 0)) for name, errors in fixed.items()}
    for name, (numbers, build) in fitted.items():
        scores = {number: rate(build(number), 1) for number in numbers}
        best = min(scores, key=lambda number: scores[number].spread)
        found[name] = f"{best:.2g}", scores[best]
    return found


def table_of_scores(scores: Mapping[str, tuple[str, Score]]) -> pd.DataFrame:
    """Return rebuilt over printed cells by hypothesis, from `hinfinity_hypotheses`."""
    rows = {
        name: {"fitted": number, "met": f"{score.met}"}
        | {
            f"${c[0]}_{c[1]}$ {c[2]}": f"{r:.2f}"
            for c, r in zip(COLUMNS, score.ratios, strict=True)
        }
        | {"spread": f"{score.spread:.2f}"}
        for name, (number, score) in scores.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("hypothesis")


def _fixed(estimate: Estimator, first: int = 0) -> Hypothesis:
    return Hypothesis(lambda _: estimate, first=first)


def _reset(gains: Mapping[str, Array]) -> Estimator:
    """Return a filter whose state is set to zero in each step."""
    return lambda a, y: gains[a] @ y
