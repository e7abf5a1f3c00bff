"""Whether the streams of a recording fit together, before a filter runs on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.spatial.transform import Rotation
from scipy.stats import binom, geom

from inswsn_lib.checks import Array, Mask
from inswsn_lib.logs.blocks import interpolate
from inswsn_lib.logs.findings import FALSE_ALARM, Finding, judged
from inswsn_lib.logs.set_up_motion import check_imu, check_odometry, check_velocities
from inswsn_lib.logs.set_up_positions import check_positions
from inswsn_lib.streams import Fixes, Imu, Odometry, Ranges, Recording, Reference, Stream, Whole

_FEWEST = 2  # rows of a reference that tells anything
_LEAST = 10.0  # periods: a shorter gap is none
_ROWS = 20
_STUCK = 20  # rows that may say the same, as of a fix at rest
_CLIPPED = 0.01  # share of the rows that may have the largest or the least value of their column
_FEW = 4  # such rows of a short recording
_NEGATIVE = 0.5  # share of the rows above which ranges have the other sign
_COMMON = 0.02  # share of the rows above which a range may mean that nothing was measured
# Times usual changes, times the finest difference, m: how far from its neighbours it must be
_APART, _STEPS, _LEAST_APART = 10.0, 3.0, 1.0
_SHORT = 0.5  # s: a shorter gap of what is not summed up is none
# Rows of one value, the share of such runs that is as long as usual, and a probability
_REPEATED, _EVEN, _NEVER = 1.4, 0.9, 1e-6
# s and periods: how far behind stamps jam; s, after what time they have caught up; what stays late
_JAM, _BEHIND, _CATCH, _STALE = 0.3, 3.0, 10.0, 0.3
_CHORD, _FAST, _BACK = 0.2, 6.0, 500  # s, of a speed; times the usual one; segments
_PUSH, _WAY, _SPIN, _TURNED = 50.0, 0.1, 100.0, 0.5  # m/s^2, m; rad/s^2, rad: beside any speed
_SHARED = 0.02  # of a stream's time, in which another one is there, too


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


def check_failed(recording: Recording) -> tuple[list[Finding], Recording]:
    """Return what rows say that is no measurement of their time, and a recording without them.

    These are ranges that are not above 0, or exactly the same in more than a fiftieth of all rows
    and far from what the rows to the same anchor before and after have; values that are repeated
    until there is a new one; stamps that jam, of fixes and a reference; and rows of a reference
    that no motion joins with the others.
    """
    found: list[Finding] = []
    checks = (_failed_ranges, _held_values, _jammed_stamps, _unjoined_rows)
    for name in recording.streams:
        for check in checks:
            stream = recording.streams[name]
            finding, kept = check(name, stream) if len(stream) >= _ROWS else (None, None)
            found += [finding] if finding else []
            if kept is not None:
                left: dict[str, Any] = {name: stream.kept(kept)}
                recording = replace(recording, **left)
    return found, recording


_Judged = tuple[Finding | None, Mask | None]  # and the rows that are kept, if not all are


def _failed_ranges(name: str, ranges: Stream) -> _Judged:
    if not isinstance(ranges, Ranges) or not (failed := _failed(ranges)).any():
        return None, None
    negative = float(len(np.unique(ranges.distance[ranges.distance < 0])) / len(ranges))
    if negative > _NEGATIVE:
        says = f"{100 * negative:.3g} % of the ranges are negative: they have the other sign"
        return Finding("unit", name, negative, 0, 0, False, says), ~failed
    values, counts = np.unique(ranges.distance[failed], return_counts=True)
    share, others = float(failed.mean()), " or another such value" if len(values) > 1 else ""
    says = (
        f"{values[np.argmax(counts)]:.6g}{others} stands in {100 * share:.3g} % of the rows, first "
        f"at {ranges.time[failed][0]:.12g} s: it seems to mean that nothing was measured, and such "
        "rows are left out"
    )
    return Finding("values", f"{name}, failed", share, 0, 0, False, says), ~failed


def _held_values(name: str, stream: Stream) -> _Judged:
    """Find values that are logged again, about as often each, until there is a new one.

    Runs of one value are more even than those of values that are repeated by chance, and go on
    with another value than the next one that can be told from it.
    """
    kept: Mask = np.ones(len(stream), dtype=bool)
    lengths, far = [np.zeros(0)], [np.zeros(0)]
    for every, told in [] if isinstance(stream, Imu | Odometry) else _measured(stream):
        once = np.diff(stream.time[every], prepend=-np.inf) > 0  # rows logged twice are no new ones
        rows, values = every[once], told[once]
        steps = np.abs(np.diff(values, axis=0))
        new = np.concatenate([[True], (steps != 0).any(axis=1)])
        kept[rows[~new]] = False
        lengths.append(np.diff(np.flatnonzero(new))[1:])
        steps = steps[new[1:]]
        finest = np.min(steps, axis=0, initial=np.inf, where=steps > 0)
        far.append((steps / np.maximum(finest, 1e-12)).max(axis=1, initial=0.0))
    runs, apart = np.concatenate(lengths), np.concatenate(far)
    mean = float(runs.mean()) if len(runs) else 1.0
    if mean < _REPEATED or np.median(apart) <= _STEPS:
        return None, None
    alike = np.abs(np.arange(1, 3 * mean) - mean) < max(1.0, 0.1 * mean)
    chance = float(geom.pmf(np.flatnonzero(alike) + 1, 1 / mean).sum())
    even = np.abs(runs - mean) < max(1.0, 0.1 * mean)
    if even.mean() < _EVEN or binom.sf(even.sum() - 1, len(runs), chance) > _NEVER:
        return None, None
    says = (
        f"each value is repeated, and stands in {mean:.3g} rows on end: there are new ones less "
        "often than rows, of which the first of each is taken"
    )
    return Finding("values", f"{name}, held", mean, 1, _REPEATED, False, says), kept


def _lags(time: Array) -> Array:
    """Return by how much stamps of one rate are too late, s: by how much later ones catch up."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    if np.ptp(np.quantile(steps, [0.1, 0.9])) > usual:  # there is no rate
        return np.zeros(len(time))
    period = min(usual, float(steps[steps <= 2 * usual].mean()))
    ahead = int(np.clip(_CATCH / period, 1, len(time)))
    behind = time - time[0] - period * np.arange(len(time))
    size = 2 * ahead + 1
    return np.asarray(behind - minimum_filter1d(behind, size, mode="nearest", origin=-ahead))


def _jammed_stamps(name: str, stream: Stream) -> _Judged:
    late = _lags(stream.time)
    bound = max(_JAM, _BEHIND * float(np.median(np.diff(stream.time))))
    jammed: Mask = np.asarray(late > bound)
    if not jammed.any():
        return None, None
    begin, worst = stream.time[jammed][0], float(late.max())
    drop = isinstance(stream, Fixes | Reference)
    says = (
        f"{int(jammed.sum())} stamps, first from {begin:.6g} s on, fall behind by up to "
        f"{worst:.2g} s, and then catch up: rows were stamped when they were logged"
        + ("; they are left out" if drop else "")
    )
    found = Finding("stamps", name, worst, 0, bound, False, says)
    return found, np.asarray(late <= _STALE * bound) if drop else None


def _unjoined_rows(name: str, stream: Stream) -> _Judged:
    """Find rows of a reference that are farther from others than it ever moves in the time.

    Of the chains of rows that a motion joins the longest is kept. Stamps may be wrong by the
    longest step within a second.
    """
    if not isinstance(stream, Reference):
        return None, None
    time, steps, rows = stream.time - _lags(stream.time), np.diff(stream.time), len(stream)
    usual = float(np.median(steps))
    slack = maximum_filter1d(np.append(steps, 0.0), 2 * int(1 / max(usual, 1e-3)) + 1) - usual
    ahead = np.maximum(np.searchsorted(time, time + _CHORD).clip(0, rows - 1), np.arange(rows))
    whole = time[ahead] - time >= _CHORD / 2
    if not whole.any():
        return None, None
    sources = [(stream.position, _PUSH, _WAY)]
    if stream.attitude is not None:  # small distances of these matrices are angles
        matrices = Rotation.from_quat(stream.attitude).as_matrix().reshape(rows, 9)
        sources.append((matrices / np.sqrt(2), _SPIN, _TURNED))
    usually = []
    for values, _, least in sources:
        speeds = np.linalg.norm(values[ahead] - values, axis=1)[whole] / (time[ahead] - time)[whole]
        moves = speeds[speeds > least / _CHORD]  # it may stand most of the time
        usually.append(_FAST * float(np.median(moves)) if len(moves) else 0.0)

    def joined(first: Whole, last: Whole) -> Mask:
        passed = np.abs(time[last] - time[first]) + slack[last]
        near: Mask = np.ones(len(last), dtype=bool)
        for fast, (values, push, least) in zip(usually, sources, strict=True):
            way = np.linalg.norm(values[last] - values[first], axis=1)
            near &= way <= (fast + push * passed) * passed + least
        return near

    cuts = np.flatnonzero(~joined(np.arange(rows - 1), np.arange(1, rows))) + 1
    kept = _longest_chain(np.append(0, cuts), np.append(cuts, rows), joined)
    if kept.all():
        return None, None
    away = stream.position - interpolate(time[kept], stream.position[kept], time)
    most, count = float(np.nanmax(np.linalg.norm(away[~kept], axis=1))), int((~kept).sum())
    says = (
        f"{count} rows, first at {stream.time[~kept][0]:.6g} s and up to {most:.2g} m away, are "
        "where no motion joins them with the others: they are left out"
    )
    return Finding("values", f"{name}, rows", count, 0, 0, False, says), kept


def _longest_chain(begins: Whole, ends: Whole, joined: Callable[[Whole, Whole], Mask]) -> Mask:
    """Return the rows of the segments that can follow on one another and are most."""
    most, before = (ends - begins).astype(float), np.full(len(begins), -1)
    for k in range(1, len(begins)):
        some = np.arange(max(0, k - _BACK), k)
        follows = joined(ends[some] - 1, np.full(len(some), begins[k]))
        if follows.any():
            best = some[follows][np.argmax(most[some[follows]])]
            most[k], before[k] = most[k] + most[best], best
    kept: Mask = np.zeros(ends[-1], dtype=bool)
    k = int(np.argmax(most))
    while k >= 0:
        kept[begins[k] : ends[k]] = True
        k = int(before[k])
    return kept


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
    """Yield whether ranges are logged twice, a sensor sticks, or others are at another time."""
    ranges = recording.ranges
    if ranges is not None and len(ranges):
        pairs = np.column_stack([ranges.time, ranges.anchor])
        twice = len(pairs) - len(np.unique(pairs, axis=0))
        says = (
            f"{twice} ranges have the stamp of another range to their anchor: logged twice, or "
            "stamped on arrival"
        )
        right = "an anchor has one range at a time"
        yield judged("repeats", "ranges", twice, 0, 0, right, says)
    yield from _values(recording)
    yield from _spans(recording)


def check_gaps(recording: Recording) -> Iterator[Finding]:
    """Yield whether a stream is not there for long."""
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
        if not isinstance(stream, Imu):  # what is not summed up goes on in a shorter time
            bound = max(bound, _SHORT / usual)
        says = (
            f"for {steps[longest]:.3g} s from {time[longest]:.6g} s there is nothing, else "
            f"every {usual:.2g} s"
        )
        yield judged("gaps", name, value, 0, bound, "no gap", says)


def _values(recording: Recording) -> Iterator[Finding]:
    """Yield whether what a sensor says sticks, or ends at a limit: noise makes it differ."""
    for name, stream in recording.streams.items():
        if len(stream) < _ROWS:
            continue
        columns = [] if isinstance(stream, Reference) else [x for _, x in _measured(stream)]
        if not columns:
            continue
        same = [(np.diff(rows, axis=0) == 0).all(axis=1) for rows in columns]
        if isinstance(stream, Odometry):  # wheels that stand say 0, and so may a straight drive
            same = [same[0] & (columns[0][1:] != 0).all(axis=1)]
        stuck = 1 + max(longest_run(each)[0] for each in same)
        says = f"{stuck} rows on end say the same: the sensor or its logger sticks"
        right = "no stretch has the same values"
        yield judged("values", name, stuck, 0, _STUCK, right, says)
        if isinstance(stream, Imu):
            ends = columns[0].min(axis=0), columns[0].max(axis=0)
            clipped = max(float(np.mean(columns[0] == end, axis=0).max()) for end in ends)
            says = (
                f"{100 * clipped:.0f} % of the rows of a column have its largest or least value: "
                "it saturates, or is quantised coarsely"
            )
            right, most = "no value is there often that none exceeds", _FEW / len(stream)
            subject, most = f"{name}, limits", max(_CLIPPED, most)
            yield judged("values", subject, clipped, 0, most, right, says)


def _measured(stream: Stream) -> list[tuple[Whole, Array]]:
    """Return what a sensor says, (rows, components), and its rows, of each anchor by itself."""
    every = np.arange(len(stream))
    if isinstance(stream, Imu):
        return [(every, np.hstack([stream.rate, stream.force]))]
    if isinstance(stream, Odometry):
        return [(every, np.column_stack([stream.speed, stream.rate]))]
    if isinstance(stream, Ranges):
        each = [np.flatnonzero(stream.anchor == k) for k in range(len(stream.anchors))]
        return [(rows, stream.distance[rows, None]) for rows in each if len(rows) > 1]
    return [(every, stream.position)] if isinstance(stream, Fixes | Reference) else []


def longest_run(same: Mask) -> tuple[int, int]:
    """Return how many on end are true at most, and the first of them."""
    edges = np.flatnonzero(np.diff(same, prepend=False, append=False)).reshape(-1, 2)
    lengths = np.append(np.diff(edges).ravel(), 0)
    longest = int(np.argmax(lengths))
    return int(lengths[longest]), int(edges[longest, 0]) if len(edges) else 0


def _spans(recording: Recording) -> Iterator[Finding]:
    """Compare the time of each stream with that from the first to the last stamp of the others."""
    spans = {name: s.time[[0, -1]] for name, s in recording.streams.items() if len(s) >= _ROWS}
    for name, (begin, end) in spans.items():
        others = np.array([span for other, span in spans.items() if other != name])
        if not len(others):
            return
        shared = min(end, others[:, 1].max()) - max(begin, others[:, 0].min())
        value = max(float(shared), 0.0) / float(end - begin)
        says = (
            f"it is from {begin:.6g} to {end:.6g} s, the others from {others[:, 0].min():.6g} to "
            f"{others[:, 1].max():.6g} s: stamps in another unit, or from another origin"
        )
        right = "other streams are there at the same time"
        yield judged("span", name, value, _SHARED, np.inf, right, says)
