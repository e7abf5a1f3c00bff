r"""Constant-gain filters in the clusters of a network, and a centre that weighs what they say.

Each cluster c predicts with its own gain (P2 4),

.. math::
    \hat x_{c,k+1} = A \hat x_{c,k} + K_c (y_{c,k} - C_c \hat x_{c,k}) ,

and the centre fuses the predictions with matrix weights of sum I. As P2 prints it, the weights are
constant. A cluster that does not hear the blind node then predicts on without measurements, and,
since A is not stable, takes the fused estimate with it. The hand-overs here repair that.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters.inputs import (
    as_floats,
    checked_clusters,
    checked_mask,
    first_state,
    is_one_of,
)
from inswsn_lib.lmi import FilterDesign, design_fusion
from inswsn_lib.lmi.designs import Solver
from inswsn_lib.lmi.fusion import check_options
from inswsn_lib.models import ErrorModel

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Numbers = NDArray[np.int64]
Design = FilterDesign | tuple[ErrorModel, Array]
Handover = Literal["restart", "constant", "fading"]
# which clusters hear the blind node
Pattern = tuple[bool, ...]

_ROUNDING = 1e-6
_DESIGNS = "filters, each a FilterDesign or a tuple of an ErrorModel and a gain"
_MOST_CLUSTERS = 62  # bits of an int64 that stand for those that hear the node


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
    predicted: bool = True,
) -> Array:
    r"""Run the filters of all clusters (P2 4) and fuse their predictions over many runs at once.

    .. math::
        \hat x_{c,k+1} = A \hat x_{c,k} + K_c (y_{c,k} - C_c \hat x_{c,k}), \qquad
        \hat x_{k+1} = \sum_c M_c \hat x_{c,k+1}

    Where a component of y is missing, its prediction stands in for it. A cluster hears the blind
    node where any component is there.

    - Hand-over "constant": the weights are those given, whoever hears the node. A cluster that
      does not hear it predicts on from its own state. P2 prints this.
    - Hand-over "restart": the weights are those of the pattern of the step, and are zero for
      clusters that do not hear the node. Their local state is set to the fused one, so that one
      that returns starts from there. Where none hears it, the fused estimate is predicted.
    - Hand-over "fading": as "restart", with the weights :math:`(\sum_b W_b)^{-1} W_c`, where
      :math:`W_c = \mu_c M_c` and :math:`\mu_c` is the margin of the cluster. One with margin 0
      counts as not heard for the weights; if all that hear the node have margin 0, margins are
      left out.

    The centre works with the last message that it has of each cluster: the prediction
    :math:`\hat x_{c,j+1}` of the step j it was sent at, carried to the present by A, with the
    cluster's word on whether it heard the node at step j, and with what margin. A cluster of which
    nothing has arrived yet stands for the initial state and counts as not heard. The way back is
    neither lost nor delayed: with "restart" and "fading" a cluster that does not hear the node at
    step k takes the fused prediction that the centre makes at step k, whatever that was made from.

    Parameters
    ----------
    designs : sequence of FilterDesign, or of tuples of ErrorModel and ndarray (n, m)
        The filters of the N clusters: designs, or models with gains; A is the same in all.
    measurements : array_like, (N, steps, m, runs)
        y of each cluster; NaN where missing.
    weights : array_like, (N, n, n), or mapping of tuple of N bools to array_like, (N, n, n)
        M of each cluster, of sum I; by pattern of the clusters that hear the node, zero for the
        others. An array alone is for the pattern in which all do. "constant" takes only an array.
    handover : {"restart", "constant", "fading"}
        See above.
    margins : array_like, (N, steps) or (N, steps, runs), optional
        For "fading": how far inside the coverage of each cluster the node is, from 0 to 1.
    lost : array_like of bool, (N, steps, runs), optional
        Whether the message that a cluster sends at a step never arrives. Default: all arrive.
    delay : int or sequence of N ints
        Steps from sending to arrival.
    initial_state : array_like, (n,) or (n, runs), optional
        Default: zero.
    predicted : bool
        ``estimates[k]`` is the fused prediction made at step k - 1, and the initial state for
        k = 0. Otherwise it is :math:`A^{-1}` times that made at step k, which uses step k.

    Returns
    -------
    ndarray, (steps, n, runs)

    Raises
    ------
    ParameterError
        If a shape does not fit, something is not numbers, a measurement is infinite, there are
        more than 62 clusters, the transitions differ, weights do not add up to I or are not zero
        where they must be, a pattern is no tuple of bools or occurs and has no weights, margins
        are outside [0, 1] or make the weights singular, a delay is negative, the hand-over is none
        of those above, or A^-1 is needed and does not exist.

    Examples
    --------
    Two clusters with deadbeat gains and equal weights measure a random walk at 2 m and at 4 m. Then
    the second no longer hears it. With "restart" its weight goes to the first, as the weights by
    pattern say; as P2 prints it, the centre goes on with half of the 4 m that the second had:

    >>> import numpy as np
    >>> from inswsn_lib.filters import run_distributed
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> filters = [(model, np.array([[1.0]]))] * 2
    >>> y = np.array([[2.0, 2.0, 2.0], [4.0, np.nan, np.nan]]).reshape(2, 3, 1, 1)
    >>> half = [[[0.5]], [[0.5]]]
    >>> weights = {(True, True): half, (True, False): [[[1.0]], [[0.0]]]}
    >>> run_distributed(filters, y, weights=weights).ravel().tolist()
    [0.0, 3.0, 2.0]
    >>> run_distributed(filters, y, weights=half, handover="constant").ravel().tolist()
    [0.0, 3.0, 3.0]
    """
    if not is_one_of(handover, get_args(Handover)):
        raise ParameterError("handover", handover, '"restart", "constant" or "fading"')
    A, C, gains = _locals(designs)
    y = _few_clusters(checked_clusters(measurements, C.shape[1], len(C)))
    steps, runs = y.shape[1], y.shape[3]
    start = first_state(initial_state, len(A), runs)
    _check_inverse(A, predicted)
    there = ~np.isnan(y)
    heard = np.asarray(there.any(axis=2))
    delays = _delays(delay, len(C))
    gone = None if lost is None else checked_mask("lost", lost, heard.shape)
    centre = _centre(weights, len(A), handover, margins, heard, gone, delays)
    post = _Post(A, start, len(C), gone, delays)
    known, complete = np.nan_to_num(y), bool(there.all())
    x, fused = np.repeat(start[None], len(C), axis=0), start
    estimates = np.empty((steps, *start.shape))
    for k in range(steps):
        if predicted:
            estimates[k] = fused
        innovation = known[:, k] - C @ x
        x = A @ x + gains @ (innovation if complete else innovation * there[:, k])
        fused = centre.fused(k, post.delivered(k, x), A @ fused)
        if handover != "constant" and not complete:
            x = np.where(heard[:, k, None, :], x, fused)
        if not predicted:
            estimates[k] = fused
    return estimates if predicted else np.asarray(np.linalg.inv(A) @ estimates)


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
    measurements : array_like, (N, steps, m, runs)
        y of each cluster; NaN where missing.
    margins, lost, delay
        As in `run_distributed`. They change the patterns that the centre knows of.

    Returns
    -------
    list of tuples of N bools
        Sorted, without the pattern in which no cluster hears the node.

    Raises
    ------
    ParameterError
        See `run_distributed`.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.filters import patterns_of
    >>> y = np.array([[2.0, 2.0, np.nan], [4.0, np.nan, np.nan]]).reshape(2, 3, 1, 1)
    >>> patterns_of(y)
    [(True, False), (True, True)]
    """
    y = _few_clusters(checked_clusters(measurements))
    heard = np.asarray((~np.isnan(y)).any(axis=2))
    delays = _delays(delay, len(heard))
    gone = None if lost is None else checked_mask("lost", lost, heard.shape)
    given = None if margins is None else _margins(margins, heard.shape)
    known, _ = _known(heard, given, gone, delays)
    codes = np.unique(_codes(known))
    return sorted(_pattern(code, len(heard)) for code in codes if code)


def handover_weights(
    designs: Sequence[FilterDesign],
    patterns: Iterable[Pattern],
    noise: Literal["common", "independent"] = "common",
    structure: Literal["full", "block"] = "full",
    margin: float = 0.01,
    *,
    solver: Solver | tuple[Solver, ...] = "clarabel",
) -> dict[Pattern, Array]:
    """Design the weights of the centre for each pattern of clusters that hear the node.

    Parameters
    ----------
    designs : sequence of FilterDesign
        The filters of the N clusters.
    patterns : iterable of tuples of N bools
        For example from `patterns_of`.
    noise, structure, margin, solver
        See `inswsn_lib.lmi.design_fusion`, which designs the weights of the clusters that hear the
        node. One that hears it alone has the weight I.

    Returns
    -------
    dict of tuple of N bools to ndarray, (N, n, n)
        Zero for clusters that do not hear the node.

    Raises
    ------
    InfeasibleDesignError
        See `inswsn_lib.lmi.design_fusion`.
    ParameterError
        If a pattern is no tuple of N bools or none of them is true, the designs do not fit
        together, or noise, structure or margin is none that `inswsn_lib.lmi.design_fusion` takes.

    Examples
    --------
    Two equal clusters share the weight, and one that hears the node alone has all of it:

    >>> from inswsn_lib.filters import handover_weights
    >>> from inswsn_lib.lmi import design_filter
    >>> from inswsn_lib.models import ErrorModel
    >>> model = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> designs = [design_filter(model)] * 2
    >>> weights = handover_weights(designs, [(True, True), (False, True)])
    >>> for pattern, M in weights.items():
    ...     print(pattern, [f"{abs(weight):.3f}" for weight in M.ravel()])
    (True, True) ['0.500', '0.500']
    (False, True) ['0.000', '1.000']
    """
    A, C, _ = _locals(designs)
    check_options(noise, structure, margin)
    clusters, n = len(C), len(A)
    if not isinstance(patterns, Iterable):
        raise ParameterError("patterns", patterns, f"tuples of {clusters} bools")
    found: dict[Pattern, Array] = {}
    for given in patterns:
        pattern = _checked_pattern("patterns", given, clusters)
        members = [c for c, hears in enumerate(pattern) if hears]
        found[pattern] = np.zeros((clusters, n, n))
        if len(members) == 1:
            found[pattern][members[0]] = np.eye(n)
        else:
            chosen = [designs[c] for c in members]
            fusion = design_fusion(chosen, noise, structure, margin=margin, solver=solver)
            found[pattern][members] = fusion.weights
    return found


def run_switched(
    designs: Mapping[Pattern, Design],
    measurements: ArrayLike,
    *,
    initial_state: ArrayLike | None = None,
    predicted: bool = True,
) -> Array:
    r"""Run the filter of all measurements, with a gain for each pattern of clusters that measure.

    With C and y stacked over the clusters that hear the node at step k,

    .. math::
        \hat x_{k+1} = A \hat x_k + K_{\mathrm{pattern}} (y_k - C \hat x_k) .

    Where a component of these is missing, its prediction stands in for it. Where no cluster hears
    the node, :math:`\hat x_{k+1} = A \hat x_k`.

    Parameters
    ----------
    designs : mapping of tuple of N bools to FilterDesign or tuple of ErrorModel and ndarray
        For each pattern the filter: C (m h, n) and a gain (n, m h), for the h clusters that hear
        the node, in order; A is the same in all.
    measurements : array_like, (N, steps, m, runs)
        y of each cluster; NaN where missing, and where it does not reach the centre.
    initial_state : array_like, (n,) or (n, runs), optional
        Default: zero.
    predicted : bool
        Whether ``estimates[k]`` uses only the measurements before step k. Otherwise it uses those
        of step k as well: :math:`A^{-1} \hat x_{k+1}`.

    Returns
    -------
    ndarray, (steps, n, runs)

    Raises
    ------
    ParameterError
        If a shape does not fit, something is not numbers, a measurement is infinite, there are
        more than 62 clusters, the transitions differ, a pattern is no tuple of bools or occurs and
        has no design, or A^-1 is needed and does not exist.

    Examples
    --------
    A filter for two clusters and one for the first alone, with gains that carry the mean of what
    is measured to the next step:

    >>> import numpy as np
    >>> from inswsn_lib.filters import run_switched
    >>> from inswsn_lib.models import ErrorModel
    >>> one = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], L=[[1]], E=[[0]], period=1.0)
    >>> two = ErrorModel(A=[[1]], B=[[1]], C=[[1], [1]], D=np.eye(2), L=[[1]], E=[[0]], period=1.0)
    >>> filters = {
    ...     (True, True): (two, np.array([[0.5, 0.5]])),
    ...     (True, False): (one, np.array([[1.0]])),
    ... }
    >>> y = np.array([[2.0, 5.0, 2.0], [4.0, np.nan, 2.0]]).reshape(2, 3, 1, 1)
    >>> run_switched(filters, y).ravel().tolist()
    [0.0, 3.0, 5.0]
    """
    y = _few_clusters(checked_clusters(measurements))
    clusters, steps, outputs, runs = y.shape
    A, codes, C, gains = _stacked(designs, clusters, outputs)
    _check_inverse(A, predicted)
    x = first_state(initial_state, len(A), runs)
    there = ~np.isnan(y)
    which = _looked_up("designs", _codes(np.asarray(there.any(axis=2))), codes, clusters)
    together = (which == which[:, :1]).all(axis=1)
    estimates = np.empty((steps, *x.shape))
    for k in range(steps):
        use = which[k, :1] if together[k] else which[k]
        measured = np.concatenate(np.where(there[:, k], y[:, k], 0.0))
        innovation = measured - _applied(C, use, x)
        ahead = A @ x + _applied(gains, use, innovation * np.concatenate(there[:, k]))
        estimates[k] = x if predicted else ahead
        x = ahead
    return estimates if predicted else np.asarray(np.linalg.inv(A) @ estimates)


class _Post:
    """The messages on their way to the centre, and the last ones that have arrived there.

    Parameters
    ----------
    A : ndarray, (n, n)
        With which the centre carries a message from step to step.
    start : ndarray, (n, runs)
        What stands for a message before the first arrives.
    clusters : int
        N.
    lost : ndarray of bool, (N, steps, runs), or None
        By step of sending.
    delays : tuple of N ints
        Steps from sending to arrival.
    """

    def __init__(
        self, A: Array, start: Array, clusters: int, lost: Mask | None, delays: tuple[int, ...]
    ) -> None:
        self._A, self._lost, self._delays = A, lost, delays
        self._at_once = lost is None and not any(delays)
        self._held = np.repeat(start[None], clusters, axis=0)
        self._sent: deque[Array] = deque(maxlen=max(delays) + 1)
        self._powers = [np.linalg.matrix_power(A, delay) for delay in delays]

    def delivered(self, k: int, sent: Array) -> Array:
        """Return what the centre has of each cluster (N, n, runs) once that of step k is sent."""
        if self._at_once:
            return sent
        self._sent.append(sent)
        self._held = self._A @ self._held
        for c, delay in enumerate(self._delays):
            if delay > k:
                continue
            arrived = self._powers[c] @ self._sent[-1 - delay][c]
            gone = False if self._lost is None else self._lost[c, k - delay]
            self._held[c] = np.where(gone, self._held[c], arrived)
        return self._held


@dataclass(frozen=True, eq=False)
class _Centre:
    """The weights of every step.

    Attributes
    ----------
    tables : ndarray, (P, n, N n)
        The weights of each pattern side by side; the first are zeros, for no cluster.
    which : ndarray of int, (steps, runs)
        The pattern of each step.
    together : ndarray of bool, (steps,)
        Whether all runs have the same.
    margins : ndarray, (N, steps, 1 or runs), or None
        Of the clusters, for fading weights.
    """

    tables: Array
    which: NDArray[np.intp]
    together: Mask
    margins: Array | None

    def fused(self, k: int, states: Array, predicted: Array) -> Array:
        """Return the fused state from those of the clusters (N, n, runs); `predicted` if none."""
        use = self.which[k, :1] if self.together[k] else self.which[k]
        faded = states
        if self.margins is not None:
            faded = states * self.margins[:, k, None, :]
        mixed = _applied(self.tables, use, np.concatenate(faded))
        if self.margins is not None:
            mixed = self._normalised(use, self.margins[:, k], mixed)
        return np.where(use == 0, predicted, mixed)

    def _normalised(self, use: NDArray[np.intp], margins: Array, mixed: Array) -> Array:
        """Divide by the sum of the faded weights."""
        clusters, n = len(margins), len(mixed)
        weights = self.tables[use].reshape(len(use), n, clusters, n)
        sums = (weights * margins.T[:, None, :, None]).sum(axis=2)
        sums[np.broadcast_to(use == 0, len(sums))] = np.eye(n)
        # one matrix for all runs, or one each
        sides = mixed[None] if len(sums) == 1 else mixed.T[:, :, None]
        try:
            solved = np.linalg.solve(sums, sides)
        except np.linalg.LinAlgError:
            raise ParameterError(
                "margins", "such that the sum of the faded weights is singular", "others"
            ) from None
        return np.asarray(solved[0] if len(sums) == 1 else solved[:, :, 0].T)


def _centre(
    weights: ArrayLike | Mapping[Pattern, ArrayLike],
    n: int,
    handover: Handover,
    margins: ArrayLike | None,
    heard: Mask,
    lost: Mask | None,
    delays: tuple[int, ...],
) -> _Centre:
    """Return the weights of every step, checked."""
    clusters = len(heard)
    if (handover == "fading") != (margins is not None):
        raise ParameterError(
            "margins",
            "missing" if margins is None else "given",
            'given where handover is "fading", and only there',
        )
    if handover == "constant":
        if isinstance(weights, Mapping):
            raise ParameterError(
                "weights", "a mapping", 'one array of weights where handover is "constant"'
            )
        heard, lost, delays = np.ones_like(heard), None, (0,) * clusters
    if not isinstance(weights, Mapping):
        weights = {(True,) * clusters: weights}
    codes, tables = _weights(weights, clusters, n)
    given = None if margins is None else _margins(margins, heard.shape)
    known, faded = _known(heard, given, lost, delays)
    which = _looked_up("weights", _codes(known), codes, clusters)
    return _Centre(tables, which, (which == which[:, :1]).all(axis=1), faded)


def _known(
    heard: Mask, margins: Array | None, lost: Mask | None, delays: tuple[int, ...]
) -> tuple[Mask, Array | None]:
    """Return which clusters count as heard (N, steps, runs), and their margins, at the centre."""
    if lost is not None or any(delays):
        sent = _sent_at(heard.shape, lost, delays)
        arrived, index = sent >= 0, np.maximum(sent, 0)
        heard = np.take_along_axis(heard, index, axis=1) & arrived
        if margins is not None:
            margins = np.take_along_axis(np.broadcast_to(margins, heard.shape), index, axis=1)
    if margins is None:
        return heard, None
    inside = heard & (margins > 0)
    unfaded = ~inside.any(axis=0)  # all that hear the node are at the edge
    faded = np.where(unfaded, 1.0, np.broadcast_to(margins, heard.shape))
    if faded.size and (faded == faded[..., :1]).all():
        faded = faded[..., :1]
    return np.where(unfaded, heard, inside), faded


def _sent_at(shape: tuple[int, ...], lost: Mask | None, delays: tuple[int, ...]) -> Numbers:
    """Return the step at which the last message at the centre was sent (N, steps, runs), or -1."""
    steps = shape[1]
    sent = np.broadcast_to(np.arange(steps)[:, None], shape)
    if lost is not None:
        sent = np.maximum.accumulate(np.where(lost, -1, sent), axis=1)
    arrived = np.full(shape, -1)
    for c, delay in enumerate(delays):
        arrived[c, delay:] = sent[c, : max(steps - delay, 0)]
    return arrived


def _parts(design: Design) -> tuple[ErrorModel, Array]:
    """Return the model and the gain of a filter, checked."""
    if isinstance(design, FilterDesign):
        model, given = design.model, design.gain
    elif isinstance(design, tuple) and len(design) == 2 and isinstance(design[0], ErrorModel):
        model, given = design
    else:
        raise ParameterError("designs", f"with {type(design).__name__}", _DESIGNS)
    shape = len(model.A), len(model.C)
    gain = as_floats("designs", given, f"with gains that are finite, {shape}")
    if gain.shape != shape or not np.isfinite(gain).all():
        raise ParameterError("designs", f"with a gain of shape {gain.shape}", f"finite, {shape}")
    return model, gain


def _locals(designs: Sequence[Design]) -> tuple[Array, Array, Array]:
    """Return A (n, n), and C (N, m, n) and the gains (N, n, m) of the clusters."""
    if not isinstance(designs, Sequence):
        raise ParameterError("designs", designs, _DESIGNS)
    if not designs:
        raise ParameterError("designs", "empty", "one filter a cluster")
    parts = [_parts(design) for design in designs]
    A = _transition([model for model, _ in parts])
    if len({model.C.shape for model, _ in parts}) > 1:
        raise ParameterError(
            "designs", "with C of different shapes", "filters with as many measurements each"
        )
    return A, np.stack([model.C for model, _ in parts]), np.stack([gain for _, gain in parts])


def _transition(models: Sequence[ErrorModel]) -> Array:
    """Return the transition that all models have."""
    A = models[0].A
    if any(not np.array_equal(model.A, A) for model in models):
        raise ParameterError("designs", "with different transitions A", "filters of the same A")
    return A


def _stacked(
    designs: Mapping[Pattern, Design], clusters: int, outputs: int
) -> tuple[Array, Numbers, Array, Array]:
    """Return A, the codes of the patterns, and their C (P, N m, n) and gains (P, n, N m).

    They are zero where a cluster does not hear the node; the first pattern is that of no cluster.
    """
    if not isinstance(designs, Mapping):
        raise ParameterError("designs", designs, "a mapping of patterns to filters")
    if not designs:
        raise ParameterError("designs", "empty", "one filter a pattern")
    parts = {
        _checked_pattern("designs", pattern, clusters): _parts(design)
        for pattern, design in designs.items()
    }
    A = _transition([model for model, _ in parts.values()])
    C = np.zeros((len(parts) + 1, clusters * outputs, len(A)))
    for place, (pattern, (model, _)) in enumerate(parts.items(), 1):
        rows = np.repeat(pattern, outputs)
        if len(model.C) != rows.sum():
            raise ParameterError(
                "designs",
                f"with {len(model.C)} measurements for {pattern}",
                f"with {rows.sum()}: {outputs} for each cluster that hears the node",
            )
        C[place, rows] = model.C
    gains = np.zeros((len(C), len(A), clusters * outputs))
    for place, (pattern, (_, gain)) in enumerate(parts.items(), 1):
        gains[place][:, np.repeat(pattern, outputs)] = gain
    return A, np.array([0, *map(_code, parts)]), C, gains


def _weights(weights: Mapping[Pattern, ArrayLike], clusters: int, n: int) -> tuple[Numbers, Array]:
    """Return the codes of the patterns and their weights (P, n, N n); the first is no cluster."""
    codes, tables = [0], [np.zeros((n, clusters * n))]
    for key, given in weights.items():
        pattern, may_be = _checked_pattern("weights", key, clusters), f"finite, {(clusters, n, n)}"
        M = as_floats("weights", given, may_be)
        if M.shape != (clusters, n, n) or not np.isfinite(M).all():
            raise ParameterError("weights", f"of shape {M.shape} for {pattern}", may_be)
        if np.abs(M.sum(axis=0) - np.eye(n)).max() > _ROUNDING * max(1.0, np.abs(M).max()):
            raise ParameterError("weights", f"of another sum for {pattern}", "of sum I")
        if M[~np.array(pattern)].any():
            raise ParameterError(
                "weights",
                f"not zero for a cluster that does not hear the node in {pattern}",
                "zero there",
            )
        codes.append(_code(pattern))
        tables.append(np.hstack(list(M)))
    return np.array(codes), np.stack(tables)


def _checked_pattern(name: str, given: Pattern, clusters: int) -> Pattern:
    bools = isinstance(given, tuple) and all(isinstance(hears, bool | np.bool_) for hears in given)
    if not bools or len(given) != clusters or not any(given):
        raise ParameterError(
            name,
            f"for the pattern {given}",
            f"for tuples of {clusters} bools of which one or more is true",
        )
    return tuple(bool(hears) for hears in given)


def _few_clusters(measurements: Array) -> Array:
    """Return measurements (N, steps, m, runs) as they are; refuse those of too many clusters."""
    if len(measurements) > _MOST_CLUSTERS:
        raise ParameterError(
            "measurements",
            f"of {len(measurements)} clusters",
            f"of {_MOST_CLUSTERS} clusters at most",
        )
    return measurements


def _margins(margins: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return margins as (N, steps, 1 or runs), checked."""
    may_be = f"numbers {shape[:2]} or {shape}"
    given = as_floats("margins", margins, may_be)
    if given.shape not in (shape, shape[:2]):
        raise ParameterError("margins", f"of shape {given.shape}", may_be)
    if not ((given >= 0) & (given <= 1)).all():
        raise ParameterError("margins", "outside [0, 1]", "from 0 to 1")
    return given if given.ndim == 3 else given[..., None]


def _delays(delay: int | Sequence[int], clusters: int) -> tuple[int, ...]:
    """Return the delay of each cluster, checked."""
    may_be = f"a whole number of steps or {clusters}, 0 or more"
    try:
        given = np.asarray(delay)
    except (TypeError, ValueError):  # rows of unequal length
        raise ParameterError("delay", delay, may_be) from None
    whole = given.dtype.kind in "iu" and given.shape in ((), (clusters,))
    if not whole or given.min() < 0:
        raise ParameterError("delay", delay, may_be)
    return tuple(int(steps) for steps in np.broadcast_to(given, clusters))


def _check_inverse(A: Array, predicted: bool) -> None:
    if not predicted and np.linalg.matrix_rank(A) < len(A):
        raise ParameterError("predicted", predicted, "true, since A cannot be inverted")


def _code(pattern: Pattern) -> int:
    return sum(1 << c for c, hears in enumerate(pattern) if hears)


def _pattern(code: int, clusters: int) -> Pattern:
    return tuple(bool(code >> c & 1) for c in range(clusters))


def _codes(heard: Mask) -> Numbers:
    """Return the code of the clusters (N, steps, runs) that hear the node, (steps, runs)."""
    powers = 1 << np.arange(len(heard), dtype=np.int64)
    return np.asarray(np.tensordot(powers, heard, axes=1), dtype=np.int64)


def _looked_up(name: str, codes: Numbers, known: Numbers, clusters: int) -> NDArray[np.intp]:
    """Return the places of codes among those known; refuse one that is not there."""
    order = np.argsort(known)
    place = np.minimum(np.searchsorted(known[order], codes), len(known) - 1)
    which = order[place]
    absent = known[which] != codes
    if absent.any():
        pattern = _pattern(int(codes[absent][0]), clusters)
        raise ParameterError(name, f"without the pattern {pattern}", "complete for all that occur")
    return np.asarray(which)


def _applied(tables: Array, use: NDArray[np.intp], vectors: Array) -> Array:
    """Return tables[use] (1 or runs of (i, j)) times vectors (j, runs)."""
    if len(use) == 1:
        return np.asarray(tables[use[0]] @ vectors)
    return np.asarray((tables[use] @ vectors.T[:, :, None])[:, :, 0].T)
