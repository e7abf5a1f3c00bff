"""P1's two training areas as a Monte Carlo: the scene, assumed noise, the filters, their errors.

This is what evidence p1-training computes over many runs, a function of its parameters.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import (
    Finding,
    NoiseFit,
    Scores,
    fit_noise,
    mean_absolute_error,
    monte_carlo,
    quotient,
)
from inswsn_lib.files import data_file
from inswsn_lib.filters import deadbeat_gain, run_hinfinity, run_kalman, run_schmidt
from inswsn_lib.lmi import FilterDesign, design_filter
from inswsn_lib.lmi.designs import Form, Solver
from inswsn_lib.models import ErrorModel
from inswsn_lib.papers import AXES, COLUMNS
from inswsn_lib.scenario import Setting, from_settings, load_scenario, with_values
from inswsn_lib.simulation import Scene

#: An array for each area, ``"1"`` and ``"2"``
ByArea = dict[str, Array]
#: Designs by the form of the inequality, ``"exact"`` or ``"printed"``, and by area
Designs = dict[str, dict[str, FilterDesign]]

AREAS = "12"
# Errors of the INS that are fitted, and its start
_INERTIAL = (
    "accelerometer_bias", "accelerometer_scale", "gyro_bias", "heading", "velocity", "position",
)  # fmt: skip
#: P_0 of the Kalman filters: they know nothing before the first measurement
UNKNOWN = 1e6 * np.eye(4)
#: The methods that `TrainingAreas.scores` compares, of those that `TrainingAreas.estimate` knows
SCORED = {
    "ins": "INS alone",
    "wsn": "network alone = published HF, filtered",
    "kf-matched-filtered": "KF, filtered",
    "kf-identity-filtered": "KF, Q = R = I, filtered",
    "hf-exact-matched-filtered": "HF, exact LMI, filtered",
    "hf-printed-matched-filtered": "HF, printed LMI, filtered",
    "hf-printed-predicted": "published HF, predicted",
}


def p1_settings() -> dict[str, Setting]:
    """Return the settings of P1's scene and of the INS that fits its cells."""
    scene, fitted = (data_file(f"scenarios/{name}.yaml") for name in ("p1", "p1-inertial"))
    return load_scenario(scene) | load_scenario(fitted)


@dataclass(frozen=True, eq=False)
class P1Runs(ABC):
    """P1's scene in many runs, and the noise that its filters assume: see `TrainingAreas`."""

    scenarios: ClassVar[tuple[str, ...]] = ("p1", "p1-inertial")

    published: Mapping[str, Setting] = field(default_factory=p1_settings)
    seed: int = 2012
    runs: int = 1024
    range_noise: float = 0.38
    correlation_time: float = 0.0
    node_bias: float = 0.0
    inertial_scale: float = 1.0

    @cached_property
    def settings(self) -> dict[str, Setting]:
        """The settings of the scene with these parameters."""
        scaled = {
            name: np.multiply(self.published[name].value, self.inertial_scale) for name in _INERTIAL
        }
        return with_values(
            self.published,
            noise=self.range_noise,
            correlation_time=self.correlation_time,
            node_bias=self.node_bias,
            **scaled,
            **self._changes(),
        )

    def _changes(self) -> dict[str, Any]:
        """Return other settings that parameters change."""
        return {}

    @cached_property
    def scene(self) -> Scene:
        """The scene."""
        return from_settings(Scene, self.settings)

    @property
    @abstractmethod
    def _fitted_to(self) -> Mapping[str, ByArea]:
        """Errors in runs of the next seed, from which noise figures are fitted."""

    @cached_property
    def models(self) -> dict[str, ErrorModel]:
        """P1's model of each area without its jitter, noise of one unit."""
        return {a: ErrorModel.p1(self.scene.windows[f"area{a}"].period) for a in AREAS}

    @cached_property
    def noise(self) -> dict[str, NoiseFit]:
        """Q and R of each area that match the simulation."""
        ins, network = self._fitted_to["ins"], self._fitted_to["wsn"]
        return {a: fit_noise(model.A, ins[a], network[a]) for a, model in self.models.items()}

    def assuming(self, ratio: float) -> dict[str, ErrorModel]:
        """Return the models that assume Q to be this many times the one that matches."""
        models = {}
        for a, fit in self.noise.items():
            position, velocity = noise_sizes(fit.process)
            models[a] = ErrorModel.p1(
                self.models[a].period,
                process_noise=(ratio**0.5 * position, ratio**0.5 * velocity),
                measurement_noise=noise_sizes(fit.measurement),
            )
        return models


@dataclass(frozen=True, eq=False)
class TrainingAreas(P1Runs):
    r"""P1's scene with its network, what the filters of p1-training assume, and their errors.

    The filters assume one standard deviation for position and one for velocity of Q and of R,
    fitted to other runs (`inswsn_lib.evaluation.fit_noise`): they are *matched*.

    **What is held when the time is scaled.** The path sample by sample: the speed goes with one
    over `time_scale`, and the periods, the times before and between the areas and the interval of
    the inertial sensors with it. The errors of the sensors keep their values in SI units, and so do
    the start of the INS, the noise of the network and the jitter. So an INS drifts for five times
    as long at a period of 1 s as at 0.2 s; its errors were fitted to P1's table at 0.2 s only.

    Attributes
    ----------
    published : mapping of str to Setting
        The scenario files ``p1`` and ``p1-inertial``, joined.
    seed, runs : int
        Of all random numbers; runs that are judged.
    other_runs : int
        Runs of the next seed, from which noise figures are fitted.
    period_area1, period_area2 : float
        Sampling periods, s.
    speed : float
        m/s.
    range_noise : float
        Standard deviation of a range, m.
    velocity_source, velocity_noise, correlation_time
        As in `inswsn_lib.simulation.Scene`.
    node_bias : float
        As in `inswsn_lib.simulation.Ranging`.
    accelerometer_noise, gyro_noise : float
        m/s/s^0.5 and rad/s^0.5.
    inertial_scale, q_scale, time_scale : float
        Factors on the fitted errors of the INS, on the Q that matched filters assume, and on
        periods and times; the speed is divided by the last.
    solver : {"clarabel", "scs"}
        Of the designs; where an answer of SCS is refused, Clarabel is asked.

    Examples
    --------
    At 1 s the node walks, and the area begins at the same place of the path:

    >>> from inswsn_lib.navigation import TrainingAreas
    >>> for areas in (TrainingAreas(), TrainingAreas(time_scale=5.0)):
    ...     print(areas.scene.periods[0], areas.scene.speed, areas.scene.speed * areas.scene.lead)
    0.2 7.5 130.8
    1.0 1.5 130.8
    """

    other_runs: int = 256
    period_area1: float = 0.2
    period_area2: float = 0.21
    speed: float = 7.5
    velocity_source: str = "sensor"
    velocity_noise: float = 0.126
    accelerometer_noise: float = 0.005
    gyro_noise: float = 0.0005
    q_scale: float = 1.0
    time_scale: float = 1.0
    solver: Solver = "clarabel"

    def _changes(self) -> dict[str, Any]:
        slower = self.time_scale
        times = ("lead", "between", "inertial_interval")
        same = ("velocity_source", "velocity_noise", "accelerometer_noise", "gyro_noise")
        return {
            "periods": [slower * self.period_area1, slower * self.period_area2],
            "speed": self.speed / slower,
            **{name: getattr(self, name) for name in same},
            **{name: slower * self.published[name].value for name in times},
        }

    @cached_property
    def drawn(self) -> dict[str, ByArea]:
        """Errors of ``ins`` and ``wsn`` in the runs that are judged, by area, (steps, 4, runs)."""
        return errors_by_area(monte_carlo(self.scene.simulate, self.runs, self.seed))

    @cached_property
    def others(self) -> dict[str, ByArea]:
        """The same in the runs from which noise figures are fitted."""
        return errors_by_area(monte_carlo(self.scene.simulate, self.other_runs, self.seed + 1))

    @property
    def _fitted_to(self) -> Mapping[str, ByArea]:
        return self.others

    def told(self, q_scale: float) -> TrainingAreas:
        """Return the same runs, with filters that assume another multiple of Q."""
        other = replace(self, q_scale=q_scale)
        # what is drawn does not depend on what filters assume
        shared = ("scene", "drawn", "others", "noise")
        vars(other).update({name: getattr(self, name) for name in shared})
        return other

    @cached_property
    def models(self) -> dict[str, ErrorModel]:
        """P1's model of each area with its jitter, noise of one unit."""
        periods = zip(AREAS, self.scene.periods, self.scene.jitter, strict=True)
        return {a: ErrorModel.p1(period, jitter) for a, period, jitter in periods}

    @cached_property
    def identity(self) -> dict[str, ErrorModel]:
        """The same without the jitter, Q = R = I."""
        return {a: replace(model, E=np.zeros((4, 4))) for a, model in self.models.items()}

    @cached_property
    def matched(self) -> dict[str, ErrorModel]:
        """The models that matched filters assume."""
        return self.assuming(self.q_scale)

    @cached_property
    def matched_designs(self) -> Designs:
        """H-infinity filters that assume the noise of `matched`."""
        return self._designs(self.matched)

    @cached_property
    def identity_designs(self) -> Designs:
        """H-infinity filters that assume B = D = I."""
        return self._designs(self.identity)

    def _designs(self, models: Mapping[str, ErrorModel]) -> Designs:
        design = partial(design_filter, solver=(self.solver, "clarabel"))
        return {f: {a: design(m, f) for a, m in models.items()} for f in get_args(Form)}

    @cached_property
    def deadbeat(self) -> dict[str, tuple[ErrorModel, Array]]:
        """The published filter, as the model and the printed gain, B_f = A."""
        return {a: (model, deadbeat_gain(model)) for a, model in self.identity.items()}

    def estimate(self, method: str, area: str, y: Array) -> Array:
        """Return what a method estimates the error of the INS to be.

        Parameters
        ----------
        method : str
            ``ins`` or ``wsn``, which is all or none of it; or a filter and whether it has seen the
            measurement of the step, ``filtered`` or ``predicted``: ``kf-TOLD-filtered``,
            ``hf-FORM-TOLD-filtered`` with FORM ``exact`` or ``printed``, or, for the printed
            matrices, ``hf-printed-filtered``. TOLD is ``matched`` or ``identity``; ``kf-coloured``
            and ``kf-schmidt`` are matched and know the correlation time (`run_coloured`).
        area : {"1", "2"}
        y : ndarray, (steps, 4, runs)
            INS less network.

        Returns
        -------
        ndarray, (steps, 4, runs)
        """
        if method in ("ins", "wsn"):
            return y if method == "wsn" else 0 * y
        family, *told, word = method.split("-")
        predicted = word == "predicted"
        if told in (["coloured"], ["schmidt"]):
            model, time = self.matched[area], self.correlation_time
            return run_coloured(model, time, y, consider=told == ["schmidt"], predicted=predicted)
        if family == "kf":
            model = (self.matched if told == ["matched"] else self.identity)[area]
            return run_kalman(model, y, initial_covariance=UNKNOWN, predicted=predicted)
        design: FilterDesign | tuple[ErrorModel, Array] = self.deadbeat[area]
        if told != ["printed"]:
            designs = self.matched_designs if told[1] == "matched" else self.identity_designs
            design = designs[told[0]][area]
        return run_hinfinity(design, y, initial_state=first_measured(y), predicted=predicted)

    def errors(self, method: str) -> ByArea:
        """Return the errors of a method, as in `estimate`, by area, (steps, 4, runs), m and m/s.

        There is no prediction of the first step, so predicted errors leave it out. Every method is
        judged on the same samples: NaN where the network has no fix, or no velocity.
        """
        ins, network = self.drawn["ins"], self.drawn["wsn"]
        if method == "wsn":  # and not INS less (INS less network), which rounds
            return network
        first = 1 if method.endswith("predicted") else 0
        errors = {a: ins[a] - self.estimate(method, a, ins[a] - network[a]) for a in AREAS}
        return {a: np.where(np.isnan(network[a]), np.nan, e)[first:] for a, e in errors.items()}

    def scores(self) -> Scores:
        """Return the cells of P1's Table 2 for each of `SCORED`, and their means.

        A cell is the mean absolute error of a run over the samples of an area. ``position`` and
        ``velocity`` are the means of the four cells each.
        """
        cells = {method: table2_cells(self.errors(method)) for method in SCORED}
        values = {
            f"{method}.{column}": cell
            for method, columns in cells.items()
            for column, cell in _with_means(columns).items()
        }
        units = {c: "m" if c[0] == "r" else "m/s" for c in COLUMNS}
        return Scores(
            methods=SCORED,
            columns=units | {"position": "m", "velocity": "m/s"},
            values=values,
            headline="position",
            baselines=frozenset({"ins"}),
            findings=table2_findings(cells),
        )


def first_measured(y: Array) -> Array:
    """Return the first measurement of each component and run, (4, runs); 0 where there is none.

    Parameters
    ----------
    y : ndarray, (steps, 4, runs)
        INS less network, NaN where the network is not heard.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import first_measured
    >>> first_measured(np.array([[[np.nan, 1.0]], [[2.0, 3.0]]])).tolist()
    [[2.0, 1.0]]
    """
    first = np.argmax(~np.isnan(y), axis=0)
    return np.asarray(np.nan_to_num(np.take_along_axis(y, first[None], axis=0)[0]))


def run_coloured(
    model: ErrorModel,
    correlation_time: ArrayLike,
    y: Array,
    *,
    white: ArrayLike = 1e-12,
    consider: bool = False,
    predicted: bool = False,
) -> Array:
    """Run a Kalman filter that knows that errors of fixes are correlated; it knows nothing else.

    Parameters
    ----------
    model : ErrorModel
        Of the INS, with four states and the R of the fixes.
    correlation_time : float or array_like, (4,)
        Of the errors of fixes and velocities, s. If all are white, with 0, it is `run_kalman`.
    y : ndarray, (steps, 4) or (steps, 4, runs)
        INS less network.
    white : float or array_like, (4,)
        Share of the variance of these errors that is white all the same.
    consider : bool
        Whether these errors are considered, as by `run_schmidt`, and not estimated.
    predicted : bool
        As in `run_kalman`.

    Returns
    -------
    ndarray, (steps, 4) or (steps, 4, runs)
        The error of the INS.

    Examples
    --------
    After a first measurement it has its fix, and of the same error no later one tells more:

    >>> import inswsn_lib as iw, numpy as np
    >>> from inswsn_lib.navigation import run_coloured
    >>> model, y = iw.ErrorModel.p1(0.2), np.ones((3, 4))
    >>> run_coloured(model, 1.0, y)[0].round(4).tolist()
    [1.0, 1.0, 1.0, 1.0]
    """
    if not np.any(correlation_time):
        return run_kalman(model, y, initial_covariance=UNKNOWN, predicted=predicted)
    knowing = model.with_coloured_noise(correlation_time, white)
    start = block_diag(UNKNOWN, (1 - np.asarray(white)) * model.measurement_covariance)
    if consider:
        return run_schmidt(
            knowing, y, considered=len(y[0]), initial_covariance=start, predicted=predicted
        )
    return run_kalman(knowing, y, initial_covariance=start, predicted=predicted)[:, :4]


def errors_by_area(drawn: Mapping[str, Array]) -> dict[str, ByArea]:
    """Return what `Scene.simulate` gives as errors of ``ins`` and ``wsn`` by area, no outages.

    Examples
    --------
    >>> from inswsn_lib.navigation import errors_by_area
    >>> errors_by_area({f"{part}.area{a}": 0.0 for part in ("ins", "wsn") for a in "12"})
    {'ins': {'1': 0.0, '2': 0.0}, 'wsn': {'1': 0.0, '2': 0.0}}
    """
    return {part: {a: drawn[f"{part}.area{a}"] for a in AREAS} for part in ("ins", "wsn")}


def noise_sizes(moment: Array) -> tuple[float, float]:
    """Return one standard deviation for position and one for velocity of a second moment, (4, 4).

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import noise_sizes
    >>> noise_sizes(np.diag([4.0, 4.0, 9.0, 9.0]))
    (2.0, 3.0)
    """
    position, velocity = np.sqrt(np.diag(moment).reshape(2, 2).mean(axis=1))
    return float(position), float(velocity)


def table2_cells(errors: ByArea) -> ByArea:
    """Return the mean absolute errors of every run, (runs,), by column of P1's Table 2.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import table2_cells
    >>> table2_cells({"1": np.ones((100, 4, 2)), "2": -2 * np.ones((100, 4, 2))})["rx2"].tolist()
    [2.0, 2.0]
    """
    means = {a: mean_absolute_error(errors[a]) for a in AREAS}
    return {axis + a: means[a][i] for i, axis in enumerate(AXES) for a in AREAS}


def table2_findings(cells: Mapping[str, ByArea]) -> dict[str, Finding]:
    """Return what Table 2 amounts to: shares of position cells, sums of medians over the runs.

    Parameters
    ----------
    cells : mapping of str to dict of str to ndarray, (runs,)
        Of methods, at least those of `SCORED`, as `table2_cells` gives them.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import table2_findings
    >>> from inswsn_lib.navigation.training_areas import SCORED
    >>> size = {"kf-matched-filtered": 1.0}
    >>> columns = [axis + area for axis in ("rx", "ry") for area in "12"]
    >>> cells = {m: {c: np.full(50, size.get(m, 2.0)) for c in columns} for m in SCORED}
    >>> table2_findings(cells)["headline.kf-share"].value
    50.0
    """

    def share(method: str, rival: str, unit: str, words: str, areas: str = AREAS) -> Finding:
        columns = [axis + a for axis in ("rx", "ry") for a in areas]
        one, other = ([cells[m][c] for c in columns] for m in (method, rival))
        return quotient(one, other, unit, f"Position cells of {words}")

    over = "over those of the published HF, sums of medians, both filtered."
    hf = "hf-printed-filtered" if "hf-printed-filtered" in cells else "wsn"  # it is the fixes
    exact = "HF, exact LMI, matched noise, over those of KF, matched noise,"
    return {
        "headline.kf-share": share("kf-matched-filtered", hf, "%", f"KF with matched noise {over}"),
        "headline.identity-share": share(
            "kf-identity-filtered", hf, "%", f"KF with Q = R = I {over}"
        ),
    } | {
        f"exact.over-kalman.{a}": share(
            "hf-exact-matched-filtered", "kf-matched-filtered", "1",
            f"{exact} area {a}, filtered, sums of medians.", a,
        )
        for a in AREAS
    }  # fmt: skip


def _with_means(cells: ByArea) -> ByArea:
    """Return the cells of a method and the means over those of position and of velocity."""
    kinds = {"position": "r", "velocity": "v"}
    return cells | {
        name: np.asarray(np.mean([cells[c] for c in COLUMNS if c[0] == kind], axis=0))
        for name, kind in kinds.items()
    }
