"""Where the project's own files are: found by looking upward from the working folder."""

from __future__ import annotations

import os
from pathlib import Path

from inswsn_lib.errors import InswsnError

#: Set by the executor, so that a chapter finds the project from any working folder.
ROOT_VARIABLE = "INSWSN_ROOT"
#: Set by the executor: the folder that results files go to, instead of ``results/``.
RESULTS_VARIABLE = "INSWSN_RESULTS"

_MARKERS = ("_config.yml", "environment.lock", "chapters", "data")


def is_checkout(folder: Path) -> bool:
    """Tell whether `folder` is the root of a checkout of this project.

    Parameters
    ----------
    folder : Path
        The folder.

    Returns
    -------
    bool

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from inswsn_book.checkout import find_root, is_checkout
    >>> is_checkout(find_root())
    True
    >>> with TemporaryDirectory() as folder:
    ...     is_checkout(Path(folder))
    False
    """
    return all((folder / marker).exists() for marker in _MARKERS)


def find_root(start: Path | None = None) -> Path:
    """Find the root of the checkout.

    Parameters
    ----------
    start : Path, optional
        Folder to look upward from. Default: what the executor set, else the working folder.

    Returns
    -------
    Path
        The absolute path of the checkout.

    Raises
    ------
    InswsnError
        If neither `start` nor a folder above it is a checkout.

    Examples
    --------
    From anywhere in a checkout:

    >>> from inswsn_book.checkout import find_root
    >>> root = find_root()
    >>> find_root(root / "data" / "papers") == root
    True
    """
    if start is None:
        start = Path(os.environ.get(ROOT_VARIABLE) or Path.cwd())
    start = start.resolve()
    for folder in (start, *start.parents):
        if is_checkout(folder):
            return folder
    raise InswsnError(
        f"{start} is not in a checkout of inswsn: go into one, or name it with --root."
    )


def results_folder(root: Path) -> Path:
    """Return the folder that this run's results files go to.

    Parameters
    ----------
    root : Path
        The checkout.

    Returns
    -------
    Path
        What ``INSWSN_RESULTS`` names, else ``results`` in the checkout.

    Examples
    --------
    >>> import os
    >>> from pathlib import Path
    >>> from unittest.mock import patch
    >>> from inswsn_book.checkout import RESULTS_VARIABLE, results_folder
    >>> with patch.dict(os.environ, {RESULTS_VARIABLE: ""}):
    ...     results_folder(Path("checkout")).as_posix()
    'checkout/results'
    """
    return Path(os.environ.get(RESULTS_VARIABLE) or root / "results")
