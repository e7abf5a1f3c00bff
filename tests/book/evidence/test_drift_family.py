"""Drifts by their mean errors: closed forms, planted drifts, planted filters, drawn noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from inswsn_book.evidence.drift_family import Correction, DriftFamily, fit_drifts
from scipy.integrate import quad
from scipy.stats import norm

from inswsn_lib.errors import ParameterError

SAMPLES, SILENT, PERIOD = 40, 20, 0.2
FAMILY = DriftFamily(PERIOD, SAMPLES, SILENT)
LENGTH = (SAMPLES + SILENT) * PERIOD
NOISE = (0.14, 0.126)
DRIFTS = np.array([[3.0, -20.0, 55.0, -15.0], [-1.0, 9.0, 4.0, 30.0]])
# a gain that moves positions and velocities into one another
GAIN = np.array([[0.62, 0.0, 0.0, 0.0], [0.0, 0.62, 0.0, 0.0],
                 [0.3, 0.0, 0.6, 0.0], [0.0, 0.3, 0.0, 0.6]])  # fmt: skip

Estimate = Callable[[np.ndarray], np.ndarray]


def times_gain(gain: np.ndarray) -> Estimate:
    return lambda y: gain @ y


def smoothed(y: np.ndarray) -> np.ndarray:
    """A filter with memory: half of the estimate before, half of the measurement."""
    out = np.empty_like(y)
    state = np.zeros_like(y[0])
    for k in range(len(y)):
        state = 0.5 * state + 0.5 * y[k]
        out[k] = state
    return out


def test_a_linear_drift_has_the_means_of_its_sums() -> None:
    # p = 2 + 3 s without a change of sign: the means of an arithmetic sequence
    n, m = SAMPLES, SILENT
    cells = DriftFamily(PERIOD, n, m, degree=1).cells([[2.0, 3.0]])[0]
    total = n + m
    assert cells[0] == pytest.approx(2 + 3 * (n - 1) / (2 * total))
    assert cells[2] == pytest.approx(2 + 3 * (n + (m - 1) / 2) / total)
    assert cells[[1, 3]] == pytest.approx(3 / (total * PERIOD))


def test_a_cubic_that_changes_sign_tends_to_the_integral() -> None:
    # |s^3 - c s| over the area, s to 2/3: below the root sqrt(c) one sign, above the other
    c, end = 0.2, 2 / 3
    family = DriftFamily(1.0, 20_000, 10_000)
    cells = family.cells([[0.0, -c, 0.0, 1.0]])[0]

    def position(s: float) -> float:
        return s**4 / 4 - c * s**2 / 2

    root = np.sqrt(c)
    area = (position(end) - 2 * position(root)) / end
    assert cells[0] == pytest.approx(area, rel=1e-3)
    root = np.sqrt(c / 3)  # of the velocity 3 s^2 - c
    speed = ((end**3 - c * end) - 2 * (root**3 - c * root)) / end
    assert cells[1] * 30_000 == pytest.approx(speed, rel=1e-3)


def left_by_hand(numbers: np.ndarray, estimate: Estimate) -> np.ndarray:
    """What an estimate leaves of a drift, sample by sample, without noise."""
    share = np.arange(SAMPLES)[:, None] / (SAMPLES + SILENT)
    powers = np.arange(1, len(numbers))
    error = np.zeros((SAMPLES, 4, 1))
    error[:, 0] = numbers[0] + (share**powers @ numbers[1:])[:, None]
    error[:, 2] = (share ** (powers - 1) @ (powers * numbers[1:]))[:, None] / LENGTH
    return np.abs(error - estimate(error)).mean(axis=(0, 2))[[0, 2]]


@pytest.mark.parametrize(
    "estimate",
    [*(lambda y, left=left: (1 - left) * y for left in (0.0, 0.37, 1.0, 1.5)),
     times_gain(GAIN), smoothed],
)  # fmt: skip
def test_a_filter_leaves_what_it_leaves_sample_by_sample(estimate: Estimate) -> None:
    correction = Correction.of(estimate, SAMPLES, (0.0, 0.0))
    expected = np.array([left_by_hand(numbers, estimate) for numbers in DRIFTS])
    assert correction.cells(FAMILY, DRIFTS) == pytest.approx(expected, rel=1e-9, abs=1e-11)


def test_the_first_samples_may_be_left_out() -> None:
    # of a drift that grows in position, the later samples have the larger mean
    whole = Correction.of(lambda y: 0 * y, SAMPLES, NOISE)
    late = Correction.of(lambda y: 0 * y, SAMPLES, NOISE, first=SAMPLES - 1)
    numbers = [[0.0, 6.0, 0.0, 0.0]]
    assert late.cells(FAMILY, numbers)[0, 0] == pytest.approx(6 * (SAMPLES - 1) / 60)
    assert whole.cells(FAMILY, numbers)[0, 0] == pytest.approx(6 * (SAMPLES - 1) / 2 / 60)


def test_the_network_itself_has_the_mean_of_a_normal_number() -> None:
    network = Correction.of(lambda y: y, SAMPLES, NOISE)
    expected = np.sqrt(2 / np.pi) * np.array(NOISE)
    assert network.cells(FAMILY, DRIFTS) == pytest.approx(np.tile(expected, (2, 1)))


def test_noise_about_a_drift_is_the_integral_over_its_density() -> None:
    numbers = np.array([[0.3, 0.0, 0.0, 0.0]])
    half = Correction.of(lambda y: 0.5 * y, SAMPLES, NOISE)
    density = norm(0.15, 0.5 * NOISE[0]).pdf
    expected = quad(lambda x: abs(x) * density(x), -2, 2, points=[0.0])[0]
    assert half.cells(FAMILY, numbers)[0, 0] == pytest.approx(expected, rel=1e-6)


def test_drawn_cells_have_the_expected_means() -> None:
    correction = Correction.of(smoothed, SAMPLES, NOISE, first=3)
    numbers = np.tile([0.2, -0.9, 1.0, 0.1], (4000, 1))
    drawn = correction.draw_cells(FAMILY, numbers, np.random.default_rng(1))
    error = drawn.std(axis=0) / np.sqrt(len(drawn))
    expected = correction.cells(FAMILY, numbers[:1])[0]
    assert np.all(np.abs(drawn.mean(axis=0) - expected) < 4 * error)
    assert np.all(drawn.std(axis=0) > 0.02 * expected)


def test_starts_have_the_printed_size() -> None:
    cells = [5.0, 0.8, 9.0, 1.2]
    starts = FAMILY.draw_starts(cells, 4000, np.random.default_rng(2))
    assert FAMILY.cells(starts)[:, 1] == pytest.approx(0.8)
    assert starts[:, 0].std() == pytest.approx(5.0, rel=0.05)
    assert abs(starts[:, 0].mean()) < 4 * 5.0 / np.sqrt(4000)
    # as many velocities rise as fall
    assert np.mean(starts[:, 2] > 0) == pytest.approx(0.5, abs=0.04)


def test_a_planted_drift_is_found_up_to_its_sign() -> None:
    for numbers in DRIFTS:
        cells = FAMILY.cells([numbers])[0]
        starts = FAMILY.draw_starts(cells, 60, np.random.default_rng(3))
        met = fit_drifts(FAMILY, cells, starts).meeting(1e-6)
        assert FAMILY.cells(met) == pytest.approx(np.tile(cells, (len(met), 1)), rel=1e-5)
        distance = np.minimum(abs(met - numbers), abs(met + numbers)).max(axis=1)
        assert distance.min() < 1e-5
        # four cells do not have one drift alone
        assert distance.max() > 1


def test_a_planted_filter_is_told_from_a_rival() -> None:
    """The filter that made the cells fits them; one with memory, on the same starts, does not."""
    truth = Correction.of(times_gain(GAIN), SAMPLES, NOISE)
    rival = Correction.of(smoothed, SAMPLES, NOISE)
    cells = np.append(FAMILY.cells(DRIFTS[:1])[0], truth.cells(FAMILY, DRIFTS[:1])[0])
    starts = FAMILY.draw_starts(cells[:4], 40, np.random.default_rng(5))
    best, other = (fit_drifts(FAMILY, cells, starts, c).best() for c in (truth, rival))
    assert best == pytest.approx(np.ones(6), abs=1e-5)
    assert np.abs(np.log(other)).max() > 0.5


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        (lambda: DriftFamily(0.0), "period"),
        (lambda: DriftFamily(0.2, samples=1), "samples"),
        (lambda: DriftFamily(0.2, silent=0), "silent"),
        (lambda: DriftFamily(0.2, degree=0), "degree"),
        (lambda: FAMILY.cells([[1.0, 2.0]]), "numbers"),
        (lambda: FAMILY.draw_starts([1, 1, 1], 3, np.random.default_rng()), "cells"),
        (lambda: fit_drifts(FAMILY, [1, 1, 0, 1], DRIFTS), "cells"),
        (lambda: fit_drifts(FAMILY, [1, 1, 1, 1, 1, 1], DRIFTS), "cells"),
        (lambda: Correction.of(lambda y: y, SAMPLES, (-1, 1)), "noise"),
        (lambda: Correction.of(lambda y: y, SAMPLES, NOISE, first=SAMPLES), "first"),
        (lambda: Correction.of(lambda y: y**2, SAMPLES, NOISE), "estimate"),
        (lambda: Correction.of(lambda y: y + 1, SAMPLES, NOISE), "estimate"),
        (lambda: Correction.of(lambda y: y[:, ::-1], SAMPLES, NOISE), "estimate"),
        (lambda: Correction.of(lambda y: y, 9, NOISE).cells(FAMILY, DRIFTS), "family"),
    ],
)
def test_what_is_refused(wrong: Callable[[], object], name: str) -> None:
    with pytest.raises(ParameterError, match=f"^{name} "):
        wrong()
