"""Make `_build/live`: the files by which Python with numpy runs in the reader's page, no server.

They are Pyodide's core, from npm, and numpy for it in a zip file. Where the network has it, that is
the wheel of a release of Pyodide; else numpy is built from its sources, for an older Pyodide, by
clang. Each thing that is fetched is known by a digest. `live.json` says what the files are.
A second call does nothing while neither this nor the files have changed.
"""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import io
import json
import os
import re
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import distribution
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import wasm_numpy
from wasm_fetch import LiveError, UnreachableError, download, locked, npm_package, sha256, unpack

CORE = "pyodide.js", "pyodide.asm.js", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json"


class Release(NamedTuple):
    """A Pyodide as npm has it."""

    version: str
    digest: str


#: The newest that starts in a classic worker, with numpy 2; and one whose Python is that of the
#: environment, with whose headers numpy is built
RELEASE = {
    "official": Release(
        "0.29.5",
        "sha512-TkYrUv9m8QmfImADKRmpwZulL48E0uUaBSO+dvRQKyAJc0qh9gu7jn8btyHPh3NZm1r2IH2YrJhIr7Q2B9urAw==",
    ),
    "built": Release(
        "0.25.1",
        "sha512-y0nJ/fLA3bxD2iZRzvVTbP2O+wp4Ewm2wThfV4HF0BytQ6hsoqTJFLNY4usLOcCVBrK8TTWqFqrmsVPzHe4rsw==",
    ),
}
#: Where the wheels of a release are, by the names and digests in its pyodide-lock.json
WHEELS = "https://cdn.jsdelivr.net/pyodide/v{version}/full/"
#: A reader waits for all of it, once
LIMIT = 20_000_000
#: What no page needs: tests, and what other code is compiled with
LEFT_OUT = re.compile(
    r"/(tests|f2py|distutils|_core/include|_core/lib|random/lib|_examples|_pyinstaller)/"
    r"|\.(pyi|pyc|pxd|pyx|h|c|a)$|/(conftest|_configtool|setup)\.py$|/py\.typed$|_tests\.|/_simd\."
)
#: Whose licence texts stand for Pyodide and for Python, in whose packages none is
LICENCES = {"LICENSE-pyodide.txt": "pathspec", "LICENSE-python.txt": "typing-extensions"}


def main() -> None:
    """Make the files, unless they are there."""
    parser = argparse.ArgumentParser(description="Make the files of Python in the page.")
    parser.add_argument("--source", choices=RELEASE, help="of numpy; both are tried without it")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    said = parser.parse_args()
    root = Path(__file__).resolve().parents[1]
    live, work = root / "_build/live", root / "_build/wasm"
    work.mkdir(parents=True, exist_ok=True)
    with (work / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # two calls at once
        digest = made_from(root)
        if not is_made(live, digest, said.source):
            about = make(live, work, digest, said.source, makers(work, root, said.jobs))
            size = sum(file["bytes"] for file in about["files"].values()) / 1e6
            what = f"Pyodide {about['pyodide']}, numpy {about['numpy']} ({about['source']})"
            print(f"{live.relative_to(root)}: {what}, {size:.1f} MB")


def made_from(root: Path) -> str:
    """Return the digest of what decides the files."""
    pinned = locked((root / "environment.lock").read_text(encoding="utf-8"), "numpy")
    files = [path.read_bytes() for path in sorted((root / ".ci").glob("wasm*")) if path.is_file()]
    return hashlib.sha256(b"\0".join([repr(pinned).encode(), *files])).hexdigest()


def is_made(live: Path, digest: str, source: str | None) -> bool:
    """Tell whether the files are there as they were made, of a source that is wanted."""
    try:
        about = json.loads((live / "live.json").read_text(encoding="utf-8"))
        same = about["made_from"] == digest and source in (None, about["source"])
        return bool(same and about["files"] == described(live))
    except (OSError, ValueError, KeyError, TypeError):
        return False


def described(folder: Path) -> dict[str, dict[str, Any]]:
    """Return digest and size of each file of a folder, but for the one that lists them."""
    return {
        path.name: {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
        for path in sorted(folder.iterdir())
        if path.name != "live.json"
        for content in [path.read_bytes()]
    }


#: Puts core and numpy into a folder, and returns the version of numpy
Maker = Callable[[Path], str]


def makers(work: Path, root: Path, jobs: int) -> dict[str, Maker]:
    """Return the sources of numpy, in the order in which they are tried."""
    fetched = work / "fetched"
    fetched.mkdir(exist_ok=True)

    def official(folder: Path) -> str:
        release = RELEASE["official"]
        write_core(npm_package("pyodide", *release, fetched), folder)
        return write_official(folder, WHEELS.format(version=release.version))

    def built(folder: Path) -> str:
        write_core(npm_package("pyodide", *RELEASE["built"], fetched), folder)
        building = work / "build"
        shutil.rmtree(building, ignore_errors=True)
        building.mkdir()
        print("Building numpy for Pyodide from its sources (ten minutes or more, once)", flush=True)
        packages = wasm_numpy.build(folder, fetched, building, root, jobs)
        files = {
            str(p.relative_to(packages)): p.read_bytes() for p in packages.rglob("*") if p.is_file()
        }
        version = write_numpy(files, folder)
        shutil.rmtree(building)  # its log is wanted after a failure alone
        return version

    return {"official": official, "built": built}


def make(
    live: Path, work: Path, digest: str, source: str | None, makers: Mapping[str, Maker]
) -> dict[str, Any]:
    """Make the folder `live` from one source, or from the first that can be reached."""
    *first, last = [source] if source else makers
    for name in first:
        try:
            return make_from(name, makers[name], live, work, digest)
        except UnreachableError as reason:
            print(f"{reason}; the next source is tried.", flush=True)
    return make_from(last, makers[last], live, work, digest)


def make_from(source: str, maker: Maker, live: Path, work: Path, digest: str) -> dict[str, Any]:
    """Make the folder in another place and rename it, so that what is there is whole."""
    new, old = work / "live", work / "replaced"
    for left in (new, old):  # by one that was killed
        shutil.rmtree(left, ignore_errors=True)
    new.mkdir()
    try:
        about = describe(new, digest, source, maker(new))
        if live.exists():
            live.rename(old)
        new.rename(live)
    finally:
        for left in (new, old):
            shutil.rmtree(left, ignore_errors=True)
    return about


def describe(folder: Path, digest: str, source: str, numpy: str) -> dict[str, Any]:
    """Add licences and `live.json` to the files, and return what it says."""
    for name, package in LICENCES.items():
        (folder / name).write_bytes(licence_of(package))
    lock = json.loads((folder / "pyodide-lock.json").read_text(encoding="utf-8"))
    python = lock["info"]["python"]
    files = described(folder)
    size = sum(file["bytes"] for file in files.values())
    if size > LIMIT:
        raise LiveError(f"The files have {size / 1e6:.1f} MB; {LIMIT / 1e6:.0f} MB are allowed.")
    about = {
        "source": source,
        "pyodide": RELEASE[source].version,
        "python": python,
        "numpy": numpy,
        "site_packages": f"/lib/python{python.rpartition('.')[0]}/site-packages",
        "files": files,
        "made_from": digest,
    }
    (folder / "live.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    return about


def licence_of(package: str) -> bytes:
    """Return the licence text of a package of the environment."""
    files = distribution(package).files or []
    return next(Path(str(f.locate())).read_bytes() for f in files if f.name.startswith("LICENSE"))


def write_core(archive: Path, folder: Path) -> None:
    """Put the core of Pyodide into a folder, without what a page does not load."""
    unpack(archive, folder, "package/")
    for name in CORE:
        (folder / "package" / name).rename(folder / name)
    shutil.rmtree(folder / "package")


def write_official(folder: Path, wheels: str) -> str:
    """Fetch the numpy of the Pyodide that is in a folder, put it there and return its version."""
    lock = json.loads((folder / "pyodide-lock.json").read_text(encoding="utf-8"))
    numpy = lock["packages"]["numpy"]
    what = f"The numpy {numpy['version']} of Pyodide"
    content = download(wheels + numpy["file_name"], sha256(numpy["sha256"]), what)
    with ZipFile(io.BytesIO(content)) as wheel:
        return write_numpy({name: wheel.read(name) for name in wheel.namelist()}, folder)


def write_numpy(files: Mapping[str, bytes], folder: Path) -> str:
    """Write `numpy.zip`, the same for the same files, and return the version of numpy."""
    wanted = dict(needed(files))
    with ZipFile(folder / "numpy.zip", "w", ZIP_DEFLATED, compresslevel=9) as made:
        for name, content in sorted(wanted.items()):
            made.writestr(ZipInfo(name), content, ZIP_DEFLATED, 9)
    (version,) = {name[6:].split(".dist-info")[0] for name in wanted if name.startswith("numpy-")}
    return version


def needed(files: Mapping[str, bytes]) -> Iterator[tuple[str, bytes]]:
    """Give the files of numpy that pages need, and of what describes it the licences."""
    for name, content in files.items():
        top, _, rest = name.partition("/")
        if top == "numpy":
            if rest and not name.endswith("/") and not LEFT_OUT.search(name):
                yield name, content
        elif top.endswith(".dist-info") and re.match(r"(METADATA$|licen[cs]e)", rest, re.I):
            yield name, content


def stop(number: int, _: object) -> NoReturn:
    """End, and remove what is half made."""
    sys.exit(128 + number)


if __name__ == "__main__":
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(130)
    except (LiveError, OSError) as error:
        print(error, file=sys.stderr)
        sys.exit(2)
