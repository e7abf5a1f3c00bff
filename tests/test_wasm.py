"""The files by which Python runs in the reader's page: made whole, from what is known, or refused.

With INSWSN_TESTS=whole they are used as a reader does: numpy computes in Chromium, in a worker,
where no host can be reached but the one that serves the files of `_build/live`.
"""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import wasm
from conftest import serving
from wasm_fetch import LiveError, UnreachableError, checked, locked, sha256 as as_npm
from wasm_module import Module, misfits, read
from wasm_numpy import compare

if TYPE_CHECKING:
    from playwright.sync_api import Browser

NUMPY = {
    "numpy/__init__.py": "version = 2",
    "numpy/linalg/__init__.py": "",
    "numpy/linalg/_umath_linalg.so": "library",
    "numpy/linalg/__init__.pyi": "no page needs it",
    "numpy/__pycache__/__init__.cpython-311.pyc": "no page needs it",
    "numpy/linalg/tests/test_linalg.py": "no page needs it",
    "numpy/_core/include/numpy/arrayobject.h": "no page needs it",
    "numpy/_core/_multiarray_tests.so": "no page needs it",
    "numpy-2.9.dist-info/METADATA": "Name: numpy",
    "numpy-2.9.dist-info/LICENSE.txt": "the licence",
    "numpy-2.9.dist-info/RECORD": "no page needs it",
}
NEEDED = {name for name, text in NUMPY.items() if text != "no page needs it"}


@pytest.fixture
def serve() -> Iterator[Callable[[Path], str]]:
    """Serve folders; return their addresses."""
    with ExitStack() as servers:
        yield lambda folder: servers.enter_context(serving(folder))


class Network:
    """A small Pyodide and a place that has its numpy, or does not."""

    def __init__(self, folder: Path) -> None:
        self.wheels = "http://127.0.0.1:9/"  # where nobody listens
        self.live, self.work, self.served = (folder / name for name in ("live", "work", "served"))
        self.work.mkdir(parents=True)
        self.served.mkdir()
        self.wheel = self.served / "numpy-2.9.whl"
        with zipfile.ZipFile(self.wheel, "w") as made:
            for name, text in NUMPY.items():
                made.writestr(name, text)
        digest = sha256(self.wheel.read_bytes()).hexdigest()
        numpy = {"version": "2.9", "file_name": self.wheel.name, "sha256": digest}
        lock = {"info": {"python": "3.13.2"}, "packages": {"numpy": numpy}}
        self.core = folder / "pyodide.tgz"
        with tarfile.open(self.core, "w:gz") as files:
            for name in (*wasm.CORE, "console.html"):
                text = json.dumps(lock) if name.endswith("lock.json") else name
                entry = tarfile.TarInfo(f"package/{name}")
                entry.size = len(text)
                files.addfile(entry, io.BytesIO(text.encode()))

    def official(self, folder: Path) -> str:
        wasm.write_core(self.core, folder)
        return wasm.write_official(folder, self.wheels)

    def built(self, folder: Path) -> str:
        wasm.write_core(self.core, folder)
        return wasm.write_numpy({n: t.encode() for n, t in NUMPY.items()}, folder)

    def make(self, source: str | None = None, **makers: wasm.Maker) -> dict[str, Any]:
        known = {"official": self.official, "built": self.built} | makers
        return wasm.make(self.live, self.work, "digest", source, known)

    def left(self) -> list[str]:
        """Return what stays in the folder of the work."""
        return [path.name for path in self.work.iterdir()]


@pytest.fixture
def network(tmp_path: Path, serve: Callable[[Path], str]) -> Network:
    made = Network(tmp_path / "network")
    made.wheels = serve(made.served)
    return made


@pytest.fixture
def cut_off(tmp_path: Path) -> Network:
    """As where the host of the wheels cannot be reached."""
    return Network(tmp_path)


# What is fetched ----------------------------------------------------------------------------------


def test_a_content_is_taken_by_its_digest_alone() -> None:
    known = as_npm(sha256(b"known").hexdigest())
    assert known.startswith("sha256-")
    assert checked(b"known", known, "It") == b"known"
    with pytest.raises(LiveError, match=r"^It is refused: its digest .*\.$"):
        checked(b"changed", known, "It")


def test_the_official_wheel_is_taken_where_it_can_be_had(network: Network) -> None:
    about = network.make()
    assert (about["source"], about["numpy"], about["python"]) == ("official", "2.9", "3.13.2")
    assert about["site_packages"] == "/lib/python3.13/site-packages"
    assert json.loads((network.live / "live.json").read_text()) == about
    names = {path.name for path in network.live.iterdir()}
    assert names == {*wasm.CORE, *wasm.LICENCES, "numpy.zip", "live.json"}
    for name, said in about["files"].items():
        content = (network.live / name).read_bytes()
        assert said == {"bytes": len(content), "sha256": sha256(content).hexdigest()}
    with zipfile.ZipFile(network.live / "numpy.zip") as made:
        assert set(made.namelist()) == NEEDED
    assert network.left() == []


def test_without_the_host_of_the_wheels_numpy_is_built(
    cut_off: Network, network: Network, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cut_off.make()["source"] == "built"
    said = r"The numpy 2\.9 of Pyodide cannot be fetched \(.*\); the next source is tried\.\n"
    assert re.fullmatch(said, capsys.readouterr().out)
    network.wheel.unlink()  # one that the host does not have is as good as no host
    assert network.make()["source"] == "built"


def test_one_source_that_is_asked_for_is_the_only_one(cut_off: Network) -> None:
    with pytest.raises(UnreachableError):
        cut_off.make("official")
    assert not cut_off.live.exists()
    assert cut_off.left() == []


def test_another_wheel_is_refused_and_nothing_is_half_made(network: Network) -> None:
    before = network.make("built")
    network.wheel.write_bytes(network.wheel.read_bytes() + b"more")
    with pytest.raises(LiveError, match="refused") as refused:
        network.make()
    assert not isinstance(refused.value, UnreachableError), "nothing else is tried"
    assert json.loads((network.live / "live.json").read_text()) == before
    assert before["files"] == wasm.described(network.live)
    assert network.left() == []


def test_a_build_that_is_stopped_or_too_large_leaves_nothing(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(folder: Path) -> str:
        network.built(folder)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        network.make("built", built=stopped)
    assert not network.live.exists()
    assert network.left() == []
    monkeypatch.setattr(wasm, "LIMIT", 100)  # no reader would wait for so much
    with pytest.raises(LiveError, match="MB are allowed"):
        network.make("built")
    assert not network.live.exists()


def test_a_second_call_finds_what_the_first_has_made_unless_changed(network: Network) -> None:
    assert not wasm.is_made(network.live, "digest", None)
    first = network.make("built")["files"]["numpy.zip"]
    assert network.make("built")["files"]["numpy.zip"] == first  # to the bit
    assert wasm.is_made(network.live, "digest", None)
    assert wasm.is_made(network.live, "digest", "built")
    assert not wasm.is_made(network.live, "digest", "official")
    assert not wasm.is_made(network.live, "of other pins", None)
    (network.live / "pyodide.js").write_text("changed")
    assert not wasm.is_made(network.live, "digest", None)


def test_the_lock_pins_the_sources_that_are_built(root: Path) -> None:
    version, digests = locked((root / "environment.lock").read_text(), "numpy")
    assert version == np.__version__
    assert len(digests) > 10
    with pytest.raises(LiveError, match="pins no numpy"):
        locked("scipy==1 \\\n    --hash=sha256:00\n", "numpy")


def test_without_the_commands_one_sentence_says_what_to_install(root: Path, tmp_path: Path) -> None:
    folder = tmp_path / ".ci"
    folder.mkdir()
    for path in [*(root / ".ci").glob("wasm*"), root / "environment.lock"]:
        if path.is_file():
            (folder / ".." / path.relative_to(root)).write_bytes(path.read_bytes())
    done = subprocess.run(
        [sys.executable, folder / "wasm.py", "--source", "built"],
        env=os.environ | {"PATH": ""}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "npm is missing; install what is needed: apt-get install npm.\n"
    assert not (tmp_path / "_build/live").exists()


# What is built ------------------------------------------------------------------------------------


def part(number: int, *entries: bytes) -> bytes:
    """Return a section of a module."""
    content = bytes([len(entries)]) + b"".join(entries)
    return bytes([number, len(content)]) + content


def named(name: str) -> bytes:
    return bytes([len(name)]) + name.encode()


I32, F64 = b"\x7f", b"\x7c"
UNARY = (F64, F64)  # takes a float, gives one
PLAIN = (b"", I32)  # takes nothing, gives an integer
#: Imports sin, a memory, a table and a global; has a function of its own and exports both
TINY = b"\0asm\1\0\0\0" + b"".join(
    [
        part(0, b"custom"),
        part(1, b"\x60\1" + F64 + b"\1" + F64, b"\x60\0\1" + I32),
        part(
            2,
            named("env") + named("memory") + b"\2\1\1\x80\2",
            named("env") + named("sin") + b"\0\0",
            named("env") + named("table") + b"\1\x70\0\1",
            named("GOT.mem") + named("errors") + b"\3\x7f\1",
        ),
        part(3, b"\1"),
        part(7, named("sine") + b"\0\0", named("own") + b"\0\1", named("memory") + b"\2\0"),
    ]
)


def test_a_module_is_read_with_the_types_of_its_functions() -> None:
    module = read(TINY)
    assert module.imports == {
        ("env", "memory"): None, ("env", "sin"): UNARY, ("env", "table"): None,
        ("GOT.mem", "errors"): None,
    }  # fmt: skip
    assert module.exports == {"sine": UNARY, "own": PLAIN, "memory": None}


@pytest.mark.parametrize("content", [b"", b"\x7fELF", TINY[:20], TINY + b"\7\x7f"])
def test_what_is_no_module_is_refused(content: bytes) -> None:
    with pytest.raises(ValueError, match="module"):
        read(content)


def test_a_library_is_held_against_what_loads_it() -> None:
    library = read(TINY)
    rest = {"table": None, "errors": None}
    assert misfits(library, Module({}, rest | {"sin": UNARY})) == []
    assert misfits(library, Module({("env", "sin"): UNARY}, rest)) == [], "of what loads both"
    assert misfits(library, Module({}, rest | {"sin": PLAIN})) == ["sin has another type"]
    assert misfits(library, Module({("env", "sin"): PLAIN}, rest)) == ["sin has another type"]
    assert misfits(library, Module({("else", "sin"): UNARY}, rest)) == ["sin is missing"]
    assert misfits(library, Module({}, {"sin": UNARY, "table": None})) == ["errors is missing"]


def test_a_build_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    core, packages = tmp_path / "core", tmp_path / "packages"
    core.mkdir()
    packages.mkdir()
    (core / "pyodide.asm.wasm").write_bytes(b"\0asm\1\0\0\0")  # which has nothing
    with pytest.raises(LiveError, match="has made no library"):
        compare(packages, core)
    (packages / "fft.cpython.so").write_bytes(TINY)
    with pytest.raises(LiveError, match=r"^fft of numpy .*: sin is missing, .*, errors is .*\.$"):
        compare(packages, core)
    (core / "pyodide.asm.wasm").write_bytes(TINY)
    with pytest.raises(LiveError, match=r"^fft of numpy does not fit .*: errors is missing\.$"):
        compare(packages, core)


@pytest.mark.parametrize(
    ("output", "has", "lacks"),
    [("it.so", "-shared", "--allow-undefined-file"), ("it", "--allow-undefined-file=", "-shared")],
)
def test_the_linker_is_told_what_it_knows(
    root: Path, tmp_path: Path, output: str, has: str, lacks: str
) -> None:
    fake = tmp_path / "wasm-ld-16"
    fake.write_text('#!/bin/sh\necho "$@"\n')
    fake.chmod(0o755)
    words = [root / ".ci/wasm-ld", "-m", "wasm32", "a.o", "-lm", "--as-needed", "-o", output, "b.a"]
    path = f"{tmp_path}{os.pathsep}{os.environ['PATH']}"
    said = subprocess.run(
        words, env=os.environ | {"PATH": path}, capture_output=True, text=True, check=True
    ).stdout
    assert f"a.o -o {output} b.a" in said
    assert has in said
    assert not any(word in said for word in (lacks, "-lm", "--as-needed"))


# What readers get ---------------------------------------------------------------------------------

WORKER = """\
importScripts("pyodide.js");
onmessage = async ({data}) => {
  try {
    const pyodide = await loadPyodide({indexURL: new URL("./", self.location).href});
    const archive = await (await fetch("numpy.zip")).arrayBuffer();
    pyodide.unpackArchive(archive, "zip", {extractDir: data.place});
    postMessage(pyodide.runPython(data.code));
  } catch (error) {
    postMessage(JSON.stringify({error: String(error)}));
  }
};
"""
ASK = """([code, place]) => new Promise((resolve, reject) => {
  const worker = new Worker("worker.js");
  worker.onmessage = ({data}) => resolve(data);
  worker.onerror = ({message}) => reject(new Error(message));
  worker.postMessage({code, place});
})"""
#: Runs in the page and here; the bits of what is drawn, and numbers that may differ by rounding
CODE = """
import json
import numpy as np
draw = np.random.default_rng(2012).normal(size=3)
A = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -1.0], [0.5, -1.0, 2.0]])
computed = [
    np.linalg.inv(A), np.linalg.eigvalsh(A), np.linalg.svd(A, compute_uv=False),
    np.linalg.lstsq(A[:, :2], draw, rcond=None)[0], np.linalg.solve(A, draw),
    np.kron(A[:2, :2], A), np.einsum("ij,jk->ik", A, A), np.abs(np.fft.fft(draw)),
    np.sort(draw), np.exp(A), np.linalg.cholesky(A),
]
json.dumps({
    "version": np.__version__, "drawn": draw.tobytes().hex(),
    "computed": [value.tolist() for value in computed],
})
"""


@pytest.mark.whole
def test_numpy_computes_in_the_page_as_it_does_here(
    root: Path, tmp_path: Path, browser: Browser, serve: Callable[[Path], str]
) -> None:
    live = root / "_build/live"
    assert (live / "live.json").is_file(), "make live comes first"
    about = json.loads((live / "live.json").read_text())
    assert about["files"] == wasm.described(live)
    for path in live.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / "worker.js").write_text(WORKER)
    (tmp_path / "page.html").write_text("<!doctype html><title>A page</title>")
    address, asked = serve(tmp_path), []
    page = browser.new_page()
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"{address}page.html")
    there = json.loads(page.evaluate(ASK, [CODE, about["site_packages"]]))
    page.close()
    assert "error" not in there, there
    code, _, last = CODE.rpartition("json.dumps(")
    known: dict[str, Any] = {}
    exec(code + "here = (" + last, known)
    here = known["here"]
    assert there["version"] == about["numpy"]
    assert there["drawn"] == here["drawn"]
    for found, wanted in zip(there["computed"], here["computed"], strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-13)
    assert {url.removeprefix(address) for url in asked} >= {"numpy.zip", "pyodide.asm.wasm"}
    assert [url for url in asked if not url.startswith(address)] == []
