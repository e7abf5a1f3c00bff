"""Declared parameters: what a declaration takes and refuses, and that values are enforced."""

from __future__ import annotations

import ast
import math

import pytest
from hypothesis import given, strategies as st
from inswsn_book.parameters import Schema, chapter_schema, read_schema
from inswsn_book.project import Project
from papermill import inspect_notebook

from inswsn_lib.errors import InswsnError, ParameterError

CELL = """\
# What "about" allows,
# on either side.
width: float = 2.5  # points; in [0, 10)
# Samples in a window.
samples: int = 100  # samples; in [4, 400]
# The form of the inequality.
form: str = "exact"  # 1; one of exact, printed
# Whether to draw.
draw: bool = True  # 1; any
# An offset.
offset: float = 0.0  # m; any
"""


@pytest.fixture(scope="module")
def schema() -> Schema:
    return read_schema(CELL)


def test_a_cell_is_read(schema: Schema) -> None:
    assert schema.defaults == {
        "width": 2.5,
        "samples": 100,
        "form": "exact",
        "draw": True,
        "offset": 0.0,
    }
    width = schema["width"]
    assert (width.kind, width.unit) == ("float", "points")
    assert width.meaning == 'What "about" allows, on either side.'
    assert width.allowed == "a number in [0, 10)"
    assert schema["form"].allowed == "one of exact, printed"
    assert schema["offset"].allowed == "any number"


@given(st.floats())
def test_a_float_is_taken_exactly_when_it_is_finite_and_in_range(value: float) -> None:
    width = read_schema(CELL)["width"]
    if math.isfinite(value) and 0 <= value < 10:
        assert width.check(value) == value
    else:
        with pytest.raises(ParameterError):
            width.check(value)


@given(st.integers())
def test_an_int_is_taken_exactly_when_it_is_in_range(value: int) -> None:
    samples = read_schema(CELL)["samples"]
    if 4 <= value <= 400:
        assert samples.check(value) == value
        assert samples.read(str(value)) == value
    else:
        with pytest.raises(ParameterError):
            samples.check(value)


@given(st.text(max_size=20))
def test_no_text_breaks_the_reader(text: str) -> None:
    for name in ("width", "samples", "form", "draw", "offset"):
        parameter = read_schema(CELL)[name]
        refusal = None
        try:
            value = parameter.read(text)
        except ParameterError as error:
            refusal = error
        if refusal is None:
            assert parameter.check(value) == value
        else:
            assert refusal.name == name
            assert "\n" not in str(refusal)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_float_survives_the_command_line(value: float) -> None:
    assert read_schema(CELL)["offset"].read(repr(value)) == value


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [("samples", "010", 10), ("width", "1e0", 1.0), ("width", "3", 3.0), ("draw", "False", False)],
)
def test_texts(schema: Schema, name: str, text: str, value: object) -> None:
    found = schema[name].read(text)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"width": 10.0}, "width is 10.0; it may be a number in [0, 10)."),
        ({"width": True}, "width is True; it may be a number in [0, 10)."),
        ({"offset": 10**400}, f"offset is {str(10**400)[:200]}…; it may be any number."),
        ({"width": "3"}, "width is '3'; it may be a number in [0, 10)."),
        ({"samples": 50.0}, "samples is 50.0; it may be a whole number in [4, 400]."),
        ({"samples": False}, "samples is False; it may be a whole number in [4, 400]."),
        ({"form": "other"}, "form is 'other'; it may be one of exact, printed."),
        ({"draw": 1}, "draw is 1; it may be true or false."),
        ({"offset": math.inf}, "offset is inf; it may be any number."),
        (
            {"wdith": 1.0},
            "parameter is 'wdith'; it may be one of width, samples, form, draw, offset.",
        ),
    ],
)
def test_a_refusal_is_one_sentence(schema: Schema, values: dict, sentence: str) -> None:
    with pytest.raises(ParameterError) as refusal:
        schema.check(values)
    assert str(refusal.value) == sentence


def test_what_is_not_given_keeps_its_default(schema: Schema) -> None:
    assert schema.check({"samples": 7}) == schema.defaults | {"samples": 7}


@pytest.mark.parametrize(
    "cell",
    [
        "x = 1  # m; any",
        "# X.\nx: int = 1",
        "x: int = 1  # m; any",
        "# X.\nx: list = []  # m; any",
        "# X.\nx: int  # m; any",
        "# X.\nx: int = 1  # m; positive",
        "# X.\nx: int = 1  # m; in (0, y)",
        "# X.\nx: int = 1  # m; in [0, inf]",
        "# X.\nx: int = 1  # m; in [3, 1]",
        "# X.\nx: int = 1  # m; in [nan, 1]",
        "# X.\nx: int = 1  # m; in [2, 9]",
        "# X.\nx: float = 1  # m; in [0, 1)",
        "# X.\nprint(1)  # m; any",
        "# X.\nx: int = 1  # m; a regressor",
        "# X.\nx: bool = True  # 1; a regressor",
        "# X.\nx: str = 'a:B'  # 1; a regressor, a file",
        "# X.\nx: str = 3  # 1; a regressor",
        "# X.\nx: int = len('ab')  # m; any",
        "# X.\nx: int = 1  # m; any\n# Y.\nx: int = 2  # m; any",
        "# X.\nx: int = = 1  # m; any",
    ],
)
def test_a_bad_declaration_is_refused(cell: str) -> None:
    with pytest.raises(InswsnError):
        read_schema(cell)


def test_papermill_shows_every_parameter_of_every_chapter(project: Project) -> None:
    """By its own inspection, which skips a line with a second sign of equality."""
    for chapter in project.chapters():
        shown = inspect_notebook(str(chapter.twin))
        schema = chapter_schema(project.root, chapter.number)
        assert list(shown) == list(schema.defaults), chapter.name
        for parameter in schema.parameters:
            found = shown[parameter.name]
            assert found["inferred_type_name"] == parameter.kind
            assert ast.literal_eval(found["default"]) == parameter.default
            assert found["help"] == f"{parameter.unit}; {parameter.rule}"


@given(st.text(max_size=20))
def test_of_a_regressor_a_declaration_asks_for_a_text_alone(text: str) -> None:
    """Whether it can be had is for the run to find, which tries it."""
    learner = read_schema("# A method.\nlearner: str = 'a.b:C'  # 1; a regressor")["learner"]
    assert learner.default == "a.b:C"
    assert learner.check(text) == text
    assert learner.read(f" {text} ") == text.strip()
    for value in (3, None, True):
        with pytest.raises(ParameterError) as refusal:
            learner.check(value)
        assert str(refusal.value) == (
            f"learner is {value}; it may be package.module:Class, a scikit-learn regressor."
        )
