"""The pages: what their templates say of results made by hand, and what the build adds to one."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import nbformat
import pytest
from inswsn_book import pages
from inswsn_book.ledger import PAPERS, Claim, MissingCheck, QuantityCheck
from inswsn_book.pages import (
    RenderingError,
    context,
    environment,
    footer,
    require_current_site,
    stage_book,
    with_captions,
    with_notes,
)
from inswsn_book.project import Project
from inswsn_book.provenance import repository_state
from inswsn_book.results import Provenance, Quantity, Results, read_results
from inswsn_book.runs import Request, Run
from inswsn_book.verdicts import Judged, Verdict, verdicts

from inswsn_lib.errors import InswsnError


@pytest.fixture(scope="module")
def published(root: Path) -> list[Results]:
    return [read_results(path) for path in sorted((root / "data/published").glob("*.json"))]


@pytest.fixture(scope="module")
def known(root: Path, published: list[Results]) -> dict[str, Any]:
    return context(Project(root), published)


def rendered(root: Path, page: str, known: dict[str, Any]) -> str:
    return environment(root).get_template(page).render(known)


def rows(text: str, name: str) -> list[list[str]]:
    """Read one table of a page back, by its label, as rows of cells."""
    tables = re.findall(r"^:::::\{list-table\}(.*?)^:::::$", text, re.M | re.S)
    (table,) = (part for part in tables if f":name: {name}\n" in part)
    return [
        [cell[4:].strip().replace("\xa0", " ") for cell in row.splitlines() if cell.strip()]
        for row in re.split(r"^(?=\* -)", table.split("\n\n", 1)[1], flags=re.M)
        if row.strip()
    ]


# The lists of the front page ---------------------------------------------------------------------


def test_the_counts_of_the_front_page_add_up(root: Path, known: dict[str, Any]) -> None:
    page = rendered(root, "index.md", known)
    ((total, tested, first, rest),) = re.findall(
        r"\*\*(\d+) claims\*\*, of which (\d+) are put to the test: (.*) The others: (.*)", page
    )
    assert int(total) == len(known["judged"])
    assert sum(map(int, re.findall(r"\*\*(\d+)\*\* ", first))) == int(tested)
    assert int(tested) + sum(map(int, re.findall(r"\d+", rest))) == int(total)
    assert "cannot be tested" in rest  # what cannot be tested is not put to the test


def test_every_chapter_says_what_it_needs_and_how_long_it_takes(known: dict[str, Any]) -> None:
    assert [c["name"] for c in known["chapters"] if not (c["need"] and c["minutes"])] == []


def test_the_heads_of_chapters(mini: Project) -> None:
    (mini.root / "data/claims/mini.yaml").write_text("missing: {}\nclaims: []\n")
    (silent,) = context(mini, [])["chapters"]
    assert (silent["need"], silent["minutes"], silent["results"]) == ("", "", None)
    source = mini.root / "chapters" / "00-mini.md"
    head = "**You need** means, and\nsums. **Reading time** 25 minutes. **Run time** 3 s."
    source.write_text(source.read_text() + head)
    (said,) = context(mini, [])["chapters"]
    assert (said["need"], said["minutes"]) == ("means, and\nsums", "25")


# The state of the build --------------------------------------------------------------------------


def made(seconds: float, **changes: object) -> Provenance:
    fields = {
        "version": "1.0.0",
        "commit": "0123456789abcdef" + 24 * "0",
        "clean": True,
        "sources": {"library": "b" * 64},
        "finished": "2026-11-22 06:00 UTC",
        "seconds": seconds,
        "python": "3.11.7",
        "system": "Linux x86_64",
        "cpu": "A processor",
        "cores": 2,
        "blas": ("openblas 1, 1 thread",),
        "packages": {"numpy": "2.4.0", "scipy": "1.17"},
    }
    return Provenance.model_validate(fields | changes)


def found(chapter: str, quantities: int, sentences: dict[str, bool], ran: Provenance | None) -> Any:
    recorded = tuple(
        Quantity(
            name=f"q{i}", value=1.0, unit="m", basis="printed", how="Made by hand.", tolerance=0
        )
        for i in range(quantities)
    )
    return Results(
        chapter=chapter,
        parameters={"seed": 7},
        data={"data/x": "a" * 64},
        quantities=recorded,
        sentences=sentences,
        provenance=ran,
        cells={f"q{i}": f"ch{chapter}-001" for i in range(quantities)},
    )


def judged(number: int, chapter: str | None, verdict: Verdict) -> Judged:
    check: QuantityCheck | MissingCheck
    if chapter is None:
        check = MissingCheck(needs=("lost",), reasons=("It is lost.",))
    else:
        check = QuantityCheck(chapter=chapter, quantity="q0")
    claim = Claim.model_construct(
        id=f"P1-{number}", paper="P1", place="", says="", kind="numeric", check=check, why=""
    )
    return Judged(claim, verdict, "")


JUDGED = [
    judged(1, "00", Verdict.REPRODUCED),
    judged(2, "00", Verdict.REPRODUCED),
    judged(3, "01", Verdict.NOT_REPRODUCED),
    judged(4, None, Verdict.UNTESTABLE),
]


def status(root: Path, results: list[Results]) -> str:
    facts = [{"number": r.chapter, "name": f"{r.chapter}-name", "results": r} for r in results]
    return rendered(root, "status.md", {"chapters": facts, "judged": JUDGED})


def test_the_runs_and_their_sums(root: Path) -> None:
    ran = [
        found("00", 3, {"a": True, "b": True}, made(61.5)),
        found("01", 2, {"c": True, "d": False}, made(63.5, clean=False)),
    ]
    _, first, second, total = rows(status(root, ran), "tbl-runs")
    commit = "`0123456789ab`"
    when = "2026-11-22 06:00 UTC"
    assert first == ["{doc}`00 <chapters/00-name>`", "61.5 s", when, commit, "3", "2 of 2", "2"]
    assert second[3:] == [f"{commit}, with changes", "2", "1 of 2", "1"]
    assert total == ["all", "2 min 5 s", "", "", "5", "3 of 4", "3"]


def test_a_run_that_is_unknown(root: Path) -> None:
    ran = [found("00", 1, {}, None), found("01", 1, {}, made(2, commit=None, clean=None))]
    _, first, second, total = rows(status(root, ran), "tbl-runs")
    assert first[1:4] == ["unknown", "unknown", "unknown"]
    assert second[3] == "unknown"
    assert total[1] == "2 s"


def test_the_verdicts_of_each_chapter(root: Path) -> None:
    ran = [found("00", 1, {}, made(1)), found("01", 1, {}, made(1))]
    header, *body = rows(status(root, ran), "tbl-verdicts")
    assert header == ["verdict", "00", "01", "in no chapter", "all"]
    table = {row[0]: row[1:] for row in body}
    assert table["reproduced"] == ["2", "0", "0", "2"]
    assert table["cannot be tested"] == ["0", "0", "1", "1"]
    assert table["all"] == ["2", "1", "1", "4"]
    assert set(table) == {str(verdict) for verdict in Verdict} | {"all"}


def test_a_machine_is_named_once(root: Path) -> None:
    same = [found("00", 1, {}, made(1)), found("01", 1, {}, made(9))]
    _, *machines = rows(status(root, same), "tbl-machines")
    assert machines == [
        [
            "00, 01",
            "A processor, 2 cores, Linux x86_64",
            "openblas 1, 1 thread",
            "Python 3.11.7, numpy 2.4.0, scipy 1.17",
        ]
    ]
    other = [same[0], found("01", 1, {}, made(1, cores=8))]
    assert [row[0] for row in rows(status(root, other), "tbl-machines")[1:]] == ["00", "01"]


# The claims, and how they are cited --------------------------------------------------------------


def test_the_page_of_many_claims(root: Path, known: dict[str, Any]) -> None:
    kinds = ("numeric", "parameter", "qualitative", "formula")
    claims = [
        Claim(
            id=f"P{1 + i % 3}-X-{i:03d}", paper=f"P{1 + i % 3}", place=f"Table {i}",  # type: ignore[arg-type]
            says="It is *so* & $x < y$.", kind=kinds[i % 4],  # type: ignore[arg-type]
            check=MissingCheck(needs=("lost",), reasons=("It is lost.",)), why="For a test.",
        )
        for i in range(374)
    ]  # fmt: skip
    text = rendered(root, "claims.md", known | {"judged": verdicts(claims, [])})
    assert all(text.count(f"\n({claim.anchor})=\n") == 1 for claim in claims)
    table = {row[0]: row[1:] for row in rows(text, "tbl-claims")}
    assert table["all"] == table["cannot be tested"] == ["125", "125", "124", "374"]
    assert table["verdict"] == [*PAPERS, "all"]
    # each button but the first of its group has a rule that hides the others
    names = set(re.findall(r'id="(show-[a-z]+-[1-9]\d*)"', text))
    assert len(names) == 3 + 4 + 1
    assert set(re.findall(r"body:has\(#(\S+):checked\)", text)) == names


def test_a_persons_name_is_no_group_in_bibtex(root: Path, known: dict[str, Any]) -> None:
    authors = ("van Berg, Ana", "Rovers and Co")
    about = known["about"] | {"names": authors, "doi": "10.5281/zenodo.1", "version": "1.2.3"}
    page = rendered(root, "cite.md", known | {"about": about})
    assert "  author       = {van Berg, Ana and {Rovers and Co}},\n" in page
    assert page.count("note         = {Version 1.2.3,") == 1  # of a verdict
    assert page.count("note         = {Version 1.2.3},\n  doi          = {10.5281/zenodo.1},") == 1
    assert "van Berg, Ana; Rovers and Co (" in page


# What the build adds to a chapter ----------------------------------------------------------------


def test_the_provenance_of_a_run(root: Path) -> None:
    results = found("00", 0, {}, made(12.3, commit=None, clean=None))
    results = results.model_copy(update={"solvers": {"HiGHS": "optimal"}})
    notebook = with_notes(nbformat.v4.new_notebook(), results, [], environment(root))
    (cell,) = notebook.cells
    assert cell["id"] == "ch00-provenance"
    for words in ("`seed = 7`", "unknown: not a git checkout\n", "HiGHS: optimal", "12.3 s, ended",
                  "numpy 2.4.0, scipy 1.17\n", "`data/x` `aaaaaaaaaaaa…`"):  # fmt: skip
        assert words in cell.source
    bare = results.model_copy(update={"parameters": {}, "solvers": {}, "data": {}})
    text = with_notes(nbformat.v4.new_notebook(), bare, [], environment(root)).cells[0].source
    for words in ("- none\n", "none declared", "none called", "none read"):
        assert words in text


@pytest.mark.parametrize("number", [1, 2, 6])
@pytest.mark.parametrize("hidden", [False, True])
def test_a_cell_that_decides_is_preceded_by_links(root: Path, number: int, hidden: bool) -> None:
    cell = nbformat.v4.new_code_cell("x", metadata={"tags": ["remove-cell"] if hidden else []})
    cell["id"] = "ch00-001"
    claims = [judged(i, "00", Verdict.REPRODUCED).claim for i in range(number)]
    notebook = nbformat.v4.new_notebook(cells=[cell])
    before, _ = with_notes(notebook, found("00", 1, {}, None), claims, environment(root)).cells
    assert before["id"] == "ch00-001-claims"
    assert before.source.startswith("(cell-ch00-001)=\n:::{")
    assert all(f"[{claim.id}](#{claim.anchor})" in before.source for claim in claims)
    assert ("left out here" in before.source) is hidden
    said = {1: "decides the claim [", 2: "decides the claims [", 6: "decides 6 claims\n"}
    assert said[number] in before.source


def figure_output(name: str) -> nbformat.NotebookNode:
    words = {"name": name, "caption": f"See {name}.", "alt": f"What {name} shows."}
    return nbformat.v4.new_output(
        "display_data", data={"image/svg+xml": "<svg/>"}, metadata={"inswsn": words}
    )


def test_captions_move_to_the_cell() -> None:
    cell = nbformat.v4.new_code_cell("x", outputs=[figure_output("fig-a")])
    notebook = with_captions(nbformat.v4.new_notebook(cells=[cell]))
    assert notebook.cells[0].metadata["mystnb"] == {
        "image": {"alt": "What fig-a shows."},
        "figure": {"caption": "See fig-a.", "name": "fig-a"},
    }
    cell["outputs"].append(figure_output("fig-b"))
    with pytest.raises(RenderingError, match="shows two figures; a cell shows one"):
        with_captions(notebook)


def test_nothing_is_written_into_the_folder_of_the_pages(mini: Project, tmp_path: Path) -> None:
    before = sorted((mini.root / "book").rglob("*"))
    results = found("00", 0, {}, None)
    (mini.root / "data/claims/mini.yaml").write_text("missing: {}\nclaims: []\n")
    notebook = nbformat.writes(nbformat.v4.new_notebook())
    stage_book(mini, [Run(Request("00"), results, notebook)], tmp_path / "source")
    assert sorted((mini.root / "book").rglob("*")) == before
    source = tmp_path / "source"
    staged = {path.relative_to(source).as_posix() for path in source.rglob("*.*")}
    assert {"index.md", "_toc.yml", "chapters/00-mini.ipynb", "generated/00.json"} <= staged
    assert not any("_templates" in name or name.endswith(".py") for name in staged)


# Whether the site is up to date ------------------------------------------------------------------


@pytest.mark.parametrize(
    "path", ["book/index.md", "book/_templates/macros.md", "data/papers/number.txt",
             "chapters/00-mini.md", "_config.yml", "CITATION.cff", "environment.lock"],
)  # fmt: skip
def test_a_site_is_out_of_date_once_a_source_differs(mini: Project, path: str) -> None:
    runs = [Run(Request("00"), found("00", 0, {}, made(1)), "{}")]
    with pytest.raises(InswsnError, match="is not up to date"):
        require_current_site(mini, runs)
    mini.site.mkdir(parents=True)
    (mini.site / "index.html").touch()
    (mini.site / ".inswsn-key").write_text(pages._site_key(mini, runs))
    require_current_site(mini, runs)
    for other in (
        replace(runs[0], notebook="{ }"),
        Run(Request("00"), found("00", 0, {}, made(2))),
    ):
        with pytest.raises(InswsnError, match="not up to date"):
            require_current_site(mini, [other])
    source = mini.root / path
    source.write_text(source.read_text() + "\n")
    with pytest.raises(InswsnError, match="not up to date"):
        require_current_site(mini, runs)


def test_the_foot_of_a_page(mini: Project, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "files that are not a git checkout" in footer(mini)
    head = "0123456789abcdef"
    for clean, said in (
        (True, f"commit {head[:12]}, env"),
        (False, "that were not committed, env"),
    ):
        monkeypatch.setattr("inswsn_book.pages.repository_state", lambda _, c=clean: (head, c))
        assert said in footer(mini)
    assert repository_state(mini.root) == (None, None)


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
