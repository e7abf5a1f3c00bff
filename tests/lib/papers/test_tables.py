"""Reading printed tables and numbers, and refusing what would lose their digits."""

from __future__ import annotations

from pathlib import Path

import pytest

from inswsn_lib.errors import InswsnError
from inswsn_lib.papers import COLUMNS, read_numbers, read_rows, read_table


def test_rows_are_in_printed_order_and_are_those_of_the_table(root: Path) -> None:
    path = root / "data" / "papers" / "p1-table2.csv"
    rows = read_rows(path, index="method")
    assert list(rows) == ["INS-only", "KF", "HF"]
    assert list(rows["KF"]) == list(COLUMNS)
    assert rows == read_table(path, index="method").to_dict("index")
    assert read_table(path, index="method").index.name == "method"


def test_digits_survive(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("method,a\nKF,0.0900\nNA,1\n")
    table = read_table(path, index="method")
    assert table.loc["KF", "a"] == "0.0900"
    assert table.loc["NA", "a"] == "1"  # a row may be called NA


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("name,a\nKF,1\n", "t.csv has no column 'method'; it has name, a."),
        ("method,a\nKF,1\nKF,2\n", "t.csv names a row twice in its column 'method'."),
        ("method,a\nKF,\n", "t.csv has a blank cell; every printed cell has a number."),
        ("", "t.csv has no column 'method'; it has none."),
        ("method,a,a\nKF,1,2\n", "t.csv names a column twice; it has method, a, a."),
        (
            "method,a\nKF,1,2\n",
            "t.csv has 3 cells in a row (KF, 1, 2); there must be 2, as in the header.",
        ),
        (
            "method,a\nKF,1,\n",
            "t.csv has 3 cells in a row (KF, 1, ); there must be 2, as in the header.",
        ),
        ("method,a\n", "t.csv has 0 cells in a row (); there must be 2, as in the header."),
        ('method,a\n"KF,1\n', "t.csv is not a CSV file: unexpected end of data."),
    ],
)
def test_a_bad_table_is_refused(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(InswsnError) as refusal:
        read_table(path, index="method")
    assert str(refusal.value) == sentence


def test_an_unquoted_number_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "n.yaml"
    path.write_text("a: {b: ['0.10', 0.10]}\n")
    with pytest.raises(
        InswsnError, match=r"n.yaml: a: b is 0.1; a printed number is a quoted string"
    ):
        read_numbers(path)
    path.write_text("a: '0.10'\n")
    assert read_numbers(path) == {"a": "0.10"}
