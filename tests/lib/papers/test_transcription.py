"""data/papers against a second transcription, made by another hand from the papers' text alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from inswsn_lib.papers import COLUMNS, read_numbers, read_table


@pytest.fixture(scope="module")
def second() -> dict[str, Any]:
    path = Path(__file__).parents[2] / "data" / "second-transcription.yaml"
    return yaml.safe_load(path.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder(root: Path) -> Path:
    return root / "data" / "papers"


def test_table_1(second: dict[str, Any], folder: Path) -> None:
    table = read_table(folder / "p1-table1.csv", index="no")
    assert list(table.index) == [str(row) for row in range(1, 11)]
    assert {name: list(table[name]) for name in table} == second["P1"]["table1"]


@pytest.mark.parametrize("number", ["2", "3"])
def test_tables_2_and_3(number: str, second: dict[str, Any], folder: Path) -> None:
    table = read_table(folder / f"p1-table{number}.csv", index="method")
    assert tuple(table.columns) == COLUMNS
    assert {row: list(table.loc[row]) for row in table.index} == second["P1"][f"table{number}"]
    captions = read_numbers(folder / "p1.yaml")["captions"]
    assert captions[f"table{number}"] == second["P1"][f"table{number}_caption_methods"]


def test_fragments_of_table_3_hold_its_cells(folder: Path) -> None:
    pieces = read_table(folder / "p1-table3-fragments.csv", index="BP")
    table = read_table(folder / "p1-table3.csv", index="method")
    assert set(zip(pieces.index, pieces["LS-SVM"], strict=True)) == set(
        zip(table.loc["BP"], table.loc["LS-SVM"], strict=True)
    )


@pytest.mark.parametrize("area", ["area1", "area2"])
def test_filter_matrices(area: str, second: dict[str, Any], folder: Path) -> None:
    assert read_numbers(folder / "p1.yaml")["filters"][area] == second["P1"][area]


def test_text_of_p1(second: dict[str, Any], folder: Path) -> None:
    ours, theirs = read_numbers(folder / "p1.yaml")["text"], second["P1"]["text"]
    assert ours["hf_vs_kf"] == theirs["hf_vs_kf_area1"]
    compared = {f"{kind[0].replace('p', 'r')}{axis}": theirs["lssvm_vs_bp"][f"{kind}_{axis}"]
                for kind in ("position", "velocity") for axis in "xy"}  # fmt: skip
    assert ours["lssvm_vs_bp"] == compared
    assert ours["selected"] == theirs["selected"]
    assert ours["sampling_period"] == theirs["sampling_period_text"]
    for name in ("training_points", "validation_points", "outage_seconds"):
        assert ours[name] == theirs[name]
    names = {
        "width": "area_width", "height": "area_height", "start": "start", "end": "end",
        "area1_side": "training_area1_side", "area2_side": "training_area2_side",
        "node_spacing": "rn_spacing", "range": "comm_range", "wsn_accuracy_cm": "wsn_accuracy_cm",
    }  # fmt: skip
    assert ours["scene"] == {name: theirs[other] for name, other in names.items()}


def test_p2(second: dict[str, Any], folder: Path) -> None:
    ours, theirs = read_numbers(folder / "p2.yaml"), second["P2"]
    assert ours["abstract"] == theirs["abstract"]
    assert ours["results"] == {
        {"position": "r", "velocity": "v"}[kind] + axis: theirs["results"][kind][axis]
        for kind in ("position", "velocity")
        for axis in "xy"
    }
    names = {"rn_spacing": "node_spacing", "comm_range": "range"}
    assert ours["settings"] == {names.get(n, n): value for n, value in theirs["settings"].items()}


def test_p3(second: dict[str, Any], folder: Path) -> None:
    ours, theirs = read_numbers(folder / "p3.yaml"), second["P3"]
    assert list(ours["outage1"].values()) == list(theirs["outage1"].values())
    assert list(ours["outage4"].values()) == list(theirs["outage4"].values())
    assert ours["outage5_50s"] == theirs["outage5_50s"]
    assert ours["outage5"]["improvement_about"] == theirs["outage5_40s_improvement"]
    assert ours["outage8"]["improvement_about"] == theirs["outage8_40s_improvement"]
    assert ours["ranges"] == theirs["ranges"]
    assert ours["average_improvement_at_least"] == theirs["average_improvement_seven"]
    settings = ours["settings"] | {"gps_position_m": ours["settings"]["gps_position"]}
    del settings["gps_position"]
    assert settings == theirs["settings"]
