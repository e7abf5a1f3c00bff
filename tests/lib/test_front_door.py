"""The front door: every name is there, and brings what it needs and no more."""

from __future__ import annotations

import subprocess
import sys

import pytest

import inswsn_lib as iw

ROOMS = [name for name in iw.__all__ if hasattr(getattr(iw, name), "__path__")]
#: What a name may load of other projects, in a fresh process
LIGHT = {"lazy_loader", "numpy", "yaml"}
NUMPY_ALONE = [
    *("ErrorModel", "run_kalman", "design_kalman", "run_hinfinity", "deadbeat_gain"),
    *("run_federated", "run_fused_locals", "run_distributed", "run_switched", "run_robust"),
    *("FilterDesign", "FusionDesign", "InfeasibleDesignError"),  # to run them
]


def test_each_name_of_the_stubs_is_there() -> None:
    assert {"filters", "lmi", "learning", "vehicle"} <= {*ROOMS} <= {*dir(iw)}
    for face in (iw, *(getattr(iw, room) for room in ROOMS)):
        assert all(getattr(face, name) is not None for name in face.__all__)


@pytest.mark.parametrize("name", NUMPY_ALONE)
def test_a_name_brings_numpy_alone(name: str) -> None:
    script = f"""
import sys
before = {{*sys.modules}}
import inswsn_lib as iw
iw.{name}
new = {{name.partition(".")[0] for name in {{*sys.modules}} - before}}
print(*sorted(new - {{*sys.stdlib_module_names}} - {{"inswsn_lib"}}))
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert {*done.stdout.split()} <= LIGHT


def test_the_kalman_filter_loads_little_beside_numpy() -> None:
    """Modules are counted, since seconds hang on the machine."""

    def modules(code: str) -> set[str]:
        script = f"import sys\n{code}\nprint(*sys.modules)"
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True
        )
        return {*done.stdout.split()}

    more = modules("from inswsn_lib.filters import run_kalman") - modules("import numpy")
    assert len(more) <= 30


def test_the_room_that_was_called_estimation_is_found_where_it_is() -> None:
    with pytest.warns(DeprecationWarning, match=r"align is now inswsn_lib\.inertial\.align"):
        from inswsn_lib.estimation import align
    with pytest.warns(DeprecationWarning, match=r"is now inswsn_lib\.logs\.slope_velocity"):
        from inswsn_lib.estimation import slope_velocity
    assert (align, slope_velocity) == (iw.inertial.align, iw.logs.slope_velocity)
    with pytest.raises(ImportError, match="anything"):
        from inswsn_lib.estimation import anything  # noqa: F401


@pytest.mark.parametrize("old", ["recordings", "calibration"])
def test_rooms_that_are_logs_now_are_found_by_their_old_names(old: str) -> None:
    room = getattr(iw, old)
    for name in iw.logs.__all__:
        with pytest.warns(DeprecationWarning, match=rf"{old}\.{name} is now inswsn_lib\.logs\."):
            found = getattr(room, name)
        assert found is getattr(iw.logs, name)
    with pytest.raises(AttributeError, match="anything"):
        room.anything  # noqa: B018


def test_modules_of_a_room_are_found_by_its_old_name() -> None:
    from inswsn_lib.recordings.rtklib import read_solution

    from inswsn_lib.logs import rtklib

    assert read_solution is rtklib.read_solution
