"""Methods that are judged on the same runs: their scores, who leads, and by how much."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation.metrics import spread

Array = NDArray[np.float64]

_NORMAL_95 = 1.96


class Lead(NamedTuple):
    """By how much one method is below another on the same runs.

    Attributes
    ----------
    percent, within : float
        The mean of the paired differences and the half-width of its 95 % interval, both in per cent
        of the mean of the other method.

    Examples
    --------
    >>> from inswsn_lib.evaluation import paired_lead
    >>> lead = paired_lead([9.0, 18.0, 27.0], [10.0, 20.0, 30.0])
    >>> print(f"{lead.percent:.1f} ± {lead.within:.1f} %")
    10.0 ± 5.7 %
    """

    percent: float
    within: float


class Leader(NamedTuple):
    """The method with the least mean of the headline.

    Attributes
    ----------
    best : str
        The method.
    error : float
        Its mean.
    next : str or None
        The method after it; None if there is one method alone.
    lead : Lead
        By how much the best is below the next.

    Examples
    --------
    >>> from inswsn_lib.evaluation import Lead, Leader
    >>> best, error, after, (percent, within) = Leader("kf", 0.9, "hf", Lead(10.0, 0.5))
    >>> f"{best} is {percent:.0f} % below {after}"
    'kf is 10 % below hf'
    """

    best: str
    error: float
    next: str | None
    lead: Lead


@dataclass(frozen=True)
class Scores:
    """What a Monte Carlo comes to: one number for each run, method and column.

    All methods judge the same runs, so that they can be compared run by run.

    Attributes
    ----------
    methods : mapping of str to str
        What is compared: keys and words.
    columns : mapping of str to str
        What is measured of each method: names and units. Less is better.
    values : mapping of str to ndarray
        ``"method.column"``, each (runs,).
    headline : str
        The column by which methods are ranked.
    baselines : frozenset of str
        Methods that a figure leaves out, since they would dwarf the others.

    Raises
    ------
    ParameterError
        If the values are not those of the methods and columns.

    Examples
    --------
    Two methods that differ by one tenth in every run:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import Scores
    >>> scores = Scores(
    ...     methods={"old": "the old one", "new": "the new one"},
    ...     columns={"error": "m"},
    ...     values={"old.error": np.arange(100.0), "new.error": 0.9 * np.arange(100.0)},
    ...     headline="error",
    ... )
    >>> leader = scores.leader()
    >>> leader.best, leader.next, round(leader.lead.percent, 6)
    ('new', 'old', 10.0)
    >>> print(*scores.table().loc[0, ["method", "column", "unit", "runs", "median"]])
    old error m 100 49.5
    """

    methods: Mapping[str, str]
    columns: Mapping[str, str]
    values: Mapping[str, Array]
    headline: str
    baselines: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        wanted = {f"{m}.{c}" for m, c in itertools.product(self.methods, self.columns)}
        if set(self.values) != wanted or self.headline not in self.columns:
            raise ParameterError(
                "values", ", ".join(self.values) or "none", "one for each method and column"
            )

    @property
    def runs(self) -> int:
        """How many runs there are."""
        return len(next(iter(self.values.values())))

    def of(self, method: str, column: str | None = None) -> Array:
        """Return a column of a method, (runs,); of the headline, if none is named."""
        return self.values[f"{method}.{column or self.headline}"]

    def table(self) -> pd.DataFrame:
        """Return the scores as a tidy table: one row for each method and column.

        Returns
        -------
        pandas.DataFrame
            ``method``, ``column``, ``unit``, ``runs``, ``mean``, ``median`` and the quantiles
            ``low`` (2.5 %) and ``high`` (97.5 %) of the runs.

        Raises
        ------
        ParameterError
            If there are fewer than 40 runs.
        """
        rows = []
        for method, (column, unit) in itertools.product(self.methods, self.columns.items()):
            values = self.of(method, column)
            (median,), (low,), (high,) = spread(values[None])
            rows.append(
                {
                    "method": method,
                    "column": column,
                    "unit": unit,
                    "runs": len(values),
                    "mean": float(values.mean()),
                    "median": float(median),
                    "low": float(low),
                    "high": float(high),
                }
            )
        return pd.DataFrame(rows)

    def leader(self) -> Leader:
        """Return which method has the least mean of the headline, and by how much.

        Returns
        -------
        Leader
        """
        best, *others = sorted(self.methods, key=lambda method: float(self.of(method).mean()))
        after = others[0] if others else None
        lead = paired_lead(self.of(best), self.of(after)) if after else Lead(math.nan, math.nan)
        return Leader(best, float(self.of(best).mean()), after, lead)


def paired_lead(values: ArrayLike, others: ArrayLike) -> Lead:
    r"""Return by how much some values are below others of the same runs.

    The interval is that of a mean of paired differences, :math:`\bar d \pm 1.96\, s_d / \sqrt{n}`.

    Parameters
    ----------
    values, others : array_like, (runs,)
        In one unit.

    Returns
    -------
    Lead
        In per cent of the mean of the others.

    Examples
    --------
    What both have in common, run by run, does not widen the interval:

    >>> from inswsn_lib.evaluation import paired_lead
    >>> paired_lead([0.0, 10.0, 20.0], [2.0, 12.0, 22.0]).within
    0.0
    """
    one, two = np.asarray(values, dtype=float), np.asarray(others, dtype=float)
    gain, scale = two - one, 100 / two.mean()
    within = _NORMAL_95 * gain.std(ddof=1) / math.sqrt(len(gain))
    return Lead(float(scale * gain.mean()), float(scale * within))
