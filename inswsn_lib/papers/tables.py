"""Reading the transcribed tables and numbers from ``data/papers``, digits and all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import read_yaml

#: The four error components, position then velocity
AXES = ("rx", "ry", "vx", "vy")
#: The columns of P1's Tables 2 and 3 in printed order, component before area
COLUMNS = tuple(axis + area for axis in AXES for area in "12")


def read_table(path: Path, index: str) -> pd.DataFrame:
    """Read a printed table from a CSV file; every cell is a text, exactly as printed.

    Parameters
    ----------
    path : Path
    index : str
        The column that names the rows.

    Raises
    ------
    InswsnError
        If the file has no such column, a name twice, or a blank cell.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> from inswsn_lib.papers import read_table
    >>> table = read_table(iw.data_file("papers/p1-table2.csv"), index="method")
    >>> table.loc["HF", "rx1"]
    '0.3881'
    """
    frame = pd.read_csv(path, dtype=str, keep_default_na=False)
    if index not in frame.columns:
        raise InswsnError(
            f"{path.name} has no column {index!r}; it has {', '.join(map(str, frame))}."
        )
    if frame[index].duplicated().any():
        raise InswsnError(f"{path.name} names a row twice in its column {index!r}.")
    if (frame == "").any(axis=None):
        raise InswsnError(f"{path.name} has a blank cell; every printed cell has a number.")
    return frame.set_index(index)


def read_numbers(path: Path) -> dict[str, Any]:
    """Read the printed numbers of a paper's text from YAML, each a text exactly as printed.

    Raises
    ------
    InswsnError
        If the file holds a number that is not a text, which would lose its digits.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> from inswsn_lib.papers import read_numbers
    >>> read_numbers(iw.data_file("papers/p1.yaml"))["text"]["sampling_period"]  # s
    '1'
    """
    content: dict[str, Any] = read_yaml(path)
    _refuse_numbers(content, path.name)
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
