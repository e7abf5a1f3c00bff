"""P1's form on a recording: filters of the difference of an INS that drifts and a network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.filters import deadbeat_gain, gating, huber, run_hinfinity, run_kalman, run_robust
from inswsn_lib.filters.robust import Policy
from inswsn_lib.lmi import InfeasibleDesignError, design_filter
from inswsn_lib.logs.estimates import Estimate
from inswsn_lib.models import ErrorModel

_UNKNOWN = 1e6 * np.eye(4)

# The deviation of the INS's acceleration, m/s^2, where fixes have 0.1 m, and by how many times 0.1
# that of the network's velocity, m/s; then the margin above the least gamma, Huber's threshold, or
# the share of good measurements that a gate gives away.
_TWO = (0.5, 1.0)
#: Filters of P1's form, and the numbers where the search for theirs begins
FAMILIES = {
    "KF": _TWO,
    "HF": (*_TWO, 1.0),
    "KF, Huber update": (*_TWO, 1.345),
    "KF, gating": (*_TWO, 1e-3),
}


@dataclass(frozen=True, eq=False)
class DifferenceFilters:
    """Filters of P1's model, whose measurement is INS less network.

    Attributes
    ----------
    ins, network : ndarray, (fixes, 4)
        Horizontal positions (m) and velocities (m/s); NaN where there is none.
    period : float
        Of fixes, s; P1's model takes steps for even.
    """

    ins: Array
    network: Array
    period: float

    def run(self, name: str, *numbers: float) -> Estimate:
        """Return what a filter of `FAMILIES` with its numbers says."""
        acceleration, ratio, *own = numbers
        model = difference_model(self.period, acceleration, ratio)
        runs: dict[str, Callable[[], Array]] = {
            "KF": lambda: run_kalman(model, self._y, initial_covariance=_UNKNOWN),
            "HF": lambda: self._hinfinity(model, own[0]),
            "KF, Huber update": lambda: self._robust(model, huber(own[0])),
            "KF, gating": lambda: self._robust(model, gating(1 - min(own[0], 0.5))),
        }
        return self._corrected(runs[name]())

    @property
    def published(self) -> Estimate:
        """P1's filter with the printed gain A: the last fix, carried on by the INS.

        After the measurement of a step it is the network itself.
        """
        model = difference_model(self.period, 1.0, 1.0)
        return self._corrected(self._run(model, deadbeat_gain(model), predicted=True))

    @property
    def _y(self) -> Array:
        return self.ins - self.network

    def _corrected(self, error: Array) -> Estimate:
        return Estimate(self.ins - error)

    def _hinfinity(self, model: ErrorModel, margin: float) -> Array:
        try:
            design = design_filter(model, "exact", margin=margin)
        except InfeasibleDesignError:
            return np.full_like(self._y, np.inf)
        return self._run(design.model, design.gain, predicted=False)

    def _run(self, model: ErrorModel, gain: Array, *, predicted: bool) -> Array:
        """Run an H-infinity filter from the first measurement on."""
        y = self._y
        first = int(np.flatnonzero(np.isfinite(y[:, 0]))[0])
        found = np.full_like(y, np.nan)
        found[first:] = run_hinfinity(
            (model, gain), y[first:], initial_state=y[first], predicted=predicted
        )
        return found

    def _robust(self, model: ErrorModel, policy: Policy) -> Array:
        return run_robust(model, self._y, policy=policy, initial_covariance=_UNKNOWN)


def difference_model(period: float, acceleration: float, ratio: float) -> ErrorModel:
    """Return P1's model with fixes of 0.1 m; gains depend on ratios alone.

    Parameters
    ----------
    period : float
        s.
    acceleration : float
        Standard deviation of the acceleration that the INS misses, m/s^2.
    ratio : float
        Of the deviation of velocities, m/s, to 0.1.
    """
    noise = (acceleration * period**2 / 2, acceleration * period)
    return ErrorModel.p1(period, process_noise=noise, measurement_noise=(0.1, 0.1 * ratio))
