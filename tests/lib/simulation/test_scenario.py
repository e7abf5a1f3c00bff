"""The scene of P1: its timeline, what it draws, and that its files are complete."""

from __future__ import annotations

import runpy
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from inswsn_lib.errors import InswsnError, ParameterError
from inswsn_lib.evaluation import monte_carlo
from inswsn_lib.scenario import load_scenario, with_values
from inswsn_lib.simulation import InertialErrors, Scene, simulate_ins


@pytest.fixture(scope="module")
def scene(root: Path) -> Scene:
    folder = root / "data" / "scenarios"
    return Scene.from_settings(
        load_scenario(folder / "p1.yaml") | load_scenario(folder / "p1-inertial.yaml")
    )


def test_the_timeline_is_that_of_the_printed_numbers(scene: Scene) -> None:
    windows = scene.windows
    assert [w.samples for w in windows.values()] == [100, 50, 100, 50]
    assert [w.period for w in windows.values()] == [0.2, 0.2, 0.21, 0.21]
    assert windows["outage1"].start == pytest.approx(windows["area1"].start + 20)
    assert windows["outage2"].start == pytest.approx(windows["area2"].start + 21)
    # 150 m in 20 s, along the path
    inside = scene.path.drive(scene.speed, windows["area1"].times)
    assert scene.speed * 20 == pytest.approx(150)
    assert len(inside.time) == 100
    # the whole of it fits on the path
    assert windows["outage2"].end * scene.speed <= scene.path.length


def test_each_window_lies_in_its_area(scene: Scene) -> None:
    for name, size, count in (("area1", 150, 31), ("area2", 100, 21)):
        inside = scene.path.drive(scene.speed, scene.windows[name].times).position
        nodes = scene.nodes[name]
        assert len(nodes) == count**2
        assert (np.ptp(inside, axis=0) <= size).all()
        assert (nodes.min(axis=0) <= inside.min(axis=0)).all()
        assert (nodes.max(axis=0) >= inside.max(axis=0)).all()
        assert (nodes >= 0).all()
        assert (nodes <= scene.size).all()


def test_fixes_are_accurate_to_the_printed_20_cm(scene: Scene) -> None:
    drawn = monte_carlo(scene.simulate, 128, seed=1)
    for name in ("area1", "area2"):
        distance = np.hypot(drawn[f"wsn.{name}"][:, 0], drawn[f"wsn.{name}"][:, 1])
        assert np.sqrt(np.mean(distance**2)) == pytest.approx(0.2, rel=0.05)
        assert drawn[f"wsn.{name}"][:, 2:].std() == pytest.approx(scene.velocity_noise, rel=0.02)


def test_without_noise_and_jitter_the_ins_is_the_deterministic_one(scene: Scene) -> None:
    still = replace(
        scene,
        jitter=(0.0, 0.0),
        inertial=replace(scene.inertial, accelerometer_noise=0.0, gyro_noise=0.0),
    )
    drawn = still.simulate(np.random.default_rng(2), 2)
    motion = still.motion
    error = simulate_ins(motion, still.inertial)[:, :, 0] - np.hstack(
        [motion.position, motion.velocity]
    )
    for name, window in still.windows.items():
        rows = np.round(window.times / still.inertial_interval).astype(int)
        for run in range(2):
            assert drawn[f"ins.{name}"][:, :, run] == pytest.approx(error[rows], abs=1e-6)


def test_jitter_moves_the_samples_and_nothing_else(scene: Scene) -> None:
    calm = replace(scene, jitter=(0.0, 0.0))
    wild = replace(scene, jitter=(0.0, 0.02))
    a, b = (s.simulate(np.random.default_rng(3), 64) for s in (calm, wild))
    for name in ("ins.area1", "ins.outage1", "wsn.area1", "wsn.area2"):
        assert np.array_equal(a[name], b[name], equal_nan=True)
    # the clock runs on from the area: after k steps it is off by 0.02 sqrt(k) s
    for name, steps in (("ins.area2", 99), ("ins.outage2", 149)):
        moved = (b[name] - a[name])[-1, :2] / a[name][-1, 2:]
        assert moved.std() == pytest.approx(0.02 * steps**0.5, rel=0.25)


def test_a_setting_moves_no_draw_but_its_own(scene: Scene) -> None:
    other = replace(scene, ranging=replace(scene.ranging, outlier=1e-9, dropout=1e-9))
    a, b = (s.simulate(np.random.default_rng(4), 16) for s in (scene, other))
    for name, array in a.items():
        assert np.array_equal(array, b[name], equal_nan=True), name


def test_a_velocity_by_difference_is_as_noisy_as_theory_says(scene: Scene) -> None:
    rough = replace(scene, velocity_source="difference")
    drawn = monte_carlo(rough.simulate, 128, seed=4)["wsn.area1"]
    assert np.isnan(drawn[0, 2:]).all()
    position = drawn[:, :2].std(axis=2).mean()
    assert drawn[5:, 2:].std() == pytest.approx(np.sqrt(2) * position / 0.2, rel=0.05)
    smooth = replace(scene, velocity_source="window", velocity_fixes=5)
    slope = monte_carlo(smooth.simulate, 128, seed=4)["wsn.area1"]
    assert np.isnan(slope[3, 2:]).all()
    # the slope of five points a step apart: sigma / (T sqrt(10)), plus the bend of the path
    assert slope[5:40, 2:].std() < 0.5 * drawn[5:40, 2:].std()


def test_a_window_of_one_fix_has_no_slope(scene: Scene) -> None:
    bad = replace(scene, velocity_source="window", velocity_fixes=1)
    with pytest.raises(ParameterError, match="velocity_fixes"):
        bad.simulate(np.random.default_rng(0), 1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("- 1", "is no scenario"),
        ("speed: {value: 1, unit: m/s, source: guessed, why: so}", "speed: source"),
        ("speed: {value: 1, unit: m/s, source: paper}", "speed has to have"),
    ],
)
def test_a_scenario_that_is_not_complete(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(text)
    with pytest.raises(InswsnError, match=said):
        load_scenario(path)


def test_settings_that_are_missing_or_unknown(root: Path) -> None:
    settings = load_scenario(root / "data" / "scenarios" / "p1.yaml")
    without = {name: setting for name, setting in settings.items() if name != "speed"}
    with pytest.raises(InswsnError, match="lacks the setting speed"):
        Scene.from_settings(without, InertialErrors())
    with pytest.raises(InswsnError, match="lacks the setting accelerometer_bias"):
        Scene.from_settings(settings)  # the errors of the INS are in a file of their own
    with pytest.raises(InswsnError, match="unknown setting pace"):
        Scene.from_settings(settings | {"pace": settings["speed"]}, InertialErrors())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("speed", 0.0), ("speed", "fast"), ("noise", -0.1), ("dropout", 3.0), ("lead", -1.0),
        ("training_samples", 100.7), ("velocity_source", "gps"), ("periods", [0.2, 0.0]),
        ("spacing", float("inf")),
    ],
)  # fmt: skip
def test_settings_that_cannot_be(root: Path, name: str, value: object) -> None:
    settings = load_scenario(root / "data" / "scenarios" / "p1.yaml")
    changed = replace(settings[name], value=value)
    with pytest.raises(ParameterError, match=name):
        Scene.from_settings(settings | {name: changed}, InertialErrors())


def test_the_path_is_the_candidate_that_its_study_names(
    root: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One candidate of the search, the winner, drawn and fitted again."""
    monkeypatch.syspath_prepend(str(root / "studies"))
    study = runpy.run_path(str(root / "studies" / "choose_path.py"))
    winner = next(islice(study["candidates"](), 1426, None))
    assert winner.waypoints.round(1).tolist() == [list(point) for point in scene.waypoints]
    assert (round(winner.lead, 2), round(winner.between, 2)) == (scene.lead, scene.between)
    assert study["residual"](winner) == pytest.approx(0.2524, abs=2e-3)


def test_the_calibration_is_what_its_script_finds(root: Path, scene: Scene) -> None:
    """The kept numbers give the residual that the file states, and no step away is better."""
    study = runpy.run_path(str(root / "studies" / "calibrate_imu.py"))
    printed, keep = study["printed_cells"](), ~study["SUSPECT"]

    def residual(errors: InertialErrors) -> float:
        logs = np.log(study["rebuilt_cells"](scene, errors) / printed)[keep]
        return float(np.sqrt(np.mean(logs**2)))

    kept = residual(scene.inertial)
    head = (root / "data" / "scenarios" / "p1-inertial.yaml").read_text().split("\n")[1]
    assert f"{kept:.3f}" in head
    for name, step in (("gyro_bias", 0.001), ("gyro_bias", -0.001), ("heading", -0.01)):
        moved = replace(scene.inertial, **{name: getattr(scene.inertial, name) + step})
        assert residual(moved) > kept
    for name, step in (("accelerometer_bias", 0.005), ("velocity", 0.1), ("position", 1.0)):
        for sign in (-1, 1):
            for axis in (0, 1):
                values = list(getattr(scene.inertial, name))
                values[axis] += sign * step
                assert residual(replace(scene.inertial, **{name: tuple(values)})) > kept


def test_a_changed_setting_says_that_it_is_assumed(root: Path) -> None:
    settings = load_scenario(root / "data/scenarios/p1.yaml")
    changed = with_values(settings, speed=7.5, noise=0.5)
    assert changed["speed"] is settings["speed"]  # 7.5 is what it was
    assert (changed["noise"].value, changed["noise"].source) == (0.5, "assumed")
    assert changed["noise"].unit == settings["noise"].unit
    assert settings["noise"].value == 0.38
    assert changed["noise"].why != settings["noise"].why
    assert with_values(settings, periods=np.array([0.2, 0.21])) == settings
    with pytest.raises(ParameterError, match="noise is None"):
        with_values(settings, noise=None)
    with pytest.raises(ParameterError, match="setting is 'sped'"):
        with_values(settings, sped=1.0)


@pytest.mark.parametrize("value", [[1.0, [2.0]], [[1.0, 2.0], [3.0]], [[[1.0], [2.0, 3.0]]]])
def test_lists_of_unequal_length_are_no_value(root: Path, value: list[object]) -> None:
    settings = load_scenario(root / "data/scenarios/p1.yaml")
    for name in ("noise", "size", "waypoints"):
        with pytest.raises(ParameterError, match=f"^{name} is .*; it may be a number, a word, or"):
            with_values(settings, **{name: value})


def test_an_area_near_the_edge_of_the_scene_stays_inside(scene: Scene) -> None:
    """The path mirrored: what was near one edge is near the other."""
    mirrored = replace(scene, waypoints=tuple((x, 450.0 - y) for x, y in scene.waypoints))
    for name in ("area1", "area2"):
        nodes = mirrored.nodes[name]
        assert (nodes >= 0).all()
        assert (nodes <= mirrored.size).all()
    assert mirrored.nodes["area1"][:, 1].max() == pytest.approx(450)


@pytest.mark.parametrize("size", [[700.0], [100.0, 450.0], [700.0, 450.0, 1.0], [0.0, 450.0]])
def test_a_scene_that_is_too_small_is_refused(root: Path, size: list[float]) -> None:
    settings = load_scenario(root / "data/scenarios/p1.yaml")
    with pytest.raises(ParameterError, match="size is"):
        Scene.from_settings(with_values(settings, size=size), inertial=InertialErrors())


def test_the_fit_to_all_cells_leaves_the_residual_that_its_file_names(root: Path) -> None:
    study = runpy.run_path(str(root / "studies" / "calibrate_imu.py"))
    path = root / "data/scenarios/p1-inertial-all-cells.yaml"
    scene = Scene.from_settings(
        load_scenario(root / "data/scenarios/p1.yaml") | load_scenario(path)
    )
    log = np.log(study["rebuilt_cells"](scene, scene.inertial) / study["printed_cells"]())
    named = float(path.read_text().split("\n")[1].split()[-1].rstrip("."))
    assert np.sqrt(np.mean(log**2)) == pytest.approx(named, abs=2e-3)
