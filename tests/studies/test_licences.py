"""The list of licences has all packages of the locks, and what is copyleft is not shipped."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

import licences
import pytest
from inswsn_book.make.archive import SITE_PACKAGES
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


@pytest.fixture(scope="module")
def rows(root: Path) -> dict[str, str]:
    text = (root / licences.LIST.name).read_text(encoding="utf-8")
    found = re.findall(r"^\| (\S+) \| (.+?) \|", text, re.MULTILINE)
    return {name: said for name, said in found if name != "package"}


def test_each_package_of_the_locks_has_a_licence(root: Path, rows: dict[str, str]) -> None:
    listed = "after a change of the locks: make licences"
    assert sorted(rows) == licences.names(root), listed
    for name in ("numpy", "torch", "colorama", "slycot"):  # of both locks, and of other systems
        assert name in rows
    assert [name for name, said in rows.items() if not said.strip()] == []


def test_what_is_copyleft_is_named_with_its_use(rows: dict[str, str]) -> None:
    """By what the installed packages say now."""
    stated = {name: licences.licence(name) or rows[name] for name in rows}
    assert {name for name in rows if licences.COPYLEFT.search(stated[name])} == set(licences.USED)
    assert {name for name in rows if licences.COPYLEFT.search(rows[name])} == set(licences.USED)
    for name in ("GPL-3.0-only", "LGPLv2", "GNU General Public License", "MPL-2.0", "AGPL-3.0"):
        assert licences.COPYLEFT.search(name)
    assert not licences.COPYLEFT.search("BSD-3-Clause AND MIT AND Apache-2.0")


def needed(name: str, known: set[str]) -> set[str]:
    """Return a package and all that it asks for in this environment."""
    if canonicalize_name(name) in known:
        return known
    known.add(canonicalize_name(name))
    try:
        asked = map(Requirement, requires(name) or ())
    except PackageNotFoundError:
        return known
    for each in asked:
        if each.marker is None or each.marker.evaluate({"extra": ""}):
            needed(each.name, known)
    return known


def test_nothing_copyleft_is_shipped_and_nothing_under_the_gpl_is_needed(root: Path) -> None:
    assert not set(SITE_PACKAGES) & set(licences.USED)
    everything: set[str] = set()
    for name in ("inswsn", "inswsn-book", "jupyter-book", "torch", *SITE_PACKAGES):
        needed(name, everything)
    assert {"numpy", "sphinx", "certifi", "sympy"} <= everything
    gpl = {name for name in licences.USED if "GPL" in licences.licence(name)}
    assert gpl & everything == {"docutils"}  # the GPL is that of one file for an editor
    importing = [
        path
        for folder in ("inswsn_lib", "book", "chapters", "studies", "benchmarks")
        for path in (root / folder).rglob("*")
        if path.suffix in (".py", ".md", ".ipynb") and "import slycot" in path.read_text("utf-8")
    ]
    assert importing == []
