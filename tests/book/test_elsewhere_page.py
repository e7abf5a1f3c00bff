"""Cells of the study of other surroundings, and the page that is made of them."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest
from conftest import MiniProject
from inswsn_book.elsewhere import (
    AGAIN,
    ELSEWHERE,
    Cell,
    Flipped,
    Moved,
    Study,
    write_elsewhere,
)
from inswsn_book.elsewhere_page import (
    EXPLANATIONS,
    chapters_table,
    elsewhere_texts,
    summary,
    variants_table,
)

from inswsn_lib.errors import InswsnError


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


def test_the_sentences_follow_the_cells() -> None:
    none = Study(cells=(cell(), cell("threads-2", identical=4)))
    text = summary(none, 3)
    assert "In 1 way of changing the surroundings, 1 execution of chapters was held" in text
    assert "of 3 that 3 chapters would make" in text
    assert "Of 4 comparisons of a quantity with its own tolerance, 4 agreed" in text
    assert "**none** went beyond" in text
    assert "Of 1 verdicts, **none** changed. Of 2 sentences" in text
    assert "**none** was overturned" in text
    assert "With nothing changed, 3 of 4 quantities" in text
    assert "another processor" in text  # the cell does not say that of the reference
    flipped = cell(
        "threads-2", identical=1, beyond=(far(),), farthest=far(),
        overturned=("One.", "Two."), flipped=(Flipped(claim="P1-X", before="a", after=None),),
    )  # fmt: skip
    some = Study(
        cells=(cell(reference_cpu="a processor"), flipped, cell("scs", failed="It broke."))
    )
    text = summary(some, 3)
    assert "1 agreed to the last bit, 2 moved within the tolerance, and **1** went beyond" in text
    assert "Of 1 verdicts, **1** changed." in text
    assert "**2** were overturned" in text
    assert "another processor" not in text
    assert "What could not be run: {ref}`chapter 00 <chapter-00>` (It broke)." in text
    rows = chapters_table(some, ["00", "01"]).split("* - ")[2:]
    assert [re.findall(r"  - (.*)", row) for row in rows] == [
        ["4", "same", "3, 1 beyond, 2 sentences, 1 verdict", "not run"],
        ["–", "not run", "not run", "not run"],
    ]
    row = variants_table(some, 2).split("* - two threads")[1].split("* -")[0]
    assert re.findall(r"  - (.*)", row) == [
        "1 of 2", "1 of 1", "2 of 2", "1 of 4", "1 of 4", "3, {ref}`chapter 00 <chapter-00>`",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ([], "00, scs: 'a' is not as in the reference, and data/elsewhere.yaml does not say why"),
        (["a"], "'A sentence.' is not as"),
        (["a", "A sent*"], "'P1-X' is not as"),
        (["a", "A sentence.", "P1-X", "b*"], r"it: nothing like 'b\*' moved in chapter 00, scs"),
        (["a", "A sentence.", "P1-*"], None),
    ],
)
def test_what_moves_is_explained_and_what_is_explained_moves(
    mini: MiniProject, names: list[str], said: str | None
) -> None:
    moved = cell(
        "scs", beyond=(far(),), farthest=far(), overturned=("A sentence.",),
        flipped=(Flipped(claim="P1-X", before="reproduced", after="contradicted"),),
    )  # fmt: skip
    write_elsewhere(Study(cells=(cell(), moved)), mini.root / ELSEWHERE)
    entry = {"id": "it", "variants": ["scs"], "chapter": "00", "names": names, "why": "So it is."}
    entries = [entry] if names else []
    (mini.root / EXPLANATIONS).write_text(json.dumps({"explanations": entries}))
    if said is not None:
        with pytest.raises(InswsnError, match=said):
            elsewhere_texts(mini)
        return
    text = elsewhere_texts(mini)["elsewhere-moved.md"]
    assert "So it is." in text
    assert "`a`\n  - 1 m\n  - 2.5 m\n  - 3" in text
    assert "this sentence does not hold: “A sentence.”" in text
    assert "P1-X is contradicted, and was reproduced." in text


def test_a_checkout_without_explanations_has_no_texts(mini: MiniProject) -> None:
    assert elsewhere_texts(mini) == {}
