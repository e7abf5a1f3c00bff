"""Whether a damage to what is kept is noticed: a flipped byte, a cut, a deletion, of any file.

What may be damaged of a small project are its store, results, site, reference, a sweep's folder and
the unpacked archive. Noticed is what is told by `inswsn verify` or refused, and what the next build
puts right, byte for byte.
"""

from __future__ import annotations

import random
import shutil
import time
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from inswsn_book.make.archive import write_archive
from inswsn_book.make.chapters import build_book
from inswsn_book.make.verify import verify
from inswsn_book.record.progress import Quiet
from inswsn_book.record.project import Project
from inswsn_book.run.store import Request, book_runs, keep, lookup

from inswsn_lib.errors import InswsnError

SCALES = (3.0, 4.0)


@pytest.fixture
def kept(
    released_mini: Path, tmp_path: Path, inswsn: Callable[..., Any]
) -> tuple[Project, dict[str, Path]]:
    """A released project with a swept grid, and the folders that may be damaged."""
    root, archive, swept = (tmp_path / name for name in ("mini", "archive", "swept"))
    shutil.copytree(released_mini, root, symlinks=True)
    mini = Project(root)
    (plain,) = book_runs(mini)
    for scale in SCALES:  # as if they had been run
        keep(mini, Request("00", {"scale": scale}), plain)
    grid = ",".join(map(str, SCALES))
    done = inswsn(root, "sweep", "00", "--grid", f"scale={grid}", "--out", str(swept))
    assert "0 cells computed, 2 were there." in done.stdout
    with zipfile.ZipFile(write_archive(mini, tmp_path / "mini.zip")) as opened:
        opened.extractall(archive)
    folders = {
        "store": mini.store, "results": mini.results, "site": mini.site,
        "reference": mini.published, "sweep": swept, "archive": archive,
    }  # fmt: skip
    return mini, folders


def damage(path: Path, chance: random.Random) -> str:
    """Flip a bit of a file, cut it or delete it; tell which."""
    content, how = path.read_bytes(), chance.choices(["flip", "cut", "delete"], [8, 1, 1])[0]
    place = chance.randrange(len(content)) if content else 0
    if how == "delete" or not content:
        path.unlink()
    elif how == "cut":
        path.write_bytes(content[:place])
    else:
        changed = content[place] ^ 1 << chance.randrange(8)
        path.write_bytes(content[:place] + bytes([changed]) + content[place + 1 :])
    return how


def differences(folder: Path) -> list[str]:
    """Return what `inswsn verify` tells of a folder."""
    try:
        return [line for _, lines in verify(folder, [], Quiet()) for line in lines]
    except InswsnError as refusal:
        return [str(refusal)]


def noticed(mini: Project, area: str, folder: Path, path: Path, whole: bytes) -> bool:
    """Tell whether a damage is told, or put right."""
    if area == "store":
        told: list[str] = []
        requests = [Request("00"), *(Request("00", {"scale": scale}) for scale in SCALES)]
        none = [lookup(mini, request, told.append) is None for request in requests]
        return sum(none) == 1 and len(told) == path.exists()
    if area == "results":
        build_book(mini, Quiet())
        return path.read_bytes() == whole
    return bool(differences(mini.root if area in ("site", "reference") else folder))


def put_right(mini: Project, chance: random.Random) -> None:
    """Damage a page, another one and the store, and build: what is found is the same."""
    files = [path for path in mini.site.rglob("*") if path.is_file()]
    site = {path: path.read_bytes() for path in files}
    changed, gone = chance.sample(sorted(mini.site.rglob("*.html")), 2)
    changed.write_bytes(changed.read_bytes() + b"<p>More.")
    gone.unlink()
    build_book(mini, Quiet())
    assert {path: path.read_bytes() for path in files} == site
    (before,) = book_runs(mini)
    for path in (mini.store / "00").iterdir():
        damage(path, chance)
    build_book(mini, Quiet())
    (after,) = book_runs(mini)
    assert (after.results.found(), after.notebook) == (before.results.found(), before.notebook)


@pytest.mark.long
def test_damages_are_noticed(
    kept: tuple[Project, dict[str, Path]],
    size: Callable[[int, int], int],
    seed: int,
    tell: Callable[[str], None],
) -> None:
    mini, folders = kept
    chance, began, found = random.Random(seed), time.monotonic(), Counter[str]()
    assert [differences(f) for f in (mini.root, folders["sweep"], folders["archive"])] == [[]] * 3
    missed = []
    for _ in range(number := size(4, 500)):
        area = chance.choice(list(folders))
        files = sorted(path for path in folders[area].rglob("*") if path.is_file())
        path = chance.choice(files)
        whole = path.read_bytes()
        how = damage(path, chance)
        found[how] += 1
        if not noticed(mini, area, folders[area], path, whole):
            missed.append(f"{how} of {area}: {path.relative_to(folders[area])}")
        path.write_bytes(whole)
    assert missed == []
    put_right(mini, chance)
    tell(
        f"{number} of {number} damages noticed ({found['flip']} flipped bits, {found['cut']} cuts, "
        f"{found['delete']} deletions) in store, results, site, reference, the folder of a sweep "
        f"and an archive, in {time.monotonic() - began:.0f} s"
    )
