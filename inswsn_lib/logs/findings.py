"""What a check of a recording found, and a sentence that sums up all findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: How often a check fails on a recording that fits
FALSE_ALARM = 1e-3


@dataclass(frozen=True)
class Finding:
    """What one check found.

    Attributes
    ----------
    name : str
        What fails if it fails. Of the columns: ``rate``, ``repeats``, ``itself`` (positions against
        velocities). Of two sources: ``time``, ``clock``, ``frame``, ``axes``, ``scale``, ``run``
        (they do not go together), ``misfit`` (one of these fits better, but not well), ``origin``,
        ``copy``, ``noise``. Of the filter: ``start``, ``outliers``, ``size``, ``colour``. Those of
        a set-up are told by `check_set_up`.
    subject : str
        Of what.
    value, low, high : float
        The number, and between which it fits.
    fits : bool or None
        None where the data cannot tell.
    says : str
        In words; what a misfit points to.

    Examples
    --------
    >>> from inswsn_lib.logs import Finding
    >>> Finding("size", "innovations", 4.0, 0.9, 1.1, False, "noise figures are too small").fits
    False
    """

    name: str
    subject: str
    value: float
    low: float
    high: float
    fits: bool | None
    says: str


def judged(
    name: str, subject: str, value: float, low: float, high: float, right: str, wrong: str
) -> Finding:
    """Return whether a number is between two bounds, and what that means."""
    fits = bool(low <= value <= high)
    return Finding(name, subject, value, low, high, fits, right if fits else wrong)


def unknown(name: str, subject: str, says: str) -> Finding:
    """Return that the data cannot tell something, and why."""
    return Finding(name, subject, np.nan, np.nan, np.nan, None, says)


def verdict(findings: Sequence[Finding]) -> str:
    """Return in a sentence whether recording and figures fit by their findings, else what not.

    Examples
    --------
    >>> from inswsn_lib.logs import verdict
    >>> verdict([])
    'Recording and figures fit.'
    """
    wrong = [found for found in findings if found.fits is False]
    if wrong:
        return f"Recording and figures do not fit: {wrong[0].subject}: {wrong[0].says}."
    unknown = [f"{found.name} ({found.subject})" for found in findings if found.fits is None]
    if unknown:
        return (
            f"Nothing that does not fit was found, but the data cannot tell {', '.join(unknown)}."
        )
    return "Recording and figures fit."
