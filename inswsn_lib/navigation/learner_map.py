"""Which method has the least error: by the drift, the length of the outage, and the input.

The methods are those of `BridgedOutages`, the drifts those of `draw_drift`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from inswsn_lib.checks import Array, array, number, one_of, whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.navigation.bridged_outages import COASTING, Bridge, BridgedOutages, Passage
from inswsn_lib.navigation.hybrid import observable_inputs
from inswsn_lib.navigation.training_areas import noise_sizes
from inswsn_lib.simulation import DRIFTS, draw_drift, draw_motion

#: What the learners are fed with
INPUTS = ("time", "motion", "inertial")
#: No correction at all
ALONE = "INS alone"
#: A lead of less than this share of the error of the INS is none, %
LEAD = 1.0
#: The methods that have no input, and the learners
FREE = ("mean of the last fixes", "line in time", "parabola in time", COASTING)
LEARNERS = ("LS-SVM", "LS-SVM, linear kernel", "BP", "Gaussian process")


class Choice(NamedTuple):
    """The settings of a method that were chosen, and what came of them.

    Attributes
    ----------
    settings : ndarray, (drifts, lengths)
        Their places in the list of settings.
    errors : ndarray, (drifts, lengths, runs)
        m.
    """

    settings: NDArray[np.intp]
    errors: Array


@dataclass(frozen=True, eq=False)
class LearnerMap:
    r"""Methods of `BridgedOutages` over shapes of drift, lengths of outage, and inputs.

    The network is heard for 100 samples, with white noise. For each drift, length and input each
    method chooses one of its twelve settings by *rehearsal* in other runs of the same drift: the
    network is heard throughout, and an outage of that length is pretended. An error is the mean of
    :math:`|e|` over the samples of an outage and both positions, m.

    Attributes
    ----------
    outages : BridgedOutages
        What the methods, their settings, the noise and the seed are taken from.
    runs, tuning_runs : int
        Runs, two or more, that are judged, and others in which methods are tuned.
    drifts : tuple of str
        Some of `DRIFTS`.
    lengths : tuple of float
        Of the outages, s, increasing.
    noise : tuple of two floats, optional
        Standard deviations of the network in position and velocity, m and m/s. Default: those of
        the scene's first area.

    Raises
    ------
    ParameterError
        If a drift is unknown, or a number is too small or out of order.

    Examples
    --------
    A line meets a drift that is one, if there is no noise:

    >>> from inswsn_lib.navigation import LearnerMap
    >>> steady = LearnerMap(runs=3, drifts=("steady",), lengths=(2.0,), noise=(0.0, 0.0))
    >>> bool(steady.judge(steady.methods["line in time", "none"]).errors.max() < 1e-9)
    True
    """

    outages: BridgedOutages = field(default_factory=BridgedOutages)
    runs: int = 48
    tuning_runs: int = 8
    drifts: tuple[str, ...] = DRIFTS
    lengths: tuple[float, ...] = (2.0, 5.0, 10.0, 20.0, 40.0)
    noise: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        whole("runs", self.runs, 2)
        whole("tuning_runs", self.tuning_runs, 1)
        for drift in self.drifts:
            one_of("drifts", drift, DRIFTS)
        for length in self.lengths:
            number("lengths", length, least=self.period)
        if not self.lengths or list(self.lengths) != sorted(self.lengths):
            raise ParameterError("lengths", self.lengths, "one or more increasing numbers")

    @property
    def period(self) -> float:
        """Between samples, s."""
        return self.outages.scene.windows["area1"].period

    @property
    def heard(self) -> int:
        """Samples before an outage."""
        return self.outages.scene.training_samples

    def draw(self, runs: int, stream: int) -> tuple[Passage, Array]:
        """Return all drifts, one after the other on the last axis, and what the network measures.

        It measures in the outage, too, of which the passage knows nothing: (steps, 4, drifts *
        runs), m and m/s.
        """
        sizes = self.noise or noise_sizes(self.outages.noise["1"].measurement)
        steps = self.heard + round(self.lengths[-1] / self.period)
        time = np.asarray(self.period * (np.arange(steps) - self.heard), dtype=float)
        drawn = []
        for drift in self.drifts:
            place = [self.outages.seed, 8, stream, DRIFTS.index(drift)]
            ways, of_ins, of_network = np.random.default_rng(place).spawn(3)
            motion = draw_motion(drift, time, ways, runs)
            noise = np.repeat(sizes, 2)[:, None] * of_network.standard_normal(motion.shape)
            drawn.append((motion, draw_drift(drift, time, motion, of_ins), noise))
        motion, error, noise = (np.concatenate(x, axis=2) for x in zip(*drawn, strict=True))
        y = error - noise
        y[self.heard :] = np.nan
        inputs = observable_inputs(time, motion + error) | {"state": None}
        return Passage("1", self.heard, error, y, inputs, time), error - noise

    @cached_property
    def judged(self) -> Passage:
        """The runs that are judged."""
        return self.draw(self.runs, 0)[0]

    @cached_property
    def rehearsed(self) -> Passage:
        """Those in which methods are tuned: what is measured stands in the place of the error."""
        passage, measured = self.draw(self.tuning_runs, 1)
        return replace(passage, error=measured)

    @cached_property
    def methods(self) -> dict[tuple[str, str], list[Bridge]]:
        """The settings that are tried, by method and input; ``"none"`` for those of `FREE`.

        Fits of the last fixes have twice the numbers of fixes of `BridgedOutages`, whose
        rehearsals are half as long.
        """
        found = {
            (name, "none" if name in FREE else kind): bridges
            for (name, kind), bridges in self.outages.methods(INPUTS).items()
            if name in FREE + LEARNERS
        }
        for name, (regressor, lasts) in self.outages.fits.items():
            found[name, "none"] = [
                partial(self.outages.bridge, regressor=regressor, kind="time", window=n, least=1)
                for n in (2 * last for last in lasts)
            ]
        return found

    def means(self, left: Array) -> Array:
        """Return mean absolute values, (drifts, lengths, runs), of the errors in an outage."""
        size = np.abs(left[:, :2]).mean(axis=1)
        upto = np.cumsum(size, axis=0) / np.arange(1, len(size) + 1)[:, None]
        ends = [round(length / self.period) - 1 for length in self.lengths]
        return np.moveaxis(upto[ends].reshape(len(ends), len(self.drifts), -1), 1, 0)

    def judge(self, bridges: list[Bridge]) -> Choice:
        """Choose among the settings of a method by rehearsal, and judge the choices."""
        tried = [self.means(bridge(self.rehearsed)).mean(axis=2) for bridge in bridges]
        chosen, passage = np.argmin(tried, axis=0), self.judged
        errors = np.empty((*chosen.shape, self.runs))
        for setting in np.unique(chosen):
            wanted = chosen == setting
            of = np.repeat(wanted.any(axis=1), self.runs)  # one setting serves some drifts
            inputs = {n: None if u is None else u[..., of] for n, u in passage.inputs.items()}
            some = replace(
                passage, error=passage.error[..., of], y=passage.y[..., of], inputs=inputs
            )
            left = np.zeros_like(passage.error[self.heard :])
            left[..., of] = bridges[setting](some)
            errors[wanted] = self.means(left)[wanted]
        return Choice(chosen, errors)

    @cached_property
    def compared(self) -> dict[tuple[str, str], Array]:
        """Errors of every method on every input, and of the INS alone, (drifts, lengths, runs)."""
        found = {key: self.judge(bridges).errors for key, bridges in self.methods.items()}
        return found | {(ALONE, "none"): self.means(self.judged.error[self.heard :])}

    def table(self, runs: slice = slice(None)) -> pd.DataFrame:
        """Return the scores of some runs, one row for each input, drift, length and method.

        The columns ``left``, ``low`` and ``high`` are the mean error over that of the INS alone
        and its interval, %; see `share`. ``beaten`` says whether the method with the least mean
        is ahead of this one beyond the interval of the differences, run by run, and by `LEAD` or
        more. Methods without an input stand under each.
        """
        rows = []
        for kind in INPUTS:
            here = {name: e for (name, k), e in self.compared.items() if k in (kind, "none")}
            for i, j in np.ndindex(len(self.drifts), len(self.lengths)):
                errors = {name: e[i, j, runs] for name, e in here.items()}
                best = min(errors.values(), key=lambda e: float(e.mean()))
                for name, e in errors.items():
                    left, within = share(e, errors[ALONE])
                    behind, unsure = share(e - best, errors[ALONE])
                    row = (kind, self.drifts[i], self.lengths[j], name, left)
                    rows.append((*row, left - within, left + within, behind > max(unsure, LEAD)))
        names = ["input", "drift", "length", "method", "left", "low", "high", "beaten"]
        return pd.DataFrame(rows, columns=names)


def share(values: ArrayLike, wholes: ArrayLike) -> tuple[float, float]:
    r"""Return the mean of some values over that of others, and half its 95 % interval, in %.

    It is :math:`t\, s / (\bar w \sqrt n)` with s the deviation of :math:`v_i - w_i \bar v / \bar w`
    (Cochran 1977, Section 2.11) and t the quantile of Student's t with n - 1 degrees.
    On the map, 40 times 48 runs, four methods, it covered 94 % of the time.

    Parameters
    ----------
    values, wholes : array_like, (runs,)
        Run by run.

    Examples
    --------
    >>> from inswsn_lib.navigation.learner_map import share
    >>> share([1.0, 2.0, 3.0], [2.0, 4.0, 6.0])
    (50.0, 0.0)
    """
    v = array("values", values, ("runs",))
    w = array("wholes", wholes, v.shape)
    ratio = v.mean() / w.mean()
    deviation = np.std(v - ratio * w, ddof=1)
    within = student.ppf(0.975, len(v) - 1) * deviation / (w.mean() * np.sqrt(len(v)))
    return float(100 * ratio), float(100 * within)
