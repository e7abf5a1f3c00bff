"""Recordings: two clusters of anchors, P1's learners in outages, and the tables of all."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from inswsn_lib import learning, logs
from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import autocorrelation
from inswsn_lib.files import WRITTEN, read_text
from inswsn_lib.filters import intersect, run_kalman
from inswsn_lib.inertial import PositionFixes
from inswsn_lib.logs import Ladder, Outages, multilaterate_track
from inswsn_lib.logs.correction import COLOURED, TIGHT
from inswsn_lib.logs.estimates import Estimate, scores
from inswsn_lib.logs.ladder import FAMILIES, FIXED_LAG, SMOOTHER, difference_model
from inswsn_lib.logs.network_fixes import UP
from inswsn_lib.logs.outages import COASTING
from inswsn_lib.navigation.bridged_outages import Passage
from inswsn_lib.navigation.hybrid import HybridNavigator, observable_inputs
from inswsn_lib.navigation.recorded_gains import gains, judged_by_fixes
from inswsn_lib.streams import Fixes, Recording, Whole

Tables = dict[str, pd.DataFrame]

#: What P1's hybrid learns from, by the names of `observable_inputs`
INPUTS = ("time", "inertial", "motion")
#: Over how many of the latest fixes
WINDOWS = (25, 50, 100)
#: After the names of methods of P1's form: what becomes of their INS
RESTARTED, NEVER = "", ", INS never corrected"
#: Against what methods are held in outages, beside going straight on
RIVALS = (COASTING, "P1's KF, coasting")
_UNKNOWN = 1e6 * np.eye(4)
# Learners, and what is tried of each: times inputs and windows about as many settings as the search
# for the numbers of a filter tries
_LEARNERS: Mapping[str, tuple[str, Mapping[str, Sequence[float]]]] = {
    "BP network": (
        "BackpropRegressor",
        {
            "hidden": (1, 2, 3, 5, 10), "weight_decay": (0.0, 1e-5, 1e-3),
            "validation_share": (0.0, 0.15), "epochs": (10, 100),
        },
    ),
    "LS-SVM": (
        "LSSVMRegressor",
        {"sigma": tuple(2.0**k for k in range(10)), "eta": (1e1, 3e2, 1e4, 3e5, 1e7, 1e8)},
    ),
}  # fmt: skip
_DRAWS = 10  # of the random numbers of learners that are judged
_FORM = 1
_LAG = 10.0  # s, to which autocorrelations are taken
_ALIGNMENTS = (15.0, 20.0, 25.0, 30.0, 40.0)  # s, from which P1's form is started
# Recordings with a reference, and such whose fixes are RTK's, with the time of alignment, s
_REFERENCES = {
    "inrol/1": 20.0, "inrol/2": 20.0, "plaza/1": 40.0, "plaza/2": 40.0, "labyrinth/1": 5.0,
}  # fmt: skip
_RTK = {"rtklib/walk-0827": 20.0, "rtklib/drive-0708": 60.0}


@dataclass(frozen=True, eq=False)
class RecordedClusters:
    """Fixes by two halves of the anchors, and what fusion makes of them.

    The anchors are taken in the order of their direction from the middle of all, every other one
    for each cluster. What a fusion must know of errors, their covariance over both clusters, is
    measured in the first part of the recording, against the reference; all is judged on the rest.

    Attributes
    ----------
    ladder : Ladder
        With eight anchors or more.

    Examples
    --------
    >>> from inswsn_lib.navigation import RecordedClusters
    >>> from inswsn_lib.logs import Ladder
    >>> from inswsn_lib.streams import Recording
    >>> RecordedClusters(Ladder(Recording("empty"))).fixes
    Traceback (most recent call last):
    ...
    inswsn_lib.errors.InswsnError: The recording empty has no ranges to cluster.
    """

    ladder: Ladder

    @cached_property
    def fixes(self) -> tuple[Fixes, Fixes]:
        """Those of each cluster."""
        heard = self.ladder.recording.ranges
        if heard is None:
            raise InswsnError(
                f"The recording {self.ladder.recording.name} has no ranges to cluster."
            )
        place = heard.anchors[:, :2] - heard.anchors[:, :2].mean(axis=0)
        order = np.argsort(np.arctan2(place[:, 1], place[:, 0]))
        halves = (heard.kept(np.isin(heard.anchor, order[half::2])) for half in (0, 1))
        first, second = (multilaterate_track(half, self.ladder.window) for half in halves)
        return first, second

    @cached_property
    def positions(self) -> Array:
        """Horizontal fixes of both clusters at the network's times, (2, fixes, 2); NaN if none."""
        times = self.ladder.fixes.time
        return np.stack([_nearest(each, times, self.ladder.window / 2) for each in self.fixes])

    @cached_property
    def errors(self) -> Array:
        """Errors of both clusters, x and y of the first and of the second, (fixes, 4)."""
        return np.hstack(list(self.positions - self.ladder.truth[:, :2]))

    @cached_property
    def covariance(self) -> Array:
        """Of these errors about zero, in the first part, (4, 4)."""
        first = self.ladder.usable & (self.ladder.fixes.time <= self.ladder.split)
        errors = self.errors[first & np.isfinite(self.errors).all(axis=1)]
        return np.asarray(errors.T @ errors / len(errors))

    @property
    def correlation(self) -> tuple[float, float]:
        """Of the errors of both clusters along x and along y, on the judged fixes."""
        x, y, others_x, others_y = self.errors[self.judged].T
        both = [(x, others_x), (y, others_y)]
        along_x, along_y = (float(np.asarray(np.corrcoef(*pair))[0, 1]) for pair in both)
        return along_x, along_y

    @cached_property
    def judged(self) -> Mask:
        """The judged fixes of the contest at which both clusters have one."""
        return np.asarray(self.ladder.judged & np.isfinite(self.errors).all(axis=1))

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """Horizontal positions by each method at the network's times."""
        P, (one, two) = self.covariance, self.positions
        blocks = np.stack([P[:2, :2], P[2:, 2:]])
        independent = P * np.kron(np.eye(2), np.ones((2, 2)))
        return {
            "first cluster alone": Estimate(one),
            "second cluster alone": Estimate(two),
            "mean of both": Estimate((one + two) / 2),
            "weighted, as if independent": self._weighted(independent),
            "covariance intersection": self._intersected(blocks),
            "weighted, correlation known": self._weighted(P),
            "all anchors at once": self.ladder.network.places(),
            "filter on the fixes of both": self._filtered(),
            "filter on all anchors at once": self.ladder.estimates[COLOURED].places(),
        }

    def table(self) -> pd.DataFrame:
        """Return the scores on the judged fixes, with ratios to *all anchors at once*.

        Returns
        -------
        DataFrame
            ``position`` (m), ``position_ratio``, ``position_low``, ``position_high`` by
            `block_ratio`, and ``nees`` over 2 of what says a covariance.
        """
        rows, truth = self.judged, self.ladder.truth[:, :2]
        others = self.ladder.network.state[rows, :2] - truth[rows]
        found = {
            name: scores(each.part(rows), truth[rows], others)
            for name, each in self.estimates.items()
        }
        return pd.DataFrame(found).T

    def _weighted(self, covariance: Array) -> Estimate:
        """Return the best linear fusion for a covariance of both (Bar-Shalom and Campo 1986)."""
        H = np.vstack([np.eye(2), np.eye(2)])
        information = np.linalg.solve(covariance, H)
        fused = np.linalg.inv(H.T @ information)
        state = np.hstack(list(self.positions)) @ information @ fused
        return Estimate(state, np.tile(fused, (len(state), 1, 1)))

    def _intersected(self, blocks: Array) -> Estimate:
        there = np.isfinite(self.errors).all(axis=1)
        both = self.positions[:, there].transpose(0, 2, 1)
        state = np.full(self.positions.shape[1:], np.nan)
        fused, P = intersect(both, blocks, weights="trace")
        state[there] = fused.T
        return Estimate(state, np.tile(P, (len(state), 1, 1)))

    def _filtered(self) -> Estimate:
        """Return the loosely coupled filter on both clusters, each with its own coloured errors.

        Its noises are those tuned for all anchors, times what the errors of a cluster are larger by
        in the first part.
        """
        ladder = self.ladder
        force, rate, white, coloured, time = ladder.tuned(COLOURED).best
        first = ladder.usable & (ladder.fixes.time <= ladder.split)
        whole = np.square(ladder.network.state - ladder.truth)[first, :2].mean()
        larger = np.sqrt(np.diag(self.covariance).reshape(2, 2).mean(axis=1) / whole)
        both = [
            PositionFixes(
                fixes, ladder.recording.lever_arm, more * white * UP, more * coloured * UP,
                np.full(3, time),
            )
            for fixes, more in zip(self.fixes, larger, strict=True)
        ]  # fmt: skip
        return ladder.of(ladder.filters.run(both, force, rate)).places()


def _nearest(fixes: Fixes, times: Array, most: float) -> Array:
    """Return the horizontal positions whose stamps are nearest to some times, or NaN."""
    after = np.clip(np.searchsorted(fixes.time, times), 1, len(fixes) - 1)
    earlier = times - fixes.time[after - 1] < fixes.time[after] - times
    row = np.where(earlier, after - 1, after)
    there = np.abs(fixes.time[row] - times) <= most
    return np.where(there[:, None], fixes.position[row, :2], np.nan)


class LearnerSetting(NamedTuple):
    """What a method of P1's form is fed with, over how many of the latest fixes, and by what.

    Attributes
    ----------
    inputs : str
        Of the learner, by the names of `observable_inputs`, or the time.
    window : int
        Fixes before the outage by which it is trained.
    machine : Any
        The learner with its settings; without one the filter coasts.

    Examples
    --------
    >>> from inswsn_lib.navigation import LearnerSetting
    >>> LearnerSetting("time", 25).window
    25
    """

    inputs: str
    window: int
    machine: Any = None


@dataclass(frozen=True, eq=False)
class RecordedOutages(Outages):
    """Outages of a recording with an IMU, in which P1's hybrids take part, too.

    In P1's form a filter estimates the error of an INS while there are fixes, and a learner that is
    trained on its estimates goes on in the outage. The INS is restarted before the fixes that
    train, with the position, velocity, attitude and biases that the likeliest error-state filter
    has there, and runs uncorrected through them and the outage. In rows that end with `NEVER` it is
    never corrected after its alignment. Of the settings of each method all are tried in outages of
    the first part, and the one of least error there is judged.

    Attributes
    ----------
    ladder, longest, every
        As of `Outages`.
    windows : sequence of int
        How many of the latest fixes train: what is tried.

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

    windows: Sequence[int] = WINDOWS

    @cached_property
    def errors(self) -> dict[str, Array]:
        """Horizontal errors of what a system could have done, (outages, steps), m, by method.

        Those of learners are root mean squares over draws of their random numbers.
        """
        starts, found = tuple(np.tile(self.starts, _DRAWS).tolist()), super().errors
        for (name, reading), setting in self.settings.items():
            each = self._bridged(starts, reading, setting).reshape(_DRAWS, -1, self.steps)
            found[f"P1's {name}{reading}"] = np.sqrt(np.mean(np.square(each), axis=0))
        return found

    @cached_property
    def choices(self) -> dict[str, list[LearnerSetting]]:
        """The settings of each method that are tried."""
        found = {"KF, coasting": [LearnerSetting("", window) for window in self.windows]}
        for name, (kind, grid) in _LEARNERS.items():
            machines = [
                getattr(learning, kind)(**dict(zip(grid, each, strict=True)))
                for each in product(*grid.values())
            ]
            tried = product(INPUTS, self.windows, machines)
            found[name] = [LearnerSetting(*each) for each in tried]
        return found

    @cached_property
    def rehearsed(self) -> Whole:
        """The last fix before each outage of the first part, in which settings are tried."""
        ladder = self.ladder
        after = int(np.searchsorted(ladder.fixes.time, ladder.start.time, side="right"))
        return self.begins(float(ladder.fixes.time[after + max(self.windows)]), ladder.split)

    @cached_property
    def settings(self) -> dict[tuple[str, str], LearnerSetting]:
        """The setting of each method and reading with the least error in these outages."""
        starts = tuple(self.rehearsed.tolist())

        def loss(reading: str, setting: LearnerSetting) -> float:
            return float(np.nanmean(np.square(self._bridged(starts, reading, setting))))

        return {
            (name, reading): min(settings, key=partial(loss, reading))
            for reading in (RESTARTED, NEVER)
            for name, settings in self.choices.items()
        }

    def chosen(self) -> pd.DataFrame:
        """Return what was chosen for the methods of P1's form, of how many trials.

        Returns
        -------
        DataFrame
            A row for each method: ``inputs``, ``window`` (fixes), the numbers of its ``machine``,
            ``trials``, the outages in which they were ``rehearsed``, how many trials the ``filter``
            had that the INS is restarted from, and how far the INS is off when the judged outages
            begin, ``least`` and ``most`` (m).
        """
        name = next(iter(self.solutions))
        rows = {}
        for (method, reading), setting in self.settings.items():
            passage, _ = self._passages(tuple(self.starts.tolist()), setting.window, reading)
            begun = np.linalg.norm(passage.error[setting.window, :2], axis=0)
            grid = _LEARNERS[method][1] if setting.machine else {}
            numbers = [f"{key} {getattr(setting.machine, key):g}" for key in grid]
            rows[f"P1's {method}{reading}"] = {
                "inputs": setting.inputs, "window": setting.window, "machine": ", ".join(numbers),
                "trials": len(self.choices[method]), "rehearsed": len(self.rehearsed),
                "filter": self.ladder.tuned(name).trials,
                "least": np.nanmin(begun), "most": np.nanmax(begun),
            }  # fmt: skip
        return pd.DataFrame(rows).T

    def passage(self, starts: Whole, window: int, reading: str = RESTARTED) -> Passage:
        """Return the fixes of a window before outages, and the outages, one run for each."""
        ladder, steps = self.ladder, np.arange(-window, self.steps + 1)
        rows = starts + steps[:, None]
        if reading == NEVER:
            ins = ladder.alone.state[rows]
        else:
            ins = np.stack([self._restarted(int(k), window) for k in starts], axis=1)
        y = ins - ladder.network.state[rows]
        y[window + 1 :] = np.nan
        each = [
            observable_inputs(ladder.fixes.time[row], ins[:, k]) for k, row in enumerate(rows.T)
        ]
        inputs = {kind: np.stack([x[kind] for x in each], axis=-1) for kind in INPUTS}
        error, y = (x.transpose(0, 2, 1) for x in (ins - ladder.truth[rows], y))
        return Passage(
            ladder.recording.name, window + 1, error, y, inputs, np.asarray(ladder.step * steps)
        )

    def _restarted(self, k: int, window: int) -> Array:
        """Return what an INS says that began as the filter was a window before a fix."""
        start = self.ladder.start_after(next(iter(self.solutions.values())), k - window)
        end = float(self.ladder.fixes.time[k + self.steps])
        return self.ladder.unaided(start, end).state[k - window : k + self.steps + 1]

    @cached_property
    def _passages(self) -> Callable[[tuple[int, ...], int, str], tuple[Passage, Array]]:
        """What makes a passage and what the filter finds in it, once: every setting needs it."""

        def make(starts: tuple[int, ...], window: int, reading: str) -> tuple[Passage, Array]:
            passage = self.passage(np.array(starts), window, reading)
            return passage, self._kalman(passage.y)

        return cache(make)

    def _kalman(self, measured: Array) -> Array:
        """Return what P1's Kalman filter finds; without a reference it keeps its first numbers."""
        ladder = self.ladder
        numbers = ladder.tuned("KF").best if "KF" in ladder.families else FAMILIES["KF"]
        model = difference_model(ladder.step, *numbers)
        return run_kalman(model, measured, initial_covariance=_UNKNOWN)

    def _bridged(self, starts: tuple[int, ...], reading: str, setting: LearnerSetting) -> Array:
        """Return the errors in outages by a filter, and a learner if there is one."""
        passage, found = self._passages(starts, setting.window, reading)
        if setting.machine is not None:
            filtered = found
            hybrid = HybridNavigator(lambda _: filtered, setting.machine, window=setting.window)
            found = hybrid.run(passage.y, passage.inputs[setting.inputs]).estimates
        left = (passage.error - found)[passage.heard :, :2]
        return np.asarray(np.linalg.norm(left, axis=1).T)


@dataclass(frozen=True, eq=False)
class RecordedStudy:
    """The filters of this package on six recordings, tuned on the first part of each.

    Attributes
    ----------
    cache : Path, optional
        Where the recordings are kept; the user's cache by default.

    Raises
    ------
    InswsnError
        If a recording cannot be had (`RecordingUnavailableError`).

    Examples
    --------
    What it found where all recordings were at hand is kept:

    >>> import inswsn_lib as iw
    >>> kept = iw.data_file("recorded/on-recordings.json")
    >>> tables, facts = iw.navigation.read_tables(kept)
    >>> len(tables["inrol/1"]), facts["digests"]["inrol/1"] is not None
    (12, True)
    """

    cache: Path | None = None

    @cached_property
    def room(self) -> Ladder:
        """A tag that is carried in a room."""
        return Ladder(self._load("inrol/1"))

    @cached_property
    def planar(self) -> dict[str, Ladder]:
        """A mower, and a robot in a labyrinth."""
        return {
            name: Ladder(self._load(name), alignment=alignment)
            for name, alignment in (("plaza/2", 40.0), ("labyrinth/1", 5.0))
        }

    @cached_property
    def outages(self) -> dict[str, RecordedOutages]:
        """Where there is an IMU: twice in the room, on foot, and by car."""
        again, walk, car = map(self._load, ("inrol/2", "rtklib/walk-0827", "rtklib/drive-0708"))
        return {
            "inrol/1": RecordedOutages(self.room),
            "inrol/2": RecordedOutages(Ladder(again)),
            "rtklib/walk-0827": RecordedOutages(Ladder(walk), 10.0, 3.0),
            "rtklib/drive-0708": RecordedOutages(Ladder(car, alignment=60.0), 20.0, 8.0),
        }

    @property
    def judged(self) -> dict[str, tuple[Recording, float]]:
        """All recordings with what judges them: a reference, or RTK's fixes; s of alignment."""
        found = {name: (self._load(name), s) for name, s in _REFERENCES.items()}
        by_fixes = {name: (judged_by_fixes(self._load(name)), s) for name, s in _RTK.items()}
        return found | by_fixes

    def tables(self) -> Tables:
        """Return everything, by the names of the sections of evidence recorded-data."""
        clusters = RecordedClusters(self.room)
        found = {
            "errors": self._errors(),
            "inrol/1": self.room.table(),
            "starts": self._starts(),
            "smoother": self._smoother(),
            "clusters": clusters.table(),
            "facts": self._facts(clusters),
            "autocorrelation": self._autocorrelations(),
        }
        found |= {name: ladder.table() for name, ladder in self.planar.items()}
        found["gains"] = gains(self.judged)
        for name, each in self.outages.items():
            found |= _of_outages(name, each)
        return found

    def _load(self, name: str) -> Recording:
        return logs.load(name, cache=self.cache)

    def _errors(self) -> pd.DataFrame:
        """Return the errors of the network in the room, over the whole recording."""
        rows = self.room.usable
        apart = (self.room.network.state - self.room.truth)[rows]
        table = pd.DataFrame(apart, columns=["x", "y", "vx", "vy"])
        return table.assign(time=self.room.fixes.time[rows] - self.room.fixes.time[0])

    def _starts(self) -> pd.DataFrame:
        """Return P1's Kalman filter over the network, by how long its INS is aligned, s."""
        rows = {}
        for seconds in _ALIGNMENTS:
            ladder = replace(self.room, alignment=seconds)
            assert ladder.difference is not None  # beside an IMU
            said = ladder.difference.run("KF", *ladder.tuned("KF").best).part(ladder.judged)
            truth = ladder.truth[ladder.judged]
            rows[seconds] = scores(said, truth, ladder.network.state[ladder.judged] - truth)
        return pd.DataFrame(rows).T

    def _smoother(self) -> pd.DataFrame:
        """Return the smoothers over the causal filter, and the filters over each other."""
        pairs = dict.fromkeys([SMOOTHER, FIXED_LAG, TIGHT], COLOURED) | {COLOURED: "KF", "HF": "KF"}
        rows: dict[str, dict[str, Any]] = {}
        for name, other in pairs.items():
            rows[name] = {"over": other}
            for of, values in self.room.compare(name, other).items():
                columns = [f"{of}_{end}" for end in ("ratio", "low", "high")]
                rows[name] |= dict(zip(columns, values, strict=True))
        return pd.DataFrame(rows).T

    def _autocorrelations(self) -> pd.DataFrame:
        """Return those of fix errors along an axis, mean of both, by recording and lag."""
        room = self.room
        series = {
            name: (ladder.step, (ladder.network.state - ladder.truth)[:, :2])
            for name, ladder in {"inrol/1": room, **self.planar}.items()
        }
        columns = {}
        for name, (period, errors) in series.items():
            lags = np.arange(round(_LAG / period) + 1)
            found = autocorrelation(errors - np.nanmean(errors, axis=0), lags)
            columns[name] = pd.Series(found.mean(axis=1), index=np.round(lags * period, 6))
        return pd.DataFrame(columns)

    def _facts(self, clusters: RecordedClusters) -> pd.DataFrame:
        """Return single numbers by name."""
        room = self.room
        fixes = np.asarray(np.isfinite(room.fixes.position).all(axis=1))
        x, y = clusters.correlation
        facts = {
            "room seconds": float(np.ptp(room.fixes.time)),
            "room fixes": len(fixes),
            "room fixes missing": int((~fixes).sum()),
            "room judged": int(room.judged.sum()),
            "room split": room.split - float(room.fixes.time[0]),
            "room attitude jumps": _jumps(room.recording),
            "clusters correlation x": x,
            "clusters correlation y": y,
        }
        return pd.DataFrame({"value": facts})


def _of_outages(name: str, outages: RecordedOutages) -> Tables:
    lengths = [length for length in (2.0, 5.0, 10.0, 20.0) if length <= outages.longest]
    return {
        f"outages {name}": outages.table(lengths),
        **{f"over {other}, {name}": outages.table(lengths, other) for other in RIVALS},
        f"profiles {name}": _profiles(outages),
        f"chosen {name}": outages.chosen(),
    }


def write_tables(tables: Mapping[str, pd.DataFrame], **facts: Any) -> str:
    """Return tables as JSON, with facts about where they come from.

    Parameters
    ----------
    tables : mapping of str to DataFrame
    **facts
        What JSON can hold.

    Examples
    --------
    >>> import pandas as pd
    >>> from inswsn_lib.navigation import write_tables
    >>> print(write_tables({"one": pd.DataFrame({"a": [0.1]})}, day="today"), end="")
    {"form":1,"facts":{"day":"today"},"tables":{"one":{"index":[0],"columns":["a"],"data":[[0.1]]}}}
    """
    content = {
        name: {
            "index": table.index.tolist(),
            "columns": table.columns.tolist(),
            "data": [[_plain(cell) for cell in row] for row in table.to_numpy(dtype=object)],
        }
        for name, table in tables.items()
    }
    whole = {"form": _FORM, "facts": facts, "tables": content}
    return json.dumps(whole, separators=(",", ":")) + "\n"


def read_tables(path: Path) -> tuple[Tables, dict[str, Any]]:
    """Return what a file keeps of `write_tables`: the tables, and the facts.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InswsnError
        If it holds something else.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import pandas as pd
    >>> from inswsn_lib.navigation import read_tables, write_tables
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder, "kept.json")
    ...     _ = path.write_text(write_tables({"one": pd.DataFrame({"a": [0.1]})}, day="today"))
    ...     print(read_tables(path)[0]["one"].loc[0, "a"])
    0.1
    """
    try:
        content = json.loads(read_text(path, WRITTEN))
        if content["form"] != _FORM:
            raise ValueError(content["form"])
        tables = {name: pd.DataFrame(**each) for name, each in content["tables"].items()}
        return tables, dict(content["facts"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InswsnError(f"{path} does not hold the tables of a study of recordings.") from None


def _plain(cell: Any) -> Any:
    """Return a cell as JSON can hold it, to ten digits."""
    if isinstance(cell, str | bool | np.bool_):
        return cell if isinstance(cell, str) else bool(cell)
    return None if np.isnan(cell) else float(f"{float(cell):.10g}")


def _profiles(outages: Outages) -> pd.DataFrame:
    """Return the RMS error of each method by the time without fixes, s."""
    everything = outages.errors | outages.oracles
    passed = (1 + np.arange(outages.steps)) * outages.ladder.step
    return pd.DataFrame(
        {n: np.sqrt(np.nanmean(np.square(e), axis=0)) for n, e in everything.items()},
        index=np.round(passed, 4),
    )


def _jumps(recording: Recording) -> int:
    """Return how often the reference's attitude turns by more than 5 degrees from row to row."""
    assert recording.reference is not None
    assert recording.reference.attitude is not None
    turned = Rotation.from_quat(recording.reference.attitude)
    return int(np.sum((turned[:-1].inv() * turned[1:]).magnitude() > np.deg2rad(5)))
