"""Many runs of a simulation: in groups, with a random stream for each group."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.errors import ParameterError

Array = NDArray[np.float64]
Simulation = Callable[[np.random.Generator, int], Mapping[str, Array]]

#: Runs that share a stream. It is part of what a seed stands for, and never changes.
GROUP = 64


def monte_carlo(simulate: Simulation, runs: int, seed: int, *, first: int = 0) -> dict[str, Array]:
    """Simulate any number of runs and return their arrays, with the runs last.

    Runs come in groups of `GROUP`, each with the stream that belongs to the seed and the number of
    the group. So run i is the same however many runs follow it, and memory is bounded by what is
    kept of a group.

    Parameters
    ----------
    simulate : callable
        Takes a generator and a number of runs and returns named arrays, the runs on the last axis.
    runs : int
        How many.
    seed : int
        Not negative.
    first : int
        The run to begin with, a multiple of `GROUP`. So many runs can be shared out to several
        calls, also on several machines, and joined again.

    Returns
    -------
    dict of str to ndarray
        As `simulate` names them, ``runs`` on the last axis.

    Raises
    ------
    ParameterError
        If there is no run, the seed is negative, or a group would begin in its middle.

    Examples
    --------
    A run is the same however many runs there are:

    >>> import numpy as np
    >>> from inswsn_lib.evaluation import monte_carlo
    >>> def simulate(rng, runs):
    ...     return {"error": rng.standard_normal((3, 2, runs))}
    >>> few, many = (monte_carlo(simulate, runs, seed=0)["error"] for runs in (5, 100))
    >>> few.shape, many.shape, bool((few == many[..., :5]).all())
    ((3, 2, 5), (3, 2, 100), True)

    and whatever call it is in:

    >>> last = monte_carlo(simulate, 36, seed=0, first=64)["error"]
    >>> bool((last == many[..., 64:]).all())
    True
    """
    if runs < 1:
        raise ParameterError("runs", runs, "1 or more")
    if seed < 0:
        raise ParameterError("seed", seed, "not negative")
    if first < 0 or first % GROUP:
        raise ParameterError("first", first, f"a multiple of {GROUP}, not negative")
    kept: dict[str, list[Array]] = {}
    for group in range(-(-runs // GROUP)):
        number = first // GROUP + group
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
        count = min(GROUP, runs - group * GROUP)
        for name, array in simulate(rng, GROUP).items():
            kept.setdefault(name, []).append(array[..., :count])
    return {name: np.concatenate(parts, axis=-1) for name, parts in kept.items()}
