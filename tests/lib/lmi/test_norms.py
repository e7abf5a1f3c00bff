"""Norms against closed forms, another library, and one another."""

from __future__ import annotations

import warnings

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import (
    hinf_norm,
    largest_singular_value,
    mean_square_radius,
    norms,
    riccati_gain_below,
    spectral_radius,
    stochastic_gain,
)


def stable_system(seed: int, n: int, p: int, q: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A *= rng.uniform(0.05, 0.98) / spectral_radius(A)
    return A, rng.normal(size=(n, p)), rng.normal(size=(q, n))


def test_a_first_order_lag_by_hand() -> None:
    # |1 / (e^jw - a)| is largest at w = 0 for a > 0, at w = pi for a < 0
    for a in (0.9, -0.9, 0.0, 0.5):
        assert hinf_norm([[a]], [[2.0]], [[3.0]]) == pytest.approx(6 / (1 - abs(a)), rel=1e-9)


def test_a_sharp_resonance_between_grid_points() -> None:
    # poles r e^(+-j phi): with C B chosen so that G(z) = 1 / ((z - p)(z - p*))
    r, phi = 1 - 1e-6, 1.2345
    A = [[2 * r * np.cos(phi), -(r**2)], [1.0, 0.0]]
    angles = phi + np.linspace(-5e-6, 5e-6, 20_001)
    z = np.exp(1j * angles)
    pole = r * np.exp(1j * phi)
    peak = np.abs(1 / ((z - pole) * (z - pole.conjugate()))).max()
    assert hinf_norm(A, [[1.0], [0.0]], [[0.0, 1.0]]) == pytest.approx(peak, rel=1e-6)


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 3), st.integers(1, 3))
def test_the_norm_is_the_top_of_a_fine_sweep(seed: int, n: int, p: int, q: int) -> None:
    A, B, C = stable_system(seed, n, p, q)
    norm = hinf_norm(A, B, C)
    sweep = largest_singular_value(A, B, C, np.linspace(0, np.pi, 4001)).max()
    assert sweep <= norm * (1 + 1e-9)
    # a sweep misses at most what the slope allows between its points
    assert norm <= sweep * 1.01 or spectral_radius(A) > 0.95


def test_the_norm_agrees_with_control() -> None:
    for seed in range(20):
        A, B, C = stable_system(seed, 4, 2, 2)
        system = control.ss(A, B, C, np.zeros((2, 2)), True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            expected = control.norm(system, p="inf", tol=1e-9)
        assert hinf_norm(A, B, C) == pytest.approx(expected, rel=1e-6)


@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_units_scale_the_norm(seed: int, a: float, b: float) -> None:
    A, B, C = stable_system(seed, 3, 2, 2)
    scale = np.diag([1.0, a, b])
    turned = hinf_norm(scale @ A @ np.linalg.inv(scale), scale @ B, C @ np.linalg.inv(scale))
    assert turned == pytest.approx(hinf_norm(A, B, C), rel=1e-6)


def test_an_unstable_system_has_no_norm() -> None:
    assert hinf_norm([[1.0]], [[1.0]], [[1.0]]) == np.inf
    assert stochastic_gain([[0.9]], [[0.5]], [[1.0]], [[1.0]]) == np.inf  # 0.81 + 0.25 > 1
    assert (
        hinf_norm([[0.5]], [[0.0]], [[1.0]]) == stochastic_gain([[0.5]], [[0]], [[0]], [[1]]) == 0
    )


def test_the_scalar_stochastic_gain_by_hand() -> None:
    """x+ = (a + e beta) x + s, z = x has the gain 1 / (sqrt(1 - e^2) - |a|)."""
    for a, e in ((0.0, 0.0), (0.0, 0.3), (0.0, 0.8), (0.5, 0.0), (0.5, 0.3), (-0.2, 0.6)):
        expected = 1 / ((1 - e**2) ** 0.5 - abs(a))
        assert stochastic_gain([[a]], [[e]], [[1.0]], [[1.0]]) == pytest.approx(expected, rel=1e-5)


def test_a_mode_that_is_hardly_seen_still_counts() -> None:
    for A, E in ((np.diag([0.5, 1.0]), np.zeros((2, 2))), (np.diag([0.5, 0.9]), np.diag([0, 0.6]))):
        assert mean_square_radius(A, E) >= 1
        assert not riccati_gain_below(A, E, np.eye(2), np.diag([1.0, 1e-9]), 3.0)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_without_jitter_the_two_routes_agree(seed: int, n: int) -> None:
    A, B, C = stable_system(seed, n, 2, 2)
    norm = hinf_norm(A, B, C)
    zero = np.zeros((n, n))
    assert riccati_gain_below(A, zero, B, C, norm * 1.01)
    assert not riccati_gain_below(A, zero, B, C, norm * 0.999)


@pytest.mark.parametrize(
    ("A", "B", "C"),
    [
        (np.eye(2), np.ones((3, 1)), np.ones((1, 2))),
        (np.ones((2, 3)), np.ones((2, 1)), np.ones((1, 2))),
        (np.full((2, 2), np.nan), np.ones((2, 1)), np.ones((1, 2))),
    ],
)
def test_what_does_not_fit_is_refused(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> None:
    with pytest.raises(ParameterError, match="A, B, C"):
        hinf_norm(A, B, C)


@pytest.mark.parametrize(("a", "e", "f"), [(0.0, 0.3, 0.4), (0.5, 0.2, 0.1), (-0.3, 0.6, 0.2)])
def test_independent_multiplicative_noises_add_their_squares(a: float, e: float, f: float) -> None:
    """A scalar with two of them is one whose e^2 is the sum: 1 / (sqrt(1 - e^2 - f^2) - |a|)."""
    both = np.array([[[e]], [[f]]])
    expected = 1 / ((1 - e**2 - f**2) ** 0.5 - abs(a))
    assert stochastic_gain([[a]], both, [[1.0]], [[1.0]]) == pytest.approx(expected, rel=1e-5)
    assert mean_square_radius([[a]], both) == pytest.approx(a**2 + e**2 + f**2)


def test_one_multiplicative_noise_is_a_stack_of_one() -> None:
    A, B, C = stable_system(3, 3, 2, 2)
    A, E = 0.5 * A, 0.2 * np.arange(9).reshape(3, 3) / 8
    one, stack = (stochastic_gain(A, e, B, C) for e in (E, E[None]))
    assert one == stack
    assert stack < stochastic_gain(A, np.stack([E, E]), B, C)


@pytest.mark.parametrize("E", [np.eye(3), np.zeros((2, 3, 3)), np.full((2, 2), np.nan), [1.0]])
def test_a_multiplicative_noise_that_does_not_fit_is_refused(E: object) -> None:
    with pytest.raises(ParameterError, match="E is"):
        mean_square_radius(np.eye(2) / 2, E)  # type: ignore[arg-type]


def test_the_norm_is_found_from_a_level_below_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sweep alone finds nearly every norm; from nine tenths of it the crossings must."""
    expected = []
    for seed in range(60):
        system = stable_system(seed, 4, 2, 2)
        norm = hinf_norm(*system)
        sizes = largest_singular_value(*system, np.linspace(0, np.pi, 200))
        if sizes.min() < 0.85 * norm:  # else nothing crosses the lower level
            expected.append((system, norm))
    assert len(expected) > 30
    top = norms._top_of_sweep
    monkeypatch.setattr(norms, "_top_of_sweep", lambda A, B, C: 0.9 * top(A, B, C))
    for system, norm in expected:
        assert hinf_norm(*system) == pytest.approx(norm, rel=1e-7)


def test_sizes_that_cannot_be_squared() -> None:
    A, B, C = stable_system(2, 3, 2, 2)
    norm = hinf_norm(A, B, C)
    for b, c in ((1e-200, 1.0), (1e200, 1.0), (1e-200, 1e-90)):
        assert hinf_norm(A, b * B, c * C) == pytest.approx(norm * b * c, rel=1e-9)
        expected = stochastic_gain(A, np.zeros((3, 3)), B, C) * b * c
        assert stochastic_gain(A, np.zeros((3, 3)), b * B, c * C) == pytest.approx(expected)


def test_a_mode_that_is_not_seen_must_be_stable() -> None:
    A, L = np.diag([0.5, 1.1]), np.diag([1.0, 0.0])
    assert not riccati_gain_below(A, np.zeros((2, 2)), np.eye(2), L, 10.0)
    assert stochastic_gain(A, np.zeros((2, 2)), np.eye(2), L) == np.inf


def test_what_the_iteration_cannot_tell_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(norms, "_DOUBLINGS", 1)
    with pytest.raises(ParameterError, match="too near instability"):
        stochastic_gain([[0.99999]], [[1e-3]], [[1.0]], [[1.0]])


@pytest.mark.parametrize("relative", [0.0, -1.0, 1.0, float("nan"), 1e-17])
def test_an_accuracy_that_cannot_be_is_refused(relative: float) -> None:
    for norm in (
        lambda: hinf_norm([[0.5]], [[1.0]], [[1.0]], relative),
        lambda: stochastic_gain([[0.5]], [[0.1]], [[1.0]], [[1.0]], relative),
    ):
        with pytest.raises(ParameterError, match="relative is"):
            norm()


@pytest.mark.parametrize(
    "matrix", [[1.0], 3.0, None, [[1.0, 2.0], [3.0]], [[1j]], [["a"]], np.zeros((0, 0)), [[np.nan]]]
)
def test_a_matrix_that_is_none_is_refused(matrix: object) -> None:
    for use in (spectral_radius, lambda A: hinf_norm(A, [[1.0]], [[1.0]])):
        with pytest.raises(ParameterError, match="A"):
            use(matrix)
    with pytest.raises(ParameterError, match="A is"):
        mean_square_radius(matrix, [[0.0]])  # type: ignore[arg-type]


def test_angles_and_gains_that_are_none_are_refused() -> None:
    for angles in (np.zeros((2, 2)), [np.nan]):
        with pytest.raises(ParameterError, match="angles is"):
            largest_singular_value([[0.5]], [[1.0]], [[1.0]], angles)
    with pytest.raises(ParameterError, match="gain is nan"):
        riccati_gain_below([[0.5]], [[0.0]], [[1.0]], [[1.0]], float("nan"))
    assert riccati_gain_below([[0.5]], [[0.0]], [[1.0]], [[1.0]], float("inf"))
    for A in (np.eye(3)[:2], np.ones((2, 3))):
        with pytest.raises(ParameterError, match="A is"):
            spectral_radius(A)
