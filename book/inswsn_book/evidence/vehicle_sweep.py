"""One thing changed at a time, on a route of its own, so that nothing is tuned on P3's outages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from inswsn_book.evidence.vehicle_tables import Ratios
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding
from inswsn_lib.learning import SelectedLSSVM
from inswsn_lib.navigation import OutageTrials, VehicleHybrid, VehicleOutages, outage_size
from inswsn_lib.navigation.vehicle_outages import LONG, OUTAGE, run_outages
from inswsn_lib.scenario import with_values
from inswsn_lib.simulation import Drive, Truth, simulate_sensors, true_motion
from inswsn_lib.vehicle import FilterSettings


@dataclass(frozen=True)
class Sweep:
    """A route beside those of the tables, with other draws of the sensors."""

    outages: VehicleOutages
    draws: int
    ratios: Ratios = field(repr=False)

    @cached_property
    def truth(self) -> Truth:
        """The route."""
        return true_motion(self.outages.settings, route=100)

    @cached_property
    def starts(self) -> list[int]:
        """The last epochs with GPS."""
        return [place.start for place in self.truth.places]

    @cached_property
    def drive(self) -> Drive:
        """The drive with the sensors of the tables."""
        return self.sensed()

    def sensed(self, **changes: float) -> Drive:
        """Return the drive with sensors some of whose settings are changed."""
        settings = with_values(self.outages.settings, **changes)
        return simulate_sensors(
            self.truth, settings, runs=self.draws, seed=self.outages.seed + 1000
        )

    def hybrid(
        self, believed: FilterSettings, regressor: Any = None, **changes: Any
    ) -> VehicleHybrid:
        """Return P3's method, or that with another regressor, with some options changed."""
        learner = SelectedLSSVM() if regressor is None else regressor
        return VehicleHybrid(believed, learner, **(self.outages.learning | changes))

    def run(
        self,
        believed: FilterSettings,
        drive: Drive | None = None,
        hybrids: Mapping[str, VehicleHybrid] | None = None,
    ) -> OutageTrials:
        """Return the outages with an aided filter that believes this, and hybrids of it."""
        there = drive or self.drive
        return run_outages(there, believed, self.starts, LONG, hybrids, filters=("through",))

    def factor(
        self, one: tuple[OutageTrials, str], other: tuple[OutageTrials, str], how: str
    ) -> Finding:
        """Return the factor between two methods in the same outages, by places."""
        return self.ratios.factor(rms(*one), rms(*other), np.arange(8)[:, None], how)


def rms(trials: OutageTrials, method: str) -> Array:
    """Return the RMS error of a method in 40 s, (places, draws), m."""
    return outage_size(trials.errors[method], 1, OUTAGE)[0]


def middle(trials: OutageTrials, method: str) -> str:
    """Write the median RMS error over the outages."""
    return f"{np.median(rms(trials, method)):.1f}"


def on_all_drives(
    outages: VehicleOutages, hybrids: Mapping[str, VehicleHybrid]
) -> dict[str, Array]:
    """Return the RMS errors in 40 s of methods that the tables lack, each (places, drives), m."""
    trials = [
        run_outages(drive, outages.beliefs, starts, LONG, hybrids, filters=("through",))
        for drive, starts in zip(outages.drives, outages.starts, strict=True)
    ]
    return {name: np.concatenate([rms(each, name) for each in trials], axis=1) for name in hybrids}
