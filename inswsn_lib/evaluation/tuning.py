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
