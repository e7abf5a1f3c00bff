"""Filters on equal terms: two numbers each, the same trials, tuned on the same runs.

This is what evidence p1-training compares, and what its map of where each filter is right shows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, partial

import numpy as np
from scipy.linalg import block_diag

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Tuning, search_pattern
from inswsn_lib.filters import adaptive, gating, huber, run_hinfinity, run_kalman, run_robust
from inswsn_lib.lmi import FilterDesign, design_filter
from inswsn_lib.lmi.designs import Form, Solver
from inswsn_lib.models import ErrorModel
from inswsn_lib.navigation.training_areas import (
    AREAS,
    UNKNOWN,
    ByArea,
    TrainingAreas,
    first_measured,
    run_coloured,
)

#: An area and measurements of it, (steps, 4, runs), to estimates of the error of the INS
Estimator = Callable[[str, Array], Array]

#: The most trials that the search for the two numbers of a filter has
TRIALS = 24
#: Rows of position and of velocity
PARTS = {"position": slice(0, 2), "velocity": slice(2, 4)}
_HALF_DECADE = 10**0.5
# The second number of each filter: where its search begins, and the ratio of its steps
_SECOND = {
    "Kalman": (1.0, _HALF_DECADE),  # factor on the variance of measured velocities
    "HF, exact LMI": (1.0, 3.0),  # margin above the least gamma
    "HF, printed LMI": (1.0, 3.0),
    "Kalman, coloured error": (0.2, 3.0),  # assumed correlation time of fixes, s
    "Kalman, acceleration states": (0.3, 3.0),  # deviation of the accelerations, m/s^2
    "Kalman with gating": (1e-3, 10.0),  # share of good measurements that is given away
    "Kalman with Huber update": (1.345, 1.5),  # threshold, standard deviations
    "Kalman with adaptive R": (0.05, 2.0),  # one less the forgetting factor
}
#: The filters that take part
CONTESTANTS = tuple(_SECOND)


@dataclass(frozen=True, eq=False)
class FilterContest:
    """Filters of P1's scene, each with two numbers that are tuned with the same trials.

    The first number of each is the ratio of the Q that it assumes to the one that matches. The
    second is its own: of the Kalman filter a factor on the variance of velocities, of an
    H-infinity filter the margin of its level above the least gamma, of the others what their names
    say. All start from the first measurement, and are judged after that of the step. A factor on R
    is not among them: it gives the gain of one over that factor on Q.

    Attributes
    ----------
    areas : TrainingAreas
        The scene. Filters are tuned on its ``others``.

    Examples
    --------
    If it knows the truth, the Kalman filter is better than the network that it listens to:

    >>> from inswsn_lib.navigation import FilterContest, TrainingAreas, relative_loss
    >>> contest = FilterContest(TrainingAreas(runs=4, other_runs=4))
    >>> drawn = contest.areas.drawn
    >>> error = contest.errors(contest.build("Kalman", 1.0, 1.0), drawn)
    >>> relative_loss(error, drawn["wsn"]) < 1
    True
    """

    areas: TrainingAreas

    def build(self, name: str, ratio: float, own: float) -> Estimator:
        """Return a filter of `CONTESTANTS`, by the ratio of its Q and its own number."""
        models = self.areas.assuming(ratio)
        if name == "Kalman":
            return kalman(self.kalman_models(ratio, own))
        if name.startswith("HF"):
            designs = self.designs("exact" if "exact" in name else "printed", models, own)
            return lambda a, y: run_hinfinity(designs[a], y, initial_state=first_measured(y))
        if name == "Kalman, coloured error":
            return lambda a, y: run_coloured(models[a], own, y)
        if name == "Kalman, acceleration states":
            return lambda a, y: run_wandering(models[a], own, y)
        share = 1 - min(own, 0.5)
        policy = {
            "Kalman with gating": partial(gating, share),
            "Kalman with Huber update": partial(huber, own),
            "Kalman with adaptive R": partial(adaptive, share),
        }[name]()
        return lambda a, y: run_robust(models[a], y, policy=policy, initial_covariance=UNKNOWN)

    def kalman_models(self, ratio: float, factor: float) -> dict[str, ErrorModel]:
        """Return what the Kalman filter with these two numbers assumes, by area."""
        wider = np.repeat([1.0, factor], 2)
        return {
            a: m.with_covariances(m.process_covariance, m.measurement_covariance * wider)
            for a, m in self.areas.assuming(ratio).items()
        }

    def designs(
        self, form: Form, models: Mapping[str, ErrorModel], margin: float
    ) -> dict[str, FilterDesign]:
        """Return the H-infinity filters of models by area, at a margin above the least gamma."""
        solvers: tuple[Solver, ...] = (self.areas.solver, "clarabel")
        return {
            a: design_filter(model, form, margin=margin, solver=solvers)
            for a, model in models.items()
        }

    @cached_property
    def tunings(self) -> dict[str, Tuning[tuple[float, ...]]]:
        """The searches for the two numbers of each filter, on other runs than those judged."""
        return {name: self.tuning(name) for name in CONTESTANTS}

    @cached_property
    def tuning(self) -> Callable[[str], Tuning[tuple[float, ...]]]:
        """The search of one filter by its name, which is made once."""
        return cache(self.tune)

    @cached_property
    def tuned(self) -> dict[str, Estimator]:
        """Each filter with the numbers that were found."""
        return {name: self.build(name, *search.best) for name, search in self.tunings.items()}

    def errors(self, estimate: Estimator, drawn: Mapping[str, ByArea]) -> ByArea:
        """Return the errors of the INS less an estimator's estimates, by area, (steps, 4, runs).

        NaN before the first fix of a run, where nobody knows the error of the INS.
        """
        ins, network = drawn["ins"], drawn["wsn"]
        errors = {a: ins[a] - estimate(a, ins[a] - network[a]) for a in AREAS}
        begun = {a: np.logical_or.accumulate(~np.isnan(network[a]), axis=0) for a in AREAS}
        return {a: np.where(begun[a], error, np.nan) for a, error in errors.items()}

    def tune(self, name: str) -> Tuning[tuple[float, ...]]:
        """Search for the two numbers of a filter of `CONTESTANTS`."""
        drawn = self.areas.others

        def loss(ratio: float, own: float) -> float:
            return relative_loss(self.errors(self.build(name, ratio, own), drawn), drawn["wsn"])

        begin, step = _SECOND[name]
        return search_pattern(name, (1.0, begin), (_HALF_DECADE, step), loss, most=TRIALS)


def kalman(
    models: Mapping[str, ErrorModel], predicted: bool = False, covariance: Array = UNKNOWN
) -> Estimator:
    """Return the Kalman filter of models by area; P_0 says that it knows nothing at first."""
    return lambda a, y: run_kalman(models[a], y, initial_covariance=covariance, predicted=predicted)


def run_wandering(
    model: ErrorModel, deviation: float, y: Array, correlation_time: float = 1.0
) -> Array:
    """Run a Kalman filter with two states for accelerations of the INS that wander.

    They are first-order Gauss-Markov processes (as in `inswsn_lib.simulation.drifting`). The
    process noise of the model is left as it is.

    Parameters
    ----------
    model : ErrorModel
        Of the INS, with four states.
    deviation, correlation_time : float
        Of the accelerations, m/s^2 and s.
    y : ndarray, (steps, 4) or (steps, 4, runs)
        INS less network.

    Returns
    -------
    ndarray, (steps, 4) or (steps, 4, runs)
        The error of the INS, after the measurement of each step.

    Examples
    --------
    A steady acceleration, measured without noise, is followed without lag once it is known:

    >>> import inswsn_lib as iw, numpy as np
    >>> from inswsn_lib.navigation import run_wandering
    >>> time = 0.2 * np.arange(100)[:, None]
    >>> error = np.concatenate([time**2 / 2, 0 * time, time, 0 * time], axis=1)
    >>> model = iw.ErrorModel.p1(0.2, process_noise=(0.01, 0.01), measurement_noise=(0.1, 0.1))
    >>> found = run_wandering(model, 1.0, error, correlation_time=1e6)
    >>> bool(np.abs(found[-1] - error[-1]).max() < 1e-3)
    True
    """
    T, share = model.period, np.exp(-model.period / correlation_time)
    A = block_diag(model.A, share * np.eye(2))
    A[2:4, 4:] = T * np.eye(2)
    A[0:2, 4:] = T**2 / 2 * np.eye(2)
    driven = deviation * np.sqrt(1 - share**2) * np.eye(2)
    wandering = ErrorModel(A=A, B=block_diag(model.B, driven), C=np.eye(4, 6), D=model.D, period=T)
    start = block_diag(UNKNOWN, deviation**2 * np.eye(2))
    return run_kalman(wandering, y, initial_covariance=start)[:, :4]


def relative_errors(errors: ByArea, network: ByArea) -> tuple[float, float]:
    """Return RMS errors of position and velocity over those of the network, means over areas.

    Parameters
    ----------
    errors, network : dict of str to ndarray, (steps, 4, runs)
        By area: of a method, and of the network; m and m/s.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import relative_errors
    >>> network = {"1": np.ones((5, 4, 2)), "2": np.ones((5, 4, 2))}
    >>> relative_errors({a: e / 2 for a, e in network.items()}, network)
    (0.5, 0.5)
    """

    def mean_ratio(rows: slice) -> float:
        sizes = ((root_mean_square(x[a][:, rows]) for x in (errors, network)) for a in errors)
        return float(np.mean([own / its for own, its in sizes]))

    return mean_ratio(PARTS["position"]), mean_ratio(PARTS["velocity"])


def relative_loss(errors: ByArea, network: ByArea) -> float:
    """Return the mean of `relative_errors` of position and velocity, by which filters are tuned.

    Parameters
    ----------
    errors, network
        As there.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import relative_loss
    >>> network = {"1": np.ones((5, 4, 2)), "2": np.ones((5, 4, 2))}
    >>> relative_loss({a: e / 2 for a, e in network.items()}, network)
    0.5
    """
    return sum(relative_errors(errors, network)) / 2


def root_mean_square(values: Array) -> float:
    """Return the root of the mean of squares; NaN left out."""
    return float(np.sqrt(np.nanmean(np.square(values))))
