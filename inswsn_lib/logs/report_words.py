"""What a report says in words."""

from __future__ import annotations

import numpy as np
import pandas as pd

from inswsn_lib.logs.findings import Finding

_OF_FILTER = ("outliers", "size", "colour", "whiteness", "errors")


def of_set_up(findings: list[Finding]) -> list[str]:
    """Return a sentence of what does not fit in the set-up, if anything."""
    wrong = [f for f in findings if f.fits is False and f.name not in _OF_FILTER]
    if not wrong:
        return []
    return [f"The set-up does not fit: {'; '.join(f'{f.subject}: {f.says}' for f in wrong)}."]


def _of_filter(findings: list[Finding]) -> str:
    """Return a sentence of whether the filter is consistent."""
    told = [found for found in findings if found.name in _OF_FILTER]
    wrong = [found for found in told if found.fits is False]
    if wrong:
        causes = "; ".join(f"{found.name} {found.value:.2g}: {found.says}" for found in wrong)
        return f"Warning: the filter is not consistent ({causes})."
    if not any(found.fits for found in told if found.name != "outliers"):
        return "Whether the filter is consistent cannot be told."
    return "The filter is consistent."


def sentence_of(findings: list[Finding], table: pd.DataFrame, judge: str) -> str:
    """Return what comes of set-up, filter and errors, with warnings.

    Parameters
    ----------
    findings : list of Finding
    table : DataFrame
    judge : str
        As of `Report`.
    """
    said = [*of_set_up(findings), _of_filter(findings)]
    if judge == "nothing":
        return " ".join([*said, "How large the errors are cannot be told."])
    said += _by_truth(table) if judge == "reference" else _in_outages(table, judge)
    return " ".join(said)


def _by_truth(table: pd.DataFrame) -> list[str]:
    """Return whether the corrected track is better than the network."""
    _, low, high = _interval(table, "position")
    what = (
        "better than" if high < 1 else "worse than" if low > 1 else "neither better nor worse than"
    )
    warning = "Warning: in" if low > 1 else "In"
    said = [
        f"{warning} position the corrected track is {what} the network: it has "
        f"{_share(table, 'position')} of its error."
    ]
    if np.isfinite(_interval(table, "velocity")).all():
        said.append(f"In velocity it has {_share(table, 'velocity')}.")
    return said


def _in_outages(table: pd.DataFrame, judge: str) -> list[str]:
    """Return what is nearer to withheld fixes, which have errors of their own."""
    warning = "Warning: in" if _interval(table, "position")[1] > 1 else "In"
    return [
        f"{warning} {judge}, by the fixes that are withheld, the corrected track is "
        f"{_share(table, 'position')} as far as what goes on from the last fix, and the smoothed "
        f"one {_share(table, 'position', 'smoothed')} as far as a straight line to the next."
    ]


def _interval(table: pd.DataFrame, what: str, row: str = "corrected") -> list[float]:
    """Return the ratio of errors of a track to what it is compared with, and its interval."""
    columns = [f"{what}_{end}" for end in ("ratio", "low", "high")]
    return [float(x) for x in table.loc[[row], columns].to_numpy()[0]]


def _share(table: pd.DataFrame, what: str, row: str = "corrected") -> str:
    ratio, low, high = _interval(table, what, row)
    return f"{ratio:.0%} ({low:.0%} to {high:.0%})"
