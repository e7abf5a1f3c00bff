"""Whether the streams of a recording fit together, before a filter runs on them."""

from __future__ import annotations

from inswsn_lib.logs.findings import Finding
from inswsn_lib.logs.set_up_motion import check_imu, check_odometry, check_velocities
from inswsn_lib.logs.set_up_positions import check_positions
from inswsn_lib.logs.set_up_streams import check_failed, check_gaps, check_stamps
from inswsn_lib.streams import Recording

_FEWEST = 2  # rows of a reference that tells anything


def check_set_up(recording: Recording) -> list[Finding]:
    """Return what each check of the streams of a recording found.

    Each compares one number with a bound that a right set-up exceeds by chance once in a thousand
    recordings, or less often: quantiles of Student's and of Fisher's distribution by blocks of 5 s,
    in which errors may hang together in any way, beside what is let pass since it is no wrong
    set-up. Units and the direction of gravity are compared with bounds that chance has no part in.

    ========= ==================================================== =================================
    name      what is wrong if it fails                            what is let pass
    ========= ==================================================== =================================
    unit      of specific force, angular rate, ranges or anchors   a third of the size, or less
    repeats   an anchor has two ranges with one stamp              none
    gaps      a stream is not there for long                       what rows at random times have
    span      a stream is not there while others are               a fiftieth of its time, or more
    itself    fixes do not move as their velocities say            half of the speed
    values    a sensor sticks, saturates, or is quantised coarsely 20 equal rows, 1 % at a limit
    values    a range means that nothing was measured: it is not   2 % of the rows
              above 0, or always the same and far from others
    values    each value is logged again until there is a new one  1.4 times
    values    rows of a reference that no motion joins with others 6 times its usual speed
    stamps    they fall behind, and then catch up                  0.3 s
    axes      exchanged, reversed or mirrored, of all signed       none
              permutations, 48 in space
    gravity   the specific force, by the attitude, is not upwards  5 degrees on average
    time      the clock of the IMU, of ranges or fixes             0.02 s
    mounting  the IMU is turned against the reference's body       5 degrees
    place     an anchor is elsewhere                               three times the noise of a range
    bias      an anchor's ranges are longer than those of others   three times the noise of a range
    scale     ranges grow too fast with distance                   5 %
    lever arm ranges are to another point of the body              half the noise of a range
    frame     anchors or fixes are turned or shifted               3 degrees, 3 times the noise
    odometry  sign or size of speed and heading rate               10 %
    ========= ==================================================== =================================

    What the data cannot tell, because nothing turns or moves, or there is no reference, has None
    for `fits`, and `says` tells why. Where a unit or the axes are wrong, what depends on them is
    not asked. Ranges that mean that nothing was measured are left out of the rest. `verdict` makes
    a sentence of the findings.

    Parameters
    ----------
    recording : Recording

    Examples
    --------
    An IMU that was logged in g, without any noise, and nothing to compare its rates with:

    >>> import numpy as np
    >>> from inswsn_lib.logs import check_set_up
    >>> from inswsn_lib.streams import Imu, Recording
    >>> force = np.tile([0.0, 0.0, 1.0], (100, 1))
    >>> imu = Imu(time=np.arange(100) * 0.01, rate=np.zeros((100, 3)), force=force)
    >>> for found in check_set_up(Recording("logged in g", imu=imu)):
    ...     print(found.name, found.subject, found.fits)
    gaps imu True
    values imu False
    values imu, limits False
    unit IMU's specific force False
    unit IMU's rates None
    axes IMU None
    """
    if recording.reference is not None and len(recording.reference) < _FEWEST:
        recording = recording.without("reference")
    gaps = check_gaps(recording)
    failed, recording = check_failed(recording)
    return [
        *failed,
        *gaps,
        *check_stamps(recording),
        *check_imu(recording),
        *check_velocities(recording),
        *check_positions(recording),
        *check_odometry(recording),
    ]
