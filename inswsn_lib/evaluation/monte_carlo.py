"""Many runs of a simulation: in groups, with a random stream for each group."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from inswsn_lib.checks import Array, whole
from inswsn_lib.errors import ParameterError

Simulation = Callable[[np.random.Generator, int], Mapping[str, Array]]

#: Runs that share a stream. It is part of what a seed stands for, and never changes.
GROUP = 64


def monte_carlo(simulate: Simulation, runs: int, seed: int, *, first: int = 0) -> dict[str, Array]:
    """Simulate any number of runs and return their arrays, with the runs last.

    Runs come in groups of `GROUP`, each with the stream that belongs to the seed and the number of
    the group. So run i is the same however many runs follow it.

    Parameters
    ----------
    simulate : callable
        Takes a generator and a number of runs and returns named arrays, the runs on the last axis.
    runs : int
    seed : int
        Not negative.
    first : int
        The run to begin with, a multiple of `GROUP`. So many runs can be shared out to several
        calls, also on several machines, and joined again.

    Returns
    -------
    dict of str to ndarray
        As `simulate` names them, ``runs`` on the last axis.

    Examples
    --------
    A run is the same however many runs there are:

    >>> import inswsn_lib as iw
    >>> def simulate(rng, runs):
    ...     return {"error": rng.standard_normal((3, 2, runs))}
    >>> few, many = (iw.monte_carlo(simulate, runs, seed=0)["error"] for runs in (5, 100))
    >>> few.shape, many.shape, bool((few == many[..., :5]).all())
    ((3, 2, 5), (3, 2, 100), True)
    """
    whole("runs", runs, 1)
    whole("seed", seed)
    if whole("first", first) % GROUP:
        raise ParameterError("first", first, f"a multiple of {GROUP}")
    kept: dict[str, list[Array]] = {}
    for group in range(-(-runs // GROUP)):
        number = first // GROUP + group
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
        count = min(GROUP, runs - group * GROUP)
        for name, drawn in simulate(rng, GROUP).items():
            kept.setdefault(name, []).append(drawn[..., :count])
    return {name: np.concatenate(parts, axis=-1) for name, parts in kept.items()}
