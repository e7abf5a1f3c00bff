"""Choosing the numbers of a method by trials, all of which are kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from inswsn_lib.checks import array, number, whole
from inswsn_lib.errors import Described, ParameterError

Candidate = TypeVar("Candidate", float, tuple[float, ...])

# Share of a loss by which a better one is no gain
_FLAT = 3e-5


@dataclass(frozen=True)
class Tuning(Generic[Candidate]):
    """The trials of one method, from `tune` or `search_pattern`.

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

    @property
    def trials(self) -> int:
        """How many candidates were tried."""
        return len(self.candidates)

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
    settled = False
    while len(tried) < most and not settled:
        centre = min(tried, key=lambda place: tried[place])
        around = [
            (*centre[:i], centre[i] + way, *centre[i + 1 :])
            for i in range(len(origin))
            for way in (1, -1)
        ]
        new = [place for place in around if place not in tried]
        for place in new[: most - len(tried)]:
            attempt(place)
        best = min(tried, key=lambda place: tried[place])
        gained = tried[centre] - tried[best]
        settled = gained <= _FLAT * abs(tried[centre]) and all(place in tried for place in around)
    return Tuning(name, tuple(map(numbers, tried)), tuple(tried.values()), settled)
