"""A tag of ultra-wideband radio and an IMU, carried by hand before motion capture.

So are the recordings of INRoL/inrol_uwb_localization. Their anchors are surveyed, about 170 ranges
come in a second, and the motion capture tells position and attitude of the IMU at about 118 Hz; now
and then for a row or two it tells another attitude.
"""

from __future__ import annotations

import numpy as np

from inswsn_lib.logs.files import Place, digests_of, files_of, pick
from inswsn_lib.logs.rows import (
    check_twins,
    numbered_ranges,
    read_rows,
    reading,
    unit_quaternions,
)  # fmt: skip
from inswsn_lib.streams import Imu, Recording, Reference

#: From the IMU to the tag, in the IMU's axes (m), as parameter.yaml of the repository has both
LEVER_ARM = (0.0, 0.0, 0.010)


def read_inrol(place: Place) -> Recording:
    """Read ``anchor.txt``, ``imu.txt``, ``imu_pose.txt`` and ``uwb.txt``.

    Ranges of one exchange have one time stamp. One that was written after a later one is put in its
    place; nothing else is changed.

    Examples
    --------
    >>> from inswsn_lib.logs.inrol import read_inrol
    >>> read_inrol({})
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.InswsnError: There is no file anchor.txt.
    """
    files = files_of(place)
    paths = [pick(files, f"{name}.txt") for name in ("anchor", "imu", "imu_pose", "uwb")]
    # number, position and attitude | row, time, rate and force | time, position and attitude |
    # row, time, anchor and range
    anchors, sensed, poses, heard = map(read_rows, paths, (8, 8, 8, 4))
    heard = heard[np.argsort(heard[:, 1], kind="stable")]
    with reading(paths[0]):
        check_twins(anchors[:, 0].tolist())
    with reading(paths[1]):
        imu = Imu(time=sensed[:, 1], rate=sensed[:, 2:5], force=sensed[:, 5:8])
    with reading(paths[2]):
        attitude = unit_quaternions(poses[:, 4:8])
        reference = Reference(time=poses[:, 0], position=poses[:, 1:4], attitude=attitude)
    with reading(paths[3]):
        ranges = numbered_ranges(
            heard[:, 1], heard[:, 2], heard[:, 3], anchors[:, 0], anchors[:, 1:4]
        )
    return Recording(
        "inrol",
        imu=imu,
        ranges=ranges,
        reference=reference,
        lever_arm=np.array(LEVER_ARM),
        digests=digests_of(*paths),
    )
