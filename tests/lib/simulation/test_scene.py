"""The scene of P1: its timeline, what it draws, and the studies that found its numbers."""

from __future__ import annotations

import runpy
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.evaluation import monte_carlo
from inswsn_lib.scenario import from_settings, load_scenario, with_values
from inswsn_lib.simulation import InertialErrors, Scene, simulate_ins


@pytest.fixture(scope="module")
def scene(root: Path) -> Scene:
    folder = root / "data" / "scenarios"
    settings = load_scenario(folder / "p1.yaml") | load_scenario(folder / "p1-inertial.yaml")
    return from_settings(Scene, settings)


def test_the_timeline_is_that_of_the_printed_numbers(scene: Scene) -> None:
    windows = scene.windows
    assert [w.samples for w in windows.values()] == [100, 50, 100, 50]
    assert [w.period for w in windows.values()] == [0.2, 0.2, 0.21, 0.21]
    starts = [w.start for w in windows.values()]
    assert starts == pytest.approx([17.44, 37.44, 47.44 + 13.86, 82.3])
    assert windows["area2"].times[[0, 1, -1]] == pytest.approx([61.3, 61.51, 82.09])
    # 150 m in 20 s, along the path; the whole of it fits on the path
    assert scene.speed * 20 == pytest.approx(150)
    assert windows["outage2"].end * scene.speed <= scene.path.length
    assert scene.motion.time[1] == 0.01
    assert windows["outage2"].end <= scene.motion.time[-1] < windows["outage2"].end + 0.02


def test_the_nodes_are_a_grid_around_the_path_within_the_scene(scene: Scene) -> None:
    """Also with the path mirrored: what was near one edge is near the other."""
    mirrored = replace(scene, waypoints=tuple((x, 450.0 - y) for x, y in scene.waypoints))
    for one in (scene, mirrored):
        for name, size, count in (("area1", 150, 31), ("area2", 100, 21)):
            inside = one.path.drive(one.speed, one.windows[name].times).position
            nodes = one.nodes[name]
            assert len(nodes) == count**2
            assert np.ptp(nodes, axis=0) == pytest.approx([size, size])
            assert (nodes.min(axis=0) <= inside.min(axis=0)).all()
            assert (nodes.max(axis=0) >= inside.max(axis=0)).all()
            assert (nodes >= -1e-9).all()
            assert (nodes <= np.array(one.size) + 1e-9).all()
    assert mirrored.nodes["area1"][:, 1].max() == pytest.approx(450)
    inside = scene.path.drive(scene.speed, scene.windows["area2"].times).position
    middle = (inside.min(axis=0) + inside.max(axis=0)) / 2
    assert scene.nodes["area2"].mean(axis=0) == pytest.approx(middle)
    for size in ((100.0, 450.0), (700.0, 149.0)):
        with pytest.raises(ParameterError, match="size must be"):
            _ = replace(scene, size=size).nodes


def test_fixes_are_accurate_to_the_printed_20_cm(scene: Scene) -> None:
    drawn = monte_carlo(scene.simulate, 128, seed=1)
    for name in ("area1", "area2"):
        distance = np.hypot(drawn[f"wsn.{name}"][:, 0], drawn[f"wsn.{name}"][:, 1])
        assert np.sqrt(np.mean(distance**2)) == pytest.approx(0.2, rel=0.05)
        assert drawn[f"wsn.{name}"][:, 2:].std() == pytest.approx(0.126, rel=0.02)


def test_every_third_fix_is_lost_and_the_others_are_what_they_were(scene: Scene) -> None:
    whole, some = (
        replace(scene, lost_every=n).simulate(np.random.default_rng(3), 2) for n in (0, 3)
    )
    lost = np.arange(len(whole["wsn.area1"])) % 3 == 2
    assert np.isnan(some["wsn.area1"][lost]).all()
    np.testing.assert_array_equal(some["wsn.area1"][~lost], whole["wsn.area1"][~lost])
    np.testing.assert_array_equal(some["ins.area1"], whole["ins.area1"])


def test_without_noise_and_jitter_the_ins_is_the_deterministic_one(scene: Scene) -> None:
    quiet = replace(scene.inertial, accelerometer_noise=0.0, gyro_noise=0.0)
    still = replace(scene, jitter=(0.0, 0.0), inertial=quiet)
    drawn = still.simulate(np.random.default_rng(2), 2)
    motion = still.motion
    truth = np.hstack([motion.position, motion.velocity])
    error = simulate_ins(motion, still.inertial)[:, :, 0] - truth
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
    assert np.array_equal(a["ins.area2"][0], b["ins.area2"][0])
    for name, steps in (("ins.area2", 99), ("ins.outage2", 149)):
        moved = (b[name] - a[name])[-1, :2] / a[name][-1, 2:]
        assert moved.std() == pytest.approx(0.02 * steps**0.5, rel=0.25)


def test_a_setting_moves_no_draw_but_its_own(scene: Scene) -> None:
    other = replace(scene, ranging=replace(scene.ranging, outlier=1e-9, dropout=1e-9))
    a, b = (s.simulate(np.random.default_rng(4), 16) for s in (scene, other))
    for name, array in a.items():
        assert np.array_equal(array, b[name], equal_nan=True), name
    with pytest.raises(ParameterError, match=r"runs .* not 1\.5"):
        scene.simulate(np.random.default_rng(4), 1.5)  # type: ignore[arg-type]


def test_a_velocity_by_difference_is_as_noisy_as_theory_says(scene: Scene) -> None:
    rough = replace(scene, velocity_source="difference")
    drawn = monte_carlo(rough.simulate, 128, seed=4)["wsn.area1"]
    assert np.isnan(drawn[0, 2:]).all()
    position = drawn[:, :2].std(axis=2).mean()
    assert drawn[5:, 2:].std() == pytest.approx(np.sqrt(2) * position / 0.2, rel=0.05)
    smooth = replace(scene, velocity_source="window", velocity_fixes=5)
    slope = monte_carlo(smooth.simulate, 128, seed=4)["wsn.area1"]
    assert np.isnan(slope[3, 2:]).all()
    # the slope of five points a step apart: sigma / (T sqrt(10)), where the path is straight
    spread = slope[5:40, 2:].std(axis=2).mean()
    assert spread == pytest.approx(position / 0.2 / np.sqrt(10), rel=0.1)


@pytest.mark.whole
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


def test_the_calibrations_are_what_their_script_finds(root: Path, scene: Scene) -> None:
    """The kept numbers give the residuals that the files state, and no step away is better."""
    study = runpy.run_path(str(root / "studies" / "calibrate_imu.py"))
    folder, printed = root / "data" / "scenarios", study["printed_cells"]()

    def residual(errors: InertialErrors, keep: np.ndarray) -> float:
        logs = np.log(study["rebuilt_cells"](scene, errors) / printed)[keep]
        return float(np.sqrt(np.mean(logs**2)))

    def named(file: str) -> float:
        return float((folder / file).read_text().split("\n")[1].split()[-1].rstrip("."))

    sound = ~study["SUSPECT"]
    kept = residual(scene.inertial, sound)
    assert kept == pytest.approx(named("p1-inertial.yaml"), abs=5e-4)
    steps = {"gyro_bias": 0.001, "heading": 0.01, "velocity": 0.1, "position": 1.0}
    for name, step in (steps | {"accelerometer_bias": 0.005}).items():
        value = np.array(getattr(scene.inertial, name))
        for way in np.eye(value.size).reshape(-1, *value.shape):
            for sign in (-1, 1):
                if (name, sign) == ("heading", 1):
                    continue  # beyond the bound of the search
                moved = (value + sign * step * way).tolist()
                moved = tuple(moved) if value.ndim else moved
                assert residual(replace(scene.inertial, **{name: moved}), sound) > kept, name
    both = load_scenario(folder / "p1.yaml") | load_scenario(folder / "p1-inertial-all-cells.yaml")
    found = residual(from_settings(Scene, both).inertial, np.ones((4, 4), dtype=bool))
    assert found == pytest.approx(named("p1-inertial-all-cells.yaml"), abs=2e-3)


def test_settings_that_cannot_be(root: Path) -> None:
    """The edge is `from_settings`; the errors of the INS may be given in place of theirs."""
    settings = load_scenario(root / "data" / "scenarios" / "p1.yaml")
    right = from_settings(Scene, settings, inertial=InertialErrors())
    assert right.training_samples == 100
    for name, value in {
        "speed": 0.0, "noise": -0.1, "dropout": 3.0, "lead": -1.0, "training_samples": 100.7,
        "velocity_source": "gps", "periods": [0.2, 0.0], "velocity_fixes": 1, "size": [700.0],
    }.items():  # fmt: skip
        with pytest.raises(ParameterError, match=f"^{name} must be"):
            from_settings(Scene, with_values(settings, **{name: value}), inertial=InertialErrors())
