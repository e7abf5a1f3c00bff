"""P3's outages: every method through each outage of a drive, and many simulated drives."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.linear_model import LinearRegression

from inswsn_lib.checks import Array, one_of, unmasked, whole
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.evaluation import Finding, Scores, cluster_mean
from inswsn_lib.files import data_file
from inswsn_lib.learning import HoldRegressor, LSSVMRegressor, RBFNetworkRegressor, SelectedLSSVM
from inswsn_lib.navigation.vehicle_hybrid import Bridge, Ramps, VehicleHybrid
from inswsn_lib.scenario import Setting, load_scenario, with_values
from inswsn_lib.simulation import Drive, Truth, simulate_sensors, true_motion
from inswsn_lib.vehicle import (
    FilterSettings,
    VehicleRun,
    horizontal_error,
    replay,
    run_vehicle_filter,
    smooth_outages,
)

#: The three filters without learning: no compass and lateral constraint at any time; both until the
#: outage begins; both through the outage as well
FILTERS = ("never", "until", "through")
#: Length of an outage and of a longer one, as printed, s
OUTAGE, LONG = 40, 50
#: The methods that are compared, and what they are called
METHODS = {
    "never": "never aided",
    "until": "aided before",
    "through": "aided through",
    "lssvm": "LS-SVM",
    "rbf": "RBF",
    "short": "LS-SVM, ramps of 10 s",
    "short rbf": "RBF, ramps of 10 s",
    "half": "LS-SVM, ramps of 20 s",
    "half rbf": "RBF, ramps of 20 s",
    "no time": "LS-SVM without time",
    "linear": "linear fit",
    "hold": "last difference held",
    "proven": "LS-SVM that has to prove itself",
    "on never": "LS-SVM on never aided",
}
#: Filters with one aid after the other, and one with the compass alone, as `with_aids` has them
RUNGS: dict[str, tuple[str, ...]] = {
    "compass": ("compass",),
    "lateral": ("constraint",),
    "standstill": ("constraint", "compass", "standstill"),
    "wheels": ("constraint", "compass", "standstill", "wheels"),
}
#: How late the answers of a fixed-lag smoother are, and for how long after an outage one that waits
#: for its end has GPS, s
LAG, AFTER = 10, 20
#: Of simulated wheels: white noise, m/s, and the standard deviation of an error of their scale
WHEEL_NOISE, WHEEL_SCALE = 0.05, 0.005
_STILL = 1e-3  # m/s
# What a drive has of each run
_BY_RUN = "rotation_increments", "velocity_increments", "gps_position", "gps_velocity", "compass"
# Other lengths of the simulated outages in which P3's two learners learn, s
_RAMPS = {"short": 10, "half": 20}
# First and last second of what is measured
_SPANS = {"40": (1, OUTAGE), "50": (1, LONG), "late": (OUTAGE + 1, LONG)}
# What is scored: a span, and whether it is the RMS or the largest error
_SCORED = {"rms-40": ("40", 0), "max-40": ("40", 1), "rms-late": ("late", 0), "max-50": ("50", 1)}

_AIDED = "that of the filter that is aided through the outage"
# What the scores amount to: a method and its rival, and words for both
_FACTORS = {
    "factor.through-never": (
        ("through", "never"),
        "the filter that is aided through the outage over that of the filter that is never aided",
    ),
    "methods.lssvm": (
        ("lssvm", "through"),
        f"the proposed method, the aided filter with the LS-SVM over {_AIDED}",
    ),
    "methods.rbf": (("rbf", "through"), f"the aided filter with the RBF network over {_AIDED}"),
}  # fmt: skip


def p3_hybrids(settings: FilterSettings, **options: Any) -> dict[str, VehicleHybrid]:
    """Return P3's hybrid and what it is compared with, by name.

    ``lssvm``, P3's proposed method, with kernel width and regularisation of least leave-one-out
    error; ``rbf``, the network with the numbers that P3 prints for newrb (Section 5.2), on inputs
    and targets as they are, since its spread and goal are in their units; ``no time``, the LS-SVM
    without the time since the outage; ``linear``, a linear fit; ``hold``, the last difference held.

    Parameters
    ----------
    settings : FilterSettings
    **options
        Of `VehicleHybrid`, for all of them.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> p3 = iw.load_scenario(iw.data_file("scenarios/p3.yaml"))
    >>> list(iw.navigation.p3_hybrids(iw.FilterSettings.from_settings(p3), window=60))
    ['lssvm', 'rbf', 'no time', 'linear', 'hold']
    """
    network = RBFNetworkRegressor(spread=3.0, goal=0.01, max_neurons=40)
    return {
        "lssvm": VehicleHybrid(settings, SelectedLSSVM(), **options),
        "rbf": VehicleHybrid(settings, network, **({"scaled": False} | options)),
        "no time": VehicleHybrid(settings, SelectedLSSVM(), **({"timed": False} | options)),
        "linear": VehicleHybrid(settings, LinearRegression(), **options),
        "hold": VehicleHybrid(settings, HoldRegressor(), **options),
    }


@dataclass(frozen=True, eq=False)
class OutageTrials:
    """What each method did in each outage.

    Attributes
    ----------
    starts : ndarray of int, (outages,)
        The last epoch with GPS.
    errors : dict of str to ndarray, (steps + 1, outages, runs)
        Horizontal distance from the reference (m), by method; at step 0 the outage begins.
    positions : dict of str to ndarray, (steps + 1, 3, outages, runs)
        Latitude, longitude (rad), height (m), by method.
    bases : dict of bool to VehicleRun
        The filters with GPS at all times, without and with compass and lateral constraint; their
        covariances, six sevenths of what they take, are not kept and read NaN.
    branches : dict of str to VehicleRun
        The filters through the outages, outages x runs, likewise.
    ramps, bridges : dict of str to Ramps, and to Bridge
        What each hybrid learned from, and what it did.
    """

    starts: NDArray[np.intp]
    errors: dict[str, Array]
    positions: dict[str, Array]
    bases: dict[bool, VehicleRun]
    branches: dict[str, VehicleRun]
    ramps: dict[str, Ramps]
    bridges: dict[str, Bridge]


def run_outages(
    drive: Drive,
    settings: FilterSettings,
    starts: ArrayLike,
    steps: int,
    hybrids: Mapping[str, VehicleHybrid] | None = None,
    *,
    filters: Sequence[str] = FILTERS,
) -> OutageTrials:
    """Take GPS away at several places, one at a time, and navigate on by every method.

    An outage does not touch the others: each is a replay of the drive with GPS up to its own start.

    Parameters
    ----------
    drive : Drive
    settings : FilterSettings
        Of the filters of `FILTERS`.
    starts : array_like of int, (outages,)
        The last epochs with GPS.
    steps : int
        Length of the outages (epochs).
    hybrids : mapping of str to VehicleHybrid, optional
        By name.
    filters : sequence of str
        Which of `FILTERS` take part.

    Raises
    ------
    ParameterError
        If an outage leaves the drive, or a hybrid has the name of a filter or other settings.

    Examples
    --------
    Forty seconds without GPS in the first turn of P3's drive, with the aids and without:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive, told = iw.simulate_drive(p3, runs=4, seed=0), iw.FilterSettings.from_settings(p3)
    >>> errors = iw.navigation.run_outages(drive, told, [drive.places[0].start], 40).errors
    >>> bool(errors["through"].mean() < errors["never"].mean() / 2)
    True
    """
    hybrids, begin = hybrids or {}, as_starts(starts)
    for name, hybrid in hybrids.items():
        if name in FILTERS or hybrid.settings != settings:
            must_be = f"named other than {', '.join(FILTERS)} and have the filters' settings"
            raise ParameterError("hybrids", name, must_be)
    for name in filters:
        one_of("filters", name, FILTERS)
    needed = {name != "never" for name in filters} | {h.aiding for h in hybrids.values()}
    bases = {
        aiding: run_vehicle_filter(drive, settings, aiding=aiding, last=int(begin.max()))
        for aiding in needed
    }
    branches = {
        name: _lean(
            replay(drive, settings, bases[name != "never"], begin, steps, aiding=name == "through")
        )
        for name in filters
    }
    positions = {name: branch.position for name, branch in branches.items()}
    ramps: dict[str, Ramps] = {}
    bridges: dict[str, Bridge] = {}
    shared: dict[tuple[object, ...], Ramps] = {}
    for name, hybrid in hybrids.items():
        base, key = bases[hybrid.aiding], hybrid.pairs_key
        if key not in shared:
            shared[key] = hybrid.simulate_outages(drive, base, begin)
        ramps[name] = shared[key]
        branch = branches.get("through" if hybrid.aiding else "never")
        bridges[name] = hybrid.bridge(drive, base, begin, steps, ramps=ramps[name], branch=branch)
        positions[name] = bridges[name].position
    any_branch, shape = next(iter(branches.values())), (len(begin), drive.runs)
    return OutageTrials(
        starts=begin,
        errors={
            name: horizontal_error(any_branch, drive, x).reshape(steps + 1, *shape)
            for name, x in positions.items()
        },
        positions={name: x.reshape(steps + 1, 3, *shape) for name, x in positions.items()},
        bases={aiding: _lean(run) for aiding, run in bases.items()},
        branches=branches,
        ramps=ramps,
        bridges=bridges,
    )


def with_aids(
    drive: Drive, settings: FilterSettings, aids: Collection[str]
) -> tuple[Drive, FilterSettings]:
    """Return drive and settings of a filter that has some aids of the drive, and no others.

    Parameters
    ----------
    drive, settings
        The first compass measurement stays: every run begins from it.
    aids : collection of str
        Any of ``compass``, ``constraint``, ``standstill`` and ``wheels``.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive, told = iw.simulate_drive(p3, runs=4, seed=0), iw.FilterSettings.from_settings(p3)
    >>> deaf, _ = iw.navigation.with_aids(drive, told, ["constraint"])
    >>> deaf.compass[:2, 0].round(2)
    array([0.86,  nan])
    """
    changes: dict[str, Any] = {}
    if "compass" not in aids:
        deaf = np.full_like(drive.compass, np.nan)
        deaf[0] = drive.compass[0]
        changes["compass"] = deaf
    more = drive.body_velocity
    if more is not None and "wheels" not in aids:
        standing = np.isfinite(more).all(axis=1, keepdims=True)
        changes["body_velocity"] = (
            np.where(standing, more, np.nan) if "standstill" in aids else None
        )
    # a deviation of 10^6 m/s says nothing
    told = settings if "constraint" in aids else replace(settings, lateral=1e6)
    return replace(drive, **changes), told


def with_wheels(drive: Drive, *, seed: int) -> Drive:
    """Return a simulated drive with wheels, and with knowledge of when it stands.

    Wheels tell the speed with white noise and an error of their scale that stays through a run,
    `WHEEL_NOISE` and `WHEEL_SCALE`. Where the car stands, its velocity is told to be zero, forward,
    right and down: the simulated IMU does not shake on the road, so that it could not tell.

    Parameters
    ----------
    drive : Drive
    seed : int
        Of the noise.

    Examples
    --------
    The car of P3 begins at rest, and later drives:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive = iw.navigation.with_wheels(iw.simulate_drive(p3, runs=1, seed=0), seed=0)
    >>> drive.body_velocity[[0, 60], :, 0].round(1)
    array([[0. , 0. , 0. ],
           [6.4, nan, nan]])
    """
    rng = np.random.default_rng([seed, 1])
    speed = np.linalg.norm(drive.reference.velocity, axis=1)[:, None]
    scale = 1 + WHEEL_SCALE * rng.standard_normal(drive.runs)
    told = np.full((len(speed), 3, drive.runs), np.nan)
    told[:, 0] = scale * speed + WHEEL_NOISE * rng.standard_normal((len(speed), drive.runs))
    told[speed[:, 0] < _STILL] = 0.0
    return replace(drive, body_velocity=told)


def run_ladder(
    drive: Drive, settings: FilterSettings, starts: ArrayLike, steps: int
) -> dict[str, Array]:
    """Take GPS away as `run_outages` does, with one aid after the other, and with smoothers.

    Parameters
    ----------
    drive, settings, starts, steps
        As in `run_outages`.

    Returns
    -------
    dict of str to ndarray, (steps + 1, outages, runs)
        Horizontal distance from the reference (m), by the name in `RUNGS`, as far as the drive has
        the aids. ``lagged`` and ``smoothed`` have compass and constraint, in the first run of the
        drive alone: the smoother with a lag of `LAG` s, and the one that knows `AFTER` s of GPS
        after the outage, if the drive is that long. They are not causal.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive, told = iw.simulate_drive(p3, runs=4, seed=0), iw.FilterSettings.from_settings(p3)
    >>> errors = iw.navigation.run_ladder(drive, told, [drive.places[0].start], 40)
    >>> {name: round(float((x**2).mean() ** 0.5)) for name, x in errors.items()}
    {'compass': 27, 'lateral': 4, 'lagged': 3, 'smoothed': 1}
    """
    begin, more = as_starts(starts), drive.body_velocity
    there = {"constraint", "compass"}
    if more is not None:
        there |= {"standstill"}
        # where it stands all three are told
        there |= {"wheels"} if (np.isfinite(more[:, 0]) & np.isnan(more[:, 1])).any() else set()
    found = {}
    for name, aids in RUNGS.items():
        if there.issuperset(aids):
            heard, told = with_aids(drive, settings, aids)
            run = run_vehicle_filter(heard, told, last=int(begin.max()))
            branch = replay(heard, told, run, begin, steps, aiding=True)
            found[name] = horizontal_error(branch, drive)
    one = {name: getattr(drive, name)[..., :1] for name in _BY_RUN}
    first = replace(drive, body_velocity=None, **one)
    run = run_vehicle_filter(first, settings, last=int(begin.max()))
    branch = replay(first, settings, run, begin, steps, aiding=True)
    left = len(drive.time) - 1 - steps - int(begin.max())
    for name, after, lag in (("lagged", LAG, float(LAG)), ("smoothed", AFTER, np.inf)):
        late = min(after, left)
        places = smooth_outages(first, settings, run, begin, steps, after=late, lag=lag)
        found[name] = horizontal_error(branch, first, places)
    return {name: x.reshape(steps + 1, len(begin), -1) for name, x in found.items()}


def _lean(run: VehicleRun) -> VehicleRun:
    """Return a run without its covariances: they read NaN, and take no memory."""
    own, others = run.states.covariance, run.innovation_covariances
    states = replace(run.states, covariance=np.broadcast_to(np.nan, own.shape))
    nothing = np.broadcast_to(np.nan, others.shape)
    return replace(run, states=states, innovation_covariances=nothing)


def as_starts(starts: ArrayLike) -> NDArray[np.intp]:
    """Return epochs at which outages begin, (outages,); refuse what is no whole number."""
    begin = np.atleast_1d(np.asarray(unmasked(starts)))
    if begin.dtype.kind not in "iu" or begin.ndim != 1 or not begin.size:
        raise ParameterError(
            "starts",
            Described(f"{begin.dtype} of shape {begin.shape}"),
            "whole numbers of shape (outages,)",
        )
    return begin.astype(np.intp)


def outage_size(errors: Array, first: int = 1, last: int | None = None) -> tuple[Array, Array]:
    """Return RMS and maximum of errors over a part of the outages, each (...).

    Parameters
    ----------
    errors : ndarray, (steps + 1, ...)
        Horizontal errors (m); step 0 is the last with GPS and does not count.
    first, last : int
        The steps, both included. Default: the whole outage.

    Examples
    --------
    >>> import numpy as np, inswsn_lib as iw
    >>> [float(size) for size in iw.navigation.outage_size(np.array([9.0, 1.0, 7.0]))]
    [5.0, 7.0]
    """
    steps = len(errors) - 1
    end = steps if last is None else whole("last", last, 1, steps)
    part = errors[whole("first", first, 1, end) : end + 1]
    return np.sqrt(np.mean(part**2, axis=0)), part.max(axis=0)


def p3_settings() -> dict[str, Setting]:
    """Return the settings of P3's drives, of their sensors and of the filter."""
    return load_scenario(data_file("scenarios/p3.yaml"))


@dataclass(frozen=True, eq=False)
class VehicleOutages:
    """P3's simulated drives, and every method of evidence p3-vehicle through each of their outages.

    Each of the eight places of a route has an outage of 50 s, of which the first 40 s are the
    shorter one. The learners correct the filter that is aided through the outage, but for
    ``on never``. ``short`` and ``half`` learn from simulated outages of 10 s and 20 s, whatever
    `tau` is; ``proven`` is an LS-SVM that has to predict the last four simulated outages better
    than zero does.

    Attributes
    ----------
    published : mapping of str to Setting
        The scenario file ``p3``.
    seed : int
        Of all random numbers but the routes, which are the same for every seed.
    routes, draws : int
        Simulated routes with eight places each, and draws of the sensors' errors on each of them.
    tau, window : int
        Length of the simulated outages in which a hybrid learns, and of the training, s.
    lateral : float
        Standard deviation of the lateral velocity that the filter believes, m/s.
    slip : float
        Side slip for each m/s^2 of lateral acceleration, degrees.
    compass_bias : float
        Constant error of the compass, degrees.
    compass_outliers : float
        Share of compass measurements that are outliers.

    Examples
    --------
    The last place of two routes: of the same kind on another road.

    >>> import inswsn_lib as iw
    >>> [truth.places[7] for truth in iw.navigation.VehicleOutages(routes=2).truths]
    [Place(name='continuous curve', start=1404), Place(name='continuous curve', start=1397)]
    """

    scenarios: ClassVar[tuple[str, ...]] = ("p3",)

    published: Mapping[str, Setting] = field(default_factory=p3_settings)
    seed: int = 2015
    routes: int = 12
    draws: int = 4
    tau: int = 40
    window: int = 40
    lateral: float = 0.1
    slip: float = 0.3
    compass_bias: float = 0.0
    compass_outliers: float = 0.02

    @cached_property
    def settings(self) -> dict[str, Setting]:
        """The settings of the drives with these parameters."""
        return with_values(
            self.published,
            slip=round(float(np.deg2rad(self.slip)), 8),
            compass_bias=float(np.deg2rad(self.compass_bias)),
            compass_outlier=self.compass_outliers,
            filter_lateral=self.lateral,
        )

    @cached_property
    def beliefs(self) -> FilterSettings:
        """What the filters assume."""
        return FilterSettings.from_settings(self.settings)

    @cached_property
    def truths(self) -> list[Truth]:
        """What happened on each route."""
        return [true_motion(self.settings, route=r) for r in range(self.routes)]

    @cached_property
    def drives(self) -> list[Drive]:
        """What the sensors of all draws measured on each route."""
        return [
            simulate_sensors(truth, self.settings, runs=self.draws, seed=self.seed + r)
            for r, truth in enumerate(self.truths)
        ]

    @cached_property
    def starts(self) -> list[list[int]]:
        """The last epochs with GPS on each route, by place."""
        return [[place.start for place in truth.places] for truth in self.truths]

    @property
    def learning(self) -> dict[str, Any]:
        """Length of the simulated outages and of the window, for `VehicleHybrid`."""
        return {"tau": self.tau, "window": self.window}

    @cached_property
    def hybrids(self) -> dict[str, VehicleHybrid]:
        """The methods that learn."""
        told, machine, learning = self.beliefs, SelectedLSSVM(), self.learning
        rivals = [LSSVMRegressor(sigma, eta) for sigma in (2.0, 8.0) for eta in (0.1, 10.0)]
        ramps = {
            name: p3_hybrids(told, tau=tau, window=self.window) for name, tau in _RAMPS.items()
        }
        return {
            **p3_hybrids(told, **learning),
            **{name: hybrids["lssvm"] for name, hybrids in ramps.items()},
            **{f"{name} rbf": hybrids["rbf"] for name, hybrids in ramps.items()},
            "on never": VehicleHybrid(told, machine, aiding=False, **learning),
            "proven": VehicleHybrid(told, machine, past=4, rivals=rivals, **learning),
        }

    @cached_property
    def trials(self) -> list[OutageTrials]:
        """What each method did in the outages of each route."""
        return self._run(METHODS)

    @cached_property
    def errors(self) -> dict[str, Array]:
        """Horizontal errors of each of `METHODS`, (51 epochs, 8 places, drives), m.

        The draws of one route are next to one another.
        """
        return _joined(self.trials, METHODS)

    def errors_of(self, methods: Collection[str]) -> dict[str, Array]:
        """Return what `errors` has of some methods, which alone are computed."""
        return _joined(self._run(methods), methods)

    @cached_property
    def ladder(self) -> dict[str, Array]:
        """Errors of `run_ladder` in outages of 40 s, (41 epochs, 8 places, drives), m.

        Of the two smoothers the first draw of each route alone.
        """
        found = [
            run_ladder(with_wheels(drive, seed=self.seed + r), self.beliefs, starts, OUTAGE)
            for r, (drive, starts) in enumerate(zip(self.drives, self.starts, strict=True))
        ]
        return {name: np.concatenate([each[name] for each in found], axis=2) for name in found[0]}

    @cached_property
    def sizes(self) -> dict[tuple[str, str], tuple[Array, Array]]:
        """RMS and largest errors, each (8 places, drives), m, by method and span.

        The spans are ``40`` and ``50`` s of the outage, and the ``late`` part from 41 s to 50 s.
        """
        return {
            (name, span): outage_size(error, *limits)
            for name, error in self.errors.items()
            for span, limits in _SPANS.items()
        }

    @cached_property
    def clusters(self) -> Array:
        """The road of each outage, (8 places, drives): those of one place and route share it."""
        route = np.repeat(np.arange(self.routes), self.draws)
        return np.asarray(np.arange(8)[:, None] * self.routes + route)

    def factor(self, method: str, rival: str) -> tuple[float, float, float]:
        """Return the mean ratio of RMS errors in 40 s, geometric, and its interval by road."""
        ratio = np.log(self.sizes[method, "40"][0] / self.sizes[rival, "40"][0])
        mean, low, high = np.exp(cluster_mean(ratio.ravel(), self.clusters.ravel()))
        return float(mean), float(low), float(high)

    def _run(self, methods: Collection[str]) -> list[OutageTrials]:
        # before the drives, which take longer than a refusal
        hybrids = {name: hybrid for name, hybrid in self.hybrids.items() if name in methods}
        filters = [name for name in FILTERS if name in methods]
        return [
            run_outages(drive, self.beliefs, starts, LONG, hybrids, filters=filters)
            for drive, starts in zip(self.drives, self.starts, strict=True)
        ]

    def scores(self) -> Scores:
        """Return the errors of each of `METHODS` in each outage.

        A run is one outage: place by place, the drives of each. RMS and largest horizontal error in
        40 s, ``rms-40`` and ``max-40``; RMS from 41 s to 50 s, ``rms-late``; largest in 50 s,
        ``max-50``. Outages at one place of one route share their road.
        """
        values = {
            f"{_key(method)}.{column}": self.sizes[method, span][index].ravel()
            for method in METHODS
            for column, (span, index) in _SCORED.items()
        }
        how = "; the geometric mean over the outages, with an interval by clusters."
        findings = {
            name: Finding(*self.factor(*pair), "1", f"RMS error in 40 s of {words}{how}")
            for name, (pair, words) in _FACTORS.items()
        }
        return Scores(
            findings=findings,
            methods={_key(method): label for method, label in METHODS.items()},
            columns=dict.fromkeys(_SCORED, "m"),
            values=values,
            headline="rms-40",
        )


def _joined(trials: Sequence[OutageTrials], methods: Collection[str]) -> dict[str, Array]:
    return {name: np.concatenate([t.errors[name] for t in trials], axis=2) for name in methods}


def _key(method: str) -> str:
    return method.replace(" ", "-")
