"""List the licences of all packages of the locks, as their metadata state them: `make licences`."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

from inswsn_book.record.files import write_whole

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "THIRD-PARTY-PACKAGES.md"
#: Of packages that are installed on other systems alone, or that state none in their metadata
BY_HAND = {
    **dict.fromkeys(("aiosignal", "frozenlist", "multidict", "propcache", "yarl"), "Apache-2.0"),
    "aiohappyeyeballs": "PSF-2.0",
    "aiohttp": "Apache-2.0 AND MIT",
    "appnope": "BSD-2-Clause",
    "axe-playwright-python": "MIT, with axe-core, MPL-2.0",
    "colorama": "BSD-3-Clause",
    "pyyaml-ft": "MIT",
}
#: What asks that changes stay under it, and what we have to say of each such package
COPYLEFT = re.compile(r"GPL|General Public|MPL|Mozilla|EPL|CDDL|EUPL")
USED = {
    "axe-playwright-python": "inspects pages, in tests alone",
    "certifi": "root certificates, read when recorded data are fetched",
    "docutils": "the GPL is that of one file for an editor, which nothing here calls",
    "hypothesis": "makes inputs, in tests alone",
    "pathspec": "read by tools for development",
    "slycot": "a reference for a Riccati equation, in tests alone; nothing else imports it",
    "tqdm": "shows progress when notebooks are executed by papermill",
}
_HEAD = """\
# What is installed

The packages that `environment.lock` and `environment-torch.lock` pin, with the licence that each
states; written by `make licences`. They are installed from the package index and are not part of
the project, nor of its wheel or its archive, but for the files of the built site that
[THIRD-PARTY.md](THIRD-PARTY.md) lists, all of them under permissive licences.

Those with a copyleft licence, none of which is shipped:

| package | licence that it states | what it is here |
|---|---|---|
"""


def names(root: Path = ROOT) -> list[str]:
    """Return the names of all packages of the locks."""
    texts = [path.read_text(encoding="utf-8") for path in sorted(root.glob("environment*.lock"))]
    return sorted(set(re.findall(r"^([A-Za-z0-9][\w.-]*)==", "\n".join(texts), re.MULTILINE)))


def licence(name: str) -> str:
    """Return the licence that a package states; empty if it states none."""
    if name in BY_HAND:
        return BY_HAND[name]
    try:
        found = metadata(name)
    except PackageNotFoundError:
        return ""
    whole = (found.get("License") or "").strip()
    short = whole if len(whole) < 60 and "\n" not in whole and whole != "UNKNOWN" else ""
    classes = [
        each.split(" :: ")[-1]
        for each in found.get_all("Classifier") or []
        if each.startswith("License :: ") and not each.endswith("OSI Approved")
    ]
    return found.get("License-Expression") or short or ", ".join(classes)


def listing() -> str:
    """Return the text of the list."""
    stated = {name: licence(name) for name in names()}
    copyleft = [name for name, said in stated.items() if COPYLEFT.search(said)]
    rows = [f"| {name} | {stated[name]} | {USED.get(name, '')} |" for name in copyleft]
    others = [f"| {name} | {said} |" for name, said in stated.items() if name not in copyleft]
    head = "\n\nThe others:\n\n| package | licence that it states |\n|---|---|\n"
    return _HEAD + "\n".join(rows) + head + "\n".join(others) + "\n"


if __name__ == "__main__":
    write_whole(LIST, listing())
