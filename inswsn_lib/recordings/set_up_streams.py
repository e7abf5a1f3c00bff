"""Whether the stamps of a recording's streams are what one clock gives."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from inswsn_lib.recordings.findings import FALSE_ALARM, Finding
from inswsn_lib.streams import Recording

_LEAST = 10.0  # periods: a shorter gap is none
_ROWS = 20
_SHARED = 0.02  # of a stream's time, in which another one is there, too


def check_stamps(recording: Recording) -> Iterator[Finding]:
    """Yield whether ranges are logged twice, a stream has a gap, or others are at another time."""
    ranges = recording.ranges
    if ranges is not None and len(ranges):
        pairs = np.column_stack([ranges.time, ranges.anchor])
        twice = len(pairs) - len(np.unique(pairs, axis=0))
        says = "an anchor has one range at a time" if not twice else (
            f"{twice} ranges have the stamp of another range to their anchor: logged twice, or "
            "stamped on arrival"
        )  # fmt: skip
        yield Finding("repeats", "ranges", twice, 0, 0, twice == 0, says)
    for name, stream in recording.streams.items():
        time = np.unique(stream.time)
        if len(time) < _ROWS:
            continue
        steps = np.diff(time)
        usual = float(np.median(steps))
        longest = int(np.argmax(steps))
        value = float(steps[longest]) / usual
        # rows at random times with this median have one such step in a thousand recordings
        bound = max(_LEAST, float(np.log(len(steps) / FALSE_ALARM) / np.log(2)))
        fits = value <= bound
        says = "no gap" if fits else (
            f"for {steps[longest]:.3g} s from {time[longest]:.6g} s there is nothing, else "
            f"every {usual:.2g} s"
        )  # fmt: skip
        yield Finding("gaps", name, value, 0, bound, fits, says)
    yield from _spans(recording)


def _spans(recording: Recording) -> Iterator[Finding]:
    """Compare the time of each stream with that from the first to the last stamp of the others."""
    spans = {name: s.time[[0, -1]] for name, s in recording.streams.items() if len(s) >= _ROWS}
    for name, (begin, end) in spans.items():
        others = np.array([span for other, span in spans.items() if other != name])
        if not len(others):
            return
        shared = min(end, others[:, 1].max()) - max(begin, others[:, 0].min())
        value = max(float(shared), 0.0) / float(end - begin)
        fits = value >= _SHARED
        says = "other streams are there at the same time" if fits else (
            f"it is from {begin:.6g} to {end:.6g} s, the others from {others[:, 0].min():.6g} to "
            f"{others[:, 1].max():.6g} s: stamps in another unit, or from another origin"
        )  # fmt: skip
        yield Finding("span", name, value, _SHARED, np.inf, fits, says)
