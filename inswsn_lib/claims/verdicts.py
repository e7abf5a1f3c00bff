"""Verdicts: computed from results by a stated rule, never typed."""

from __future__ import annotations

from enum import StrEnum


class Verdict(StrEnum):
    """What became of a claim."""

    REPRODUCED = "reproduced"
    ASSUMED = "reproduced under a stated assumption"
    NOT_REPRODUCED = "not reproduced"
    CONTRADICTED = "contradicted by the paper itself"
    NOT_DECIDED = "not decided"
    UNTESTABLE = "cannot be tested"


def judge_own_cells(rebuilt: tuple[float, float], published: tuple[float, float]) -> Verdict:
    """Judge a statement that a paper derives from its own printed numbers.

    Parameters
    ----------
    rebuilt : tuple of two floats
        Lower and upper end of what the printed numbers, within their rounding, give.
    published : tuple of two floats
        Lower and upper end of what the printed statement stands for.

    Returns
    -------
    Verdict
        Reproduced if the two intervals have a value in common, else contradicted by the paper
        itself.
    """
    # an end that is not a number compares as false, and then nothing is reproduced
    meets = rebuilt[0] <= rebuilt[1] >= published[0] <= published[1] >= rebuilt[0]
    return Verdict.REPRODUCED if meets else Verdict.CONTRADICTED
