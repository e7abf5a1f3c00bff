"""P3's hybrid: two filters while GPS is heard, and a regressor that learns how they differ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn import config_context
from sklearn.base import clone

from inswsn_lib.errors import ParameterError
from inswsn_lib.learning import Scale
from inswsn_lib.vehicle import Drive, FilterSettings, VehicleRun, metres, replay, yaw

Array = NDArray[np.float64]
Integers = NDArray[np.intp]
Restart = Literal["successive", "aligned", "bank"]
Frame = Literal["navigation", "body"]


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
        Forward and lateral specific force (m/s^2) and yaw rate (rad/s), as the IMU tells them,
        means over the interval that ends at the epoch.
    difference : ndarray, (pairs, 2)
        Position of the first module, after compass and lateral velocity, less that of the second,
        after GPS: P3 (38), east and north (m), or forward and right.

    Examples
    --------
    From epoch 20 on one simulated outage after the other, ten seconds each, before a real one at
    40:

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.learning import HoldRegressor
    >>> from inswsn_lib.navigation import VehicleHybrid
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import FilterSettings, run_vehicle_filter, simulate_drive
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> settings = FilterSettings.from_settings(scenario)
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=1, seed=0)
    >>> run = run_vehicle_filter(drive, settings, last=40)
    >>> hybrid = VehicleHybrid(settings, HoldRegressor(), tau=10, phase=20)
    >>> ramps = hybrid.simulate_outages(drive, run, [40])
    >>> ramps.ramp.tolist() == [20, 30] * 10, ramps.elapsed[:4].tolist()
    (True, [1.0, 1.0, 2.0, 2.0])
    >>> ramps.motion.shape, ramps.difference.shape
    ((20, 3), (20, 2))
    """

    epoch: Integers
    run: Integers
    ramp: Integers
    elapsed: Array
    motion: Array
    difference: Array


@dataclass(frozen=True, eq=False)
class Machine:
    """A trained regressor with the units it was trained in.

    Attributes
    ----------
    regressor : scikit-learn regressor or None
        None predicts zero.
    inputs, targets : Scale
    pairs : int
        How many trained it.

    Examples
    --------
    >>> import numpy as np
    >>> from sklearn.linear_model import LinearRegression
    >>> from inswsn_lib.learning import Scale
    >>> from inswsn_lib.navigation import Machine
    >>> X = np.arange(10.0)[:, None]
    >>> y = np.hstack([2 * X, 5 - X])
    >>> units = Scale.of(X, "standard"), Scale.of(y, "standard")
    >>> machine = Machine.fit(LinearRegression(), X, y, *units)
    >>> machine.pairs, machine.predict(np.array([[20.0]])).round(6).tolist()
    (10, [[40.0, -15.0]])
    >>> Machine(None, *units, pairs=0).predict(X[:1]).tolist()
    [[0.0, 0.0]]
    """

    regressor: Any
    inputs: Scale
    targets: Scale
    pairs: int

    @classmethod
    def fit(cls, regressor: Any, X: Array, y: Array, inputs: Scale, targets: Scale) -> Machine:
        """Train a clone.

        Parameters
        ----------
        regressor : scikit-learn regressor
            Left as it is.
        X, y : ndarray, (rows, inputs) and (rows, outputs)
            In their own units.
        inputs, targets : Scale
            Of X and of y.

        Returns
        -------
        Machine
        """
        with config_context(assume_finite=True):
            trained = clone(regressor).fit(inputs.transform(X), targets.transform(y))
        return cls(trained, inputs, targets, len(X))

    def predict(self, X: Array) -> Array:
        """Return the targets of inputs (rows, inputs), in their own units.

        Parameters
        ----------
        X : ndarray, (rows, inputs)
            In the inputs' own units.

        Returns
        -------
        ndarray, (rows, outputs)
        """
        if self.regressor is None:
            return np.zeros((len(X), self.targets.size.size))
        with config_context(assume_finite=True):
            found: Array = np.asarray(self.regressor.predict(self.inputs.transform(X)), dtype=float)
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
        The regressor of each outage, as it was trained last.

    Examples
    --------
    What was predicted is what the position is moved by:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.learning import HoldRegressor
    >>> from inswsn_lib.navigation import VehicleHybrid
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import FilterSettings, metres, run_vehicle_filter, simulate_drive
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> settings = FilterSettings.from_settings(scenario)
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=1, seed=0)
    >>> run = run_vehicle_filter(drive, settings, last=60)
    >>> bridge = VehicleHybrid(settings, HoldRegressor(), tau=20).bridge(drive, run, [60], 10)
    >>> before, after = bridge.branch.first[10, :, 0], bridge.position[10, :, 0]
    >>> moved = (before - after) * metres(before)  # north, east, up
    >>> bool(np.allclose(moved[[1, 0]], bridge.predicted[10, :, 0], atol=1e-6))
    True
    """

    branch: VehicleRun
    position: Array
    predicted: Array
    machines: list[Machine]


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

    Raises
    ------
    ParameterError
        If a number is not whole or too small, a word is not one of those above, options exclude one
        another, or a regressor is not one of scikit-learn.

    Examples
    --------
    Ten seconds without GPS after a minute's drive. A regressor that has learned from the outages
    that were simulated before predicts how far the filter without GPS goes astray:

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.learning import LSSVMRegressor
    >>> from inswsn_lib.navigation import VehicleHybrid
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import FilterSettings, run_vehicle_filter, simulate_drive
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> settings = FilterSettings.from_settings(scenario)
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=2, seed=0)
    >>> run = run_vehicle_filter(drive, settings, last=60)
    >>> hybrid = VehicleHybrid(settings, LSSVMRegressor(sigma=2.0, eta=10.0), tau=20, window=40)
    >>> bridge = hybrid.bridge(drive, run, [60], 10)
    >>> bridge.position.shape, bridge.machines[0].pairs  # the latest 40 s, one pair a second
    ((11, 3, 2), 40)
    >>> hybrid.bridge(drive, run, [0], 10)
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: starts is [0]; it may be 20 epochs later.
    """

    def __init__(
        self,
        settings: FilterSettings,
        regressor: Any,
        *,
        aiding: bool = True,
        tau: int = 40,
        restart: Restart = "successive",
        phase: int = 0,
        spacing: int = 5,
        window: int = 40,
        frame: Frame = "navigation",
        motion: bool = True,
        timed: bool = True,
        scaled: bool = True,
        anchored: bool = False,
        past: int = 0,
        rivals: Sequence[Any] = (),
    ) -> None:
        for name, value, low in (
            ("tau", tau, 1), ("phase", phase, 0), ("spacing", spacing, 1), ("window", window, 2),
            ("past", past, 0),
        ):  # fmt: skip
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < low:
                raise ParameterError(name, value, f"a whole number, {low} or more")
        for name, word, words in (
            ("restart", restart, ("successive", "aligned", "bank")),
            ("frame", frame, ("navigation", "body")),
        ):
            if word not in words:
                raise ParameterError(name, word, f"one of {', '.join(words)}")
        if past and (anchored or restart == "aligned"):
            raise ParameterError("past", past, "0 where ramps are aligned or predictions anchored")
        if not motion and not timed:
            raise ParameterError("timed", timed, "true where motion is no input")
        for machine in (regressor, *rivals):
            if not all(hasattr(machine, name) for name in ("fit", "predict", "get_params")):
                raise ParameterError("regressor", machine, "a scikit-learn regressor")
        self.settings, self.regressor, self.aiding = settings, regressor, aiding
        self.past, self.rivals = past, tuple(rivals)
        self.tau, self.restart, self.phase, self.spacing = tau, restart, phase, spacing
        self.window, self.frame = window, frame
        self.motion, self.timed, self.scaled, self.anchored = motion, timed, scaled, anchored

    @property
    def pairs_key(self) -> tuple[object, ...]:
        """What two hybrids share if they learn from the same pairs."""
        return (
            *(self.settings, self.aiding, self.tau, self.restart),
            *(self.phase, self.spacing, self.frame),
        )

    def simulate_outages(self, drive: Drive, run: VehicleRun, starts: ArrayLike) -> Ramps:
        """Run the first module through the simulated outages that outages at `starts` ask for.

        Parameters
        ----------
        drive : Drive
        run : VehicleRun
            The second module: `run_vehicle_filter` with GPS at all times.
        starts : array_like of int, (outages,)
            Epochs at which real outages begin. Nothing after them is used for them.

        Returns
        -------
        Ramps
            One pair for each epoch of each simulated outage and each run.

        Raises
        ------
        ParameterError
            If a start is not in the run, or there is no simulated outage before one.
        """
        last = len(run.epochs) - 1
        if np.max(starts) > last:
            raise ParameterError("starts", np.asarray(starts).tolist(), f"{last} at most")
        if self.restart == "aligned":
            first = np.unique(starts) - self.tau
        else:
            pace = self.tau if self.restart == "successive" else self.spacing
            first = np.arange(self.phase, int(np.max(starts)), pace)
        first = first[(first >= 0) & (first < last)]
        if not len(first):
            raise ParameterError("starts", np.asarray(starts).tolist(), f"{self.tau} epochs later")
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
        difference = _east_north(np.moveaxis(ramps.first, 2, 1) - second, second)
        if self.frame == "body":
            difference = _turn(difference, yaw(ramps.states.attitude))
        steps = slice(1, None)  # at the start both modules know the same
        shape = ramps.epochs[steps].shape
        elapsed = np.arange(1, length + 1) * drive.interval
        return Ramps(
            epoch=ramps.epochs[steps].ravel(),
            run=np.broadcast_to(ramps.which, shape).ravel(),
            ramp=np.broadcast_to(ramps.epochs[0], shape).ravel(),
            elapsed=np.broadcast_to(elapsed[:, None], shape).ravel(),
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
        """Navigate through outages.

        Parameters
        ----------
        drive, run, starts
            As for `simulate_outages`. Each outage begins after the epoch of its start.
        steps : int
            Length of the outages (epochs).
        ramps : Ramps, optional
            From `simulate_outages`, for methods that share them.
        branch : VehicleRun, optional
            From `replay`, likewise.

        Returns
        -------
        Bridge

        Raises
        ------
        ParameterError
            If an outage has fewer than two pairs before it.
        """
        starts = np.asarray(starts)
        pairs = self.simulate_outages(drive, run, starts) if ramps is None else ramps
        if branch is None:
            branch = replay(drive, self.settings, run, starts, steps, aiding=self.aiding)
        motion = sensed_motion(drive)[branch.epochs, :, branch.which]
        elapsed: Array = np.arange(steps + 1, dtype=float) * drive.interval
        predicted = np.zeros((steps + 1, len(branch.which), 2))
        machines = []
        for b, (which, start) in enumerate(zip(branch.which, branch.epochs[0], strict=True)):
            machine = self.train(pairs, int(which), int(start))
            found = machine.predict(self.inputs(motion[:, b], elapsed))
            predicted[:, b] = found - found[0] if self.anchored else found
            machines.append(machine)
        # at its start the outage has not begun
        predicted[0] = 0.0
        if self.frame == "body":
            predicted = _turn(predicted, yaw(branch.states.attitude))
        first = np.moveaxis(branch.first, 2, 1).copy()
        first[0] = branch.position[0].T
        size = metres(first)
        first[..., 1] -= predicted[..., 0] / size[..., 1]
        first[..., 0] -= predicted[..., 1] / size[..., 0]
        return Bridge(branch, np.moveaxis(first, 1, 2), np.moveaxis(predicted, 1, 2), machines)

    def train(self, pairs: Ramps, which: int, start: int) -> Machine:
        """Return the regressor, trained on the latest pairs of a run at an outage's start.

        Parameters
        ----------
        pairs : Ramps
            From `simulate_outages`.
        which : int
            The run.
        start : int
            The epoch at which the outage begins; no pair after it is used.

        Returns
        -------
        Machine

        Raises
        ------
        ParameterError
            If there are fewer than two pairs.
        """
        if not self.past:
            return self._trained(self.regressor, pairs, which, start)
        own = pairs.run == which
        # a ramp has to be over, and to have a window before it
        begun = np.unique(pairs.ramp[own & (pairs.ramp + self.tau <= start)])
        begun = begun[begun >= self.phase + self.window][-self.past :]
        scores = []
        for regressor in (self.regressor, *self.rivals):
            trials = [self.predict_ramp(pairs, which, int(b), regressor) for b in begun]
            scores.append(sum(float(np.sum((found - true) ** 2)) for found, true in trials))
        nothing = sum(
            float(np.sum(pairs.difference[own & (pairs.ramp == begin)] ** 2)) for begin in begun
        )
        best = int(np.argmin(scores))
        if scores[best] >= nothing:
            return Machine(
                None, Scale.of(np.zeros((1, 1)), "none"), Scale.of(np.zeros((1, 2)), "none"), 0
            )
        return self._trained((self.regressor, *self.rivals)[best], pairs, which, start)

    def predict_ramp(
        self, pairs: Ramps, which: int, begin: int, regressor: Any = None
    ) -> tuple[Array, Array]:
        """Return what a regressor, trained before a simulated outage, says of it, and what came.

        Parameters
        ----------
        pairs : Ramps
        which : int
            The run.
        begin : int
            The epoch at which the simulated outage began.
        regressor : scikit-learn regressor, optional
            Default: that of the hybrid.

        Returns
        -------
        predicted, difference : ndarray, (steps, 2)
            m.

        Raises
        ------
        ParameterError
            If no simulated outage of the run began there, or fewer than two pairs are before it.
        """
        rows = np.flatnonzero((pairs.run == which) & (pairs.ramp == begin))
        if not len(rows):
            raise ParameterError("begin", begin, "the start of a simulated outage")
        machine = self._trained(
            self.regressor if regressor is None else regressor, pairs, which, begin
        )
        found = machine.predict(self.inputs(pairs.motion[rows], pairs.elapsed[rows]))
        return found, pairs.difference[rows]

    def _trained(self, regressor: Any, pairs: Ramps, which: int, start: int) -> Machine:
        chosen = (pairs.run == which) & (pairs.epoch <= start) & (pairs.epoch > start - self.window)
        if self.restart == "aligned":
            chosen &= pairs.ramp == start - self.tau
        rows = np.flatnonzero(chosen)
        rows = rows[np.argsort(pairs.epoch[rows], kind="stable")]
        if len(rows) < 2:
            raise ParameterError("starts", start, "one with two or more pairs before it")
        X, y = self.inputs(pairs.motion[rows], pairs.elapsed[rows]), pairs.difference[rows]
        scaling: Literal["standard", "none"] = "standard" if self.scaled else "none"
        return Machine.fit(regressor, X, y, Scale.of(X, scaling), Scale.of(y, scaling))

    def inputs(self, motion: Array, elapsed: Array) -> Array:
        """Return the inputs of P3 (39), (pairs, inputs), or those of them that are asked for.

        Parameters
        ----------
        motion : ndarray, (pairs, 3)
            From `sensed_motion`.
        elapsed : ndarray, (pairs,)
            Time since the outage began (s).

        Returns
        -------
        ndarray, (pairs, inputs)
        """
        parts = [motion] if self.motion else []
        return np.hstack([*parts, elapsed[:, None]] if self.timed else parts)


def sensed_motion(drive: Drive) -> Array:
    """Return forward and lateral specific force and yaw rate, (epochs, 3, runs); P3 (39).

    Means over the interval that ends at the epoch, as the IMU tells them (m/s^2, m/s^2, rad/s); at
    the first epoch those of the second.

    Parameters
    ----------
    drive : Drive

    Returns
    -------
    ndarray, (epochs, 3, runs)

    Examples
    --------
    A parked car whose nose is up feels a part of the reaction to gravity forward; the IMU has 10
    Hz:

    >>> import numpy as np
    >>> from inswsn_lib.navigation import sensed_motion
    >>> from inswsn_lib.vehicle import Drive, Reference
    >>> pushes = np.zeros((20, 3, 1))
    >>> pushes[:, 0], pushes[:, 2] = 0.5 * 0.1, -9.8 * 0.1
    >>> drive = Drive(
    ...     time=np.arange(3.0), period=0.1, rotation_increments=0 * pushes,
    ...     velocity_increments=pushes, gps_position=np.zeros((3, 3, 1)),
    ...     gps_velocity=np.zeros((3, 3, 1)), compass=np.zeros((3, 1)), places=(),
    ...     reference=Reference(np.zeros((3, 3)), np.zeros((3, 3))), origin="simulated",
    ... )
    >>> sensed_motion(drive)[:, :, 0].round(6).tolist()
    [[0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]
    """
    turns, pushes = drive.increments
    means = np.stack(
        [pushes[..., 0].sum(-1), pushes[..., 1].sum(-1), turns[..., 2].sum(-1)], axis=-1
    )
    rates = np.moveaxis(means, 0, 2) / drive.interval
    return np.concatenate([rates[:1], rates])


def _east_north(difference: Array, position: Array) -> Array:
    """Return a difference of positions (..., 3) as east and north (..., 2), m."""
    scaled = difference * metres(position)
    return np.stack([scaled[..., 1], scaled[..., 0]], axis=-1)


def _turn(vector: Array, heading: Array) -> Array:
    """Return east and north as forward and right, or forward and right as east and north."""
    sine, cosine = np.sin(heading), np.cos(heading)
    a, b = vector[..., 0], vector[..., 1]
    return np.stack([a * sine + b * cosine, a * cosine - b * sine], axis=-1)
