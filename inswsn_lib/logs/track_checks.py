"""Whether a recording and the figures of a filter fit one another, and what misfits point to.

Each check compares one number with a bound that a recording which fits exceeds by chance once in a
thousand times, or less often. A mistake that the data cannot show, as a late network while nothing
moves, is told to be one.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2, f, norm, poisson

from inswsn_lib.checks import Array, covariance, positive_definite
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.evaluation import independent_count, mean_square, normalised_squares
from inswsn_lib.evaluation.alignment import Alignment
from inswsn_lib.filters import design_kalman, run_kalman
from inswsn_lib.logs.filter_checks import check_filter
from inswsn_lib.logs.findings import FALSE_ALARM, Finding
from inswsn_lib.logs.ins_wsn import TrackPair
from inswsn_lib.models import ErrorModel

_FEWEST = 20  # values that are compared
_REACH = 5.0  # s: how late and how early is looked for
# A lag (s) and a turn (degrees) that must be told, lest the data cannot tell them.
_LAG, _TURN = 1.0, 20.0
_COPIED = 0.1  # of the network's variance: a reference that is nearer was made from it
_OTHER = 9.0  # times the variance of the network: what no lag and no turn explain is another run
_SMOOTH = 10  # rows for which that lasts, or more; noise that is larger does not
_LEAST = 0.01  # of that variance, lest a track that is the other one has none
# Where one mistake makes several checks fail, those that are not here come first, then these.
_ORDER = ("run", "start", "outliers", "origin", "size", "colour", "whiteness", "copy", "noise")
_TRIED = 300  # explanations and lags of their own, that are tried at once


def check_recording(
    data: TrackPair, model: ErrorModel, *, initial_covariance: ArrayLike
) -> list[Finding]:
    """Return what each check of a recording found, those that reveal most about the cause first.

    The innovations of the filter are white, of the size that the filter says, and without steps
    that stand out, if model and recording fit. Whether the network is late, or in another frame,
    is told by the reference: a lag, a clock that gains, a turn, a mirror and a scale are fitted to
    both by least squares, and compared by what they leave.

    Parameters
    ----------
    data : TrackPair
    model : ErrorModel
        Of the error of the INS and its measurement, as `run_kalman` takes it, with the components
        x, y, v_x, v_y, of which the measurement may lack the last two.
    initial_covariance : array_like, (4, 4)
        P_0, as in `run_kalman`.

    Examples
    --------
    A network that is told 1 s late:

    >>> import dataclasses
    >>> import numpy as np, inswsn_lib as iw
    >>> data = iw.read_recording(iw.data_file("examples/ins-wsn.csv"))
    >>> model = iw.ErrorModel.p1(0.2, process_noise=(0.001, 0.01), measurement_noise=(0.2, 0.1))
    >>> late = dataclasses.replace(data, wsn=np.roll(data.wsn, 5, axis=0))
    >>> for found in iw.check_recording(late, model, initial_covariance=np.eye(4))[:20]:
    ...     if found.name == "time" and not found.fits:
    ...         print(f"{found.subject}: {found.value:.1f} s")
    network and reference: 1.0 s
    """
    if model.A.shape != (4, 4) or len(model.C) not in {2, 4}:
        got = Described(f"of {len(model.A)} and {len(model.C)}")
        raise ParameterError("model", got, "of 4 states and 2 or 4 measured components")
    positive_definite("D D' of the model", model.measurement_covariance)
    P0 = covariance("initial_covariance", initial_covariance, (4, 4))
    innovations = list(_innovations(data, model, P0))
    sized = all(each.fits for each in innovations if each.name == "size")
    found = [
        _rate(data),
        _repeats(data, model),
        *_in_itself(data),
        *_against_reference(data, model, sized=sized),
        *innovations,
    ]
    return sorted(found, key=lambda each: _ORDER.index(each.name) if each.name in _ORDER else -1)


# What can be seen in the columns as they are


def _rate(data: TrackPair) -> Finding:
    """Look for a second rate: a long run of equal intervals that are not those of the grid."""
    rows = np.flatnonzero(~np.isnan(data.ins[:, 0]))
    steps = np.diff(rows)
    edges = np.flatnonzero(np.diff(steps, prepend=0, append=0))
    lengths = [(int(b - a), int(steps[a])) for a, b in pairwise(edges) if steps[a] > 1]
    longest, step = max(lengths, default=(0, 1))
    # rows that are lost at random leave an interval of two steps with a probability below 1/4
    bound = float(np.ceil(np.log(len(rows) / FALSE_ALARM) / np.log(4)))
    says = "intervals between rows are even" if longest <= bound else (
        f"{longest + 1} rows follow one another in {step * data.period:.3g} s, others in "
        f"{data.period:.3g} s: two rates in one file"
    )  # fmt: skip
    return Finding("rate", "rows", longest, 0, bound, longest <= bound, says)


def _resolution(values: Array) -> float:
    """Return the unit that values are rounded to: the least of their distances, or a decimal."""
    found = np.unique(values)
    if found.size < 2:
        return 0.0
    for unit in (float(np.diff(found).min()), *10.0 ** np.arange(0, -9, -1)):
        parts = (found - found[0]) / unit
        if np.abs(parts - np.round(parts)).max() < 1e-3:
            return float(unit)
    return 0.0


def _repeats(data: TrackPair, model: ErrorModel) -> Finding:
    """Count values of the network that stand again, and how many noise and rounding make."""
    sigma = np.sqrt(np.diag(model.measurement_covariance))
    worst = Finding("repeats", "network", 0, 0, 0, True, "no value stands again too often")
    for name, values, size in zip(["x", "y", "v_x", "v_y"], data.wsn.T, sigma, strict=False):
        there = values[~np.isnan(values)]
        if there.size < 3:
            continue
        again = int(np.sum(there[1:] == there[:-1]))
        chance = min(1.0, _resolution(there) / (np.sqrt(4 * np.pi) * size))
        most = float(poisson.isf(FALSE_ALARM / 4, there.size * chance)) + 1
        if again > most and again - most > worst.value - worst.high:
            says = f"{name} repeats {again} times: stuck, clipped, held, or a number for no fix"
            worst = Finding("repeats", "network", again, 0, most, False, says)
    return worst


def _in_itself(data: TrackPair) -> Iterator[Finding]:
    """Compare the way of each smooth source with the integral of its velocities, step by step."""
    for subject, values in (("INS", data.ins), ("reference", data.reference)):
        if values is None:
            continue
        moved = np.diff(values[:, :2], axis=0)
        told = (values[1:, 2:] + values[:-1, 2:]) / 2 * data.period
        known = ~np.isnan(moved + told).any(axis=1)
        if known.sum() < 3:
            continue
        moved, told = moved[known], told[known]
        apart = moved - told
        off = np.linalg.norm(apart, axis=1)
        noise = float(np.median(np.linalg.norm(np.diff(apart, axis=0), axis=1)))
        unit = max(_resolution(column) for column in values[~np.isnan(values).any(axis=1), :2].T)
        change = np.linalg.norm(np.diff(values[:, 2:], axis=0)[known], axis=1) * data.period
        # an integral by rectangles is half a change of velocity away; noise changes by the step
        slack = 0.2 * np.linalg.norm(told, axis=1) + change + 5 * unit + 8 * noise
        count = int(np.sum(off > slack))
        bound = 2.0
        says = "positions follow velocities" if count <= bound else (
            f"in {count} rows positions do not move as velocities say: stuck, set back, in other "
            "axes, late, or held"
        )  # fmt: skip
        yield Finding("itself", subject, count, 0, bound, count <= bound, says)


# What the innovations tell


def _innovations(data: TrackPair, model: ErrorModel, P0: Array) -> Iterator[Finding]:
    y = data.measurements[:, : len(model.C), 0]
    there = ~np.isnan(y)
    S = design_kalman(model, there, initial_covariance=P0).innovation
    left = y - run_kalman(model, y, initial_covariance=P0, predicted=True) @ model.C.T
    counts, each = there.sum(axis=1), normalised_squares(left, S)
    fixes = np.flatnonzero(counts)
    squares, counts = each[fixes], counts[fixes]
    # what stands out does so beside the others, however large they are
    scale = max(1.0, float(np.median(squares / chi2.median(counts))))
    value, bound = float(squares[0]) / scale, float(chi2.isf(FALSE_ALARM, counts[0]))
    says = "the first fix is as near as the initial errors say" if value <= bound else (
        f"the first fix is {np.sqrt(value / counts[0]):.1f} times as far as the initial errors "
        "say: they are too small, or the network has another origin"
    )  # fmt: skip
    yield Finding("start", "first fix", value, 0, bound, value <= bound, says)
    chance = chi2.sf(squares[1:] / scale, counts[1:])
    count = int(np.sum(chance < FALSE_ALARM / len(fixes)))
    says = "none stands out"
    if count:
        at = data.time[fixes[1 + int(np.argmin(chance))]]
        says = f"{count} fixes stand out, most that at {at:.6g} s: wrong fixes, a jump"
    yield Finding("outliers", "fixes", count, 0, 0, count == 0, says)
    yield from check_filter(left, S)


# What fits the reference better than no lag and no turn


def _against_reference(data: TrackPair, model: ErrorModel, *, sized: bool) -> Iterator[Finding]:
    """Compare the network with the reference; `sized` tells that innovations are as assumed."""
    who, m, reference = "network and reference", len(model.C), data.reference
    if reference is None or np.isfinite(data.wsn - reference).sum() < _FEWEST:
        says = "there is no reference to tell by" if reference is None else "too few fixes"
        for name in ("time", "frame"):
            yield Finding(name, who, np.nan, np.nan, np.nan, None, says)
        return
    sigma = np.sqrt(np.diag(model.measurement_covariance))
    reach = min(_REACH, len(data.time) * data.period / 10)
    yield from _aligned(who, Alignment(data.time, data.wsn[:, :m], reference, sigma, reach))
    apart = data.wsn[:, :m] - reference[:, :m]
    shift = np.nanmean(apart[:, :2], axis=0)
    free = (apart - np.append(shift, np.zeros(m - 2))) / sigma
    there = np.isfinite(free)
    mean = float(np.mean(free[there] ** 2))
    # errors of the network that last count as fewer
    independent = independent_count(free[there.any(axis=1)])
    z = float(np.abs(shift / sigma[:2]).max() * np.sqrt(independent / max(1.0, mean)))
    bound = float(norm.isf(FALSE_ALARM / 4))
    says = "network and reference have one origin" if z <= bound else (
        f"they are ({shift[0]:.3g}, {shift[1]:.3g}) m apart on average: another origin"
    )  # fmt: skip
    yield Finding("origin", who, z, 0, bound, z <= bound, says)
    size = mean_square(mean, independent * there.sum() / there.any(axis=1).sum())
    name, says = "size", f"they are {np.sqrt(mean):.3g} times as far apart as is assumed"
    if size.fits:
        says = "the network is as far from the reference as its noise says"
    elif mean < _COPIED or (mean < size.low and sized):
        name, says = "copy", "the reference has the network's noise: it was made from the network"
    elif sized:  # the innovations do not know the reference
        name, says = "noise", "the reference has noise of its own, or another rate or run"
    yield Finding(name, who, *size, size.fits, says)


def _aligned(who: str, found: Alignment) -> Iterator[Finding]:
    """Return whether a lag, or a turn, fits better than none, and which."""
    tries = found.explanations()
    best = min(tries, key=lambda fit: fit.squares + 3 * np.log(found.values) * fit.parameters)
    variance = max(_LEAST, best.squares / found.values)
    share, wrong = independent_count(best.left) / max(1, len(best.left)), None
    if share * _SMOOTH < 1 and best.squares > _OTHER * found.values:
        says = "they do not go together, with any lag, turn or scale"
        wrong = best._replace(name="run", value=best.squares / found.values, says=says)
    else:
        gain = share * (best.rival - best.squares) / variance
        level, rest = FALSE_ALARM / _TRIED, max(1.0, share * found.values)
        if gain > best.parameters * float(f.isf(level, best.parameters, rest)):
            wrong = best
    far = float(norm.isf(FALSE_ALARM / (2 * _TRIED)) * np.sqrt(variance / share))
    late, turned = (far * each for each in found.deviations())
    values = {
        "time": (tries[0].value, late, _LAG),
        "frame": (0.0, float(np.degrees(turned)), _TURN),
    }
    for name, (value, bound, most) in values.items():
        if wrong is not None and (wrong.name in {"time", "clock"}) == (name == "time"):
            yield Finding(wrong.name, who, wrong.value, -bound, bound, False, wrong.says)
        elif bound > most:
            says = "too little changes for the data to tell"
            yield Finding(name, who, value, -bound, bound, None, says)
        else:
            says = "another explanation fits better" if wrong else "none is found"
            yield Finding(name, who, value, -bound, bound, True, says)
