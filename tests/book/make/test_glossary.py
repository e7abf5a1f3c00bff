"""The first use of a term links to the glossary, once, and in prose alone."""

from __future__ import annotations

import re

import pytest
from conftest import ROOT
from inswsn_book.make.glossary import FirstUses, terms_of

PAGE = """# Terms

```{glossary}
fix
  A position.

filtered, predicted
  With or without the present one.

INS
  A navigator. A fix is none.
```
"""


def test_a_glossary_is_read_name_by_name() -> None:
    both = "filtered, predicted"
    assert terms_of(PAGE) == {"fix": "fix", "filtered": both, "predicted": both, "INS": "INS"}
    assert terms_of("no glossary") == {}


@pytest.mark.parametrize(
    ("text", "linked"),
    [
        ("Two fixes and a fix.", "Two fixes and a {term}`fix <fix>`."),
        ("A fix, two fixs.", "A {term}`fix <fix>`, two fixs."),
        ("Fix it.", "{term}`Fix <fix>` it."),
        ("prefix, fix-point, INS-only", "prefix, fix-point, INS-only"),
        ("Predicted, then filtered.", "{term}`Predicted <filtered, predicted>`, then filtered."),
        ("`fix` $fix$ [fix](fix) {ref}`a fix` <b>", "`fix` $fix$ [fix](fix) {ref}`a fix` <b>"),
        ("# fix\n(fix)=\n:name: fix\n* - fix", "# fix\n(fix)=\n:name: fix\n* - fix"),
        ("```\nfix\n```\nfix", "```\nfix\n```\n{term}`fix <fix>`"),
        ("$$\nfix\n$$\n*fix*", "$$\nfix\n$$\n*{term}`fix <fix>`*"),
        ("::::{x}\n:::\nfix\n::::\nfix", "::::{x}\n:::\nfix\n::::\n{term}`fix <fix>`"),
    ],
)  # fmt: skip
def test_the_first_use_in_prose_is_a_link(text: str, linked: str) -> None:
    assert FirstUses(terms_of(PAGE)).link(text) == linked


def test_a_page_links_each_entry_once_over_all_its_cells() -> None:
    uses = FirstUses(terms_of(PAGE))
    assert uses.link("A fix is filtered.").count("{term}") == 2
    assert (
        uses.link("A fix is predicted by an INS.") == "A fix is predicted by an {term}`INS <INS>`."
    )


def test_what_the_lessons_rest_on_is_explained() -> None:
    terms = terms_of((ROOT / "book" / "notation.md").read_text(encoding="utf-8"))
    asked = {"LMI", "energy", "Riccati equation", "Schur complement", "bounded real lemma"}
    assert asked | {"matched", "NEES", "NIS"} <= set(terms)
    assert all(re.fullmatch(r"\S.*\S", entry) for entry in terms.values())
