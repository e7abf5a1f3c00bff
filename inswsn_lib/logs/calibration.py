"""Clock, frame, lever arm and ranges of a recording against its reference, with deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t

from inswsn_lib.checks import Array, number, one_of
from inswsn_lib.errors import Described, InswsnError, ParameterError
from inswsn_lib.logs.blocks import FEWEST, block_starts, covariance, deviation_of, fit
from inswsn_lib.logs.model import KINDS, Meeting, Model, ReferenceMotion, Rows, State
from inswsn_lib.logs.network_fixes import multilaterate_track
from inswsn_lib.logs.window_fits import PERIODS, enough_ranges
from inswsn_lib.streams import Fixes, Ranges, Recording

_UNKNOWNS = ("clock", "rate", "frame", "lever arm", "bias", "scale")
# The largest deviation that counts as told; of lengths it is that of one measurement, or the least
_LIMITS, _LENGTH = {"clock": 0.05, "rate": 200.0, "turn": 0.05, "scale": 0.05}, 0.01
_UNITS = {"clock": "s", "rate": "ppm", "turn": "rad", "scale": ""}  # others are in m
_MARGIN = 0.5  # s, by which clocks may still move
_STEP = 0.1  # s, of the clocks that are tried
_MOST = 500  # rows and fixes that a trial looks at
_SHARED = 0.25  # of them, that a clock must leave


@dataclass(frozen=True, eq=False)
class Calibration:
    """What `calibrate` found.

    Attributes
    ----------
    source : str
        ``"ranges"`` or ``"fixes"``.
    names : tuple of str
        Of the unknowns that were asked for: ``clock`` (s, how late stamps of the source are by the
        reference's clock, at `middle`), ``rate`` (1e-6, how much too fast their clock is), ``turn``
        and ``shift`` (rad and m: the reference is turned about `centre`, then shifted, into the
        frame of anchors or fixes), ``lever arm`` (m, in the axes of the body), ``bias`` (m) and
        ``scale`` of each anchor: a range is (1 + scale) times the distance, and bias.
    values : ndarray, (p,)
        In this order; a turn in space is a rotation vector.
    covariance : ndarray, (p, p)
        Of them; that of a turn is of the small rotation, about the axes of the frame, that is left.
    before, after : float
        Deviation of the residuals by their median absolute value, m: with nothing estimated, and
        with these values.
    blocks : int
        Of time, that the covariance comes from; one more than Student's degrees of freedom.
    state : dataclass
        Values of all unknowns, also of those not asked for; its `turn` is a matrix.
    centre : ndarray, (d,)
        m, in the reference's own frame.
    middle : float
        s.
    """

    source: str
    names: tuple[str, ...]
    values: Array
    covariance: Array
    before: float
    after: float
    blocks: int
    state: State
    centre: Array
    middle: float

    @property
    def deviations(self) -> Array:
        """Standard deviations of the values."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def told(self) -> dict[str, tuple[float, float]]:
        """Value and deviation of each unknown, by its name."""
        pairs = zip(self.values.tolist(), self.deviations.tolist(), strict=True)
        return dict(zip(self.names, pairs, strict=True))

    def intervals(self, level: float = 0.95) -> Array:
        """Return intervals of the values at a level, (p, 2), by Student's distribution."""
        number("level", level, above=0, below=1)
        half = t.ppf((1 + level) / 2, self.blocks - 1) * self.deviations
        return np.column_stack([self.values - half, self.values + half])

    def apply(self, recording: Recording) -> Recording:
        """Return a recording with all of this corrected.

        Stamps of the source are by the reference's clock, the reference is in the frame of anchors
        or fixes, the lever arm is the one found, and ranges are free of bias and scale.
        """
        state, source = self.state, getattr(recording, self.source)
        if source is None:
            raise InswsnError(f"The recording {recording.name} has no {self.source} to correct.")
        source = replace(source, time=source.time - state.late(source.time, self.middle))
        if isinstance(source, Ranges):
            if len(source.anchors) != len(state.bias):
                got = Described(f"one with {len(source.anchors)}")
                raise ParameterError("recording", got, f"one with {len(state.bias)} anchors")
            k = source.anchor
            right = (source.distance - state.bias[k]) / (1 + state.scale[k])
            source = replace(source, distance=right)
        reference = recording.reference
        if reference is not None:
            d, turn, attitude = len(self.centre), np.eye(3), reference.attitude
            turn[:d, :d] = state.turn
            position = reference.position.copy()
            position[:, :d] = (position[:, :d] - self.centre) @ state.turn.T
            position[:, :d] += self.centre + state.shift
            if attitude is not None:
                attitude = (Rotation.from_matrix(turn) * Rotation.from_quat(attitude)).as_quat()
            reference = replace(reference, position=position, attitude=attitude)
        arm = state.lever_arm if "lever arm x" in self.names else recording.lever_arm
        return replace(recording, reference=reference, lever_arm=arm, **{self.source: source})


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
    and Webb 2023). To ranges, a lever arm and errors of an antenna that go with the direction in
    which it is heard are one and the same.

    Without a reference, only the bias by anchor can be told, from ranges that do not meet in one
    point: the positions of intervals of 0.2 s, or longer, are unknowns, too.

    Parameters
    ----------
    recording : Recording
        With ranges or fixes, and if more than the bias is asked for, a reference.
    estimate : sequence of str
        Of ``"clock"``, ``"rate"``, ``"frame"``, ``"lever arm"``, ``"bias"``, ``"scale"`` (the last
        two of ranges). Others are as the recording has them; a lever arm in the plane keeps its z.
    source : str, optional
        ``"ranges"`` or ``"fixes"``; by default ranges if there are any.
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
        If the recording cannot tell an unknown; it names it, and why.

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
    chosen = _source_of(recording, source)
    model, state = _compared(recording, estimate, chosen, reach)
    found = fitted(model, state, block)
    _refuse(model, found, _limits_of(model, found.after, limits))
    return found


def _check(
    estimate: Sequence[str], block: float, reach: float, limits: Mapping[str, float]
) -> None:
    if isinstance(estimate, str) or not estimate or len(set(estimate)) < len(estimate):
        raise ParameterError("estimate", estimate, "one or more names, none of them twice")
    for each in estimate:
        one_of("estimate", each, _UNKNOWNS)
    number("block", block, above=0)
    number("reach", reach, least=0)
    for kind, limit in limits.items():
        one_of("limits", kind, KINDS)
        number(f"the limit of {kind}", limit, above=0)


def _source_of(recording: Recording, source: str | None) -> Ranges | Fixes:
    if source is not None:
        one_of("source", source, ("ranges", "fixes"))
    found = getattr(recording, source) if source else recording.ranges or recording.fixes
    if found is None or not len(found):
        raise InswsnError(f"The recording {recording.name} has no {source or 'ranges or fixes'}.")
    return found


def _compared(
    recording: Recording, estimate: Sequence[str], source: Ranges | Fixes, reach: float
) -> tuple[Model | Meeting, State]:
    """Return what is fitted, and from where; refuse what could be told of no such recording."""
    reference, lever_arm = recording.reference, np.array(recording.lever_arm, dtype=float)
    if reference is None:
        if tuple(estimate) != ("bias",) or isinstance(source, Fixes):
            raise InswsnError(
                "Without a reference nothing can be told but the bias by anchor, and that from "
                'ranges; ask for estimate=("bias",).'
            )
        meeting = Meeting(source)
        return meeting, State.nothing(meeting.rows, lever_arm)
    rows = Rows.of(source)
    if reference.position.shape[1] < rows.dimension:
        raise InswsnError(
            f"The reference has {reference.position.shape[1]} coordinates, and what it is compared "
            f"with has {rows.dimension}."
        )
    if "lever arm" in estimate and reference.attitude is None:
        raise InswsnError("The reference has no attitude, so the lever arm cannot be told.")
    if isinstance(source, Fixes):
        for kind in {"bias", "scale"} & set(estimate):
            raise InswsnError(f"Fixes have no {kind} by anchor; it takes ranges to tell it.")
    motion, state = ReferenceMotion(reference, rows.dimension), State.nothing(rows, lever_arm)
    if not motion.covers(rows.time).any():
        raise InswsnError("The reference and what it is compared with share no time.")
    fixes = None
    if "frame" in estimate:
        fixes = source if isinstance(source, Fixes) else fixes_of(source)
    state = _start(motion, rows, fixes, state, reach if "clock" in estimate else 0.0)
    margin = _MARGIN if {"clock", "rate"} & set(estimate) else 0.0
    rows = rows.part(motion.covers(rows.time - state.clock, margin))
    kinds = {"turn", "shift", *estimate} if "frame" in estimate else estimate
    return Model(motion, rows, kinds), state


def _start(
    motion: ReferenceMotion, rows: Rows, fixes: Fixes | None, first: State, reach: float
) -> State:
    """Return a state near which the best one is, a clock and, where there are fixes, a frame.

    The best of a grid of clocks leaves the least median of the residuals, free of each anchor's
    median. With each, the frame is that which takes the track to fixes.
    """
    rows = rows.part(np.random.default_rng(0).permutation(len(rows.time)) < _MOST)
    if fixes is not None:
        there = np.flatnonzero(np.isfinite(fixes.position).all(axis=1))
        there = there[:: max(1, len(there) // _MOST)]
        fixes = Fixes(fixes.time[there], fixes.position[there])
    count, tried = round(reach / _STEP), []
    for clock in sorted((_STEP * np.arange(-count, count + 1)).tolist(), key=abs):
        state = replace(first, clock=first.clock + clock)
        covered = rows.part(motion.covers(rows.time - state.clock))
        placed = state if fixes is None else _in_frame(motion, fixes, state)
        if placed and len(covered.time) >= _SHARED * len(rows.time):
            miss = covered.level(Model(motion, covered, []).residual(placed))
            tried.append((float(np.median(np.abs(miss))), placed))
    if not tried and fixes is not None:
        raise InswsnError(
            f"The frame cannot be told: there are {len(fixes)} fixes, and too few of them are "
            "while the reference is there."
        )
    return min(tried, key=lambda each: each[0], default=(0.0, first))[1]


def fixes_of(ranges: Ranges) -> Fixes:
    """Return fixes of the shortest intervals of which most have one, or of the longest."""
    period = enough_ranges(ranges) if len(ranges) else None
    return multilaterate_track(ranges, period or PERIODS[-1])


def _in_frame(motion: ReferenceMotion, fixes: Fixes, state: State) -> State | None:
    """Return a state with the rotation and shift that take the track to fixes; None by too few.

    They leave the least squares (Umeyama 1991); the second time without what is far off.
    """
    used = motion.covers(fixes.time - state.clock)
    if used.sum() < max(motion.d + 1, _SHARED * len(fixes)):
        return None
    track = motion.carried(fixes.time[used] - state.clock, state.lever_arm) - motion.middle
    place = fixes.position[used] - motion.middle
    kept = np.ones(len(track), dtype=bool)
    for _ in range(2):
        middle, other = track[kept].mean(axis=0), place[kept].mean(axis=0)
        left, _, right = np.linalg.svd((place[kept] - other).T @ (track[kept] - middle))
        left[:, -1] *= np.linalg.det(left @ right)
        turn: Array = left @ right
        shift = other - turn @ middle
        off = np.linalg.norm(place - track @ turn.T - shift, axis=1)
        kept = off <= 3 * np.median(off) + 1e-12
    return replace(state, turn=turn, shift=shift)


def fitted(model: Model | Meeting, state: State, block: float) -> Calibration:
    """Return the best state near another; what is told by nothing has an infinite deviation."""
    rows = model.rows
    starts = block_starts(rows.time, block) if len(rows.time) else np.arange(0)
    if len(rows.time) <= 2 * len(model.names) or len(starts) < FEWEST:
        raise InswsnError(
            f"There are {len(rows.time)} measurements to be compared in {len(starts)} blocks of "
            f"time, too few for {len(model.names)} unknowns: it takes twice as many, and {FEWEST} "
            "blocks."
        )
    # what an anchor has too much must not look like noise at the start
    noise = deviation_of(rows.level(model.residual(state)))
    before = deviation_of(model.residual(State.nothing(rows, state.lever_arm)))
    state, noise = fit(model, state, noise, lambda noise: _limits_of(model, noise))
    found, lost = covariance(model, state, noise, starts)
    found[lost, lost] = np.inf
    return Calibration(
        source="fixes" if rows.anchors is None else "ranges",
        names=tuple(model.names),
        values=model.values(state),
        covariance=found,
        before=before,
        after=noise,
        blocks=len(starts),
        state=state,
        centre=model.centre,
        middle=model.middle,
    )


def _limits_of(
    model: Model | Meeting, noise: float, given: Mapping[str, float] | None = None
) -> Array:
    """Return the largest deviation of each unknown that counts as told."""
    limits = dict.fromkeys(KINDS, max(noise, _LENGTH)) | _LIMITS | dict(given or {})
    return np.array([limits[kind] for kind in model.kinds])


def _refuse(model: Model | Meeting, found: Calibration, limits: Array) -> None:
    """Raise an error that names the unknowns whose deviation is above its limit, and why."""
    wrong, said = ~(found.deviations <= limits), []
    for kind, entries in model.entries.items():
        own = np.array([each == kind for each in model.kinds])
        mine = np.flatnonzero(own & wrong)
        if not len(mine):
            continue
        worst, unit = float(np.max(found.deviations[mine])), _UNITS.get(kind, "m")
        size = f"its deviation would be {worst:.2g} {unit}, above {limits[mine[0]]:.2g}"
        if np.isinf(worst):
            size = "nothing, or one short time alone, tells it from the others"
        which = ", ".join(found.names[i].removeprefix(kind).strip() for i in mine)
        why = model.why(found.state, kind, entries[wrong[own]])
        said.append(f"{kind} {which}".strip() + f" ({size}; {why})")
    if said:
        raise InswsnError(f"The recording cannot tell {'; '.join(said)}.")
