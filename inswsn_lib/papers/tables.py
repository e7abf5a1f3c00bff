"""Reading the transcribed tables and numbers from ``data/papers``, digits and all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml


def read_table(path: Path, index: str) -> pd.DataFrame:
    """Read a printed table.

    Parameters
    ----------
    path : Path
        A CSV file with a header.
    index : str
        The column that names the rows.

    Returns
    -------
    DataFrame
        Every cell a string, exactly as printed.

    Raises
    ------
    InswsnError
        If the file has no such column, a name twice, or a blank cell.

    Examples
    --------
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.papers import read_table
    >>> table = read_table(data_file("papers/p1-table2.csv"), index="method")
    >>> table.loc["HF", "rx1"]
    '0.3881'
    >>> list(table.index)
    ['INS-only', 'KF', 'HF']
    """
    frame = pd.read_csv(path, dtype=str, keep_default_na=False)
    if index not in frame.columns:
        raise InswsnError(
            f"{path.name} has no column {index!r}; it has {', '.join(map(str, frame.columns))}."
        )
    if frame[index].duplicated().any():
        raise InswsnError(f"{path.name} names a row twice in its column {index!r}.")
    if (frame == "").any(axis=None):
        raise InswsnError(f"{path.name} has a blank cell; every printed cell has a number.")
    return frame.set_index(index)


def read_numbers(path: Path) -> dict[str, Any]:
    """Read the printed numbers of a paper's text from YAML, each a string exactly as printed.

    Parameters
    ----------
    path : Path
        The file, such as ``data/papers/p1.yaml``.

    Returns
    -------
    dict
        As nested as the file.

    Raises
    ------
    InswsnError
        If the file holds a number that is not a string, which would lose its digits.

    Examples
    --------
    >>> from inswsn_lib.files import data_file
    >>> from inswsn_lib.papers import read_numbers
    >>> numbers = read_numbers(data_file("papers/p1.yaml"))
    >>> numbers["text"]["sampling_period"]  # in s, a text with the digits as printed
    '1'
    """
    content = read_yaml(path)
    _refuse_numbers(content, path.name)
    assert isinstance(content, dict)
    return content


def _refuse_numbers(node: Any, where: str) -> None:
    if isinstance(node, dict):
        for key, value in node.items():
            _refuse_numbers(value, f"{where}: {key}")
    elif isinstance(node, list):
        for value in node:
            _refuse_numbers(value, where)
    elif not isinstance(node, str):
        raise InswsnError(f"{where} is {node!r}; a printed number is a quoted string.")
