"""A report on a recording: its set-up, a filter tuned on it, and how good that filter is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation, Slerp

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.evaluation import search_pattern
from inswsn_lib.inertial import InertialState, PlanarState, Solution, Start, smooth
from inswsn_lib.recordings.contest import TRIALS
from inswsn_lib.recordings.correction import (
    Correction,
    correction_of,
    network_of,
    turned_by_gyroscope,
)
from inswsn_lib.recordings.estimates import (
    Estimate,
    normalised,
    of_solution,
    scores,
    truth_at,
    unlikely,
)
from inswsn_lib.recordings.filter_checks import (
    check_errors,
    check_innovations,
    check_outliers,
    inside,
)
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding
from inswsn_lib.recordings.report_words import of_set_up, sentence_of
from inswsn_lib.recordings.set_up_checks import check_set_up
from inswsn_lib.recordings.set_up_streams import check_failed
from inswsn_lib.streams import Fixes, Recording

_ALIGNMENT = 20.0  # s
_RATIO = 2.0  # of the steps of a search
_MIRRORED = "the network is mirrored, its x and y exchanged, or rates have the other sign"
_FEWEST = 12  # fixes by which a track is judged
_TRACK = ("x", "y", "vx", "vy")
_SCORES = (
    "position", "position_ratio", "position_low", "position_high",
    "velocity", "velocity_ratio", "velocity_low", "velocity_high",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Report:
    """A report on a recording.

    Attributes
    ----------
    findings : list of Finding
        Of the set-up, as of `check_set_up`; then ``gyroscope`` of an IMU beside odometry, and
        ``axes`` of a network that fits the motion better if it is mirrored; then of the filter:
        ``start`` if it cannot start, ``outliers``, ``size`` (mean NIS of the others), ``colour``
        and ``whiteness`` of the innovations, and ``errors`` (NEES) with a reference.
    table : DataFrame
        Rows ``network``, ``corrected`` and ``smoothed``: horizontal RMS errors ``position`` (m) and
        ``velocity`` (m/s) in the second half; their ratios to the network's with intervals
        (``position_ratio``, ``position_low``, ``position_high``, and of velocity). What cannot be
        told is NaN.
    judge : str
        By what: ``reference``, ``withheld fixes``, whose own errors are in the numbers, or
        ``nothing``.
    sentence : str
        What comes of it, with a warning where the filter is not consistent or does not help.
    track : DataFrame
        Corrected, at the times of fixes: ``time`` (s), ``x``, ``y`` (m) of the tag, ``vx``, ``vy``
        (m/s), and the deviations that the filter states, ``sd_x`` and so on; by odometry it states
        none of velocities. Without a filter it is the network's track.
    numbers : tuple of float
        Of the filter, as `InertialCorrection` and `OdometryCorrection` name them; empty without.
    """

    findings: list[Finding]
    table: pd.DataFrame
    judge: str
    sentence: str
    track: pd.DataFrame
    numbers: tuple[float, ...] = ()


def report(
    recording: Recording,
    *,
    alignment: float = _ALIGNMENT,
    trials: int = TRIALS,
    start: Start | None = None,
) -> Report:
    """Check a recording, correct its motion by its network, and report how good that is.

    Stamps are taken as they are. Ranges that mean that nothing was measured, such as -1, are left
    out. Ranges beside an IMU are made into fixes; beside odometry they are
    taken one by one, and of an IMU beside odometry the rate about the vertical is taken where it
    makes the network more likely. The start is found from the data, without the reference. The few
    numbers of the filter are tuned by the likelihood of its innovations in the first half of the
    recording, with white and with coloured errors of fixes, and all is judged in the second half.
    Without a reference every second fix of it is withheld, and errors are those there; the network
    has a line between the fixes beside.

    Parameters
    ----------
    recording : Recording
        From `load`; of any streams.
    alignment : float
        By how much of the data the start is found, s; by more where the heading does not show yet.
    trials : int
        Of each search for the filter's numbers.
    start : Start, optional
        What is known of the start, of `known_start`; for odometry with a `PlanarState`.

    Returns
    -------
    Report

    Raises
    ------
    InswsnError
        If there is no network, or it has too few fixes.

    Examples
    --------
    Fixes, and nothing to correct them with:

    >>> import numpy as np
    >>> from inswsn_lib import recordings, streams
    >>> t = np.arange(60.0)
    >>> fixes = streams.Fixes(time=t, position=np.column_stack([t, 0 * t, 0 * t]))
    >>> print(recordings.report(streams.Recording("walk", fixes=fixes)).sentence)
    The recording walk has neither an IMU nor odometry: there is nothing to correct fixes with.
    """
    kind = InertialState if recording.odometry is None else PlanarState
    if start is not None and not isinstance(start.state, kind):
        raise ParameterError("start", type(start.state).__name__, f"one with {kind.__name__}")
    findings = check_set_up(recording)
    recording = check_failed(recording)[1]
    try:
        filtered: Correction = correction_of(recording, alignment, start)
        findings += filtered.assumed
        begun = filtered.start.time
    except InswsnError as error:
        findings += _mirrored_start(recording, alignment)
        return _without_filter(recording, findings, str(error))
    split = float(np.mean(filtered.fixes.time[[0, -1]]))
    if not filtered.known < filtered.fixes.time[-1] or not begun < split:
        taken = filtered.known - filtered.fixes.time[0]
        said = f"The start takes {taken:.3g} s, more than half of the recording."
        return _without_filter(recording, findings, said)
    filtered, more = _by_gyroscope(filtered, alignment, split, start)
    findings += more
    if not any(found.name == "axes" and found.fits for found in findings):
        findings += _mirrored(recording, filtered, alignment, split)
    numbers = _tuned(filtered, split, trials)
    solution = filtered.run(*numbers)
    corrected = of_solution(solution, filtered.lever_arm, filtered.fixes.time, filtered.rate)
    since = max(split, filtered.known)
    findings += _of_innovations(filtered, solution, since)
    judged = _by_reference if recording.reference is not None else _at_withheld
    table, judge, more = judged(filtered, numbers, solution, since)
    findings += more
    return Report(
        findings,
        table,
        judge,
        sentence_of(findings, table, judge),
        _track(filtered.fixes.time, corrected, filtered.stated),
        numbers,
    )


def _tuned(filtered: Correction, end: float, trials: int) -> tuple[float, ...]:
    """Return the most likely numbers: of those that searches find, times a common factor.

    With all deviations times a factor the estimates are the same, and the likelihood is largest
    where the mean NIS is 1.
    """
    loss = unlikely(filtered.run, end)
    searches = [
        search_pattern("filter", begin, [_RATIO] * len(begin), loss, most=trials)
        for begin in filtered.begins
    ]
    best = min(searches, key=lambda search: search.loss).best
    near = [
        told.squares[inside(told.values, told.deviations)]
        for told in filtered.told(filtered.run(*best, end=end))
    ]
    squares = np.concatenate(near)
    factor = float(np.sqrt(np.mean(squares))) if squares.size else 1.0
    count = min(len(best), len(filtered.begins[0]) + 1)  # what may follow is a time
    return (*(factor * number for number in best[:count]), *best[count:])


_Judged = tuple[pd.DataFrame, str, list[Finding]]


def _by_reference(
    filtered: Correction, numbers: Sequence[float], solution: Solution, since: float
) -> _Judged:
    """Judge by the reference."""
    times = filtered.fixes.time
    truth = truth_at(turned_by(filtered.recording, solution), times)
    estimates = _estimates(filtered, solution) | {"network": _of_network(filtered.fixes)}
    table = _table(estimates, truth, times > since, times)
    corrected, told = estimates["corrected"], slice(0, filtered.stated)
    assert corrected.covariance is not None  # a filter has it
    errors = (corrected.state - truth)[:, told]
    rows = (times > since) & np.isfinite(errors).all(axis=1)
    if rows.sum() < _FEWEST:
        return table, _judge(table, "reference"), []
    squares = normalised(errors[rows], corrected.covariance[rows, told, told])
    period = float(np.median(np.diff(times)))
    return table, _judge(table, "reference"), [check_errors(squares, filtered.stated, period)]


def turned_by(recording: Recording, solution: Solution) -> Recording:
    """Return a recording whose reference has attitudes: its own, or those of a filter in space.

    By them the reference, which is the body's, is brought to the tag.

    Parameters
    ----------
    recording : Recording
        With a reference.
    solution : Solution
    """
    reference, states = recording.reference, solution.states
    assert reference is not None
    told = reference.attitude is not None or not np.any(recording.lever_arm)
    if told or not isinstance(states[0], InertialState):
        return recording
    inside = reference.part(float(solution.time[0]), float(solution.time[-1]))
    turns = Rotation.from_matrix(np.array([state.attitude for state in states]))
    quaternions = Slerp(solution.time, turns)(inside.time).as_quat()
    return replace(recording, reference=replace(inside, attitude=quaternions))


def _at_withheld(
    filtered: Correction, numbers: Sequence[float], solution: Solution, since: float
) -> _Judged:
    """Judge by fixes that the filter does not get."""
    network = filtered.fixes
    rows = withheld_rows(network, since)
    truth = np.hstack([network.position[:, :2], np.full((len(network), 2), np.nan)])
    other = filtered.without(rows)
    there = np.isfinite(other.fixes.position).all(axis=1)
    line = [
        np.interp(network.time, network.time[there], x) for x in other.fixes.position[there, :2].T
    ]
    alone = Estimate(np.column_stack([*line, truth[:, 2:]]))
    estimates = _estimates(other, other.run(*numbers)) | {"network": alone}
    table = _table(estimates, truth, rows, network.time)
    return table, _judge(table, "withheld fixes"), []


def _judge(table: pd.DataFrame, by: str) -> str:
    return "nothing" if table.isna().all(axis=None) else by


def _estimates(filtered: Correction, solution: Solution) -> dict[str, Estimate]:
    others = filtered.lever_arm, filtered.fixes.time, filtered.rate
    return {
        "corrected": of_solution(solution, *others),
        "smoothed": of_solution(smooth(solution), *others),
    }


def _without_filter(recording: Recording, findings: list[Finding], said: str) -> Report:
    """Return what can be told of the network alone."""
    network = network_of(recording)
    times, alone = network.time, _of_network(network)
    table, judge = _table({}, np.empty((0, 4)), np.zeros(0, dtype=bool), times), "nothing"
    if recording.reference is not None:
        truth, half = truth_at(recording, times), times > float(np.mean(times[[0, -1]]))
        table = _table({"network": alone}, truth, half, times)
        judge = _judge(table, "reference")
    start = Finding("start", "filter", np.nan, np.nan, np.nan, None, said.rstrip("."))
    said = " ".join([*of_set_up(findings), said])
    return Report([*findings, start], table, judge, said, _track(times, alone, 0))


def _of_network(network: Fixes) -> Estimate:
    assert network.velocity is not None  # `network_of` has it
    return Estimate(np.hstack([network.position[:, :2], network.velocity[:, :2]]))


def withheld_rows(network: Fixes, since: float) -> Mask:
    """Return every second fix after a time, of those that are good if some are.

    Parameters
    ----------
    network : Fixes
    since : float
        s.
    """
    rows = np.isfinite(network.position).all(axis=1) & (network.time > since)
    rows &= np.arange(len(network)) % 2 == 1
    return np.asarray(rows if network.good is None else rows & network.good)


def _table(estimates: dict[str, Estimate], truth: Array, rows: Mask, times: Array) -> pd.DataFrame:
    """Return the scores on the rows where all estimates and the truth say where the tag is."""
    names = [name for name in ("network", "corrected", "smoothed") if name in estimates]
    parts = [truth, *(estimates[name].state for name in names)]
    # velocities count where everything has them
    for d in (4, 2):
        there = rows & np.isfinite(np.hstack([each[:, :d] for each in parts])).all(axis=1)
        if there.sum() >= _FEWEST:
            break
    else:
        return pd.DataFrame(np.nan, index=names, columns=list(_SCORES))
    if d == 2:
        truth = np.hstack([truth[:, :2], np.full((len(truth), 2), np.nan)])
    errors = estimates["network"].state[there] - truth[there]
    spacing = float(np.median(np.diff(times[there])))
    found = {
        name: scores(Estimate(estimates[name].state[there]), truth[there], errors, spacing)
        for name in names
    }
    return pd.DataFrame(found).T[list(_SCORES)]


def _mirrored(
    recording: Recording, filtered: Correction, alignment: float, end: float
) -> list[Finding]:
    """Ask whether the motion fits the network better if that is mirrored."""
    who = "network and motion"
    gain = _more_likely(_mirror(recording), filtered, alignment, end)[0]
    if np.isnan(gain):
        return []
    bound = float(-np.log(FALSE_ALARM))
    if abs(gain) < bound:
        says = "the motion turns too little to tell a mirrored network"
        return [Finding("axes", who, gain, -np.inf, bound, None, says)]
    says = _MIRRORED if gain > 0 else "they turn to the same side"
    return [Finding("axes", who, gain, -np.inf, bound, gain < 0, says)]


def _mirrored_start(recording: Recording, alignment: float) -> list[Finding]:
    """Ask whether a filter that cannot start would, if the network were mirrored."""
    try:
        _ = correction_of(_mirror(recording), alignment).start
    except InswsnError:
        return []
    return [Finding("axes", "network and motion", np.inf, -np.inf, 0.0, False, _MIRRORED)]


def _by_gyroscope(
    filtered: Correction, alignment: float, end: float, start: Start | None
) -> tuple[Correction, list[Finding]]:
    """Ask whether the rate of an IMU beside odometry fits the network better, and take that."""
    other = turned_by_gyroscope(filtered.recording)
    if other is None:
        return filtered, []
    gain, turned = _more_likely(other, filtered, alignment, end, start)
    bound = float(np.log(FALSE_ALARM))
    fits = bool(gain > bound)
    says = "the IMU's rate about the vertical fits the network as well, and is left out"
    if gain > 0:
        says, filtered = "the IMU's rate about the vertical fits the network better: taken", turned
    elif not fits:
        says = "the IMU's rate about the vertical does not fit the network, and is left out"
    return filtered, [Finding("gyroscope", "IMU and odometry", gain, bound, np.inf, fits, says)]


def _more_likely(
    recording: Recording, filtered: Correction, alignment: float, end: float,
    start: Start | None = None,
) -> tuple[float, Correction]:  # fmt: skip
    """Return by how much more likely another recording is, in logarithms, and its correction.

    NaN where its filter cannot start, or has fewer measurements, since it starts later.
    """
    try:
        other = correction_of(recording, alignment, start)
        later = other.start.time != filtered.start.time
    except InswsnError:
        later = True
    if later:
        return np.nan, filtered
    mine, its = (
        each.run(*filtered.begins[0], end=end, kept=False).log_likelihood
        for each in (filtered, other)
    )
    return its - mine, other


def _mirror(recording: Recording) -> Recording:
    """Return a recording whose network has the other sign of y."""
    ranges, fixes = recording.ranges, recording.fixes
    if ranges is not None:
        ranges = replace(ranges, anchors=_other_side(ranges.anchors))
    if fixes is not None:
        velocity = None if fixes.velocity is None else _other_side(fixes.velocity)
        fixes = replace(fixes, position=_other_side(fixes.position), velocity=velocity)
    return replace(recording, ranges=ranges, fixes=fixes)


def _other_side(vectors: Array) -> Array:
    return np.asarray(vectors * np.array([1.0, -1.0, 1.0])[: vectors.shape[1]])


def _of_innovations(filtered: Correction, solution: Solution, since: float) -> list[Finding]:
    told = filtered.told(solution)
    values = [value for each in told for value in each.values]
    deviations = [deviation for each in told for deviation in each.deviations]
    near = inside(values, deviations)
    judged = np.concatenate([each.time for each in told]) > since
    sizes = np.array([len(value) for value in values])
    rows = np.repeat(judged & near, sizes)
    scaled = np.concatenate(values) / np.concatenate(deviations)
    squares = np.repeat(np.concatenate([each.squares for each in told]), sizes)
    series = filtered.series(solution)
    return [
        check_outliers(near[judged]),
        *check_innovations(squares[rows], scaled[rows], series[rows]),
    ]


def _track(times: Array, estimate: Estimate, stated: int) -> pd.DataFrame:
    found = pd.DataFrame(estimate.state, columns=list(_TRACK))
    found.insert(0, "time", times)
    deviations = np.full_like(estimate.state, np.nan)
    if estimate.covariance is not None:
        variances = np.diagonal(estimate.covariance, axis1=1, axis2=2)
        deviations[:, :stated] = np.sqrt(variances[:, :stated])
    found[[f"sd_{name}" for name in _TRACK]] = deviations
    return found.dropna(subset=["x", "y"]).reset_index(drop=True)
