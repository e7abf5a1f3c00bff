"""Whether the stamps of streams are what one clock gives, and their values those of a sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from inswsn_lib.checks import Array, Mask
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding
from inswsn_lib.streams import Fixes, Imu, Ranges, Recording, Stream

_LEAST = 10.0  # periods: a shorter gap is none
_ROWS = 20
_STUCK = 20  # rows that may say the same, as of a fix at rest
_CLIPPED = 0.01  # share of the rows that may have the largest or the least value of their column
_FEW = 4  # such rows of a short recording
_COMMON = 0.02  # share of the rows above which a range may mean that nothing was measured
# Times usual changes, times the finest difference, m: how far from its neighbours it must be
_APART, _STEPS, _LEAST_APART = 10.0, 3.0, 1.0
_SHARED = 0.02  # of a stream's time, in which another one is there, too


def check_failed(recording: Recording) -> tuple[list[Finding], Recording]:
    """Return what rows of ranges say that nothing was measured, and a recording without them.

    These are distances that are not above 0; and one that stands exactly in more than a fiftieth of
    all rows, and is far from what the rows to the same anchor before and after have.
    """
    ranges = recording.ranges
    if ranges is None or not (failed := _failed(ranges)).any():
        return [], recording
    values, counts = np.unique(ranges.distance[failed], return_counts=True)
    share, others = float(failed.mean()), " or another such value" if len(values) > 1 else ""
    says = (
        f"{values[np.argmax(counts)]:.6g}{others} stands in {100 * share:.3g} % of the rows, first "
        f"at {ranges.time[failed][0]:.12g} s: it seems to mean that nothing was measured, and such "
        "rows are left out"
    )
    found = Finding("values", "ranges, failed", share, 0, 0, False, says)
    return [found], replace(recording, ranges=ranges.kept(~failed))


def _failed(ranges: Ranges) -> Mask:
    """Tell which rows are no distances."""
    failed: Mask = np.asarray(ranges.distance <= 0)
    values, counts = np.unique(ranges.distance[ranges.distance > 0], return_counts=True)
    finest = float(np.diff(values).min(initial=np.inf))
    for value in values[counts > max(_COMMON * len(ranges), _FEW)]:
        mine: Mask = np.asarray(ranges.distance == value)
        off, usual = [], []
        for anchor in np.unique(ranges.anchor[mine]):
            own = ranges.kept(~failed & (ranges.anchor == anchor))
            others = own.kept(own.distance != value)
            if len(others) > 1:
                at = own.time[own.distance == value]
                off.append(value - np.interp(at, others.time, others.distance))
                usual.append(np.diff(others.distance))
        far, near = (np.median(np.abs(np.concatenate([*x, [0.0]]))) for x in (off, usual))
        if off and far > max(_APART * near, _STEPS * finest, _LEAST_APART):
            failed = failed | mine
    return failed


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
    yield from _values(recording)
    yield from _spans(recording)


def _values(recording: Recording) -> Iterator[Finding]:
    """Yield whether what a sensor says sticks, or ends at a limit: noise makes it differ."""
    for name, stream in recording.streams.items():
        if len(stream) < _ROWS:
            continue
        columns = _measured(stream)
        if not columns:
            continue
        stuck = max(_longest((np.diff(rows, axis=0) == 0).all(axis=1)) for rows in columns) + 1
        says = "no stretch has the same values" if stuck <= _STUCK else (
            f"{stuck} rows on end say the same: the sensor or its logger sticks"
        )  # fmt: skip
        yield Finding("values", name, stuck, 0, _STUCK, stuck <= _STUCK, says)
        if isinstance(stream, Imu):
            clipped = max(_at_limit(column) for column in columns[0].T)
            most = max(_CLIPPED, _FEW / len(stream))
            says = "no value is there often that none exceeds" if clipped <= most else (
                f"{100 * clipped:.0f} % of the rows of a column have its largest or least value: "
                "it saturates, or is quantised coarsely"
            )  # fmt: skip
            subject = f"{name}, limits"
            yield Finding("values", subject, clipped, 0, most, clipped <= most, says)


def _measured(stream: Stream) -> list[Array]:
    """Return what a sensor says, (rows, components), of each anchor by itself."""
    if isinstance(stream, Imu):
        return [np.hstack([stream.rate, stream.force])]
    if isinstance(stream, Ranges):
        each = [stream.distance[stream.anchor == k, None] for k in range(len(stream.anchors))]
        return [rows for rows in each if len(rows) > 1]
    return [stream.position] if isinstance(stream, Fixes) else []


def _longest(same: Mask) -> int:
    """Return how many on end are true at most."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(int)))
    return int(np.max(np.diff(edges)[::2], initial=0))


def _at_limit(column: Array) -> float:
    """Return the share of rows with the largest or with the least value, the larger of both."""
    return float(max(np.mean(column == column.max()), np.mean(column == column.min())))


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
