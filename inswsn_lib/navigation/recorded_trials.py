"""Outages in the recorded drive, each in a replay of its own, and keeping what came of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.files import WRITTEN, read_text
from inswsn_lib.inertial import metres
from inswsn_lib.logs.correction import is_quiet
from inswsn_lib.navigation.vehicle_hybrid import VehicleHybrid
from inswsn_lib.navigation.vehicle_outages import OUTAGE, as_starts, run_ladder, run_outages
from inswsn_lib.simulation import Drive
from inswsn_lib.streams import Imu, Recording
from inswsn_lib.vehicle import (
    FilterSettings,
    emulate_sensors,
    estimate_mounting,
    run_vehicle_filter,
)

_FORM = 2
_STANDS = 2  # s, for which an IMU is quiet before it is believed


@dataclass(frozen=True, eq=False)
class RecordedTrials:
    """What each method did in each outage of the recorded drive.

    Attributes
    ----------
    starts : ndarray of int, (outages,)
        The last epochs with GPS.
    errors : dict of str to ndarray, (steps + 1, outages, runs)
        Horizontal distance from RTK (m), by method.
    tracks : dict of str to ndarray, (steps + 1, 2, outages)
        East and north of the first epoch of the drive (m), by method, in the first run.
    reference : ndarray, (epochs, 2)
        RTK, likewise.
    speed : ndarray, (epochs,)
        Over ground (m/s).
    mounting : ndarray, (2, outages, runs)
        Yaw and pitch of the car's forward axis in the IMU's axes, as estimated before each outage
        (rad): to the right, and up.
    ladder : dict of str to ndarray, (steps + 1, outages, runs)
        As `errors`, in outages of 40 s at most, by `run_ladder`: there are no wheels.
    """

    starts: NDArray[np.intp]
    errors: dict[str, Array]
    tracks: dict[str, Array]
    reference: Array
    speed: Array
    mounting: Array
    ladder: dict[str, Array]

    def to_json(self, **facts: Any) -> str:
        """Return the trials as JSON, to millimetres, with facts about where they come from."""
        content: dict[str, Any] = {"form": _FORM, "facts": facts}
        for name, value in vars(self).items():
            digits = 6 if name == "mounting" else 3
            content[name] = (
                {method: np.round(x, digits).tolist() for method, x in value.items()}
                if isinstance(value, dict)
                else np.round(value, digits).tolist()
            )
        return json.dumps(content, separators=(",", ":")) + "\n"


def read_trials(path: Path) -> tuple[RecordedTrials, dict[str, Any]]:
    """Return what a file keeps of `RecordedTrials.to_json`: the trials, and the facts.

    Examples
    --------
    What ``studies/recorded_drive.py`` kept of the recorded drive:

    >>> import inswsn_lib as iw
    >>> trials, facts = iw.navigation.read_trials(iw.data_file("recorded/p3-drive.json"))
    >>> trials.starts[:3].tolist(), trials.errors["never"].shape, facts["draws"]
    ([120, 150, 180], (51, 12, 4), 4)
    """
    try:
        content = json.loads(read_text(path, WRITTEN))
        if content["form"] != _FORM:
            raise ValueError(content["form"])
        for name in ("errors", "tracks", "ladder"):
            content[name] = {m: np.array(x, dtype=float) for m, x in content[name].items()}
        for name in ("reference", "speed", "mounting"):
            content[name] = np.array(content[name], dtype=float)
        starts, facts = np.array(content.pop("starts"), dtype=np.intp), dict(content.pop("facts"))
        del content["form"]
        return RecordedTrials(starts=starts, **content), facts
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        RecursionError,
        OverflowError,
    ):
        raise InswsnError(f"{path} does not hold the trials of a recorded drive.") from None


def run_recorded_outages(
    recording: Recording,
    settings: FilterSettings,
    starts: ArrayLike,
    steps: int,
    hybrids: Callable[[FilterSettings], Mapping[str, VehicleHybrid]],
    *,
    runs: int,
    seed: int,
) -> RecordedTrials:
    """Take GPS away in the recorded drive, each outage in a replay of its own.

    The IMU's mounting is estimated anew for each outage, from data before it alone: a filter with
    GPS and without compass and lateral constraint runs over the drive, and the direction of motion
    in the IMU's axes up to the outage tells (`estimate_mounting`). That the car stands is told by
    an IMU as quiet as in the quietest seconds before the first outage.

    Parameters
    ----------
    recording : Recording
        As in `emulate_sensors`.
    settings, starts, steps
        As in `run_outages`.
    hybrids : callable
        Takes the settings and returns the hybrids by name, for example `p3_hybrids`.
    runs, seed : int
        Draws of the noise of the emulated GPS and compass, and their seed.

    Raises
    ------
    ParameterError
        If an outage leaves the drive, or the car has not been faster than 5 m/s before one: then
        nothing tells the mounting.

    Examples
    --------
    >>> import numpy as np, inswsn_lib as iw
    >>> from inswsn_lib.streams import Fixes, Imu
    >>> p3 = iw.with_values(iw.load_scenario(iw.data_file("scenarios/p3.yaml")), imu_period=0.1)
    >>> drive, told = iw.simulate_drive(p3, runs=1, seed=0), iw.FilterSettings.from_settings(p3)
    >>> rate, force = 10 * drive.rotation_increments.T[0], 10 * drive.velocity_increments.T[0]
    >>> imu = Imu(0.1 * np.arange(len(rate.T)) + 0.05, rate.T, force.T)
    >>> origin, way = drive.reference.position[0], drive.reference
    >>> fixes = Fixes(drive.time, iw.inertial.Earth(*origin).local(way.position), way.velocity)
    >>> recording = iw.Recording("made", imu=imu, fixes=fixes, origin=origin)
    >>> trials = iw.navigation.run_recorded_outages(
    ...     recording, told, [110], 10, lambda told: {}, runs=2, seed=0
    ... )
    >>> bool(np.degrees(np.abs(trials.mounting)).max() < 3)  # the IMU is not turned in this car
    True
    """
    begin = as_starts(starts)
    raw = emulate_sensors(recording, runs=runs, seed=seed)
    position, velocity = raw.reference.position, raw.reference.velocity
    free = run_vehicle_filter(raw, settings, aiding=False, last=int(begin.max()))
    origin, size = position[0], metres(position[0])
    trials, ladders, mountings = [], [], []
    standing = _standing(raw, int(begin.min()))
    for start in begin:
        rotation = estimate_mounting(free, int(start))
        forward, right, down = np.moveaxis(rotation[:, 0], 1, 0)
        mountings.append([np.arctan2(right, forward), np.arctan2(-down, np.hypot(forward, right))])
        drive = emulate_sensors(recording, runs=runs, seed=seed, mounting=rotation)
        trials.append(run_outages(drive, settings, [start], steps, hybrids(settings)))
        seen = replace(drive, body_velocity=standing)
        ladders.append(run_ladder(seen, settings, [start], min(steps, OUTAGE)))
    methods = list(trials[0].errors)
    return RecordedTrials(
        starts=begin,
        errors={m: np.concatenate([t.errors[m] for t in trials], axis=1) for m in methods},
        tracks={
            m: np.stack(
                [((t.positions[m][:, :, 0, 0] - origin) * size)[:, [1, 0]] for t in trials], axis=2
            )
            for m in methods
        },
        reference=((position - origin) * size)[:, [1, 0]],
        speed=np.hypot(velocity[:, 0], velocity[:, 1]),
        mounting=np.stack(mountings, axis=1),
        ladder={m: np.concatenate([x[m] for x in ladders], axis=1) for m in ladders[0]},
    )


def _standing(drive: Drive, until: int) -> Array:
    """Return zeros where the first run's IMU has been quiet for two seconds, (epochs, 3, runs)."""
    turns, pushes = (x[0].reshape(-1, 3) / drive.period for x in drive.increments)
    time = drive.period * np.arange(1.0, len(turns) + 1)
    imu = Imu(np.asarray(time, dtype=float), np.asarray(turns), np.asarray(pushes))
    quiet = np.concatenate([[0], np.cumsum(is_quiet(imu, drive.time[until]))])
    ends = drive.samples_per_epoch * np.arange(len(drive.time))
    count = round(_STANDS / drive.period)
    standing = quiet[ends] - quiet[np.maximum(ends - count, 0)] == count
    return np.where(standing[:, None, None], 0.0, np.full((1, 3, drive.runs), np.nan))
