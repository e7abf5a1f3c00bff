"""The lock fits what asks for it: nothing is missing, nothing lies outside its bounds."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PIN = re.compile(r"^([A-Za-z0-9][\w.-]*)==([^\s;\\]+)(.*)$", re.MULTILINE)


def pins(lock: Path) -> dict[str, str]:
    text = lock.read_text(encoding="utf-8")
    return {canonicalize_name(name): version for name, version, _ in PIN.findall(text)}


def asked(root: Path) -> Iterator[Requirement]:
    for line in (root / "environment.in").read_text(encoding="utf-8").splitlines():
        if text := line.split("#", 1)[0].strip():
            yield Requirement(text)
    for name in ("pyproject.toml", "book/pyproject.toml"):
        project = tomllib.loads((root / name).read_text(encoding="utf-8"))["project"]
        yield from map(Requirement, project["dependencies"])


def problems(requirements: Iterator[Requirement], pinned: dict[str, str]) -> list[str]:
    found = []
    for requirement in requirements:
        version = pinned.get(canonicalize_name(requirement.name))
        if requirement.name == "inswsn":  # the checkout itself
            continue
        if version is None or not requirement.specifier.contains(version, prereleases=True):
            found.append(f"{requirement}: the lock has {version}")
    return found


def test_the_lock_has_all_that_is_asked_for(root: Path) -> None:
    assert problems(asked(root), pins(root / "environment.lock")) == []


def test_a_lock_that_does_not_fit_is_found() -> None:
    wanted = [Requirement("numpy>=2"), Requirement("scipy"), Requirement("click<9")]
    found = problems(iter(wanted), {"numpy": "1.9", "click": "8.2"})
    assert [line.partition(":")[0] for line in found] == ["numpy>=2", "scipy"]


@pytest.mark.parametrize("name", ["environment.lock", "environment-torch.lock"])
def test_every_pin_has_a_hash(root: Path, name: str) -> None:
    text = (root / name).read_text(encoding="utf-8")
    assert [pin for pin, _, rest in PIN.findall(text) if not rest.endswith("\\")] == []


def test_the_versions_agree(root: Path) -> None:
    from inswsn_book.project import Project

    version = tomllib.loads((root / "pyproject.toml").read_text())["project"]["version"]
    assert Project(root).about()["version"] == version
