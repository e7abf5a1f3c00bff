"""The time that each function of a chapter takes, by looking at its thread now and then."""

from __future__ import annotations

import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from inswsn_book.record.results import Results

_EVERY = 0.02  # s: less than a hundredth of a run goes into looking
_PACKAGES = ("inswsn_lib", "inswsn_book")
_ON_BEHALF = "inswsn_lib.kernels.choice"  # it calls a kernel, compiled or not, for whoever asks
#: How many functions a run keeps
KEPT = 20


class Sampler:
    """Looks at the thread that made it; what runs counts for the innermost function of ours.

    What numpy or a compiled kernel does counts for the function that calls it.
    """

    def __init__(self) -> None:
        self._seen: defaultdict[str, float] = defaultdict(float)
        self._ended = threading.Event()
        self._watched = threading.get_ident()
        threading.Thread(target=self._look, daemon=True).start()

    def _look(self) -> None:
        last = time.monotonic()
        while not self._ended.wait(_EVERY):
            frame, now = sys._current_frames().get(self._watched), time.monotonic()
            while frame is not None:
                module = frame.f_globals.get("__name__", "")
                if module.partition(".")[0] in _PACKAGES and module != _ON_BEHALF:
                    self._seen[f"{module}.{frame.f_code.co_qualname}"] += now - last
                    break
                frame = frame.f_back
            last = now

    def end(self) -> dict[str, float]:
        """Look no more; return the seconds of the functions that took most."""
        self._ended.set()
        longest = sorted(self._seen.items(), key=lambda seen: seen[1], reverse=True)
        return {name: round(taken, 2) for name, taken in longest[:KEPT]}


class Slow(NamedTuple):
    """A function, the seconds that it takes in all chapters, and the chapters, longest first."""

    name: str
    seconds: float
    chapters: Sequence[str]


def slowest(results: Iterable[Results], number: int = 10) -> list[Slow]:
    """Return the functions that take most of the time of some runs, longest first."""
    taken = defaultdict[str, dict[str, float]](dict)
    for each in results:
        for name, seconds in (each.provenance.functions if each.provenance else {}).items():
            taken[name][each.chapter] = seconds
    found = [
        Slow(name, sum(of.values()), sorted(of, key=lambda chapter: of[chapter], reverse=True))
        for name, of in taken.items()
    ]
    return sorted(found, key=lambda slow: slow.seconds, reverse=True)[:number]
