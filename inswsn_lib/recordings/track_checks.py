"""Whether a recording and the figures of a filter fit one another, and what misfits point to.

Each check compares one number with a bound that a recording which fits exceeds by chance once in a
thousand times, or less often. A mistake that the data cannot show, as a late network while nothing
moves, is told to be one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2, f, norm, poisson

from inswsn_lib.checks import Array, Mask, covariance, positive_definite
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.evaluation import normalised_squares
from inswsn_lib.evaluation.alignment import Comparison
from inswsn_lib.filters import design_kalman, run_kalman
from inswsn_lib.models import ErrorModel
from inswsn_lib.recordings.filter_checks import check_filter
from inswsn_lib.recordings.findings import FALSE_ALARM, Finding
from inswsn_lib.recordings.ins_wsn import TrackPair

_LOW = FALSE_ALARM / 4
_WINDOW, _MOST = 2000, 10  # steps of a stretch that is compared, and how many stretches
_FEWEST = 20  # values of a stretch
_BLOCK, _FEWEST_BLOCKS = 20, 10  # steps whose residuals count as one, and of them
_REACH, _SPACING = 5.0, 0.1  # s: how late and how early is looked for, and how finely
# A lag (s) and a turn (degrees) that must be told, lest the data cannot tell them.
_LAG, _TURN = 1.0, 20.0
_COPIED = 0.1  # of the network's variance: a reference that is nearer was made from it
_OTHER = 9.0  # times the variance of the network: what no lag and no turn explain is another run
# Where one mistake makes several checks fail, those that are not here come first, then these.
_ORDER = (
    "run",
    "start",
    "outliers",
    "origin",
    "size",
    "colour",
    "whiteness",
    "copy",
    "noise",
    "misfit",
)
_MOVED = 3.0  # times its noise: how far the network must have moved, beside what an INS drifts
_REST = 0.3  # of what is too much: what an explanation may leave
_KINDS = 300  # kinds of misfit, and lags of their own, that are tried at once


def check_recording(
    data: TrackPair, model: ErrorModel, *, initial_covariance: ArrayLike
) -> list[Finding]:
    """Return what each check of a recording found, those that reveal most about the cause first.

    The innovations of the filter are white, of the size that the filter says, and without steps
    that stand out, if model and recording fit. A network that is late, or in another frame, leaves
    in them what the INS, late or turned, would: all are fitted by generalised least squares through
    the whitening filter, with an unknown start and bias of the INS (Willsky and Jones 1976), and
    likewise the network to the reference.

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
    network and INS: 1.0 s
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
        *_pair("network and INS", data, model, data.ins, filtered=True),
        *_against_reference(data, model, P0, sized),
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
        resolution = _resolution(there)
        again = int(np.sum(there[1:] == there[:-1]))
        found, counts = np.unique(there, return_counts=True)
        usual, most = (
            float(poisson.isf(level, there.size * min(1, resolution / (share * size)))) + 1
            for level, share in (
                (FALSE_ALARM / 8, np.sqrt(4 * np.pi)),
                (FALSE_ALARM / (8 * there.size), np.sqrt(2 * np.pi)),
            )
        )
        for count, bound, says in (
            (again, usual, f"{name} repeats {again} times: stuck, clipped, or held between fixes"),
            (int(counts.max()), most, f"{name} is {found[counts.argmax()]:.6g} in {counts.max()} "
             "rows: a number where there was no fix, or clipped"),
        ):  # fmt: skip
            if count > bound and count - bound > worst.value - worst.high:
                worst = Finding("repeats", "network", count, 0, bound, False, says)
    flat = _interpolated(data.wsn[:, :2])
    if worst.fits and flat > 0.2:
        says = f"{flat:.0%} of the fixes lie on straight lines between others: interpolated"
        worst = Finding("repeats", "network", flat, 0, 0.2, False, says)
    return worst


def _interpolated(positions: Array) -> float:
    """Return the share of fixes that lie half way between their neighbours, to rounding."""
    second = np.diff(positions, 2, axis=0)
    known = ~np.isnan(second).any(axis=1)
    if known.sum() < 10:
        return 0.0
    unit = np.array([_resolution(x[~np.isnan(x)]) for x in positions.T])
    scale = np.median(np.abs(np.diff(positions[~np.isnan(positions[:, 0])], axis=0)), axis=0)
    if (scale <= 10 * unit).any():  # rounding makes straight lines, too
        return 0.0
    close = np.abs(second[known]) <= np.minimum(2.1 * unit, 0.02 * scale) + 1e-9 * scale
    return float(np.mean(close.all(axis=1)))


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
        yield from _velocity_lag(subject, values, data.period)


def _velocity_lag(subject: str, values: Array, period: float) -> Iterator[Finding]:
    """Fit how late velocities are against the differences of positions over two steps.

    Velocities that are late by s miss the accelerations times s. The error of the fit is from
    blocks of steps, since what is left over hangs together.
    """
    apart = (values[2:, :2] - values[:-2, :2]) / (2 * period) - values[1:-1, 2:]
    pushed = (values[2:, 2:] - values[:-2, 2:]) / (2 * period)
    known = ~np.isnan(apart + pushed).any(axis=1)
    apart, pushed = apart[known], pushed[known]
    energy, count = float(np.sum(pushed**2)), len(pushed) // _BLOCK
    if count < _FEWEST_BLOCKS or energy == 0:
        return
    lag = float(np.sum(pushed * apart)) / energy
    left = np.sum(pushed * (apart - lag * pushed), axis=1)[: count * _BLOCK]
    error = float(np.linalg.norm(left.reshape(count, _BLOCK).sum(axis=1))) / energy
    # a step is what ways to integrate differ by
    bound = period + 5 * error
    says = "velocities belong to the positions beside them" if abs(lag) <= bound else (
        f"velocities are {abs(lag):.2g} s {'late' if lag > 0 else 'early'} against positions"
    )  # fmt: skip
    who = f"{subject}, lag of velocities"
    yield Finding("itself", who, lag, -bound, bound, abs(lag) <= bound, says)


# What the innovations tell


def _whitened(factors: Array, values: Array) -> Array:
    return np.asarray(np.linalg.solve(np.linalg.cholesky(factors), values))


def _present(S: Array, there: Mask) -> Array:
    """Return covariances (steps, m, m) with rows and columns of the identity for what is absent."""
    return np.where(there[:, :, None] & there[:, None, :], S, np.eye(S.shape[-1]))


def _through_filter(model: ErrorModel, columns: Array, there: Mask, P0: Array) -> Array:
    """Return the whitened innovations of columns (steps, m, columns), zero where absent."""
    design = design_kalman(model, there, initial_covariance=P0)
    given = np.where(there[:, :, None], columns, np.nan)
    before = run_kalman(model, given, initial_covariance=P0, predicted=True)
    left = np.where(there[:, :, None], columns - model.C @ before, 0.0)
    return _whitened(_present(design.innovation, there), left)


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


# What fits better than no lag and no turn


def _pair(
    subject: str, data: TrackPair, model: ErrorModel, other: Array, *, filtered: bool
) -> list[Finding]:
    """Return lag and turn of the network, or of what alone is wrong of positions and velocities."""
    found = list(_judged(subject, _compare(data, model, other, filtered=filtered)))
    wrong = next((each for each in found if each.fits is False), None)
    if wrong is None or len(model.C) < 4 or not _has(data.wsn[:, 2:]):
        return found
    alone = {}
    for part, rest in (("positions", slice(2, 4)), ("velocities", slice(0, 2))):
        wsn = data.wsn.copy()
        wsn[:, rest] = np.nan
        kept = _compare(replace(data, wsn=wsn), model, other, filtered=filtered)
        alone[part] = list(_judged(f"{part} of {subject}", kept))
    for part, right in (("positions", "velocities"), ("velocities", "positions")):
        mine = next((each for each in alone[part] if each.fits is False), None)
        time, frame = alone[right]
        if mine and time.fits and frame.fits:
            enough = time.high if mine.name == "time" else frame.high
            if 1.5 * enough < _size(mine):
                return alone[part]
    return found


def _size(wrong: Finding) -> float:
    """Return a misfit in the unit of the bound of its kind: s, or degrees."""
    if wrong.name in {"time", "frame"}:
        return abs(wrong.value)
    return float(np.degrees(abs(wrong.value - 1))) if wrong.name == "scale" else 90.0


def _has(values: Array) -> bool:
    return bool(np.isfinite(values).any())


def _against_reference(
    data: TrackPair, model: ErrorModel, P0: Array, sized: bool
) -> Iterator[Finding]:
    reference = data.reference
    if reference is None or np.isfinite(data.wsn - reference).sum() < _FEWEST:
        return
    yield from _pair("network and reference", data, model, reference, filtered=False)
    m = len(model.C)
    apart = data.wsn[:, :m] - reference[:, :m]
    there = ~np.isnan(apart)
    sigma = np.sqrt(np.diag(model.measurement_covariance))
    scaled = apart / sigma
    # the noise of the network, free of the mean
    measured = int(there.sum()) - 2
    middle = np.nanmean(scaled[:, :2], axis=0)
    squares = np.nansum((scaled[:, :2] - middle) ** 2) + np.nansum(scaled[:, 2:] ** 2)
    mean = float(squares) / measured
    low, high = (float(x) for x in chi2.ppf([_LOW, 1 - _LOW], measured) / measured)
    # the origin
    z = float(np.abs(middle * np.sqrt(there[:, :2].sum(axis=0))).max()) / max(1.0, mean**0.5)
    bound = float(norm.isf(FALSE_ALARM / 4))
    shift = np.nanmean(apart[:, :2], axis=0)
    says = "network and reference have one origin" if z <= bound else (
        f"they are ({shift[0]:.3g}, {shift[1]:.3g}) m apart on average: another origin"
    )  # fmt: skip
    yield Finding("origin", "network and reference", z, 0, bound, z <= bound, says)
    # what the filter knew before a fix is independent of the noise of the fix
    before = run_kalman(model, data.measurements[:, :m, 0], initial_covariance=P0, predicted=True)
    track = data.ins[:, :m] - before @ model.C.T - reference[:, :m]
    both = there & ~np.isnan(track)
    weights = np.where(both, track / sigma, 0.0)
    size = float(np.sqrt(np.sum(weights**2)))
    z = float(np.sum(weights * np.nan_to_num(scaled))) / size if size > 0 else 0.0
    bound = float(norm.isf(_LOW))
    fits = low <= mean <= high and abs(z) <= bound
    who, says = "copy", "the network is as far from the reference as its noise says"
    # the innovations do not know the reference: if their size is as assumed, it is the reference's
    if mean < _COPIED or z < -bound or (mean < low and sized):
        says = "the reference has the network's noise: it was made from the network"
    elif z > bound or (mean > high and sized):
        who, says = "noise", "the reference has noise of its own, or another rate or run"
    elif not fits:
        who, says = "size", f"the noise of the network is {np.sqrt(mean):.3g} times what is assumed"
    if low <= mean <= high and not fits:
        mean, low, high = z, -bound, bound
    yield Finding(who, "network and reference", mean, low, high, fits, says)


def _compare(data: TrackPair, model: ErrorModel, other: Array, *, filtered: bool) -> Comparison:
    """Return the network compared with another source, the errors of which are an INS's or none."""
    m, steps, T = len(model.C), len(data.time), data.period
    spacing = max(1, round(_SPACING / T))
    lags = max(1, int(min(_REACH, steps * T / 10) / (spacing * T)))
    margin = (lags + 1) * spacing
    found = Comparison(lags, spacing * T)
    if np.isnan(other).any(axis=1).all():
        return found
    centre = np.append(np.nanmean(other[:, :2], axis=0), [0.0, 0.0])
    moving, z = _filled(other) - centre, (data.wsn - centre)[:, :m]
    usable: Mask = np.asarray(~np.isnan(other).any(axis=1))
    usable[:margin] = usable[max(0, steps - margin) :] = False
    for begin in _begins(steps):
        part = slice(begin, min(begin + _WINDOW, steps))
        there = ~np.isnan(z[part]) & usable[part, None]
        if there.sum() < _FEWEST:
            continue
        shifts = range(-lags - 1, lags + 2)
        rows = np.arange(part.start, part.stop)
        later = [moving[np.clip(rows - j * spacing, 0, steps - 1)] for j in shifts]
        late = (rows - steps / 2) * T
        columns = [np.nan_to_num(z[part])]
        for before, now, after in zip(later, later[1:], later[2:], strict=False):
            x, y, u, v = now.T
            slope = (after - before) * late[:, None] / (2 * spacing * T)
            columns += [now[:, :m]] + [
                np.column_stack(turned)[:, :m]
                for turned in ((-y, x, -v, u), (x, -y, u, -v), (y, x, v, u))
            ]
            columns.append(slope[:, :m])
        unknown = (_start_and_bias if filtered else _offset)(model, len(rows))
        both = np.concatenate([np.stack(columns, axis=2), unknown], axis=2)
        if filtered:
            white = _through_filter(model, both, there, np.zeros_like(model.A))
        else:
            R = np.broadcast_to(model.measurement_covariance, (len(rows), m, m))
            white = _whitened(_present(R, there), np.where(there[:, :, None], both, 0.0))
        found.add(white[there], len(columns))
    return found


def _begins(steps: int) -> list[int]:
    """Return where the stretches begin that are compared: all, or as many as are enough."""
    every = np.arange(0, steps, _WINDOW)
    if len(every) <= _MOST:
        return [int(x) for x in every]
    return [int(x) for x in np.linspace(0, steps - _WINDOW, _MOST)]


def _filled(source: Array) -> Array:
    """Return a source with the rows that it lacks on straight lines between the others."""
    rows = np.arange(len(source))
    known = ~np.isnan(source).any(axis=1)
    return np.column_stack([np.interp(rows, rows[known], x[known]) for x in source.T])


def _start_and_bias(model: ErrorModel, steps: int) -> Array:
    """Return what each component of an error at the start, and a bias along x and y, measure."""
    n, T = len(model.A), model.period
    states, push = np.eye(n, n + 2), np.zeros((n, n + 2))
    push[:4, n:] = np.vstack([np.eye(2) * T**2 / 2, np.eye(2) * T])
    made = np.empty((steps, len(model.C), n + 2))
    for k in range(steps):
        made[k] = model.C @ states
        states = model.A @ states + push
    return made


def _offset(model: ErrorModel, steps: int) -> Array:
    m = len(model.C)
    return np.broadcast_to(np.eye(m, 2), (steps, m, 2))


def _judged(subject: str, found: Comparison) -> Iterator[Finding]:
    """Return whether a lag and a turn fit better than none, and which."""
    moved = found.gram[0, 0] / max(1, found.freedom)
    if found.freedom < _FEWEST or moved < _MOVED:
        says = (
            "too few fixes" if found.freedom < _FEWEST else "too little moves for the data to tell"
        )
        for name in ("time", "frame"):
            yield Finding(name, subject, np.nan, np.nan, np.nan, None, says)
        return
    nothing, variance, tries = found.explanations()
    far = float(norm.isf(FALSE_ALARM / (2 * _KINDS)))
    gains = {fit: (nothing - fit.left) / variance for fit in tries}
    bounds = {
        fit: fit.parameters * float(f.isf(FALSE_ALARM / _KINDS, fit.parameters, found.freedom))
        for fit in tries
    }
    wrong = [fit for fit in tries if gains[fit] > bounds[fit]]
    price = 3 * float(np.log(found.freedom))  # of a parameter
    best = min(wrong, key=lambda fit: fit.left / variance + price * fit.parameters, default=None)
    kind = best.name if best is not None else ""
    low, high = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], found.freedom) / found.freedom
    off = abs(best.left - found.freedom) if best is not None else 0.0
    if best is not None and kind == "scale":  # which stretches the noise of the network as well
        low, high = low * min(1, best.value**2), high * max(1, best.value**2)
    if best is not None and not (
        low <= best.left / found.freedom <= high or off <= _REST * (nothing - found.freedom)
    ):
        # it is better, but not right: a sign of something else
        best = best._replace(name="misfit", says=f"{best.says}, but this does not explain all")
    if best is not None and best.left > _OTHER * found.freedom:
        says = "they do not go together, with any lag, turn or scale"
        best = best._replace(name="run", value=best.left / found.freedom, says=says)
    time, turn = tries[0], tries[2]
    bounds_of = far * time.deviation, float(np.degrees(min(far * turn.deviation, 3.0)))
    for simple, bound, limit in zip((time, turn), bounds_of, (_LAG, _TURN), strict=True):
        if best is not None and (kind == "time") == (simple is time):
            yield Finding(best.name, subject, best.value, -bound, bound, False, best.says)
        elif bound > limit:
            says = "too little changes for the data to tell"
            yield Finding(simple.name, subject, simple.value, -bound, bound, None, says)
        else:
            says = simple.says if best is None else "another explanation fits better"
            yield Finding(simple.name, subject, simple.value, -bound, bound, True, says)
