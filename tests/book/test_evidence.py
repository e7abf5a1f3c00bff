"""Evidence and placeholders: what holds, what is shown, and what is refused."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from inswsn_book.evidence import Bound, Findings, Ruling, Sentence, escape_text
from inswsn_book.ledger import Claim, QuantityCheck
from inswsn_book.results import Quantity, Results
from inswsn_book.verdicts import Judged, Verdict

from inswsn_lib.errors import InswsnError

CLAIM = Claim(
    id="P1-M-twice",
    paper="P1",
    place="Section 1",
    says="Twice the number is 42 m.",
    value="42",
    unit="m",
    kind="numeric",
    check=QuantityCheck(chapter="00", quantity="twice"),
    tolerance="digits",
    why="It is printed in whole metres.",
)
RESULTS = Results(
    chapter="00",
    parameters={},
    data={},
    quantities=(
        Quantity(name="twice", value=42.25, unit="m", interval=(41.5, 43.0),
                 interval_kind="rounding", basis="printed", tolerance=0,
                 how="The number, scaled."),
        Quantity(name="share", value=0.25, unit="1", basis="printed", tolerance=0,
                 how="A share of the whole."),
        Quantity(name="loss", value=-3.5, unit="m", basis="printed", tolerance=0,
                 how="Less than nothing."),
    ),
    sentences={"It holds.": True, "It does not.": False},
)  # fmt: skip
FOUND = Findings([RESULTS], [Judged(CLAIM, Verdict.REPRODUCED, "It lies within.")])


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("{00:twice:.1f} m", "**42.2** m"),
        ("{00:twice}", "**42.25**"),
        ("{00:twice@low:.0f} to {00:twice@high:.0f}", "**42** to **43**"),
        ("{00:share:.0%}", "**25 %**"),
        ("{00:loss:.1f}", "**−3.5**"),
        ("{claim:P1-M-twice}", "[P1-M-twice](#claim-p1-m-twice) (*reproduced*)"),
        ("{ref}`x <y>` and {prf:ref}`z` and $A_{f}$, \\mathrm{a:b c}", None),
    ],
)
def test_placeholders_are_filled(text: str, shown: str | None) -> None:
    if shown is None:  # roles are left alone; a colon within braces is not
        with pytest.raises(InswsnError, match="no placeholder"):
            FOUND.fill(text)
        assert FOUND.fill(text.split(",", maxsplit=1)[0]) == text.split(",", maxsplit=1)[0]
    else:
        assert FOUND.fill(text) == shown


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{00:none:.1f}", "chapter 00 records no quantity none."),
        ("{07:twice:.1f}", "there are no results of chapter 07."),
        ("{0:twice}", "{0:twice} is no placeholder; it may be {01:name:.2f} or {claim:P1-P-T}."),
        ("{00:twice:zz}", "{00:twice:zz} has a format that does not fit a number."),
        ("{00:share@low}", "{00:share@low} asks for an interval, and there is none."),
        ("{00:twice@mid}", "@mid is no end of an interval; it may be @low or @high."),
        ("{claim:P1-none}", "the ledger has no claim P1-none."),
    ],
)
def test_a_bad_placeholder_gives_one_sentence(text: str, said: str) -> None:
    with pytest.raises(InswsnError) as caught:
        FOUND.fill(f"It is {text}.")
    assert str(caught.value) == said


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_a_bound_holds_exactly_when_the_value_is_within(value: float, end: float) -> None:
    quantity = RESULTS.quantities[2].model_copy(update={"value": value})
    found = Findings([RESULTS.model_copy(update={"quantities": (quantity,)})], [])
    assert found.holds(Bound(chapter="00", quantity="loss", at_least=end)) == (value >= end)
    assert found.holds(Bound(chapter="00", quantity="loss", at_most=end)) == (value <= end)


def test_sentences_and_rulings_hold_or_not() -> None:
    assert FOUND.holds(Sentence(chapter="00", sentence="It holds."))
    assert not FOUND.holds(Sentence(chapter="00", sentence="It does not."))
    assert FOUND.holds(Ruling(claim="P1-M-twice", verdict=Verdict.REPRODUCED))
    assert not FOUND.holds(Ruling(claim="P1-M-twice", verdict=Verdict.CONTRADICTED))


@pytest.mark.parametrize(
    ("evidence", "said"),
    [
        (Sentence(chapter="00", sentence="Nobody said so."),
         "chapter 00 binds no sentence 'Nobody said so.'."),
        (Ruling(claim="P1-X", verdict=Verdict.REPRODUCED), "the ledger has no claim P1-X."),
        (Bound(chapter="00", quantity="none", at_least=1), "chapter 00 records no quantity none."),
    ],
)  # fmt: skip
def test_evidence_that_names_nothing_is_refused(
    evidence: Sentence | Ruling | Bound, said: str
) -> None:
    with pytest.raises(InswsnError) as caught:
        FOUND.holds(evidence)
    assert str(caught.value) == said


def test_a_bound_without_an_end_is_no_evidence() -> None:
    with pytest.raises(ValueError, match="at_least or at_most"):
        Bound(chapter="00", quantity="twice")


def test_the_basis_names_each_number_once_and_says_where_it_is_from() -> None:
    text = "{00:twice:.1f}, {00:twice:.2f}, {00:twice@low:.1f} and {00:share:.0%}"
    basis = FOUND.basis([Ruling(claim="P1-M-twice", verdict=Verdict.REPRODUCED)], text)
    assert basis.count("`twice`: The number, scaled.") == 1
    assert basis.count("`share`: A share of the whole.") == 1
    assert "Claim [P1-M-twice](#claim-p1-m-twice): reproduced." in basis
    assert FOUND.basis([], "No number.") == ""


@given(st.text("ab*_`[]{}$<>~|^\\ ", max_size=20))
def test_escaped_text_shows_every_character(text: str) -> None:
    from markdown_it import MarkdownIt

    shown = MarkdownIt().render(f"x{escape_text(text)}x")
    plain = shown.removeprefix("<p>").removesuffix("</p>\n")
    for code, sign in (("&lt;", "<"), ("&gt;", ">"), ("&quot;", '"'), ("&amp;", "&")):
        plain = plain.replace(code, sign)
    assert plain == f"x{text}x"
