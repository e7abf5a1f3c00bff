"""Filter and smoothers: against all measurements at once, against consistency, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lib.inertial.made import ANCHORS, LEVER_ARM, Path, ahead, fixes_of, imu_of, ranges_of
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import chi2

from inswsn_lib.errors import InswsnError
from inswsn_lib.inertial import (
    ImuNoise,
    InertialMotion,
    InertialState,
    OdometryMotion,
    OdometryNoise,
    PlanarState,
    PositionFixes,
    RangesToAnchors,
    Solution,
    Start,
    Velocities,
    run_error_state,
    smooth,
    smooth_with_lag,
)
from inswsn_lib.streams import Fixes, Imu, Odometry, Ranges

Array = NDArray[np.float64]
NOISE = ImuNoise(0.02, 0.002, 1e-3, 1e-5)
SPREAD = np.repeat([0.1, 0.05, 0.02, 0.05, 0.003], 3)


def begun(path: Path, rng: np.random.Generator) -> tuple[Start, Array]:
    """Return a start that is wrong by what it says, and the true state."""
    true = path.start()
    wrong = SPREAD * rng.standard_normal(15)
    return Start(
        0.0,
        replace(true.plus(wrong), force_bias=np.zeros(3), rate_bias=np.zeros(3)),
        np.diag(SPREAD**2),
    ), wrong


def coloured(rng: np.random.Generator, count: int, deviation: float, factor: float) -> Array:
    e = np.empty((count, 3))
    e[0] = deviation * rng.standard_normal(3)
    for k in range(1, count):
        e[k] = factor * e[k - 1] + deviation * (1 - factor**2) ** 0.5 * rng.standard_normal(3)
    return e


def planar_case(seed: int) -> tuple[OdometryMotion, Start, RangesToAnchors, Array]:
    """A vehicle with odometry and ranges, small enough to be solved at once."""
    rng, t = np.random.default_rng(seed), np.arange(0, 4.01, 0.1)
    odometry = Odometry(t, np.full(len(t), 1.0), 0.5 * np.sin(t))
    noise = OdometryNoise(0.02, 0.01, 1e-3, 1e-3)
    times = np.arange(0.5, 4.01, 0.5)
    anchors = ANCHORS[:4, :2]
    heading = np.cumsum(0.1 * odometry.rate)
    track = np.cumsum(0.1 * np.stack([np.cos(heading), np.sin(heading)], -1), axis=0)
    truth = track[np.searchsorted(t, times - 1e-9)]
    which = np.arange(len(times)) % 4
    distance = np.linalg.norm(truth - anchors[which], axis=1) + 0.03 * rng.standard_normal(
        len(times)
    )
    ranges = RangesToAnchors(
        Ranges(times, which, distance, anchors, tuple("abcd")), np.zeros(2), 0.03
    )
    start = Start(
        0.0,
        PlanarState(np.array([0.03, -0.03]), 0.01),
        np.diag([0.05, 0.05, 0.03, 0.02, 0.01]) ** 2,
    )
    return OdometryMotion(odometry, noise), start, ranges, times


@pytest.mark.parametrize("seed", range(4))
def test_the_smoother_is_least_squares_over_everything(seed: int) -> None:
    """The most likely track by scipy, from start, motion and ranges as residuals of one problem.

    They agree to what is left of linearisation: a twentieth of the standard deviation.
    """
    motion, start, ranges, times = planar_case(seed)
    edges = np.append(0.0, times)
    found = smooth(run_error_state(motion, start, [ranges], iterations=10))

    def residuals(x: Array) -> Array:
        corrections = x.reshape(-1, 5)
        states = [start.state.plus(corrections[0])]
        parts = [corrections[0] / np.sqrt(np.diag(start.covariance))]
        for k in range(len(times)):
            end, _, Q = ahead(motion, edges[k], times[k], states[-1])
            states.append(end.plus(corrections[k + 1]))
            parts.append(np.linalg.solve(np.linalg.cholesky(Q), corrections[k + 1]))
            got = ranges.innovation(k, states[-1], np.zeros(0))
            parts.append(got.value / 0.03)
        return np.concatenate(parts)

    best = least_squares(
        residuals, np.zeros(5 * (len(times) + 1)), xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    corrections, state = best.x.reshape(-1, 5), start.state
    state = state.plus(corrections[0])
    for k in range(len(times)):
        state = ahead(motion, edges[k], times[k], state)[0].plus(corrections[k + 1])
        deviation = np.sqrt(np.diag(found.covariances[k]))
        assert np.abs(found.states[k].minus(state) / deviation).max() < 0.05


def test_the_covariance_of_the_smoother_is_that_of_least_squares() -> None:
    motion, start, ranges, times = planar_case(1)
    filtered = run_error_state(motion, start, [ranges])
    smoothed = smooth(filtered)
    n, K = 5, len(times)
    information = np.zeros((n * (K + 1), n * (K + 1)))
    information[:n, :n] = np.linalg.inv(start.covariance)
    edges, state = np.append(0.0, times), start.state
    for k in range(K):
        end, Phi, Q = ahead(motion, edges[k], times[k], state)
        rows = np.zeros((n, n * (K + 1)))
        rows[:, n * k : n * k + n], rows[:, n * (k + 1) : n * (k + 2)] = -Phi, np.eye(n)
        information += rows.T @ np.linalg.solve(Q, rows)
        got = ranges.innovation(k, end, np.zeros(0))
        part = slice(n * (k + 1), n * (k + 2))
        information[part, part] += got.rows.T @ got.rows / 0.03**2
        state = filtered.states[k]
    whole = np.linalg.inv(information)
    for k in range(K):
        part = slice(n * (k + 1), n * (k + 2))
        assert smoothed.covariances[k] == pytest.approx(whole[part, part], rel=1e-6, abs=1e-10)
    assert smoothed.covariances[-1] == pytest.approx(filtered.covariances[-1])


def nees(solution: Solution, path: Path, rows: slice) -> float:
    """Return the mean normalised square of the errors of position and velocity."""
    total = []
    for t, state, P in zip(solution.time, solution.states, solution.covariances, strict=True):
        at = np.array(t)
        error = np.concatenate(
            [state.position - path.position(at), state.velocity - path.velocity(at)]
        )
        total.append(error[rows] @ np.linalg.solve(P[rows, rows], error[rows]) / len(error[rows]))
    return float(np.mean(total))


RUNS = 12


@pytest.fixture(scope="module")
def loose() -> list[tuple[Path, Solution, Solution, Solution]]:
    """Filter, smoother and fixed-lag smoother on fixes with coloured errors, twelve runs."""
    made = []
    for seed in range(RUNS):
        rng = np.random.default_rng([7, seed])
        path = Path(float(seed))
        start, _ = begun(path, rng)
        imu = imu_of(
            path,
            20.0,
            rng,
            force=0.02,
            rate=0.002,
            biases=(SPREAD[9:12] * rng.standard_normal(3), SPREAD[12:] * rng.standard_normal(3)),
        )
        count = len(np.arange(0.2, 20.0, 0.2))
        errors = coloured(rng, count, 0.1, np.exp(-0.2 / 2)) + 0.03 * rng.standard_normal(
            (count, 3)
        )
        fixes = PositionFixes(
            fixes_of(path, 20.0, errors),
            LEVER_ARM,
            np.full(3, 0.03),
            np.full(3, 0.1),
            np.full(3, 2.0),
        )
        solution = run_error_state(InertialMotion(imu, NOISE), start, [fixes])
        made.append((path, solution, smooth(solution), smooth_with_lag(solution, 2.0)))
    return made


def test_errors_are_as_large_as_the_filter_says(loose: list) -> None:
    """Twelve independent runs; within each the error is correlated over about 2 s of 20.

    So a mean of 120 values of 6 components, at least: false alarms of 1e-4.
    """
    for place in (1, 2, 3):
        found = np.mean([nees(run[place], run[0], slice(0, 6)) for run in loose])
        low, high = chi2.ppf([5e-5, 1 - 5e-5], RUNS * 6 * 4) / (RUNS * 6 * 4)
        assert low < found < high, place


def test_innovations_are_white(loose: list) -> None:
    """Correlations of neighbours of 12 runs of 99: a standard deviation of 0.017 each axis."""
    values = np.array([run[1].innovations[0].values for run in loose])
    spread = np.array([run[1].innovations[0].deviations for run in loose])
    whitened = values / spread
    lag = (whitened[:, 11:] * whitened[:, 10:-1]).mean(axis=(0, 1)) / (whitened[:, 10:] ** 2).mean(
        axis=(0, 1)
    )
    assert np.abs(lag).max() < 0.15


def test_smoothers_are_better_in_their_order(loose: list) -> None:
    def rms(place: int) -> float:
        errors = [run[place].position - run[0].position(run[place].time) for run in loose]
        return float(np.sqrt(np.mean(np.square(errors))))

    assert rms(2) < rms(3) < rms(1)


def test_a_lag_longer_than_the_run_is_the_smoother_and_none_is_the_filter(loose: list) -> None:
    _, solution, smoothed, _ = loose[0]
    whole, none = smooth_with_lag(solution, 1e3), smooth_with_lag(solution, 0.0)
    assert whole.position == pytest.approx(smoothed.position, abs=1e-6)
    assert whole.covariances == pytest.approx(smoothed.covariances, rel=1e-4, abs=1e-9)
    assert none.position == pytest.approx(solution.position, abs=0)


def test_a_filter_that_takes_coloured_errors_for_white_is_too_sure() -> None:
    rng, path = np.random.default_rng(11), Path()
    start, _ = begun(path, rng)
    count = len(np.arange(0.2, 20.0, 0.2))
    fixes = fixes_of(path, 20.0, coloured(rng, count, 0.1, np.exp(-0.2 / 2)))
    motion = InertialMotion(imu_of(path, 20.0, rng, force=0.02, rate=0.002), NOISE)
    white = run_error_state(motion, start, [PositionFixes(fixes, LEVER_ARM, np.full(3, 0.1))])
    told = run_error_state(
        motion, start,
        [PositionFixes(fixes, LEVER_ARM, np.full(3, 0.01), np.full(3, 0.1), np.full(3, 2.0))],
    )  # fmt: skip
    assert nees(white, path, slice(0, 3)) > 2 * nees(told, path, slice(0, 3))


def test_tight_finds_the_bias_of_each_anchor() -> None:
    rng, path = np.random.default_rng(2), Path()
    start, _ = begun(path, rng)
    ranges = ranges_of(path, 20.0, rng, 0.05)
    bias = np.array([0.2, -0.1, 0.0, 0.3, 0.1, -0.2])
    wrong = replace(ranges, distance=ranges.distance + bias[ranges.anchor])
    motion = InertialMotion(imu_of(path, 20.0, rng, force=0.02, rate=0.002), NOISE)
    solution = run_error_state(motion, start, [RangesToAnchors(wrong, LEVER_ARM, 0.05, bias=0.3)])
    found, P = solution.states[-1].own, solution.covariances[-1][15:, 15:]
    gap = found - bias
    assert gap @ np.linalg.solve(P, gap) < chi2.ppf(1 - 1e-4, 6)
    assert np.sqrt(np.diag(P)).max() < 0.1
    told = run_error_state(motion, start, [RangesToAnchors(ranges, LEVER_ARM, 0.05)])
    assert nees(told, path, slice(0, 6)) < 2


def test_tight_finds_the_scale_of_all_ranges() -> None:
    rng, path = np.random.default_rng(6), Path()
    start, _ = begun(path, rng)
    ranges = ranges_of(path, 20.0, rng, 0.05)
    wrong = replace(ranges, distance=1.07 * ranges.distance)
    motion = InertialMotion(imu_of(path, 20.0, rng, force=0.02, rate=0.002), NOISE)
    solution = run_error_state(motion, start, [RangesToAnchors(wrong, LEVER_ARM, 0.05, scale=0.1)])
    deviation = np.sqrt(solution.covariances[-1][15, 15])
    assert abs(solution.states[-1].own[0] - 0.07) < 4 * deviation < 0.01


def test_derivatives_of_ranges_are_differences() -> None:
    rng, path = np.random.default_rng(8), Path()
    observed = RangesToAnchors(
        ranges_of(path, 1.0, rng, 0.05), LEVER_ARM, 0.05, 0.1, 0.1, 1.0, scale=0.1
    )
    state, own = path.start(), 0.1 * rng.standard_normal(13)
    got = observed.innovation(3, state, own)
    assert got is not None
    for column in range(28):
        step = np.zeros(28)
        step[column] = 1e-6
        moved = observed.innovation(3, state.plus(step[:15]), own + step[15:])
        assert moved is not None
        rows = np.hstack([got.rows, got.own])[:, column]
        assert (got.value - moved.value) / 1e-6 == pytest.approx(rows, abs=1e-5)


def test_a_gate_keeps_false_ranges_out() -> None:
    rng, path = np.random.default_rng(4), Path()
    start, _ = begun(path, rng)
    ranges = ranges_of(path, 10.0, rng, 0.05)
    false = rng.random(len(ranges)) < 0.05
    spoilt = replace(ranges, distance=ranges.distance + 3.0 * false)
    motion = InertialMotion(imu_of(path, 10.0, rng, force=0.02, rate=0.002), NOISE)
    observed = [RangesToAnchors(spoilt, LEVER_ARM, 0.05)]
    gated = run_error_state(motion, start, observed, gate=16.0)
    open_ = run_error_state(motion, start, observed)
    used = np.concatenate(gated.innovations[0].used)
    assert np.array_equal(used, ~false)

    def rms(s: Solution) -> float:
        return float(np.sqrt(np.mean((s.position - path.position(s.time)) ** 2)))

    assert rms(gated) < 0.05 < 4 * rms(gated) < rms(open_)


def test_zero_velocity_holds_the_drift_of_an_imu_at_rest() -> None:
    """With ZUPT each second the position goes by metres less in a minute than without."""
    t = np.arange(0, 60.0, 0.02)
    imu = Imu(t, np.zeros((len(t), 3)), np.tile([0.05, 0.0, 9.80665], (len(t), 1)))
    start = Start(
        0.0,
        InertialState(np.zeros(3), np.zeros(3), np.eye(3)),
        np.diag(np.repeat([1e-3, 1e-3, 1e-2, 0.1, 1e-3], 3) ** 2),
    )
    seconds = np.arange(1.0, 60.0)
    still = Velocities(seconds, np.zeros((len(seconds), 3)), np.full(3, 0.01))
    nothing = Velocities(seconds, np.full((len(seconds), 3), np.nan), np.full(3, 0.01))
    motion = InertialMotion(imu, NOISE)
    held = run_error_state(motion, start, [still]).position[-1]
    free = run_error_state(motion, start, [nothing]).position[-1]
    assert free[0] == pytest.approx(0.5 * 0.05 * 59**2, rel=1e-6)
    assert np.abs(held).max() < 0.5


def test_nothing_to_measure_is_told() -> None:
    path = Path()
    motion = InertialMotion(imu_of(path, 1.0), NOISE)
    start = Start(5.0, InertialState(np.zeros(3), np.zeros(3), np.eye(3)), np.eye(15))
    with pytest.raises(InswsnError, match="There is no measurement after 5 s"):
        run_error_state(
            motion, start, [PositionFixes(fixes_of(path, 1.0, 0.0), LEVER_ARM, np.ones(3))]
        )
    with pytest.raises(InswsnError, match=r"covariance .* not one with a negative eigenvalue"):
        run_error_state(
            motion,
            Start(0.0, start.state, -np.eye(15)),
            [PositionFixes(fixes_of(path, 1.0, 0.0), LEVER_ARM, np.ones(3))],
        )
    with pytest.raises(InswsnError, match="There is no measurement"):
        run_error_state(motion, start, [])


def test_an_axis_without_a_fix_is_left_out() -> None:
    path = Path()
    fixes = fixes_of(path, 2.0, 0.0)
    flat = Fixes(fixes.time, np.column_stack([fixes.position[:, :2], np.full(len(fixes), np.nan)]))
    start, _ = begun(path, np.random.default_rng(0))
    motion = InertialMotion(imu_of(path, 2.0), NOISE)
    solution = run_error_state(motion, start, [PositionFixes(flat, LEVER_ARM, np.full(3, 0.1))])
    assert {len(v) for v in solution.innovations[0].values} == {2}
    assert solution.covariances[-1][2, 2] > solution.covariances[-1][0, 0]


def test_steps_of_the_covariance_err_by_their_square() -> None:
    rng, path = np.random.default_rng(1), Path()
    imu, start = imu_of(path, 20.0, rng, force=0.02, rate=0.002), begun(path, rng)[0]
    fixes = PositionFixes(fixes_of(path, 20.0, 0.0, 2.0), LEVER_ARM, np.full(3, 0.05))
    sizes = []
    for substep in (0.01, 0.1, 0.2):
        run = run_error_state(InertialMotion(imu, NOISE, None, substep), start, [fixes])
        sizes.append(np.sqrt(np.diagonal(run.covariances, axis1=1, axis2=2)))
    errors = [np.abs(size / sizes[0] - 1).max() for size in sizes[1:]]
    assert errors[1] < 1e-3
    assert errors[1] / errors[0] == pytest.approx(4, rel=0.1)
