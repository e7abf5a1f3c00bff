"""What P3 prints of its outages: rebuilt, on equal terms, and on the recorded drive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding
from inswsn_lib.navigation.recorded_trials import RecordedTrials
from inswsn_lib.navigation.vehicle_outages import LONG, OUTAGE, outage_size

#: The methods that P3 has or that stand for its KF, in words
WORDS = {
    "never": "the filter that is never aided",
    "until": "the filter that is aided until the outage",
    "through": "the filter that is aided through the outage",
    "lssvm": "the proposed method, the aided filter with the LS-SVM",
    "rbf": "the aided filter with the RBF network",
}
_KINDS = {"rms": "RMS", "max": "largest"}
_PLACES = {"rms": (4, 5), "max": (1, 5, 8)}  # of which P3 prints a reduction
_LONG_PLACES = (1, 5, 8)
_AGAINST_NEVER = f"by the proposed method against {WORDS['never']}"
_AGAINST = {"sim": "never", "fair.cells": "through"}  # what a reduction is one of


class ByDrive(NamedTuple):
    """A number of each drive, its unit, and what it is."""

    values: Array
    unit: str
    how: str


def outages_by_drive(errors: Mapping[str, Array]) -> dict[str, ByDrive]:
    """Return what P3 prints of its outages, and the like of all places, for each drive.

    ``sim.40.METHOD.placeN.KIND`` of each of `WORDS` that there is, the RMS or the largest error at
    a place, with ``least`` and ``most`` over the places; ``sim.50.METHOD.placeN.max``;
    ``sim.40.gain.placeN.KIND``, the reduction of the error of the filter that is never aided by
    P3's method, with ``seven`` for the mean of all places but the fourth; and
    ``fair.cells.40.gain...``, that of the filter that is aided through the outage.

    Parameters
    ----------
    errors : mapping of str to ndarray, (51 epochs, 8 places, drives)
        Of some methods, as `VehicleOutages.errors`; of ``never``, ``through``, ``lssvm``, ``rbf``
        at least.
    """
    sizes = error_sizes(errors)
    found: dict[str, ByDrive] = {}
    for name, who in WORDS.items():
        for kind, word in _KINDS.items() if name in errors else ():
            each, start = sizes[name, "40", kind], f"sim.40.{name}"
            for end, words in (("least", "least"), ("most", "largest")):
                how = f"The {words} of the {word} errors at the eight places, 40 s, {who}."
                of_all = each.min(axis=0) if end == "least" else each.max(axis=0)
                found[f"{start}.{kind}.{end}"] = ByDrive(of_all, "m", how)
            for i, values in enumerate(each, 1):
                how = f"The {word} error at place {i}, 40 s, {who}."
                found[f"{start}.place{i}.{kind}"] = ByDrive(values, "m", how)
        for i in _LONG_PLACES if name in errors and name != "until" else ():
            values, how = sizes[name, "50", "max"][i - 1], f"The largest error at place {i}, 50 s"
            found[f"sim.50.{name}.place{i}.max"] = ByDrive(values, "m", f"{how}, {who}.")
    for source, rival in _AGAINST.items():
        against = f"by the proposed method against {WORDS[rival]}"
        for kind, word in _KINDS.items():
            gains = _less(sizes["lssvm", "40", kind], sizes[rival, "40", kind])
            how = f"Reduction of the {word} error {against}"
            mean = np.delete(gains, 3, axis=0).mean(axis=0)
            found[f"{source}.40.gain.seven.{kind}"] = ByDrive(
                mean, "%", f"{how}, mean over the seven places other than the fourth."
            )
            words = "by the proposed method" if rival == "never" else against
            for i in _PLACES[kind]:
                how = f"Reduction of the {word} error {words} at place {i}."
                found[f"{source}.40.gain.place{i}.{kind}"] = ByDrive(gains[i - 1], "%", how)
        apart = (sizes["lssvm", "40", "max"] - sizes[rival, "40", "max"])[3]
        how = f"Largest error at place 4, 40 s, of the proposed method less that of {WORDS[rival]}."
        found[f"{source}.40.difference.place4.max"] = ByDrive(apart, "m", how)
        gain = _less(sizes["lssvm", "50", "max"], sizes[rival, "50", "max"])[4]
        how = f"Reduction of the largest error in 50 s at place 5 {against}."
        found[f"{source}.50.gain.place5.over-kf"] = ByDrive(gain, "%", how)
    gain = _less(sizes["lssvm", "50", "max"], sizes["rbf", "50", "max"])[4]
    how = "Reduction of the largest error in 50 s at place 5 by the LS-SVM against the RBF network."
    return found | {"sim.50.gain.place5.over-rbf": ByDrive(gain, "%", how)}


def spreads(drives: Mapping[str, ByDrive]) -> dict[str, Finding]:
    """Return the medians over the drives with the ends of 95 % of the drives."""
    return {
        name: Finding.of_runs(values, unit, f"{how} Median over the drives.")
        for name, (values, unit, how) in drives.items()
    }


def rebuild_outages(errors: Mapping[str, Array]) -> dict[str, Finding]:
    """Return the medians of `outages_by_drive` with the ends of 95 % of the drives.

    Parameters
    ----------
    errors : mapping of str to ndarray, (51 epochs, 8 places, drives)
    """
    return spreads(outages_by_drive(errors))


def rebuild_recorded(trials: RecordedTrials) -> dict[str, Finding]:
    """Return the counterparts of P3's numbers on the recorded drive, whose places are others.

    ``recorded.cells.40.METHOD.max`` and all that has no place in its name otherwise: medians over
    the outages and draws, with the ends of 95 % of them. ``least``, ``most`` and ``all``, the mean,
    are over the outages of a draw: medians over the draws.

    Parameters
    ----------
    trials : RecordedTrials
        With 50 s of ``never``, ``lssvm`` and ``rbf``.
    """
    sizes, found = error_sizes(trials.errors), {}

    def keep(name: str, values: Array, unit: str, how: str) -> None:
        whole = "outages and draws" if values.ndim > 1 else "draws"
        how = f"Recorded drive: {how} Median over the {whole}."
        found[f"recorded.cells.{name}"] = Finding.of_runs(values.ravel(), unit, how)

    for name in ("never", "lssvm", "rbf"):
        for span, length in (("40", OUTAGE), ("50", LONG)):
            words = f"largest error in {length} s, {WORDS[name]}."
            keep(f"{span}.{name}.max", sizes[name, span, "max"], "m", words)
        for kind, word in _KINDS.items() if name != "rbf" else ():
            each = sizes[name, "40", kind]
            words = f"of the {word} errors in the outages of {OUTAGE} s, {WORDS[name]}."
            keep(f"40.{name}.{kind}.least", each.min(axis=0), "m", f"the least {words}")
            keep(f"40.{name}.{kind}.most", each.max(axis=0), "m", f"the largest {words}")
    for kind, word in _KINDS.items():
        gains = _less(sizes["lssvm", "40", kind], sizes["never", "40", kind])
        words = f"reduction of the {word} error in {OUTAGE} s {_AGAINST_NEVER}"
        keep(f"40.gain.{kind}", gains, "%", f"{words}.")
        keep(f"40.gain.all.{kind}", gains.mean(axis=0), "%", f"{words}, mean over the outages.")
    apart = sizes["lssvm", "40", "max"] - sizes["never", "40", "max"]
    words = f"of the proposed method less that of {WORDS['never']}."
    keep("40.difference.max", apart, "m", f"largest error in {OUTAGE} s {words}")
    for name, rival in (("kf", "never"), ("rbf", "rbf")):
        gains = _less(sizes["lssvm", "50", "max"], sizes[rival, "50", "max"])
        words = f"reduction of the largest error in {LONG} s by the proposed method"
        keep(f"50.gain.over-{name}", gains, "%", f"{words} against {WORDS[rival]}.")
    return found


def error_sizes(errors: Mapping[str, Array]) -> dict[tuple[str, str, str], Array]:
    """Return RMS and largest errors, ``rms`` and ``max``, by method and span."""
    return {
        (name, span, kind): size
        for name, error in errors.items()
        for span, last in (("40", OUTAGE), ("50", LONG))
        for kind, size in zip(_KINDS, outage_size(error, 1, last), strict=True)
    }


def _less(better: Array, worse: Array) -> Array:
    return np.asarray(100 * (1 - better / worse))
