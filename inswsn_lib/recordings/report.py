"""What a reader is told of a recording: its set-up, a filter tuned on it, and how good that is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.estimation import Solution, slope_velocity, smooth
from inswsn_lib.evaluation import search_pattern
from inswsn_lib.recordings.contest import TRIALS
from inswsn_lib.recordings.correction import Correction, correction_of, network_of
from inswsn_lib.recordings.estimates import (
    Estimate,
    normalised,
    of_solution,
    scores,
    truth_at,
    unlikely,
)
from inswsn_lib.recordings.filter_checks import check_errors, check_innovations
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding, verdict
from inswsn_lib.recordings.set_up_checks import check_set_up
from inswsn_lib.streams import Fixes, Recording

_ALIGNMENT = 20.0  # s
_RATIO = 2.0  # of the steps of a search
_FEWEST = 12  # fixes by which a track is judged
_OF_FILTER = ("size", "colour", "whiteness", "errors")
_TRACK = ("x", "y", "vx", "vy")
_SCORES = ("position", "position_ratio", "position_low", "position_high") + (
    "velocity", "velocity_ratio", "velocity_low", "velocity_high"
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Report:
    """What is told of a recording.

    Attributes
    ----------
    findings : list of Finding
        Of the set-up, as of `check_set_up`; then ``axes`` of a network that fits the motion better
        if it is mirrored; then of the filter: ``start`` if it cannot start, ``size`` (mean NIS),
        ``colour`` and ``whiteness`` of the innovations, and ``errors`` (NEES) with a reference.
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
        (m/s), and the deviations that the filter states, ``sd_x`` and so on. Without a filter it is
        the network's.
    numbers : tuple of float
        Of the filter, as `InertialCorrection` and `OdometryCorrection` name them; empty without.
    """

    findings: list[Finding]
    table: pd.DataFrame
    judge: str
    sentence: str
    track: pd.DataFrame
    numbers: tuple[float, ...] = ()


def report(recording: Recording, *, alignment: float = _ALIGNMENT, trials: int = TRIALS) -> Report:
    """Check a recording, correct its motion by its network, and tell how good that is.

    Stamps are taken as they are. Ranges beside an IMU are made into fixes; beside odometry they are
    taken one by one. The start is found from the data, without the reference. The few numbers of
    the filter are tuned by the likelihood of its innovations in the first half of the recording,
    and all is judged in the second. Without a reference every second fix of the second half is
    withheld, and errors are those there: of the network, what the fix before and its velocity say.

    Parameters
    ----------
    recording : Recording
        From `load`; of any streams.
    alignment : float
        By how much of the data the start is found, s.
    trials : int
        Of the search for the filter's numbers.

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
    findings = check_set_up(recording)
    try:
        filtered = correction_of(recording, alignment)
        start = filtered.start
    except InswsnError as error:
        return _without_filter(recording, findings, str(error))
    findings += _mirrored(recording, filtered, alignment)
    split = float(np.mean(filtered.fixes.time[[0, -1]]))
    if not start.time < split:
        said = f"The start takes {alignment:g} s, more than half of the recording."
        return _without_filter(recording, findings, said)
    loss = unlikely(filtered.run, split)
    ratios = [_RATIO] * len(filtered.begin)
    numbers = search_pattern("filter", filtered.begin, ratios, loss, most=trials).best
    solution = filtered.run(*numbers)
    since = max(split, filtered.known)
    findings += _of_innovations(filtered, solution, since)
    network = filtered.fixes
    corrected = of_solution(solution, filtered.lever_arm, network.time)
    if recording.reference is not None:
        truth = truth_at(recording, network.time)
        estimates = {
            "network": Estimate(_network_state(network, network.time)),
            "corrected": corrected,
            "smoothed": of_solution(smooth(solution), filtered.lever_arm, network.time),
        }
        rows = network.time > since
        judge = "reference"
        findings += _of_errors(corrected, truth, rows, network)
    else:
        rows = withheld_rows(network, since)
        truth = _network_state(network, network.time)
        if network.velocity is None or recording.fixes is None or recording.fixes.velocity is None:
            truth[:, 2:] = np.nan  # of a line through fixes that were withheld
        estimates = _at_withheld(filtered, numbers, rows)
        judge = "withheld fixes"
    table = _table(estimates, truth, rows, network)
    return Report(
        findings,
        table,
        judge if table["position"].notna().any() else "nothing",
        _sentence(findings, table, judge),
        _track(network.time, corrected),
        numbers,
    )


def _without_filter(recording: Recording, findings: list[Finding], said: str) -> Report:
    """Return what can be told of the network alone."""
    network = network_of(recording)
    alone = Estimate(_network_state(network, network.time))
    table, judge = _table({}, np.empty(0), np.zeros(0, dtype=bool), network), "nothing"
    if recording.reference is not None:
        half = network.time > float(np.mean(network.time[[0, -1]]))
        table = _table({"network": alone}, truth_at(recording, network.time), half, network)
        judge = "reference" if table["position"].notna().any() else "nothing"
    findings = [
        *findings,
        Finding("start", "filter", np.nan, np.nan, np.nan, None, said.rstrip(".")),
    ]
    wrong = [found for found in findings if found.fits is False]
    said = f"{verdict(wrong)} {said}" if wrong else said
    return Report(findings, table, judge, said, _track(network.time, alone))


def _network_state(network: Fixes, times: Array) -> Array:
    """Return what the last fix before or at each time says of it, by its velocity, (times, 4)."""
    assert network.velocity is not None  # `network_of` has it
    state = np.hstack([network.position[:, :2], network.velocity[:, :2]])
    there = np.flatnonzero(np.isfinite(state).all(axis=1))
    last = np.searchsorted(network.time[there], times, side="right") - 1
    found = np.full((len(times), 4), np.nan)
    told = last >= 0
    rows = there[last[told]]
    found[told] = state[rows]
    found[told, :2] += state[rows, 2:] * (times[told] - network.time[rows])[:, None]
    return found


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


def _at_withheld(
    filtered: Correction, numbers: Sequence[float], rows: Mask
) -> dict[str, Estimate]:
    """Return what is said without fixes that are withheld."""
    other = filtered.without(rows)
    taken: Fixes = other.fixes
    if filtered.fixes.velocity is not None and _is_slope(filtered.fixes):
        taken = slope_velocity(replace(taken, velocity=None))
    solution = other.run(*numbers)
    return {
        "network": Estimate(_network_state(taken, taken.time)),
        "corrected": of_solution(solution, filtered.lever_arm, taken.time),
        "smoothed": of_solution(smooth(solution), filtered.lever_arm, taken.time),
    }


def _is_slope(fixes: Fixes) -> bool:
    """Tell whether velocities are those of lines through fixes."""
    assert fixes.velocity is not None
    return np.allclose(
        fixes.velocity, slope_velocity(fixes).velocity, rtol=0, atol=1e-9, equal_nan=True
    )


def _table(
    estimates: dict[str, Estimate], truth: Array, rows: Mask, network: Fixes
) -> pd.DataFrame:
    """Return the scores on the rows of which all estimates and the truth say where the tag is."""
    states = [each.state[:, :2] for each in estimates.values()]
    if states:
        rows = rows & np.isfinite(np.hstack([*states, truth[:, :2]])).all(axis=1)
    if rows.sum() < _FEWEST:
        return pd.DataFrame(np.nan, index=list(estimates), columns=list(_SCORES))
    if not np.isfinite(truth[rows, 2:]).all():
        truth = np.column_stack([truth[:, :2], np.full((len(truth), 2), np.nan)])
    errors = estimates["network"].state[rows] - truth[rows]
    period = float(np.median(np.diff(network.time)))
    every = max(1, round((len(rows) - 1) / max(int(rows.sum()), 1)))
    found = {
        name: scores(replace(each.part(rows), covariance=None), truth[rows], errors, every * period)
        for name, each in estimates.items()
    }
    return pd.DataFrame(found).T[list(_SCORES)]


def _mirrored(recording: Recording, filtered: Correction, alignment: float) -> list[Finding]:
    """Ask whether the motion fits the network better if that is mirrored."""
    end = filtered.known
    who = "network and motion"
    straight = filtered.run(*filtered.begin, end=2 * end - filtered.fixes.time[0])
    try:
        other = correction_of(_mirror(recording), alignment)
        mirrored = other.run(*filtered.begin, end=2 * end - filtered.fixes.time[0])
    except InswsnError:
        return []
    gain = mirrored.log_likelihood - straight.log_likelihood
    bound = float(-np.log(FALSE_ALARM))
    if abs(gain) < bound:
        says = "the motion turns too little to tell a mirrored network"
        return [Finding("axes", who, gain, -np.inf, bound, None, says)]
    says = "they turn to the same side"
    if gain > 0:
        says = "the network is mirrored, its x and y exchanged, or rates have the other sign"
    return [Finding("axes", who, gain, -np.inf, bound, gain < 0, says)]


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
    told = solution.innovations[0]
    sizes = np.array([len(value) for value in told.values])
    judged = np.repeat(told.time > since, sizes)
    scaled = np.concatenate(told.values) / np.concatenate(told.deviations)
    squares = np.repeat(told.squares, sizes)
    series = filtered.series(solution)
    return list(check_innovations(squares[judged], scaled[judged], series[judged]))


def _of_errors(corrected: Estimate, truth: Array, rows: Mask, network: Fixes) -> list[Finding]:
    assert corrected.covariance is not None
    rows = rows & np.isfinite(np.hstack([corrected.state, truth])).all(axis=1)
    if rows.sum() < _FEWEST:
        return []
    squares = normalised((corrected.state - truth)[rows], corrected.covariance[rows])
    return [check_errors(squares, 4, float(np.median(np.diff(network.time))))]


def _sentence(findings: list[Finding], table: pd.DataFrame, judge: str) -> str:
    """Return what comes of it."""
    said = []
    set_up = [found for found in findings if found.name not in _OF_FILTER]
    if any(found.fits is False for found in set_up):
        said.append(verdict(set_up))
    wrong = [found for found in findings if found.name in _OF_FILTER and found.fits is False]
    if wrong:
        causes = "; ".join(f"{found.name} {found.value:.2g}: {found.says}" for found in wrong)
        said.append(f"Warning: the filter is not consistent ({causes}).")
    else:
        said.append("The filter is consistent.")
    ratio, low, high = table.loc["corrected", ["position_ratio", "position_low", "position_high"]]
    by = {"reference": "by the reference", "withheld fixes": "at withheld fixes"}[judge]
    if np.isnan(ratio):
        return " ".join([*said, "How large errors are cannot be told."])
    if low > 1:
        said.append("Warning: the corrected track is worse than the network.")
    what = "better" if high < 1 else "worse" if low > 1 else "neither better nor worse"
    said.append(
        f"Position, {by}: corrected, it is {what}, with {ratio:.0%} ({low:.0%} to {high:.0%}) of "
        "the network's error."
    )
    speed = table.loc["corrected", ["velocity_ratio", "velocity_low", "velocity_high"]]
    if np.isfinite(speed).all():
        r, a, b = speed
        said.append(f"Velocity: {r:.0%} ({a:.0%} to {b:.0%}).")
    return " ".join(said)


def _track(times: Array, estimate: Estimate) -> pd.DataFrame:
    found = pd.DataFrame(estimate.state, columns=list(_TRACK))
    found.insert(0, "time", times)
    deviations = np.full_like(estimate.state, np.nan)
    if estimate.covariance is not None:
        deviations = np.sqrt(np.diagonal(estimate.covariance, axis1=1, axis2=2))
    found[[f"sd_{name}" for name in _TRACK]] = deviations
    return found[np.isfinite(estimate.state[:, :2]).all(axis=1)].reset_index(drop=True)
