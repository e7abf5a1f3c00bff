"""The results file: what its schema takes and refuses, and that it is written whole."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st
from inswsn_book.results import (
    SCHEMA_VERSION,
    Provenance,
    Quantity,
    Results,
    read_results,
    write_results,
)
from pydantic import ValidationError

from inswsn_lib import files
from inswsn_lib.errors import InswsnError


def quantity(**changes: Any) -> Quantity:
    fields: dict[str, Any] = {
        "name": "a.b-c",
        "value": 1.5,
        "unit": "m",
        "basis": "printed",
        "how": "Computed for a test.",
        "tolerance": 0.1,
    }
    return Quantity(**(fields | changes))


def results(*quantities: Quantity, **changes: Any) -> Results:
    fields: dict[str, Any] = {"chapter": "00", "parameters": {}, "data": {}}
    return Results(**(fields | {"quantities": quantities} | changes))


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.lists(
        st.tuples(st.from_regex(r"\A[a-z0-9]{1,8}(\.[a-z0-9]{1,8})?\Z"), finite),
        unique_by=lambda pair: pair[0],
        max_size=5,
    ),
    st.dictionaries(
        st.from_regex(r"\A[a-z]{1,8}\Z"),
        st.one_of(st.booleans(), st.integers(-9, 9), finite, st.text()),
        max_size=4,
    ),
)
def test_what_is_written_is_read_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory,
    values: list[tuple[str, float]],
    parameters: dict[str, Any],
) -> None:
    path = tmp_path_factory.mktemp("results") / "00.json"
    made = results(*(quantity(name=n, value=v) for n, v in values), parameters=parameters)
    write_results(made, path)
    assert read_results(path) == made


@pytest.mark.parametrize(
    "changes",
    [
        {"value": float("nan")},
        {"value": float("inf")},
        {"name": "Upper"},
        {"name": ""},
        {"name": "a..b"},
        {"unit": ""},
        {"runs": 0},
        {"tolerance": -1.0},
        {"tolerance": float("inf")},
        {"basis": "guessed"},
        {"how": "short"},
        {"interval": (2.0, 3.0), "interval_kind": "rounding"},
        {"interval": (1.0, 2.0)},
        {"interval_kind": "rounding"},
        {"surprise": 1},
    ],
)
def test_the_schema_refuses(changes: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        quantity(**changes)


def test_a_name_twice_is_refused() -> None:
    with pytest.raises(ValidationError, match="recorded twice: x"):
        results(quantity(name="x"), quantity(name="x"))


def test_lookup_by_name() -> None:
    made = results(quantity(name="x", value=3.0))
    assert made["x"].value == 3.0
    with pytest.raises(KeyError):
        made["y"]


def test_a_broken_file_is_refused_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "00.json"
    with pytest.raises(InswsnError, match="There is no results file"):
        read_results(path)
    path.write_text("{")
    with pytest.raises(InswsnError, match="is not a results file"):
        read_results(path)
    write_results(results(quantity()), path)
    content = json.loads(path.read_text())
    for wrong in (SCHEMA_VERSION + 1, 0, "1", None):
        content["schema_version"] = wrong
        path.write_text(json.dumps(content))
        with pytest.raises(InswsnError, match="of this version: schema_version"):
            read_results(path)


@pytest.mark.parametrize("version", [1, 2])
def test_a_file_of_an_older_version_is_read(tmp_path: Path, version: int) -> None:
    # as data/published/00.json stood at version 1, cut short
    old = {
        "schema_version": version,
        "chapter": "00",
        "parameters": {"a": 1},
        "data": {},
        "quantities": [
            {"name": "x", "value": 1.0, "unit": "m", "interval": None, "interval_kind": None,
             "runs": 1, "basis": "printed", "how": "For a test.", "tolerance": 0.0}
        ],
        "sentences": {"So.": True},
    }  # fmt: skip
    path = tmp_path / "00.json"
    path.write_text(json.dumps(old))
    new = read_results(path)
    assert new.schema_version == SCHEMA_VERSION
    assert new["x"].role == "found"
    assert new.provenance is None
    assert new.cells == {}
    assert new.solvers == {}
    assert new.tables == {}


PROVENANCE = Provenance(
    version="0.1.0", commit="0" * 40, clean=True, sources={"library": "1" * 64},
    finished="2026-11-21 10:00 UTC", seconds=1.5, python="3.11.7", system="Linux x86_64",
    cpu="a processor", cores=2, blas=("openblas 0.3, 1 thread",), packages={"numpy": "2.4"},
)  # fmt: skip


def test_provenance_is_kept_and_is_no_finding(tmp_path: Path) -> None:
    made = results(quantity(), provenance=PROVENANCE)
    write_results(made, tmp_path / "00.json")
    assert read_results(tmp_path / "00.json").provenance == PROVENANCE
    later = PROVENANCE.model_copy(update={"seconds": 99.0, "commit": None, "clean": None})
    assert made.found() == results(quantity(), provenance=later).found()
    assert made.found() != results(quantity(value=2.0), provenance=PROVENANCE).found()


def test_an_interrupted_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "00.json"
    write_results(results(quantity(value=1.0)), path)
    before = path.read_bytes()

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(files.os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_results(results(quantity(value=2.0)), path)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["00.json"]
