"""Cells of a CSV file by pandas, which reads a million rows in a second."""

from __future__ import annotations

import csv
import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from inswsn_lib.checks import Array
from inswsn_lib.recordings.cells import (
    ISO,
    NOT_THERE,
    PEEK,
    Column,
    Sheet,
    decimal_sign,
    refused,
)


def parse(sheet: Sheet) -> dict[str, NDArray[Any]]:
    """Return the columns of a file: floats, NaN where a cell is empty, or words."""
    columns, separator = sheet.columns, sheet.separator
    numeric = [column.place for column in columns if not column.words]
    decimal = _decimal(sheet, numeric)
    empty: Any = {place: ["", "nan", "NaN"] for place in numeric}
    try:
        with warnings.catch_warnings(action="ignore", category=pd.errors.DtypeWarning):
            table = pd.read_csv(
                BytesIO(sheet.data), sep=separator, decimal=decimal, index_col=False, header=0,
                names=range(sheet.width), usecols=[column.place for column in columns],
                keep_default_na=False, na_values=empty, skipinitialspace=b" " in sheet.data,
                dtype={column.place: str for column in columns if column.words},
            )  # fmt: skip
    except pd.errors.ParserError as error:
        raise csv.Error(str(error)) from None
    return {
        column.name: _texts(table[column.place])
        if column.words
        else _numbers(sheet.path, column, table[column.place], decimal)
        for column in columns
    }


def _decimal(sheet: Sheet, places: list[int]) -> str:
    """Return the decimal sign of the first rows."""
    if sheet.separator == ",":
        return "."
    seen = pd.read_csv(
        BytesIO(sheet.data), sep=sheet.separator, usecols=places, nrows=PEEK, dtype=str,
        index_col=False, keep_default_na=False,
    )  # fmt: skip
    return decimal_sign("".join(seen.to_numpy().ravel().tolist()), sheet.separator)


def _texts(cells: pd.Series) -> NDArray[Any]:
    return cells.str.strip().to_numpy(dtype=object)


def _numbers(path: Path, column: Column, cells: pd.Series, decimal: str) -> Array:
    """Return cells as floats; refuse words and what is no length, speed or time."""
    if cells.dtype.kind in "iuf":
        numbers, none = cells.astype(float), cells.isna()
        if numbers.abs().max() < column.largest:
            return np.asarray(numbers) / column.per_second
    else:
        texts = cells.astype("str").str.strip()
        none = cells.isna() | texts.str.lower().isin(NOT_THERE)
        numbers = pd.to_numeric(texts, errors="coerce").astype(float)
        if column.dates and (iso := _seconds(texts, decimal)).count() > numbers.count():
            numbers = iso
    wrong = np.asarray((numbers.isna() & ~none) | (numbers.abs() > column.largest))
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise refused(path, column, str(cells.iloc[row]), row)
    return np.asarray(numbers) / column.per_second


def _seconds(texts: pd.Series, decimal: str) -> pd.Series:
    """Return dates and times as seconds since 1970, UTC where none is named; else NaN."""
    dated = texts.where(texts.str.match(ISO)).str.replace(decimal, ".", regex=False)
    moments = pd.to_datetime(dated, format="ISO8601", utc=True, errors="coerce")
    return (moments - pd.Timestamp(0, tz="UTC")) / pd.Timedelta(seconds=1)
