"""Run P3's methods through the outages of the recorded drive and keep it: `make studies`.

Evidence p3-vehicle runs the same on each build where the recording is there; else it
shows what this script kept in data/recorded/p3-drive.json, and says so. The recording is fetched,
or comes from the mirror that INSWSN_DATA names.

The filter's inertial noises are calibrated on the epochs 40 s to 120 s alone, which lie before the
first outage; the mounting of the IMU is estimated anew for each outage, from data before it.
"""

from __future__ import annotations

import datetime
from dataclasses import replace
from pathlib import Path

import numpy as np
from inswsn_book.record.files import write_whole
from inswsn_book.record.provenance import repository_state

from inswsn_lib.logs import load_drive
from inswsn_lib.navigation import p3_hybrids, run_recorded_outages
from inswsn_lib.scenario import load_scenario
from inswsn_lib.vehicle import FilterSettings, calibrate_inertial_noise, emulate_sensors

ROOT = Path(__file__).parent.parent
SEED, DRAWS, STEPS = 2015, 4, 50
TAU, WINDOW = 40, 40
STARTS = np.arange(120, 460, 30)
ROWS = (40, 120)


def main() -> None:
    """Run and write."""
    recorded = load_drive()
    beliefs = replace(
        FilterSettings.from_settings(load_scenario(ROOT / "data/scenarios/p3.yaml")),
        yaw=float(np.deg2rad(10)),
        tilt=float(np.deg2rad(5)),
        accelerometer_bias=0.3,
        gyro_drift=float(np.deg2rad(0.5)),
    )
    emulated = emulate_sensors(recorded, runs=DRAWS, seed=SEED)
    settings, levels = calibrate_inertial_noise(emulated, beliefs, ROWS)
    trials = run_recorded_outages(
        recorded,
        settings,
        STARTS,
        STEPS,
        lambda told: p3_hybrids(told, tau=TAU, window=WINDOW),
        runs=DRAWS,
        seed=SEED,
    )
    commit, clean = repository_state(ROOT)
    text = trials.to_json(
        made=datetime.datetime.now(datetime.UTC).date().isoformat(),
        commit=commit,
        clean=clean,
        seed=SEED,
        draws=DRAWS,
        lateral=settings.lateral,
        tau=TAU,
        window=WINDOW,
        level=settings.gyro_noise / beliefs.gyro_noise,
        levels={f"{level:g}": round(mean, 4) for level, mean in levels.items()},
    )
    write_whole(ROOT / "data/recorded/p3-drive.json", text)


if __name__ == "__main__":
    main()
