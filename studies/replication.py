"""Run chapter 06 of version 2.0.0 on recordings that it had not used, as registered.

The plan is data/recorded/replication.yaml. This runs in a clone of the commit that it names, once:

    git clone . CLONE && git -C CLONE checkout f7b8109
    PYTHONPATH=CLONE:CLONE/book INSWSN_DATA=MIRROR .venv/bin/python studies/replication.py \
        CLONE INROL_2_FOLDER PLAZA_1_FILE PLAN_COMMIT > outcome.yaml

Filters, learners and fusion have the numbers found on inrol/1 and plaza/2; the cells of the chapter
decide what holds. Run with the files of inrol/1 and plaza/2 it finds what 2.0.0 published.
"""

from __future__ import annotations

import re
import sys
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml
from inswsn_lib.navigation.recorded_clusters import RecordedClusters
from inswsn_lib.navigation.recorded_outages import RecordedOutages
from inswsn_lib.recordings.files import digests_of
from scipy.io import savemat

from inswsn_lib import navigation, recordings
from inswsn_lib.errors import InswsnError
from inswsn_lib.navigation import RecordedStudy, read_tables
from inswsn_lib.recordings import PlanarContest, RecordedContest, matlab

_CELL = re.compile(r"```\{code-cell\} ipython3\n(?::[^\n]*\n)*(.*?)\n```\n", re.DOTALL)
_COLOURED, _TIGHT = "loosely coupled, coloured fixes", "tightly coupled, biases and a scale"
_LEARNERS = ["P1's BP network", "P1's LS-SVM"]
_FUSIONS = [1, 2, 3, 4, 5, 7]  # rows of the table of clusters that fuse fixes, and filter them

#: What each condition hangs on, by the number of its sentence, from the names of the chapter
NUMBERS = {
    1: {"anchors": "(apart.abs() > 2).sum()"},
    2: {"surely below the network, %": "sure"},
    3: {f"{of} {end}": f"room.loc['KF', '{of}_{end}']"
        for of in ("position", "velocity") for end in ("ratio", "low", "high")},
    4: {f"{n} over KF": f"room.loc['KF, {n}', 'position'] / room.loc['KF', 'position']"
        for n in ("Huber update", "gating")},
    5: {of: f"room.loc['{_COLOURED}', '{of}']"
        for of in ("position_ratio", "velocity_ratio", "nees", "lag1")},
    6: {"NEES, white over coloured":
        f"room.loc['loosely coupled, white fixes', 'nees'] / room.loc['{_COLOURED}', 'nees']"},
    7: {f"{of} {end}": f"pairs.loc['smoother', '{of}_{end}']"
        for of in ("position", "velocity") for end in ("ratio", "high")},
    8: {"share of gain": "(1 - room.loc['fixed-lag smoother, 2 s', 'position_ratio'])"
        " / (1 - room.loc['smoother', 'position_ratio'])"},
    9: {end: f"tight.loc['in another order', '{end}']" for end in ("ratio", "low", "high")},
    10: {n: f"tight.loc['{n}', 'ratio']" for n in ("as recorded", "in another order")},
    12: {"tight over network, high": f"tables['plaza/2'].loc['{_TIGHT}', 'position_high']",
         "tight over odometry": f"tables['plaza/2'].loc['{_TIGHT}', 'position']"
         " / tables['plaza/2'].loc['odometry alone', 'position']"},
    14: {f"lesser learner over standing still, {s} s": f"cut.loc[{_LEARNERS}, 'rms {s} s'].min()"
         f" / cut.loc['stand still at the last fix', 'rms {s} s']" for s in (2, 5, 10)},
    15: {f"KF over the lesser learner, {s} s": f"cut.loc[\"P1's KF, coasting\", 'rms {s} s']"
         f" / cut.loc[{_LEARNERS}, 'rms {s} s'].min()" for s in (2, 5, 10)},
    16: {f"coasting over the best of the others, {s} s": f"cut.loc['coasting filter', 'rms {s} s']"
         f" / cut.loc[list(SHORT_OUT), 'rms {s} s'].drop('coasting filter').min()"
         for s in (2, 5, 10)},
    17: {end: f"cut.loc['stand still at the last fix', '{end} 10 s']" for end in ("ratio", "high")},
    19: {"best fusion over all anchors": f"clusters['position'].iloc[{_FUSIONS}].min()"
         " / clusters.loc['all anchors at once', 'position']"},
    20: {"mean over the better cluster": "clusters.loc['mean of both', 'position'] / better"},
}  # fmt: skip


class Replication(RecordedStudy):
    """Chapter 06 with another room and another field, and the numbers of those that it had."""

    def __init__(self, kept: dict[str, Any], room: Path, field: Path) -> None:
        super().__init__()
        vars(self)["kept"] = kept
        first, plaza = RecordedStudy(), RecordedStudy().planar["plaza/2"]
        other = RecordedContest(recordings.load("inrol", room), trials=self.trials)
        mower = PlanarContest(
            recordings.load("plaza", field), 1.0, alignment=40.0, trials=self.trials
        )
        # what was found on the first recordings stands where a search would put its result
        vars(other)["tuned"], vars(mower)["tuned"] = first.room.tuned, plaza.tuned
        vars(self).update(room=other, planar=first.planar | {"plaza/2": mower})
        vars(self).update(
            known=RecordedClusters(first.room).covariance,
            settings=RecordedOutages(first.room).settings,
            size=_size(first.room),
            refused={},  # what for, by the word that its sentences begin with
        )

    def tables(self) -> dict[str, Any]:
        """Return the tables of the chapter."""
        filtered = RecordedClusters._filtered

        def as_in_first(clusters: RecordedClusters) -> Any:
            """Take fixes of a cluster for as much worse than those of all as they were there."""
            mine = RecordedClusters(clusters.contest)
            vars(mine)["covariance"] = self.known * _size(clusters.contest) / self.size
            return filtered(mine)

        def or_refused(of: type, word: str, name: str) -> Any:
            """Return a patch of a table that is NaN where it is refused, and keeps why."""
            table = of.table

            def kept(contest: Any) -> Any:
                try:
                    return table(contest)
                except InswsnError as refusal:
                    self.refused[word] = str(refusal)
                    return self.kept[name] * np.nan

            return patch.object(of, "table", kept)

        with (
            or_refused(RecordedClusters, "Clusters", "clusters"),
            or_refused(PlanarContest, "Mower", "plaza/2"),
            patch.object(RecordedClusters, "covariance", self.known),
            patch.object(RecordedClusters, "_filtered", as_in_first),
            patch.object(RecordedOutages, "settings", self.settings),
        ):
            return super().tables()


class Record:
    """What the cells of the chapter take for their record: it keeps which sentences hold."""

    def __init__(self, root: Path) -> None:
        self.root, self.schema, self.sentences = root, None, dict[str, bool]()

    def data(self, name: str) -> Path:
        """Return where a file is."""
        return self.root / "data" / name

    def holds(self, sentence: str, condition: bool) -> None:
        """Keep whether a sentence holds."""
        self.sentences[sentence] = bool(condition)

    def ignore(self, *_: Any, **__: Any) -> None:
        """Keep nothing of what else a chapter says."""

    quantity = say = write = ignore


def run_chapter(root: Path, tables: Any) -> tuple[dict[str, bool], dict[str, Any]]:
    """Run the chapter's cells on tables; return which sentences hold, and its names."""
    record, names = Record(root), dict[str, Any](trials=20, runs=32, seed=2012)
    study = type("Study", (), {"__init__": lambda *_, **__: None, "tables": lambda _: tables})
    text = (root / "chapters/evidence/06-on-recorded-data.md").read_text(encoding="utf-8")
    with ExitStack() as stack:
        stack.enter_context(patch("inswsn_book.record.ChapterRecord", lambda *_, **__: record))
        stack.enter_context(patch.object(navigation, "RecordedStudy", study))
        for name in ("figure", "parameters", "table"):
            stack.enter_context(patch(f"inswsn_book.show.show_{name}", record.ignore))
        for cell in _CELL.findall(text):
            exec(cell, names)
    return record.sentences, names


def sort_rows(path: Path, folder: Path) -> None:
    """Write a MATLAB file whose tables with times are sorted by them, their first column."""
    tables = matlab.read_tables(path)
    timed = {n: t[np.argsort(t[:, 0], kind="stable")] for n, t in tables.items() if n != "TL"}
    savemat(folder / path.name, tables | timed)


def found(names: dict[str, Any], number: int) -> dict[str, float]:
    """Return the numbers that a condition hangs on."""
    return {what: float(f"{float(eval(e, names)):.4g}") for what, e in NUMBERS[number].items()}


def _size(contest: RecordedContest) -> float:
    rows = contest.usable & (contest.fixes.time <= contest.split)
    return float(np.square(contest.network.state - contest.truth)[rows, :2].mean())


def main(root: Path, room: Path, field: Path, plan_commit: str) -> None:
    """Print the outcome, to be appended to the plan."""
    plan = yaml.safe_load(Path("data/recorded/replication.yaml").read_text())["plan"]
    kept = read_tables(root / "data/recorded/on-recordings.json")[0]
    with TemporaryDirectory() as folder:
        sort_rows(field, Path(folder))
        study = Replication(kept, room, Path(folder))
        tables = study.tables()
    was, before = run_chapter(root, kept)
    now, after = run_chapter(root, tables)
    rows = []
    for each in plan["sentences"]:
        number, sentence = each["number"], each["sentence"]
        row = {"number": number, "came_of_it": "not applicable"}
        if each["applies_to"] != "neither":
            assert was[sentence], sentence
            row["came_of_it"] = "held" if now[sentence] else "did not hold"
            row["published"] = found(before, number)
            if reason := study.refused.get(sentence.partition(":")[0]):
                row |= {"came_of_it": "could not be run", "reason": reason}
            else:
                row["replicated"] = found(after, number)
        rows.append(row)
    digests = {
        "inrol/2": recordings.load("inrol", room).digests,
        "plaza/1": digests_of(field),
    }
    outcome = {"plan_commit": plan_commit, "code": plan["code"], "digests": digests}
    outcome |= {"sentences": rows}
    print(yaml.safe_dump({"outcome": outcome}, sort_keys=False, width=100), end="")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]), sys.argv[4])
