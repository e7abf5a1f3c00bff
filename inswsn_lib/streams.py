"""One type for recorded data as they were logged: streams, each with its own time stamps.

Nothing is resampled and nothing is put on a grid. All streams of a recording have one frame of
reference, level and right-handed with z up, and metres, seconds, radians. Vectors of the body are
in the IMU's own axes; those of a vehicle are forward, to the left, up.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array, Mask, array, one_of, unmasked
from inswsn_lib.errors import Described, InswsnError, ParameterError

Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Stream:
    """Values with a time stamp each, s, which increase; those of `Ranges` may also repeat."""

    time: Array

    def __post_init__(self) -> None:
        """Check that every array has a row for each time stamp, and that these increase."""
        object.__setattr__(self, "time", array("time", self.time, ("rows",)))
        check_increase(type(self).__name__, self.time, repeats=isinstance(self, Ranges))
        for name, value in list(self._columns()):
            if np.ma.is_masked(value) and value.dtype.kind != "f":  # what cannot be NaN
                raise ParameterError(name, Described("partly masked"), "complete")
            object.__setattr__(self, name, unmasked(value))
            if len(value) != len(self.time):
                raise ParameterError(name, len(value), f"of {len(self.time)} rows, as time is")

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.time)

    def part(self, begin: float = -np.inf, end: float = np.inf) -> Self:
        """Return the rows from a time on and before another, s."""
        return self.kept(slice(*np.searchsorted(self.time, [begin, end]).tolist()))

    def kept(self, rows: slice | Mask) -> Self:
        """Return some of the rows."""
        return replace(self, time=self.time[rows], **{n: v[rows] for n, v in self._columns()})

    def _columns(self) -> Iterator[tuple[str, Array]]:
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name != "time" and each.metadata.get("rows", True) and value is not None:
                yield each.name, value


@dataclass(frozen=True, eq=False)
class Imu(Stream):
    """What an inertial measurement unit measures.

    Attributes
    ----------
    time : ndarray, (rows,)
        s.
    rate : ndarray, (rows, 3)
        Angular rate about the axes of the body, rad/s.
    force : ndarray, (rows, 3)
        Specific force along them, m/s^2; at rest it is gravity's opposite, upwards.
    """

    rate: Array
    force: Array


@dataclass(frozen=True, eq=False)
class Odometry(Stream):
    """What wheels measure, and a gyroscope that turns with them, if there is one.

    Attributes
    ----------
    time : ndarray, (rows,)
        s, the end of the interval that a row speaks of.
    speed : ndarray, (rows,)
        Forward, m/s, the mean of the interval.
    rate : ndarray, (rows,)
        Of the heading, to the left, rad/s, likewise.
    """

    speed: Array
    rate: Array


@dataclass(frozen=True, eq=False)
class Ranges(Stream):
    """Distances to anchors.

    Attributes
    ----------
    time : ndarray, (rows,)
        s.
    anchor : ndarray of int, (rows,)
        Which anchor, a row of `anchors`.
    distance : ndarray, (rows,)
        m.
    anchors : ndarray, (N, 2 or 3)
        Where the anchors are, m.
    names : tuple of str
        What they are called, in the order of `anchors`.
    """

    anchor: Whole
    distance: Array
    anchors: Array = field(metadata={"rows": False})
    names: tuple[str, ...] = field(metadata={"rows": False})


@dataclass(frozen=True, eq=False)
class Fixes(Stream):
    """Positions that were measured.

    Attributes
    ----------
    time : ndarray, (rows,)
        s.
    position : ndarray, (rows, 2 or 3)
        m; NaN where there is none.
    velocity : ndarray, (rows, 2 or 3), or None
        m/s, if it was measured too.
    deviation : ndarray, (rows, 2 or 3), or None
        What the receiver says of its standard deviation, m.
    good : ndarray of bool, (rows,), or None
        Whether a fix is good enough to judge others by, as a satellite fix with whole-number
        ambiguities.
    """

    position: Array
    velocity: Array | None = None
    deviation: Array | None = None
    good: NDArray[np.bool_] | None = None


@dataclass(frozen=True, eq=False)
class Reference(Stream):
    """Where the body was, by a far better instrument.

    Attributes
    ----------
    time : ndarray, (rows,)
        s.
    position : ndarray, (rows, 2 or 3)
        Of the IMU or, where there is none, of what carries the tag, m.
    attitude : ndarray, (rows, 4), or None
        Unit quaternions x, y, z, w that turn vectors of the body into the frame.
    """

    position: Array
    attitude: Array | None = None


@dataclass(frozen=True, eq=False)
class Recording:
    """Recorded data as they were logged.

    Attributes
    ----------
    name : str
        Such as ``"inrol/1"``.
    imu, odometry, ranges, fixes, reference : streams, or None
        Those that there are.
    lever_arm : ndarray, (3,)
        From the IMU, or from what the reference tells of, to the tag or antenna, in the axes of the
        body, m.
    origin : ndarray, (3,), or None
        Latitude, longitude (rad) and height (m) of the origin, if fixes are by satellites; then x
        is east and y north.
    licence : str
        Of the recording.
    source : str
        Where its files come from.
    digests : mapping of str to str
        SHA-256 of each of its files.
    height : float or None
        Of the tag or antenna, m, if it is known and hardly changes.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.streams import Fixes, Recording
    >>> walk = Recording("walk", fixes=Fixes(time=np.arange(5.0), position=np.zeros((5, 2))))
    >>> walk.part(end=2.0).duration
    1.0
    """

    name: str
    imu: Imu | None = None
    odometry: Odometry | None = None
    ranges: Ranges | None = None
    fixes: Fixes | None = None
    reference: Reference | None = None
    lever_arm: Array = field(default_factory=lambda: np.zeros(3))
    origin: Array | None = None
    licence: str = ""
    source: str = ""
    digests: Mapping[str, str] = field(default_factory=dict)
    height: float | None = None

    @property
    def streams(self) -> dict[str, Stream]:
        """The streams that there are, by name."""
        found = {name: getattr(self, name) for name in STREAMS}
        return {name: stream for name, stream in found.items() if stream is not None}

    @property
    def span(self) -> tuple[float, float]:
        """The first and the last time stamp of all streams, s."""
        times = [stream.time for stream in self.streams.values() if len(stream)]
        if not times:
            raise InswsnError(f"The recording {self.name} is empty.")
        return min(float(t[0]) for t in times), max(float(t[-1]) for t in times)

    @property
    def duration(self) -> float:
        """From the first time stamp to the last, s."""
        begin, end = self.span
        return end - begin

    def part(self, begin: float = -np.inf, end: float = np.inf) -> Self:
        """Return what was logged from a time on and before another, s."""
        parts: dict[str, Any] = {n: s.part(begin, end) for n, s in self.streams.items()}
        return replace(self, **parts)

    def without(self, *names: str) -> Self:
        """Return the recording without some of its streams."""
        for name in names:
            one_of("stream", name, STREAMS)
        gone: dict[str, Any] = dict.fromkeys(names)
        return replace(self, **gone)


#: The streams of a recording, by the names of its attributes
STREAMS = ("imu", "odometry", "ranges", "fixes", "reference")


def check_increase(what: str, time: Array, *, repeats: bool = False, first: int = 1) -> None:
    """Refuse time stamps that go back, or repeat where they may not, naming the row.

    Parameters
    ----------
    what : str
        How the sentence begins.
    time : ndarray, (rows,)
        s.
    repeats : bool
        Whether a time stamp may be that of the row before.
    first : int
        The number of the first row.
    """
    steps = np.diff(time)
    wrong = np.flatnonzero(steps < 0 if repeats else steps <= 0)
    if wrong.size:
        row = int(wrong[0]) + 1
        how = "repeats" if steps[row - 1] == 0 else f"goes back by {-steps[row - 1]:.6g} s"
        raise InswsnError(
            f"{what}: the time stamp {how} in row {row + first}; time stamps must increase."
        )
