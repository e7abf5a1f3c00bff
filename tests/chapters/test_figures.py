"""What holds for every figure of the book: one colour a method, and letters that can be read."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inswsn_book.record.project import Project
from inswsn_book.run.store import Request, lookup
from inswsn_book.show.legible import (
    label_lines,
    least_points,
    legend_of,
    place_labels,
    texts_in_the_way,
)
from matplotlib import pyplot as plt

from inswsn_lib.plotting import STROKES, figure, stroke

# what a label names: the first that is found in it
METHODS = (
    ("lssvm", r"LS-SVM"),
    ("backprop", r"\bBP\b"),
    ("rbf", r"\bRBF\b"),
    ("federated", r"\bFKF\b"),
    ("distributed", r"\bDHF\b"),
    ("smoother", r"smoother"),
    ("network", r"^network|^fixes$|deadbeat|last (fix|correction)"),
    ("ins", r"INS-only|INS alone|error of the INS|never aided"),
    ("hinfinity", r"\bHF\b|H-infinity|H∞|Riccati"),
    (
        "kalman",
        r"Kalman|\bKF\b|NEES|NIS|coasting filter|aided (before|through|filter)|INS corrected",
    ),
    ("kalman", r"Schmidt|two more states|gating|Huber|adaptive R"),
    ("truth", r"^(truth|path|reference)$"),
)


def figures(project: Project) -> dict[str, dict[str, Any]]:
    """Return what `show_figure` says of each figure of the executed notebooks, by name."""
    runs = [lookup(project, Request(chapter.id)) for chapter in project.chapters()]
    cells = [cell for run in runs if run for cell in json.loads(run.notebook)["cells"]]
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    shown = (output.get("metadata", {}).get("inswsn") for output in outputs)
    return {words["name"]: words for words in shown if words}


def wrong(legend: dict[str, str]) -> dict[str, str]:
    """Return the labels of a legend in another colour than that of the method they name."""
    named = {
        label: next((m for m, pattern in METHODS if re.search(pattern, label)), None)
        for label in legend
        if "\n" not in label  # that is a key to many
    }
    return {
        label: f"{legend[label]}, not {method}"
        for label, method in named.items()
        if method and legend[label] != STROKES[method].colour
    }


def test_every_figure_is_read_with_ease(built_site: Path, project: Project) -> None:
    """A method has its own colour, no letter is in the way, and none is below 8 points."""
    found = figures(project)
    assert len(found) > 30
    assert {name: bad for name, f in found.items() if (bad := wrong(f["legend"]))} == {}
    assert {name: f["in the way"] for name, f in found.items() if f["in the way"]} == {}
    assert {name: f["points"] for name, f in found.items() if f["points"] < 8} == {}


def test_a_method_in_the_colour_of_another_is_found() -> None:
    fig, ax = figure()
    ax.plot([0, 1], label="Kalman, tuned", **stroke("kalman"))
    ax.errorbar([0, 1], [0, 1], [0.1, 0.1], label="HF + BP", color=STROKES["rbf"].colour)
    ax.plot([0, 1], label="KF")
    fig.legend()
    assert [*wrong(legend_of(fig))] == ["KF", "HF + BP"]
    plt.close(fig)


@pytest.mark.parametrize(
    ("texts", "found"),
    [
        ([(0.5, 0.5)], ["0"]),  # on the marker
        ([(0.2, 0.2), (0.205, 0.2)], ["0", "1"]),
        ([(0.2, 0.2), (0.8, 0.8)], []),
        ([(1.4, 0.5)], ["0"]),  # beyond the edge
    ],
)
def test_a_text_in_the_way_is_found(texts: list[tuple[float, float]], found: list[str]) -> None:
    fig, ax = figure()
    fig.set_layout_engine("none")
    ax.plot([0.5, 9.0], [0.5, 9.0], "o")
    ax.set(xlim=(0, 1), ylim=(0, 1))
    for i, place in enumerate(texts):
        ax.text(*place, str(i), fontsize=9)
    assert (texts_in_the_way(fig), least_points(fig)) == (found, 9.0)
    plt.close(fig)


def test_texts_are_placed_where_they_hide_nothing() -> None:
    fig, (left, right) = figure(1, 2)
    way = np.stack([np.linspace(0, 10, 300), 3 * np.sin(np.linspace(0, 10, 300))], axis=1)
    left.plot(*way.T)
    left.plot(*way[::30].T, "o", ms=6)
    place_labels(left, [f"No. {i}" for i in range(10)], way[::30], way)
    for method, height in (("ins", 0.0), ("kalman", 0.3), ("hinfinity", -0.3)):
        right.plot(
            way[:, 0], way[:, 1] + height, "o", ms=1, label=method, color=stroke(method)["color"]
        )
    label_lines(right)
    assert texts_in_the_way(fig) == []
    assert {t.get_text(): t.get_color() for t in right.texts} == legend_of(fig)
    plt.close(fig)
