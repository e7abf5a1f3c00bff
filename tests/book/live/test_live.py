"""Cells that run one by one, what they need of each other, and what a page is given."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import zipfile
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from bs4 import BeautifulSoup
from inswsn_book.live.about import about_lesson, fields
from inswsn_book.live.absent import PACKAGES, AbsentError
from inswsn_book.live.bundle import archive
from inswsn_book.live.cells import Lesson, Plan, answer, before, names
from inswsn_book.live.html import policy_of, with_cells, with_policy
from inswsn_book.live.measured import Measured
from inswsn_book.live.site import lessons
from inswsn_book.live.unrecorded import ChapterRecord as Unrecorded
from inswsn_book.record import ChapterRecord
from inswsn_book.record.parameters import read_schema
from inswsn_book.record.project import Project
from inswsn_book.record.results import Results


@pytest.mark.parametrize(
    ("source", "needed", "bound"),
    [
        ("x = y", {"y"}, {"x"}),
        ("y = 1\nx = y", set(), {"x", "y"}),
        ("x = x + 1", {"x"}, {"x"}),
        ("def f(a): return a + b", {"b"}, {"f"}),
        ("[k * n for k in range(3)]", {"n"}, set()),
        ("import numpy as np\nnp.pi", set(), {"np"}),
        ("for i in things: print(i)", {"things"}, {"i"}),
        ("class A(B):\n    c = d", {"B", "d"}, {"A"}),
        ("with f() as g: pass", {"f"}, {"g"}),
    ],
)
def test_names_of_a_cell(source: str, needed: set[str], bound: set[str]) -> None:
    found, binds = names(source)
    assert found == needed
    assert bound <= binds


CELLS = ["a = 1", "b = a + 1", "c = 5", "print(b + c)", "a = 10", "print(a)"]


def test_what_a_cell_needs_comes_from_the_last_cell_above_it() -> None:
    assert [before(CELLS, i) for i in range(6)] == [[], [0], [], [0, 1, 2], [], [4]]
    assert before(["a = 1", "a +"], 1) == []


def test_a_cell_runs_with_what_it_needs_and_again_alone() -> None:
    plan = Plan()
    assert plan.needed(CELLS, [3]) == [0, 1, 2, 3]
    for cell in (0, 1, 2, 3):
        plan.ran(cell, CELLS[cell])
    assert plan.needed(CELLS, [3]) == [3]
    changed = ["a = 2", *CELLS[1:]]
    assert plan.needed(changed, [3]) == [0, 1, 3]
    plan.ran(0, "a = 2")  # by itself: what needs it is old now
    assert plan.needed(changed, [3]) == [1, 3]
    assert plan.below(CELLS, 0) == [1, 3]
    for turn in plan.turns({"sources": CELLS, "wanted": [2], "runs": [True] * 6}):
        assert turn == {"cell": 2, "starts": 1, "of": 1}  # and does not end well
    assert 2 in plan.needed(CELLS, [3])


def test_a_cell_that_fails_keeps_from_running_what_needs_it_alone() -> None:
    sources = ["a = 1 / 0", "b = a", "c = b", "d = 2", "print(d)"]
    assert [cell for cell, said in told(sources, [2, 4]) if said] == [0, 4]
    assert [cell for cell, _ in told(CELLS, [0], below=True)] == [0, 1, 2, 3]
    assert [cell for cell, _ in told(["a = 1", *sources[1:]], [2, 4])] == [0, 1, 2, 3, 4]


def told(sources: list[str], wanted: list[int], **more: object) -> list[tuple[int, str]]:
    asked = {"sources": sources, "wanted": wanted, "runs": [True] * len(sources)} | more
    found = answer(Lesson(), Plan(), asked)
    return [(said["cell"], said["text"] or said["error"]) for said in found if "text" in said]


@pytest.mark.parametrize(
    ("sources", "said"),
    [
        (CELLS[:4], "7\n"),
        (["a = 4", *CELLS[1:4]], "10\n"),
        (["1 + 1"], "2\n"),  # as in a notebook
        (["1 + 1;"], ""),
        (["None"], ""),
    ],
)
def test_what_a_cell_prints(sources: list[str], said: str) -> None:
    last = len(sources) - 1
    assert told(sources, [last])[-1] == (last, said)


def test_an_error_is_shown_as_python_shows_it() -> None:
    sources = ["def f(x):\n    return 1 / x", "f(0)", "f(1)"]
    ((cell, _), (failed, error), after) = told(sources, [1, 2])
    assert (cell, failed, after) == (0, 1, (2, "1.0\n"))
    lines = error.splitlines()
    assert lines[0] == "Traceback (most recent call last):"
    assert '  File "<cell 2>", line 1, in <module>' in lines
    assert '  File "<cell 1>", line 2, in f' in lines
    assert "    return 1 / x" in lines
    assert lines[-1] == "ZeroDivisionError: division by zero"
    assert "inswsn_book" not in error
    ((_, error),) = told(["x ="], [0])
    assert error.endswith("    x =\n       ^\nSyntaxError: invalid syntax\n")


def blocked(code: str) -> str:
    script = f"from inswsn_book.live import absent\nabsent.block()\n{code}"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr.strip().rpartition("\n")[2]


@pytest.mark.parametrize("name", ["scipy", "cvxpy", "torch", "pydantic", "yaml"])
def test_an_absent_package_is_imported_but_not_used(name: str) -> None:
    assert name in PACKAGES
    assert blocked(f"import {name}\nfrom {name} import thing\nprint(1)") == "1\n"
    assert blocked(f"from {name}.deep import thing\nthing()").endswith(
        f"{name} is not in the page."
    )


def test_one_may_inherit_from_what_is_absent() -> None:
    code = "from sklearn.base import B, C\nclass A(B, C):\n    def __init__(self): self.x = 3\n"
    assert blocked(f"{code}print(A().x)") == "3\n"
    assert "not in the page" in blocked("from pydantic import M\nclass A(M): pass\nA()")


def test_what_is_loaded_cannot_be_made_absent() -> None:
    code = "import yaml\nfrom inswsn_book.live import absent\nabsent.block()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "yaml is loaded already." in done.stderr


def test_the_archive_is_the_same_each_time_and_has_data_that_json_can_read(
    project: Project, published: dict[str, Results]
) -> None:
    first = archive(project)
    assert first == archive(project)
    assert len(first) < 1_500_000
    with zipfile.ZipFile(BytesIO(first)) as packed:
        scenario = json.loads(packed.read("inswsn_lib/data/scenarios/p1.yaml"))
        assert set(scenario["speed"]) == {"value", "unit", "source", "why"}
        names = packed.namelist()
        assert "inswsn_book/run/store.py" not in names
        licences = [name for name in names if name.rpartition("/")[2].startswith("LICENSE")]
        assert len(licences) == 2  # of mpmath and lazy_loader, which others made
        values = json.loads(packed.read("inswsn_lib/data/published.json"))
    said = {q.name: [q.value, *(q.interval or ())] for q in published["p2-fusion"].quantities}
    assert values["p2-fusion"] == said


def test_a_record_in_the_page_has_what_cells_ask_of_one(
    project: Project, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = set()
    paths = [chapter.source for chapter in lessons(project)]
    for path in (*paths, *(project.libraries[1] / "lessons").glob("*.py")):
        asked |= set(re.findall(r"\brecord\.(\w+)\(", path.read_text(encoding="utf-8")))
    assert {"data", "holds", "reference", "say"} <= asked
    assert all(hasattr(Unrecorded, name) and hasattr(ChapterRecord, name) for name in asked)
    record = Unrecorded("lesson-2", {})
    assert record.data("papers/p1.yaml").is_file()
    with pytest.raises(AbsentError, match=r"^data/recorded/none\.json is not in the page\.$"):
        record.data("recorded/none.json")
    record.holds("It is so.", condition=True)
    record.holds("It is so, too.", np.float64(1) > 2)
    assert capsys.readouterr().out == "No longer true: It is so, too.\n"
    record.say("x", "y")


def test_parameters_become_fields(project: Project) -> None:
    assert len(lessons(project)) == 8
    (chapter,) = (each for each in lessons(project) if each.id == "lesson-2")
    measured = [Measured("", 0.123, "", []), *[Measured("scipy", 0, "", [])] * 18]
    told = about_lesson(project, chapter, measured)
    seed, q_scale, *_ = told["parameters"]
    assert (seed["name"], seed["whole"], seed["low"], seed["high"]) == ("seed", True, 0, 1000000)
    assert (q_scale["value"], q_scale["low"]) == (1.0, 1e-4)
    assert told["cells"][0] == {"needs": "", "seconds": 0.1, "before": []}
    assert told["cells"][1] == {"needs": "scipy", "seconds": 0, "before": [0]}


HTML = """<!DOCTYPE html><html lang="en"><head><title>x</title><script>let a = "é";</script></head>
<body><button onclick="window.print()">x</button><script src="x.js"></script>
<script type="application/json">{"b": 1}</script></body></html>
"""


def test_what_a_page_is_told_ends_no_script() -> None:
    about = {"cells": [1], "said": "</script>\\1"}
    page = BeautifulSoup(with_cells(HTML, "../", about), "html.parser")
    assert json.loads(page.select_one("body > #live").string) == about
    assert [link["href"] for link in page.select("head > link")] == ["../_static/live.css"]
    assert [script["src"] for script in page.select("#live + script")] == ["../_static/live.js"]


def test_a_policy_lets_run_what_stands_in_the_page_alone() -> None:
    policy = dict(part.split(" ", 1) for part in policy_of(HTML).split("; "))
    # openssl dgst -sha256 -binary | base64, of each text
    script = "'sha256-bRpuFRoYVKjvn/GA0B4PGwNkBZ9x/rIEtQahq9wjZ24='"
    handler = "'sha256-MguIPR6qNR8D3B+eAlK+bIRTZe8t3wkOY4B/56Me9FU='"
    own = "'self' 'wasm-unsafe-eval'"
    assert policy["script-src"] == f"{own} {script} 'unsafe-hashes' {handler}"
    assert policy["default-src"] == policy["object-src"] == policy["base-uri"] == "'none'"
    assert policy["connect-src"] == policy["worker-src"] == "'self'"
    assert f"script-src {own} 'unsafe-hashes' {handler};" in policy_of("")
    assert re.findall(r'Policy" content="(\w+)"', with_policy(HTML, "first")) == ["first"]


@pytest.mark.parametrize(
    ("rule", "limits"),
    [
        ("float = 1.0  # 1; in [0, 10)", (0, 10, False, True)),
        ("float = 1.0  # 1; in (0, inf)", (0, None, True, False)),
        ("int = 1  # 1; in (0, 10)", (1, 9, False, False)),
        ("int = 1  # 1; any", (None, None, False, False)),
    ],
)
def test_a_field_has_the_limits_of_its_parameter(rule: str, limits: tuple[Any, ...]) -> None:
    schema = read_schema(f"# It.\nx: {rule}\n")
    (field,) = fields(schema.parameters)
    assert tuple(field[name] for name in ("low", "high", "above", "below")) == limits
