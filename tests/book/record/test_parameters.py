"""Declared parameters: what a declaration takes and refuses; those of chapters and their cores."""

from __future__ import annotations

import ast
import math
from dataclasses import fields

import pytest
from conftest import MINI_CHAPTER
from hypothesis import given, strategies as st
from inswsn_book.record.notebooks import read_source
from inswsn_book.record.parameters import chapter_schema, read_schema, source_schema
from inswsn_book.record.project import Project
from inswsn_book.run.cores import core_name, load_core
from papermill import inspect_notebook

from inswsn_lib.errors import InswsnError, ParameterError

SCHEMA = read_schema("""\
# What "about" allows,
# on either side.
width: float = 2.5  # points; in [0, 10)
# Samples in a window.
samples: int = 100  # samples; in [4, 400]
# The form of the inequality.
form: str = "exact"  # 1; one of exact, printed
# Whether to draw.
draw: bool = True  # 1; any
# A share.
share: float = 0.5  # 1; in (0, 1]
# An offset.
offset: float = 0.0  # m; any
# A method, which the run tries.
learner: str = 'a.b:C'  # 1; a regressor
""")
NAMES = [parameter.name for parameter in SCHEMA.parameters]


def test_a_cell_is_read() -> None:
    assert SCHEMA.defaults == {
        "width": 2.5, "samples": 100, "form": "exact", "draw": True, "share": 0.5,
        "offset": 0.0, "learner": "a.b:C",
    }  # fmt: skip
    width = SCHEMA["width"]
    assert (width.kind, width.unit) == ("float", "points")
    assert width.meaning == 'What "about" allows, on either side.'
    assert SCHEMA.check({"samples": 7}) == SCHEMA.defaults | {"samples": 7}


@given(st.floats() | st.sampled_from([0.0, 10.0, math.nextafter(10, 0), -5e-324]))
def test_a_float_is_taken_exactly_when_it_is_finite_and_in_range(value: float) -> None:
    width = SCHEMA["width"]
    if math.isfinite(value) and 0 <= value < 10:
        assert width.check(value) == value
    else:
        with pytest.raises(ParameterError):
            width.check(value)


@given(st.integers() | st.integers(2, 402))
def test_an_int_is_taken_exactly_when_it_is_in_range(value: int) -> None:
    samples = SCHEMA["samples"]
    if 4 <= value <= 400:
        assert samples.check(value) == samples.read(str(value)) == value
    else:
        with pytest.raises(ParameterError):
            samples.check(value)


@given(st.sampled_from(NAMES), st.text(max_size=20))
def test_no_text_breaks_the_reader(name: str, text: str) -> None:
    parameter, value, refusal = SCHEMA[name], None, None
    try:
        value = parameter.read(text)
    except ParameterError as error:
        refusal = error
    if refusal is None:
        assert parameter.check(value) == value
    else:
        assert (refusal.name, "\n" in str(refusal)) == (name, False)
    # whether there is such a regressor is for the run to find
    assert name != "learner" or value == text.strip()


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_float_survives_the_command_line(value: float) -> None:
    assert SCHEMA["offset"].read(repr(value)) == value


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("samples", "010", 10),
        ("width", "1e0", 1.0),
        ("share", "1", 1.0),
        ("draw", "False", False),
        ("width", ".5", 0.5),
        ("width", "5.", 5.0),
        ("share", "1E-3", 1e-3),
    ],
)
def test_texts(name: str, text: str, value: object) -> None:
    found = SCHEMA[name].read(text)
    assert (found, type(found)) == (value, type(value))


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("width", 10.0, "width must be a number in [0, 10), not 10.0."),
        ("share", 0.0, "share must be a number in (0, 1], not 0.0."),
        ("width", True, "width must be a number in [0, 10), not True."),
        ("width", "3", "width must be a number in [0, 10), not '3'."),
        ("offset", 10**400, f"offset must be a finite number, not {str(10**400)[:200]}…."),
        ("offset", math.inf, "offset must be a finite number, not inf."),
        ("samples", 50.0, "samples must be a whole number in [4, 400], not 50.0."),
        ("samples", False, "samples must be a whole number in [4, 400], not False."),
        ("form", "other", "form must be one of exact, printed, not 'other'."),
        ("draw", 1, "draw must be true or false, not 1."),
        ("learner", 3, f"learner must be {SCHEMA['learner'].allowed}, not 3."),
        ("wdith", 1.0, f"parameter must be one of {', '.join(NAMES)} (the nearest is width), not "
         "'wdith'."),
    ],
)  # fmt: skip
def test_a_refusal_is_one_sentence(name: str, value: object, sentence: str) -> None:
    with pytest.raises(ParameterError) as refusal:
        SCHEMA.check({name: value})
    assert str(refusal.value) == sentence


@pytest.mark.parametrize(
    "line",
    [
        *("x: int = 1", "x: list = []  # m; any", "x: int  # m; any", "x: int = 1  # m; positive"),
        *("x: int = 1  # m; in (0, y)", "x: int = 1  # m; in [0, inf]", "print(1)  # m; any"),
        *(f"x: int = 1  # m; in [{ends}]" for ends in ("3, 1", "nan, 1", "2, 9")),
        *("x: float = 1  # m; in [0, 1)", "x: int = 1  # m; a regressor", "x: int = = 1  # m; any"),
        *("x: bool = True  # 1; a regressor", "x: str = 'a:B'  # 1; a regressor, a file"),
        *(f"x: int = {value}  # m; any" for value in ("{[]: 1}", "(", f"{'-' * 9999}1")),
        *("x: str = 3  # 1; a regressor", "x: int = len('ab')  # m; any", "x = 1  # m; any"),
        "x: int = 1  # m; any\n# Y.\nx: int = 2  # m; any",
    ],
)
def test_a_bad_declaration_is_refused(line: str) -> None:
    with pytest.raises(InswsnError):
        read_schema(f"# X.\n{line}")
    with pytest.raises(InswsnError, match="is not a declaration of the form"):
        read_schema("x: int = 1  # m; any")  # without a meaning


@pytest.mark.parametrize(
    "tags", ["[parameters]", "[hide-input, parameters]", '["parameters"]', "[parameters, more]"]
)
def test_the_cell_is_found_however_its_tags_are_written(tags: str) -> None:
    source = MINI_CHAPTER.replace("@BODY@", "").replace(":tags: [parameters]", f":tags: {tags}")
    assert source_schema(source, "00-mini.md").defaults == {"scale": 2.0}
    twice = source + f"\n```{{code-cell}} ipython3\n:tags: {tags}\n\n# x\n```\n"
    with pytest.raises(InswsnError, match="has 2 cells tagged parameters"):
        source_schema(twice, "00-mini.md")


def test_papermill_shows_every_parameter_of_every_chapter(project: Project) -> None:
    """By its own inspection, which skips a line with a second sign of equality."""
    for chapter in project.chapters():
        shown = inspect_notebook(str(chapter.twin))
        schema = chapter_schema(project.root, chapter.id)
        assert list(shown) == list(schema.defaults), chapter.name
        for parameter in schema.parameters:
            found = shown[parameter.name]
            assert found["inferred_type_name"] == parameter.kind
            assert ast.literal_eval(found["default"]) == parameter.default
            assert found["help"] == f"{parameter.unit}; {parameter.rule}"


def test_every_parameter_of_a_chapter_is_used_and_not_only_recorded(project: Project) -> None:
    """One that no cell reads would be accepted, shown, and change nothing."""
    for chapter in project.chapters():
        cells = [c.source for c in read_source(chapter).cells if c.cell_type == "code"]
        tree = ast.parse("\n".join(cells))
        recorded = {
            id(node)
            for call in ast.walk(tree)
            if isinstance(call, ast.Call) and getattr(call.func, "id", None) == "ChapterRecord"
            for node in ast.walk(call)
        }
        read = {
            node.id
            for node in ast.walk(tree)
            if isinstance(node, ast.Name)
            and isinstance(node.ctx, ast.Load)
            and id(node) not in recorded
        }
        if (core := core_name(chapter.source.read_text())) and "record.parameters" in str(cells):
            read |= {field.name for field in fields(load_core(core))}
        unused = set(chapter_schema(project.root, chapter.id).defaults) - read
        assert unused == set(), chapter.name


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
