"""A report on a recording: its set-up, a filter tuned on it, and how good that filter is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation, Slerp

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.filters import MISFIT, likely_interval
from inswsn_lib.inertial import InertialState, PlanarState, Solution, Start, smooth
from inswsn_lib.logs.correction import COLOURED, is_planar, turned_by_gyroscope
from inswsn_lib.logs.estimates import ERRORS, FEWEST, Estimate, innovations_of, scores, truth_at
from inswsn_lib.logs.filter_checks import check_innovations, check_nees, check_outliers
from inswsn_lib.logs.findings import FALSE_ALARM, Finding
from inswsn_lib.logs.ladder import Ladder
from inswsn_lib.logs.network_fixes import network_of, shares_of
from inswsn_lib.logs.outages import COASTING, ON, SMOOTHED, STILL, STRAIGHT, Outages
from inswsn_lib.logs.set_up_checks import check_failed, check_set_up
from inswsn_lib.streams import Fixes, Recording

_ALIGNMENT = 20.0  # s
_MIRRORED = "the network is mirrored, its x and y exchanged, or rates have the other sign"
_TRACK = ("x", "y", "vx", "vy")
_MOST, _INTERVAL = 20_000, 0.2  # fixes, or intervals of ranges, that are taken, and s of these
# RMS misfit of the logarithm of the ratio that a filter states: on the seven series of
# `recorded_gains` whose innovations fit without their reference it was 0.09
_STATED = 0.12
_OF_FILTER = ("outliers", "size", "colour", "whiteness", "errors")  # findings of the filter
# Outages in which fixes are withheld, s: times how long their errors last, at the least and most,
# and of the time that is judged
_LASTING, _SHORTEST, _LONGEST, _SHARE = 2.0, 2.0, 10.0, 0.1


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
        (``position_ratio``, ``position_low``, ``position_high``, and of velocity). A row
        ``expected`` has the ratios of a filter on fixes that were to be expected by how long errors
        of fixes last and the motion holds their accuracy, with 90 % intervals
        (`filters.ErrorStatistics`), where there is a reference and enough of it; one that learns
        the tilt of an INS may have less error of velocity. Without a reference it is the ratio
        of position by the covariance of the filter, if its innovations fit. In outages the
        network is the better of standing still and going on at the last velocity; a row ``line`` is
        the straight line to the next fix, which the smoothed track is compared with. What cannot
        be told is NaN.
    judge : str
        By what: ``reference``; ``outages of L s``, of withheld fixes whose own errors are in the
        numbers; or ``nothing``.
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
    begins: int = 3,
    start: Start | None = None,
) -> Report:
    """Check a recording, correct its motion by its network, and report how good that is.

    Stamps are taken as they are. Ranges that mean that nothing was measured, such as -1, are left
    out. Ranges beside an IMU are made into fixes; beside odometry they are taken one by one, and of
    an IMU beside odometry the rate about the vertical is taken where it makes the network more
    likely. The start is found from the data, without the reference. The filter is the likeliest of
    a `Ladder`, with white or with coloured errors of fixes, tuned on the first half; all is judged
    in the second half. Without a reference the filter is judged in outages of fixes, which are
    longer than their errors last: of what both have at hand the corrected track is compared with
    the better of standing still and going on from the last fix, the smoothed one with a straight
    line to the next. Of more than 20,000 fixes, or intervals of ranges, every so many-th is taken.

    Parameters
    ----------
    recording : Recording
        From `load`; of any streams.
    alignment : float
        By how much of the data the start is found, s; by more where the heading does not show yet.
    begins : int
        Of each search for the filter's numbers, as of `most_likely`.
    start : Start, optional
        What is known of the start, of `known_start`; for odometry with a `PlanarState`.

    Raises
    ------
    InswsnError
        If there is no network.

    Examples
    --------
    Fixes, and nothing to correct them with:

    >>> import numpy as np
    >>> from inswsn_lib import logs, streams
    >>> t = np.arange(60.0)
    >>> fixes = streams.Fixes(time=t, position=np.column_stack([t, 0 * t, 0 * t]))
    >>> print(logs.report(streams.Recording("walk", fixes=fixes)).sentence)
    The recording walk has neither an IMU nor odometry: there is nothing to correct fixes with.
    """
    kind = PlanarState if is_planar(recording) else InertialState
    if start is not None and not isinstance(start.state, kind):
        raise ParameterError("start", type(start.state).__name__, f"one with {kind.__name__}")
    findings = check_set_up(recording)
    recording, more = _thinned(check_failed(recording)[1])
    findings += more
    ladder = Ladder(recording, alignment=alignment, given=start, begins=begins)
    try:
        findings += ladder.filters.assumed
        begun = ladder.start.time
    except InswsnError as error:
        findings += _mirrored_start(ladder)
        return _without_filter(ladder.recording, findings, str(error))
    if not begun < ladder.split:
        taken = begun - ladder.fixes.time[0]
        said = f"The start takes {taken:.3g} s, more than half of the recording."
        return _without_filter(ladder.recording, findings, said)
    try:
        return _with_filter(ladder, findings)
    except (InswsnError, np.linalg.LinAlgError) as error:
        return _without_filter(ladder.recording, findings, f"The filter cannot run: {error}")


def _thinned(recording: Recording) -> tuple[Recording, list[Finding]]:
    """Return a recording with every so many-th fix, or interval of ranges, where it is long."""
    fixes, ranges = recording.fixes, recording.ranges
    count, what = 0 if fixes is None else len(fixes), "fixes"
    if ranges is not None and len(ranges):
        count, what = int(np.ptp(ranges.time) / _INTERVAL), "intervals of ranges"
    every = count // _MOST + 1
    if every == 1:
        return recording, []
    if ranges is not None and len(ranges):
        inside = ((ranges.time - ranges.time[0]) / _INTERVAL).astype(int) % every == 0
        recording = replace(recording, ranges=ranges.kept(inside))
    elif fixes is not None:
        recording = replace(recording, fixes=fixes.kept(np.arange(count) % every == 0))
    says = f"the recording is long: of {every} {what} one is taken"
    return recording, [Finding("length", "network", every, 1, np.inf, True, says)]


def _with_filter(ladder: Ladder, findings: list[Finding]) -> Report:
    recording = ladder.recording
    ladder, more = _by_gyroscope(ladder)
    findings += more
    if not {("axes", True), ("time", False)} & {(each.name, each.fits) for each in findings}:
        findings += _mirrored(replace(ladder, recording=recording), ladder)
    name = ladder.corrected
    solution = ladder.solution(name)
    findings += [_settled(ladder, name), *_of_innovations(ladder, name, solution)]
    judged = _by_reference if recording.reference is not None else _in_outages
    table, judge, more = judged(ladder, solution)
    findings += more
    if recording.reference is None:
        table = pd.concat([table, _stated(ladder, solution, findings)])
    judge = "nothing" if table.isna().all(axis=None) else judge
    said = sentence_of(findings, table, judge)
    track = _track(ladder.fixes.time, ladder.of(solution))
    return Report(findings, table, judge, said, track, ladder.tuned(name).best)


_Judged = tuple[pd.DataFrame, str, list[Finding]]


def _settled(ladder: Ladder, name: str) -> Finding:
    """Return whether the search for the numbers led from two begins to one end."""
    search = ladder.tuned(name)
    least, *others = sorted(search.losses)
    apart = others[0] - least if others else 0.0
    says = "the numbers hang on where the search for them began"
    if search.settled:
        says = "two begins led to the same numbers"
    return Finding("search", "filter", apart, 0.0, 0.5, search.settled if others else None, says)


def _by_reference(ladder: Ladder, solution: Solution) -> _Judged:
    """Judge by the reference."""
    turned = _turned_by(ladder.filters.recording, solution)
    truth, rows = truth_at(turned, ladder.fixes.time), ladder.fixes.time > ladder.split
    corrected, smoothed = ladder.of(solution), ladder.of(smooth(solution))
    estimates = {"network": ladder.network, "corrected": corrected, "smoothed": smoothed}
    table, P = _table(estimates, truth, rows), corrected.covariance
    table = pd.concat([table, _expected(ladder, truth)])
    assert P is not None  # a filter has it
    errors = (corrected.state - truth)[:, : P.shape[1]]
    rows = rows & np.isfinite(errors).all(axis=1)
    found = [check_nees(errors[rows], P[rows])] if rows.sum() >= FEWEST else []
    return table, "reference", found


def _expected(ladder: Ladder, truth: Array) -> pd.DataFrame:
    """Return a row of what a filter on fixes is expected to leave of their errors, or none."""
    try:
        ratios = ladder.statistics(truth).ratios()
    except InswsnError:  # too short
        return pd.DataFrame(columns=[*ERRORS], dtype=float)
    told = [likely_interval(*each) for each in zip(ratios, MISFIT, strict=True)]
    row = [value for each in told for value in (np.nan, *each)]
    return pd.DataFrame([row], index=["expected"], columns=[*ERRORS])


def _stated(ladder: Ladder, solution: Solution, findings: list[Finding]) -> pd.DataFrame:
    """Return a row of what a filter on fixes says that it leaves of their errors, or none.

    By its covariance, the solution of the Riccati equation with the errors of fixes that it takes
    for likely, and only where its innovations bear it out.
    """
    name, P = ladder.corrected, ladder.of(solution).covariance
    doubted = any(each.fits is False for each in findings if each.name in _OF_FILTER)
    if name != ladder.on_fixes or P is None or doubted:
        return pd.DataFrame(columns=[*ERRORS], dtype=float)
    white, *others = ladder.tuned(name).best[2:]
    variance = white**2 + (others[-2] ** 2 if name == COLOURED else 0.0)
    rows = (ladder.fixes.time > ladder.split) & np.isfinite(P).all(axis=(1, 2))
    of_fixes = variance * np.mean(shares_of(ladder.fixes)[rows, :2] ** 2)
    ratio = float(np.sqrt(np.mean(np.diagonal(P[rows, :2, :2], axis1=1, axis2=2)) / of_fixes))
    row = dict.fromkeys(ERRORS, np.nan)
    row |= zip(ERRORS[1:4], likely_interval(ratio, _STATED), strict=True)
    return pd.DataFrame(row, index=["expected"])


def _turned_by(recording: Recording, solution: Solution) -> Recording:
    """Return a recording whose reference has attitudes: its own, or those of a filter in space.

    By them the reference, which is the body's, is brought to the tag.
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


def _in_outages(ladder: Ladder, solution: Solution) -> _Judged:
    """Judge by fixes that are withheld, in outages longer than their errors last."""
    numbers, judged = ladder.tuned(ladder.corrected).best, ladder.fixes.time[-1] - ladder.split
    lasting = numbers[-1] if ladder.corrected == COLOURED else 0.0
    length = max(min(max(_LASTING * lasting, _SHORTEST), _LONGEST, _SHARE * judged), ladder.step)
    outages = Outages(ladder, length, length)
    vars(outages)["solutions"] = {ladder.corrected: solution}
    try:
        errors = outages.errors | outages.oracles
    except InswsnError:  # there is no room for three
        rows = ["network", "corrected", "line", "smoothed"]
        return pd.DataFrame(np.nan, index=rows, columns=[*ERRORS]), "nothing", []
    carried = min((STILL, ON), key=lambda name: float(np.nanmean(np.square(errors[name]))))
    pairs = {
        "network": (carried, carried),
        "corrected": (COASTING, carried),
        "line": (STRAIGHT, STRAIGHT),
        "smoothed": (SMOOTHED, STRAIGHT),
    }
    told = {
        row: dict(zip(ERRORS, outages.ratio(errors[mine], errors[other], length), strict=False))
        for row, (mine, other) in pairs.items()
    }
    return pd.DataFrame(told, index=[*ERRORS]).T, f"outages of {length:.3g} s", []


def _without_filter(recording: Recording, findings: list[Finding], said: str) -> Report:
    """Return what can be told of the network alone; findings are kept whatever it is."""
    try:
        network = network_of(recording)
    except InswsnError:
        if not (recording.ranges or recording.fixes):
            raise
        network = Fixes(np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2)))
    assert network.velocity is not None  # `network_of` has it
    times = network.time
    alone = Estimate(np.hstack([network.position[:, :2], network.velocity[:, :2]]))
    table, judge = pd.DataFrame(columns=[*ERRORS]), "nothing"
    if recording.reference is not None and len(times):
        truth, half = truth_at(recording, times), times > float(np.mean(times[[0, -1]]))
        table = _table({"network": alone}, truth, half)
        judge = "nothing" if table.isna().all(axis=None) else "reference"
    start = Finding("start", "filter", np.nan, np.nan, np.nan, None, said.rstrip("."))
    said = " ".join([*_of_set_up(findings), said])
    return Report([*findings, start], table, judge, said, _track(times, alone))


def _table(estimates: dict[str, Estimate], truth: Array, rows: Mask) -> pd.DataFrame:
    """Return the scores on the rows where all estimates say where the tag is."""
    states = [each.state[:, :2] for each in estimates.values()]
    there = rows & np.isfinite(states).all(axis=(0, 2))
    errors = (estimates["network"].state - truth)[there]
    found = {name: scores(e.part(there), truth[there], errors) for name, e in estimates.items()}
    return pd.DataFrame(found).T[[*ERRORS]]


def _mirrored(other: Ladder, ladder: Ladder) -> list[Finding]:
    """Ask whether the motion fits the network better if that is mirrored."""
    gain = _more_likely(replace(other, recording=_mirror(other.recording)), ladder)
    if np.isnan(gain):
        return []
    bound = float(-np.log(FALSE_ALARM))
    fits, says = None, "the motion turns too little to tell a mirrored network"
    if abs(gain) >= bound:
        fits, says = gain < 0, _MIRRORED if gain > 0 else "they turn to the same side"
    return [Finding("axes", "network and motion", gain, -np.inf, bound, fits, says)]


def _mirrored_start(ladder: Ladder) -> list[Finding]:
    """Ask whether a filter that cannot start would, if the network were mirrored."""
    try:
        _ = replace(ladder, recording=_mirror(ladder.recording)).start
    except InswsnError:
        return []
    return [Finding("axes", "network and motion", np.inf, -np.inf, 0.0, False, _MIRRORED)]


def _by_gyroscope(ladder: Ladder) -> tuple[Ladder, list[Finding]]:
    """Ask whether the rate of an IMU beside odometry fits the network better, and take that."""
    turned = turned_by_gyroscope(ladder.recording) if ladder.planar else None
    if turned is None:
        return ladder, []
    other = replace(ladder, recording=turned)
    gain = _more_likely(other, ladder)
    bound = float(np.log(FALSE_ALARM))
    fits = bool(gain > bound)
    says = "the IMU's rate about the vertical fits the network as well, and is left out"
    if gain > 0:
        says, ladder = "the IMU's rate about the vertical fits the network better: taken", other
    elif not fits:
        says = "the IMU's rate about the vertical does not fit the network, and is left out"
    return ladder, [Finding("gyroscope", "IMU and odometry", gain, bound, np.inf, fits, says)]


def _more_likely(other: Ladder, ladder: Ladder) -> float:
    """Return by how much more likely another recording is, in logarithms.

    NaN where its filter cannot start, or has fewer measurements, since it starts later.
    """
    try:
        if other.start.time != ladder.start.time:
            return np.nan
    except InswsnError:
        return np.nan
    name = next(iter(ladder.rungs))
    numbers, end = ladder.rungs[name].begin, ladder.tuning_end(name)
    mine, its = (each.rungs[name].likely(*numbers, end=end) for each in (ladder, other))
    return its - mine


def _mirror(recording: Recording) -> Recording:
    """Return a recording whose network has the other sign of y."""

    def mirrored(vectors: Array | None) -> Any:
        signs = np.array([1.0, -1.0, 1.0])
        return None if vectors is None else vectors * signs[: vectors.shape[1]]

    ranges, fixes = recording.ranges, recording.fixes
    if ranges is not None:
        ranges = replace(ranges, anchors=mirrored(ranges.anchors))
    if fixes is not None:
        moved = mirrored(fixes.velocity)
        fixes = replace(fixes, position=mirrored(fixes.position), velocity=moved)
    return replace(recording, ranges=ranges, fixes=fixes)


def _of_innovations(ladder: Ladder, name: str, solution: Solution) -> list[Finding]:
    told = innovations_of(solution, ladder.rungs[name].series)
    told = told[told["time"] > ladder.split]
    each = told.drop_duplicates("measurement")["near"].to_numpy()
    near = told[told["near"]]
    squares, scaled, series = (near[of].to_numpy() for of in ("squares", "scaled", "series"))
    return [check_outliers(each), *check_innovations(squares, scaled, series)]


def _track(times: Array, estimate: Estimate) -> pd.DataFrame:
    found = pd.DataFrame(np.column_stack([times, estimate.state]), columns=["time", *_TRACK])
    deviations = np.full_like(estimate.state, np.nan)
    if (P := estimate.covariance) is not None:
        stated = P.shape[1]
        deviations[:, :stated] = np.sqrt(np.diagonal(P, axis1=1, axis2=2))
    found[[f"sd_{name}" for name in _TRACK]] = deviations
    return found.dropna(subset=["x", "y"]).reset_index(drop=True)


def _of_set_up(findings: list[Finding]) -> list[str]:
    """Return a sentence of what does not fit in the set-up, if anything."""
    wrong = [f for f in findings if f.fits is False and f.name not in _OF_FILTER]
    if not wrong:
        return []
    return [f"The set-up does not fit: {'; '.join(f'{f.subject}: {f.says}' for f in wrong)}."]


def _of_filter(findings: list[Finding]) -> str:
    """Return a sentence of whether the filter is consistent."""
    told = [found for found in findings if found.name in _OF_FILTER]
    wrong = [found for found in told if found.fits is False]
    if wrong:
        causes = "; ".join(f"{found.name} {found.value:.2g}: {found.says}" for found in wrong)
        return f"Warning: the filter is not consistent ({causes})."
    if not any(found.fits for found in told if found.name != "outliers"):
        return "Whether the filter is consistent cannot be told."
    return "The filter is consistent."


def sentence_of(findings: list[Finding], table: pd.DataFrame, judge: str) -> str:
    """Return what comes of set-up, filter and errors, as of `Report`, with warnings."""
    said = [*_of_set_up(findings), _of_filter(findings)]
    if judge == "nothing":
        return " ".join([*said, "How large the errors are cannot be told."])

    def interval(what: str, row: str = "corrected") -> Array:
        columns = [f"{what}_{end}" for end in ("ratio", "low", "high")]
        return np.asarray(table.loc[[row], columns].to_numpy(dtype=float)[0])

    def share(what: str, row: str = "corrected") -> str:
        ratio, low, high = interval(what, row)
        return f"{ratio:.0%} ({low:.0%} to {high:.0%})"

    _, low, high = interval("position")
    begin = "Warning: in" if low > 1 else "In"
    if judge == "reference":
        better = "worse than" if low > 1 else "neither better nor worse than"
        better = "better than" if high < 1 else better
        said.append(
            f"{begin} position the corrected track is {better} the network: it has "
            f"{share('position')} of its error."
        )
        if np.isfinite(interval("velocity")).all():
            said.append(f"In velocity it has {share('velocity')}.")
        if "expected" in table.index:
            said.append(
                "By how long errors of fixes last and the motion holds their accuracy, a filter on "
                "fixes, which learns neither tilt nor biases, is expected to have "
                f"{share('position', 'expected')} of their error in position and "
                f"{share('velocity', 'expected')} in velocity (90 %)."
            )
    else:
        said.append(
            f"{begin} {judge}, by the fixes that are withheld, the corrected track is "
            f"{share('position')} as far as what goes on from the last fix, and the smoothed one "
            f"{share('position', 'smoothed')} as far as a straight line to the next."
        )
        if "expected" in table.index:
            said.append(
                "While there are fixes it should have "
                f"{share('position', 'expected')} of their error in position."
            )
    return " ".join(said)
