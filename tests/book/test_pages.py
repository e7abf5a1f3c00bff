"""The pages: what their templates say of results made by hand, and what the build adds to one."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import nbformat
import pytest
from conftest import MiniProject
from inswsn_book import pages
from inswsn_book.ledger import Claim, MissingCheck, QuantityCheck
from inswsn_book.pages import (
    RenderingError,
    context,
    environment,
    reference,
    require_current_site,
    stage_book,
    with_captions,
    with_notes,
)
from inswsn_book.results import Provenance, Quantity, Results
from inswsn_book.runs import Request, Run
from inswsn_book.verdicts import Judged, Verdict, verdicts

import inswsn_lib
from inswsn_lib.errors import InswsnError


def rows(text: str, name: str) -> list[list[str]]:
    """Read one table of a page back, by its label, as rows of cells."""
    tables = re.findall(r"^:::::\{list-table\}(.*?)^:::::$", text, re.M | re.S)
    (table,) = (part for part in tables if f":name: {name}\n" in part)
    return [
        [cell[4:].strip().replace("\xa0", " ") for cell in row.splitlines() if cell.strip()]
        for row in re.split(r"^(?=\* -)", table.split("\n\n", 1)[1], flags=re.M)
        if row.strip()
    ]


def made(seconds: float, **changes: object) -> Provenance:
    fields = {
        "version": "1.0.0", "commit": "0123456789abcdef" + 24 * "0", "clean": True,
        "sources": {"library": "b" * 64}, "finished": "2026-11-22 06:00 UTC", "seconds": seconds,
        "python": "3.11.7", "system": "Linux x86_64", "cpu": "A processor", "cores": 2,
        "blas": ("openblas 1, 1 thread",), "packages": {"numpy": "2.4.0", "scipy": "1.17"},
    }  # fmt: skip
    return Provenance.model_validate(fields | changes)


def found(
    chapter: str, quantities: int = 0, ran: Provenance | None = None, **sentences: bool
) -> Results:
    names = [f"q{i}" for i in range(quantities)]
    fields: dict[str, Any] = {
        "unit": "m",
        "basis": "printed",
        "how": "Made by hand.",
        "tolerance": 0,
    }
    return Results(
        chapter=chapter, parameters={"seed": 7}, data={"data/x": "a" * 64}, sentences=sentences,
        quantities=tuple(Quantity(name=name, value=1.0, **fields) for name in names),
        provenance=ran, cells=dict.fromkeys(names, f"ch{chapter}-001"),
    )  # fmt: skip


def judged(number: int, chapter: str | None, verdict: Verdict) -> Judged:
    check: QuantityCheck | MissingCheck = MissingCheck(needs=("lost",), reasons=("It is lost.",))
    if chapter is not None:
        check = QuantityCheck(chapter=chapter, quantity="q0")
    claim = Claim.model_construct(
        id=f"P1-{number}", paper="P1", place="", says="", kind="numeric", check=check, why=""
    )
    return Judged(claim, verdict, "")


# The front page ----------------------------------------------------------------------------------


def test_the_counts_of_the_front_page_add_up(
    render: Callable[..., str], known: dict[str, Any]
) -> None:
    ((total, tested, first, rest),) = re.findall(
        r"\*\*(\d+) claims\*\*, of which (\d+) are put to the test: (.*) The others: (.*)",
        render("index"),
    )
    assert int(total) == len(known["judged"])
    assert sum(map(int, re.findall(r"\*\*(\d+)\*\* ", first))) == int(tested)
    assert int(tested) + sum(map(int, re.findall(r"\d+", rest))) == int(total)
    assert "cannot be tested" in rest  # what cannot be tested is not put to the test


def test_the_heads_of_chapters(mini: MiniProject, known: dict[str, Any]) -> None:
    """Every chapter of the book says what it needs and how long it takes."""
    assert [c["name"] for c in known["chapters"] if not (c["need"] and c["minutes"])] == []
    mini.ledger.write_text("missing: {}\nclaims: []\n")
    (silent,) = context(mini, [])["chapters"]
    assert (silent["need"], silent["minutes"], silent["results"]) == ("", "", None)
    head = "**You need** means, and\nsums. **Reading time** 25 minutes. **Run time** 3 s."
    mini.source.write_text(mini.source.read_text() + head)
    (said,) = context(mini, [])["chapters"]
    assert (said["need"], said["minutes"]) == ("means, and\nsums", "25")


# The state of the build --------------------------------------------------------------------------


@pytest.fixture
def status(render: Callable[..., str]) -> Callable[..., str]:
    """The page on the state of a build with some results."""
    entries = [
        judged(1, "00", Verdict.REPRODUCED), judged(2, "00", Verdict.REPRODUCED),
        judged(3, "01", Verdict.NOT_REPRODUCED), judged(4, None, Verdict.UNTESTABLE),
    ]  # fmt: skip

    def page(*results: Results) -> str:
        facts = [{"number": r.chapter, "name": f"{r.chapter}-name", "results": r} for r in results]
        return render("status", chapters=facts, judged=entries)

    return page


def test_the_runs_their_sums_and_their_verdicts(status: Callable[..., str]) -> None:
    page = status(
        found("00", 3, made(61.5), a=True, b=True),
        found("01", 2, made(63.5, clean=False), c=True, d=False),
        found("90"),
    )
    ended = "2026-11-22 06:00 UTC"
    assert rows(page, "tbl-runs")[1:] == [
        ["{doc}`00 <chapters/00-name>`", "61.5 s", ended, "`0123456789ab`", "3", "2 of 2", "2"],
        ["{doc}`01 <chapters/01-name>`", "63.5 s", ended, "`0123456789ab`, with changes", "2",
         "1 of 2", "1"],
        ["{doc}`90 <chapters/90-name>`", "unknown", "unknown", "unknown", "0", "0 of 0", "0"],
        ["all", "2 min 5 s", "", "", "5", "3 of 4", "3"],
    ]  # fmt: skip
    header, *body = rows(page, "tbl-verdicts")
    assert header == ["verdict", "00", "01", "in no chapter", "all"]
    table = {row[0]: row[1:] for row in body}
    assert set(table) == {str(verdict) for verdict in Verdict} | {"all"}
    assert table["reproduced"] == ["2", "0", "0", "2"]
    assert table["cannot be tested"] == ["0", "0", "1", "1"]
    assert table["all"] == ["2", "1", "1", "4"]


def test_a_machine_is_named_once(status: Callable[..., str]) -> None:
    one = found("00", 1, made(1))
    assert rows(status(one, found("01", 1, made(9))), "tbl-machines")[1:] == [
        ["00, 01", "A processor, 2 cores, Linux x86_64", "openblas 1, 1 thread",
         "Python 3.11.7, numpy 2.4.0, scipy 1.17"]
    ]  # fmt: skip
    other = rows(status(one, found("01", 1, made(1, cores=8))), "tbl-machines")
    assert [row[0] for row in other[1:]] == ["00", "01"]


# The claims, how they are cited, and the reference -----------------------------------------------


def test_the_page_of_many_claims(render: Callable[..., str]) -> None:
    kinds = ("numeric", "parameter", "qualitative", "formula")
    claims = [
        Claim(
            id=f"P{1 + i % 3}-X-{i:03d}", paper=f"P{1 + i % 3}", place=f"Table {i}",  # type: ignore[arg-type]
            says="It is *so* & $x < y$.", kind=kinds[i % 4],  # type: ignore[arg-type]
            check=MissingCheck(needs=("lost",), reasons=("It is lost.",)), why="For a test.",
        )
        for i in range(374)
    ]  # fmt: skip
    text = render("claims", judged=verdicts(claims, []))
    assert all(text.count(f"\n({claim.anchor})=\n") == 1 for claim in claims)
    table = {row[0]: row[1:] for row in rows(text, "tbl-claims")}
    assert table["verdict"] == ["P1", "P2", "P3", "all"]
    assert table["all"] == table["cannot be tested"] == ["125", "125", "124", "374"]
    # each button but the first of its group has a rule that hides the others
    names = set(re.findall(r'id="(show-[a-z]+-[1-9]\d*)"', text))
    assert len(names) == 3 + 4 + 1
    assert set(re.findall(r"body:has\(#(\S+):checked\)", text)) == names


def test_a_persons_name_is_no_group_in_bibtex(
    render: Callable[..., str], known: dict[str, Any]
) -> None:
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
    named = [name for _, names in groups for _, name in names]
    assert len(named) == len(set(named))
    shown = {name.rsplit(".", 1)[1] for name in named}
    rooms = [getattr(inswsn_lib, name) for name in inswsn_lib.__all__]
    offered = {n for room in rooms if hasattr(room, "__path__") for n in room.__all__}
    assert offered <= shown
    assert ("autofunction", "inswsn_lib.filters.run_kalman") in [p for _, g in groups for p in g]
    assert ("autoclass", "inswsn_lib.models.ErrorModel") in [p for _, g in groups for p in g]


# What the build adds to a chapter ----------------------------------------------------------------


def test_the_provenance_of_a_run(root: Path) -> None:
    results = found("00", 0, made(12.3, commit=None, clean=None))
    results = results.model_copy(update={"solvers": {"HiGHS": "optimal"}})
    bare = results.model_copy(update={"parameters": {}, "solvers": {}, "data": {}})
    for run, words in (
        (results, ("`seed = 7`", "unknown: not a git checkout\n", "HiGHS: optimal", "12.3 s, ended",
                   "numpy 2.4.0, scipy 1.17\n", "`data/x` `aaaaaaaaaaaa…`")),
        (bare, ("- none\n", "none declared", "none called", "none read")),
    ):  # fmt: skip
        (cell,) = with_notes(nbformat.v4.new_notebook(), run, [], environment(root)).cells
        assert cell["id"] == "ch00-provenance"
        assert [word for word in words if word not in cell.source] == []


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize(
    ("number", "said"),
    [
        (1, "decides the claim ["),
        (2, "decides the claims ["),
        (6, "decides 6 claims\n"),
    ],
)
def test_a_cell_that_decides_is_preceded_by_links(
    root: Path, number: int, said: str, hidden: bool
) -> None:
    cell = nbformat.v4.new_code_cell("x", metadata={"tags": ["remove-cell"] if hidden else []})
    cell["id"] = "ch00-001"
    claims = [judged(i, "00", Verdict.REPRODUCED).claim for i in range(number)]
    notebook = nbformat.v4.new_notebook(cells=[cell])
    before, _ = with_notes(notebook, found("00", 1), claims, environment(root)).cells
    assert before["id"] == "ch00-001-claims"
    assert before.source.startswith("(cell-ch00-001)=\n:::{")
    assert all(f"[{claim.id}](#{claim.anchor})" in before.source for claim in claims)
    assert ("left out here" in before.source) is hidden
    assert said in before.source


def test_captions_move_to_the_cell() -> None:
    def output(name: str) -> Any:
        words = {"name": name, "caption": f"See {name}.", "alt": f"What {name} shows."}
        return nbformat.v4.new_output("display_data", metadata={"inswsn": words})

    cell = nbformat.v4.new_code_cell("x", outputs=[output("fig-a")])
    notebook = with_captions(nbformat.v4.new_notebook(cells=[cell]))
    assert notebook.cells[0].metadata["mystnb"] == {
        "image": {"alt": "What fig-a shows."},
        "figure": {"caption": "See fig-a.", "name": "fig-a"},
    }
    cell["outputs"].append(output("fig-b"))
    with pytest.raises(RenderingError, match="shows two figures; a cell shows one"):
        with_captions(notebook)


# The site ----------------------------------------------------------------------------------------


def test_nothing_is_written_into_the_folder_of_the_pages(mini: MiniProject, tmp_path: Path) -> None:
    before = sorted((mini.root / "book").rglob("*"))
    mini.ledger.write_text("missing: {}\nclaims: []\n")
    notebook, source = nbformat.writes(nbformat.v4.new_notebook()), tmp_path / "source"
    stage_book(mini, [Run(Request("00"), found("00"), notebook)], source)
    assert sorted((mini.root / "book").rglob("*")) == before
    staged = {path.relative_to(source).as_posix() for path in source.rglob("*.*")}
    assert {"index.md", "_toc.yml", "chapters/00-mini.ipynb", "generated/00.json"} <= staged
    assert not any("_templates" in name or name.endswith(".py") for name in staged)


@pytest.mark.parametrize(
    "path", ["book/index.md", "book/_templates/macros.md", "data/papers/number.txt",
             "chapters/00-mini.md", "_config.yml", "CITATION.cff", "environment.lock"],
)  # fmt: skip
def test_a_site_is_out_of_date_once_a_source_differs(mini: MiniProject, path: str) -> None:
    def current(*runs: Run) -> bool:
        try:
            require_current_site(mini, runs)
        except InswsnError:
            return False
        return True

    one = Run(Request("00"), found("00", 0, made(1)), "{}")
    assert not current(one)
    mini.site.mkdir(parents=True)
    (mini.site / ".inswsn-key").write_text(pages._site_key(mini, [one]))
    assert current(one)
    assert not current(replace(one, notebook="{ }"))
    assert not current(replace(one, results=found("00", 0, made(2))))
    (mini.root / path).write_text((mini.root / path).read_text() + "\n")
    assert not current(one)


@pytest.mark.parametrize(
    ("line", "warns"),
    [
        ("/a/b.md:3: WARNING: undefined label", True),
        ("WARNING: unknown config value", True),
        ("/a/b.md:3: ERROR: unknown directive", True),
        ("Source Folder: /a/ERROR/WARNING/book", False),
        ("copying images... [100%] WARNING.png", False),
    ],
)
def test_what_counts_as_a_warning(line: str, warns: bool) -> None:
    assert bool(pages.WARNING.search(line)) is warns
