"""Make the raw logs that come with the project, of a simulated walk: data/examples/raw-walk.

The page on your own data reports on them, and shows what files of a reader's own must look like.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from made_recording import made, made_imu

from inswsn_lib.logs import write_csv

FOLDER = Path(__file__).parent.parent / "data/examples/raw-walk"
SEED, SECONDS = 31, 60.0


def main() -> None:
    """Write the files, IMU and reference at half of their rate, rounded as a logger would."""
    walk = replace(
        made(SEED, seconds=SECONDS, rate=80.0, noise=0.15),
        imu=made_imu(SEED, seconds=SECONDS),
        name="walk",
    )
    imu, ranges, reference = walk.imu, walk.ranges, walk.reference
    assert imu is not None
    assert ranges is not None
    assert reference is not None
    assert reference.attitude is not None
    even = slice(None, None, 2)
    walk = replace(
        walk,
        imu=replace(
            imu, time=imu.time[even], rate=imu.rate[even].round(4), force=imu.force[even].round(3)
        ),
        ranges=replace(
            ranges, time=ranges.time.round(6), distance=np.round(ranges.distance, 3)
        ),
        reference=replace(
            reference, time=reference.time[even].round(4),
            position=reference.position[even].round(4), attitude=reference.attitude[even].round(6),
        ),
        licence="BSD-3-Clause, simulated",
    )  # fmt: skip
    write_csv(walk, FOLDER)


if __name__ == "__main__":
    main()
