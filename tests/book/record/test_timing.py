"""What the time of a run goes into, by function."""

from __future__ import annotations

import time

from inswsn_book.record.timing import Sampler, slowest
from made_results import quantity, results
from test_results import PROVENANCE

BUSY = """
def busy(seconds):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        sum(range(1000))
"""


def test_time_counts_for_the_innermost_function_of_ours() -> None:
    ours = {"__name__": "inswsn_lib.busy", "time": time}
    exec(BUSY, ours)
    sampler = Sampler()
    ours["busy"](0.6)  # type: ignore[operator]
    time.sleep(0.3)  # of no function of ours
    took = sampler.end()
    assert took.keys() == {"inswsn_lib.busy.busy"}
    assert took["inswsn_lib.busy.busy"] > 0.3


def test_the_slowest_are_those_of_all_chapters_together() -> None:
    def of(chapter: str, **functions: float):  # type: ignore[no-untyped-def]
        made = PROVENANCE.model_copy(update={"functions": functions})
        return results(quantity(), chapter=chapter, provenance=made)

    found = slowest([of("00", a=1.0, b=5.0), of("01", a=6.0, c=2.0), results(chapter="02")], 2)
    assert [tuple(each) for each in found] == [("a", 7.0, ["01", "00"]), ("b", 5.0, ["00"])]
