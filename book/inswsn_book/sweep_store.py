"""What a sweep has computed, in one file that survives whatever ends the command.

The file is a database of SQLite. A task is stored in one transaction, and its parts have a key of
cell and group: so after a power cut or a kill -9 a group of runs is there once, or not at all.
"""

from __future__ import annotations

import json
import os
import re
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

from filelock import FileLock, Timeout

from inswsn_lib.errors import BuildError, InswsnError, ParameterError

STORE = "sweep.sqlite"
_LOCK = ".lock"
#: All files that a sweep writes to its folder
MADE = frozenset(
    {STORE, *(f"{STORE}-{kind}" for kind in ("journal", "wal", "shm")), _LOCK}
    | {f"sweep.{kind}" for kind in ("csv", "svg", "json")}
    | {"failed.csv"}
)
# what `inswsn_book.files.write_whole` writes to until the file is whole; a kill -9 leaves it
_UNFINISHED = re.compile(r"\.(sweep\.(csv|svg|json)|failed\.csv)\.[a-z0-9_]{8}")

#: Raised when the tables, or what is in them, change their form
FORM = "1"
_TABLES = """
CREATE TABLE made_from (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE done (cell INTEGER, part INTEGER, content BLOB NOT NULL, PRIMARY KEY (cell, part));
CREATE TABLE failed (cell INTEGER PRIMARY KEY, reason TEXT NOT NULL);
CREATE TABLE computed_by (number INTEGER PRIMARY KEY, who TEXT NOT NULL UNIQUE);
"""


class Store:
    """The finished groups of runs of a sweep, held by one command at a time.

    Parameters
    ----------
    folder : Path
        New, empty, or with an earlier sweep in it.
    made_from : mapping of str to str
        What the numbers depend on, by a name that a user understands. A store of something else is
        refused.
    fresh : bool
        Begin anew, whatever is there.

    Raises
    ------
    ParameterError
        If the folder holds something else, or nobody may write there.
    InswsnError
        If another sweep runs in the folder, the store is of something else, or cannot be read.
    """

    def __init__(self, folder: Path, made_from: Mapping[str, str], *, fresh: bool = False) -> None:
        check_folder(folder)
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder.resolve()
        self._lock = FileLock(self.folder / _LOCK)
        try:
            self._lock.acquire(timeout=0)
        except Timeout:
            raise InswsnError(
                f"Another sweep is running in {folder}; wait for it, or give another --out."
            ) from None
        try:
            for path in self.folder.iterdir():
                if _UNFINISHED.fullmatch(path.name):
                    path.unlink(missing_ok=True)
            if fresh:
                for name in MADE - {_LOCK}:
                    (self.folder / name).unlink(missing_ok=True)
            self._base = self._opened(made_from)
        except BaseException:
            self._lock.release()
            raise

    def _opened(self, made_from: Mapping[str, str]) -> sqlite3.Connection:
        # each statement is a transaction, but for those in a block of their own
        with _told():
            base = sqlite3.connect(self.folder / STORE, isolation_level=None)
        try:
            base.execute("PRAGMA synchronous = FULL")  # a commit is on the disk when it returns
            if not base.execute("SELECT 1 FROM sqlite_master").fetchone():
                with base:
                    base.execute("BEGIN")
                    for statement in _TABLES.split(";"):
                        base.execute(statement)
                    base.executemany("INSERT INTO made_from VALUES (?, ?)", made_from.items())
            held = dict(base.execute("SELECT name, value FROM made_from"))
            other = sorted(
                name for name in {*held, *made_from} if held.get(name) != made_from.get(name)
            )
        except sqlite3.DatabaseError as error:
            base.close()
            # an error of the statements says that the database is another one; all other errors of
            # its operation, such as a full disk, say nothing of what is in it
            if (
                isinstance(error, sqlite3.OperationalError)
                and error.sqlite_errorcode != sqlite3.SQLITE_ERROR
            ):
                raise _interrupted(error) from None
            raise InswsnError(
                f"{self.folder / STORE} is not the store of a sweep ({error}); give another --out, "
                "or --fresh to begin anew."
            ) from None
        if other:
            base.close()
            raise InswsnError(
                f"{self.folder} holds a sweep that was made with another "
                f"{' and another '.join(other)}; give another --out, or --fresh to drop it and "
                "begin anew."
            )
        return base

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._base.close()
        self._lock.release()

    def done(self) -> dict[int, set[int]]:
        """Return the parts that are there, by cell."""
        found: dict[int, set[int]] = {}
        with _told():
            for cell, part in self._base.execute("SELECT cell, part FROM done"):
                found.setdefault(cell, set()).add(part)
        return found

    def add(self, parts: Iterable[tuple[int, int, bytes]]) -> None:
        """Store parts, (cell, part, content), all or none.

        Raises
        ------
        sqlite3.IntegrityError
            If one is there already: nothing is counted twice.
        BuildError
            If it cannot be written, such as on a full disk.
        """
        with _told(), self._base:
            self._base.execute("BEGIN")
            self._base.executemany("INSERT INTO done VALUES (?, ?, ?)", parts)

    def read(self, cell: int, parts: int) -> list[bytes]:
        """Return the first parts of a cell, in order."""
        with _told():
            rows = self._base.execute(
                "SELECT content FROM done WHERE cell = ? AND part < ? ORDER BY part", (cell, parts)
            )
            return [content for (content,) in rows]

    def note(self, who: str) -> None:
        """Note who is about to compute."""
        with _told():
            self._base.execute("INSERT OR IGNORE INTO computed_by (who) VALUES (?)", (who,))

    def computed_by(self) -> list[str]:
        """Return who has computed, in any call, in order."""
        with _told():
            return [
                who for (who,) in self._base.execute("SELECT who FROM computed_by ORDER BY number")
            ]

    def fail(self, cell: int, reason: str) -> None:
        """Note why a cell has failed."""
        with _told():
            self._base.execute("INSERT OR REPLACE INTO failed VALUES (?, ?)", (cell, reason))

    def forget_failures(self) -> None:
        """Forget which cells have failed, since they are about to be tried again."""
        with _told():
            self._base.execute("DELETE FROM failed")

    def failed(self) -> dict[int, str]:
        """Return why cells have failed, by cell."""
        with _told():
            return dict(self._base.execute("SELECT cell, reason FROM failed ORDER BY cell"))


def _interrupted(error: sqlite3.OperationalError) -> BuildError:
    return BuildError(f"{STORE}: {error}; what is finished is kept.")


@contextmanager
def _told() -> Iterator[None]:
    """Tell in a sentence why the store cannot be read or written now."""
    try:
        yield
    except sqlite3.OperationalError as error:
        raise _interrupted(error) from None


def check_folder(folder: Path) -> None:
    """Refuse a folder that holds anything but a sweep, or where nobody may write.

    Raises
    ------
    ParameterError
        If it is one.
    """
    held = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    if (folder.exists() and not folder.is_dir()) or not all(
        name in MADE or _UNFINISHED.fullmatch(name) for name in held
    ):
        raise ParameterError(
            "--out", str(folder), "a new or empty folder, or one that holds an earlier sweep alone"
        )
    above = next(path for path in (folder.resolve(), *folder.resolve().parents) if path.exists())
    if not above.is_dir() or not os.access(above, os.W_OK):
        raise ParameterError("--out", str(folder), f"where one can write, and {above} is not")


def as_text(facts: object) -> str:
    """Return facts as one line that is the same whenever they are."""
    return json.dumps(facts, sort_keys=True)
