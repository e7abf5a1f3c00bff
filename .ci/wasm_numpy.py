"""Build numpy for Pyodide from its sources, by clang, where the wheel of Pyodide is out of reach.

Emscripten's compiler is not needed. clang makes WebAssembly by itself; of Emscripten it takes the
headers of its C and C++ libraries, which Debian has. What they and the sources ask for at run time
is in Pyodide, and at the end all that the built libraries ask for is compared with what is there.
The build holds for one Pyodide: the one that `RELEASE` of `wasm.py` names for it.

WebAssembly keeps no account of errors of floating point, whoever builds numpy: no warning is given
of a division by zero, and `numpy.linalg.inv` of a singular matrix returns without a `LinAlgError`.
"""

from __future__ import annotations

import os
import shutil
import sys
import sysconfig
from pathlib import Path
from typing import Any
from zipfile import ZipFile

from wasm_fetch import (
    LiveError,
    debian_package,
    need,
    run,
    sha256,
    source_of,
    unpack,
    unpack_debian,
)
from wasm_module import misfits, read

COMMANDS = "clang-16", "clang++-16", "wasm-ld-16", "llvm-ar-16"
PACKAGES = "clang-16 lld-16 llvm-16"
EMSCRIPTEN = (
    "emscripten",
    "3.1.6~dfsg-5",
    sha256("43742f32443a7a5510f6c5d1d2603f07c0ff555b3464f2438ab7ba7fdc85c8fd"),
)
_SYSROOT = "./usr/share/emscripten/cache/sysroot/"
#: The version of Emscripten that made Pyodide 0.25.1, which the headers of 3.1.6 have to serve
_EMSCRIPTEN = 3, 1, 46
#: Templates of C++ are compiled where they are used, since those of another version are in Pyodide
_SETTINGS = """\
[constants]
flags = {flags}
[binaries]
c = ['clang-16'] + flags
cpp = ['clang++-16'] + flags + ['-D_LIBCPP_DISABLE_EXTERN_TEMPLATE']
ar = 'llvm-ar-16'
strip = 'true'
cython = '{tools}/cython'
python = '{tools}/python'
[host_machine]
system = 'emscripten'
cpu_family = 'wasm32'
cpu = 'wasm32'
endian = 'little'
[properties]
skip_sanity_check = true
needs_exe_wrapper = true
longdouble_format = 'IEEE_QUAD_LE'
"""


def build(core: Path, fetched: Path, work: Path, root: Path, jobs: int) -> Path:
    """Build numpy for the Pyodide whose files are in `core`; return its site-packages.

    What is fetched stays in `fetched`; all else is made in `work`.
    """
    need(COMMANDS, PACKAGES)
    log = work / "build.log"
    settings = work / "pyodide.ini"
    tools = _tools(work, root, log)
    source = _sources(fetched, work, root)
    flags = _flags(_headers(fetched, work), _python_headers(core, work), root)
    settings.write_text(_SETTINGS.format(flags=flags, tools=tools))
    exports = read((core / "pyodide.asm.wasm").read_bytes()).exports
    listed = work / "exports.txt"
    listed.write_text("\n".join(exports))
    os.environ["PYODIDE_EXPORTS"] = str(listed)
    os.environ["PATH"] = f"{tools}{os.pathsep}{os.environ['PATH']}"
    meson = tools / "python", source / "vendored-meson/meson/meson.py"
    choices = "-Dbuildtype=release", "-Db_ndebug=true", "-Dblas=none", "-Dlapack=none"
    failed = "numpy could not be built for Pyodide"
    words: tuple[object, ...] = *meson, "setup", "made", source, "--cross-file", settings
    run([*words, "--prefix=/", *choices], work, log, failed)
    run([tools / "ninja", "-C", "made", "-j", jobs], work, log, failed)
    words = *meson, "install", "-C", "made", "--no-rebuild", "--quiet"
    tags = "--tags=runtime,python-runtime"
    run([*words, tags, f"--destdir={work / 'installed'}"], work, log, failed)
    return _finished(work, source, core, root)


def _tools(work: Path, root: Path, log: Path) -> Path:
    """Install what `.ci/wasm.txt` pins; return the folder of its commands."""
    python = getattr(sys, "_base_executable", sys.executable)
    run([python, "-m", "venv", "tools"], work, log, "No environment could be made")
    pip = work / "tools/bin/python", "-m", "pip", "install", "--quiet", "--no-deps"
    words = *pip, "--disable-pip-version-check", "--require-hashes", "-r", root / ".ci/wasm.txt"
    run(words, work, log, "What .ci/wasm.txt pins could not be installed")
    return work / "tools/bin"


def _sources(fetched: Path, work: Path, root: Path) -> Path:
    """Unpack the sources of numpy; return their folder."""
    lock = (root / "environment.lock").read_text(encoding="utf-8")
    archive = source_of("numpy", lock, fetched)
    unpack(archive, work)
    return work / archive.name.removesuffix(".tar.gz")


def _headers(fetched: Path, work: Path) -> Path:
    """Unpack the headers of C and C++; return the folder that clang finds them below.

    Times had 32 bits in that version of Emscripten; they have 64 in the one of Pyodide.
    """
    unpack_debian(debian_package(*EMSCRIPTEN, fetched), work, f"{_SYSROOT}include/")
    found = work / _SYSROOT
    types = found / "include/bits/alltypes.h"
    text = types.read_text(encoding="utf-8")
    short, long = "typedef long time_t;", "typedef _Int64 time_t;"
    if text.count(short) != 1:
        raise LiveError("The headers of Emscripten are not those that this build knows.")
    types.write_text(text.replace(short, long), encoding="utf-8")
    return found


def _python_headers(core: Path, work: Path) -> Path:
    """Copy Python's headers, with the numbers of Pyodide in the one that depends on the machine."""
    own, made = Path(sysconfig.get_path("include")), work / "python"
    if not (own / "Python.h").exists():
        raise LiveError(
            "Python's headers are missing; install them: apt-get install python3.11-dev."
        )
    shutil.copytree(own, made)
    known = pyodide_settings(core)
    with (own / "pyconfig.h").open(encoding="utf-8") as stream:
        names = sysconfig.parse_config_h(stream)
    lines = [f"#define {n} {known[n]}\n" for n in names if known.get(n) and _is_number(known[n])]
    (made / "pyconfig.h").write_text("".join(lines))
    return made


def pyodide_settings(core: Path) -> dict[str, Any]:
    """Return what Pyodide's Python was built with, which its standard library keeps."""
    known: dict[str, Any] = {}
    with ZipFile(core / "python_stdlib.zip") as files:
        names = [name for name in files.namelist() if name.startswith("_sysconfigdata_")]
        exec(files.read(names[0]), known)
    settings: dict[str, Any] = known["build_time_vars"]
    return settings


def _is_number(value: object) -> bool:
    return isinstance(value, int)


def _flags(headers: Path, python: Path, root: Path) -> list[str]:
    """Return what clang is always told."""
    names = zip(("major", "minor", "tiny"), _EMSCRIPTEN, strict=True)
    version = [f"-D__EMSCRIPTEN_{name}__={number}" for name, number in names]
    return [
        *("--target=wasm32-unknown-emscripten", f"--sysroot={headers}", f"-I{python}"),
        *(f"-isystem{headers}/include/compat", "-D__EMSCRIPTEN__=1", *version),
        # hidden in headers that are told to keep to C11, as numpy tells them
        "-D_GNU_SOURCE=1",
        # as Pyodide has them: code that may lie anywhere, no instructions of later processors
        *("-fPIC", "-mcpu=mvp", "-mmutable-globals", "-D_LIBCPP_ABI_VERSION=2"),
        # without it, throwing in C++ would need what the processor of Pyodide 0.25 has not
        "-fignore-exceptions",
        # no path of this machine in what readers get
        *(f"-ffile-prefix-map={root}/=", "-Wno-everything"),
        *("--start-no-unused-arguments", "-nostdlib", f"-fuse-ld={root}/.ci/wasm-ld"),
        "--end-no-unused-arguments",
    ]


def _finished(work: Path, source: Path, core: Path, root: Path) -> Path:
    """Name the libraries as in Pyodide, add what else a wheel has, and compare the libraries."""
    (found,) = (work / "installed").rglob("site-packages")
    here, there = sysconfig.get_config_var("EXT_SUFFIX"), pyodide_settings(core)["EXT_SUFFIX"]
    for library in sorted(found.rglob(f"*{here}")):
        library.rename(library.with_name(library.name.removesuffix(here) + there))
    told = found / "numpy/__config__.py"
    text = told.read_text(encoding="utf-8").replace(f"{root}/", "")
    told.write_text(text, encoding="utf-8")
    about = (source / "PKG-INFO").read_text(encoding="utf-8")
    described = found / f"{source.name}.dist-info"
    described.mkdir()
    (described / "METADATA").write_text(about, encoding="utf-8")
    licences = [x.removeprefix("License-File: ") for x in about.splitlines() if "License-File" in x]
    for name in licences:
        copy = described / "licenses" / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source / name, copy)
    compare(found, core)
    return found


def compare(packages: Path, core: Path) -> None:
    """Refuse a library that wants what Pyodide does not have, or has with another type."""
    main = read((core / "pyodide.asm.wasm").read_bytes())
    libraries = sorted(packages.rglob("*.so"))
    if not libraries:
        raise LiveError("The build of numpy has made no library.")
    for library in libraries:
        wrong = misfits(read(library.read_bytes()), main)
        if wrong:
            name = library.name.partition(".")[0]
            raise LiveError(f"{name} of numpy does not fit this Pyodide: {', '.join(wrong)}.")
