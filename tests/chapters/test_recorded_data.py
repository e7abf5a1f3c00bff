"""Evidence recorded-data: what is published is what is kept, and pieces with known answers."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import Project
from inswsn_book.record.results import Results, read_results
from inswsn_book.run.compare import pair_quantities
from inswsn_book.run.store import Request, run_all
from made_folders import needs

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError
from inswsn_lib.filters import MISFIT
from inswsn_lib.logs.registry import KNOWN
from inswsn_lib.navigation import read_tables, write_tables
from inswsn_lib.navigation.recorded_study import Tables


@pytest.fixture(scope="module")
def results(root: Path) -> Results:
    return read_results(root / "data/published/recorded-data.json")


@pytest.fixture(scope="module")
def kept(root: Path) -> Tables:
    return read_tables(root / "data/recorded/on-recordings.json")[0]


def test_the_kept_results_say_what_they_came_from(root: Path) -> None:
    facts = read_tables(root / "data/recorded/on-recordings.json")[1]
    assert set(facts["digests"]) == set(logs.names())
    for name, known in KNOWN.items():
        assert facts["digests"][name] == dict(known.digests)
    assert len(facts["commit"]) == 40


@pytest.mark.long
@needs(*KNOWN)
def test_what_the_recordings_give_is_what_is_kept_and_published(project: Project) -> None:
    """Executed on the recordings; what is kept of them is held to the same by each build."""
    made = run_all(project, [Request("p3-vehicle"), Request("recorded-data")], Quiet())
    for run in made:
        assert all(run.results.provenance.studies.values())
        assert all(run.results.sentences.values())
        reference = read_results(project.published / f"{run.request.chapter}.json")
        far = [str(p) for p in pair_quantities(reference, run.results) if p.beyond_tolerance]
        assert far == []


def test_what_is_published_is_what_is_kept(results: Results, kept: Tables) -> None:
    room = kept["inrol/1"]
    pairs = {
        "room.kf.position": room.loc["KF", "position_ratio"],
        "room.coloured.velocity": room.loc["loosely coupled, coloured fixes", "velocity_ratio"],
        "room.smoother.position": room.loc["smoother", "position_ratio"],
        "outages.coasting.10": kept["outages inrol/1"].loc["coasting filter", "rms 10 s"],
        "clusters.mean.error": kept["clusters"].loc["mean of both", "position"],
        "mower.tight.error": kept["plaza/2"].loc["tightly coupled, biases and a scale", "position"],
    }
    for name, value in pairs.items():
        assert results[name].value == pytest.approx(float(value), rel=0.02), name
        assert results[name].basis == "recorded"
    assert all(results.sentences.values())


def test_the_replication_is_as_it_was_committed_and_told(root: Path, results: Results) -> None:
    """The plan was committed as 8b878d2, before it was run, and the outcome below it as 137ff3d."""
    content = (root / "data/recorded/replication.yaml").read_bytes()
    plan, outcome = content.split(b"outcome:\n")
    digests = [hashlib.sha256(part).hexdigest()[:16] for part in (plan, content)]
    assert digests == ["a945dd708467a409", "ad9fd909bd06f586"]
    told = {
        "held": "held", "failed": "did not hold", "refused": "could not be run",
        "left-out": "not applicable",
    }  # fmt: skip
    for name, words in told.items():
        count = outcome.count(f"came_of_it: {words}\n".encode())
        assert results[f"replication.{name}"].value == count
    assert results["replication.sentences"].value == plan.count(b"- number:") == 20


def test_the_misfit_of_a_report_is_that_of_recordings(kept: Tables) -> None:
    gains = kept["gains"].astype(float).dropna(subset="hold")
    for of, misfit in zip(("position", "velocity"), MISFIT, strict=True):
        off = np.log(gains[f"expected_{of}"] / gains[f"state_{of}"])
        assert 0.85 < np.sqrt(np.mean(off**2)) / misfit < 1


def test_the_network_is_one_in_every_ratio(kept: Tables) -> None:
    for name in ("inrol/1", "plaza/2", "labyrinth/1"):
        row = kept[name].loc["network alone"]
        assert row["position_ratio"] == row["position_low"] == row["position_high"] == 1.0
    errors = kept["errors"][["x", "y"]]
    # of the whole recording, about that of its judged part
    assert np.hypot(errors.x, errors.y).pow(2).mean() ** 0.5 == pytest.approx(
        kept["inrol/1"].loc["network alone", "position"], rel=0.15
    )


def test_tables_come_back_as_they_were_kept(tmp_path: Path) -> None:
    tables = {
        "one": pd.DataFrame({"a": [0.1, np.nan], "b": [True, False], "c": ["x", "y"]}),
        "two": pd.DataFrame({"v": [1.0]}, index=["row"]),
    }
    path = tmp_path / "kept.json"
    path.write_text(write_tables(tables, day="today"), encoding="utf-8")
    found, facts = read_tables(path)
    assert facts == {"day": "today"}
    for name, table in tables.items():
        pd.testing.assert_frame_equal(found[name], table)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"form": 2}', '{"form": 1, "tables": {"a": 1}}'])
def test_a_file_that_keeps_something_else_is_told(tmp_path: Path, text: str) -> None:
    path = tmp_path / "other.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InswsnError, match=r"does not hold the tables of a study of recordings\.$"):
        read_tables(path)
