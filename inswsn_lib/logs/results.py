"""What a calibration found, and recordings corrected by it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import t

from inswsn_lib.checks import Array, number
from inswsn_lib.errors import Described, InswsnError, ParameterError
from inswsn_lib.logs.model import State
from inswsn_lib.streams import Ranges, Recording, Reference


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
        How many blocks of time the covariance comes from; 1 less are the degrees of freedom of
        Student's distribution.
    state : dataclass
        Values of all unknowns, also of those not asked for; its `turn` is a matrix.
    centre : ndarray, (d,)
        m, in the reference's own frame.
    middle : float
        s.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.logs import Calibration
    >>> from inswsn_lib.logs.model import State
    >>> none = np.zeros(0)
    >>> state = State(0.012, 0.0, np.eye(2), np.zeros(2), np.zeros(3), bias=none, scale=none)
    >>> found = Calibration("ranges", ("clock",), np.array([0.012]), np.array([[4e-6]]), 0.1, 0.08,
    ...     blocks=30, state=state, centre=np.zeros(2), middle=0.0)
    >>> found.told
    {'clock': (0.012, 0.002)}
    >>> print(found.intervals(0.95).round(4))
    [[0.0079 0.0161]]
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
        late = state.clock + 1e-6 * state.rate * (source.time - self.middle)
        source = replace(source, time=source.time - late)
        if isinstance(source, Ranges):
            if len(source.anchors) != len(state.bias):
                got = Described(f"one with {len(source.anchors)}")
                raise ParameterError("recording", got, f"one with {len(state.bias)} anchors")
            k = source.anchor
            right = (source.distance - state.bias[k]) / (1 + state.scale[k])
            source = replace(source, distance=right)
        reference = recording.reference
        if reference is not None:
            reference = _moved(reference, state, self.centre)
        corrected = replace(recording, reference=reference)
        if "lever arm x" in self.names:
            corrected = replace(corrected, lever_arm=state.lever_arm)
        return replace(corrected, **{self.source: source})


def _moved(reference: Reference, state: State, centre: Array) -> Reference:
    """Return a reference in the frame of anchors or fixes."""
    d, turn = len(centre), np.eye(3)
    turn[:d, :d] = state.turn
    position = reference.position.copy()
    position[:, :d] = (position[:, :d] - centre) @ state.turn.T + centre + state.shift
    attitude = reference.attitude
    if attitude is not None:
        attitude = (Rotation.from_matrix(turn) * Rotation.from_quat(attitude)).as_quat()
    return replace(reference, position=position, attitude=attitude)
