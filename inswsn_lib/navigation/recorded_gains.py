"""What filters gain on recordings, as they are and made worse, beside what was to be expected."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np
import pandas as pd

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.filters import ErrorStatistics
from inswsn_lib.logs import Ladder
from inswsn_lib.logs.estimates import Estimate, scores
from inswsn_lib.logs.network_fixes import network_of
from inswsn_lib.streams import Fixes, Ranges, Recording, Reference

_NOISE, _SLOW, _SEED = 0.1, 1.0, 0  # m, s
_ANCHORS = 4
_OF = ("position", "velocity")


def judged_by_fixes(recording: Recording) -> Recording:
    """Return a recording whose reference are its good fixes, such as RTK's, with worse fixes.

    These have white errors of 0.1 m, and no velocities.
    """
    fixes = recording.fixes
    assert fixes is not None
    good = np.isfinite(fixes.position).all(axis=1)
    if fixes.good is not None:
        good &= fixes.good
    reference = Reference(fixes.time[good], fixes.position[good])
    return noisy(replace(recording, reference=reference))


def noisy(recording: Recording) -> Recording:
    """Return a recording with white errors of 0.1 m more in its fixes, which have no velocities."""
    fixes = network_of(recording)
    errors = np.random.default_rng(_SEED).normal(size=fixes.position.shape)
    worse = Fixes(fixes.time, fixes.position + _NOISE * errors)
    return replace(recording, ranges=None, fixes=worse)


def slower(recording: Recording) -> Recording:
    """Return a recording with a fix each second, or as it is if it has fewer."""
    fixes = network_of(recording)
    every = round(_SLOW / float(np.median(np.diff(fixes.time))))
    if every < 2:
        raise InswsnError(f"The recording {recording.name} has no more than a fix each second.")
    kept = fixes.kept(np.arange(len(fixes)) % every == 0)
    return replace(recording, ranges=None, fixes=Fixes(kept.time, kept.position))


def fewer_anchors(recording: Recording) -> Recording:
    """Return a recording with the ranges to four of its anchors, those of the best geometry.

    It has the least trace of the inverse of the information in the middle of all anchors.
    """
    ranges = recording.ranges
    if ranges is None or len(ranges.anchors) <= _ANCHORS:
        raise InswsnError(f"The recording {recording.name} has no more than four anchors.")
    chosen = min(combinations(range(len(ranges.anchors)), _ANCHORS), key=lambda c: _dop(ranges, c))
    return replace(recording, ranges=ranges.kept(np.isin(ranges.anchor, chosen)))


#: What is done to a recording, by name
WORSE: Mapping[str, Callable[[Recording], Recording]] = {
    "as recorded": lambda recording: recording,
    "0.1 m of noise": noisy,
    "a fix each second": slower,
    "four anchors": fewer_anchors,
}


def gains(recordings: Mapping[str, tuple[Recording, float]]) -> pd.DataFrame:
    """Return what filters gain on recordings with a reference, and what was to be expected.

    Parameters
    ----------
    recordings : mapping of str to (Recording, float)
        By name, with the time of alignment, s.

    Returns
    -------
    DataFrame
        A row for each way of `WORSE` that a recording admits, ``recording: way``: ``seconds`` of
        ``fixes``, ``step`` (s), ``hold`` (s) and ``lags`` of `ErrorStatistics`; the ratio to the
        RMS error of fixes, of ``position`` and ``velocity``, which is ``expected_``, that if errors
        were ``white_``, that of a filter of P1's form that knows how errors last (no prefix), with
        ``_low`` and ``_high`` by `block_ratio`, and of the error-state filter, ``state_``. Where a
        series is too short to tell, all but the first two are NaN.
    """
    found = {}
    for name, (recording, alignment) in recordings.items():
        for way, worse in WORSE.items():
            try:
                ladder = Ladder(worse(recording), alignment=alignment)
            except InswsnError:
                continue
            found[f"{name}: {way}"] = gain(ladder)
    return pd.DataFrame(found).T


def gain(ladder: Ladder) -> dict[str, float]:
    """Return a row of `gains`."""
    rows, time = ladder.usable, ladder.fixes.time
    row = {"seconds": float(np.ptp(time[rows])), "fixes": float(rows.sum())}
    try:
        told = ladder.statistics()
    except InswsnError:
        return row
    ins, network = ladder.restarted.state, ladder.network.state
    truth = np.where(rows[:, None], ladder.truth, np.nan)
    measured = np.where(rows[:, None], ins - network, np.nan)
    first = int(np.flatnonzero(np.isfinite(measured).all(axis=1))[0])
    estimate = np.full_like(ins, np.nan)
    estimate[first:] = ins[first:] - told.run(measured[first:])
    row |= {"step": told.period, "hold": told.hold_time, "lags": float(len(told.covariances) - 1)}
    for prefix, ratios in (("expected", told.ratios()), ("white", told.ratios(white=True))):
        row |= {f"{prefix}_{of}": r for of, r in zip(_OF, ratios, strict=True)}
    filtered = ladder.of(ladder.solution(ladder.on_fixes)).state
    for prefix, state in (("", estimate), ("state_", filtered)):
        said = scores(Estimate(state), truth, network - truth)
        for of in _OF:
            row |= {
                f"{prefix}{of}{end}": said[f"{of}_{name}"]
                for end, name in (("", "ratio"), ("_low", "low"), ("_high", "high"))
            }
    return row


def simulated_gain(ins: Array, network: Array, period: float) -> dict[str, float]:
    """Return what a filter of P1's form gains in simulated runs, and what was to be expected.

    Parameters
    ----------
    ins, network : ndarray, (steps, 4, runs)
        Errors of x, y (m) and of their velocities (m/s).
    period : float
        s.

    Returns
    -------
    dict of str to float
        ``expected_position``, ``expected_velocity`` by the statistics of all runs together;
        ``position`` and ``velocity``, the ratios in the second half of the runs' steps.
    """

    def joined(errors: Array) -> Array:  # a gap is between the runs
        gap = np.full((1, 4, errors.shape[2]), np.nan)
        return np.concatenate([errors, gap]).transpose(2, 0, 1).reshape(-1, 4)

    told = ErrorStatistics.of(joined(ins), joined(network), period)
    second = slice(len(ins) // 2, None)
    found = [told.run(each) for each in (ins - network).transpose(2, 0, 1)]
    left = ins - np.array(found).transpose(1, 2, 0)
    row: dict[str, float] = {}
    for of, part, ratio in zip(_OF, (slice(0, 2), slice(2, 4)), told.ratios(), strict=True):
        sizes = [np.sqrt(np.mean(np.square(each[second, part]))) for each in (left, network)]
        row |= {f"expected_{of}": ratio, of: float(sizes[0] / sizes[1])}
    return row


def _dop(ranges: Ranges, chosen: tuple[int, ...]) -> float:
    """Return the trace of the inverse information of some anchors in the middle of all."""
    middle = ranges.anchors.mean(axis=0)
    apart = middle - ranges.anchors[list(chosen)]
    along = apart / np.linalg.norm(apart, axis=1, keepdims=True)
    information = along.T @ along
    if np.linalg.matrix_rank(information, tol=1e-6) < len(middle):
        return np.inf
    return float(np.trace(np.linalg.inv(information)))
