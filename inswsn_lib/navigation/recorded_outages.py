"""P1's learners in outages of a recording, beside what an `Outages` has of itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from inswsn_lib import learning
from inswsn_lib.checks import Array
from inswsn_lib.filters import run_kalman
from inswsn_lib.logs import Outages
from inswsn_lib.logs.ladder import DifferenceFilters, difference_model
from inswsn_lib.navigation.hybrid import HybridNavigator, observable_inputs
from inswsn_lib.streams import Whole

#: What P1's hybrid learns from, by the names of `observable_inputs`
INPUTS = ("inertial", "motion")
#: Over how many of the latest fixes
WINDOWS = (25, 50)
_UNKNOWN = 1e6 * np.eye(4)
_LEARNERS: Mapping[str, Callable[[], Any]] = {
    "BP network": lambda: learning.BackpropRegressor(networks=1),
    "LS-SVM": learning.SelectedLSSVM,
}


@dataclass(frozen=True, eq=False)
class RecordedOutages(Outages):
    """Outages of a recording with a reference, in which P1's hybrids take part, too.

    Attributes
    ----------
    ladder, longest, every
        As of `Outages`.

    Examples
    --------
    >>> from inswsn_lib.navigation import RecordedOutages
    >>> from inswsn_lib.logs import Ladder
    >>> from inswsn_lib.streams import Recording
    >>> RecordedOutages(Ladder(Recording("empty"))).starts
    Traceback (most recent call last):
    ...
    inswsn_lib.errors.InswsnError: The recording empty has neither an IMU nor odometry: there is \
nothing to correct fixes with.
    """

    @cached_property
    def errors(self) -> dict[str, Array]:
        """Horizontal errors of what a system could have done, (outages, steps), m, by method."""
        found = {**super().errors, "P1's KF, coasting": self._coasting_kalman()}
        return found | {f"P1's {name}": self._hybrid(name, self.starts) for name in _LEARNERS}

    @cached_property
    def settings(self) -> dict[str, tuple[str, int]]:
        """The inputs and the window of each learner, by every second outage of the tuning part."""
        ladder = self.ladder
        begin, end = ladder.start.time + self.longest, ladder.split - self.longest
        starts = self.begins(begin, end)[::2]
        choices = [(inputs, window) for inputs in INPUTS for window in WINDOWS]
        return {
            name: min(
                choices,
                key=lambda c: float(np.nanmean(np.square(self._hybrid(name, starts, c)))),
            )
            for name in _LEARNERS
        }

    @property
    def _filters(self) -> DifferenceFilters:
        found = self.ladder.difference
        assert found is not None  # beside an IMU
        return found

    def _hybrid(self, name: str, starts: Whole, choice: tuple[str, int] | None = None) -> Array:
        """Return the errors of P1's hybrid, whose filter and learner have an INS that drifts."""
        inputs, window = choice or self.settings[name]
        time, (ins, y) = self.ladder.fixes.time, self._difference(starts)
        navigator = HybridNavigator(self._kalman, _LEARNERS[name](), window=window)
        run = navigator.run(y, observable_inputs(time[-len(ins) :], ins)[inputs])
        return self._corrected(run.estimates, starts)

    def _coasting_kalman(self) -> Array:
        """Return the errors of P1's filter alone, whose INS drifts."""
        return self._corrected(self._kalman(self._difference(self.starts)[1]), self.starts)

    def _kalman(self, measured: Array) -> Array:
        model = difference_model(self.ladder.step, *self.ladder.tuned("KF").best)
        return run_kalman(model, measured, initial_covariance=_UNKNOWN)

    def _difference(self, starts: Whole) -> tuple[Array, Array]:
        """Return an INS that drifts, (rows, 4), and INS less network, (rows, 4, outages)."""
        ins, network = self._filters.ins, self.ladder.network.state
        first = int(np.flatnonzero(np.isfinite(ins).all(axis=1))[0])
        y = np.repeat((ins - network)[first:, :, None], len(starts), axis=2)
        for outage, k in enumerate(starts - first):
            y[k + 1 : k + 1 + self.steps, :, outage] = np.nan
            y[k + 1 + self.steps :, :, outage] = 0.0  # after the outage nobody asks
        return ins[first:], y

    def _corrected(self, errors: Array, starts: Whole) -> Array:
        """Return the errors of the INS less its errors (rows, 4, outages), in the outages."""
        places = self._filters.ins[-len(errors) :, :2, None] - errors[:, :2]
        ahead = self.ahead(starts) - (len(self.ladder.fixes) - len(errors))
        return self.apart(np.array([places[steps, :, k] for k, steps in enumerate(ahead)]), starts)
