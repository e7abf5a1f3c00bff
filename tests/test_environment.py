"""The lock fits what asks for it: nothing is missing, nothing lies outside its bounds."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PIN = re.compile(r"^([A-Za-z0-9][\w.-]*)==([^\s;\\]+)(.*)$", re.MULTILINE)


def asked(root: Path) -> Iterator[Requirement]:
    for line in (root / "environment.in").read_text(encoding="utf-8").splitlines():
        if text := line.split("#", 1)[0].strip():
            yield Requirement(text)
    for name in ("pyproject.toml", "book/pyproject.toml"):
        project = tomllib.loads((root / name).read_text(encoding="utf-8"))["project"]
        yield from map(Requirement, project["dependencies"])


def problems(requirements: Iterable[Requirement], lock: str) -> list[str]:
    pinned = {canonicalize_name(name): version for name, version, _ in PIN.findall(lock)}
    found = {r.name: (r, pinned.get(canonicalize_name(r.name))) for r in requirements}
    found.pop("inswsn", None)  # the checkout itself
    return [
        name
        for name, (requirement, version) in found.items()
        if version is None or not requirement.specifier.contains(version, prereleases=True)
    ]


def test_the_lock_has_all_that_is_asked_for(root: Path) -> None:
    assert problems(asked(root), (root / "environment.lock").read_text(encoding="utf-8")) == []
    wanted = [Requirement("numpy>=2"), Requirement("scipy"), Requirement("click<9")]
    assert problems(wanted, "numpy==1.9 \\\nclick==8.2 \\\n") == ["numpy", "scipy"]


@pytest.mark.parametrize("name", ["environment.lock", "environment-torch.lock"])
def test_every_pin_has_a_hash(root: Path, name: str) -> None:
    pins = PIN.findall((root / name).read_text(encoding="utf-8"))
    assert pins
    assert [pin for pin, _, rest in pins if not rest.endswith("\\")] == []
