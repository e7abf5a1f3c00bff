"""What the page "Which filter?" says of a reader's own file: answers, a figure, and code.

The noise figures are fitted by the likelihood of the innovations, with numpy alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np

from inswsn_book.live.own_data import read
from inswsn_book.show.moving import Moving, Slider
from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation.consistency import log_likelihoods
from inswsn_lib.evaluation.tuning import Tuning, search_pattern, tune
from inswsn_lib.logs.filter_checks import FilterRun, check_filter, say_noise, usual_spacing
from inswsn_lib.logs.ins_wsn import TrackPair
from inswsn_lib.models import ErrorModel

_MOST, _FEWEST, _SETTLED = 600, 60, 5  # fixes that are fitted, and the first that do not count
_HOLDS = np.geomspace(2, 2000, 13)  # intervals of fixes for which the INS holds their accuracy
_LASTS, _SHARE, _WHITE = 5.0, 0.02, 0.5  # intervals that errors last; the share that does not
_RATIOS, _TRIALS = (3.0, 10.0, _HOLDS[1] / _HOLDS[0]), 60
_BETTER, _ALIKE = 10.0, 2.0  # by how much a logarithm of a likelihood tells, and does not
_KNOWN, _HELPLESS = 10.0, 0.9  # a factor of deviations, and what is next to no gain
_FACTORS = (0.001, 0.01, 0.1, 1.0, 10.0, 100.0, 1000.0)  # of Q


@dataclass(frozen=True)
class Fit:
    """Noise figures of a recording, along an axis: what they are, and how likely.

    `noise` are deviations of position (m) and velocity (m/s) of fixes, of which the share `white`
    is white and the rest lasts `lasts` s; `holds` s long the INS holds the accuracy of a fix.
    `settled` tells whether the search for them has, as of `Tuning`.
    """

    period: float
    holds: float
    lasts: float
    white: float
    noise: Array
    settled: bool = False

    def acceleration(self, period: float) -> float:
        """Return the deviation of the INS's acceleration error, if white by such periods, m/s²."""
        return float(np.sqrt(3 * self.noise[0] ** 2 / self.holds**3 / period))

    def model(self, factor: float = 1.0) -> ErrorModel:
        """Return the model of an axis, with the drift's variance times a factor."""
        step = self.acceleration(self.period) * self.period * np.sqrt(factor)
        model = ErrorModel(
            A=np.array([[1, self.period], [0, 1]]), B=np.diag([step * self.period / 2, step]),
            C=np.eye(2)[: len(self.noise)], D=np.diag(self.noise), period=self.period,
        )  # fmt: skip
        return model.with_coloured_noise(self.lasts, self.white) if self.lasts else model

    def run(self, y: Array, factor: float = 1.0) -> FilterRun:
        """Run its filter over INS less network, (steps, components, axes)."""
        lasting = (1 - self.white) * self.noise**2 if self.lasts else np.zeros(0)
        far = 1e4 * self.noise[0] ** 2 * np.array([1, 1 / self.period**2])
        return FilterRun.of(self.model(factor), y, np.diag(np.append(far, lasting)))


def _told(run: FilterRun, rows: slice = slice(_SETTLED, None)) -> tuple[float, float]:
    """Return the mean NIS of a component, and how likely steps are, all variances times it."""
    left, S = run.innovations[rows], run.design.innovation[rows]
    nis = float(np.nansum(run.nis[rows]) / np.isfinite(left).sum())
    return nis, float(np.nansum(log_likelihoods(left, nis * S)))


def measured(data: TrackPair) -> tuple[Array, float, slice]:
    """Return INS less network at fixes (fixes, components, axes), their interval, and the rows."""
    there = np.asarray(np.isfinite(data.wsn[:, :2]).all(axis=1))
    usual = usual_spacing(there)
    rows = slice(int(np.argmax(there)), None, usual)
    y = (data.ins - data.wsn)[rows].reshape(-1, 2, 2)
    y = y if np.isfinite(y[:, 1]).any() else y[:, :1]
    y = np.where(np.isfinite(y).all(axis=(1, 2), keepdims=True), y, np.nan)
    if np.isfinite(y[:_MOST, 0, 0]).sum() < _FEWEST:
        raise InswsnError(f"Fewer than {_FEWEST} fixes are too few to tell a filter by.")
    return y[:_MOST], usual * data.period, rows


def fit(y: Array, period: float) -> tuple[Fit, list[tuple[float, float]]]:
    """Return the likeliest figures, and between which hold times are about as likely.

    Of all that is fitted, and of each of its halves.
    """
    apart = np.diff(y, 2, axis=0)
    noise = np.maximum(np.sqrt(np.nanmean(apart**2, axis=(0, 2)) / 6), 1e-9)
    there, holds = np.flatnonzero(np.isfinite(y[:, 0, 0])), (_HOLDS * period).tolist()
    half = int(there[len(there) // 2])
    parts = slice(_SETTLED, None), slice(_SETTLED, half), slice(half, None)

    @cache
    def run(lasts: float, white: float, hold: float) -> FilterRun:
        return Fit(period, hold, lasts, white, noise).run(y)

    def loss(part: slice, *figures: float) -> float:
        return -_told(run(*figures), part)[1] if figures[1] < _WHITE or not figures[0] else np.inf

    def by_holds(*errors: float) -> list[Tuning[float]]:
        return [tune("hold time", holds, partial(loss, part, *errors)) for part in parts]

    def along(lasts: float, white: float, hold: float) -> tuple[float, float, float]:
        """Return figures: white errors and drift stay, as densities, while `lasts` changes."""
        return lasts, white * start[0] / lasts, hold * (lasts / start[0]) ** (1 / 3)

    found, errors = by_holds(0.0, 1.0), (0.0, 1.0)
    start = _LASTS * period, _SHARE, found[0].best
    lasting = search_pattern(
        "lasting", start, _RATIOS, lambda *x: loss(parts[0], *along(*x)), _TRIALS
    )
    if found[0].loss - lasting.loss > _BETTER:
        errors = along(*lasting.best)[:2]
        found = by_holds(*errors)
    alike = []
    for each in found:
        near = [x for x, y in zip(holds, each.losses, strict=True) if y < each.loss + _ALIKE]
        alike.append((near[0], near[-1]))
    # a drift too small to be seen: the largest that is as likely
    hold = found[0].best if alike[0][1] < holds[-1] else alike[0][0]
    settled, nis = lasting.settled and hold > holds[0], _told(run(*errors, hold))[0]
    return Fit(period, hold, *errors, noise * nis**0.5, settled), alike


def decide(text: str, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page shows of a recording: answers, a figure, and code with its numbers.

    Parameters
    ----------
    text, options
        As `examine` takes them, which says what is refused; of the options the ``name`` alone.

    Examples
    --------
    >>> from inswsn_book.live.which_page import decide
    >>> from inswsn_lib.files import data_file
    >>> found = decide(data_file("examples/ins-wsn.csv").read_text(), {"name": "my.csv"})
    >>> found["sentences"][-1]
    'Take the Kalman filter; the code below has your numbers.'
    """
    name = str(options.get("name", "my-recording.csv"))
    data = read(name, text)
    y, period, rows = measured(data)
    found, (alike, *halves) = fit(y, period)
    run = found.run(y)
    at = np.flatnonzero(np.isfinite(y[:, 0, 0]))[-1]  # a fix: no gap at the end
    kept = np.sqrt(run.design.filtered[at].diagonal()[: len(found.noise)]) / found.noise
    # deviations of the drift go with the hold time to the power of 3/2
    wide = max((alike[1] / alike[0]) ** 0.75, (_HOLDS[1] / _HOLDS[0]) ** 0.75)
    unlike = (max(low for low, _ in halves) / min(high for _, high in halves)) ** 1.5
    chosen = "kalman" if not found.lasts else "none" if kept[0] > _HELPLESS else "lasting"
    chosen = "worst" if unlike > _KNOWN else chosen
    S: Array = np.kron(run.design.innovation, np.eye(2)).astype(float)
    checks = check_filter(run.innovations.reshape(len(y), -1), S)
    sentences = [
        *_answers(data, found, wide, unlike, kept),
        f"Does that fit? Of the noise figures: {say_noise(checks)}. The search for them "
        f"{'settled' if found.settled else 'did not settle: they may be far off'}.",
        f"Take {TAKEN[chosen]}; the code below has your numbers.",
    ]
    figure, code = _figure(name, data, found, y, rows).content(), _code(name, data, found, chosen)
    return {"name": name, "sentences": sentences, "figure": figure, "tables": [], "code": code}


TAKEN = {
    "kalman": "the Kalman filter",
    "lasting": "the Kalman filter with states for errors that last",
    "none": "the Kalman filter with states for errors that last, for the velocity; in position no "
    "filter helps much",
    "worst": "the H-infinity filter",
}


def _answers(data: TrackPair, found: Fit, wide: float, unlike: float, kept: Array) -> Iterator[str]:
    """Answer the questions of the page, as they are numbered there."""
    apart = f"no, the halves of the file have drifts that differ by a factor of {unlike:.0f}"
    known = apart if unlike > _KNOWN else "yes"
    scatter = " and ".join(f"{x:.3g} {m}" for x, m in zip(found.noise, ("m", "m/s"), strict=False))
    yield (
        f"1. Drift and noise are known: {known}. Fixes scatter by {scatter}; the error of the INS's"
        f" acceleration is {found.acceleration(data.period):.2g} m/s², to a factor of {wide:.1f}."
    )
    long = "yes" if found.lasts and kept[0] > _HELPLESS else "no"
    yield (
        f"2. Errors outlast the INS: {long}. The INS holds the accuracy of a fix for "
        f"{found.holds:.2g} s; a filter that knows all this should leave {kept[0]:.0%} of the "
        "error of a fix in position"
        + (f" and {kept[1]:.0%} in velocity." if len(kept) > 1 else ".")
    )
    says = "there is no sign that they last"
    if found.lasts:
        says = f"no. {1 - found.white:.0%} of their variance lasts about {found.lasts:.2g} s"
    yield f"3. Errors of fixes are independent: {says}."
    longest = max((j - i for i, j in data.outages), default=0) * data.period
    far = "yes" if longest > found.holds else "no"
    yield f"4. Fixes stop for longer than the INS holds: {far}. The longest gap is {longest:.3g} s."
    yield "5 and 6. Of other networks and of wheels a file with one network tells nothing."


def _figure(name: str, data: TrackPair, found: Fit, y: Array, rows: slice) -> Moving:
    """Return both ways of being wrong about Q: what a filter leaves, by the Q that it assumes."""
    told, sizes = {}, {}
    for factor in _FACTORS:
        run = found.run(y, factor)
        error, told[factor] = run.innovations[_SETTLED:, 0], _told(run)[0]
        if data.reference is not None:
            true = (data.ins - data.reference)[rows].reshape(-1, 2, 2)[: len(y)]
            error = (run.states[:, :2] - true)[_SETTLED:, 0]
        sizes[factor] = float(np.sqrt(2 * np.nanmean(error**2)))
    what = "position" if data.reference is not None else "the next fix, as predicted"
    what, top = f"RMS error of {what}", 1.1 * min(max(sizes.values()), 5 * sizes[1.0])
    label = "assumed Q over the fitted one"
    shown = Moving(f"What {name} answers", Slider("q", label, _FACTORS, 1.0))
    axes = {"x": f"{label} (power of ten)", "y": "m", "xlim": (-3, 3)}
    chart = shown.chart(f"Both ways of being wrong about Q: {what}", ylim=(0, top), **axes)
    reached = np.minimum([*sizes.values()], top)
    shown.draw(chart, "kalman", "", (np.log10(_FACTORS), reached))
    shown.draw(chart, "published", "", lambda q: ([np.log10(q)] * 2, [0.0, top]))
    shown.sentence(lambda q: (
        f"With {q:g} times the fitted Q: {what} {sizes[q]:.3g} m, mean NIS {told[q]:.2f}, which "
        "should be 1."
    ))  # fmt: skip
    shown.number("kalman", what, lambda q: f"{sizes[q]:.3g} m")
    shown.number("published", "mean NIS (1 if it fits)", lambda q: f"{told[q]:.2f}")
    return shown


def _code(name: str, data: TrackPair, found: Fit, chosen: str) -> str:
    """Return lines that run the filter on the file, with the numbers that were found."""
    size = [f"{each:.3g}" for each in found.noise]
    position, velocity = size if len(size) > 1 else [*size, "1.0"]
    lines = [
        "from pathlib import Path", "import numpy as np", "import inswsn_lib as iw", "",
        f"data = iw.read_recording(Path({name!r}), resample=True)",
        f"T, a = data.period, {found.acceleration(data.period):.3g}  # s, m/s^2",
        "model = iw.ErrorModel.p1(", "    T, process_noise=(a * T**2 / 2, a * T),",
        f"    measurement_noise=({position}, {velocity})", ")",
        "y = data.ins - data.wsn  # NaN where there is no fix",
    ]  # fmt: skip
    if chosen == "worst":
        lines += ["first = y[np.isfinite(y).all(axis=1)][0]", "design = iw.design_filter(model)"]
        lines += ["error = iw.run_hinfinity(design, y, initial_state=first)"]
    else:
        lines += ["P0 = [1e4, 1e4, 1e2, 1e2]"]
        if found.lasts:
            lines += [
                f"R = np.repeat([{position}, {velocity}], 2) ** 2",
                f"model = model.with_coloured_noise({found.lasts:.3g}, white={found.white:g})",
                f"P0 = [*P0, *({1 - found.white:g} * R)]",
            ]
        lines += ["error = iw.run_kalman(model, y, initial_covariance=np.diag(P0))[:, :4]"]
    return "\n".join([*lines, 'np.savetxt("corrected.csv", data.ins - error, delimiter=",")', ""])
