"""Reading the transcribed tables and numbers from ``data/papers``, digits and all."""

from __future__ import annotations

import csv
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inswsn_lib.errors import InswsnError
from inswsn_lib.extras import need
from inswsn_lib.files import read_text, read_yaml

if TYPE_CHECKING:
    import pandas as pd

#: The four error components, position then velocity
AXES = ("rx", "ry", "vx", "vy")
#: The columns of P1's Tables 2 and 3 in printed order, component before area
COLUMNS = tuple(axis + area for axis in AXES for area in "12")


def read_rows(path: Path, index: str) -> dict[str, dict[str, str]]:
    """Read the rows of a printed table from a CSV file; every cell is a text, exactly as printed.

    Parameters
    ----------
    path : Path
    index : str
        The column that names the rows.

    Returns
    -------
    dict
        The cells of each row by their columns, in printed order.

    Raises
    ------
    InswsnError
        If the file has no such column, a name twice, a blank cell, a row of another length than
        the header, or none.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> from inswsn_lib.papers import read_rows
    >>> read_rows(iw.data_file("papers/p1-table2.csv"), index="method")["HF"]["rx1"]
    '0.3881'
    """
    try:
        lines = csv.reader(StringIO(read_text(path), newline=""), strict=True)
        header, *rows = [line for line in lines if line] or [[]]
    except csv.Error as error:
        raise InswsnError(f"{path.name} is not a CSV file: {error}.") from None
    if index not in header:
        named = ", ".join(header) or "none"
        raise InswsnError(f"{path.name} has no column {index!r}; it has {named}.")
    if len(set(header)) < len(header):
        raise InswsnError(f"{path.name} names a column twice; it has {', '.join(header)}.")
    found = {}
    for row in rows or [[]]:
        if len(row) != len(header):
            raise InswsnError(
                f"{path.name} has {len(row)} cells in a row ({', '.join(row)}); there must be "
                f"{len(header)}, as in the header."
            )
        if "" in row:
            raise InswsnError(f"{path.name} has a blank cell; every printed cell has a number.")
        cells = dict(zip(header, row, strict=True))
        found[cells.pop(index)] = cells
    if len(found) < len(rows):
        raise InswsnError(f"{path.name} names a row twice in its column {index!r}.")
    return found


def read_table(path: Path, index: str) -> pd.DataFrame:
    """Return what `read_rows` does as a table.

    Parameters
    ----------
    path, index
        As `read_rows` takes them, which says what is refused.

    Examples
    --------
    >>> import inswsn_lib as iw
    >>> from inswsn_lib.papers import read_table
    >>> table = read_table(iw.data_file("papers/p1-table2.csv"), index="method")
    >>> table.loc["HF", "rx1"]
    '0.3881'
    """
    rows = read_rows(path, index)
    frame = need("pandas", "A table as printed").DataFrame
    return frame.from_dict(rows, orient="index", dtype="str").rename_axis(index)


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
    content = read_yaml(path)
    if not isinstance(content, dict):
        raise InswsnError(f"{path.name} holds no names with numbers.")
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
