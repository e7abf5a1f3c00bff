"""Whether a recording and the figures of a filter fit one another, and what misfits point to.

Each check compares one number with a bound that a recording which fits exceeds by chance once in a
thousand times, or less often. A mistake that the data cannot show, as a late network while nothing
moves, is told to be one. It needs numpy alone: the page on your own data calls it in a browser.
"""

from __future__ import annotations

from collections.abc import Iterator
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from mpmath import betainc
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.checks import Array, covariance, positive_definite
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.evaluation.consistency import chi_square, independent_count, mean_square
from inswsn_lib.logs.filter_checks import FilterRun, check_filter
from inswsn_lib.logs.findings import FALSE_ALARM, Finding, judged, unknown
from inswsn_lib.logs.ins_wsn import TrackPair
from inswsn_lib.logs.set_up_checks import longest_run
from inswsn_lib.models import ErrorModel

Complex = NDArray[np.complex128]

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
_UNITS = {
    "feet": 3.2808, "cm": 100.0, "mm": 1000.0, "km/h": 3.6, "knots": 1.9438, "yards": 1.0936,
    "miles": 1.6093,
}  # fmt: skip
_NEAR = 0.03  # of a unit, in scale
_SPACING = 0.1  # s, of the lags at which a search begins
_MOST = 10_000  # rows that are compared; of more, some at even distances
#: Explanations: whether turned or mirrored, and how many numbers the time has, a lag and a gain
_KINDS = (("", 1), ("", 2), ("turned", 0), ("mirrored", 0), ("turned", 1), ("mirrored", 1))


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


def _rate(data: TrackPair) -> Finding:
    """Look for a second rate: a long run of equal intervals that are not those of the grid."""
    rows = np.flatnonzero(~np.isnan(data.ins[:, 0]))
    steps = np.diff(rows)
    same, first = longest_run((np.diff(steps) == 0) & (steps[1:] > 1))
    longest, step = same + bool((steps > 1).any()), int(steps[first]) if len(steps) else 1
    # rows that are lost at random leave an interval of two steps with a probability below 1/4
    bound = float(np.ceil(np.log(len(rows) / FALSE_ALARM) / np.log(4)))
    says = (
        f"{longest + 1} rows follow one another in {step * data.period:.3g} s, others in "
        f"{data.period:.3g} s: two rates in one file"
    )
    return judged("rate", "rows", longest, 0, bound, "intervals between rows are even", says)


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
        most = _most_of(there.size * chance, FALSE_ALARM / 4) + 1
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
        says = (
            f"in {count} rows positions do not move as velocities say: stuck, set back, in other "
            "axes, late, or held"
        )
        yield judged("itself", subject, count, 0, 2.0, "positions follow velocities", says)


def _innovations(data: TrackPair, model: ErrorModel, P0: Array) -> Iterator[Finding]:
    run = FilterRun.of(model, data.measurements[:, : len(model.C), 0], P0)
    counts = np.isfinite(run.innovations).sum(axis=1)
    fixes = np.flatnonzero(counts)
    squares, counts = run.nis[fixes], counts[fixes]
    # what stands out does so beside the others, however large they are
    scale = max(1.0, float(np.median(squares / _chi_squares(0.5, counts))))
    value, bound = float(squares[0]) / scale, chi_square(1 - FALSE_ALARM, int(counts[0]))
    says = (
        f"the first fix is {np.sqrt(value / counts[0]):.1f} times as far as the initial errors "
        "say: they are too small, or the network has another origin"
    )
    right = "the first fix is as near as the initial errors say"
    yield judged("start", "first fix", value, 0, bound, right, says)
    far = squares[1:] / scale / _chi_squares(1 - FALSE_ALARM / len(fixes), counts[1:])
    count = int(np.sum(far > 1))
    at = data.time[fixes[1:]][np.argmax(far)] if len(far) else np.nan
    says = f"{count} fixes stand out, most that at {at:.6g} s: wrong fixes, a jump"
    yield judged("outliers", "fixes", count, 0, 0, "none stands out", says)
    yield from check_filter(run.innovations, run.design.innovation)


def _chi_squares(level: float, degrees: NDArray[np.int64]) -> Array:
    return np.array([chi_square(level, each) for each in degrees.tolist()])


def _against_reference(data: TrackPair, model: ErrorModel, *, sized: bool) -> Iterator[Finding]:
    """Compare the network with the reference; `sized` tells that innovations are as assumed."""
    who, m, reference = "network and reference", len(model.C), data.reference
    if reference is None or np.isfinite(data.wsn - reference).sum() < _FEWEST:
        says = "there is no reference to tell by" if reference is None else "too few fixes"
        yield from (unknown(name, who, says) for name in ("time", "frame"))
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
    bound = -NormalDist().inv_cdf(FALSE_ALARM / 4)
    says = f"they are ({shift[0]:.3g}, {shift[1]:.3g}) m apart on average: another origin"
    yield judged("origin", who, z, 0, bound, "network and reference have one origin", says)
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
        if gain > best.parameters * _f_bound(level, best.parameters, rest):
            wrong = best
    far = -NormalDist().inv_cdf(FALSE_ALARM / (2 * _TRIED)) * float(np.sqrt(variance / share))
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


class Explanation(NamedTuple):
    """How one track follows another, by how many parameters, and what that means.

    What is left is (rows, 2 or 4), over the noise; `value` is in s, degrees, or a quotient. `rival`
    is the sum of squares that nothing leaves or, if less, what the opposite lag leaves: between two
    rows the noise of the other track is averaged, which is no lag.
    """

    name: str
    parameters: int
    left: Array
    value: float
    says: str
    rival: float

    @property
    def squares(self) -> float:
        """The sum of squares that it leaves."""
        return _squares(self.left)


class Alignment:
    """A track (n, 2 or 4) of known noise, to be explained by another (n, 4) of unknown origin.

    Positions and velocities are complex numbers, z = x + iy. Turned and stretched, the other is
    a z; mirrored it is a z*. The track may be late or early by a reach (s).
    """

    def __init__(self, time: Array, track: Array, other: Array, sigma: Array, reach: float) -> None:
        known = ~np.isnan(other).any(axis=1)
        there = ~np.isnan(track).any(axis=1) & known
        there &= (time >= time[0] + reach) & (time <= time[-1] - reach)
        rows = np.flatnonzero(there)
        rows = rows[:: -(-len(rows) // _MOST) or 1]
        self._sigma = np.sqrt(np.mean(np.square(sigma).reshape(-1, 2), axis=1))
        self._known, self._other = time[known], _complex(other[known, : len(sigma)])
        self._time, self._middle, self._reach = time[rows], float(time.mean()), reach
        self._track = self._over_noise(_complex(track[rows]))
        #: How many values are compared
        self.values = max(1, 2 * self._track.size)

    def _over_noise(self, values: Complex) -> Complex:
        """Return values over the noise, with the mean position at zero."""
        origin = np.zeros(values.shape[1], dtype=complex)
        origin[0] = values[:, 0].mean() if len(values) else 0.0
        return np.asarray((values - origin) / self._sigma)

    def _moved(self, lag: float, gain: float = 0.0) -> Complex:
        """Return the other track as it is told so much later, by a clock that loses."""
        at = self._time - lag - gain * (self._time - self._middle)
        return np.column_stack([np.interp(at, self._known, z) for z in self._other.T])

    def _fit(self, kind: str, *late: float) -> tuple[complex, Array]:
        """Return the factor, and what is left over the noise."""
        moved = self._over_noise(self._moved(*late or (0.0,)))
        moved = moved.conj() if kind == "mirrored" else moved
        size = float(np.sum(np.abs(moved) ** 2))
        factor = complex(np.vdot(moved, self._track) / size) if kind and size else 1.0 + 0.0j
        return factor, (self._track - factor * moved).view(float)

    def _searched(self, kind: str, count: int) -> Array:
        """Return the lag, or it and the gain, that leave least."""

        def squares(late: Array) -> float:
            outside = max(0.0, abs(float(late[0])) - self._reach)
            return _squares(self._fit(kind, *late)[1]) * (1 + outside) + outside

        lags = np.linspace(-self._reach, self._reach, 2 * max(1, round(self._reach / _SPACING)) + 1)
        begin = min(([float(lag), 0.0][:count] for lag in lags), key=lambda x: squares(np.array(x)))
        late, steps = np.array(begin), np.diag([_SPACING, 0.01])[:count, :count]
        least, worst = squares(late), np.inf
        # to a step either way along each axis, or half as far, until that changes next to nothing
        while steps[0, 0] > 1e-9 and (steps[0, 0] > 1e-4 or worst > least + 1e-2):
            tried = [late + step for step in (*steps, *-steps)]
            sizes = [squares(each) for each in tried]
            worst = max(sizes)
            if min(sizes) < least:
                late, least = tried[int(np.argmin(sizes))], min(sizes)
            else:
                steps = steps / 2
        return late

    def explanations(self) -> list[Explanation]:
        """Return the explanations, first that of a lag alone."""
        found = []
        nothing = _squares(self._fit("")[1])
        for kind, count in _KINDS:
            late = self._searched(kind, count) if count else np.empty(0)
            factor, left = self._fit(kind, *late)
            name, value, says = _turned(kind, factor)
            rival = nothing
            if count:
                how = f"it is {abs(late[0]):.3g} s {'late' if late[0] > 0 else 'early'}"
                name, says = (f"{name} and time", f"{says}; {how}") if kind else ("time", how)
                value = value if kind else float(late[0])
                rival = min(nothing, _squares(self._fit(kind, *-late)[1]))
            if count == 2:
                name, value = "clock", float(late[1])
                says = f"its clock loses {value:.2%}, and half way {says}"
            found.append(Explanation(name, count + 2 * bool(kind), left, value, says, rival))
        return found

    def deviations(self) -> tuple[float, float]:
        """Return the deviations of a lag, s, and of a turn, rad, by the noise."""
        h = _SPACING / 2
        changes = (self._moved(h) - self._moved(-h)) / (2 * h), self._moved(0.0)
        sizes = (float(np.sum(np.abs(self._over_noise(each)) ** 2)) for each in changes)
        lag, turn = (size**-0.5 if size > 0 else np.inf for size in sizes)
        return lag, turn


def _f_bound(level: float, above: float, below: float) -> float:
    """Return what a variable with the distribution F exceeds by chance that often, by halving."""
    low, high = 0.0, 1.0
    while low < (u := (low + high) / 2) < high:
        rarer = betainc(below / 2, above / 2, 0, u, regularized=True) < level
        low, high = (u, high) if rarer else (low, u)
    return float(below * (1 - u) / (above * u))


def _most_of(mean: float, level: float) -> float:
    """Return the number that one with the distribution of Poisson exceeds by chance that often."""
    if mean <= 0:
        return 0.0
    k = np.arange(1.0, mean + 20 * np.sqrt(mean) + 40)
    below = np.cumsum(np.exp(np.append(0.0, np.cumsum(np.log(mean / k))) - mean))
    return float(np.argmax(below > 1 - level))


def _complex(track: Array) -> Complex:
    return np.asarray(track[:, ::2] + 1j * track[:, 1::2])


def _squares(left: Array) -> float:
    return float(np.sum(left**2))


def _turned(kind: str, factor: complex) -> tuple[str, float, str]:
    """Return the name, the value and the words of a factor."""
    scale, angle = abs(factor), float(np.angle(factor, deg=True))
    name, what = "frame", f"it is turned by {angle:.3g}°"
    if kind == "mirrored":
        named = {
            0: "y has the other sign", 90: "x and y are exchanged", -90: "x and y are exchanged, "
            "with other signs", 180: "x has the other sign", -180: "x has the other sign",
        }  # fmt: skip
        near = min(named, key=lambda each: abs(each - angle))
        also = f": {named[near]}" if abs(near - angle) < 15 else f", and turned by {angle:.3g}°"
        name, what = "axes", f"it is mirrored{also}"
    if abs(scale - 1) > 0.02:
        units = [u for u, size in _UNITS.items() if abs(abs(np.log(scale)) - np.log(size)) < _NEAR]
        size = f"{scale:.3g} times as large" + (f", as with {units[0]}" if units else "")
        if kind == "turned" and abs(np.radians(angle)) < max(0.05, abs(scale - 1) / 2):
            return "scale", scale, f"it is {size}"
        what += f", and {size}"
    return name, angle, what
