"""Clock, frame, lever arm and ranges of a recording against its reference, with deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array, number, one_of
from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.logs.anchor_bias import bias_of_ranges
from inswsn_lib.logs.blocks import FEWEST, block_starts
from inswsn_lib.logs.model import KINDS, Model, Rows, State
from inswsn_lib.logs.observability import limits_of, refuse
from inswsn_lib.logs.reference_motion import ReferenceMotion
from inswsn_lib.logs.results import Calibration
from inswsn_lib.logs.robust_fit import covariance, deviation_of, fit
from inswsn_lib.logs.start import start_at
from inswsn_lib.streams import Fixes, Ranges, Recording, Reference

#: What may be estimated
UNKNOWNS = ("clock", "rate", "frame", "lever arm", "bias", "scale")

_MARGIN = 0.5  # s, by which clocks may still move


def calibrate(
    recording: Recording,
    estimate: Sequence[str] = ("clock", "frame", "lever arm", "bias"),
    *,
    source: str | None = None,
    block: float = 5.0,
    reach: float = 5.0,
    limits: Mapping[str, float] | None = None,
) -> Calibration:
    r"""Return the unknowns of a set-up that fit best, all at once; refuse those it cannot estimate.

    A range of anchor k that is stamped t is, with the reference's position p and attitude A,

    .. math:: r = (1 + s_k)\, |R (p(t') + A(t')\, l - c) + c + h - a_k| + b_k + e,

    where :math:`t' = t - \mathrm{clock} - \mathrm{rate}\,(t - t_m)`; a fix is the place between the
    bars with :math:`a_k = 0`. The sum of the soft-l1 loss (see `multilaterate_track`) of all e is
    made least by `scipy.optimize.least_squares`, from a clock found by trial and a frame found in
    closed form (Umeyama 1991). The loss's scale is the residuals' own deviation.

    Errors of ranges last for seconds: of anchors that are hidden, of antennas that are turned away.
    So the covariance is a jackknife over blocks of time (Liang and Zeger 1986; MacKinnon, Nielsen
    and Webb 2023), in which errors of one block may hang together in any way. A lever arm and
    errors of an antenna that go with the direction in which it is heard are one and the same to
    ranges.

    Without a reference, only the bias by anchor can be told, from ranges that do not meet in one
    point: the positions of intervals of 0.2 s, or of those longer ones that have enough ranges, are
    unknowns, too.

    Parameters
    ----------
    recording : Recording
        With ranges or fixes, and if more than the bias is asked for, a reference.
    estimate : sequence of str
        Of ``"clock"``, ``"rate"``, ``"frame"``, ``"lever arm"``, ``"bias"``, ``"scale"``. What is
        not asked for is taken as the recording has it; a lever arm in the plane keeps its z.
    source : str, optional
        ``"ranges"`` or ``"fixes"``; by default ranges if there are any. Fixes have no bias and no
        scale.
    block : float
        Length of the blocks, s, longer than errors last; of a short recording, a tenth.
    reach : float
        How late or early the clock may be, s.
    limits : mapping of str to float, optional
        The largest deviation that counts as told, by ``"clock"`` (0.05 s by default), ``"rate"``
        (200, in 1e-6), ``"turn"`` (0.05 rad), ``"scale"`` (0.05), ``"shift"``, ``"lever arm"`` and
        ``"bias"`` (the deviation of one range or fix, m).

    Raises
    ------
    InswsnError
        If the recording cannot tell an unknown; it names it, and why. Singular values of the
        Jacobian tell what depends on nothing, the jackknife what is known too poorly.

    Examples
    --------
    A tag on a circle; its ranges are stamped 30 ms late.

    >>> import numpy as np
    >>> from inswsn_lib.logs import calibrate
    >>> from inswsn_lib.streams import Ranges, Recording, Reference
    >>> def circle(time):
    ...     return np.column_stack([3 * np.cos(time), 2 * np.sin(time)])
    >>> time, stamps = np.arange(0, 40, 0.05), np.arange(1, 39, 0.025)
    >>> anchors = np.array([[5.0, 5.0], [-5.0, 4.0], [-5.0, -5.0], [4.0, -5.0]])
    >>> heard = np.arange(len(stamps)) % 4
    >>> distance = np.linalg.norm(circle(stamps - 0.03) - anchors[heard], axis=1)
    >>> distance += np.random.default_rng(0).normal(0, 0.05, len(stamps))
    >>> made = Recording("circle", ranges=Ranges(stamps, heard, distance, anchors, tuple("abcd")),
    ...     reference=Reference(time, circle(time)))
    >>> value, deviation = calibrate(made, ("clock", "bias")).told["clock"]
    >>> print(f"{value:.3f} s, and known to {deviation:.3f} s")
    0.031 s, and known to 0.001 s
    """
    _check(estimate, block, reach, limits or {})
    chosen = source_of(recording, source)
    if recording.reference is None:
        return _alone(recording, estimate, chosen, block, limits)
    kinds = [kind for each in estimate for kind in _kinds(each)]
    rows = Rows.of(chosen)
    _refuse_missing(recording.reference, kinds, chosen, rows.dimension)
    motion = ReferenceMotion(recording.reference, rows.dimension)
    first = State.nothing(rows, np.array(recording.lever_arm, dtype=float))
    covered = rows.part(motion.covers(rows.time))
    if not len(covered.time):
        raise InswsnError("The reference and what it is compared with share no time.")
    before = deviation_of(Model(motion, covered, []).residual(first))
    state = start_at(motion, rows, chosen, first, kinds, reach)
    margin = _MARGIN if {"clock", "rate"} & set(kinds) else 0.0
    model = Model(motion, rows.part(motion.covers(rows.time - state.clock, margin)), kinds)
    starts = _blocks(model, block)
    state, noise, found = _fitted(model, state, limits, starts)
    return Calibration(
        source="ranges" if isinstance(chosen, Ranges) else "fixes",
        names=tuple(model.names),
        values=_values(model, state),
        covariance=found,
        before=before,
        after=noise,
        blocks=len(starts),
        state=state,
        centre=motion.middle,
        middle=model.middle,
    )


def _check(
    estimate: Sequence[str], block: float, reach: float, limits: Mapping[str, float]
) -> None:
    if isinstance(estimate, str) or not estimate or len(set(estimate)) < len(estimate):
        raise ParameterError("estimate", estimate, "one or more names, none of them twice")
    for each in estimate:
        one_of("estimate", each, UNKNOWNS)
    number("block", block, above=0)
    number("reach", reach, least=0)
    for kind, limit in limits.items():
        one_of("limits", kind, KINDS)
        number(f"the limit of {kind}", limit, above=0)


def _kinds(each: str) -> tuple[str, ...]:
    return ("turn", "shift") if each == "frame" else (each,)


def source_of(recording: Recording, source: str | None) -> Ranges | Fixes:
    """Return the ranges or the fixes of a recording, as asked for."""
    if source is not None:
        one_of("source", source, ("ranges", "fixes"))
    found = getattr(recording, source) if source else recording.ranges or recording.fixes
    if found is None or not len(found):
        raise InswsnError(f"The recording {recording.name} has no {source or 'ranges or fixes'}.")
    return found


def _refuse_missing(
    reference: Reference, kinds: Sequence[str], source: Ranges | Fixes, d: int
) -> None:
    """Refuse what could not be told of any such recording."""
    if reference.position.shape[1] < d:
        raise InswsnError(
            f"The reference has {reference.position.shape[1]} coordinates, and what it is compared "
            f"with has {d}."
        )
    if "lever arm" in kinds and reference.attitude is None:
        raise InswsnError("The reference has no attitude, so the lever arm cannot be told.")
    if isinstance(source, Fixes):
        for kind in {"bias", "scale"} & set(kinds):
            raise InswsnError(f"Fixes have no {kind} by anchor; it takes ranges to tell it.")


def _alone(
    recording: Recording,
    estimate: Sequence[str],
    source: Ranges | Fixes,
    block: float,
    limits: Mapping[str, float] | None,
) -> Calibration:
    if tuple(estimate) != ("bias",) or isinstance(source, Fixes):
        raise InswsnError(
            "Without a reference nothing can be told but the bias by anchor, and that from ranges; "
            'ask for estimate=("bias",).'
        )
    return bias_of_ranges(source, block, (limits or {}).get("bias"))


def _blocks(model: Model, block: float) -> NDArray[np.intp]:
    """Return where the blocks of the model's rows begin; refuse too few rows or blocks."""
    rows = model.rows
    starts = block_starts(rows.time, block) if len(rows.time) else np.arange(0)
    if len(rows.time) <= 2 * len(model.names) or len(starts) < FEWEST:
        raise InswsnError(
            f"There are {len(rows.time)} measurements in {len(starts)} blocks of time while the "
            f"reference is there, too few for {len(model.names)} unknowns: it takes twice as many, "
            f"and {FEWEST} blocks."
        )
    return starts


def _fitted(
    model: Model, state: State, limits: Mapping[str, float] | None, starts: NDArray[np.intp]
) -> tuple[State, float, Array]:
    """Return the best state, the deviation of the residuals, and the covariance; or refuse."""
    miss = model.residual(state)
    for k in model.heard:  # what an anchor has too much must not look like noise at the start
        mine = model.rows.which == k
        miss[mine] -= np.median(miss[mine])
    state, noise = fit(model, state, deviation_of(miss), lambda x: limits_of(model, x))
    found, lost = covariance(model, state, noise, limits_of(model, noise), starts)
    deviations = np.sqrt(np.diag(found))
    deviations[lost] = np.inf
    refuse(model, state, deviations, limits_of(model, noise, limits))
    return state, noise, found


def _values(model: Model, state: State) -> Array:
    """Return the values of the unknowns in the order of the model's names."""
    found: list[float] = []
    for kind in model.kinds:
        if kind == "turn":
            turn = np.eye(3)
            turn[: model.d, : model.d] = state.turn
            vector = Rotation.from_matrix(turn).as_rotvec()
            found += vector.tolist() if model.d == 3 else [float(vector[2])]
        elif kind in {"bias", "scale"}:
            found += getattr(state, kind)[model.heard].tolist()
        elif kind == "lever arm":
            found += state.lever_arm[: model.d].tolist()
        else:
            found += np.atleast_1d(getattr(state, kind)).tolist()
    return np.array(found)
