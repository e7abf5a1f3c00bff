"""Every public name has an example, and every example of the library gives what it says."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import inswsn_book
import matplotlib as mpl
import pytest
from inswsn_book.record.project import RESULTS_VARIABLE, ROOT_VARIABLE
from matplotlib import pyplot as plt

import inswsn_lib
from inswsn_lib.files import DATA_VARIABLE

# The rooms whose public names are listed in __all__, and the modules below them
ROOMS = (
    "evaluation",
    "filters",
    "inertial",
    "kernels",
    "learning",
    "lmi",
    "navigation",
    "papers",
    "logs",
    "simulation",
    "vehicle",
)
MODULES = ("errors", "files", "models", "plotting", "scenario", "streams")

#: Functions and classes of a room that need no example, each with the reason
EXEMPT = {
    "errors.Described": "for the rooms",
    "evaluation.DriftBound": "given by drift_bound",
    "evaluation.Lead": "given by paired_lead",
    "evaluation.Leader": "given by Scores.leader",
    "evaluation.Score": "given by score_hypothesis",
    "evaluation.Spread": "given by spread",
    "inertial.Ground": "given by Earth.ground",
    "inertial.ImuNoise": "shown by align",
    "inertial.InertialMotion": "shown by align",
    "inertial.Innovation": "given by observations",
    "inertial.Innovations": "a part of Solution",
    "inertial.Observation": "what run_error_state takes",
    "inertial.OdometryMotion": "shown by run_error_state",
    "inertial.OdometryNoise": "shown by run_error_state",
    "inertial.PlanarState": "shown by run_error_state",
    "inertial.PositionFixes": "shown by run_error_state",
    "inertial.Solution": "given by run_error_state",
    "inertial.Start": "shown by run_error_state",
    "inertial.smooth_with_lag": "as smooth, whose example it would repeat",
    "kernels.choose": "for the rooms",
    "lmi.WorstCase": "given by worst_disturbance",
    "navigation.Bridge": "shown by VehicleHybrid",
    "navigation.Judged": "given by BridgedOutages.compare",
    "navigation.Machine": "what VehicleHybrid trains",
    "navigation.OutageTrials": "shown by run_outages",
    "navigation.Ramps": "what VehicleHybrid learns from",
    "navigation.RecordedTrials": "shown by read_trials",
    "papers.Printed": "a name for str, without a docstring of its own",
    "logs.Calibration": "given by calibrate",
    "logs.Answer": "shown by the module entries",
    "logs.Estimate": "given by Ladder.estimates",
    "logs.Event": "what an entry is given",
    "logs.RecordingUnavailableError": "raised by load_drive where nothing can be fetched",
    "logs.Report": "what report returns",
    "logs.Rung": "a part of Ladder",
    "scenario.between": "shown by from_settings",
    "simulation.DriveReference": "shown by horizontal_error",
    "simulation.Kinematics": "shown by Route",
    "simulation.Piece": "shown by Route",
    "simulation.Place": "shown by Drive",
    "simulation.Truth": "shown by true_motion",
    "simulation.Window": "a part of Scene",
    "streams.Fixes": "shown by Recording",
    "streams.Imu": "a part of Recording, as Fixes is",
    "streams.Odometry": "shown by write_csv",
    "streams.Ranges": "a part of Recording, as Fixes is",
    "streams.Reference": "a part of Recording, as Fixes is",
    "streams.Stream": "what Imu, Fixes and others share",
    "streams.check_increase": "for the readers",
    "vehicle.VehicleRun": "shown by run_vehicle_filter",
}

MODULES_WITH_EXAMPLES = sorted(
    ".".join(path.relative_to(package.parent).with_suffix("").parts)
    for package in (Path(inswsn_lib.__file__).parent, Path(inswsn_book.__file__).parent)
    for path in package.rglob("*.py")
    if ">>> " in path.read_text(encoding="utf-8")
)


def public_names(name: str) -> dict[str, object]:
    """Return what a room lists, or what a module defines, without a leading underscore."""
    module = importlib.import_module(f"inswsn_lib.{name}")
    listed = getattr(module, "__all__", None)
    if listed is not None:
        return {f"{name}.{word}": getattr(module, word) for word in listed}
    return {
        f"{name}.{word}": value
        for word, value in vars(module).items()
        if not word.startswith("_") and getattr(value, "__module__", None) == module.__name__
    }


def has_example(value: object) -> bool:
    """Tell whether a docstring has a section of examples that gives something: not prose alone."""
    _, _, section = (inspect.getdoc(value) or "").partition("Examples\n--------\n")
    return any(example.want for example in doctest.DocTestParser().get_examples(section))


@pytest.mark.parametrize("name", [*ROOMS, *MODULES])
def test_every_public_name_has_an_example_but_for_those_that_need_none(name: str) -> None:
    found = public_names(name)
    exempt = {word for word in EXEMPT if word.partition(".")[0] == name}
    assert exempt <= set(found)
    without = {
        word
        for word, value in found.items()
        if (inspect.isclass(value) or inspect.isroutine(value)) and not has_example(value)
    }
    assert without - exempt == set()
    assert not any(has_example(found[word]) for word in exempt)


def test_the_rooms_are_all_packages() -> None:
    packages = {found.name for found in pkgutil.iter_modules(inswsn_lib.__path__) if found.ispkg}
    assert packages == set(ROOMS)


@pytest.fixture
def _as_a_reader(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The checkout is found, nothing recorded is, and what an example changes is taken back."""
    monkeypatch.setenv(ROOT_VARIABLE, str(root))
    monkeypatch.setenv(RESULTS_VARIABLE, str(tmp_path))
    monkeypatch.delenv(DATA_VARIABLE, raising=False)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = plt.get_fignums()  # of other tests in this process
    with mpl.rc_context():
        yield
    assert plt.get_fignums() == before, "an example leaves a figure open"


def examples_of(module: ModuleType) -> list[doctest.DocTest]:
    """Return the examples of a module, each to be run with no name defined but what it imports."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    return [test for test in finder.find(module, globs={"__name__": "__main__"}) if test.examples]


@pytest.mark.parametrize("name", MODULES_WITH_EXAMPLES)
@pytest.mark.usefixtures("_as_a_reader")
def test_the_examples_give_what_they_say(name: str) -> None:
    told: list[str] = []
    runner = doctest.DocTestRunner(verbose=False)
    for test in examples_of(importlib.import_module(name)):
        runner.run(test, out=told.append)
    assert runner.failures == 0, "".join(told)


def test_a_wrong_example_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also one that leans on a name of its module, which a reader does not have."""
    (tmp_path / "wrong_examples.py").write_text(
        '"""Two wrong examples.\n\n>>> 1 + 1\n3\n>>> word\n\'here\'\n"""\n\nword = "here"\n',
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(tmp_path)
    runner = doctest.DocTestRunner(verbose=False)
    for test in examples_of(importlib.import_module("wrong_examples")):
        runner.run(test, out=lambda _: None)
    monkeypatch.delitem(sys.modules, "wrong_examples")
    assert runner.failures == 2
