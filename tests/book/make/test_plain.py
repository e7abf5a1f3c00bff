"""Chapters as notebooks: read from their sources, kept as they ran, and in plain Markdown."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import nbformat
import pytest
from conftest import MiniProject, assert_plain
from inswsn_book.make.plain import PlainBook, stale_twins
from inswsn_book.record.notebooks import notebook_text, read_source, strip_run
from inswsn_book.record.project import ROOT_VARIABLE, Project
from made_results import quantity, results

from inswsn_lib.errors import InswsnError


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (":tags: [parameters]", "", "has 0 cells tagged parameters"),
        ("record.write()", ":tags: [parameters]\n\n1", "has 2 cells tagged parameters"),
        ("{text_representation", "[", "is not a MyST notebook"),
    ],
)
def test_what_is_no_chapter_is_refused(mini: MiniProject, old: str, new: str, said: str) -> None:
    mini.source.write_text(mini.source.read_text().replace(old, new))
    with pytest.raises(InswsnError, match=said):
        read_source(mini.chapters()[0])


def test_a_stripped_run_has_no_time_and_no_path(mini: MiniProject) -> None:
    notebook = read_source(mini.chapters()[0])
    notebook.metadata["papermill"] = {"start_time": "now", "input_path": "/somewhere"}
    cell = next(cell for cell in notebook.cells if cell.cell_type == "code")
    cell.metadata |= {"papermill": {"duration": 1.0}, "execution": {"iopub.execute_input": "now"}}
    cell.outputs = [nbformat.v4.new_output("display_data", data={"text/plain": "kept"})]
    text = json.dumps(strip_run(notebook))
    words = ("papermill", "now", "/somewhere", "kept")
    assert [word in text for word in words] == [False, False, False, True]


WORDS = {"said": "2 to 4", "fig-x": "What $x$ does."}
FOUND = results(quantity("whole", 42.0), quantity("part", 2.345), words=WORDS)
LABELS = """
```{math}
:label: eq-a
x = 1
```

```{prf:theorem} It holds
:label: thm-a

Always.
```

```{list-table} Some cells.
:header-rows: 1
:name: tbl-a

* - a
  - b
* - $|x|$
  - {glue:text}`whole` | more
```

```{exercise-start} By hand
:label: ex-a
```

```{exercise-end}
```
"""
CASES = {
    "{glue:text}`whole` m": "**42** m",
    "{glue:text}`part:.1f` m, {glue:text}`whole:d`": "**2.3** m, **42**",
    "**About {glue:text}`said` m.**": "**About 2 to 4 m.**",
    "{glue:text}`not.yet`": "**…**",
    "the {term}`INS <inertial navigation system>`": "the INS",
    "{func}`~inswsn_lib.lmi.design_filter`": "`inswsn_lib.lmi.design_filter`",
    "{cite:t}`xu2012ins` say": "Xu et al. (2012) say",
    "so {cite}`carlson1990federated,barshalom1986effect`":
        "so (Carlson, 1990; Bar-Shalom and Campo, 1986)",
    "{doc}`the other <01-other>`": "[the other](01-other.ipynb)",
    "{doc}`01-other`": "[Another](01-other.ipynb)",
    "{doc}`/index`": "Mini",
    "{download}`the notebook <00-mini.ipynb>`": "the notebook",
    "{ref}`there <other-place>`, {ref}`other-place`":
        "[there](01-other.ipynb), [A place](01-other.ipynb)",
    "{ref}`below <own-place>`": "below",
    "{numref}`tbl-a`, {numref}`tbl-other`": "Table 1, [Table 1](01-other.ipynb)",
    "{prf:ref}`thm-a`, {ref}`it <ex-a>`, {eq}`eq-a`": "Theorem 1, it, (1)",
    "[a claim](#claim-1), <span id=\"old\"></span>so": "a claim, so",
    "(own-place)=\n## A heading": "## A heading",
    "Word\n: what it means": "- Word: what it means",
    "```{index} ! word\n```": "",
    "```{raw} html\n<div></div>\n```": "",
    "```python\n{ref}`x`\n```": "```python\n{ref}`x`\n```",
    ":::{div} deciding\nWords.\n:::": "Words.",
    "```{admonition} Mind\n:class: note\nThe *gap*.\n\nSo.\n```":
        "> **Mind**\n>\n> The *gap*.\n>\n> So.",
    "```{note} Mind it.\n```": "> **Note**\n>\n> Mind it.",
    "````{prf:proof}\nAs $x$:\n```{math}\nx\n```\n````": "**Proof.**\n\nAs $x$:\n\n$$\nx\n$$",
    "```{figure} a.svg\n:alt: A line.\nIt rises.\n```": "![A line.](a.svg)\n\nIt rises.",
    "```{solution-start} ex-a\n:class: dropdown\n```\nIt is one.": "**Solution.**\n\nIt is one.",
}  # fmt: skip
LABELLED = (
    "$$\nx = 1\n\\tag{1}\n$$\n\n**Theorem 1 (It holds).**\n\nAlways.\n\n"
    "**Table 1.** Some cells.\n\n| a | b |\n| --- | --- |\n"
    "| $\\vert x\\vert $ | **42** \\| more |\n\n**Exercise 1: By hand**"
)


@pytest.fixture
def book(mini: MiniProject) -> PlainBook:
    """A book of two chapters."""
    other = mini.source.read_text().replace("# A small chapter", "# Another")
    other += "\n(other-place)=\n## A place\n\n```{list-table} It.\n:name: tbl-other\n\n* - x\n```\n"
    mini.source.with_name("01-other.md").write_text(other)
    return PlainBook(mini)


def test_each_form_in_plain_markdown(mini: MiniProject, book: PlainBook) -> None:
    chapter, _ = mini.chapters()
    notebook = read_source(chapter)
    notebook.cells = notebook.cells[:2]
    notebook.cells += [nbformat.v4.new_markdown_cell(text) for text in [LABELS, *CASES]]
    shown = [cell.source for cell in book.notebook(chapter, notebook, FOUND).cells]
    assert shown[2:] == [LABELLED, *filter(None, CASES.values())]


def test_figures_stay_with_their_captions_and_what_needs_the_page_goes(
    mini: MiniProject, book: PlainBook
) -> None:
    chapter, _ = mini.chapters()
    notebook = read_source(chapter)
    table = "```{list-table} Of {ref}`it <other-place>`.\n:name: tbl-x\n\n* - a\n```"
    shown = [
        ({"application/papermill.record/text/plain": "1"}, {"scrapbook": {"name": "a"}}),
        ({"text/html": '<section class="moving">'}, {}),
        ({"image/svg+xml": "<svg/>"}, {"inswsn": {"name": "fig-x", "caption": "", "alt": "a"}}),
        ({"text/markdown": table, "text/html": "<table>"}, {"table": {"name": "tbl-x"}}),
    ]
    notebook.cells[2].outputs = [
        nbformat.v4.new_output("display_data", data=data, metadata=about) for data, about in shown
    ]
    cells = book.notebook(chapter, notebook, FOUND, mini.root / "runs" / "a").cells
    assert_plain(notebook_text(notebook))
    assert [output["data"] for output in cells[2].outputs] == [
        {"image/svg+xml": "<svg/>"},
        {"text/markdown": "**Fig. 1.** What $x$ does."},
        {"text/markdown": "**Table 1.** Of [it](../../chapters/01-other.ipynb).\n\n"
                          "|  |\n| --- |\n| a |"},
    ]  # fmt: skip


def test_the_kept_twins_are_what_the_sources_give(project: Project) -> None:
    stale = [path.name for path in stale_twins(project)]
    assert not stale, "They are not what sources and published results give: make notebooks"


def test_the_kept_twins_read_anywhere(project: Project) -> None:
    for chapter in project.chapters():
        text = chapter.twin.read_text(encoding="utf-8")
        assert_plain(text)
        assert "**…**" not in text, chapter.name
        first = "".join(json.loads(text)["cells"][0]["source"])
        assert "Numbers in the text are those of the published run" in first


def test_a_twin_holds_no_output_and_is_written_where_it_is_stale(mini: MiniProject) -> None:
    (chapter,) = mini.chapters()
    mini.publish(results(quantity("twice", 42.0)))
    text, lost = str(stale_twins(mini)[chapter.twin]), mini.root / "chapters" / "07-lost.ipynb"
    assert "The number is **42**." in text
    cells = json.loads(text)["cells"]
    assert [cell["id"] for cell in cells] == [f"ch00-{i:03d}" for i in range(len(cells))]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all((cell["outputs"], cell["execution_count"]) == ([], None) for cell in code)
    assert code[0]["metadata"]["tags"] == ["parameters"]
    chapter.twin.write_text(text.replace("float = 2.0", "float = 3.0"))
    lost.write_text("{}")
    assert stale_twins(mini) == {chapter.twin: text, lost: None}
    write = [sys.executable, "-m", "inswsn_book.make.plain"]
    subprocess.run(write, env=os.environ | {ROOT_VARIABLE: str(mini.root)}, check=True)
    assert (stale_twins(mini), lost.exists()) == ({}, False)
