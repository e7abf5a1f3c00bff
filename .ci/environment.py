"""Make the environment of the locks and point ``.venv`` at it: the first step of ``make``.

An environment lies in ``.venvs``, in a folder named by a digest of what it is made from: locks and
a Python that are unchanged ask for nothing. It is made where it stays, since its scripts hold its
path, and ``.venv`` is a link that is set once all is in it. Until then the old one remains.
Two calls at once wait for each other. Any Python on Linux or macOS runs this, in the checkout; it
takes 3.11, 3.12 or 3.13 to make an environment. What is pinned by hash holds for all three, but for
torch: the hash of its wheel for CPUs is that for 3.11, and the others get the same version.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import IO, NoReturn

PIP, LOCK, TORCH = ".ci/pip.txt", "environment.lock", "environment-torch.lock"
#: Below ``.venvs``: what pip fetches and builds, so that nothing is asked of a home folder
CACHE = "pip"
#: What the two packages of the checkout are installed by
PACKAGES = "pyproject.toml", "book/pyproject.toml"


def main() -> None:
    """Make what is missing of the environment, and point ``.venv`` at it."""
    kept = Path(".venvs")
    kept.mkdir(exist_ok=True)
    with (kept / "lock").open("w") as lock:
        hold(lock)
        made = kept / digest(PIP, LOCK, TORCH)[:16]
        # a Python that has been removed leaves a link to nothing
        if not ((made / "finished").exists() and (made / "bin" / "python").exists()):
            install(made)
        installed, wanted = made / "installed", digest(*PACKAGES)
        if not installed.exists() or installed.read_text() != wanted:
            own = "--no-deps", "--no-build-isolation", "--no-index", "-e", ".", "-e", "book"
            run(*pip(made, *own))
            installed.write_text(wanted)
        point(Path(".venv"), made)
        for other in set(kept.iterdir()) - {made, kept / "lock", kept / CACHE}:
            remove(other)


def hold(lock: IO[str]) -> None:
    """Wait until nobody else makes an environment here; what is started holds the lock as well."""
    os.set_inheritable(lock.fileno(), True)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        print("Waiting for another make, which installs the environment", flush=True)
        fcntl.flock(lock, fcntl.LOCK_EX)


def digest(*names: str) -> str:
    """Return the digest of files, of where they are, which an environment holds, and of Python."""
    here = os.fsencode(Path.cwd()), bytes(sys.version_info[:2])
    content = [*here, *(Path(name).read_bytes() for name in names)]
    return hashlib.sha256(b"\0".join(content)).hexdigest()


def install(made: Path) -> None:
    """Install what the locks pin into a new folder, which goes again if that fails."""
    version = sys.version_info[:2]
    if not (3, 11) <= version <= (3, 13):
        sys.exit(
            f"Python 3.11, 3.12 or 3.13 is needed; {sys.executable} is {version[0]}.{version[1]}. "
            "Name another one: make PYTHON=/path/to/python3.11"
        )
    print("Installing the locked environment into .venv (a few minutes, once)", flush=True)
    remove(made)
    try:
        # the one that .venv is made from, not the one in .venv, which may go
        run(sys._base_executable, "-m", "venv", str(made))
        run(*pip(made, "--require-hashes", "-r", PIP))
        locked = "--require-hashes", "--no-compile", "-r"
        # both at once, since each unpacks on one core
        words = [*locked, TORCH] if version == (3, 11) else ["-r", str(without_hashes(made, TORCH))]
        torch = subprocess.Popen(pip(made, "--no-deps", *words), close_fds=False)
        try:
            run(*pip(made, *locked, LOCK))
            if torch.wait():
                raise subprocess.CalledProcessError(torch.returncode, torch.args)
        finally:
            torch.kill()
            torch.wait()
        # on all cores, where pip would take one, and without tests
        python = str(made / "bin" / "python"), "-m", "compileall", "-q", "-j", "0"
        words = [*python, "-x", r"[/\\]tests?[/\\]", str(made / "lib")]
        # what is no Python 3 is told and stays as it is
        subprocess.run(words, check=False, close_fds=False, stdout=subprocess.DEVNULL)
        (made / "finished").touch()
    except BaseException:
        remove(made)
        raise


def without_hashes(made: Path, name: str) -> Path:
    """Return a lock in an environment that pins by version alone."""
    path = made / name
    path.write_text(re.sub(r" \\\n +--hash=\S+", "", Path(name).read_text()))
    return path


def remove(made: Path) -> None:
    """Remove an environment, first what says that it is finished."""
    with suppress(OSError):
        (made / "finished").unlink()
    shutil.rmtree(made, ignore_errors=True)


def pip(made: Path, *words: str) -> list[str]:
    """Return the words that install something into an environment."""
    quiet = "--quiet", "--disable-pip-version-check"
    return [str(made / "bin" / "python"), "-m", "pip", "install", *quiet, *words]


def run(*words: str) -> None:
    """Run a command to its end; it is ended if this is."""
    subprocess.run(words, check=True, close_fds=False)


def point(name: Path, made: Path) -> None:
    """Make `name` a link to an environment, in one step."""
    replaced, new = made.parent / "replaced", made.parent / "link"
    if name.is_symlink() and name.readlink() == made:
        return
    if name.is_dir() and not name.is_symlink():  # made by an earlier version, or by hand
        shutil.rmtree(replaced, ignore_errors=True)
        name.rename(replaced)
    new.unlink(missing_ok=True)
    new.symlink_to(made)
    new.replace(name)


def stop(number: int, _: object) -> NoReturn:
    """End, and what was started with it."""
    sys.exit(128 + number)


if __name__ == "__main__":
    os.environ.setdefault("PIP_CACHE_DIR", str(Path(".venvs", CACHE).absolute()))
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)
    try:
        main()
    except KeyboardInterrupt:
        sys.exit(130)
    except subprocess.CalledProcessError:  # it has said why
        sys.exit("The environment could not be made, for the reason above; .venv is as it was.")
    except OSError as error:
        sys.exit(f"The environment could not be made: {error}.")
