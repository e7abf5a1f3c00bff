"""P3's hybrid: two filters while GPS is heard, and a regressor that learns how they differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn import config_context
from sklearn.base import clone

from inswsn_lib.checks import Array, one_of, whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.inertial import metres
from inswsn_lib.learning import Scale
from inswsn_lib.simulation import Drive
from inswsn_lib.vehicle import FilterSettings, VehicleRun, replay, yaw

Integers = NDArray[np.intp]
_AS_IS = Scale(np.zeros(1), np.ones(1))


@dataclass(frozen=True, eq=False)
class Ramps:
    """How the two filter modules differed during simulated outages: pairs for a regressor.

    Attributes
    ----------
    epoch, run, ramp : ndarray of int, (pairs,)
        Of the drive; the number of the run in it; the epoch at which the simulated outage began.
    elapsed : ndarray, (pairs,)
        Time since then (s).
    motion : ndarray, (pairs, 3)
        As in `sensed_motion`.
    difference : ndarray, (pairs, 2)
        Position of the first module, after compass and lateral velocity, less that of the second,
        after GPS: P3 (38), east and north (m), or forward and right.
    """

    epoch: Integers
    run: Integers
    ramp: Integers
    elapsed: Array
    motion: Array
    difference: Array


@dataclass(frozen=True, eq=False)
class Machine:
    """A trained regressor, and the units in which it sees its columns.

    Attributes
    ----------
    regressor : scikit-learn regressor or None
        None predicts zero.
    inputs, targets : Scale
        Their units.
    pairs : int
        How many trained it.
    """

    regressor: Any = None
    inputs: Scale = _AS_IS
    targets: Scale = _AS_IS
    pairs: int = 0

    @classmethod
    def fit(cls, regressor: Any, X: Array, y: Array, scaled: bool) -> Machine:
        """Train a clone on inputs (pairs, inputs) and targets (pairs, 2), in their own units."""
        inputs, targets = (Scale.of(x, "standard" if scaled else "none") for x in (X, y))
        with config_context(assume_finite=True):
            trained = clone(regressor).fit(inputs.transform(X), targets.transform(y))
        return cls(trained, inputs, targets, len(X))

    def predict(self, X: Array) -> Array:
        """Return the targets of inputs (rows, inputs), (rows, 2), in their own units."""
        if self.regressor is None:
            return np.zeros((len(X), 2))
        with config_context(assume_finite=True):
            found = np.asarray(self.regressor.predict(self.inputs.transform(X)), dtype=float)
        return self.targets.inverse_transform(found)


@dataclass(frozen=True, eq=False)
class Bridge:
    """The hybrid's positions through outages.

    Attributes
    ----------
    branch : VehicleRun
        The filter that runs through the outage, (steps + 1, ..., starts x runs).
    position : ndarray, (steps + 1, 3, starts x runs)
        Latitude, longitude (rad), height (m): those of the branch less the predicted difference.
    predicted : ndarray, (steps + 1, 2, starts x runs)
        East and north (m).
    machines : list
        The trained regressor of each outage, with the units in which it sees inputs and targets.
    """

    branch: VehicleRun
    position: Array
    predicted: Array
    machines: list[Machine]


@dataclass(frozen=True, eq=False)
class VehicleHybrid:
    r"""A vehicle's filter and a regressor that corrects it through GPS outages (P3 Section 2).

    In *update mode* two filter modules run. The second has GPS at all times. The first is put into
    simulated outages of `tau` epochs: each begins with what the second knows, and goes on with
    compass and lateral velocity alone. The difference of their positions (P3 (38)) is the target of
    a regressor, its input (P3 (39)) the forward and lateral specific force, the yaw rate, and the
    time since the simulated outage began. In *prediction mode* the regressor, trained on the latest
    `window` epochs, is subtracted from the position of the filter that runs through the outage.

    P3 compares position *errors* :math:`X_1, X_2`; here the two modules correct INS of their own,
    so their positions are compared, which is the same difference.

    Parameters
    ----------
    settings : FilterSettings
        Of both modules.
    regressor : scikit-learn regressor
        It must take two outputs. It is left as it is, and clones are trained.
    aiding : bool
        Whether the first module has compass and lateral velocity.
    tau : int
        Length of a simulated outage (epochs). P3 says "successive s GPS signal outages", with the
        number lost.
    restart : {"successive", "aligned", "bank"}
        When simulated outages begin: one after the other from epoch `phase` on; so that one ends
        where the real one begins; or every `spacing` epochs, so that several run at once.
    phase, spacing : int
        See `restart` (epochs).
    window : int
        Epochs before the outage whose pairs train.
    frame : {"navigation", "body"}
        Axes of the targets.
    motion, timed : bool
        Whether specific force and yaw rate, and whether the time, are inputs.
    scaled : bool
        Whether the regressor sees inputs and targets with mean 0 and deviation 1 on the pairs it is
        trained on.
    anchored : bool
        Whether the prediction for the moment at which the outage begins is taken off.
    past : int
        If more than 0, the regressor has to prove itself: it, and the `rivals`, are trained as for
        an outage at each of the last `past` simulated ones and predict the whole of it; the one
        with the least squared error is used, or none if predicting zero is better than all.
    rivals : sequence of scikit-learn regressors
        See `past`.

    Examples
    --------
    Ten seconds without GPS after a minute's drive, and what the last 40 s have taught:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive, told = iw.simulate_drive(p3, runs=2, seed=0), iw.FilterSettings.from_settings(p3)
    >>> hybrid = iw.navigation.VehicleHybrid(told, iw.LSSVMRegressor(sigma=2, eta=10), tau=20)
    >>> bridge = hybrid.bridge(drive, iw.run_vehicle_filter(drive, told, last=60), [60], 10)
    >>> bridge.position.shape, bridge.machines[0].pairs
    ((11, 3, 2), 40)
    """

    settings: FilterSettings
    regressor: Any
    _: KW_ONLY
    aiding: bool = True
    tau: int = 40
    restart: Literal["successive", "aligned", "bank"] = "successive"
    phase: int = 0
    spacing: int = 5
    window: int = 40
    frame: Literal["navigation", "body"] = "navigation"
    motion: bool = True
    timed: bool = True
    scaled: bool = True
    anchored: bool = False
    past: int = 0
    rivals: Sequence[Any] = ()

    def __post_init__(self) -> None:
        least = {"tau": 1, "phase": 0, "spacing": 1, "window": 2, "past": 0}
        for name, low in least.items():
            whole(name, getattr(self, name), low)
        one_of("restart", self.restart, ("successive", "aligned", "bank"))
        one_of("frame", self.frame, ("navigation", "body"))
        if self.past and (self.anchored or self.restart == "aligned"):
            raise ParameterError(
                "past", self.past, "0 if ramps are aligned or predictions anchored"
            )
        if not self.motion and not self.timed:
            raise ParameterError("timed", self.timed, "True if motion is no input")
        for machine in (self.regressor, *self.rivals):
            try:
                fits = hasattr(clone(machine), "predict")
            except TypeError:  # it has no parameters to be had
                fits = False
            if not fits:
                raise ParameterError("regressor", machine, "a scikit-learn regressor")

    @property
    def pairs_key(self) -> tuple[object, ...]:
        """What two hybrids share if they learn from the same pairs."""
        names = ("settings", "aiding", "tau", "restart", "phase", "spacing", "frame")
        return tuple(getattr(self, name) for name in names)

    def simulate_outages(self, drive: Drive, run: VehicleRun, starts: ArrayLike) -> Ramps:
        """Run the first module through the simulated outages that outages at `starts` ask for.

        Parameters
        ----------
        drive, run
            The run is the second module: `run_vehicle_filter` with GPS at all times.
        starts : array_like of int, (outages,)
            Epochs at which real outages begin. Nothing after them is used for them.

        Returns
        -------
        Ramps
            One pair for each epoch of each simulated outage and each run.
        """
        begin, last = np.asarray(starts), len(run.epochs) - 1
        if self.restart == "aligned":
            first = np.unique(begin) - self.tau
        else:
            pace = self.tau if self.restart == "successive" else self.spacing
            first = np.arange(self.phase, int(begin.max()), pace)
        first = first[(first >= 0) & (first < last)]
        if begin.max() > last or not len(first):
            must_be = f"within the run, with {self.tau} or more epochs before the last"
            raise ParameterError("starts", begin.tolist(), must_be)
        # where the run ends, the simulated outage that is under way ends with it
        lengths = np.minimum(self.tau, last - first)
        parts = [
            self._ramps_of(drive, run, first[lengths == length], int(length))
            for length in np.unique(lengths)
        ]
        names = [field.name for field in fields(Ramps)]
        return Ramps(**{n: np.concatenate([getattr(part, n) for part in parts]) for n in names})

    def _ramps_of(self, drive: Drive, run: VehicleRun, first: Integers, length: int) -> Ramps:
        """Return the pairs of simulated outages of one length."""
        ramps = replay(drive, self.settings, run, first, length, aiding=self.aiding)
        second = np.moveaxis(run.position, 2, 1)[ramps.epochs, ramps.which]
        apart = (np.moveaxis(ramps.first, 2, 1) - second) * metres(second)
        difference = apart[..., [1, 0]]
        if self.frame == "body":
            difference = _turned(difference, yaw(ramps.states.attitude))
        elapsed = np.arange(length + 1)[:, None] * drive.interval
        shape, steps = ramps.epochs.shape, slice(1, None)  # at the start both know the same
        return Ramps(
            epoch=ramps.epochs[steps].ravel(),
            run=np.broadcast_to(ramps.which, shape)[steps].ravel(),
            ramp=np.broadcast_to(ramps.epochs[0], shape)[steps].ravel(),
            elapsed=np.broadcast_to(elapsed, shape)[steps].ravel(),
            motion=sensed_motion(drive)[ramps.epochs, :, ramps.which][steps].reshape(-1, 3),
            difference=difference[steps].reshape(-1, 2),
        )

    def bridge(
        self,
        drive: Drive,
        run: VehicleRun,
        starts: ArrayLike,
        steps: int,
        *,
        ramps: Ramps | None = None,
        branch: VehicleRun | None = None,
    ) -> Bridge:
        """Navigate through outages of some epochs, each after the epoch of its start.

        Parameters
        ----------
        drive, run, starts
            As in `simulate_outages`; two pairs or more have to be before a start.
        steps : int
            Length of the outages (epochs).
        ramps, branch : optional
            From `simulate_outages` and `replay`, for methods that share them.
        """
        pairs = self.simulate_outages(drive, run, starts) if ramps is None else ramps
        if branch is None:
            branch = replay(drive, self.settings, run, starts, steps, aiding=self.aiding)
        motion = sensed_motion(drive)[branch.epochs, :, branch.which]
        elapsed = np.arange(steps + 1, dtype=float) * drive.interval
        predicted = np.zeros((steps + 1, len(branch.which), 2))
        machines = []
        for b, (which, start) in enumerate(zip(branch.which, branch.epochs[0], strict=True)):
            machine = self.train(pairs, int(which), int(start))
            found = machine.predict(self.inputs(motion[:, b], elapsed))
            predicted[:, b] = found - found[0] if self.anchored else found
            machines.append(machine)
        predicted[0] = 0.0  # at its start the outage has not begun
        if self.frame == "body":
            predicted = _turned(predicted, yaw(branch.states.attitude))
        position = np.moveaxis(branch.first, 2, 1).copy()
        position[0] = branch.position[0].T
        position[..., :2] -= predicted[..., [1, 0]] / metres(position)[..., :2]
        return Bridge(branch, np.moveaxis(position, 1, 2), np.moveaxis(predicted, 1, 2), machines)

    def train(self, pairs: Ramps, which: int, start: int) -> Machine:
        """Return the regressor, trained on the latest pairs of a run at an outage's start.

        Nothing after the epoch of the start is used; at least two pairs have to be before it.
        """
        if not self.past:
            return self._trained(self.regressor, pairs, which, start)
        own = pairs.run == which
        # a ramp has to be over, and to have a window before it
        begun = np.unique(pairs.ramp[own & (pairs.ramp + self.tau <= start)])
        begun = begun[begun >= self.phase + self.window][-self.past :]
        candidates = (self.regressor, *self.rivals)
        scores = [sum(self._miss(pairs, which, int(b), each) for b in begun) for each in candidates]
        silent = np.sum(pairs.difference[own & np.isin(pairs.ramp, begun)] ** 2)
        best = int(np.argmin(scores))
        if scores[best] >= silent:
            return Machine()
        return self._trained(candidates[best], pairs, which, start)

    def _miss(self, pairs: Ramps, which: int, begin: int, regressor: Any) -> float:
        """Return the squared error of a regressor on a simulated outage."""
        found, true = self.predict_ramp(pairs, which, begin, regressor)
        return float(np.sum((found - true) ** 2))

    def predict_ramp(
        self, pairs: Ramps, which: int, begin: int, regressor: Any = None
    ) -> tuple[Array, Array]:
        """Return what a regressor, trained before a simulated outage, says of it, and what came.

        The outage is that of run `which` that began at the epoch `begin`; both are (steps, 2), m.
        """
        rows = np.flatnonzero((pairs.run == which) & (pairs.ramp == begin))
        if not len(rows):
            raise ParameterError("begin", begin, "the start of a simulated outage")
        candidate = self.regressor if regressor is None else regressor
        machine = self._trained(candidate, pairs, which, begin)
        found = machine.predict(self.inputs(pairs.motion[rows], pairs.elapsed[rows]))
        return found, pairs.difference[rows]

    def _trained(self, regressor: Any, pairs: Ramps, which: int, start: int) -> Machine:
        """Train a regressor on the pairs of the window, in the order of their epochs."""
        chosen = (pairs.run == which) & (pairs.epoch <= start) & (pairs.epoch > start - self.window)
        if self.restart == "aligned":
            chosen &= pairs.ramp == start - self.tau
        rows = np.flatnonzero(chosen)
        rows = rows[np.argsort(pairs.epoch[rows], kind="stable")]
        if len(rows) < 2:
            raise ParameterError("starts", start, "epochs with two or more pairs before them")
        X = self.inputs(pairs.motion[rows], pairs.elapsed[rows])
        return Machine.fit(regressor, X, pairs.difference[rows], self.scaled)

    def inputs(self, motion: Array, elapsed: Array) -> Array:
        """Return the inputs of P3 (39) that are asked for, (pairs, inputs)."""
        parts = [motion] if self.motion else []
        return np.hstack([*parts, elapsed[:, None]] if self.timed else parts)


def sensed_motion(drive: Drive) -> Array:
    """Return forward and lateral specific force and yaw rate, (epochs, 3, runs); P3 (39).

    Means over the interval that ends at the epoch, as the IMU tells them (m/s^2, m/s^2, rad/s); at
    the first epoch those of the second.

    Examples
    --------
    A car that stands for the first seconds feels its sensors' errors and the slope of the road:

    >>> import inswsn_lib as iw
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive = iw.simulate_drive(p3, runs=2, seed=0)
    >>> iw.navigation.sensed_motion(drive)[:10].mean(axis=(0, 2)).round(1)
    array([ 0.2, -0.1,  0. ])
    """
    turns, pushes = drive.increments
    means = [pushes[..., 0].sum(-1), pushes[..., 1].sum(-1), turns[..., 2].sum(-1)]
    rates = np.moveaxis(np.stack(means, axis=-1), 0, 2) / drive.interval
    return np.concatenate([rates[:1], rates])


def _turned(vector: Array, heading: Array) -> Array:
    """Return east and north as forward and right, or forward and right as east and north."""
    sine, cosine = np.sin(heading), np.cos(heading)
    a, b = vector[..., 0], vector[..., 1]
    return np.stack([a * sine + b * cosine, a * cosine - b * sine], axis=-1)
