"""Filter and smoothers: against all measurements at once, against consistency, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lib.inertial.made import ANCHORS, LEVER_ARM, Path, ahead, fixes_of, motion_on, ranges_of
from scipy.optimize import least_squares
from scipy.stats import chi2

from inswsn_lib import inertial as nav
from inswsn_lib.checks import Array
from inswsn_lib.errors import InswsnError
from inswsn_lib.streams import Odometry, Ranges

SPREAD = np.repeat([0.1, 0.05, 0.02, 0.05, 0.003], 3)


def begun(path: Path, rng: np.random.Generator) -> nav.Start:
    """Return a start that is wrong by what it says, but for the biases."""
    wrong = path.state(0.0).plus(SPREAD * rng.standard_normal(15))
    state = replace(wrong, force_bias=np.zeros(3), rate_bias=np.zeros(3))
    return nav.Start(0.0, state, np.diag(SPREAD**2))


def coloured(rng: np.random.Generator, deviation: float, factor: float) -> Array:
    """Return 99 errors of three axes, by their recursion."""
    e = deviation * rng.standard_normal((99, 3))
    for k in range(1, 99):
        e[k] = factor * e[k - 1] + (1 - factor**2) ** 0.5 * e[k]
    return e


def planar_case(seed: int) -> tuple[nav.OdometryMotion, nav.Start, nav.RangesToAnchors, Array]:
    """A vehicle with odometry and ranges, small enough to be solved at once."""
    rng, t = np.random.default_rng(seed), np.arange(0, 4.01, 0.1)
    odometry = Odometry(t, np.full(len(t), 1.0), 0.5 * np.sin(t))
    times, anchors = np.arange(0.5, 4.01, 0.5), ANCHORS[:4, :2]
    heading = np.cumsum(0.1 * odometry.rate)
    track = np.cumsum(0.1 * np.stack([np.cos(heading), np.sin(heading)], -1), axis=0)
    which = np.arange(len(times)) % 4
    away = np.linalg.norm(track[np.searchsorted(t, times - 1e-9)] - anchors[which], axis=1)
    told = Ranges(times, which, away + 0.03 * rng.standard_normal(8), anchors, tuple("abcd"))
    spread = np.diag([0.05, 0.05, 0.03, 0.02, 0.01]) ** 2
    start = nav.Start(0.0, nav.PlanarState(np.array([0.03, -0.03]), 0.01), spread)
    motion = nav.OdometryMotion(odometry, nav.OdometryNoise(0.02, 0.01, 1e-3, 1e-3))
    return motion, start, nav.RangesToAnchors(told, np.zeros(2), 0.03), times


def test_the_smoother_is_least_squares_over_everything() -> None:
    """The most likely track by scipy, from start, motion and ranges as residuals of one problem.

    They agree to what is left of linearisation: a twentieth of the standard deviation.
    """
    motion, start, ranges, times = planar_case(2)
    edges, count = np.append(0.0, times), len(times) + 1
    found = nav.smooth(nav.run_error_state(motion, start, [ranges]))

    def track(x: Array) -> tuple[list, list]:
        """Return states, each of what is left of the one before, and what the motion says."""
        states, went = [start.state.plus(x[:5])], []
        for k, correction in enumerate(x[5:].reshape(-1, 5)):
            went.append(ahead(motion, edges[k], edges[k + 1], states[-1]))
            states.append(went[-1][0].plus(correction))
        return states, went

    def residuals(x: Array) -> Array:
        states, went = track(x)
        parts = [x[:5] / np.sqrt(np.diag(start.covariance))]
        for k, (_, _, Q) in enumerate(went):
            got = ranges.innovation(k, states[k + 1], np.zeros(0))
            noise = np.linalg.cholesky(Q)
            parts += [np.linalg.solve(noise, x[5 * k + 5 : 5 * k + 10]), got.value / 0.03]
        return np.concatenate(parts)

    best = least_squares(residuals, np.zeros(5 * count), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    states, went = track(best.x)
    whole, errors = np.linalg.inv(best.jac.T @ best.jac), np.eye(5, 5 * count)
    for k, P in enumerate(found.covariances):
        errors = went[k][1] @ errors + np.eye(5, 5 * count, 5 * k + 5)
        deviation = np.sqrt(np.diag(P))
        assert np.abs(found.states[k].minus(states[k + 1]) / deviation).max() < 0.05
        spread = (P - errors @ whole @ errors.T) / np.outer(deviation, deviation)
        assert np.abs(spread).max() < 0.03


def nees(solution: nav.Solution, path: Path) -> float:
    """Return the mean normalised square of the errors of position and velocity."""
    t = solution.time
    apart = solution.position - path.position(t), solution.velocity - path.velocity(t)
    error = np.hstack(apart)[..., None]
    return float((error * np.linalg.solve(solution.covariances[:, :6, :6], error)).mean())


RUNS = 12


@pytest.fixture(scope="module")
def loose() -> list[tuple[Path, nav.Solution, nav.Solution, nav.Solution]]:
    """Filter, smoother and fixed-lag smoother on fixes with coloured errors, twelve runs."""
    made = []
    for seed in range(RUNS):
        rng, path = np.random.default_rng([7, seed]), Path(float(seed))
        start = begun(path, rng)
        wrong = SPREAD[9:].reshape(2, 3) * rng.standard_normal((2, 3))
        errors = coloured(rng, 0.1, np.exp(-0.2 / 2)) + 0.03 * rng.standard_normal((99, 3))
        fixes = nav.PositionFixes(
            fixes_of(path, 20.0, errors), LEVER_ARM,
            np.full(3, 0.03), np.full(3, 0.1), np.full(3, 2.0),
        )  # fmt: skip
        solution = nav.run_error_state(motion_on(path, 20.0, rng, biases=wrong), start, [fixes])
        made.append((path, solution, nav.smooth(solution), nav.smooth_with_lag(solution, 2.0)))
    return made


def test_errors_are_as_large_as_the_filter_says(loose: list) -> None:
    """Twelve independent runs; within each the error is correlated over about 2 s of 20.

    So a mean of 120 values of 6 components, at least: false alarms of 1e-4.
    """
    for place in (1, 2, 3):
        found = np.mean([nees(run[place], run[0]) for run in loose])
        low, high = chi2.ppf([5e-5, 1 - 5e-5], RUNS * 6 * 4) / (RUNS * 6 * 4)
        assert low < found < high, place


def test_a_lag_longer_than_the_run_is_the_smoother_and_none_is_the_filter(loose: list) -> None:
    _, solution, smoothed, _ = loose[0]
    whole, none = nav.smooth_with_lag(solution, 1e3), nav.smooth_with_lag(solution, 0.0)
    assert whole.position == pytest.approx(smoothed.position, abs=1e-6)
    assert whole.covariances == pytest.approx(smoothed.covariances, rel=1e-4, abs=1e-9)
    assert none.position == pytest.approx(solution.position, abs=0)


def test_tight_finds_the_bias_of_each_anchor_and_the_scale_of_all() -> None:
    rng, path = np.random.default_rng(2), Path()
    start, ranges = begun(path, rng), ranges_of(path, 20.0, rng, 0.05)
    own = np.array([0.07, 0.2, -0.1, 0.0, 0.3, 0.1, -0.2])
    wrong = replace(ranges, distance=(1 + own[0]) * ranges.distance + own[1 + ranges.anchor])
    heard = nav.RangesToAnchors(wrong, LEVER_ARM, 0.05, bias=0.3, scale=0.1)
    solution = nav.run_error_state(motion_on(path, 20.0, rng), start, [heard])
    apart, P = solution.states[-1].own - own, solution.covariances[-1][15:, 15:]
    assert apart @ np.linalg.solve(P, apart) < chi2.ppf(1 - 1e-4, 7)
    assert np.sqrt(np.diag(P)).max() < 0.1
    assert nees(solution, path) < 2


def test_a_gate_keeps_false_ranges_out() -> None:
    rng, path = np.random.default_rng(4), Path()
    start, ranges = begun(path, rng), ranges_of(path, 10.0, rng, 0.05)
    false = rng.random(len(ranges)) < 0.05
    spoilt = replace(ranges, distance=ranges.distance + 3.0 * false)
    motion, observed = motion_on(path, 10.0, rng), [nav.RangesToAnchors(spoilt, LEVER_ARM, 0.05)]
    gated = nav.run_error_state(motion, start, observed, gate=16.0)
    assert np.array_equal(np.concatenate(gated.innovations[0].used), ~false)
    assert np.sqrt(np.mean((gated.position - path.position(gated.time)) ** 2)) < 0.05


@pytest.mark.parametrize(
    ("begin", "sign", "count", "said"),
    [
        (5.0, 1.0, 1, "There is no measurement after 5 s"),
        (0.0, 1.0, 0, "There is no measurement"),
        (0.0, -1.0, 1, r"covariance .* not one with a negative eigenvalue"),
    ],
)
def test_nothing_to_measure_is_told(begin: float, sign: float, count: int, said: str) -> None:
    path = Path()
    fixes = nav.PositionFixes(fixes_of(path, 1.0, 0.0), LEVER_ARM, np.ones(3))
    start = nav.Start(begin, path.state(0.0), sign * np.eye(15))
    with pytest.raises(InswsnError, match=said):
        nav.run_error_state(motion_on(path, 1.0), start, [fixes] * count)


def test_steps_of_the_covariance_err_by_their_square() -> None:
    rng, path = np.random.default_rng(1), Path()
    motion, start = motion_on(path, 20.0, rng), begun(path, rng)
    fixes = nav.PositionFixes(fixes_of(path, 20.0, 0.0, 2.0), LEVER_ARM, np.full(3, 0.05))
    sizes = []
    for substep in (0.01, 0.1, 0.2):
        run = nav.run_error_state(replace(motion, substep=substep), start, [fixes])
        sizes.append(np.sqrt(np.diagonal(run.covariances, axis1=1, axis2=2)))
    errors = [np.abs(size / sizes[0] - 1).max() for size in sizes[1:]]
    assert errors[1] < 1e-3
    assert errors[1] / errors[0] == pytest.approx(4, rel=0.1)
