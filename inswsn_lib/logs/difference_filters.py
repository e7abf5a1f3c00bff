"""P1's form on a recording: filters of the difference of an INS that drifts and a network."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.filters import deadbeat_gain, gating, huber, run_hinfinity, run_kalman, run_robust
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

    def run(self, name: str, acceleration: float, ratio: float, own: float = 0.0) -> Estimate:
        """Return what a filter of `FAMILIES` with its numbers says."""
        model, y = difference_model(self.period, acceleration, ratio), self.ins - self.network
        if name == "HF":
            try:
                design = design_filter(model, "exact", margin=own)
            except InfeasibleDesignError:
                return Estimate(np.full_like(y, -np.inf))
            return self._hinfinity(design.model, design.gain, predicted=False)
        if name == "KF":
            found = run_kalman(model, y, initial_covariance=_UNKNOWN)
        else:
            policy = huber(own) if name == "KF, Huber update" else gating(1 - min(own, 0.5))
            found = run_robust(model, y, policy=policy, initial_covariance=_UNKNOWN)
        return Estimate(self.ins - found)

    @property
    def published(self) -> Estimate:
        """P1's filter with the printed gain A: the last fix, carried on by the INS.

        After the measurement of a step it is the network itself.
        """
        model = difference_model(self.period, 1.0, 1.0)
        return self._hinfinity(model, deadbeat_gain(model), predicted=True)

    def _hinfinity(self, model: ErrorModel, gain: Array, *, predicted: bool) -> Estimate:
        """Run an H-infinity filter from the first measurement on."""
        y = self.ins - self.network
        first = int(np.flatnonzero(np.isfinite(y[:, 0]))[0])
        found = np.full_like(y, np.nan)
        found[first:] = run_hinfinity(
            (model, gain), y[first:], initial_state=y[first], predicted=predicted
        )
        return Estimate(self.ins - found)


def difference_model(period: float, acceleration: float, ratio: float) -> ErrorModel:
    """Return P1's model with fixes of 0.1 m; gains depend on ratios alone.

    The INS misses an acceleration of this deviation, m/s^2; that of velocities is `ratio` times
    0.1 m/s.
    """
    noise = (acceleration * period**2 / 2, acceleration * period)
    return ErrorModel.p1(period, process_noise=noise, measurement_noise=(0.1, 0.1 * ratio))
