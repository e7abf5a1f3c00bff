"""Outages in the recorded drive, each in a replay of its own, and keeping what came of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import InswsnError
from inswsn_lib.navigation.trials import as_starts, run_outages
from inswsn_lib.navigation.vehicle_hybrid import VehicleHybrid
from inswsn_lib.vehicle import (
    FilterSettings,
    RecordedDrive,
    emulate_sensors,
    estimate_mounting,
    metres,
    run_vehicle_filter,
)

Array = NDArray[np.float64]
Hybrids = Callable[[FilterSettings], Mapping[str, VehicleHybrid]]

_FORM = 1
_DIGITS = 3  # millimetres


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
        (rad).

    Examples
    --------
    What ``studies/recorded_drive.py`` kept of the recorded drive:

    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.navigation import read_trials
    >>> trials, facts = read_trials(data_file("recorded/p3-drive.json"))
    >>> steps, outages, runs = trials.errors["never"].shape
    >>> len(trials.starts) == outages, trials.mounting.shape == (2, outages, runs)
    (True, True)
    >>> trials.tracks["never"].shape == (steps, 2, outages)
    True
    """

    starts: NDArray[np.intp]
    errors: dict[str, Array]
    tracks: dict[str, Array]
    reference: Array
    speed: Array
    mounting: Array

    def to_json(self, **facts: Any) -> str:
        """Return the trials as JSON, to millimetres, with facts about where they come from.

        Parameters
        ----------
        **facts
            What JSON can hold, by name.

        Returns
        -------
        str
            What `read_trials` reads from a file.
        """
        content = {
            "form": _FORM,
            "facts": facts,
            "starts": self.starts.tolist(),
            "errors": {name: np.round(e, _DIGITS).tolist() for name, e in self.errors.items()},
            "tracks": {name: np.round(t, _DIGITS).tolist() for name, t in self.tracks.items()},
            "reference": np.round(self.reference, _DIGITS).tolist(),
            "speed": np.round(self.speed, _DIGITS).tolist(),
            "mounting": np.round(self.mounting, 6).tolist(),
        }
        return json.dumps(content, separators=(",", ":")) + "\n"


def read_trials(path: Path) -> tuple[RecordedTrials, dict[str, Any]]:
    """Return trials that were kept, and the facts about them.

    Parameters
    ----------
    path : Path
        A file of what `RecordedTrials.to_json` returned.

    Returns
    -------
    trials : RecordedTrials
        To millimetres.
    facts : dict of str to object

    Raises
    ------
    InswsnError
        If the file is not one of `RecordedTrials.to_json`.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import numpy as np
    >>> from inswsn_lib.navigation import RecordedTrials, read_trials
    >>> trials = RecordedTrials(
    ...     starts=np.array([7]), errors={"hold": np.array([[[0.0]], [[1.23456]]])},
    ...     tracks={"hold": np.zeros((2, 2, 1))}, reference=np.zeros((9, 2)), speed=np.zeros(9),
    ...     mounting=np.zeros((2, 1, 1)),
    ... )
    >>> with TemporaryDirectory() as folder:
    ...     _ = Path(folder, "trials.json").write_text(trials.to_json(level=2.0))
    ...     found, facts = read_trials(Path(folder, "trials.json"))
    >>> facts, found.starts.tolist(), found.errors["hold"].ravel().tolist()
    ({'level': 2.0}, [7], [0.0, 1.235])
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["form"] != _FORM:
            raise InswsnError(f"{path} has the form {content['form']}; it may be {_FORM}.")
        errors, tracks = (
            {method: np.array(x, dtype=float) for method, x in content[name].items()}
            for name in ("errors", "tracks")
        )
        trials = RecordedTrials(
            starts=np.array(content["starts"], dtype=np.intp),
            errors=errors,
            tracks=tracks,
            reference=np.array(content["reference"], dtype=float),
            speed=np.array(content["speed"], dtype=float),
            mounting=np.array(content["mounting"], dtype=float),
        )
        return trials, dict(content["facts"])
    except FileNotFoundError:
        raise InswsnError(f"There is no file {path}.") from None
    except InswsnError:
        raise
    except (KeyError, TypeError, AttributeError, ValueError, OSError):
        raise InswsnError(f"{path} does not hold the trials of a recorded drive.") from None


def run_recorded_outages(
    recorded: RecordedDrive,
    settings: FilterSettings,
    starts: ArrayLike,
    steps: int,
    hybrids: Hybrids,
    *,
    runs: int,
    seed: int,
) -> RecordedTrials:
    """Take GPS away in the recorded drive, each outage in a replay of its own.

    The IMU's mounting is estimated anew for each outage, from data before it alone: a filter with
    GPS and without compass and lateral constraint runs over the drive, and the direction of motion
    in the IMU's axes up to the outage tells (`estimate_mounting`).

    Parameters
    ----------
    recorded : RecordedDrive
    settings : FilterSettings
    starts : array_like of int, (outages,)
        The last epochs with GPS.
    steps : int
        Length of the outages (epochs).
    hybrids : callable
        Takes the settings and returns the hybrids by name, for example `p3_hybrids`.
    runs : int
        Draws of the noise of the emulated GPS and compass.
    seed : int
        Of these draws.

    Returns
    -------
    RecordedTrials

    Raises
    ------
    ParameterError
        If an outage leaves the drive, or the car has not been faster than 5 m/s before one: then
        nothing tells the mounting.

    Examples
    --------
    A recording of the same form, made from a simulated drive, and one outage of ten seconds in its
    first turn:

    >>> import numpy as np
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.learning import HoldRegressor
    >>> from inswsn_lib.navigation import VehicleHybrid, run_recorded_outages
    >>> from inswsn_lib.scenario import load_scenario, with_values
    >>> from inswsn_lib.vehicle import FilterSettings, RecordedDrive, simulate_drive
    >>> from inswsn_lib.vehicle.recorded import Track
    >>> scenario = load_scenario(data_file("scenarios/p3.yaml"))
    >>> drive = simulate_drive(with_values(scenario, imu_period=0.1), runs=1, seed=0)
    >>> true = drive.reference
    >>> track = Track(drive.time, true.position, true.velocity, np.ones(len(drive.time), int))
    >>> recorded = RecordedDrive(
    ...     0.0, drive.time, drive.period, drive.rotation_increments[..., 0],
    ...     drive.velocity_increments[..., 0], true.position, true.velocity, track,
    ... )
    >>> trials = run_recorded_outages(
    ...     recorded, FilterSettings.from_settings(scenario), [drive.places[0].start], 10,
    ...     lambda settings: {"hold": VehicleHybrid(settings, HoldRegressor())}, runs=2, seed=0,
    ... )
    >>> list(trials.errors), trials.errors["hold"].shape
    (['never', 'until', 'through', 'hold'], (11, 1, 2))
    >>> bool(np.degrees(np.abs(trials.mounting)).max() < 3)  # the IMU is not turned in this car
    True
    """
    begin = as_starts(starts)
    raw = emulate_sensors(recorded, runs=runs, seed=seed)
    free = run_vehicle_filter(raw, settings, aiding=False, last=int(begin.max()))
    errors: dict[str, list[Array]] = {}
    tracks: dict[str, list[Array]] = {}
    mountings = []
    origin, size = recorded.position[0], metres(recorded.position[0])
    for start in begin:
        mounting = estimate_mounting(free, int(start))
        mountings.append([mounting.yaw, mounting.pitch])
        drive = emulate_sensors(recorded, runs=runs, seed=seed, mounting=mounting.rotation)
        trials = run_outages(drive, settings, [start], steps, hybrids(settings))
        for name, error in trials.errors.items():
            errors.setdefault(name, []).append(error[:, 0])
            moved = (trials.positions[name][:, :, 0, 0] - origin) * size
            tracks.setdefault(name, []).append(moved[:, [1, 0]])
    return RecordedTrials(
        starts=begin,
        errors={name: np.stack(parts, axis=1) for name, parts in errors.items()},
        tracks={name: np.stack(parts, axis=2) for name, parts in tracks.items()},
        reference=((recorded.position - origin) * size)[:, [1, 0]],
        speed=np.hypot(recorded.velocity[:, 0], recorded.velocity[:, 1]),
        mounting=np.moveaxis(np.array(mountings), 1, 0),
    )
