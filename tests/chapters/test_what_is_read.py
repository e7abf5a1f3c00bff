"""What a chapter reads below data/ is what its results file says that it read.

Chapters are executed under an audit hook. Some take long however few their runs: those are executed
with INSWSN_TESTS=whole only, and their code is looked through in every run of the tests.
"""

from __future__ import annotations

import ast
import os
import re
from pathlib import Path

import nbformat
import pytest
from conftest import weekly_but
from inswsn_book.record.files import MANIFEST
from inswsn_book.record.notebooks import read_source
from inswsn_book.record.parameters import Value
from inswsn_book.record.project import RESULTS_VARIABLE, ROOT_VARIABLE, Project
from inswsn_book.record.results import read_results
from inswsn_book.run.kernels import execute_notebook

# parameters with which a chapter is quick, and which are not those of the published run
QUICK: dict[str, dict[str, Value]] = {
    "printed-numbers": {"training_samples": 12, "outage_samples": 12},
    "p1-lmi": {"systems": 40, "runs": 40, "margin": 0.1},
    "lesson-1": {"seed": 7},
    "lesson-7": {"about_points": 5.0},
    "lesson-8": {"seed": 7},
    "lesson-2": {"seed": 7},
    "lesson-4": {"seed": 7},
    "lesson-6": {"seed": 7},
    "lesson-3": {"seed": 7},
    "lesson-5": {"seed": 7},
    "p1-training": {"runs": 40, "other_runs": 40, "velocity_source": "window"},
    "p1-outages": {"runs": 40, "tuning_runs": 4, "networks": 40},
    "p2-fusion": {"runs": 64, "other_runs": 40, "speed": 6.0, "most_clusters": 8},
    "p3-vehicle": {"routes": 5, "draws": 2, "sweep_draws": 2, "recorded_draws": 2},
    "recorded-data": {"trials": 2, "runs": 8},
    "61": {"tolerance": 1.0},
    "62": {"tolerance": 0.01},
    "63": {"tolerance": 5.0},
    "64": {"tolerance": 0.01},
    "65": {"tolerance": 0.1},
    "which-filter": {"seed": 7},
    "your-own-data": {"wsn_position_noise": 0.3},
}


#: What is executed daily, beside the book
DAILY = {"64", "lesson-7"}
LONG = {
    "printed-numbers", "p1-lmi", "p1-training", "p1-outages", "p2-fusion", "p3-vehicle",
    "recorded-data", "62", *(f"lesson-{n}" for n in (1, 2, 3, 4, 5, 6, 8)),
}  # fmt: skip
SPY = """\
import os, sys
def _hook(event, args, log=open({log!r}, "w", buffering=1)):
    if event == "open" and not isinstance(args[0], int):
        log.write(os.fsdecode(args[0]) + "\\n")
sys.addaudithook(_hook)
"""


def test_every_chapter_is_looked_at(project: Project) -> None:
    assert {chapter.id for chapter in project.chapters()} == {*QUICK}


#: What a chapter calls with the name of a file that it reads, and of a study that it may compute
RECORDING = "record.data", "record.study"


def unrecorded(code: str, data: Path) -> list[str]:
    """Return what in the code of a chapter may read a file below data/ without recording it."""
    tree = ast.parse(code)
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
    recorded = {id(a) for c in calls if ast.unparse(c.func) in RECORDING for a in c.args}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            name = node.value.removeprefix("data/")
            if 0 < len(name) < 200 and (data / name).is_file() and id(node) not in recorded:
                found.append(name)
        elif isinstance(node, ast.Name | ast.Attribute):
            name = node.id if isinstance(node, ast.Name) else node.attr
            if name in {"open", "Path", "find_root", "read_csv"}:
                found.append(name)
    return found


@pytest.mark.parametrize("number", sorted(LONG))
def test_its_code_names_no_file_but_to_the_record(number: str, project: Project) -> None:
    cells = read_source(project.by_id(number)).cells
    code = "\n".join(cell.source for cell in cells if cell.cell_type == "code")
    for module in re.findall(r"from inswsn_book\.lessons import (\w+)", code):  # it may record
        path = project.libraries[1] / "lessons" / f"{module}.py"
        code += "\n" + path.read_text(encoding="utf-8")
    assert unrecorded(code, project.root / "data") == []


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("read_numbers(record.data('papers/p1.yaml'))", []),
        ("read_numbers('papers/p1.yaml')", ["papers/p1.yaml"]),
        ("name = 'data/papers/p1.yaml'\nrecord.data(name)", ["papers/p1.yaml"]),
        ("find_root() / 'da' / 'ta'", ["find_root"]),
        ("pd.read_csv(x)", ["read_csv"]),
    ],
)
def test_what_reads_without_record_is_found(code: str, found: list[str], project: Project) -> None:
    assert unrecorded(code, project.root / "data") == found


@pytest.mark.long
@pytest.mark.parametrize("number", weekly_but(DAILY, sorted(QUICK)))
def test_it_reads_what_it_says_alone(number: str, project: Project, tmp_path: Path) -> None:
    """An audit hook sees every file that the kernel opens below data/."""
    notebook, log = read_source(project.by_id(number)), tmp_path / "opened"
    notebook.cells.insert(0, nbformat.v4.new_code_cell(SPY.format(log=str(log))))
    own = {
        ROOT_VARIABLE: str(project.root),
        RESULTS_VARIABLE: str(tmp_path / "results"),
        "IPYTHONDIR": str(tmp_path / "ipython"),
    }
    execute_notebook(notebook, QUICK[number], tmp_path, os.environ | own)
    opened = {Path(line).resolve() for line in log.read_text().splitlines()}
    data = {path for path in opened if path.is_relative_to(project.root / "data")}
    results = read_results(tmp_path / "results" / f"{number}.json")
    read = [(project.root / name.partition("#")[0]).resolve() for name in results.data]
    # the ledger is a folder; references are held against their digests
    data -= {project.published / MANIFEST}
    assert data == {f for path in read for f in ([path] if path.is_file() else path.glob("*.yaml"))}
    assert results.parameters.items() >= QUICK[number].items()
