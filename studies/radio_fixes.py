"""Fix a tag from recorded ranges of ultra-wideband radio and keep how good that is: `make studies`.

Evidence p1-training puts the errors of these fixes, in their order, into P1's scene, and
shows how accurate radio can be. A tag was carried by hand among eight surveyed anchors in a room,
and motion capture tells where it was. Each fix uses the ranges of one interval of 0.2 s alone, P1's
period: least squares in three dimensions from the middle of the anchors, nothing filtered and
nothing rejected.

The recording is fetched, or comes from the mirror that INSWSN_DATA names; it is not kept here.
"""

from __future__ import annotations

import datetime
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from inswsn_book.record.files import write_whole
from inswsn_book.record.provenance import repository_state
from scipy.optimize import least_squares

from inswsn_lib import logs
from inswsn_lib.checks import Array
from inswsn_lib.logs.estimates import tag_track
from inswsn_lib.streams import Recording

ROOT = Path(__file__).parent.parent
NAME = "inrol/1"
INTERVAL = 0.2  # s


def fix(anchors: Array, ranges: Array, start: Array) -> Array:
    """Return the position that fits the ranges best, m."""

    def residual(position: Array) -> Array:
        return np.asarray(np.linalg.norm(anchors - position, axis=1) - ranges)

    return np.asarray(least_squares(residual, start).x)


def measure(recording: Recording) -> dict[str, Any]:
    """Return how good ranges and fixes are, by name, and the horizontal errors in their order.

    Ranges from before and after the reference are left out.
    """
    (clock, track), ranges = tag_track(recording), recording.ranges
    assert ranges is not None
    kept = (ranges.time >= clock[0]) & (ranges.time <= clock[-1])
    time, anchor, distance = ranges.time[kept], ranges.anchor[kept], ranges.distance[kept]
    nodes = ranges.anchors[anchor]
    truth = np.column_stack([np.interp(time, clock, along) for along in track.T])
    range_error = distance - np.linalg.norm(nodes - truth, axis=1)
    middle = np.mean(ranges.anchors, axis=0)
    epoch = np.floor((time - time[0]) / INTERVAL).astype(int)
    errors = []
    series = np.full((epoch[-1] + 1, 2), np.nan)
    for k in np.unique(epoch):
        rows = epoch == k
        if len({*anchor[rows]}) < 4:  # fewer anchors do not fix three coordinates
            continue
        errors.append(fix(nodes[rows], distance[rows], middle) - truth[rows].mean(axis=0))
        series[k] = errors[-1][:2]
    horizontal = np.hypot(*np.array(errors)[:, :2].T)
    median = np.median(range_error)
    found = {
        "anchors": len(ranges.anchors),
        "ranges": len(time),
        "seconds": np.ptp(time),
        "range_median_error": median,
        # of a normal distribution with the same median absolute deviation
        "range_deviation": 1.4826 * np.median(np.abs(range_error - median)),
        "range_beyond_half_metre": np.mean(np.abs(range_error) > 0.5),
        "intervals": len(np.unique(epoch)),
        "fixes": len(errors),
        "horizontal_rms": np.sqrt(np.mean(horizontal**2)),
        "horizontal_median": np.median(horizontal),
        "horizontal_95": np.quantile(horizontal, 0.95),
    }
    rounded = {name: round(float(value), 4) for name, value in found.items()}
    # to the millimetre; an interval without a fix has none
    errors_kept = [None if np.isnan(e).any() else [round(float(v), 3) for v in e] for e in series]
    return rounded | {"horizontal_errors": errors_kept}


def main() -> None:
    """Fix, compare and write."""
    recording = logs.load(NAME)
    commit, clean = repository_state(ROOT)
    facts = {
        "made": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "commit": commit,
        "clean": clean,
        "source": NAME,
        "digests": dict(recording.digests),
        "interval": INTERVAL,
    }
    kept = {"form": 1, "facts": facts} | measure(recording)
    text = json.dumps(kept, indent=1)
    # a pair a line
    text = re.sub(r"\[\s+(-?[\d.]+),\s+(-?[\d.]+)\s+\]", r"[\1, \2]", text)
    write_whole(ROOT / "data/recorded/uwb-fixes.json", text + "\n")


if __name__ == "__main__":
    main()
