"""P2's clusters as a Monte Carlo: the scene, the filters tuned alike, their errors.

This is what evidence p2-fusion compares on equal terms, a function of its parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar, Literal, TypeVar

import numpy as np
from scipy.linalg import block_diag

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding, Scores, Tuning, monte_carlo, quotient, search_pattern
from inswsn_lib.files import data_file
from inswsn_lib.filters import (
    handover_weights,
    patterns_of,
    run_distributed,
    run_federated,
    run_fused_locals,
    run_switched,
)
from inswsn_lib.lmi import FilterDesign, InfeasibleDesignError, design_filter
from inswsn_lib.lmi.designs import FusionSolver, Solver
from inswsn_lib.models import ErrorModel
from inswsn_lib.scenario import Setting, from_settings, load_scenario, with_values
from inswsn_lib.simulation import ClusterScene

#: Which clusters hear the node
Pattern = tuple[bool, ...]
#: Measurements of the clusters, (N, steps, 4, runs), to estimates, (steps, 4, runs)
Estimator = Callable[..., Array]
_Made = TypeVar("_Made")

#: The methods that are compared, and what they are called
METHODS = {
    "fkf-reset": "FKF, reset",
    "fkf-no-reset": "FKF, no reset",
    "fkf-each-fix": "FKF, R of each fix",
    "covariance-intersection": "covariance intersection",
    "best-cluster": "best cluster",
    "dhf": "DHF",
    "hf-centralised": "HF, centralised",
    "kf-with-bias": "KF with bias",
    "dhf-one-ins": "DHF, one INS",
    "network-alone": "network alone",
}
#: The most trials that the search for the numbers of a method has
TRIALS = 48
# Where a search begins, and the ratios of its steps: an acceleration, a factor on the variance of
# velocities, the weight of velocities in L, and the margin above the least gamma
_START = (1.0, 1.0)
_STARTS = {
    "dhf": (1.0, 1.0, 1.0, 1.0),
    "hf-centralised": (1.0, 1.0, 1.0, 1.0),
    "kf-with-bias": (0.03, 1.0),
}
_RATIOS = (2.5, 10.0, 3.0, 3.0)
_COLUMNS = {"position": "m", "velocity": "m/s"}
_PARTS = (slice(0, 2), slice(2, 4))  # position and velocity in the state


class _Asked(Mapping[str, _Made]):
    """What a function makes of some names, each when it is asked for, and once."""

    def __init__(self, names: Iterable[str], make: Callable[[str], _Made]) -> None:
        self._names, self._make = [*names], make
        self._made: dict[str, _Made] = {}

    def __getitem__(self, name: str) -> _Made:
        if name not in self._made:
            if name not in self._names:
                raise KeyError(name)
            self._made[name] = self._make(name)
        return self._made[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@dataclass(frozen=True, eq=False)
class ClusterFusion:
    """P2's scene with its clusters, the filters of p2-fusion tuned alike, and their errors.

    Every filter gives its estimate before the measurement of the step. Its numbers are tuned on
    `other_runs` runs of the next seed: an acceleration that is its process noise, m/s^2 (of the
    filter with bias how fast the bias wanders, m/s^2/s^0.5), a factor on the variance of measured
    velocities, and, of H-infinity filters, the weight of a velocity against a position in L and the
    margin above the least gamma. All assume the same R, the mean covariance of a cluster's
    measurements; only ``fkf-each-fix`` is given that of each fix, which a constant gain cannot use.

    Attributes
    ----------
    published : mapping of str to Setting
        The scenario file ``p2``, of which the other attributes change some settings.
    seed, runs, other_runs : int
        Of all random numbers; runs that are judged, and those on which the filters are tuned.
    speed : float
        Of the node along its path, m/s.
    range_noise, dropout : float
        Standard deviation of a range, m, and the share of ranges that are lost.
    velocity_source, velocity_noise, velocity_fixes, correlation_time : str, float, int and float
        As in `inswsn_lib.simulation.ClusterScene`.
    node_bias : float
        As in `inswsn_lib.simulation.Ranging`.
    accelerometer_bias : float
        Of both accelerometers, m/s^2.
    solver : {"clarabel", "scs"}
        Of the designs; where an answer of SCS is refused, Clarabel is asked.

    Examples
    --------
    Carlson's filter in a fast walk, with 1 m/s^2 assumed, is better than the INS alone in each run:

    >>> from inswsn_lib.navigation import ClusterFusion, planar_rms
    >>> fusion = ClusterFusion(runs=4, speed=6.0)
    >>> ins = fusion.drawn["ins"]
    >>> error = ins - fusion.federated(1.0, 1.0)(fusion.measurements)
    >>> bool((planar_rms(error) < planar_rms(ins)).all())
    True
    """

    scenarios: ClassVar[tuple[str, ...]] = ("p2",)

    published: Mapping[str, Setting] = field(
        default_factory=lambda: load_scenario(data_file("scenarios/p2.yaml"))
    )
    seed: int = 2012
    runs: int = 512
    other_runs: int = 64
    speed: float = 2.4
    range_noise: float = 0.2
    dropout: float = 0.0
    velocity_source: str = "window"
    velocity_noise: float = 0.126
    velocity_fixes: int = 25
    correlation_time: float = 0.0
    node_bias: float = 0.0
    accelerometer_bias: float = 0.15
    solver: Solver = "clarabel"

    @cached_property
    def settings(self) -> dict[str, Setting]:
        """The settings of the scene with these parameters."""
        same = (
            "speed", "dropout", "velocity_source", "velocity_noise", "velocity_fixes",
            "correlation_time", "node_bias",
        )  # fmt: skip
        return with_values(
            self.published,
            noise=self.range_noise,
            accelerometer_bias=[self.accelerometer_bias] * 2,
            **{name: getattr(self, name) for name in same},
        )

    @cached_property
    def scene(self) -> ClusterScene:
        """The scene."""
        return from_settings(ClusterScene, self.settings)

    @cached_property
    def drawn(self) -> dict[str, Array]:
        """What `ClusterScene.simulate` gives in the runs that are judged."""
        return monte_carlo(self.scene.simulate, self.runs, self.seed)

    @cached_property
    def tuning(self) -> dict[str, Array]:
        """The same in the runs on which filters are tuned."""
        return monte_carlo(self.scene.simulate, self.other_runs, self.seed + 1)

    @cached_property
    def measurements(self) -> Array:
        """INS less network of each cluster, (N, steps, 4, runs); NaN where it does not hear."""
        return _measured(self.drawn)

    @cached_property
    def covariance(self) -> Array:
        """The R that filters assume, a cluster's mean at each step, (N, steps, 4, 4)."""
        steps = len(self.scene.motion.time)
        return np.repeat(self.scene.mean_covariance[:, None], steps, axis=1)

    @cached_property
    def white(self) -> float:
        """The white noise of an accelerometer in a sample, m/s^2."""
        return float(self.scene.inertial.accelerometer_noise / self.scene.period**0.5)

    def initial_covariance(self, acceleration: float) -> Array:
        """Return the P_0 of the Kalman filters, (4, 4): the scene's start, and a step of noise."""
        start = [self.settings[name].value for name in ("position", "velocity")]
        return np.diag(np.ravel(start) ** 2) + self._process(acceleration)

    def _process(self, acceleration: float) -> Array:
        """Return the Q of an acceleration, m/s^2, that acts on the INS in a period."""
        T = self.scene.period
        return np.diag(np.repeat([acceleration * T**2 / 2, acceleration * T], 2) ** 2)

    @cached_property
    def sets(self) -> list[Pattern]:
        """The sets of clusters in reach in any run."""
        return sorted({*patterns_of(self.measurements), *patterns_of(_measured(self.tuning))})

    def local_models(self, acceleration: float, covariances: Iterable[Array]) -> list[ErrorModel]:
        """Return a model for each covariance of a measurement, (4, 4), m^2 and m^2/s^2.

        The process noise is an acceleration, m/s^2, that acts on the INS in a period.
        """
        model, Q = ErrorModel.p2(self.scene.period), self._process(acceleration)
        return [model.with_covariances(Q, R) for R in covariances]

    def federated(
        self,
        acceleration: float,
        factor: float,
        *,
        reset: Literal["fusion", "zero", "none"] = "fusion",
        interval: int = 1,
        each_fix: bool = False,
    ) -> Estimator:
        """Return Carlson's federated filter; on demand it is given the covariance of each fix."""
        model, known = self._told(acceleration, factor, each_fix=each_fix)
        return lambda y, **options: run_federated(
            model, y, reset=reset, interval=interval, **known, **options
        )

    def fused_locals(
        self, acceleration: float, factor: float, rule: Literal["intersection", "best"]
    ) -> Estimator:
        """Return local Kalman filters, each with all of Q, fused by a rule."""
        model, known = self._told(acceleration, factor)
        return lambda y: run_fused_locals(model, y, rule=rule, **known)

    def local_designs(
        self, acceleration: float, factor: float, weight: float, margin: float = 0.01
    ) -> list[FilterDesign]:
        """Return the local H-infinity filters; L weighs velocities by a number."""
        models = self._weighed(acceleration, factor, weight)
        return [design_filter(m, margin=margin, solver=self._solvers) for m in models]

    def distributed(
        self,
        acceleration: float,
        factor: float,
        weight: float,
        margin: float = 0.01,
        *,
        noise: Literal["independent", "common"] = "independent",
        for_sets: Iterable[Pattern] | None = None,
    ) -> Estimator:
        """Return P2's distributed H-infinity filter with restart, weights for each set."""
        designs = self.local_designs(acceleration, factor, weight, margin)
        weights = self.fused_weights(designs, for_sets or self.sets, noise)
        return lambda y, **options: run_distributed(
            designs, y, weights=weights, predicted=True, **options
        )

    def fused_weights(
        self,
        designs: Sequence[FilterDesign],
        for_sets: Iterable[Pattern],
        noise: Literal["independent", "common"] = "independent",
    ) -> dict[Pattern, Array]:
        """Return the weights of P2 (9) for each set of clusters, block by block."""
        return handover_weights(designs, for_sets, noise, "block", solver=self._fusion_solvers)

    def central_hf(
        self,
        acceleration: float,
        factor: float,
        weight: float,
        margin: float = 0.01,
        *,
        for_sets: Iterable[Pattern] | None = None,
    ) -> Estimator:
        """Return the H-infinity filter of all measurements in reach, one gain for each set.

        It is designed for their mean, weighted by their informations, which has all that they tell
        of the state: what they have beside is noise that has no part in the mean.
        """
        models = self._weighed(acceleration, factor, weight)
        gains = {}
        for heard in for_sets or self.sets:
            inside = [m for m, there in zip(models, heard, strict=True) if there]
            C, D = np.vstack([m.C for m in inside]), block_diag(*[m.D for m in inside])
            informations = [np.linalg.inv(m.measurement_covariance) for m in inside]
            covariance = np.linalg.inv(sum(informations))
            mean = replace(inside[0], D=np.linalg.cholesky(covariance))
            design = design_filter(mean, margin=margin, solver=self._solvers)
            gain = design.gain @ covariance @ np.hstack(informations)
            gains[heard] = replace(inside[0], C=C, D=D), gain
        return lambda y: run_switched(gains, y, predicted=True)

    def with_bias(self, walk: float, factor: float) -> Estimator:
        """Return a centralised Kalman filter with two states for the acceleration errors."""
        _, known = self._told(self.white, factor)
        T = self.scene.period
        A = np.eye(6)
        A[0, 2] = A[1, 3] = A[2, 4] = A[3, 5] = T
        A[0, 4] = A[1, 5] = T**2 / 2
        q = np.repeat([self.white * T**2 / 2, self.white * T, walk * T**0.5], 2)
        model = ErrorModel(A=A, B=np.diag(q), C=np.eye(4, 6), D=np.eye(4), period=T)
        # of the bias it knows the size, twice of which is wide enough, and how far it wanders
        sizes = 2 * np.array(self.settings["accelerometer_bias"].value)
        biases = np.diag(sizes**2 + walk**2 * T)
        known["initial_covariance"] = block_diag(known["initial_covariance"], biases)
        return lambda y: run_federated(model, y, **known)[:, :4]

    def network_alone(self, y: Array) -> Array:
        """Return the fixes weighted by covariance, one step late; the INS is left out.

        NaN where no cluster heard the node in the step before.
        """
        there = np.asarray(~np.isnan(y).any(axis=2))
        heard = np.where(there[:, :, None, None], np.linalg.inv(self.covariance)[..., None], 0.0)
        right = np.einsum("csijr,csjr->sir", heard, np.nan_to_num(y))
        late = np.full((len(right) + 1, *right.shape[1:]), np.nan)
        k, r = np.nonzero(there.any(axis=0))
        total = np.moveaxis(heard.sum(axis=0), -1, 1)
        late[k + 1, :, r] = np.linalg.solve(total[k, r], right[k, :, r, None])[..., 0]
        return late[:-1]

    @cached_property
    def tuned(self) -> Mapping[str, Tuning[tuple[float, ...]]]:
        """The search for the numbers of each method that has some; each is made when asked for."""
        made = self._makers()
        return _Asked(made, lambda name: self._tune(name, made[name]))

    @cached_property
    def chosen(self) -> Mapping[str, tuple[float, ...]]:
        """The numbers of each method; DHF for one INS has those of DHF."""
        names = [*self.tuned, "dhf-one-ins"]
        return _Asked(names, lambda n: self.tuned["dhf" if n == "dhf-one-ins" else n].best)

    @cached_property
    def filters(self) -> Mapping[str, Estimator]:
        """Each of `METHODS` with its numbers."""
        made = self._makers() | {"dhf-one-ins": partial(self.distributed, noise="common")}

        def tuned(name: str) -> Estimator:
            return made[name](*self.chosen[name]) if name in made else self.network_alone

        return _Asked(METHODS, tuned)

    @cached_property
    def errors(self) -> Mapping[str, Array]:
        """The errors of each of `METHODS` in the runs that are judged, (steps, 4, runs)."""
        ins, y = self.drawn["ins"], self.measurements
        return _Asked(METHODS, lambda name: ins - self.filters[name](y))

    def scores(self) -> Scores:
        """Return the RMS errors of each of `METHODS` over the whole path.

        Returns
        -------
        Scores
            ``position``, m, and ``velocity``, m/s: see `planar_rms`.
        """
        values = {name: size for method in METHODS for name, size in self._sizes(method).items()}
        return Scores(METHODS, _COLUMNS, values, headline="position", findings=self.findings())

    def findings(self) -> dict[str, Finding]:
        """Return ratios of RMS errors, for which three of `METHODS` are tuned.

        Returns
        -------
        dict of str to Finding
            ``fair.dhf-over-fkf.position`` and ``.velocity``, and the like of ``bias-over-fkf``.
        """
        compared = {
            "fair.dhf-over-fkf": ("dhf", "of DHF over that of FKF, both tuned."),
            "fair.bias-over-fkf": (
                "kf-with-bias",
                "of the filter that estimates the bias over that of FKF, both tuned.",
            ),
        }
        rival = [*self._sizes("fkf-reset").values()]
        return {
            f"{name}.{part}": quotient([size], [other], "1", f"RMS {part} error {words}")
            for name, (method, words) in compared.items()
            for part, size, other in zip(_COLUMNS, self._sizes(method).values(), rival, strict=True)
        }

    def _sizes(self, method: str) -> dict[str, Array]:
        sizes = zip(_COLUMNS, planar_rms(self.errors[method]), strict=True)
        return {f"{method}.{column}": size for column, size in sizes}

    def _told(
        self, acceleration: float, factor: float, *, each_fix: bool = False
    ) -> tuple[ErrorModel, dict[str, Any]]:
        """Return the model of a cluster, and what Kalman filters assume of the noise."""
        R = self.scene.measurement_covariance if each_fix else self.covariance
        known = widen_velocities(R, factor)
        start = self.initial_covariance(acceleration)
        told = {"measurement_covariance": known, "initial_covariance": start}
        return self.local_models(acceleration, known[:, 0])[0], told | {"predicted": True}

    @property
    def _solvers(self) -> tuple[Solver, ...]:
        return (self.solver, "clarabel")

    @property
    def _fusion_solvers(self) -> tuple[FusionSolver, ...]:
        return ("structured" if self.solver == "clarabel" else self.solver, "clarabel")

    def _weighed(self, acceleration: float, factor: float, weight: float) -> list[ErrorModel]:
        known = widen_velocities(self.covariance[:, 0], factor)
        L = np.diag([1.0, 1.0, weight, weight])
        return [replace(m, L=L) for m in self.local_models(acceleration, known)]

    def _makers(self) -> dict[str, Callable[..., Estimator]]:
        return {
            "fkf-reset": self.federated,
            "fkf-no-reset": lambda a, f: self.federated(a, f, reset="none"),
            "fkf-each-fix": lambda a, f: self.federated(a, f, each_fix=True),
            "covariance-intersection": lambda a, f: self.fused_locals(a, f, "intersection"),
            "best-cluster": lambda a, f: self.fused_locals(a, f, "best"),
            "dhf": self.distributed,
            "hf-centralised": self.central_hf,
            "kf-with-bias": self.with_bias,
        }

    def _tune(self, name: str, make: Callable[..., Estimator]) -> Tuning[tuple[float, ...]]:
        y = _measured(self.tuning)

        def loss(*numbers: float) -> float:
            """Return the geometric mean of the errors of position and velocity."""
            try:
                error = self.tuning["ins"] - make(*numbers)(y)
            except InfeasibleDesignError:  # numbers too far apart for the solver
                return np.inf
            sizes = [np.nanmean(np.sum(error[:, rows] ** 2, axis=1)) for rows in _PARTS]
            return float(np.prod(sizes) ** 0.25)

        begin = _STARTS.get(name, _START)
        return search_pattern(METHODS[name], begin, _RATIOS[: len(begin)], loss, most=TRIALS)


def planar_rms(error: Array) -> Array:
    """Return the RMS lengths of the errors of position and velocity in each run, (2, runs).

    Parameters
    ----------
    error : ndarray, (steps, 4, runs)
        x, y, their velocities, m and m/s. A step with a NaN is left out.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import planar_rms
    >>> planar_rms(np.tile([[3.0], [4.0], [0.6], [0.8]], (10, 1, 1))).ravel().tolist()
    [5.0, 1.0]
    """
    squares = [np.sum(error[:, rows] ** 2, axis=1) for rows in _PARTS]
    return np.asarray(np.sqrt(np.nanmean(squares, axis=1)))


def widen_velocities(covariance: Array, factor: float) -> Array:
    """Return covariances (..., 4, 4) with the part of the velocities times a factor.

    Parameters
    ----------
    covariance : ndarray, (..., 4, 4)
        Of positions and velocities.
    factor : float

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.navigation import widen_velocities
    >>> np.diag(widen_velocities(np.eye(4), 10.0)).tolist()
    [1.0, 1.0, 10.0, 10.0]
    """
    out = covariance.copy()
    out[..., 2:, 2:] *= factor
    return out


def _measured(drawn: Mapping[str, Array]) -> Array:
    return np.asarray(drawn["ins"][None] - drawn["wsn"])
