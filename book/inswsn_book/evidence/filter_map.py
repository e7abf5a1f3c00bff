"""Where each filter is right: the tuned filters under what they do not know of, by how much."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from inswsn_lib.checks import Array
from inswsn_lib.filters import design_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation.filter_contest import (
    PARTS,
    Estimator,
    FilterContest,
    kalman,
    relative_errors,
    run_wandering,
)
from inswsn_lib.navigation.lmi_designs import gain_and_error
from inswsn_lib.navigation.training_areas import AREAS, UNKNOWN, ByArea, TrainingAreas, run_coloured
from inswsn_lib.scenario import with_values

#: Errors of position and of velocity over those of the network
Errors = tuple[float, float]
#: What the map varies, and by how much
GROUNDS: dict[str, tuple[float, ...]] = {
    "bias": (0.0, 0.1, 0.3, 1.0, 3.0),  # m/s^2
    "correlation": (0.0, 0.2, 0.5, 1.0, 2.0, 5.0),  # s
    "assumed-q": (1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4),
    "outliers": (0.0, 2.0, 5.0, 10.0, 20.0),  # %
    "adversary": (0.0, 0.1, 1.0, 10.0, 100.0),  # %
}
_LATE = 3.0  # m, mean excess of a late range
_LASTING = 100.0  # s, longer than an area: to a filter, a bias that does not change


@dataclass(frozen=True, eq=False)
class FilterMap:
    r"""The errors of the filters of a contest over five grounds, each at a few sizes.

    The Kalman filter and the H-infinity filter of the exact inequality are tuned for the scene as
    it is, and changed in nothing. ``hf-least`` is the latter at 1 % above its least gamma, and
    ``told`` a Kalman filter that knows what was changed, and how large it is: by states for a
    lasting acceleration or for a coloured error, by the right Q, by the R of late ranges.
    ``network`` are the fixes. Grounds (see `GROUNDS`):

    - ``bias``: a constant acceleration error of the INS from the start of an area, any direction;
    - ``correlation``: errors of fixes and velocities correlated over time (`coloured`);
    - ``assumed-q``: the Q that filters assume, the same for all, over the one that matches;
    - ``outliers``: ranges that are late, by 3 m on average (exponential);
    - ``adversary``: the share of the energy of the disturbances that is placed where it harms a
      filter most, without end. With white noise of unit variance in the q channels of the model,
      X the covariance of the predicted error and :math:`\gamma` the worst-case gain, the power of
      the error is :math:`(1 - \lambda) \mathrm{tr}\, L X L' + \lambda q \gamma^2`, with L of the
      positions, or of the velocities.

    Attributes
    ----------
    contest : FilterContest
        The tuned filters.
    runs : int
        Of each size of a ground, with another seed than those that tuned.
    """

    contest: FilterContest
    runs: int = 128

    def table(self) -> dict[tuple[str, str], pd.DataFrame]:
        """Return the errors of filters over sizes, by ground and part, of the whole map."""
        found = {}
        for ground, sizes in GROUNDS.items():
            at = {size: self.errors(ground, size) for size in sizes}
            for k, part in enumerate(PARTS):
                rows = {x: {name: each[k] for name, each in of.items()} for x, of in at.items()}
                found[ground, part] = pd.DataFrame.from_dict(rows, orient="index")
        return found

    def errors(self, ground: str, size: float) -> dict[str, Errors]:
        """Return RMS errors of position and velocity over the network's, means of both areas.

        They are errors after the measurement of the step; of ``adversary``, of which no filter can
        be told, the root of the power of predicted ones.

        Parameters
        ----------
        ground : str
            One of `GROUNDS`.
        size : float
            In the unit of the ground.
        """
        if ground == "adversary":
            return self._against_adversary(size / 100)
        drawn = self._drawn(ground, size)
        filters = self._built(size, size) if ground == "assumed-q" else dict(self._filters)
        filters["told"] = self._told(ground, size)
        return {"network": (1.0, 1.0)} | {
            name: relative_errors(self.contest.errors(estimate, drawn), drawn["wsn"])
            for name, estimate in filters.items()
        }

    @cached_property
    def _filters(self) -> dict[str, Estimator]:
        """The filters as they are tuned."""
        return self._built(self._numbers["Kalman"][0], self._numbers["HF, exact LMI"][0])

    def _built(self, kalman_ratio: float, hf_ratio: float) -> dict[str, Estimator]:
        (_, own), (_, margin) = self._numbers["Kalman"], self._numbers["HF, exact LMI"]
        return {
            "kalman": self.contest.build("Kalman", kalman_ratio, own),
            "hf": self.contest.build("HF, exact LMI", hf_ratio, margin),
            "hf-least": self.contest.build("HF, exact LMI", hf_ratio, 0.01),
        }

    @property
    def _numbers(self) -> dict[str, tuple[float, ...]]:
        return {name: search.best for name, search in self.contest.tunings.items()}

    def _told(self, ground: str, size: float) -> Estimator:
        """Return a Kalman filter that knows what was changed."""
        ratio, _ = self._numbers["Kalman"]
        models = self.contest.areas.assuming(ratio)
        if ground == "bias" and size:
            return lambda a, y: run_wandering(models[a], size, y, _LASTING)
        if ground == "correlation" and size:
            return lambda a, y: run_coloured(models[a], size, y)
        if ground == "outliers" and size:
            return kalman(self._areas(ground, size).assuming(ratio))
        return self._filters["kalman"]

    @cached_property
    def _as_it_is(self) -> TrainingAreas:
        return self._changed()

    def _areas(self, ground: str, size: float) -> TrainingAreas:
        if ground not in ("correlation", "outliers") or not size:
            return self._as_it_is  # the scene itself is drawn once
        return self._changed(ground, size)

    def _changed(self, ground: str = "", size: float = 0.0) -> TrainingAreas:
        areas = self.contest.areas
        late = {"outlier": size / 100, "outlier_scale": _LATE} if ground == "outliers" else {}
        return replace(
            areas,
            runs=self.runs,
            seed=areas.seed + 6,
            correlation_time=size if ground == "correlation" else 0.0,
            published=with_values(areas.published, **late),
        )

    def _drawn(self, ground: str, size: float) -> dict[str, ByArea]:
        """Return errors of INS and network at a place of the map."""
        drawn = self._areas(ground, size).drawn
        if ground == "bias":
            drawn = drawn | {"ins": self._with_bias(drawn["ins"], size)}
        return drawn

    def _with_bias(self, ins: Mapping[str, Array], size: float) -> ByArea:
        angle = np.random.default_rng(self.contest.areas.seed + 7).uniform(0, 2 * np.pi, self.runs)
        bias = size * np.stack([np.cos(angle), np.sin(angle)])
        found = {}
        for a, period in zip(AREAS, self.contest.areas.scene.periods, strict=True):
            time = period * np.arange(len(ins[a]))[:, None, None]
            added = np.concatenate([bias * time**2 / 2, bias * time], axis=1)
            found[a] = ins[a] + added
        return found

    def _against_adversary(self, share: float) -> dict[str, Errors]:
        """Return the errors where a share of the energy is placed by an adversary."""
        powers = {
            name: (1 - share) * white**2 + share * channels * worst**2
            for name, (channels, white, worst) in self._steady.items()
        }
        found = {}
        for name, power in powers.items():
            position, velocity = np.sqrt(power / powers["network"]).mean(axis=0)
            found[name] = float(position), float(velocity)
        return found

    @cached_property
    def _steady(self) -> dict[str, tuple[int, Array, Array]]:
        """Of each filter: channels, RMS under white noise and worst-case gain, (areas, parts)."""
        matched, areas = self.contest.areas.matched, self.contest.areas
        (q, own), (ratio, margin) = self._numbers["Kalman"], self._numbers["HF, exact LMI"]
        models, steps = areas.assuming(ratio), areas.scene.training_samples
        designs = {g: self.contest.designs("exact", models, g) for g in (margin, 0.01)}
        gains: dict[str, dict[str, Array]] = {
            "network": {a: matched[a].A for a in AREAS},
            "kalman": {
                a: last_gain(m, steps) for a, m in self.contest.kalman_models(q, own).items()
            },
            "hf": {a: design.gain for a, design in designs[margin].items()},
            "hf-least": {a: design.gain for a, design in designs[0.01].items()},
        }
        seen = [np.eye(4)[rows] for rows in PARTS.values()]
        found = {}
        for name, gain in gains.items():
            parts = [[(replace(matched[a], L=L), gain[a]) for L in seen] for a in AREAS]
            both = [[gain_and_error(*part) for part in of_area] for of_area in parts]
            worst, white = np.transpose(both, (2, 0, 1))
            found[name] = matched["1"].B.shape[1] + matched["1"].D.shape[1], white, worst
        return found


def last_gain(model: ErrorModel, steps: int) -> Array:
    """Return the gain of the Kalman predictor at the end of an area."""
    there = np.ones((steps, len(model.C)), dtype=bool)
    return np.asarray(model.A @ design_kalman(model, there, initial_covariance=UNKNOWN).gains[-1])
