"""The types of both packages hold together."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.long
def test_mypy_has_nothing_to_say(root: Path) -> None:
    """It takes one processor for a minute; here the other goes on with tests."""
    done = subprocess.run(
        [sys.executable, "-m", "mypy"], cwd=root, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
