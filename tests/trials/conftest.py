"""What trials share: how many inputs, from which seed, and where their line of figures goes.

A trial makes many inputs from a seed and counts what comes of each. Daily it makes a few; with
``INSWSN_TESTS=whole`` all. ``INSWSN_SEED`` is another seed. `make trials` keeps the lines of a
whole run in ``data/trials.json``, for the book's page on its state.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from tempfile import gettempdir

import pytest
from filelock import FileLock
from inswsn_book.record.files import write_whole

WHOLE = os.environ.get("INSWSN_TESTS") == "whole"
#: Now, since trials work in other folders
KEPT = Path(os.environ["INSWSN_TRIALS"]).absolute() if "INSWSN_TRIALS" in os.environ else None


@pytest.fixture
def size() -> Callable[[int, int], int]:
    """Return the first number, or the second if the whole is asked for."""
    return lambda daily, whole: whole if WHOLE else daily


@pytest.fixture
def seed() -> int:
    """The seed of a trial."""
    return int(os.environ.get("INSWSN_SEED", "1"))


@pytest.fixture
def tell(request: pytest.FixtureRequest, seed: int) -> Callable[[str], None]:
    """Print a trial's line of figures, and keep it where ``INSWSN_TRIALS`` says."""

    def keep(figures: str) -> None:
        name = request.path.stem.removeprefix("test_").replace("_", " ")
        if hasattr(request.node, "callspec"):
            name += f", {request.node.callspec.id}"
        print(f"{name}, seed {seed}: {figures}")
        if KEPT:
            with FileLock(Path(gettempdir()) / "inswsn-trials.lock"):
                lines = json.loads(KEPT.read_bytes()) if KEPT.is_file() else {}
                lines[name] = {
                    "figures": figures, "seed": seed, "day": f"{datetime.now(UTC):%Y-%m-%d}",
                }  # fmt: skip
                write_whole(KEPT, json.dumps(dict(sorted(lines.items())), indent=1) + "\n")

    return keep
