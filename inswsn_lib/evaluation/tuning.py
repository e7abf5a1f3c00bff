"""Choosing one number of a method by trials, all of which are kept."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from inswsn_lib.errors import ParameterError


@dataclass(frozen=True)
class Tuning:
    """The trials of one method.

    Attributes
    ----------
    name : str
        The method.
    candidates : tuple of float
        The numbers tried.
    losses : tuple of float
        What each of them cost, in the units of the loss.

    Examples
    --------
    >>> from inswsn_lib.evaluation import tune
    >>> tuning = tune("parabola", [0.0, 1.0, 3.0], lambda x: (x - 2) ** 2)
    >>> tuning.losses  # the second and the third cost the same: the first of them is the best
    (4.0, 1.0, 1.0)
    >>> tuning.best, tuning.loss, tuning.trials
    (1.0, 1.0, 3)
    """

    name: str
    candidates: tuple[float, ...]
    losses: tuple[float, ...]

    @property
    def trials(self) -> int:
        """How many numbers were tried."""
        return len(self.candidates)

    @property
    def best(self) -> float:
        """The number with the least loss; the first of equals."""
        return self.candidates[self.losses.index(self.loss)]

    @property
    def loss(self) -> float:
        """The least loss."""
        return min(self.losses)


def tune(name: str, candidates: Sequence[float], loss: Callable[[float], float]) -> Tuning:
    """Try every candidate and keep all losses.

    Parameters
    ----------
    name : str
        The method.
    candidates : sequence of float
        The numbers to try, finite.
    loss : callable
        Takes a candidate and returns what it costs.

    Returns
    -------
    Tuning
        Every candidate with its loss.

    Raises
    ------
    ParameterError
        If there is no candidate, or one or its loss is not a finite number.

    Examples
    --------
    >>> from inswsn_lib.evaluation import tune
    >>> tune("parabola", range(6), lambda x: (x - 2) ** 2 + 0.5).best
    2.0
    >>> tune("a hole", [1.0, 0.0], lambda x: 1 / x if x else float("inf"))
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: loss is 'inf at 0'; it may be finite.
    """
    numbers = tuple(float(number) for number in candidates)
    if not numbers or not all(map(math.isfinite, numbers)):
        raise ParameterError("candidates", list(numbers), "one or more finite numbers")
    losses = []
    for number in numbers:
        losses.append(float(loss(number)))
        if not math.isfinite(losses[-1]):
            raise ParameterError("loss", f"{losses[-1]} at {number:g}", "finite")
    return Tuning(name, numbers, tuple(losses))


@dataclass(frozen=True)
class PatternSearch:
    """The trials of one method with several numbers.

    Attributes
    ----------
    name : str
        The method.
    points : tuple of tuples of float
        The numbers tried, in order.
    losses : tuple of float
        What each of them cost, in the units of the loss.
    settled : bool
        Whether all neighbours of the best were tried: it lies at no edge.

    Examples
    --------
    A search that ends before it has settled says so:

    >>> from inswsn_lib.evaluation import search_pattern
    >>> search = search_pattern("slope", [1.0], [2.0], lambda x: 1 / x, most=4)
    >>> search.points
    ((1.0,), (2.0,), (0.5,), (4.0,))
    >>> search.best, search.settled
    ((4.0,), False)
    """

    name: str
    points: tuple[tuple[float, ...], ...]
    losses: tuple[float, ...]
    settled: bool

    @property
    def trials(self) -> int:
        """How many sets of numbers were tried."""
        return len(self.points)

    @property
    def best(self) -> tuple[float, ...]:
        """The numbers with the least loss; the first of equals."""
        return self.points[self.losses.index(self.loss)]

    @property
    def loss(self) -> float:
        """The least loss."""
        return min(self.losses)


def search_pattern(
    name: str,
    start: Sequence[float],
    ratios: Sequence[float],
    loss: Callable[..., float],
    most: int = 16,
) -> PatternSearch:
    """Tune positive numbers by going from the best point so far to its neighbours.

    The neighbours of a point have one number multiplied or divided by its ratio. As soon as all
    neighbours of the best are known, none of them better, the search has settled.

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

    Returns
    -------
    PatternSearch
        Every trial with its loss.

    Raises
    ------
    ParameterError
        If start and ratios do not pair, a number is not positive and finite, a ratio is not above
        1, there is no trial, or a loss is not a number or at the start not finite.

    Examples
    --------
    From (1, 1) by factors of two to the least of a bowl at (4, 1/2):

    >>> from math import log
    >>> from inswsn_lib.evaluation import search_pattern
    >>> def bowl(x, y):
    ...     return log(x / 4) ** 2 + log(y / 0.5) ** 2
    >>> search = search_pattern("bowl", [1.0, 1.0], [2.0, 2.0], bowl)
    >>> search.best, round(search.loss, 6), search.settled
    ((4.0, 0.5), 0.0, True)
    """
    origin, steps = [float(x) for x in start], [float(r) for r in ratios]
    if len(origin) != len(steps) or not origin:
        raise ParameterError("ratios", steps, f"one for each of {origin}")
    if not all(0 < x < math.inf for x in origin):
        raise ParameterError("start", origin, "positive, finite numbers")
    if not all(1 < r < math.inf for r in steps):
        raise ParameterError("ratios", steps, "finite numbers above 1")
    if most < 1:
        raise ParameterError("most", most, "1 or more")
    tried: dict[tuple[int, ...], float] = {}

    def numbers(place: tuple[int, ...]) -> tuple[float, ...]:
        return tuple(x * r**i for x, r, i in zip(origin, steps, place, strict=True))

    def attempt(place: tuple[int, ...]) -> None:
        tried[place] = float(loss(*numbers(place)))
        if math.isnan(tried[place]) or (len(tried) == 1 and math.isinf(tried[place])):
            raise ParameterError("loss", f"{tried[place]} at {numbers(place)}", "a number")

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
        centre_now = min(tried, key=lambda place: tried[place])
        settled = centre_now == centre and all(place in tried for place in around)
    return PatternSearch(
        name, tuple(numbers(place) for place in tried), tuple(tried.values()), settled
    )
