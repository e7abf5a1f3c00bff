"""All that evidence recorded-data tells of recordings, as tables that can be kept."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from inswsn_lib import logs
from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.evaluation import autocorrelation
from inswsn_lib.files import WRITTEN, read_text
from inswsn_lib.logs import Ladder, Outages, calibrate
from inswsn_lib.logs.correction import COLOURED, TIGHT
from inswsn_lib.logs.estimates import scores, tag_track
from inswsn_lib.logs.ladder import FIXED_LAG, SMOOTHER
from inswsn_lib.navigation.recorded_clusters import RecordedClusters
from inswsn_lib.navigation.recorded_outages import RecordedOutages
from inswsn_lib.streams import Ranges, Recording

Tables = dict[str, pd.DataFrame]

_FORM = 1
_LAG = 10.0  # s, to which autocorrelations are taken
# what a tight filter may assume beside the tuned numbers: errors that soon fade
_FADING = (0.02, 0.001, 0.05, 0.05, 0.5, 0.02)
_BOUND = 0.2  # m
_ALIGNMENTS = (15.0, 20.0, 25.0, 30.0, 40.0)  # s, from which P1's form is started
_CHOICE = 30.0  # s after the start, by which one of the two is chosen


@dataclass(frozen=True, eq=False)
class RecordedStudy:
    """The filters of this package on five recordings, tuned on the first part of each.

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
    def outages(self) -> dict[str, Outages]:
        """On foot and by car."""
        walk, car = self._load("rtklib/walk-0827"), self._load("rtklib/drive-0708")
        return {
            "rtklib/walk-0827": Outages(Ladder(walk), 10.0, 3.0),
            "rtklib/drive-0708": Outages(Ladder(car, alignment=60.0), 20.0, 8.0),
        }

    def tables(self) -> Tables:
        """Return everything, by the names of the sections of evidence recorded-data."""
        clusters, outages = RecordedClusters(self.room), RecordedOutages(self.room)
        found = {
            "errors": self._errors(),
            "bias": self._biases(),
            "inrol/1": self.room.table(),
            "starts": self._starts(),
            "smoother": self._smoother(),
            "tight": self._tight(),
            "clusters": clusters.table(),
            "facts": self._facts(clusters, outages),
            **_of_outages("inrol/1", outages),
            "autocorrelation": self._autocorrelations(),
        }
        found |= {name: ladder.table() for name, ladder in self.planar.items()}
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

    def _biases(self) -> pd.DataFrame:
        """Return the bias of each anchor by the first part and by the rest, m."""
        recording, split = self.room.recording, self.room.split
        parts = {"first": recording.part(end=split), "rest": recording.part(begin=split)}
        columns: dict[str, dict[str, float]] = {}
        for part, each in parts.items():
            told = calibrate(each, ["bias"]).told
            columns[part] = {name: value for name, (value, _) in told.items()}
            columns[f"{part} deviation"] = {name: sd for name, (_, sd) in told.items()}
        return pd.DataFrame(columns).sort_index()

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

    def _tight(self) -> pd.DataFrame:
        """Return the tight filter over the loose one as causes of its errors are taken away.

        What is taken away is known from the reference: these are experiments, not filters.
        """
        room, ranges = self.room, self._heard
        point = calibrate(
            room.recording.part(end=room.split), ["bias", "lever arm"]
        ).state.lever_arm
        true, other = (self._distances(arm) for arm in (room.recording.lever_arm, point))
        error, left = ranges.distance - true, ranges.distance - other
        middle = pd.Series(left).groupby(ranges.anchor).transform("median").to_numpy()
        shuffled = (
            pd.Series(error)
            .groupby(ranges.anchor)
            .transform(lambda each: np.random.default_rng(0).permutation(each.to_numpy()))
        )
        kinds = {
            "as recorded": error,
            "without what is beyond 0.2 m": np.clip(error, -_BOUND, _BOUND),
            "also of the point that the ranges see, and without bias": np.clip(
                left - middle, -_BOUND, _BOUND
            ),
            "in another order": shuffled.to_numpy(),
        }
        return pd.DataFrame({n: self._tight_row(true + each) for n, each in kinds.items()}).T

    @property
    def _heard(self) -> Ranges:
        """The ranges of the room while the IMU is on."""
        heard = self.room.filters.recording.ranges
        assert heard is not None
        return heard

    def _tight_row(self, distance: Array) -> dict[str, float]:
        """Return the tight filter over the loose one for these ranges, by the likelier of two."""
        room = self.room
        heard = replace(self._heard, distance=distance)
        ladder = replace(room, recording=replace(room.recording, ranges=heard))
        tight, loose = (ladder.rungs[name].run for name in (TIGHT, COLOURED))
        told = max(
            [room.tuned(TIGHT).best, _FADING],
            key=lambda n: tight(*n, end=ladder.start.time + _CHOICE, kept=False).log_likelihood,
        )
        rows, truth = ladder.judged, ladder.truth[ladder.judged]
        mine, others = (
            ladder.of(solution).part(rows)
            for solution in (tight(*told), loose(*room.tuned(COLOURED).best))
        )
        row = scores(mine, truth, others.state - truth)
        kept = {end: row[f"position_{end}"] for end in ("ratio", "low", "high")}
        return {"position": row["position"], **kept, "correlation time": told[4]}

    def _distances(self, arm: Array) -> Array:
        """Return the true distances of a point of the body to the anchors that were heard."""
        ranges = self._heard
        time, track = tag_track(replace(self.room.recording, lever_arm=arm))
        place = np.column_stack([np.interp(ranges.time, time, x) for x in track.T])
        return np.asarray(np.linalg.norm(place - ranges.anchors[ranges.anchor], axis=1))

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

    def _facts(self, clusters: RecordedClusters, outages: RecordedOutages) -> pd.DataFrame:
        """Return single numbers by name."""
        room = self.room
        # what the learners' INS, which is never corrected, is off by when an outage begins
        astray = (room.alone.state - room.truth)[outages.starts, :2]
        begun = np.linalg.norm(astray, axis=1)
        fixes = np.asarray(np.isfinite(room.fixes.position).all(axis=1))
        x, y = clusters.correlation
        facts = {
            "room seconds": float(np.ptp(room.fixes.time)),
            "room fixes": len(fixes),
            "room fixes missing": int((~fixes).sum()),
            "room judged": int(room.judged.sum()),
            "room split": room.split - float(room.fixes.time[0]),
            "room attitude jumps": _jumps(room.recording),
            "outages ins least": float(begun.min()),
            "outages ins most": float(begun.max()),
            "clusters correlation x": x,
            "clusters correlation y": y,
        }
        return pd.DataFrame({"value": facts})


def _of_outages(name: str, outages: Outages) -> Tables:
    lengths = [length for length in (2.0, 5.0, 10.0, 20.0) if length <= outages.longest]
    return {f"outages {name}": outages.table(lengths), f"profiles {name}": _profiles(outages)}


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
