"""The comparison of results, and the reference: what a build may move, and what publishing does."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import made_results
import pytest
from conftest import Command, MiniProject, files_of
from inswsn_book.record.files import write_listed
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import Project
from inswsn_book.record.results import Results, read_results, write_results
from inswsn_book.run.compare import (
    Change,
    changes_to_publish,
    check_kept_studies,
    compare_conditions,
    comparison,
    flipped_verdicts,
    publish_build,
)
from inswsn_book.run.store import Request, Run, keep, run

from inswsn_lib.errors import BuildError

quantity = partial(made_results.quantity, tolerance=0.1)


def results(**values: float) -> Results:
    return made_results.results(*(quantity(name, value) for name, value in values.items()))


# Quantities, conditions, verdicts ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "beyond"),
    [
        ({"value": 1.05}, False),
        ({"value": 1.2}, True),
        ({"unit": "km"}, True),
        ({"runs": 2}, True),
        ({"basis": "recorded"}, True),
        ({"interval": (0.95, 1.25)}, False),
        ({"interval": (0.5, 1.3)}, True),
        ({"interval": None, "interval_kind": None}, True),
        ({"how": "Otherwise, for a test."}, False),
        ({"role": "input"}, True),
        ({"tolerance": 1e9}, True),
        ({"tolerance": 0.11}, True),
        ({"share": 0.11}, True),
    ],
)
def test_what_is_beyond_tolerance(changes: dict[str, Any], beyond: bool) -> None:
    fields = {"interval": (0.9, 1.3), "interval_kind": "rounding"}
    change = Change("x", quantity("x", **fields), quantity("x", **fields | changes))
    assert change.beyond_tolerance is beyond
    (field, *_) = changes
    assert field in str(change) or field in ("unit", "value")


def test_a_share_is_one_of_the_reference_and_the_same_for_every_value() -> None:
    """A number that moves by less than it may is no change of its tolerance."""
    before, fields = quantity("x", 16.923, tolerance=0.01, share=0.02), {"tolerance": 0.01}
    for value, beyond in ((17.178, False), (17.26, False), (17.27, True)):
        after = quantity("x", value, share=0.02, **fields)
        assert Change("x", before, after).beyond_tolerance is beyond
    assert Change("x", before, quantity("x", 16.923, share=0.03, **fields)).beyond_tolerance


def test_flipped_verdicts_and_only_those() -> None:
    claims = [
        made_results.claim(
            id=f"P1-{name}", says="It is 1.0 m.", value="1.0", tolerance="within 0.1",
            check={"chapter": "00", "quantity": name},
        )
        for name in ("same", "moved", "gone", "new", "never")
    ]  # fmt: skip
    flips = flipped_verdicts(
        claims, results(same=1.0, moved=1.0, gone=1.0), results(same=1.05, moved=1.2, new=9.0)
    )
    assert [claim.id for claim, _, _ in flips] == ["P1-moved", "P1-gone", "P1-new"]
    assert [old and old.words for _, old, _ in flips] == ["adds up in print"] * 2 + [None]
    lines = comparison(results(gone=1.0), results(new=9.0), claims)
    assert "verdict P1-gone: adds up in print -> without a verdict" in lines
    assert lines[-2].startswith(
        "verdict P1-new: without a verdict -> contradicted by the paper itself (No "
    )


def test_all_that_differs_between_two_runs_of_a_chapter() -> None:
    before = results(old=1, both=1, near=1, rounded=1, **{"own.left": 4}).model_copy(
        update={
            "parameters": {"a": 1, "same": 3}, "tables": {"tbl-a": [["x"], ["1"]]},
            "sentences": {"It rains.": True, "It pours.": False, "It is gone.": True},
        }
    )  # fmt: skip
    after = results(both=1, near=1.05, rounded=1 + 1e-8, new=3, **{"own.left": 5}).model_copy(
        update={
            "parameters": {"b": 2, "same": 3}, "data": {"data/x": "a" * 64},
            "sentences": {"It rains.": False, "It pours.": True, "It snows.": False},
            "solvers": {"HiGHS": "optimal"}, "cells": {"both": "ch00-001"},
            "tables": {"tbl-a": [["x"], ["2"], ["3"]], "tbl-b": []},
        }
    )  # fmt: skip
    both = after["both"].model_copy(update={"tolerance": 0.2})
    after = after.model_copy(update={"quantities": (both, *after.quantities[1:])})
    assert comparison(before, after, []) == [
        "parameters: b: absent -> 2",
        "parameters: a: 1 -> absent",
        "own.left: 4 m -> 5 m (change +1, tolerance 0.1)",
        "old: 1 m -> absent",
        "both: 1 m -> 1 m (change +0, tolerance 0.1); tolerance 0.1 -> 0.2",
        "near: 1 m -> 1.05 m (change +0.05, tolerance 0.1)",
        "new: absent -> 3 m",
        "data: data/x: absent -> " + "a" * 64,
        "sentences: It rains.: True -> False",
        "sentences: It pours.: False -> True",
        "sentences: It snows.: absent -> False",
        "sentences: It is gone.: True -> absent",
        "solvers: HiGHS: absent -> optimal",
        "table tbl-a: 2 of 3 cells differ",
        "5 of 6 quantities changed, 4 of 4 sentences overturned, 0 of 0 verdicts flipped.",
    ]
    assert "cells: both: absent -> ch00-001" in compare_conditions(before, after)
    assert compare_conditions(before, before) == []


# The reference -----------------------------------------------------------------------------------


def test_a_fresh_build_is_close_to_the_reference(project: Project, built_site: Path) -> None:
    due = [line for line in changes_to_publish(project) if line.startswith("!")]
    if due:
        said = "The build is not data/published; if what it found is meant to be: make publish"
        pytest.fail("\n".join([said, *due]), pytrace=False)


@pytest.mark.parametrize("at_hand", [pytest.param(True, marks=pytest.mark.whole), False])
def test_a_kept_study_that_is_not_the_reference_is_refused_wherever_it_is_built(
    mini: MiniProject, at_hand: bool
) -> None:
    """With the recordings at hand and without: the sentence names both, and what mends it."""

    def build(by_kept: float) -> Run:
        mini.chapter(
            "import os\n"
            f"computed = {at_hand} and os.environ.get('INSWSN_DATA') != os.devnull\n"
            "record.study('recorded/kept.json', computed=computed)\n"
            f"record.quantity('found', 1.0 if computed else {by_kept}, 'm', how='For a test.',\n"
            "                basis='recorded', tolerance=0.0, share=0.02)"
        )
        return run(mini, Request("00"), Quiet())

    made = build(1.01)
    found = (quantity("found", 1.0, basis="recorded", tolerance=0.0, share=0.02),)
    mini.publish(made.results.model_copy(update={"quantities": found}))
    check_kept_studies(mini, [made], Quiet())
    with pytest.raises(BuildError) as refused:
        check_kept_studies(mini, [build(1.03)], Quiet())
    for part in ("data/recorded/kept.json", "data/published/00.json", "1 m -> 1.03 m",
                 "make recorded", "make publish"):  # fmt: skip
        assert part in str(refused.value)


def build(mini: MiniProject, made: Results) -> None:
    """Put results into the store as the book's run of the chapter."""
    keep(mini, Request("00"), Run(Request("00"), made, "{}\n"))


def test_only_publish_changes_the_reference(mini: MiniProject, inswsn: Command) -> None:
    reference = mini.published / "00.json"
    build(mini, results(x=1.0))
    assert inswsn(mini.root, "publish", "--check").stdout == "! 00 x: absent -> 1 m\n"
    assert not reference.exists()
    done = inswsn(mini.root, "publish")
    assert done.stdout == "! 00 x: absent -> 1 m\nwrote data/published/00.json\n"
    assert read_results(reference) == results(x=1.0)
    # a run by hand writes to results/, and never reaches the reference
    write_results(results(x=9.0), mini.results / "00.json")
    assert inswsn(mini.root, "publish").stdout == ""
    # a reference of another schema is shown as all new, and replaced
    other = reference.read_text().replace('version": 5', 'version": 9')
    write_listed(mini.published, {"00.json": other})
    assert "! 00 x: absent -> 1 m\n" in inswsn(mini.root, "publish").stdout
    mini.publish(results().model_copy(update={"chapter": "07"}))
    said = "! data/published/07.json belongs to no chapter, and goes.\n"
    assert inswsn(mini.root, "publish", "--check").stdout == said
    assert inswsn(mini.root, "publish").stdout == said
    assert inswsn(mini.root, "publish").stdout == ""
    # what was not published, or is cut off, or gone, is refused in a sentence and not taken as none
    before = files_of(mini.published)
    for damage in (lambda: reference.write_text("{}"), reference.unlink,
                   (mini.published / "SHA256SUMS").unlink,
                   lambda: (mini.published / "01.json").write_text("{}")):  # fmt: skip
        damage()
        for words in (["publish"], ["publish", "--check"], ["book"]):
            done = inswsn(mini.root, *words)
            assert (done.returncode, "restore the folder" in done.stderr) == (2, True), words
        for name, content in before.items():
            (mini.published / name).write_bytes(content)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"quantities": (quantity("x", 1.05), quantity("y"))}, None),  # rounding of a machine
        ({"quantities": (quantity("x", 1.05), quantity("y", 1.2))},
         ["  00 x: 1 m -> 1.05 m (change +0.05, tolerance 0.1)",
          "! 00 y: 1 m -> 1.2 m (change +0.2, tolerance 0.1)"]),
        ({"quantities": (quantity("x"),)}, ["! 00 y: 1 m -> absent"]),
        ({"quantities": (quantity("x"), quantity("y", how="In another way."))},
         ["  00 y: 1 m -> 1 m (change +0, tolerance 0.1); how For a test. -> In another way."]),
        ({"parameters": {"a": 2}}, ["! 00 parameters: a: absent -> 2"]),
        ({"sentences": {"So.": True}}, ["! 00 sentences: So.: absent -> True"]),
        ({"tables": {"tbl-x": [["−1.5e-3 m"]]}}, None),  # it is for the quantities to say
        ({"tables": {"tbl-x": [["1 km"]]}}, ["  00 table tbl-x: 1 of 1 cells differ"]),
        ({"tables": {"tbl-x": [["1 m", "1 m"]]}}, ["  00 table tbl-x: 1 of 2 cells differ"]),
        ({"tables": {}}, ["  00 table tbl-x: 1 of 1 cells differ"]),
        ({"words": {"said": "3 to 5 m"}}, None),
        ({"words": {"said": "2 to 4 km"}}, ["  00 words: said: # to # m -> # to # km"]),
        ({"words": {}}, ["  00 words: said: # to # m -> absent"]),
    ],
)  # fmt: skip
def test_a_chapter_is_published_if_more_than_its_rounding_has_changed(
    mini: MiniProject, changes: dict[str, Any], said: list[str] | None
) -> None:
    before = results(x=1.0, y=1.0).model_copy(
        update={"tables": {"tbl-x": [["1 m"]]}, "words": {"said": "2 to 4 m"}}
    )
    mini.publish(before)
    after = before.model_copy(update=changes)
    build(mini, after)
    assert changes_to_publish(mini) == (said or [])
    assert publish_build(mini) == (["data/published/00.json"] if said else [])
    assert read_results(mini.published / "00.json") == (after if said else before)
    assert publish_build(mini) == []
