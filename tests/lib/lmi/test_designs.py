"""What a design holds is imported without solvers: who runs a design need not have made it."""

from __future__ import annotations

import subprocess
import sys


def test_what_a_design_holds_brings_no_solver() -> None:
    script = """
import sys
import inswsn_lib as iw
iw.FilterDesign, iw.FusionDesign, iw.InfeasibleDesignError
print(*({"cvxpy", "scipy", "clarabel", "scs", "sklearn"} & {*sys.modules}))
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []
