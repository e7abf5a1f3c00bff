"""Runs with other parameters: into a folder of their own, compared with the published run."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest
from conftest import MiniProject, run_command
from inswsn_book.compare import comparison
from inswsn_book.parameters import chapter_schema, read_schema
from inswsn_book.project import MODULES_VARIABLE
from inswsn_book.record import ChapterRecord
from inswsn_book.results import Quantity, Results, read_results
from inswsn_book.running import gather_parameters

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.files import DATA_VARIABLE


def test_chapters_lists_their_parameters(mini: MiniProject) -> None:
    done = run_command(mini.root, "chapters")
    assert done.stdout == (
        "00  mini\n"
        "    scale = 2.0; a number in (0, 100]\n"
        "        What the number is multiplied by.\n"
    )


def test_a_run_and_its_comparison(built: MiniProject, tmp_path: Path) -> None:
    assert run_command(built.root, "publish").returncode == 0
    published = (built.published / "00.json").read_bytes()
    results = (built.results / "00.json").read_bytes()

    out = tmp_path / "out"
    done = run_command(built.root, "run", "0", "-p", "scale=3", "--out", str(out), "--html")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].startswith("twice: 42 m -> 63 m (change +21, tolerance 0.5)")
    assert "parameters: scale: 2.0 -> 3.0" in lines
    assert (
        "verdict P1-M-twice: reproduced -> contradicted by the paper itself "
        "(No numbers that round to the printed cells allow it.)"
    ) in lines
    assert (
        "1 of 1 quantities changed, 0 of 0 sentences overturned, 1 of 1 verdicts flipped."
    ) in lines
    assert read_results(out / "00.json").parameters == {"scale": 3.0}
    assert (out / "parameters.yml").read_text() == "scale: 3.0\n"
    assert ">63<" in (out / "html" / "chapters" / "00-mini.html").read_text()
    # the page of claims in the rendered run is of that run
    assert "63 m" in (out / "html" / "claims.html").read_text()
    assert "42 m" in (built.site / "claims.html").read_text()
    assert "## Provenance" in (out / "00-mini.ipynb").read_text()
    # the published results, the last build and its site are what they were
    assert (built.published / "00.json").read_bytes() == published
    assert (built.results / "00.json").read_bytes() == results
    assert ">42<" in (built.site / "chapters" / "00-mini.html").read_text()
    assert "00-mini: unchanged" in run_command(built.root, "book").stderr

    # a file of parameters, overridden; the folder of an earlier run may be used again
    file = tmp_path / "params.yml"
    file.write_text("scale: 5\n")
    done = run_command(built.root, "run", "00-mini", "-f", str(file), "--out", str(out))
    assert done.returncode == 0
    assert read_results(out / "00.json")["twice"].value == 105
    assert not (out / "html").exists()  # a page of the earlier run would belie this one
    words = ("run", "00", "-f", str(file), "-p", "scale=4")
    done = run_command(built.root, *words)
    (folder,) = (built.root / "runs").iterdir()
    assert done.stdout.splitlines()[-1] == f"The run is in {folder}"
    done = run_command(built.root, "compare", str(out / "00.json"), str(folder / "00.json"))
    assert "parameters: scale: 5.0 -> 4.0" in done.stdout


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["00", "-p", "seed=7"], "parameter is 'seed'; it may be one of scale."),
        (["00", "-p", "scale=0"], "scale is 0.0; it may be a number in (0, 100]."),
        (["00", "-p", "scale=inf"], "scale is inf; it may be a number in (0, 100]."),
        (["00", "-p", "scale=two"], "scale is 'two'; it may be a number in (0, 100]."),
        (["00", "-p", "scale"], "-p is 'scale'; it may be name=value."),
        (
            ["00", "-p", "scale=1", "-p", "scale=2"],
            "-p is 'scale=2'; it may be given once: scale is set twice.",
        ),
        (["07"], "NAME is '07'; it may be one of 00."),
        (
            ["00", "--out", "data"],
            "--out is 'data'; it may be a new or empty folder, or one that holds an earlier run "
            "alone.",
        ),
    ],
)
def test_a_run_is_refused_before_anything_runs(
    mini: MiniProject, words: list[str], sentence: str
) -> None:
    done = run_command(mini.root, "run", *words)
    assert done.returncode == 2
    assert done.stderr == f"inswsn: {sentence}\n"
    assert done.stdout == ""
    assert not (mini.root / "runs").exists()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("scale: [", "is not YAML"),
        ("- scale", "is not a list of parameters"),
        ("7: 1", "is not a list of parameters"),
        ("scale: '3'", "scale is '3'"),
        ("scale: .nan", "scale is nan"),
        ("scale: true", "scale is True"),
        ("other: 1", "parameter is 'other'"),
    ],
)
def test_a_bad_file_of_parameters(mini: MiniProject, tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "params.yml"
    file.write_text(text)
    schema = chapter_schema(mini.root, "00")
    with pytest.raises(InswsnError) as refusal:
        gather_parameters(schema, [], file, tmp_path)
    assert said in str(refusal.value)
    file.write_text("")
    assert gather_parameters(schema, [], file, tmp_path) == {}


def test_a_run_that_fails_writes_nothing(mini: MiniProject) -> None:
    (mini.root / "data" / "papers" / "number.txt").write_text("not a number")
    done = run_command(mini.root, "run", "00")
    assert done.returncode == 1
    assert "Chapter 00-mini failed in cell 3" in done.stderr
    assert not (mini.root / "runs").exists()


def test_html_needs_a_built_book(mini: MiniProject, tmp_path: Path) -> None:
    done = run_command(mini.root, "run", "00", "--html", "--out", str(tmp_path / "out"))
    assert done.returncode == 2
    assert "Chapter 00 has not been built as it is now" in done.stderr
    assert "executing" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_run_whose_page_cannot_be_rendered_writes_nothing(
    built: MiniProject, tmp_path: Path
) -> None:
    built.page("# Mini\n\nSee {ref}`nowhere`.\n")
    out = tmp_path / "out"
    done = run_command(built.root, "run", "00", "--html", "--out", str(out))
    assert done.returncode == 1
    assert "undefined label: 'nowhere'" in done.stderr
    assert not out.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["mini"]
    built.page()
    assert run_command(built.root, "run", "00", "--html", "--out", str(out)).returncode == 0


def test_plain_papermill_is_held_to_the_declaration(mini: MiniProject) -> None:
    # a record refuses what `inswsn run` would have refused
    with pytest.raises(ParameterError, match=r"scale is 1000\.0"):
        ChapterRecord("00", parameters={"scale": 1000.0}, root=mini.root)
    with pytest.raises(ParameterError, match="parameter is 'other'"):
        ChapterRecord("00", parameters={"scale": 1.0, "other": 1}, root=mini.root)
    with pytest.raises(InswsnError, match="keeps no record of its parameter scale"):
        ChapterRecord("00", parameters={}, root=mini.root)


def quantity(name: str, value: float) -> Quantity:
    return Quantity(
        name=name, value=value, unit="m", basis="printed", how="Made for a test.", tolerance=0.1
    )


def test_compare_on_files_that_do_not_hold_the_same() -> None:
    before = Results(
        chapter="00",
        parameters={"a": 1},
        data={},
        quantities=(quantity("old", 1), quantity("both", 1)),
        sentences={"It rains.": True, "It pours.": False, "It is gone.": True},
    )
    after = Results(
        chapter="00",
        parameters={"b": 2},
        data={"data/x": "a" * 64},
        quantities=(
            quantity("both", 1 + 1e-15).model_copy(update={"tolerance": 0.2}),
            quantity("new", 3),
        ),
        sentences={"It rains.": False, "It pours.": True, "It snows.": False},
    )
    assert comparison(before, after, []) == [
        "old: 1 m -> absent",
        "both: 1 m -> 1 m (change +1.11e-15, tolerance 0.1); tolerance 0.1 -> 0.2",
        "new: absent -> 3 m",
        "parameters: b: absent -> 2",
        "parameters: a: 1 -> absent",
        "data: data/x: absent -> " + "a" * 64,
        "sentences: It rains.: True -> False",
        "sentences: It pours.: False -> True",
        "sentences: It snows.: absent -> False",
        "sentences: It is gone.: True -> absent",
        "3 of 3 quantities changed, 4 of 4 sentences overturned, 0 of 0 verdicts flipped.",
    ]


def test_compare_refuses_what_cannot_be_compared(mini: MiniProject, tmp_path: Path) -> None:
    first, second = tmp_path / "a.json", tmp_path / "b.json"
    made = Results(chapter="00", parameters={}, data={}, quantities=())
    first.write_text(made.model_dump_json())
    second.write_text(made.model_copy(update={"chapter": "01"}).model_dump_json())
    done = run_command(mini.root, "compare", str(first), str(second))
    assert done.returncode == 2
    assert "two runs of one chapter can be compared" in done.stderr
    content = json.loads(first.read_text())
    second.write_text(json.dumps(content | {"schema_version": 99}))
    done = run_command(mini.root, "compare", str(first), str(second))
    assert done.returncode == 2
    assert "is not a results file of this version: schema_version" in done.stderr
    # a file of the first version has no solvers, cells and provenance, and is compared
    old = {k: v for k, v in content.items() if k not in ("solvers", "cells", "provenance")}
    second.write_text(json.dumps(old | {"schema_version": 1}))
    done = run_command(mini.root, "compare", str(first), str(second))
    assert done.returncode == 0
    assert done.stdout.splitlines()[-1].startswith("0 of 0 quantities changed")


def test_no_folder_but_an_earlier_run_is_replaced(mini: MiniProject, tmp_path: Path) -> None:
    out, neighbour = tmp_path / "keep", tmp_path / "keep.old"
    neighbour.mkdir()
    (neighbour / "thesis.txt").write_text("mine")
    words = ("run", "00", "-p", "scale=3", "--out", str(out))
    assert run_command(mini.root, *words).returncode == 0
    assert run_command(mini.root, *words).returncode == 0  # an earlier run may be replaced
    assert (neighbour / "thesis.txt").read_text() == "mine"
    # not with anything else in it
    (out / "note.txt").write_text("mine")
    done = run_command(mini.root, *words)
    assert done.returncode == 2
    assert "one that holds an earlier run alone" in done.stderr
    assert (out / "note.txt").read_text() == "mine"
    # nor a folder with a file of parameters that a user wrote
    own = tmp_path / "own"
    own.mkdir()
    (own / "parameters.yml").write_text("scale: 3\n")
    done = run_command(mini.root, "run", "00", "-f", str(own / "parameters.yml"), "--out", str(own))
    assert done.returncode == 2
    assert [path.name for path in own.iterdir()] == ["parameters.yml"]


def test_what_a_chapter_writes_for_its_reader_is_in_the_run(
    mini: MiniProject, tmp_path: Path
) -> None:
    mini.chapter("```{code-cell} ipython3\nrecord.write_file('note.csv', 'a,b\\n')\n```")
    done = run_command(mini.root, "run", "00", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "note.csv").read_text() == "a,b\n"


def test_a_chapter_is_told_where_recorded_data_are(
    mini: MiniProject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # named from where the command is run; the kernel works in a folder of its own
    monkeypatch.setenv(DATA_VARIABLE, "recorded")
    mini.chapter(
        "```{code-cell} ipython3\nimport os\n"
        f"record.write_file('told.txt', os.environ['{DATA_VARIABLE}'])\n```"
    )
    done = run_command(mini.root, "run", "00", "--out", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "told.txt").read_text() == str(mini.root / "recorded")


def test_a_file_that_a_parameter_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    schema = read_schema("# A file.\nname: str = 'given.csv'  # 1; a file")
    data = tmp_path / "data"
    data.mkdir()
    (data / "given.csv").write_text("")
    (tmp_path / "own.csv").write_text("")
    monkeypatch.chdir(tmp_path)
    # one of the project's stays a name, so that a results file is the same on every machine
    assert gather_parameters(schema, ["name=given.csv"], None, data) == {"name": "given.csv"}
    own = str((tmp_path / "own.csv").resolve())
    assert gather_parameters(schema, ["name=own.csv"], None, data) == {"name": own}
    with pytest.raises(ParameterError, match="there is no such file"):
        gather_parameters(schema, ["name=none.csv"], None, data)


def test_a_regressor_that_a_parameter_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    schema = read_schema("# A method.\nlearner: str = 'no.such:Thing'  # 1; a regressor")
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delenv(MODULES_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    # the default is not tried: the published run has
    assert gather_parameters(schema, [], None, tmp_path) == {}
    name = "sklearn.linear_model:LinearRegression"
    assert gather_parameters(schema, [f"learner={name}"], None, tmp_path) == {"learner": name}
    with pytest.raises(ParameterError) as refusal:
        gather_parameters(schema, ["learner=nonsense"], None, tmp_path)
    assert str(refusal.value) == (
        "learner is 'nonsense'; it may be package.module:Class, a scikit-learn regressor that "
        "needs no arguments."
    )
    # one in a file of parameters is tried as well
    file = tmp_path / "params.yml"
    file.write_text("learner: sklearn.linear_model:Nobody\n")
    with pytest.raises(ParameterError, match="has no attribute 'Nobody'"):
        gather_parameters(schema, [], file, tmp_path)
    # the command line comes before the file, and what it overrides is not tried
    found = gather_parameters(schema, [f"learner={name}"], file, tmp_path)
    assert found == {"learner": name}


def test_what_the_library_refuses_in_a_run_is_one_sentence(mini: MiniProject) -> None:
    mini.chapter(
        "```{code-cell} ipython3\nfrom inswsn_lib.errors import ParameterError\n"
        "if scale > 50:\n    raise ParameterError('scale', scale, 'at most 50 here')\n```"
    )
    done = run_command(mini.root, "run", "00", "-p", "scale=60")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "inswsn: scale is 60.0; it may be at most 50 here."
    assert "Traceback" not in done.stderr
    assert not list(mini.root.glob("runs/*"))
