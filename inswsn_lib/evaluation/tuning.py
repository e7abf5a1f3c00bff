"""Choosing one number of a method by trials, all of which are kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Tuning:
    """The trials of one method.

    Attributes
    ----------
    name : str
        The method.
    candidates : tuple of float
        The numbers tried.
    losses : ndarray, (candidates,)
        What each of them cost.
    """

    name: str
    candidates: tuple[float, ...]
    losses: Array

    @property
    def trials(self) -> int:
        """How many numbers were tried."""
        return len(self.candidates)

    @property
    def best(self) -> float:
        """The number with the least loss; the first of equals."""
        return self.candidates[int(np.argmin(self.losses))]

    @property
    def loss(self) -> float:
        """The least loss."""
        return float(self.losses.min())


def tune(name: str, candidates: Sequence[float], loss: Callable[[float], float]) -> Tuning:
    """Try every candidate and keep all losses.

    Parameters
    ----------
    name : str
        The method.
    candidates : sequence of float
        The numbers to try.
    loss : callable
        Takes a candidate and returns what it costs.

    Raises
    ------
    ParameterError
        If there is no candidate, or a loss is not a finite number.
    """
    numbers = tuple(float(number) for number in candidates)
    if not numbers:
        raise ParameterError("candidates", "empty", "one or more numbers")
    losses = np.array([float(loss(number)) for number in numbers])
    if not np.isfinite(losses).all():
        where = numbers[int(np.argmin(np.isfinite(losses)))]
        raise ParameterError("loss", f"not finite at {where:g}", "finite")
    return Tuning(name, numbers, losses)
