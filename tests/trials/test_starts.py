"""How often an alignment returns a start, and whether that is as good as it says."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from lib.inertial.made import Log, off_by

from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import align

WHOLE = 200
#: Deviations that are assumed: those of what is drawn are half as large
ASSUMED = (1000.0, 30.0, 2.0, 0.6, 0.06)


def test_starts(size: Callable[[int, int], int], seed: int, tell: Callable[[str], None]) -> None:
    """At most a quarter is refused, and 99 of 100 starts lie within 3.5 of their deviations."""
    trials, off, refused = size(10, WHOLE), [], []
    for k in range(trials):
        log = Log.drawn(1000 * seed + k)
        motion, seen, attitude, _ = log.make()
        try:
            start = align(motion, seen, 0.0, 60.0, deviations=ASSUMED)
        except InswsnError as error:
            refused.append((log, str(error)))
        else:
            off.append(float(np.abs(off_by(start, attitude(start.time))).max()))
    tell(
        f"{trials} logs: {len(refused)} refused; of {len(off)} starts "
        f"{np.sum(np.array(off) > 3.5)} beyond 3.5 deviations, the largest at {max(off):.1f}"
    )
    assert len(refused) <= 0.25 * trials, refused
    assert np.sum(np.array(off) > 3.5) <= 0.01 * len(off), sorted(off)[-5:]
