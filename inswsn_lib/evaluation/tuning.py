"""Choosing the numbers of a method by trials, all of which are kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from inswsn_lib.checks import Array, array, number, whole
from inswsn_lib.errors import Described, ParameterError

Candidate = TypeVar("Candidate", float, tuple[float, ...])

# Share of a loss by which a better one is no gain
_FLAT = 3e-5
# Where searches for the most likely numbers begin, in deviations of the prior; by how much their
# ends may differ; steps of derivatives, and the widest, both in logarithms
_BEGINS = ((0, 0), (1, -1), (-1, 1), (0, 1))
_APART, _STEP, _WIDEST = 0.5, 1e-4, 9.0
_FLAT_LIKELIHOOD = 1e-7  # share of the loss by which the last step of a search is no gain
_IMPOSSIBLE = 1e12  # the loss where there is no likelihood


@dataclass(frozen=True)
class Tuning(Generic[Candidate]):
    """The trials of one method, from `tune`, `search_pattern` or `most_likely`.

    Attributes
    ----------
    name : str
        The method.
    candidates : tuple of float or of tuples of float
        What was tried, in order: a number, or several.
    losses : tuple of float
        What each of them cost, in the units of the loss.
    settled : bool
        Of a pattern search: whether all neighbours of the best were tried, and it lies at no edge.
        Of one for the most likely numbers: whether two begins led to the best end.
    evaluations : int, optional
        How often the loss was computed, where candidates are but the ends of searches.

    Examples
    --------
    >>> from inswsn_lib.evaluation import Tuning
    >>> tuning = Tuning("parabola", (0.0, 1.0, 3.0), (4.0, 1.0, 1.0))
    >>> tuning.best, tuning.loss, tuning.trials  # the first of equals
    (1.0, 1.0, 3)
    """

    name: str
    candidates: tuple[Candidate, ...]
    losses: tuple[float, ...]
    settled: bool = True
    evaluations: int | None = None

    @property
    def trials(self) -> int:
        """How many settings were tried."""
        return self.evaluations or len(self.candidates)

    @property
    def best(self) -> Candidate:
        """The candidate with the least loss; the first of equals."""
        return self.candidates[self.losses.index(self.loss)]

    @property
    def loss(self) -> float:
        """The least loss."""
        return min(self.losses)


def tune(name: str, candidates: Sequence[float], loss: Callable[[float], float]) -> Tuning[float]:
    """Try every candidate and keep all losses.

    Parameters
    ----------
    name : str
        The method.
    candidates : sequence of float
        The numbers to try, finite.
    loss : callable
        Takes a candidate and returns what it costs, a finite number.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> iw.tune("parabola", range(6), lambda x: (x - 2) ** 2 + 0.5).best
    2.0
    """
    numbers = tuple(array("candidates", candidates, ("candidates",)).tolist())
    if not numbers:
        raise ParameterError("candidates", candidates, "one or more finite numbers")
    return Tuning(name, numbers, tuple(number(f"loss at {x:g}", float(loss(x))) for x in numbers))


def search_pattern(
    name: str,
    start: Sequence[float],
    ratios: Sequence[float],
    loss: Callable[..., float],
    most: int = 16,
) -> Tuning[tuple[float, ...]]:
    """Tune positive numbers by going from the best point so far to its neighbours.

    The neighbours of a point have one number multiplied or divided by its ratio. As soon as all
    neighbours of the best are known, none of them better by more than a share of 3e-5, the search
    has settled: along a flat valley it would else go on for ever, led by rounding.

    Parameters
    ----------
    name : str
        The method.
    start : sequence of float
        Positive numbers to begin with.
    ratios : sequence of float
        For each number the step to a neighbour, above 1.
    loss : callable
        Takes the numbers and returns what they cost; infinite where the method cannot be had.
    most : int
        Trials after which the search ends, settled or not.

    Examples
    --------
    From (1, 1) by factors of two to the least of a bowl at (4, 1/2):

    >>> from math import log
    >>> from inswsn_lib.evaluation import search_pattern
    >>> def bowl(x, y):
    ...     return log(x / 4) ** 2 + log(y / 0.5) ** 2
    >>> search = search_pattern("bowl", [1.0, 1.0], [2.0, 2.0], bowl)
    >>> search.best, search.settled
    ((4.0, 0.5), True)
    """
    origin = array("start", start, ("numbers",)).tolist()
    steps = array("ratios", ratios, (len(origin),)).tolist()
    for given, above, values in (("start", 0, origin), ("ratios", 1, steps)):
        if not values or min(values) <= above:
            raise ParameterError(given, values, f"one or more numbers above {above}")
    whole("most", most, 1)
    tried: dict[tuple[int, ...], float] = {}

    def numbers(place: tuple[int, ...]) -> tuple[float, ...]:
        return tuple(x * r**i for x, r, i in zip(origin, steps, place, strict=True))

    def attempt(place: tuple[int, ...]) -> None:
        tried[place] = float(loss(*numbers(place)))
        if math.isnan(tried[place]) or (len(tried) == 1 and math.isinf(tried[place])):
            given = Described(f"{tried[place]} at {numbers(place)}")
            raise ParameterError("loss", given, "a number, and finite at the start")

    attempt((0,) * len(origin))
    ways = np.kron(np.eye(len(origin), dtype=int), [[1], [-1]])
    settled = False
    while len(tried) < most and not settled:
        centre = min(tried, key=lambda place: tried[place])
        around = [tuple(place) for place in (np.array(centre) + ways).tolist()]
        new = [place for place in around if place not in tried]
        for place in new[: most - len(tried)]:
            attempt(place)
        best = min(tried, key=lambda place: tried[place])
        gained = tried[centre] - tried[best]
        settled = gained <= _FLAT * abs(tried[centre]) and all(place in tried for place in around)
    return Tuning(name, tuple(map(numbers, tried)), tuple(tried.values()), settled)


def most_likely(
    name: str, begin: Sequence[float], log_likelihood: Callable[..., float], *,
    spread: float = 3.0, begins: int = 3,
) -> Tuning[tuple[float, ...]]:  # fmt: skip
    r"""Tune positive numbers by a log-likelihood and a weak prior.

    .. math:: \ell(x) - \tfrac12 \sum_i \big(\ln (x_i / x^0_i) / \ln s\big)^2

    is made largest over :math:`\ln x` by L-BFGS-B (Byrd, Lu, Nocedal and Zhu 1995), with
    derivatives by differences, from several begins. The prior is log-normal about the first begin,
    a factor s wide. It decides where data tell little: along a valley in which one number makes up
    for another, as the size of errors that last and how long they last do.

    Parameters
    ----------
    name : str
        The method.
    begin : sequence of float
        Positive numbers, :math:`x^0`.
    log_likelihood : callable
        Takes the numbers; what is not finite counts as impossible.
    spread : float
        s, above 1.
    begins : int
        1 to 4; the others are where every second number is a factor s larger or smaller.

    Returns
    -------
    Tuning
        Its candidates are the ends, its losses their log-likelihoods with the prior, negated. It
        has settled if another begin led within 0.5 of the best end.

    Raises
    ------
    ParameterError
        If numbers do not fit, or the log-likelihood is not finite at the first begin.

    Examples
    --------
    How large a hundred values are, with deviation 2, of which 1 is thought before:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import most_likely
    >>> x = 2 * np.random.default_rng(0).normal(size=100)
    >>> found = most_likely("size", [1.0], lambda s: -100 * np.log(s) - np.sum(x**2) / (2 * s**2))
    >>> print(f"{found.best[0]:.2f} {np.sqrt(np.mean(x**2)):.2f}", found.settled)
    1.93 1.93 True
    """
    from scipy.optimize import minimize  # noqa: PLC0415  # a page of the book has numpy alone

    origin = array("begin", begin, ("numbers",))
    if not origin.size or origin.min() <= 0:
        raise ParameterError("begin", origin.tolist(), "one or more positive numbers")
    width = math.log(number("spread", spread, above=1))
    whole("begins", begins, 1, len(_BEGINS))

    def loss(z: Array) -> float:
        value = float(log_likelihood(*(origin * np.exp(z)).tolist()))
        return float(z @ z) / (2 * width**2) - value if math.isfinite(value) else _IMPOSSIBLE

    if loss(np.zeros(len(origin))) >= _IMPOSSIBLE:
        given = Described(f"undefined at {tuple(origin.tolist())}")
        raise ParameterError("log_likelihood", given, "finite at the begin")
    ends = [
        minimize(
            loss, width * np.resize(signs, len(origin)), method="L-BFGS-B",
            bounds=[(-_WIDEST, _WIDEST)] * len(origin),
            options={"eps": _STEP, "ftol": _FLAT_LIKELIHOOD},
        )
        for signs in _BEGINS[:begins]
    ]  # fmt: skip
    losses = tuple(float(end.fun) for end in ends)
    near = sum(each - min(losses) < _APART for each in losses)
    found = tuple(tuple((origin * np.exp(end.x)).tolist()) for end in ends)
    tried = sum(int(end.nfev) for end in ends)
    return Tuning(name, found, losses, settled=near > 1, evaluations=tried)
