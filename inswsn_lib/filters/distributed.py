"""Constant-gain filters in the clusters of a network, and a centre that weighs their estimates.

As P2 prints it, the weights are constant. A cluster that does not hear the blind node then goes on
without measurements, and, since A is not stable, takes the fused estimate with it. The hand-overs
here repair that.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from inswsn_lib.checks import Array, Mask, array, mask, of_runs, one_of
from inswsn_lib.errors import Described, ParameterError
from inswsn_lib.filters.hinfinity import (
    Design,
    common_transition,
    empty_predictions,
    estimates_of,
    model_and_gain,
)
from inswsn_lib.filters.inputs import (
    Pattern,
    as_pattern,
    by_pattern,
    each_step,
    first_state,
    measured,
    occurring,
    once,
    times,
)
from inswsn_lib.lmi.designs import FilterDesign, FusionSolver

Handover = Literal["restart", "constant", "fading"]

_ROUNDING = 1e-6


def run_distributed(
    designs: Sequence[Design],
    measurements: ArrayLike,
    *,
    weights: ArrayLike | Mapping[Pattern, ArrayLike],
    handover: Handover = "restart",
    margins: ArrayLike | None = None,
    lost: ArrayLike | None = None,
    delay: int | Sequence[int] = 0,
    initial_state: ArrayLike | None = None,
    predicted: bool = False,
) -> Array:
    r"""Run the filters of all clusters (P2 4) and fuse their predictions over many runs at once.

    .. math::
        \hat x_{c,k+1} = A \hat x_{c,k} + K_c (y_{c,k} - C_c \hat x_{c,k}), \qquad
        \hat x_{k+1} = \sum_c M_c \hat x_{c,k+1}

    A cluster hears the blind node where any component of its y is there.

    - Hand-over "constant", as P2 prints it: the weights are those of all clusters, whoever hears
      the node. A cluster that does not predicts on from its own state.
    - Hand-over "restart": the weights are those of the clusters that hear the node. The state of
      the others is set to the fused one, from which one that returns starts. Where none hears the
      node, the fused estimate is predicted.
    - Hand-over "fading": as "restart", with the weights :math:`(\sum_b W_b)^{-1} W_c`, where
      :math:`W_c = \mu_c M_c` and :math:`\mu_c` is the margin of the cluster. One with margin 0
      counts as not heard, unless all that hear the node have margin 0.

    The centre works with the last message that it has of each cluster: the prediction made when it
    was sent, carried to the present by A, with the cluster's word on whether it heard the node
    then, and with what margin. A cluster of which nothing has arrived yet counts as not heard. The
    way back is neither lost nor delayed.

    Parameters
    ----------
    designs : sequence of FilterDesign, or of tuples of ErrorModel and ndarray (n, m)
        The filters of the N clusters: designs, or models with gains; A is the same in all.
    measurements : array_like, (N, steps, m) or (N, steps, m, runs)
        y of each cluster; NaN where missing.
    weights : array_like, (N, n, n), or mapping of tuple of N bools to array_like, (N, n, n)
        M of each cluster, of sum I, by pattern of the clusters that hear the node and zero for the
        others. An array alone is for the pattern in which all do.
    handover : {"restart", "constant", "fading"}
    margins : array_like, (N, steps) or (N, steps, runs), optional
        For "fading": how far inside the coverage of each cluster the node is, from 0 to 1.
    lost : array_like of bool, (N, steps) or (N, steps, runs), as measurements, optional
        Whether the message that a cluster sends at a step never arrives. Default: all arrive.
    delay : int or sequence of N ints
        Steps from sending to arrival.
    initial_state, predicted
        As in `run_hinfinity`.

    Returns
    -------
    ndarray, (steps, n) or (steps, n, runs)

    Examples
    --------
    Two clusters of deadbeat gain measure a random walk at 2 m and at 4 m. Then the second falls
    silent, and the first has all the weight. As P2 prints it, half of the 4 m stays:

    >>> import numpy as np
    >>> import inswsn_lib as iw
    >>> filters = [(iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0), [[1]])] * 2
    >>> y = [[[2.0], [2.0]], [[4.0], [np.nan]]]
    >>> half = [[[0.5]], [[0.5]]]
    >>> weights = {(True, True): half, (True, False): [[[1]], [[0]]]}
    >>> iw.run_distributed(filters, y, weights=weights).tolist()
    [[3.0], [2.0]]
    >>> iw.run_distributed(filters, y, weights=half, handover="constant").tolist()
    [[3.0], [3.0]]
    """
    one_of("handover", handover, get_args(Handover))
    if (handover == "fading") != (margins is not None):
        raise ParameterError("margins", margins, 'given if, and only if, handover is "fading"')
    A, C, gains = _locals(designs)
    there, y, back = measured(measurements, len(C), "steps", C.shape[1], "runs")
    hearing = np.any(there, axis=2)
    start = first_state(initial_state, len(A), y.shape[-1])
    links = _Links(lost, delay, back(y).shape)
    known, factors = _known(hearing, margins, links)
    occur, which = occurring(np.ones_like(hearing[..., :1]) if handover == "constant" else known)
    tables = _tables(weights, occur, len(A))
    estimates = empty_predictions(A, start, y.shape[1], predicted)
    x = held = np.repeat(start[None], len(C), axis=0)  # of the clusters, and at the centre
    for k, use in enumerate(each_step(which)):
        x = A @ x + gains @ (there[:, k] * (y[:, k] - C @ x))
        held = links.received(k, x, held, A)
        parts = np.concatenate([held, [A @ estimates[k]]])
        estimates[k + 1] = _mixed(tables[use], None if factors is None else factors[:, k], parts)
        if handover != "constant":
            x = np.where(hearing[:, k, None], x, estimates[k + 1])
    return back(estimates_of(A, estimates, predicted))


def patterns_of(
    measurements: ArrayLike,
    *,
    margins: ArrayLike | None = None,
    lost: ArrayLike | None = None,
    delay: int | Sequence[int] = 0,
) -> list[Pattern]:
    """Return the patterns of clusters that hear the node for which a run asks weights.

    Parameters
    ----------
    measurements, margins, lost, delay
        As in `run_distributed`. All change the patterns that the centre knows of.

    Returns
    -------
    list of tuples of N bools
        Sorted, without the pattern in which no cluster hears the node.

    Examples
    --------
    >>> import numpy as np
    >>> import inswsn_lib as iw
    >>> iw.patterns_of([[[2.0], [2.0], [np.nan]], [[4.0], [np.nan], [np.nan]]])
    [(True, False), (True, True)]
    """
    y, back = of_runs("measurements", measurements, "N", "steps", "m", "runs", gaps=True)
    links = _Links(lost, delay, back(y).shape)
    known, _ = _known(~np.all(np.isnan(y), axis=2), margins, links)
    return sorted(tuple(row) for row in occurring(known)[0].tolist() if any(row))


def handover_weights(
    designs: Sequence[FilterDesign],
    patterns: Iterable[Pattern],
    noise: Literal["common", "independent"] = "common",
    structure: Literal["full", "block"] = "full",
    *,
    margin: float = 0.01,
    solver: FusionSolver | tuple[FusionSolver, ...] = ("structured", "clarabel"),
) -> dict[Pattern, Array]:
    """Design the weights of the centre for each pattern of clusters that hear the node.

    Parameters
    ----------
    designs : sequence of FilterDesign
        The filters of the N clusters.
    patterns : iterable of tuples of N bools
        For example from `patterns_of`.
    noise, structure, margin, solver
        As in `design_fusion`, which designs the weights of the clusters that hear the node. One
        that hears it alone has the weight I.

    Returns
    -------
    dict of tuple of N bools to ndarray, (N, n, n)
        Zero for clusters that do not hear the node.

    Examples
    --------
    Two equal clusters share the weight, and one that hears the node alone has all of it:

    >>> import inswsn_lib as iw
    >>> model = iw.ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
    >>> patterns = [(True, True), (True, False)]
    >>> weights = iw.handover_weights([iw.design_filter(model)] * 2, patterns)
    >>> [[f"{weight:.3f}" for weight in M.ravel()] for M in weights.values()]
    [['0.500', '0.500'], ['1.000', '0.000']]
    """
    from inswsn_lib.lmi import design_fusion  # noqa: PLC0415  # runs of filters need no solver

    A, C, _ = _locals(designs)
    found: dict[Pattern, Array] = {}
    for given in patterns:
        pattern = as_pattern("patterns", given, len(C))
        members = [c for c, hears in enumerate(pattern) if hears]
        found[pattern] = np.zeros((len(C), *A.shape))
        if len(members) == 1:
            found[pattern][members] = np.eye(len(A))
        else:
            chosen = [designs[c] for c in members]
            fusion = design_fusion(chosen, noise, structure, margin=margin, solver=solver)
            found[pattern][members] = fusion.weights
    return found


class _Links:
    """Which message of each cluster is the last that has arrived at the centre, at each step.

    The shape is that of the measurements, as they are given.

    Attributes
    ----------
    sent : ndarray of int, (N, steps, 1 or runs)
        The step at which it was sent; -1 if none has arrived yet.
    at_once : bool
        Whether it is always that of the step itself.
    """

    def __init__(
        self, lost: ArrayLike | None, delay: int | Sequence[int], shape: tuple[int, ...]
    ) -> None:
        clusters, steps, _, *runs = shape
        delays = np.broadcast_to(array("delay", delay, (), (clusters,)), clusters)
        if ((delays < 0) | (delays % 1 != 0)).any():
            raise ParameterError("delay", delay, "whole numbers of at least 0")
        self._delays = [int(each) for each in delays]
        self.at_once = lost is None and not any(self._delays)
        gone = np.zeros((clusters, steps, 1), dtype=bool)
        if lost is not None:
            gone = once(mask("lost", lost, (*shape[:2], *runs)).reshape(*shape[:2], *(runs or [1])))
        sent = np.maximum.accumulate(np.where(gone, -1, np.arange(steps)[:, None]), axis=1)
        before = np.full((max(self._delays), sent.shape[-1]), -1)
        rows = zip(sent, self._delays, strict=True)
        self.sent = np.stack([np.concatenate([before[:d], row])[:steps] for row, d in rows])
        self._messages: deque[Array] = deque(maxlen=len(before) + 1)

    def received(self, k: int, message: Array, held: Array, A: Array) -> Array:
        """Return what the centre has (N, n, runs) after step k, once its messages are sent.

        Of the step before it held another, which A carries on.
        """
        if self.at_once:
            return message
        if k == 0:
            self._powers = [np.linalg.matrix_power(A, delay) for delay in self._delays]
        self._messages.append(message)
        held = A @ held
        for c, delay in enumerate(self._delays):
            if delay <= k:
                arrived = self._powers[c] @ self._messages[-1 - delay][c]
                held[c] = np.where(self.sent[c, k] == k - delay, arrived, held[c])
        return held


def _known(hearing: Mask, margins: ArrayLike | None, links: _Links) -> tuple[Mask, Array | None]:
    """Return which clusters count for the centre (N, steps, 1 or runs), and by what factors.

    The factors are those of the clusters and, last, of the prediction; None without margins.
    """
    clusters, steps, _ = hearing.shape
    sent = np.maximum(links.sent, 0)
    if not links.at_once:
        hearing = np.take_along_axis(hearing, sent, axis=1) & (links.sent >= 0)
    if margins is None:
        return hearing, None
    given = array("margins", margins, (clusters, steps), (clusters, steps, "runs"))
    if ((given < 0) | (given > 1)).any():
        raise ParameterError("margins", Described("outside that range"), "between 0 and 1")
    factors = np.take_along_axis(given if given.ndim == 3 else given[..., None], sent, axis=1)
    inside = hearing & (factors > 0)
    edge = ~inside.any(axis=0)  # all that hear the node are at the edge of their coverage
    factors = np.where(edge, 1.0, factors)
    return np.where(edge, hearing, inside), np.append(factors, np.ones_like(factors[:1]), axis=0)


def _tables(weights: ArrayLike | Mapping[Pattern, ArrayLike], occur: Mask, n: int) -> Array:
    """Return the weights of each pattern side by side (patterns, n, N n + n).

    The last are those of the prediction: I where no cluster hears the node, and else zero.
    """
    clusters = occur.shape[1]
    given = weights if isinstance(weights, Mapping) else {(True,) * clusters: weights}
    checked = {pattern: _checked_weights(pattern, M, clusters, n) for pattern, M in given.items()}
    tables = np.zeros((len(occur), n, clusters + 1, n))
    tables[:, :, -1] = np.eye(n)
    for place, _, M in by_pattern("weights", checked, occur):
        tables[place, :, :-1], tables[place, :, -1] = np.swapaxes(M, 0, 1), 0.0
    return tables.reshape(len(occur), n, (clusters + 1) * n)


def _checked_weights(pattern: Pattern, weights: ArrayLike, clusters: int, n: int) -> Array:
    """Return weights (N, n, n) of sum I, zero for clusters that do not hear the node."""
    M = array("weights", weights, (clusters, n, n))
    off = np.abs(M.sum(axis=0) - np.eye(n)).max()
    deaf = ~np.array(as_pattern("weights", pattern, clusters))
    if off > _ROUNDING * max(1.0, np.abs(M).max()) or M[deaf].any():
        got = Described(f"those for {pattern}")
        wanted = "of sum I, and zero for clusters that do not hear the node"
        raise ParameterError("weights", got, wanted)
    return M


def _mixed(tables: Array, factors: Array | None, parts: Array) -> Array:
    """Return the sum (n, runs) of parts (N + 1, n, runs) with weights (1 or runs, n, N n + n).

    With factors (N + 1, 1 or runs) it is that of the faded weights, divided by their sum.
    """
    if factors is None:
        return times(tables, np.concatenate(parts))
    count, n = len(factors), tables.shape[1]
    weights = tables.reshape(len(tables), n, count, n) * factors.T[:, None, :, None]
    mixed = times(tables, np.concatenate(parts * factors[:, None]))
    return times(np.linalg.inv(weights.sum(axis=2)), mixed)


def _locals(designs: Sequence[Design]) -> tuple[Array, Array, Array]:
    """Return A (n, n), and C (N, m, n) and the gains (N, n, m) of the clusters."""
    models, gains = zip(*(model_and_gain("designs", each) for each in designs), strict=True)
    return common_transition(models), np.stack([model.C for model in models]), np.stack(gains)
