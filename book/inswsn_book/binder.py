"""The files below ``binder/``, from which Binder makes an image of the repository.

Binder's builder, repo2docker, would install a ``requirements.txt`` among the packages of its own
notebook server, in one call of pip. Here torch comes from an index of its own, before all else and
without its dependencies; and the server's packages are not those that the lock pins. So the image
gets the environment that every other machine gets, by the same make target, and the server's one
kernel is told to use it. All that is left to say of the locks is the Python that they are for.
"""

from __future__ import annotations

from inswsn_book.environment import PYTHON
from inswsn_book.files import write_whole
from inswsn_book.project import Project

_POST_BUILD = """\
#!/usr/bin/env bash
# Made by `make lock`; do not edit. Called by repo2docker in the repository's folder, once the image
# has its Python, of the version in runtime.txt, and its notebook server.
set -euo pipefail
export PIP_NO_CACHE_DIR=1  # a cache would stay in the image
make environment PYTHON="$NB_PYTHON_PREFIX/bin/python"
# notebooks name the kernel python3; from here on it is the environment from the locks
.venv/bin/python -m ipykernel install --prefix "$NB_PYTHON_PREFIX" --name python3
"""


def binder_files() -> dict[str, str]:
    """Return the texts of the files, by their names in a checkout."""
    return {"binder/runtime.txt": f"python-{PYTHON}\n", "binder/postBuild": _POST_BUILD}


def stale_binder_files(project: Project) -> list[str]:
    """Return the names of files that differ from what `write_binder_files` would write.

    Parameters
    ----------
    project : Project
        The checkout.
    """
    return [
        name
        for name, text in binder_files().items()
        if not (project.root / name).is_file()
        or (project.root / name).read_text(encoding="utf-8") != text
    ]


def write_binder_files(project: Project) -> list[str]:
    """Write the files that differ; return their names.

    Parameters
    ----------
    project : Project
        The checkout.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    stale = stale_binder_files(project)
    for name in stale:
        path = project.root / name
        write_whole(path, binder_files()[name])
        if path.name == "postBuild":
            path.chmod(0o755)
    return stale
