"""The book as `make serve LIVE=1` serves it, in a thread of the tests, on any free port."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from inswsn_book.live.serve import Served, serve
from inswsn_book.project import Project


@contextmanager
def serving(project: Project) -> Iterator[Served]:
    """Serve a project until the end of the block."""
    begun: list[Served] = []
    loop, stop, ready = asyncio.new_event_loop(), asyncio.Event(), threading.Event()

    def tell(served: Served) -> None:
        begun.append(served)
        ready.set()

    thread = threading.Thread(
        target=loop.run_until_complete, args=[serve(project, 0, stop, tell)], daemon=True
    )
    thread.start()
    assert ready.wait(600)
    yield begun[0]
    loop.call_soon_threadsafe(stop.set)
    thread.join(600)
    assert not thread.is_alive()
    loop.close()
