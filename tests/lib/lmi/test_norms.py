"""Norms against closed forms, another library, and one another."""

from __future__ import annotations

import warnings
from typing import Any

import control
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import hinf_norm, largest_singular_value, norms, spectral_radius
from inswsn_lib.lmi.norms import least_level, of_size_one, swept_peak

ONE, HALF = [[1.0]], [[0.5]]
System = tuple[np.ndarray, np.ndarray, np.ndarray]


def stable_system(seed: int, n: int, p: int, q: int) -> System:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A *= rng.uniform(0.05, 0.98) / np.abs(np.linalg.eigvals(A)).max()
    return A, rng.normal(size=(n, p)), rng.normal(size=(q, n))


def test_the_radius_of_a_rotation() -> None:
    """Eigenvalues 3 +- 4 j, and a real one that is smaller than their modulus."""
    assert spectral_radius([[3, -4, 0], [4, 3, 0], [0, 0, -4.5]]) == pytest.approx(5)


def test_singular_values_of_a_lag_by_hand() -> None:
    """|2 * 3 / (e^jw - 1/2)| at w = 0, pi / 2 and pi."""
    sizes = largest_singular_value([[0.5]], [[2.0]], [[3.0]], [0.0, np.pi / 2, np.pi])
    assert sizes == pytest.approx([12.0, 6 / 1.25**0.5, 4.0])


def test_a_first_order_lag_by_hand() -> None:
    # |1 / (e^jw - a)| is largest at w = 0 for a > 0, at w = pi for a < 0
    for a in (0.9, -0.9, 0.0, 0.5):
        assert hinf_norm([[a]], [[2.0]], [[3.0]]) == pytest.approx(6 / (1 - abs(a)), rel=1e-9)


def test_a_sharp_resonance_between_grid_points() -> None:
    # poles r e^(+-j phi): with C B chosen so that G(z) = 1 / ((z - p)(z - p*))
    r, phi = 1 - 1e-6, 1.2345
    A = [[2 * r * np.cos(phi), -(r**2)], [1.0, 0.0]]
    z = np.exp(1j * (phi + np.linspace(-5e-6, 5e-6, 20_001)))
    pole = r * np.exp(1j * phi)
    peak = np.abs(1 / ((z - pole) * (z - pole.conjugate()))).max()
    assert hinf_norm(A, [[1.0], [0.0]], [[0.0, 1.0]]) == pytest.approx(peak, rel=1e-6)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 3), st.integers(1, 3))
def test_the_norm_agrees_with_control(seed: int, n: int, p: int, q: int) -> None:
    A, B, C = stable_system(seed, n, p, q)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        expected = control.norm(control.ss(A, B, C, np.zeros((q, p)), True), p="inf", tol=1e-9)
    assert hinf_norm(A, B, C) == pytest.approx(expected, rel=1e-6)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_units_scale_the_norm(seed: int, a: float, b: float) -> None:
    A, B, C = stable_system(seed, 3, 2, 2)
    scale = np.diag([1.0, a, b])
    back = np.linalg.inv(scale)
    norm = hinf_norm(A, B, C)
    assert hinf_norm(scale @ A @ back, scale @ B, C @ back) == pytest.approx(norm, rel=1e-6)
    for b_, c in ((1e-200, 1.0), (1e200, 1.0), (1e-200, 1e-90)):  # their squares are no numbers
        assert hinf_norm(A, b_ * B, c * C) == pytest.approx(norm * b_ * c, rel=1e-9)


def test_what_has_no_norm_and_what_has_none_to_speak_of() -> None:
    for unstable in (1.0, -1.0, 1.01):
        assert hinf_norm([[unstable]], [[1.0]], [[1.0]]) == np.inf
    assert hinf_norm([[0.5]], [[0.0]], [[1.0]]) == hinf_norm([[0.5]], [[1.0]], [[0.0]]) == 0
    B, C, size = of_size_one(np.array([[-4.0, 2.0]]), np.zeros((1, 1)))
    assert (B.tolist(), C.tolist(), size) == ([[-1.0, 0.5]], [[0.0]], 4.0)


def test_the_norm_is_found_from_a_level_below_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sweep alone finds nearly every norm; from nine tenths of it the crossings must."""
    expected = []
    for seed in range(30):
        system = stable_system(seed, 4, 2, 2)
        norm = hinf_norm(*system)
        sizes = largest_singular_value(*system, np.linspace(0, np.pi, 200))
        if sizes.min() < 0.85 * norm:  # else nothing crosses the lower level
            expected.append((system, norm))
    assert len(expected) > 15
    monkeypatch.setattr(norms, "swept_peak", lambda *given: 0.9 * swept_peak(*given))
    for system, norm in expected:
        assert hinf_norm(*system) == pytest.approx(norm, rel=1e-9)


@pytest.mark.parametrize("where", [0.0, 0.7, np.pi])
def test_the_sweep_finds_a_narrow_peak_where_a_pole_is(where: float) -> None:
    """A bell 1e-6 wide, half a width away from the pole, beside many that are lower."""
    width = 1e-6
    top = np.clip(where + width / 2, 0, np.pi)

    def bells(angles: np.ndarray) -> np.ndarray:
        narrow = 2 / (1 + ((angles - top) / width) ** 2)
        return np.asarray(np.maximum(narrow, 1 + 0.5 * np.cos(50 * angles)))

    pole = (1 - width) * np.exp(1j * where)
    assert swept_peak(bells, np.array([pole, 0.3])) == pytest.approx(2, rel=1e-8)
    # and one between the points of the grid
    wide = swept_peak(lambda angles: 1 / (1 + (angles - 0.9 * where) ** 2), np.array([0.0]))
    assert wide == pytest.approx(1, abs=1e-13)


def test_the_least_level_is_approached_from_above() -> None:
    for low, high in ((0.0, 1.0), (3.0, 3.5), (1e-3, 50.0)):
        found = least_level(lambda level: level >= np.pi, low, high, 1e-6, doublings=2)
        assert np.pi <= found <= np.pi * (1 + 1e-6)
    assert least_level(lambda level: level >= np.pi, 0.5, 1.0, 1e-6, doublings=1) == np.inf
    assert least_level(lambda level: level >= 4, 0.5, 1.0, 1e-9, doublings=2) == pytest.approx(4)
    asked: list[float] = []
    least_level(lambda level: bool(asked.append(level)) or level >= 4, 0.5, 1.0, 0.1, 2)
    assert asked[:4] == [1.0, 2.0, 4.0, 3.0]  # what is known not to hold is the new lower end


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: spectral_radius(np.ones((2, 3))), "A must be"),
        (lambda: hinf_norm(np.ones((2, 3)), ONE, ONE), "A must be"),
        (lambda: hinf_norm(np.eye(2), ONE, np.eye(2)), "B must be"),
        (lambda: hinf_norm(np.eye(2), np.eye(2), ONE), "C must be"),
        (lambda: hinf_norm(HALF, ONE, ONE, 1e-15), "relative .* at least 1e-14 and below 1"),
        (lambda: hinf_norm(HALF, ONE, ONE, 1.0), "relative must be"),
        (lambda: largest_singular_value(np.ones((2, 3)), ONE, ONE, [0.0]), "A must be"),
        (lambda: largest_singular_value(np.eye(2), ONE, np.eye(2), [0.0]), "B must be"),
        (lambda: largest_singular_value(np.eye(2), np.eye(2), ONE, [0.0]), "C must be"),
        (lambda: largest_singular_value(HALF, ONE, ONE, 0.0), r"angles must be .*\(k,\)"),
    ],
)
def test_what_cannot_be_is_refused(call: Any, said: str) -> None:
    with pytest.raises(ParameterError, match=f"^{said}"):
        call()
