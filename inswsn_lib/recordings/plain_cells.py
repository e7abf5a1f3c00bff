"""Cells of a CSV file without pandas: a tenth as fast, and to the last digits the same numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from math import nan
from typing import Any

import numpy as np
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

# what a number may be: float takes other digits, and digits in groups, too
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?|[-+]?inf(inity)?", re.A | re.I)
_ISO = re.compile(ISO)


def parse(sheet: Sheet) -> dict[str, NDArray[Any]]:
    """Return the columns of a file: floats, NaN where a cell is empty, or words."""
    lines = sheet.data.decode().split("\n")[:-1]  # each has its end
    reader = csv.reader(lines, delimiter=sheet.separator, skipinitialspace=True, strict=True)
    cells = [[row[column.place] for column in sheet.columns] for row in reader][1:]
    texts = {
        column.name: [row[k].strip() for row in cells] for k, column in enumerate(sheet.columns)
    }
    numeric = [column.name for column in sheet.columns if not column.words]
    seen = "".join(text for name in numeric for text in texts[name][:PEEK])
    decimal = decimal_sign(seen, sheet.separator)
    return {
        column.name: np.array(texts[column.name], dtype=object)
        if column.words
        else _numbers(sheet, column, texts[column.name], decimal)
        for column in sheet.columns
    }


def _numbers(sheet: Sheet, column: Column, texts: Sequence[str], decimal: str) -> Array:
    """Return cells as floats; refuse words and what is no length, speed or time."""
    there = np.array([text.lower() not in NOT_THERE for text in texts], dtype=bool)
    found = np.array([_number(text.replace(decimal, ".")) for text in texts])
    if np.isnan(found[there]).any():
        # a column may have points for all that where others have commas
        found = np.array([_number(text) for text in texts])
        if column.dates:
            dates = np.array([_seconds(text.replace(decimal, ".")) for text in texts])
            found = max(found, dates, key=lambda each: int(np.isfinite(each).sum()))
    wrong = (np.isnan(found) & there) | (np.abs(found) > column.largest)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise refused(sheet.path, column, texts[row], row)
    return found / column.per_second


def _number(text: str) -> float:
    return float(text) if _NUMBER.fullmatch(text) else nan


def _seconds(text: str) -> float:
    """Return a date and time as seconds since 1970, UTC where no zone is named; else NaN."""
    if _ISO.match(text):
        with suppress(ValueError):
            moment = datetime.fromisoformat(text)
            return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return nan
