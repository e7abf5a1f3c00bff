"""Fetch what the files of `_build/live` are made from; each is known by a digest, or refused.

No package registry is named here: npm, uv and apt-get know theirs.
"""

from __future__ import annotations

import base64
import hashlib
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import urllib.request
from collections.abc import Iterable
from http.client import HTTPException
from pathlib import Path

#: Debian 12 has Python 3.11.2, whose tarfile has no filter; what is unpacked is known by digests
SAFELY = {"filter": "data"} if hasattr(tarfile, "data_filter") else {}


class LiveError(Exception):
    """What ends the work, in one sentence."""


class UnreachableError(LiveError):
    """A host cannot be reached, or does not have the file."""


def need(commands: Iterable[str], packages: str) -> None:
    """Refuse to go on without some commands; `packages` are those of Debian that have them."""
    missing = [name for name in commands if shutil.which(name) is None]
    if missing:
        words = f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
        raise LiveError(f"{words}; install what is needed: apt-get install {packages}.")


def run(words: Iterable[object], folder: Path, log: Path, what: str) -> None:
    """Run a command in a folder; what it says is kept in `log`."""
    command = [str(word) for word in words]
    with log.open("ab") as kept:
        done = subprocess.run(
            command, cwd=folder, check=False, stdout=kept, stderr=subprocess.STDOUT
        )
    if done.returncode:
        raise LiveError(f"{what}; {Path(command[0]).name} said why in {log}.")


def checked(content: bytes, digest: str, what: str) -> bytes:
    """Return the content if it has the digest, written as npm writes it: sha512-, base64."""
    kind, _, wanted = digest.partition("-")
    found = base64.b64encode(hashlib.new(kind, content).digest()).decode()
    if found != wanted:
        raise LiveError(f"{what} is refused: its digest is not the one that is pinned.")
    return content


def sha256(hexadecimal: str) -> str:
    """Return a digest in hexadecimal digits as npm writes one."""
    return "sha256-" + base64.b64encode(bytes.fromhex(hexadecimal)).decode()


def download(address: str, digest: str, what: str, seconds: float = 10) -> bytes:
    """Return what is at an address, if it has the digest."""
    try:
        with urllib.request.urlopen(address, timeout=seconds) as answer:
            content: bytes = answer.read()
    except (OSError, HTTPException) as error:  # a proxy that forbids a host is one of them
        reason = getattr(error, "reason", error)
        raise UnreachableError(f"{what} cannot be fetched ({reason})") from error
    return checked(content, digest, what)


def kept(place: Path, digest: str) -> bytes | None:
    """Return what an earlier call has fetched, unless it is another content by now."""
    try:
        return checked(place.read_bytes(), digest, place.name)
    except (OSError, LiveError):
        return None


def npm_package(name: str, version: str, digest: str, folder: Path) -> Path:
    """Fetch a package by npm; return its archive."""
    place = folder / f"{name}-{version}.tgz"
    if kept(place, digest) is None:
        need(["npm"], "npm")
        log, what = folder / "npm.log", f"npm cannot fetch {name} {version}"
        quiet = [
            "--silent",
            "--ignore-scripts",
            "--cache",
            str(folder / "npm"),
        ]  # no home is needed
        run(["npm", "pack", *quiet, f"{name}@{version}"], folder, log, what)
        checked(place.read_bytes(), digest, f"{name} {version} of npm")
    return place


def debian_package(name: str, version: str, digest: str, folder: Path) -> Path:
    """Fetch a package of Debian without installing it; return its archive."""
    place = folder / f"{name}_{version}_all.deb"
    if kept(place, digest) is None:
        need(["apt-get", "dpkg-deb"], "apt dpkg")
        log, what = folder / "apt.log", f"apt-get cannot fetch {name} {version} of Debian 12"
        run(["apt-get", "download", f"{name}={version}"], folder, log, what)
        checked(place.read_bytes(), digest, f"{name} {version} of Debian")
    return place


def locked(lock: str, name: str) -> tuple[str, list[str]]:
    """Return the version and the digests that `environment.lock` pins for a package."""
    found = re.search(rf"^{name}==(\S+) \\\n((?: +--hash=sha256:\w+.*\n)+)", lock, re.MULTILINE)
    if found is None:
        raise LiveError(f"environment.lock pins no {name} with digests.")
    return found[1], re.findall(r"sha256:(\w{64})", found[2])


def source_of(name: str, lock: str, folder: Path) -> Path:
    """Fetch the sources of a package in the version of `environment.lock`; return the archive.

    pip would run them while it fetches them, so uv says where they are.
    """
    version, digests = locked(lock, name)
    place = folder / f"{name}-{version}.tar.gz"
    if any(kept(place, sha256(digest)) for digest in digests):
        return place
    asked, told = folder / "sources.in", folder / "pylock.toml"
    asked.write_text(f"{name}=={version}\n")
    uv = sys.executable, "-m", "uv", "--no-cache", "pip", "compile", "--quiet", "--no-deps"
    words = (
        *uv,
        "--universal",
        "--python-version",
        "3.11",
        "--format",
        "pylock.toml",
        "-o",
        told,
        asked,
    )
    run(words, folder, folder / "uv.log", f"uv cannot find the sources of {name} {version}")
    source = tomllib.loads(told.read_text(encoding="utf-8"))["packages"][0]["sdist"]
    digest = source["hashes"]["sha256"]
    if digest not in digests:
        raise LiveError(
            f"The sources of {name} {version} are refused: environment.lock lacks them."
        )
    what = f"The archive of the sources of {name} {version}"
    place.write_bytes(download(source["url"], sha256(digest), what, 60))
    return place


def unpack(archive: Path, folder: Path, prefix: str = "") -> None:
    """Unpack an archive of sources, or what lies below `prefix` in it."""
    with tarfile.open(archive) as files:
        wanted = [each for each in files if each.name.startswith(prefix)]
        files.extractall(folder, wanted, **SAFELY)


def unpack_debian(archive: Path, folder: Path, prefix: str) -> None:
    """Unpack what lies below `prefix` in a package of Debian, which may hold far more."""
    words = ["dpkg-deb", "--fsys-tarfile", str(archive)]
    with (
        subprocess.Popen(words, stdout=subprocess.PIPE) as told,
        tarfile.open(fileobj=told.stdout, mode="r|") as files,
    ):
        for each in files:
            if each.name.startswith(prefix):
                files.extract(each, folder, **SAFELY)
    if told.returncode:
        raise LiveError(f"{archive.name} cannot be unpacked by dpkg-deb.")
