"""The pages: what their templates say of results made by hand, and what the build adds to one."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from conftest import MiniProject, Render
from inswsn_book.judge.ledger import MissingCheck
from inswsn_book.judge.verdicts import OUTCOMES, verdicts
from inswsn_book.make.pages import (
    context,
    environment,
    reference,
    stage_book,
    with_captions,
    with_notes,
    with_pictures,
)
from inswsn_book.record.results import Provenance
from inswsn_book.run.store import Request, Run
from made_results import claim, results

import inswsn_lib
from inswsn_lib.errors import BuildError

MISSING = MissingCheck(needs=("lost",), reasons=("It is lost.",))
MADE = Provenance(
    version="1.0.0", commit=None, clean=None, sources={"library": "b" * 64}, cores=2, cpu="One",
    finished="2026-11-22 06:00 UTC", seconds=12.3, python="3.11.7", system="Linux x86_64",
    blas=("openblas 1, 1 thread",), packages={"numpy": "2.4.0", "scipy": "1.17"},
)  # fmt: skip
BARE = results(provenance=MADE, cells={"q": "ch00-001"})


def rows(text: str, name: str) -> dict[str, list[str]]:
    """Read one table of a page back, by its label, as rows of cells behind their first ones."""
    tables = re.findall(r"^:::::\{list-table\}(.*?)^:::::$", text, re.M | re.S)
    (table,) = (part for part in tables if f":name: {name}\n" in part)
    read = [
        re.findall(r"^(?:\* |  )- ?(.*)", row, re.M)
        for row in re.split(r"^(?=\* -)", table, flags=re.M)
    ]
    return {row[0]: row[1:] for row in read if row}


# Templates ---------------------------------------------------------------------------------------


def test_the_counts_of_the_front_page_add_up(render: Render, known: dict[str, Any]) -> None:
    ((total, outcomes),) = re.findall(r"Of (\d+) claims (.*) \(\{doc\}", render("index"))
    assert int(total) == len(known["judged"])
    counts = [int(count) for count in re.findall(r"\*\*(\d+)\*\* ", outcomes)]
    assert (len(counts), sum(counts)) == (3, int(total))
    table = rows(render("claims"), "tbl-claims")
    assert [int(table[f"**{name}**"][3]) for name in OUTCOMES] == counts


def test_the_heads_of_chapters(mini: MiniProject, known: dict[str, Any]) -> None:
    """Every chapter of the book says what it needs and how long it takes."""
    heads = [c for c in known["chapters"] if c["name"].startswith("evidence/")]
    assert len(heads) == 12
    assert [c["name"] for c in heads if not (c["need"] and c["minutes"])] == []
    mini.ledger.write_text("missing: {}\nclaims: []\n")
    head = "**You need** means, and\nsums. **Reading time** 25 minutes. **Run time** 3 s."
    for text, said in (("", ("", "")), (head, ("means, and\nsums", "25"))):
        mini.source.write_text(mini.source.read_text() + text)
        (found,) = context(mini, [])["chapters"]
        assert (found["need"], found["minutes"], found["results"]) == (*said, None)


def test_the_page_of_many_claims(render: Render) -> None:
    kinds = ("numeric", "parameter", "qualitative", "formula")
    claims = [
        claim(
            id=f"P{1 + i % 3}-X-{i:03d}", paper=f"P{1 + i % 3}", place=f"Table {i}", check=MISSING,
            says="It is *so* & $x < y$.", kind=kinds[i % 4], value=None, tolerance=None,
        )
        for i in range(374)
    ]  # fmt: skip
    text = render("claims", judged=verdicts(claims, []))
    assert all(text.count(f"\n({each.anchor})=\n") == 1 for each in claims)
    table = rows(text, "tbl-claims")
    assert table["verdict"] == ["P1", "P2", "P3", "all", "assumed"]
    for name in ("all", "**cannot be decided**", "cannot be tested"):
        assert table[name] == ["125", "125", "124", "374", "0"]
    # each button but the first of its group has a rule that hides the others
    names = set(re.findall(r'id="(show-[a-z]+-[1-9]\d*)"', text))
    assert len(names) == 3 + 4 + 1
    assert set(re.findall(r"body:has\(#(\S+):checked\)", text)) == names


def test_the_state_of_the_build_adds_up(render: Render, known: dict[str, Any]) -> None:
    page = render("cite")
    runs, judged = rows(page, "tbl-runs"), rows(page, "tbl-verdicts")
    assert len(runs) == 2 + len(known["chapters"])
    for column in (3, 5):  # quantities, and claims treated
        *parts, whole = [int(row[column]) for row in list(runs.values())[1:]]
        assert sum(parts) == whole
    held, bound = runs["all"][4].split(" of ")
    assert held == bound
    for *parts, whole in [list(map(int, row)) for row in list(judged.values())[1:]]:
        assert sum(parts) == whole
    assert judged["all"][-1] == str(len(known["judged"]))


def test_a_persons_name_is_no_group_in_bibtex(render: Render, known: dict[str, Any]) -> None:
    authors = ("van Berg, Ana", "Rovers and Co")
    about = known["about"] | {"names": authors, "doi": "10.5281/zenodo.1", "version": "1.2.3"}
    page = render("cite", about=about)
    assert "  author       = {van Berg, Ana and {Rovers and Co}},\n" in page
    assert page.count("note         = {Version 1.2.3,") == 1  # of a verdict
    assert page.count("note         = {Version 1.2.3},\n  doi          = {10.5281/zenodo.1},") == 1
    assert "van Berg, Ana; Rovers and Co (" in page


def test_the_reference_has_the_front_door_first_and_every_name_once() -> None:
    (_, first), *_ = groups = reference()
    assert first
    pairs = [pair for _, group in groups for pair in group]
    assert len(pairs) == len({name for _, name in pairs})
    rooms = [getattr(inswsn_lib, name) for name in inswsn_lib.__all__]
    offered = {n for room in rooms if hasattr(room, "__path__") for n in room.__all__}
    assert offered <= {name.rsplit(".", 1)[1] for _, name in pairs}
    assert ("autofunction", "inswsn_lib.filters.run_kalman") in pairs
    assert ("autoclass", "inswsn_lib.models.ErrorModel") in pairs


# What the build adds to a chapter ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        ({}, ("- none\n", "none declared", "none called", "none read")),
        ({"parameters": {"seed": 7}, "data": {"data/x": "a" * 64}, "solvers": {"HiGHS": "optimal"}},
         ("`seed = 7`", "unknown: not a git checkout\n", "HiGHS: optimal", "12.3 s, ended",
          "numpy 2.4.0, scipy 1.17\n", "`data/x` `aaaaaaaaaaaa…`")),
    ],
)  # fmt: skip
def test_the_provenance_of_a_run(root: Path, facts: dict[str, Any], words: list[str]) -> None:
    run = BARE.model_copy(update=facts)
    (cell,) = with_notes(nbformat.v4.new_notebook(), run, [], environment(root)).cells
    assert cell["id"] == "ch00-provenance"
    assert [word for word in words if word not in cell.source] == []


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize(
    ("number", "said"),
    [(1, "decides the claim ["), (2, "decides the claims ["), (6, "decides 6 claims\n")],
)
def test_links_precede_a_cell_that_decides(
    root: Path, number: int, said: str, hidden: bool
) -> None:
    cell = nbformat.v4.new_code_cell("x", metadata={"tags": ["remove-cell"] if hidden else []})
    cell["id"] = "ch00-001"
    check = {"chapter": "00", "quantity": "q"}
    claims = [claim(id=f"P1-{i}", check=check) for i in range(number)]
    notebook = nbformat.v4.new_notebook(cells=[cell])
    before, _, _ = with_notes(notebook, BARE, claims, environment(root)).cells
    assert before["id"] == "ch00-001-claims"
    assert before.source.startswith("(cell-ch00-001)=\n:::{")
    assert all(f"[{each.id}](#{each.anchor})" in before.source for each in claims)
    assert ("left out here" in before.source) is hidden
    assert said in before.source


def test_captions_move_to_the_cell() -> None:
    def output(name: str) -> Any:
        words = {"name": name, "caption": f"See {name}.", "alt": f"What {name} shows."}
        return nbformat.v4.new_output("display_data", metadata={"inswsn": words})

    cell = nbformat.v4.new_code_cell("x", outputs=[output("fig-a")])
    notebook = with_captions(nbformat.v4.new_notebook(cells=[cell]))
    assert notebook.cells[0].metadata["mystnb"] == {
        "image": {"alt": "What fig-a shows."}, "figure": {"caption": "See fig-a.", "name": "fig-a"}
    }  # fmt: skip
    cell["outputs"].append(output("fig-b"))
    with pytest.raises(BuildError, match="shows two figures; a cell shows one"):
        with_captions(notebook)


def test_the_still_of_a_figure_that_moves_has_a_cell_of_its_own() -> None:
    moving = nbformat.v4.new_output("display_data", {"text/html": '<section class="moving">'})
    still = nbformat.v4.new_output("display_data", metadata={"inswsn": {"name": "fig-a"}})
    cells = [nbformat.v4.new_code_cell("show()", outputs=[moving, still])]
    cells.append(nbformat.v4.new_code_cell("x", outputs=[still]))
    first, picture, other = with_pictures(nbformat.v4.new_notebook(cells=cells)).cells
    assert (first.source, first.outputs, other.outputs) == ("show()", [moving], [still])
    assert (picture.outputs, picture.metadata) == ([still], {"tags": ["remove-input"]})
    assert picture.source  # without a word Sphinx would leave it out


# The site ----------------------------------------------------------------------------------------


def test_nothing_is_written_into_the_folder_of_the_pages(mini: MiniProject, tmp_path: Path) -> None:
    before = sorted((mini.root / "book").rglob("*"))
    mini.ledger.write_text("missing: {}\nclaims: []\n")
    notebook, source = nbformat.writes(nbformat.v4.new_notebook()), tmp_path / "source"
    stage_book(mini, [Run(Request("00"), BARE, notebook)], source)
    assert sorted((mini.root / "book").rglob("*")) == before
    staged = {path.relative_to(source).as_posix() for path in source.rglob("*.*")}
    assert {"index.md", "_toc.yml", "chapters/00-mini.ipynb", "generated/00.json"} <= staged
    assert not any("_templates" in name for name in staged)
    assert {name for name in staged if name.endswith(".py")} == {"conf.py"}
