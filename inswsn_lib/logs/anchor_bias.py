"""The bias of each anchor's ranges, from ranges alone: they should meet in one point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.logs.model import Rows, State, Unknowns
from inswsn_lib.logs.window_fits import (
    PERIODS,
    WindowFit,
    WindowRanges,
    by_window,
    each_row,
    enough_ranges,
    fit_windows,
    mean_times,
    window_ranges,
)
from inswsn_lib.simulation.position_search import squares
from inswsn_lib.streams import Ranges


class Meeting(Unknowns):
    """Ranges of intervals that should meet in points, but for a bias of each anchor.

    The positions are unknowns, too, and eliminated (variable projection, Golub and Pereyra 1973).
    What all anchors have too much is told by how ranges from all around cannot meet.

    Parameters
    ----------
    ranges : Ranges
    """

    def __init__(self, ranges: Ranges) -> None:
        ranges = ranges.kept(np.isfinite(ranges.distance))
        d, period = ranges.anchors.shape[1], enough_ranges(ranges) if len(ranges) else None
        if period is None:
            raise InswsnError(
                f"The bias by anchor cannot be told without a reference: hardly an interval of "
                f"{PERIODS[-1]:g} s has ranges to {d + 1} anchors, so none is redundant."
            )
        windows = window_ranges(ranges, period)
        near = fit_windows(windows)
        self._windows = windows._replace(place=windows.place - _moved(windows, near))
        self._near, self._good = near, each_row(windows, ~near.bad)
        time = each_row(windows, np.minimum.reduceat(windows.time, windows.windows))
        ones = np.ones(len(time))
        rows = Rows(time, windows.anchor, windows.distance, ones, ranges.anchors, ranges.names, d)
        super().__init__(rows.part(self._good), ["bias"])
        self.centre = np.zeros(d)
        # residuals that are as large as if positions were known
        taken = d * int((~near.bad).sum()) / max(1, len(self.rows.time))
        self._size = 1 / np.sqrt(max(1 - taken, 1e-3))
        self._last: tuple[Array, WindowFit] | None = None

    def _fit(self, bias: Array) -> WindowFit:
        if self._last is None or not np.array_equal(self._last[0], bias):
            free = self._windows.distance - bias[self._windows.anchor]
            found = fit_windows(self._windows._replace(distance=free), near=self._near)
            self._last = (bias, found)
        return self._last[1]

    def residual(self, state: State) -> Array:
        """Return what ranges have more than the distances from the points where they meet best."""
        return np.asarray(self._size * self._fit(state.bias).miss[self._good])

    def jacobian(self, state: State) -> Array:
        """Return the derivatives of the residuals, (rows, anchors), as positions follow."""
        rows, fit = self._windows, self._fit(state.bias)
        own, bend = rows.anchor[:, None] == self.entries["bias"], fit.weight[:, None, None] ** 3
        H = by_window(rows, bend * squares(fit.direction))
        C = by_window(rows, bend * fit.direction[:, :, None] * own[:, None, :])
        follows = each_row(rows, np.linalg.pinv(H, hermitian=True) @ C)
        followed = np.einsum("nd,ndh->nh", fit.direction, follows)
        return np.asarray(self._size * (followed - own)[self._good])

    def why(self, state: State, kind: str, entries: NDArray[np.intp]) -> str:
        """Return what there is too little of."""
        return "the tag hears too few anchors, or too seldom, or hardly moves among them"


def _moved(rows: WindowRanges, fit: WindowFit) -> Array:
    """Return how far the tag is, at each range, from where it is at the mean of its interval.

    A range from a place that moves is one from the mean place to an anchor that moves the other
    way. The velocity is that between the intervals before and after, where both have a position.
    """
    time = mean_times(rows)
    velocity = np.zeros_like(fit.position)
    if len(time) > 2:
        lasted = (time[2:] - time[:-2])[:, None]
        near = (lasted[:, 0] <= 3 * np.median(lasted)) & ~fit.bad[2:] & ~fit.bad[:-2]
        velocity[1:-1] = np.where(near[:, None], (fit.position[2:] - fit.position[:-2]) / lasted, 0)
    after = rows.time - each_row(rows, time)
    return np.asarray(each_row(rows, velocity) * after[:, None])
