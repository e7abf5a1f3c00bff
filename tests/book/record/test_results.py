"""The results file: what its form takes and refuses, and what is read back."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st
from inswsn_book.record.results import (
    SCHEMA_VERSION,
    Provenance,
    quantity_digest,
    read_results,
    write_results,
)
from made_results import quantity as made_quantity, results
from pydantic import ValidationError

from inswsn_lib.errors import InswsnError

quantity = partial(made_quantity, value=1.5, tolerance=0.1)
PROVENANCE = Provenance(
    version="0.1.0", commit="0" * 40, clean=True, sources={"library": "1" * 64},
    finished="2026-11-21 10:00 UTC", seconds=1.5, python="3.11.7", system="Linux x86_64",
    cpu="a processor", cores=2, blas=("openblas 0.3, 1 thread",), packages={"numpy": "2.4"},
)  # fmt: skip
finite = st.floats(allow_nan=False, allow_infinity=False)
names = st.from_regex(r"\A[a-z0-9]{1,8}(\.[a-z0-9]{1,8})?\Z")


@given(
    st.dictionaries(names, finite, max_size=5),
    st.dictionaries(
        names, st.one_of(st.booleans(), st.integers(-9, 9), finite, st.text()), max_size=4
    ),
)
def test_what_is_written_is_read_back_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, values: dict[str, float], parameters: dict[str, Any]
) -> None:
    path = tmp_path_factory.mktemp("results") / "00.json"
    found = [quantity(name=n, value=v) for n, v in values.items()]
    made = results(*found, parameters=parameters, provenance=PROVENANCE)
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
def test_the_form_refuses(changes: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        quantity(**changes)


def test_a_quantity_has_a_name_of_its_own_and_is_found_by_it() -> None:
    made = results(quantity(name="x", value=3.0), quantity(name="y"))
    assert made["x"].value == 3.0
    with pytest.raises(KeyError):
        made["z"]
    with pytest.raises(ValidationError, match="recorded twice: x"):
        results(quantity(name="x"), quantity(name="x"))
    assert quantity_digest(made["x"]) != quantity_digest(quantity(name="x", value=3.0, runs=2))
    assert quantity_digest(made["x"]) == quantity_digest(quantity(name="x", value=3.0))


def test_provenance_is_no_finding() -> None:
    later = PROVENANCE.model_copy(update={"seconds": 99.0, "commit": None, "clean": None})
    one = results(quantity(), provenance=PROVENANCE)
    assert one.found() == results(quantity(), provenance=later).found()
    assert one.found() != results(quantity(value=2.0), provenance=PROVENANCE).found()


def test_a_broken_file_is_refused_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "00.json"
    with pytest.raises(InswsnError, match="There is no results file"):
        read_results(path)
    content = json.loads(results(quantity()).model_dump_json())
    for text in (b"{", b"\xff", b"[" * 100_000):
        path.write_bytes(text)
        with pytest.raises(InswsnError, match="is not a results file"):
            read_results(path)
    for wrong in (SCHEMA_VERSION + 1, 0, "1", None):
        path.write_text(json.dumps(content | {"schema_version": wrong}))
        with pytest.raises(InswsnError, match="of this version: schema_version"):
            read_results(path)


@pytest.mark.parametrize("version", [1, 2, 3, 4])
def test_a_file_of_an_older_version_is_read(tmp_path: Path, version: int) -> None:
    """As data/published/00.json stood at version 1, cut short."""
    old = {
        "schema_version": version, "chapter": "00", "parameters": {"a": 1}, "data": {},
        "quantities": [
            {"name": "x", "value": 1.0, "unit": "m", "interval": None, "interval_kind": None,
             "runs": 1, "basis": "printed", "how": "For a test.", "tolerance": 0.0}
        ],
        "sentences": {"So.": True},
    }  # fmt: skip
    (tmp_path / "00.json").write_text(json.dumps(old))
    new = read_results(tmp_path / "00.json")
    assert (new.schema_version, new["x"].role, new.provenance) == (SCHEMA_VERSION, "found", None)
    assert (new.cells, new.solvers, new.tables, new.words) == ({}, {}, {}, {})
