"""``python -m inswsn_book.lab``: open copies of the chapters' notebooks in JupyterLab."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

from inswsn_book.record.files import write_whole
from inswsn_book.record.project import RESULTS_VARIABLE, ROOT_VARIABLE, Project, find_root
from inswsn_book.run.store import Request, environment_of

_KERNEL = (
    *(sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"),
    "--IPKernelApp.exec_lines=import inswsn_book.lab.kernel as _lab; _lab.begin(); del _lab",
)
# neither news nor newer versions are looked for in the network, unless a reader has it so
_SETTINGS = {
    "@jupyterlab/apputils-extension:notification": {"fetchNews": "false", "checkForUpdates": False}
}


def copy_chapters(project: Project, folder: Path) -> None:
    """Copy the notebooks of the chapters that are not in a folder yet."""
    for chapter in project.chapters():
        place = folder / f"{chapter.name}.ipynb"
        if not place.exists():
            write_whole(place, chapter.twin.read_bytes())


def main() -> None:
    """Become JupyterLab, with the words that are given."""
    project = Project(find_root())
    folder, share = project.root / "runs" / "lab", Path(sys.prefix, "share", "jupyter")
    copy_chapters(project, folder)
    print(
        "Copies of the chapters are in runs/lab, and yours: delete one to have it copied anew.",
        flush=True,
    )
    spec = {"argv": _KERNEL, "display_name": "Python 3", "language": "python"}
    write_whole(share / "kernels" / "python3" / "kernel.json", json.dumps(spec))
    write_whole(share / "lab" / "settings" / "overrides.json", json.dumps(_SETTINGS))
    environment = environment_of(project, Request(project.chapters()[0].id)) | {
        ROOT_VARIABLE: str(project.root),
        RESULTS_VARIABLE: str(folder / "results"),
        "JUPYTER_PATH": str(share),  # else another kernel of that name may be found first
    }
    os.chdir(folder)
    os.execve(sys.executable, [sys.executable, "-m", "jupyterlab", *sys.argv[1:]], environment)


if __name__ == "__main__":
    main()
