"""Methods judged on the same runs, and hypotheses judged on printed cells."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, array, whole
from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation.clusters import cluster_mean
from inswsn_lib.evaluation.metrics import spread
from inswsn_lib.extras import need

if TYPE_CHECKING:
    import pandas as pd

#: A cell is explained if the rebuilt one is within this share of it.
WITHIN = 0.1


class Lead(NamedTuple):
    """By how much one method is below another, and the half-width of its 95 % interval, in %."""

    percent: float
    within: float


class Leader(NamedTuple):
    """The method with the least mean, that mean, the next method if any, and the lead over it."""

    best: str
    error: float
    next: str | None
    lead: Lead


_LEVEL = 0.05  # margin of equivalence of two errors


class Finding(NamedTuple):
    """A number that scores amount to, the ends of its 95 % interval, its unit, and what it is.

    Examples
    --------
    >>> from inswsn_lib.evaluation import Finding
    >>> Finding(49.0, 48.0, 50.0, "%", "One error over another.").kind
    'confidence 95 %'
    """

    value: float
    low: float
    high: float
    unit: str
    how: str
    kind: Literal["confidence 95 %", "runs 95 %"] = "confidence 95 %"

    @classmethod
    def of_runs(cls, values: ArrayLike, unit: str, how: str) -> Finding:
        """Return the median of some runs, with the ends between which one more is by 95 %.

        Values are (runs,), or (1 + draws, runs) of a method whose tuning was drawn, too: the median
        is that of the first row, the ends are those of all. They are quantiles at k / (n + 1) of n
        values; at (k - 1) / (n - 1), one more of 48 is between them by 90 %.
        """
        rows = np.atleast_2d(values)
        low, high = np.quantile(rows, [0.025, 0.975], method="weibull")
        return cls(float(np.median(rows[0])), float(low), float(high), unit, how, "runs 95 %")

    @property
    def is_level(self) -> bool:
        """Whether two methods are level, if this is the ratio of their errors.

        They are if the whole interval lies within 5 % of one, from 1/1.05 to 1.05: two one-sided
        tests of equivalence. An interval that merely holds one says that no difference was found.
        The least difference in error that the three papers print is 38 %, eight times the margin.
        """
        return 1 / (1 + _LEVEL) <= self.low <= self.high <= 1 + _LEVEL


def quotient(
    above: Sequence[ArrayLike],
    below: Sequence[ArrayLike],
    unit: str,
    how: str,
    *,
    resamples: int = 400,
) -> Finding:
    """Return the sum of the medians of some columns of runs over that of others, in 1 or %.

    The interval is that of 95 % of draws of as many runs with replacement, the same of all columns.

    Parameters
    ----------
    above, below : sequences of array_like, (runs,) or (1 + draws, runs)
        In one unit. With rows, the first gives the ratio, and each resample takes its runs of one.
    unit : {"1", "%"}
    how : str
        What it is, one sentence.
    resamples : int
        Draws.

    Examples
    --------
    What all runs have in common does not widen the interval:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import quotient
    >>> runs = np.arange(1.0, 102.0)
    >>> [round(x, 6) for x in quotient([runs / 2], [runs], "%", "Half of it.")[:3]]
    [50.0, 50.0, 50.0]
    """
    parts = [np.array([np.atleast_2d(c) for c in columns], float) for columns in (above, below)]
    rows, runs = parts[0].shape[1:]
    of_row = np.arange(resamples)[:, None] % rows
    drawn = np.random.default_rng(runs).integers(runs, size=(resamples, runs))
    sums = [
        (np.median(p[:, 0], axis=1).sum(), np.median(p[:, of_row, drawn], axis=2).sum(axis=0))
        for p in parts
    ]
    scale = 100.0 if unit == "%" else 1.0
    value, others = (float(scale * sums[0][0] / sums[1][0]), scale * sums[0][1] / sums[1][1])
    low, high = np.quantile(others, [0.025, 0.975])
    return Finding(value, min(float(low), value), max(float(high), value), unit, how)


@dataclass(frozen=True)
class Scores:
    """The outcome of a Monte Carlo: one number for each run, method and column.

    Attributes
    ----------
    methods : mapping of str to str
        What is compared: keys and words.
    columns : mapping of str to str
        What is measured of each method: names and units. Less is better.
    values : mapping of str to ndarray
        ``"method.column"``, each (runs,); the runs are the same for all.
    headline : str
        The column by which methods are ranked.
    baselines : frozenset of str
        Methods that a figure leaves out, since they would dwarf the others.
    findings : mapping of str to Finding
        What they amount to, by the names that the evidence has for it.

    Raises
    ------
    ParameterError
        If the values are not those of the methods and columns.

    Examples
    --------
    Two methods that differ by one tenth in every run:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import Scores
    >>> values = {"old.error": np.arange(100.0), "new.error": 0.9 * np.arange(100.0)}
    >>> scores = Scores({"old": "the old", "new": "the new"}, {"error": "m"}, values, "error")
    >>> scores.leader().best, round(scores.leader().lead.percent, 6)
    ('new', 10.0)
    """

    methods: Mapping[str, str]
    columns: Mapping[str, str]
    values: Mapping[str, Array]
    headline: str
    baselines: frozenset[str] = frozenset()
    findings: Mapping[str, Finding] = field(default_factory=dict)

    def __post_init__(self) -> None:
        wanted = {f"{m}.{c}" for m, c in itertools.product(self.methods, self.columns)}
        if set(self.values) != wanted or self.headline not in self.columns:
            raise ParameterError("values", [*self.values], "one for each method and column")

    @property
    def runs(self) -> int:
        """How many runs there are."""
        return len(next(iter(self.values.values())))

    def of(self, method: str, column: str | None = None) -> Array:
        """Return a column of a method, (runs,); of the headline, if none is named."""
        return self.values[f"{method}.{column or self.headline}"]

    def table(self) -> pd.DataFrame:
        """Return the scores as a tidy table: one row for each method and column.

        Its columns are ``method``, ``column``, ``unit``, ``runs``, ``mean``, ``median`` and the
        quantiles ``low`` (2.5 %) and ``high`` (97.5 %) of the runs, of which it takes 40 or more.
        """
        rows = []
        for method, (column, unit) in itertools.product(self.methods, self.columns.items()):
            values = self.of(method, column)
            middle = {name: float(q[0]) for name, q in spread(values[None])._asdict().items()}
            row = {"method": method, "column": column, "unit": unit, "runs": len(values)}
            rows.append(row | {"mean": float(values.mean())} | middle)
        return need("pandas", "The table of scores").DataFrame(rows)

    def leader(self) -> Leader:
        """Return which method has the least mean of the headline, and by how much."""
        best, *others = sorted(self.methods, key=lambda method: float(self.of(method).mean()))
        after = others[0] if others else None
        lead = paired_lead(self.of(best), self.of(after)) if after else Lead(math.nan, math.nan)
        return Leader(best, float(self.of(best).mean()), after, lead)


def paired_lead(values: ArrayLike, others: ArrayLike) -> Lead:
    r"""Return by how much some values are below others of the same runs, in per cent of these.

    The half-width is that of the farther end of `cluster_mean` for the paired differences.

    Parameters
    ----------
    values, others : array_like, (runs,)
        In one unit, five runs or more.

    Examples
    --------
    What both have in common, run by run, does not widen the interval:

    >>> from inswsn_lib.evaluation import paired_lead
    >>> paired_lead([0.0, 10.0, 20.0, 5.0, 7.0], [2.0, 12.0, 22.0, 7.0, 9.0]).within
    0.0
    """
    one = array("values", values, ("runs",))
    two = array("others", others, one.shape)
    gain, scale = two - one, 100 / two.mean()
    mean, low, high = cluster_mean(gain, np.arange(len(gain)))
    return Lead(float(scale * mean), float(scale * max(mean - low, high - mean)))


@dataclass(frozen=True, eq=False)
class Score:
    """How well a hypothesis explains printed cells, from `score_hypothesis`.

    Attributes
    ----------
    free : int
        Numbers that were chosen with these cells in view.
    ratios : ndarray, (cells,)
        Rebuilt over printed.
    """

    free: int
    ratios: Array

    @property
    def met(self) -> int:
        """How many cells are within `WITHIN`."""
        return int(np.sum(np.abs(self.ratios - 1) <= WITHIN))

    @property
    def explained(self) -> bool:
        """Whether all cells are, and there are more of them than free numbers."""
        return self.met == self.ratios.size > self.free

    @property
    def spread(self) -> float:
        """Root mean square of the logarithms of the ratios; 0.1 is about ten per cent."""
        return float(np.sqrt(np.mean(np.log(self.ratios) ** 2)))

    @property
    def worst(self) -> float:
        """The ratio that is farthest from one, on a logarithmic scale."""
        return float(self.ratios[np.argmax(np.abs(np.log(self.ratios)))])


def score_hypothesis(rebuilt: ArrayLike, printed: ArrayLike, free: int) -> Score:
    """Score the cells that a hypothesis rebuilds against those that are printed.

    Parameters
    ----------
    rebuilt, printed : array_like, (cells,)
        Positive, in one unit.
    free : int
        Numbers of the hypothesis that were chosen with these cells in view.

    Examples
    --------
    >>> from inswsn_lib.evaluation import score_hypothesis
    >>> score = score_hypothesis(rebuilt=[1.0, 2.1, 2.9], printed=[1.0, 2.0, 3.0], free=1)
    >>> score.met, score.explained, round(score.worst, 2)
    (3, True, 1.05)
    """
    a = array("rebuilt", rebuilt, ("cells",))
    b = array("printed", printed, a.shape)
    if not a.size or min(a.min(), b.min()) <= 0:
        raise ParameterError("rebuilt and printed", [*a, *b], "positive numbers")
    return Score(whole("free", free), a / b)


@dataclass(frozen=True, eq=False)
class Prediction:
    """What is predicted of printed cells by a hypothesis that was not fitted to them.

    Attributes
    ----------
    ratios : ndarray, (cells, draws)
        Predicted over printed, a column for each drawn case. Positive.

    Raises
    ------
    ParameterError
        If they are not positive.

    Examples
    --------
    Of two cells the second is predicted between 1.2 and 2.2 times the printed one:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import Prediction
    >>> spread = np.linspace(0.8, 1.2, 41)
    >>> prediction = Prediction(np.array([spread, spread + 1]))
    >>> prediction.inside, round(prediction.width, 2)
    (1, 1.33)
    """

    ratios: Array

    def __post_init__(self) -> None:
        if array("ratios", self.ratios, ("cells", "draws")).min() <= 0:
            raise ParameterError("ratios", self.ratios, "positive numbers")

    @property
    def interval(self) -> Array:
        """The ends of the 95 % interval of each cell, (2, cells)."""
        return np.asarray(np.quantile(self.ratios, [0.025, 0.975], axis=1))

    @property
    def inside(self) -> int:
        """How many printed cells lie in their interval."""
        low, high = self.interval
        return int(np.sum((low <= 1) & (high >= 1)))

    @property
    def width(self) -> float:
        """Upper over lower end of the intervals, geometric mean."""
        low, high = self.interval
        return float(np.exp(np.mean(np.log(high / low))))

    @property
    def scores(self) -> Array:
        """The score `crps` of the logarithm of each cell, (cells,)."""
        return crps(np.log(self.ratios), np.zeros(len(self.ratios)))

    @property
    def score(self) -> float:
        """Its mean over the cells: near the relative error, if small and certain."""
        return float(self.scores.mean())


def crps(predicted: ArrayLike, observed: ArrayLike) -> Array:
    r"""Return the continuous ranked probability score of predictions, (cells,). Less is better.

    .. math:: \mathbb{E}|X - x| - \tfrac12\, \mathbb{E}|X - X'|

    with X and X' drawn from the prediction and x observed (Gneiting and Raftery 2007, Section 4.2).
    It is proper: who predicts what he believes has the least expected score, so a prediction that
    is too wide pays for it as well as one that misses. One without spread is scored by its
    distance.

    Parameters
    ----------
    predicted : array_like, (cells, draws)
    observed : array_like, (cells,)

    Examples
    --------
    Both predictions hold the observed 0, the second is ten times as wide:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import crps
    >>> crps([[-1.0, 1.0], [-10.0, 10.0]], [0.0, 0.0]).tolist()
    [0.5, 5.0]
    """
    drawn = np.sort(array("predicted", predicted, ("cells", "draws")), axis=1)
    found = array("observed", observed, (len(drawn),))
    draws = drawn.shape[1]
    # sum of |x_i - x_j| over all pairs, from sorted numbers: each is as often above as it is high
    weights = (2 * np.arange(draws) + 1 - draws) / draws**2
    return np.asarray(np.abs(drawn - found[:, None]).mean(axis=1) - drawn @ weights)
