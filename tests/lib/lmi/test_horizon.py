"""Gains over a finite horizon, against the singular values of one big matrix and by simulation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import (
    buildable_system,
    design_filter,
    enumerated_gain,
    finite_horizon_gain,
    hinf_norm,
    mean_square_radius,
    stochastic_gain,
    worst_disturbance,
)
from inswsn_lib.models import ErrorModel


def impulse_matrix(A: np.ndarray, B: np.ndarray, L: np.ndarray, steps: int) -> np.ndarray:
    """Return the map from all disturbances to all outputs: block k, j is L A^(k-j-1) B."""
    blocks = np.zeros((steps + 1, len(L), steps, B.shape[1]))
    for k in range(steps + 1):
        for j in range(k):
            blocks[k, :, j] = L @ np.linalg.matrix_power(A, k - j - 1) @ B
    return blocks.reshape((steps + 1) * len(L), steps * B.shape[1])


def random_system(seed: int, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((3, 3))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    return A, rng.standard_normal((3, 2)), rng.standard_normal((2, 3))


@given(seed=st.integers(0, 10**6), radius=st.floats(0.1, 1.3), steps=st.integers(1, 12))
def test_without_jitter_it_is_a_singular_value(seed: int, radius: float, steps: int) -> None:
    """Stable or not: over a finite horizon every system has a gain."""
    A, B, L = random_system(seed, radius)
    exact = np.linalg.svd(impulse_matrix(A, B, L, steps), compute_uv=False)[0]
    assert finite_horizon_gain(A, np.zeros((3, 3)), B, L, steps) == pytest.approx(exact, rel=1e-7)


@given(seed=st.integers(0, 10**6), steps=st.integers(1, 12))
def test_the_worst_disturbance_attains_the_gain(seed: int, steps: int) -> None:
    A, B, L = random_system(seed, 0.9)
    worst = worst_disturbance(A, np.zeros((3, 3)), B, L, steps)
    x, s, spent, seen = np.zeros(3), worst.first, 0.0, 0.0
    for k in range(steps):
        if k:
            s = worst.feedback[k - 1] @ x
        spent += s @ s
        x = A @ x + B @ s
        seen += np.sum((L @ x) ** 2)
    assert np.sqrt(seen / spent) == pytest.approx(worst.gain, rel=1e-4)


def test_with_jitter_the_mean_energy_attains_the_gain() -> None:
    """A scalar plant, all signs of beta of equal weight: 2^8 ways, so that the mean is exact."""
    A, E, B, L = ([[0.9]], [[0.4]], [[1.0]], [[1.0]])
    steps = 8
    worst = worst_disturbance(A, E, B, L, steps)
    signs = 1 - 2.0 * ((np.arange(2**steps)[:, None] >> np.arange(steps)) & 1)
    x, spent, seen = np.zeros(2**steps), 0.0, 0.0
    for k in range(steps):
        s = worst.first[0] * np.ones_like(x) if k == 0 else worst.feedback[k - 1, 0, 0] * x
        spent += np.mean(s**2)
        x = (0.9 + 0.4 * signs[:, k]) * x + s
        seen += np.mean(x**2)
    assert np.sqrt(seen / spent) == pytest.approx(worst.gain, rel=1e-4)


def test_it_rises_with_the_horizon_to_the_gain_over_all_time() -> None:
    model = ErrorModel.p1(0.2, 0.05)
    design = design_filter(model)
    B = np.hstack([model.B, -design.gain @ model.D])
    gains = [finite_horizon_gain(design.A_f, model.E, B, model.L, n) for n in (1, 2, 5, 20, 80)]
    assert gains == sorted(gains)
    assert gains[-1] == pytest.approx(stochastic_gain(design.A_f, model.E, B, model.L), rel=1e-3)
    assert gains[0] == pytest.approx(np.linalg.norm(model.L @ B, 2))


def test_the_filter_that_can_be_built_has_no_gain_over_all_time_for_p1() -> None:
    """Its jitter multiplies an integrator chain; contraction or a finite horizon repairs it."""
    model = ErrorModel.p1(0.2, 0.0012)
    gain = design_filter(ErrorModel.p1(0.2)).gain
    A, E, B, L = buildable_system(model, gain)
    assert mean_square_radius(A, E) >= 1
    assert stochastic_gain(A, E, B, L) == np.inf
    over = [finite_horizon_gain(A, E, B, L, steps) for steps in (50, 100, 200, 400)]
    assert over == sorted(over)
    assert over[3] ** 2 - over[2] ** 2 > 2 * (over[2] ** 2 - over[1] ** 2) > 0
    forgetting = model.contracted(0.95)
    assert pytest.approx(0.95 * model.A) == forgetting.A
    assert np.isfinite(stochastic_gain(*buildable_system(forgetting, gain)))


def test_without_jitter_the_buildable_system_is_that_of_the_error() -> None:
    model = ErrorModel.p1(0.2)
    design = design_filter(model)
    A, E, B, L = buildable_system(model, design.gain)
    assert not E.any()
    # the state is beside it and does not enter z
    error = hinf_norm(design.A_f, np.hstack([model.B, -design.gain @ model.D]), model.L)
    zero, long = np.zeros((8, 8)), 60
    assert finite_horizon_gain(A, zero, B, L, long) == pytest.approx(error, rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"steps": 0}, "steps is 0"),
        ({"steps": 2.5}, "steps is 2.5"),
        ({"steps": True}, "steps is True"),
        ({"relative": 0.0}, "relative is 0"),
        ({"relative": float("nan")}, "relative is nan"),
        ({"L": np.ones((0, 3))}, "A, B, C is"),
        ({"A": [[1j, 0, 0]] * 3}, "A, B, C is"),
        ({"A": [[1, 2], [3]]}, "A, B, C is"),
        ({"E": np.eye(2)}, "E is"),
        ({"E": np.full((3, 3), np.nan)}, "E is"),
        ({"B": np.eye(2)}, "A, B, C is"),
    ],
)
def test_what_cannot_be_is_refused(changes: dict[str, object], said: str) -> None:
    A, B, L = random_system(1, 0.5)
    given_ = {"A": A, "E": np.zeros((3, 3)), "B": B, "L": L, "steps": 3} | changes
    with pytest.raises(ParameterError, match=said):
        finite_horizon_gain(**given_)  # type: ignore[arg-type]
    if not {"steps", "relative"} & set(changes):
        with pytest.raises(ParameterError, match=said):
            worst_disturbance(**given_)  # type: ignore[arg-type]


def test_no_output_or_no_input_has_no_gain() -> None:
    A, B, L = random_system(2, 0.5)
    zero = np.zeros((3, 3))
    assert finite_horizon_gain(A, zero, B, 0 * L, 4) == 0
    assert finite_horizon_gain(A, zero, 0 * B, L, 4) == 0
    none = worst_disturbance(A, zero, B, 0 * L, 4)
    assert none.gain == 0
    assert none.feedback.shape == (3, 2, 3)


def test_the_buildable_system_is_plant_and_filter_step_by_step() -> None:
    model = ErrorModel.p1(0.3, 0.2, process_noise=(0.5, 0.4), measurement_noise=(0.3, 0.2))
    gain = design_filter(model).gain
    A, E, B, _ = buildable_system(model, gain)
    rng = np.random.default_rng(3)
    x, estimate, both = np.zeros(4), np.zeros(4), np.zeros(8)
    for _ in range(20):
        w, v, beta = rng.standard_normal(4), rng.standard_normal(4), rng.standard_normal()
        y = model.C @ x + model.D @ v
        estimate = (model.A - gain @ model.C) @ estimate + gain @ y
        x = (model.A + model.E * beta) @ x + model.B @ w
        both = (A + E * beta) @ both + B @ np.concatenate([w, v])
        assert both == pytest.approx(np.concatenate([x - estimate, x]), abs=1e-9)


def test_the_gain_is_proportional_to_input_and_output() -> None:
    A, B, L = random_system(4, 0.9)
    E = 0.1 * np.ones((3, 3))
    gain = finite_horizon_gain(A, E, B, L, 6)
    for b, c in ((1e-200, 1.0), (1e-150, 1e140), (1e200, 1e-100)):
        assert finite_horizon_gain(A, E, b * B, c * L, 6) == pytest.approx(gain * b * c, rel=1e-6)
        worst = worst_disturbance(A, E, b * B, c * L, 6)
        assert worst.gain == pytest.approx(gain * b * c, rel=1e-6)
        # the state is b times larger, so the feedback is b times smaller
        one = worst_disturbance(A, E, B, L, 6).feedback
        assert b * worst.feedback == pytest.approx(one, abs=1e-3 * np.abs(one).max())


def test_a_gain_that_is_no_number_is_refused() -> None:
    with pytest.raises(ParameterError, match="steps is 600"):
        finite_horizon_gain([[2.0]], [[0.0]], [[1.0]], [[1.0]], 600)


def test_a_gain_of_another_shape_is_refused() -> None:
    for gain in (np.eye(3), np.full((4, 4), np.nan)):
        with pytest.raises(ParameterError, match="gain is"):
            buildable_system(ErrorModel.p1(0.2), gain)


@pytest.mark.parametrize("factor", [0.0, 1.01, float("nan")])
def test_a_factor_that_does_not_contract_is_refused(factor: float) -> None:
    with pytest.raises(ParameterError, match="factor is"):
        ErrorModel.p1(0.2).contracted(factor)


@given(seed=st.integers(0, 10**6), steps=st.integers(1, 6))
def test_with_jitter_it_is_a_singular_value_over_all_courses(seed: int, steps: int) -> None:
    A, B, L = random_system(seed, 0.8)
    E = 0.3 * np.random.default_rng(seed).standard_normal((3, 3))
    counted = enumerated_gain(A, E, B, L, steps)
    assert counted == pytest.approx(finite_horizon_gain(A, E, B, L, steps), rel=1e-6)


def test_the_enumeration_without_jitter_is_that_of_one_course() -> None:
    A, B, L = random_system(3, 0.9)
    exact = np.linalg.svd(impulse_matrix(A, B, L, 5), compute_uv=False)[0]
    assert enumerated_gain(A, np.zeros((3, 3)), B, L, 5) == pytest.approx(exact)


def test_a_scalar_enumeration_by_hand() -> None:
    """Two steps of x+ = (a + e beta) x + s: the map of (s_0, s_1) to (x_1, x_2) in the mean."""
    a, e = 0.5, 0.7
    # x_1 = s_0; E x_2^2 = (a^2 + e^2) s_0^2 + 2 a s_0 s_1 + s_1^2
    energy = np.array([[1 + a**2 + e**2, a], [a, 1.0]])
    expected = np.linalg.eigvalsh(energy).max() ** 0.5
    assert enumerated_gain([[a]], [[e]], [[1.0]], [[1.0]], 2) == pytest.approx(expected)


def test_what_cannot_be_enumerated_is_refused() -> None:
    A, B, L = random_system(1, 0.5)
    zero = np.zeros((3, 3))
    for steps in (0, 9):
        with pytest.raises(ParameterError, match="steps is"):
            enumerated_gain(A, zero, B, L, steps)
    with pytest.raises(ParameterError, match="E is 'a stack of 2'"):
        enumerated_gain(A, np.stack([zero, zero]), B, L, 2)
