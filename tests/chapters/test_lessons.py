"""What makes a lesson a lesson: its length, its pictures, its cells, its words."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import jupytext
import pytest
from conftest import ROOT
from inswsn_book.record.project import Project
from inswsn_book.run.store import Request, lookup

FOLDER = ROOT / "chapters"
LESSONS = {f"lesson-{path.name[0]}": path for path in sorted(FOLDER.glob("[1-8]-*.md"))}
WORDS = {"lesson-1": (400, 800)}  # the other lessons have
LENGTH = (1500, 2200)
lessons = pytest.mark.parametrize("number", LESSONS)

_HEAD = r"\s+".join(
    rf"\*\*{name}\*\* {says}" for name, says in (
        ("For", r".+?\."), ("You need", r".+?\."), ("You will learn to", r".+?\."),
        ("Reading time", r"(\d+) minutes"),
    )
)  # fmt: skip
_ROLE = re.compile(r"\{[a-z:]+\}`(?:([^`<]+?) *<[^`>]+>|[^`]*)`")
_FENCE = re.compile(
    r"^(`{3,}|:{3,})\{(list-table|code-cell|math)\}.*?^\1$", re.MULTILINE | re.DOTALL
)


@cache
def cells(path: Path) -> list[Any]:
    return list(jupytext.read(path, fmt="md:myst").cells)


def markdown(path: Path) -> str:
    return "\n\n".join(cell.source for cell in cells(path) if cell.cell_type == "markdown")


def prose(text: str) -> str:
    """Return what is read: without tables, formulas, code and marks; a number is a word."""
    text = _FENCE.sub("", text)
    text = re.sub(r"^```python$.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^(`{3,}|:{3,}).*$|^:\w+:.*$|^\([\w-]+\)=$", "", text, flags=re.MULTILINE)
    text = re.sub(r"\$\$.*?\$\$", "", text, flags=re.DOTALL)
    text = re.sub(r"\$[^$]+\$", "x", text)
    text = _ROLE.sub(lambda role: role[1] or "it", text)
    return re.sub(r"[*`#]|^- |^\d\. ", "", text, flags=re.MULTILINE)


def executed(project: Project, path: Path) -> Any:
    (chapter,) = (c for c in project.chapters() if c.source.resolve() == path.resolve())
    return lookup(project, Request(chapter.id))


@lessons
def test_a_lesson_says_for_whom_it_is_and_how_long_it_takes(
    number: str, built_site: Path, project: Project
) -> None:
    """150 words or 12 lines of code a minute, one for a moving figure, half for a formula."""
    low, high = WORDS.get(number, LENGTH)
    text = markdown(LESSONS[number])
    words = len(prose(text).split())
    assert low <= words <= high
    (said,) = re.findall(_HEAD, text, re.DOTALL)
    code = [c.source for c in cells(LESSONS[number]) if c.cell_type == "code"]
    lines = sum(len(source.splitlines()) for source in code)
    moving = executed(project, LESSONS[number]).notebook.count('class=\\"moving\\"')
    minutes = words / 150 + lines / 12 + moving + text.count("$$") / 4
    assert float(said) == pytest.approx(minutes, abs=5)


@lessons
def test_its_sentences_are_short(number: str) -> None:
    said = prose(markdown(LESSONS[number]))
    paragraphs = [" ".join(p.split()) for p in said.split("\n\n") if len(p.split()) > 3]
    sentences = [s for p in paragraphs for s in re.split(r"(?<=[.?!:])\s+", p)]
    assert sum(len(s.split()) for s in sentences) / len(sentences) <= 20


@lessons
def test_a_picture_stands_for_every_three_hundred_words(
    number: str, built_site: Path, project: Project
) -> None:
    notebook = json.loads(executed(project, LESSONS[number]).notebook)
    shown = [o.get("metadata", {}) for c in notebook["cells"] for o in c.get("outputs", [])]
    figures = sum("inswsn" in found for found in shown)
    assert len(prose(markdown(LESSONS[number])).split()) <= 300 * figures
    moving = sum('class=\\"moving\\"' in json.dumps(cell) for cell in notebook["cells"])
    assert moving >= 3


def test_lessons_take_a_third_of_their_evidence(built_site: Path, project: Project) -> None:
    """Both were executed side by side: of seconds alone a busy machine would take its share."""
    runs = {chapter.id: lookup(project, Request(chapter.id)) for chapter in project.chapters()}
    seconds = {name: run.results.provenance.seconds for name, run in runs.items()}  # type: ignore[union-attr]
    taught = sum(seconds[name] for name in LESSONS)
    proved = sum(seconds[chapter] for chapter in seconds if chapter.startswith(("p", "recorded")))
    assert taught < proved / 3


@lessons
def test_every_cell_is_short_and_is_seen(number: str) -> None:
    code = [cell for cell in cells(LESSONS[number]) if cell.cell_type == "code"]
    assert [c.source for c in code if len(c.source.splitlines()) > 15] == []
    tags = {tag for cell in code for tag in cell.metadata.get("tags", [])}
    assert tags <= {"parameters"}


@pytest.mark.parametrize("path", [*LESSONS.values(), FOLDER / "which-filter.md"])
def test_lines_of_code_hold_to_72_columns(path: Path) -> None:
    """They are read and copied as they are; those of evidence are wrapped on the page."""
    code = [cell.source for cell in cells(path) if cell.cell_type == "code"]
    code += re.findall(r"^```(?:python|bash)$(.*?)^```$", markdown(path), re.MULTILINE | re.DOTALL)
    assert [line for text in code for line in text.splitlines() if len(line) > 72] == []


@lessons
def test_its_tables_are_few_and_small(number: str) -> None:
    text = markdown(LESSONS[number])
    tables = [t[0] for t in _FENCE.finditer(text) if t[2] == "list-table"]
    assert len(tables) + text.count("\n|---") <= 2
    for table in tables:
        rows = table.split("\n* - ")[1:]
        assert len(rows) <= 1 + 6
        assert max(row.count("\n  - ") + 1 for row in rows) <= 5


@lessons
def test_an_acronym_is_explained_where_it_first_stands(number: str) -> None:
    said = prose(markdown(LESSONS[number]).partition("\n# ")[2].partition("\n")[2])  # no title
    for word in set(re.findall(r"\b[A-Z]{2,}[a-z]?\b", said)):
        first = re.search(rf"\S*\b{word}\b\S*", said)[0]  # type: ignore[index]
        assert re.match(r"\([\w-]+\)", first), word  # such as (INS) or (LS-SVM)
    # a paper is named before its short name, and its equations with the paper
    text = markdown(LESSONS[number])
    for paper in set(re.findall(r"\bP[123]\b", said)):
        assert re.search(rf"cite:t\}}`\w+`, {paper} in this book", text), paper
    assert re.findall(r"(?<!P[123] )\(\d\.\d+\)", said) == []
    assert "chapter to come" not in said


@lessons
def test_what_is_taken_home_runs_as_pasted(number: str) -> None:
    code = re.findall(r"^```python$(.*?)^```$", markdown(LESSONS[number]), re.MULTILINE | re.DOTALL)
    assert code
    for block in code:
        exec(compile(block, "taken home", "exec"), {})


def test_each_answer_to_which_filter_runs_as_pasted(capsys: pytest.CaptureFixture[str]) -> None:
    """And each filter beats the network on the drive that it is for."""
    code = [c.source for c in cells(FOLDER / "which-filter.md") if c.cell_type == "code"]
    for answer in code[1:-1]:
        assert len([line for line in answer.splitlines() if line]) <= 15
        exec(compile(answer, "pasted", "exec"), {})
        said = capsys.readouterr().out.replace(",", "")
        network, *_, chosen = (float(word) for word in said.split() if word[0].isdigit())
        assert chosen < network
