"""Many runs of a simulation: in groups, with a random stream for each group."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from inswsn_lib.checks import Array, whole
from inswsn_lib.errors import ParameterError

Simulation = Callable[[np.random.Generator, int], Mapping[str, Array]]
Kept = Callable[[dict[str, Array]], Mapping[str, Array]]

#: Runs that share a stream. It is part of what a seed stands for, and never changes.
GROUP = 64


def monte_carlo(
    simulate: Simulation,
    runs: int,
    seed: int,
    *,
    first: int = 0,
    keep: Kept | None = None,
    at_once: int = 4096,
) -> dict[str, Array]:
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
    keep : callable, optional
        What is kept of some runs: takes the arrays of `simulate` and returns others, such as the
        errors of a filter, a number for each run. So a million runs take the memory of `at_once`.
        It must treat each run by itself. Default: all is kept.
    at_once : int
        Runs that `keep` is given at a time, a multiple of `GROUP`.

    Returns
    -------
    dict of str to ndarray
        As `simulate` names them, or `keep`, ``runs`` on the last axis.

    Examples
    --------
    A run is the same however many runs there are:

    >>> import inswsn_lib as iw
    >>> def simulate(rng, runs):
    ...     return {"error": rng.standard_normal((3, 2, runs))}
    >>> few, many = (iw.monte_carlo(simulate, runs, seed=0)["error"] for runs in (5, 100))
    >>> few.shape, many.shape, bool((few == many[..., :5]).all())
    ((3, 2, 5), (3, 2, 100), True)

    Of each of ten thousand walks only how far it came is kept:

    >>> def how_far(drawn):
    ...     return {"end": abs(drawn["error"].sum(axis=(0, 1)))}
    >>> iw.monte_carlo(simulate, 10_000, seed=0, keep=how_far)["end"].shape
    (10000,)
    """
    whole("runs", runs, 1)
    whole("seed", seed)
    for name, value in (("first", first), ("at_once", whole("at_once", at_once, 1))):
        if whole(name, value) % GROUP:
            raise ParameterError(name, value, f"a multiple of {GROUP}")
    if keep is None:
        return _drawn(simulate, runs, seed, first)
    kept = []
    for begin in range(0, runs, at_once):
        drawn = keep(_drawn(simulate, min(at_once, runs - begin), seed, first + begin))
        # a view would hold all that it is a part of
        kept.append({name: np.array(each) for name, each in drawn.items()})
    return {name: np.concatenate([each[name] for each in kept], axis=-1) for name in kept[0]}


def _drawn(simulate: Simulation, runs: int, seed: int, first: int) -> dict[str, Array]:
    parts: dict[str, list[Array]] = {}
    for group in range(-(-runs // GROUP)):
        number = first // GROUP + group
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
        count = min(GROUP, runs - group * GROUP)
        for name, drawn in simulate(rng, GROUP).items():
            parts.setdefault(name, []).append(drawn[..., :count])
    return {name: np.concatenate(each, axis=-1) for name, each in parts.items()}
