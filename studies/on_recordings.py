"""Run the filters on the recordings of recorded-data and keep what comes out: `make studies`.

Evidence recorded-data runs the same where all recordings are there; else it shows what
this script kept in data/recorded/on-recordings.json, and says so. The recordings are fetched, or
come from the mirror that INSWSN_DATA names.
"""

from __future__ import annotations

import datetime
from pathlib import Path

from inswsn_book.record.files import write_whole
from inswsn_book.record.provenance import repository_state

from inswsn_lib import logs
from inswsn_lib.navigation import RecordedStudy, write_tables

ROOT = Path(__file__).parent.parent


def main() -> None:
    """Run and write."""
    study = RecordedStudy()
    commit, clean = repository_state(ROOT)
    text = write_tables(
        study.tables(),
        made=datetime.datetime.now(datetime.UTC).date().isoformat(),
        commit=commit,
        clean=clean,
        digests={name: dict(logs.load(name).digests) for name in logs.names()},
    )
    write_whole(ROOT / "data/recorded/on-recordings.json", text)


if __name__ == "__main__":
    main()
