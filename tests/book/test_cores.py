"""The cores of the chapters take the parameters that the chapters declare."""

from __future__ import annotations

from dataclasses import fields

import pytest
from inswsn_book.cores import core_name, load_core
from inswsn_book.parameters import chapter_schema
from inswsn_book.project import Project

from inswsn_lib.errors import InswsnError

#: Parameters that change other sections of a chapter only
OTHER_SECTIONS = {
    "p1-lmi": {"jitter", "systems", "runs", "seed"},
    "p1-training": set(),
    "p1-outages": {"networks"},
    "p2-fusion": {"fading_length", "most_clusters"},
    "p3-vehicle": {"sweep_draws", "recorded_draws"},
}


def test_every_core_is_looked_at(project: Project) -> None:
    named = {c.id: core_name(c.source.read_text("utf-8")) for c in project.chapters()}
    assert {number for number, name in named.items() if name} == {*OTHER_SECTIONS}


@pytest.mark.parametrize("number", OTHER_SECTIONS)
def test_a_core_takes_the_parameters_of_its_chapter(project: Project, number: str) -> None:
    declared = chapter_schema(project.root, number).defaults
    name = core_name(project.by_id(number).source.read_text(encoding="utf-8"))
    own = {f.name: f.default for f in fields(load_core(str(name))) if f.name != "published"}
    assert {*own} == {*declared} - OTHER_SECTIONS[number]
    assert own == {name: declared[name] for name in own}
    assert {n: type(v) for n, v in own.items()} == {n: type(declared[n]) for n in own}


def test_a_core_that_is_not_there_is_named() -> None:
    for name in ("inswsn_lib.navigation:Nothing", "inswsn_lib.nothing:TrainingAreas"):
        with pytest.raises(InswsnError, match=f"There is no core {name}"):
            load_core(name)


def test_the_head_alone_names_a_core() -> None:
    assert core_name("---\ncore: module:Class\n---\n") == "module:Class"
    assert core_name("---\na: b\n---\ncore: module:Class\n") is None
