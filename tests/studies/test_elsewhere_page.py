"""The page of other surroundings, rendered over small studies and over the stored one."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

import pytest
from elsewhere import AGAIN, ELSEWHERE, Cell, Flipped, Moved, Study
from inswsn_book.project import Project


def cell(variant: str = AGAIN, chapter: str = "00", **fields: Any) -> Cell:
    made: dict[str, Any] = {
        "seconds": 10, "python": "3.11.7", "day": "2026-11-22", "commit": None, "clean": None,
        "cpu": "a processor", "system": "Linux", "compared": 4, "identical": 3, "sentences": 2,
        "judged": 1,
        "sources": dict.fromkeys(("chapter", "library", "locks", "reference"), "0" * 64),
    }  # fmt: skip
    return Cell(variant=variant, chapter=chapter, **made | fields)


def far(name: str = "a", deviation: float | None = 3.0) -> Moved:
    return Moved(
        name=name, unit="m", before=1.0, after=2.5, part="value", tolerance=0.5, deviation=deviation
    )


def page_of(render: Callable[..., str], *cells: Cell, changed: tuple[str, ...] = ()) -> str:
    study = Study(cells=cells).model_dump(mode="json")
    return render("elsewhere", elsewhere=study, changed_since=lambda _: changed)


def rows_of(page: str, name: str) -> list[list[str]]:
    """Return the rows of a table below its head."""
    table = page.split(f":name: {name}\n")[1].split(":::::", maxsplit=1)[0]
    return [[part.strip() for part in row.split("\n  - ")] for row in table.split("* - ")[2:]]


def test_nothing_that_moved(render: Callable[..., str], known: dict[str, Any]) -> None:
    page = page_of(render, cell(), cell("threads-2", identical=4))
    count = len(known["chapters"])
    assert "In 1 way of changing the surroundings, 1 execution of chapters was held" in page
    assert f"of {count} that {count} chapters would make" in page
    assert "Of 4 comparisons of a quantity with its own tolerance, 4 agreed" in page
    assert "**none** went beyond" in page
    assert "Of 1 verdicts, **none** changed. Of 2 sentences" in page
    assert "**none** was overturned" in page
    assert "With nothing changed, 3 of 4 quantities" in page
    assert "Some were made on another processor than the reference" in page
    assert "Nothing: no quantity, no sentence and no verdict." in page
    assert "Nothing that they were made from has changed since." in page
    assert "What could not be run" not in page


def test_all_that_moved_is_told(render: Callable[..., str], known: dict[str, Any]) -> None:
    moved = cell(
        "threads-2", identical=1, beyond=(far(),), farthest=far(),
        overturned=("One.", "Two."),
        flipped=(Flipped(claim="P1-X", before="reproduced", after=None),),
    )  # fmt: skip
    failed = cell("scs", failed="It broke.")
    again = cell(reference_cpu="a processor")
    page = page_of(render, again, moved, failed, changed=("chapter 00", "locks"))
    assert "1 agreed to the last bit, 2 moved within the tolerance, and **1** went beyond" in page
    assert "Of 1 verdicts, **1** changed." in page
    assert "**2** were overturned" in page
    assert "on another processor" not in page
    assert "What could not be run: {ref}`chapter 00 <chapter-00>` with SCS (It broke)." in page
    first, *others = rows_of(page, "tbl-elsewhere-chapters")
    assert first[1:] == ["4", "same", "3, 1 beyond, 2 sentences, 1 verdict", "not run"]
    assert [row[1:] for row in others] == [["–", *["not run"] * 3]] * (len(known["chapters"]) - 1)
    (row,) = (row for row in rows_of(page, "tbl-elsewhere") if row[0] == "two threads")
    assert row[1:] == [
        f"1 of {len(known['chapters'])}", "1 of 1", "2 of 2", "1 of 4", "1 of 4",
        "3, {ref}`chapter 00 <chapter-00>`",
    ]  # fmt: skip
    assert rows_of(page, "tbl-elsewhere-00") == [["two threads", "`a`", "1 m", "2.5 m", "3"]]
    assert "With two threads this sentence does not hold: “Two.”" in page
    assert "With two threads P1-X is not judged, and was reproduced." in page
    assert "Since then, these have changed: chapter 00, locks." in page


def test_the_processors_of_another_machine(render: Callable[..., str]) -> None:
    pairs = (("Third", "First"), ("Twin", "Twin"), ("Third", "First"))
    cells = [
        cell("other-machine", f"0{i}", cpu=run, reference_cpu=made)
        for i, (run, made) in enumerate(pairs)
    ]
    page = page_of(render, cell(), *cells)
    assert page.count("Runs are from Third, their references from First.") == 1
    assert "are from two unlike processors that are called Twin." in page


def test_a_deviation_in_tolerances(render: Callable[..., str]) -> None:
    for deviation, said in ((None, "another quantity"), (1e-4, "below 0.001"), (0.5, "0.5")):
        page = page_of(render, cell(), cell("scs", farthest=far(deviation=deviation)))
        assert rows_of(page, "tbl-elsewhere-chapters")[0][3] == said


@pytest.fixture(scope="module")
def cells(project: Project) -> list[dict[str, Any]]:
    """The stored cells, from the JSON alone."""
    stored: list[dict[str, Any]] = json.loads((project.root / ELSEWHERE).read_text())["cells"]
    return stored


def in_order(cells: list[dict[str, Any]]) -> list[str]:
    """The variants as the page has them, another Python last."""
    found = {cell["variant"] for cell in cells}
    order = ("again", "other-machine", "threads-2", "older-processor", "hash-seed", "scs")
    return [*(name for name in order if name in found), *sorted(found - set(order))]


def test_the_table_by_plain_arithmetic(
    cells: list[dict[str, Any]], known: dict[str, Any], render: Callable[..., str]
) -> None:
    """What the row of each variant says."""
    rows = rows_of(render("elsewhere"), "tbl-elsewhere")
    variants = in_order(cells)
    assert len(rows) == len(variants) == len({c["variant"] for c in cells})
    for name, row in zip(variants, rows, strict=True):
        own = [c for c in cells if c["variant"] == name and c["failed"] is None]
        counts = [
            (sum(len(c.get(part, [])) for c in own), sum(c.get(whole, 0) for c in own))
            for part, whole in (
                ("flipped", "judged"), ("overturned", "sentences"), ("beyond", "compared"),
            )
        ]  # fmt: skip
        counts.append((sum(c.get("identical", 0) for c in own), counts[-1][1]))
        said = [f"{part} of {whole}" if whole else "there are none" for part, whole in counts]
        assert row[1:6] == [f"{len(own)} of {len(known['chapters'])}", *said]
        sizes = [c["farthest"]["deviation"] or float("inf") for c in own if c["farthest"]]
        far_ = row[6].split(",")[0]
        if not sizes:
            assert far_ == "none moved"
        elif max(sizes) < 0.001:
            assert far_ == "below 0.001"
        else:
            assert float(far_) == pytest.approx(max(sizes), rel=0.05)


def test_what_has_not_been_run_is_said_not_to_have_been(
    cells: list[dict[str, Any]], known: dict[str, Any], render: Callable[..., str]
) -> None:
    by = {(cell["variant"], cell["chapter"]): cell for cell in cells}
    rows = rows_of(render("elsewhere"), "tbl-elsewhere-chapters")
    for chapter, (_, _, *entries) in zip(known["chapters"], rows, strict=True):
        for name, entry in zip(in_order(cells), entries, strict=True):
            found = by.get((name, chapter["number"]))
            assert entry.startswith("not run") == (found is None or found["failed"] is not None)


def test_nothing_is_beyond_its_tolerance_without_being_said_to_be(
    cells: list[dict[str, Any]], render: Callable[..., str]
) -> None:
    """Each deviation by its own numbers, and on the page by its name."""
    told = re.split(r"\n## ", render("elsewhere").split("## Beyond the tolerance")[1])[0]
    for found in cells:
        farthest = found.get("farthest")
        if farthest and farthest.get("deviation") is not None:
            size = abs(farthest["after"] - farthest["before"]) / farthest["tolerance"]
            assert farthest["deviation"] == pytest.approx(size, rel=1e-9)
            if size > 1:
                assert farthest["name"] in {moved["name"] for moved in found["beyond"]}
        for moved in found.get("beyond", []):
            assert f"`{moved['name']}`" in told
        for flip in found.get("flipped", []):
            assert flip["claim"] in told
