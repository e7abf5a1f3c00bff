"""The sensitivity study: its cells, the requests that they are, and what is kept of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from assumptions import Assumptions, load_assumptions
from conftest import MiniProject
from inswsn_book.progress import Quiet
from inswsn_book.project import Project
from inswsn_book.runs import ChapterError, request_key, run
from sensitivity import Cell, cells_of, merged, request_of, run_of, write_study
from study import Made, Run, Study, read_study

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

SMALL: dict[str, Any] = {
    "headlines": [{"chapter": "00", "quantity": "twice", "short": "twice", "says": "twice it"}],
    "reduced": {"00": {"parameters": {}, "seeds": [1, 2]}},
    "printed": {"00": {}},
    "assumptions": [
        {
            "id": "P1-M-scale", "paper": "P1", "unsaid": "The scale.", "place": "Section 1",
            "bounds": "Nothing.", "chosen": [{"chapter": "00", "parameter": "scale"}],
            "alternatives": [
                {"id": "three", "set": "3", "why": "One more.", "chapters": ["00"],
                 "parameters": {"00": {"scale": 3.0}}},
                {"id": "ten", "set": "10", "why": "Many more.", "chapters": ["00"],
                 "parameters": {"00": {"scale": 10.0}}},
            ],
        },
        {
            "id": "P2-M-word", "paper": "P2", "unsaid": "A word.", "place": "Section 2",
            "bounds": "Nothing.", "chosen": [{"text": "This word."}], "why": "So it is.",
            "varied": "Nothing varies it.",
        },
    ],
}  # fmt: skip


def small() -> Assumptions:
    return Assumptions.model_validate(SMALL)


def test_a_change_is_the_overlay_of_a_request(project: Project) -> None:
    """The alternatives of the list itself."""
    cells = {cell.id + cell.chapter: cell for cell in cells_of(load_assumptions(project.root))}
    scenarios = project.root / "data/scenarios"
    path = "data/scenarios/{}.yaml".format

    def overlay(name: str) -> dict[str, str]:
        request = request_of(project, cells[name])
        assert request.parameters == cells[name].parameters
        return dict(request.overlay)

    made = overlay("P1-M-path/corner02")
    (source,) = (project.root / "chapters").glob("02-*.md")
    assert set(made) == {path("p1"), f"chapters/{source.name}"}
    changed = yaml.safe_load(made[path("p1")])
    assert changed["waypoints"]["value"] == [[650, 0], [150, 200], [130, 400]]
    assert changed["waypoints"]["unit"] == "m"
    assert changed["speed"] == read_yaml(scenarios / "p1.yaml")["speed"]
    text = made[f"chapters/{source.name}"]
    assert "## Exercises" in source.read_text()
    assert "## Exercises" not in text
    assert "## Table 2, published and rebuilt" in text
    assert "record.write()" in text

    changed = yaml.safe_load(overlay("P3-M-imu/poor05")[path("p3")])
    told = read_yaml(scenarios / "p3.yaml")
    for name in ("gyro_noise", "filter_gyro_noise", "accelerometer_bias"):
        assert changed[name]["value"] == pytest.approx(3 * told[name]["value"], rel=1e-12)
    assert changed["gps_position_noise"] == told["gps_position_noise"]

    other = (scenarios / "p1-inertial-all-cells.yaml").read_text()
    assert overlay("P1-M-INS/all-cells03")[path("p1-inertial")] == other

    (text,) = overlay("P1-M-L/positions01").values()
    assert text.count("L=np.eye(2, 4)") == 2
    assert "L=np.eye(2, 4)" not in next((project.root / "chapters").glob("01-*.md")).read_text()


def test_a_section_that_is_not_there_is_told(project: Project) -> None:
    cell = Cell("baseline", "01", skips=("No such section",))
    with pytest.raises(InswsnError, match="has no section 'No such section'"):
        request_of(project, cell)


def test_a_cell_gives_headlines_and_verdicts(mini: MiniProject) -> None:
    """The chapter says twice the number 21, or what `scale` makes of it; the claim says 42."""
    headlines = small().headlines[:1]
    for scale, value, verdict in ((2.0, 42.0, "reproduced"), (3.0, 63.0, "contradicted by")):
        cell = Cell("P1-M-scale/three", "00", {"scale": scale})
        done = run(mini, request_of(mini, cell), Quiet())
        found = run_of(mini, cell, headlines, done)
        assert found.failed is None
        assert found.headlines == {"twice": value}
        assert found.verdicts["P1-M-twice"].startswith(verdict)
        assert found.seconds > 0
        assert found.key == request_key(mini, done.request)


def test_a_run_that_fails_is_a_result(mini: MiniProject) -> None:
    cell = Cell("baseline", "00")
    failure = ChapterError(
        f"Chapter 00 failed:\n\x1b[31mThe design\x1b[0m of {mini.root}/data/x has no solution.\n"
    )
    found = run_of(mini, cell, small().headlines, failure)
    assert found.failed == "The design of data/x has no solution."
    assert found.headlines == {}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is not a study: the file: Invalid JSON"),
        ("{}", "is not a study: made: Field required"),
        ('{"made": 1, "runs": []}', "is not a study: made: "),
    ],
)
def test_a_bad_study_gives_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "study.json"
    path.write_text(text)
    with pytest.raises(InswsnError, match=r"\.$") as refused:
        read_study(path)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_no_study_is_told(tmp_path: Path) -> None:
    with pytest.raises(InswsnError, match="make it with make studies"):
        read_study(tmp_path / "none.json")


def study() -> Study:
    """Return a study of three runs."""
    made = Made(
        version="1.0.0", day="2026-11-22", commit=None, clean=None, sources={}, recorded=False,
        python="3.11", system="Linux", cpu="one", packages={},
    )  # fmt: skip
    return Study(made=made, runs=tuple(one(name) for name in ("baseline", "seed-1", "seed-2")))


def one(identity: str, **fields: Any) -> Run:
    given = {"id": identity, "chapter": "00", "parameters": {}, "seconds": 1.0, "key": "0" * 64}
    return Run(**(given | fields))  # type: ignore[arg-type]


def test_a_study_reads_back(tmp_path: Path) -> None:
    write_study(study(), tmp_path / "study.json")
    assert read_study(tmp_path / "study.json") == study()
    other = one("seed-1", seconds=50.0)
    runs = merged([other], {(run.chapter, run.id): run for run in study().runs})
    assert [run.id for run in runs] == ["baseline", "seed-1", "seed-2"]
    assert runs[1] == other


def test_the_cells_of_one_entry() -> None:
    assert [cell.id for cell in cells_of(small(), ["P1-M-scale"])] == [
        "baseline", "seed-1", "seed-2", "P1-M-scale/three", "P1-M-scale/ten",
    ]  # fmt: skip
    assert cells_of(small(), ["P2-M-word"]) == []
    with pytest.raises(InswsnError, match="no assumption P9"):
        cells_of(small(), ["P9-M-none"])
