"""Fusion weights against P2's inequality written out, closed forms, and their own certificates."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from scipy.linalg import block_diag, solve_discrete_lyapunov

from inswsn_lib import ErrorModel
from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import (
    FilterDesign,
    InfeasibleDesignError,
    design_filter,
    design_fusion,
    fusion,
    fusion_gain,
    fusion_system,
    hinf_norm,
)
from inswsn_lib.lmi.designs import FusionDesign, Noise, Structure

NOISES: tuple[Noise, ...] = ("common", "independent")
STRUCTURES: tuple[Structure, ...] = ("full", "block")
WALK = ErrorModel(A=[[1]], B=[[1]], C=[[1]], D=[[1]], period=1.0)
for_each_noise = pytest.mark.parametrize("noise", NOISES)
for_each_structure = pytest.mark.parametrize("structure", STRUCTURES)


def random_clusters(seed: int, count: int, L: Any = None) -> list[FilterDesign]:
    """Local filters of one random plant, each with measurements of its own."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(2, 2))
    A *= rng.uniform(0.5, 1.0) / np.abs(np.linalg.eigvals(A)).max()
    B = rng.normal(size=(2, 2))
    return [
        design_filter(
            ErrorModel(
                A=A, B=B, C=rng.normal(size=(2, 2)), D=rng.uniform(0.3, 3.0) * np.eye(2), L=L,
                period=1.0,
            )
        )
        for _ in range(count)
    ]  # fmt: skip


def stacked(designs: list[FilterDesign], noise: Noise) -> tuple[Any, Any]:
    """A~ and K of P2 (13), for either noise."""
    own = [-design.gain @ design.model.D for design in designs]
    A = block_diag(*(design.model.A - design.gain @ design.model.C for design in designs))
    if noise == "independent":
        return A, block_diag(*(np.hstack([designs[0].model.B, G]) for G in own))
    return A, np.hstack([np.vstack([d.model.B for d in designs]), block_diag(*own)])


def least_of_p2_9(designs: list[FilterDesign], noise: Noise, P: Any) -> float:
    """Return the least level of P2 (9) as it is printed, for a P that is a variable."""
    A, K = stacked(designs, noise)
    N, (rows, n), u = len(designs), designs[0].model.L.shape, K.shape[1]
    M, squared = cp.Variable((n, N * n)), cp.Variable()
    LM = designs[0].model.L @ M
    k = N * n
    F = cp.bmat(
        [
            [-P, np.zeros((k, u)), A.T @ P, LM.T],
            [np.zeros((u, k)), -squared * np.eye(u), K.T @ P, np.zeros((u, rows))],
            [P @ A, P @ K, -P, np.zeros((k, rows))],
            [LM, np.zeros((rows, u)), np.zeros((rows, k)), -np.eye(rows)],
        ]
    )
    problem = cp.Problem(
        cp.Minimize(squared), [(F + F.T) / 2 << 0, M @ np.vstack([np.eye(n)] * N) == np.eye(n)]
    )
    problem.solve(solver=cp.CLARABEL)
    return float(np.sqrt(squared.value))


def blocks(N: int, n: int) -> Any:
    rows = [[np.zeros((n, n)) for _ in range(N)] for _ in range(N)]
    for c in range(N):
        rows[c][c] = cp.Variable((n, n), symmetric=True)
    return cp.bmat(rows)


@for_each_structure
@pytest.mark.parametrize("solver", ["clarabel", "scs"])
@pytest.mark.parametrize("count", [2, 3])
def test_random_walks_by_hand(count: int, structure: Structure, solver: Any) -> None:
    """All have the gain 1: alike they weigh best, and w - (v_1 + .. + v_N) / N has the gain.

    With w_1 to w_N of their own it is (w_1 + .. + w_N - v_1 - .. - v_N) / N.
    """
    designs = [design_filter(WALK, margin=1e-6)] * count
    for noise, least in zip(NOISES, (1 + 1 / count, 2 / count), strict=True):
        design = design_fusion(designs, noise, structure, margin=0.1, solver=solver)
        assert design.gamma == pytest.approx(least**0.5, rel=1e-5)
        assert design.level == pytest.approx(1.1 * design.gamma, rel=1e-12)
        # a P of diagonal blocks bounds the variance of any weights alike
        away = 1e-3 if structure == "full" else 2e-2
        assert design.weights.ravel() == pytest.approx([1 / count] * count, abs=away)
        told = design.certificate
        assert told.norm == pytest.approx(least**0.5, rel=1e-3)
        assert told.lower * (1 - 1e-6) <= least**0.5 <= told.upper * (1 + 1e-6)
        assert told.upper / told.lower < 1.0006
        assert told.weights_sum_error <= 1e-12
        assert (design.noise, design.structure, design.solver) == (noise, structure, solver)
        assert (design.designs, design.status) == (tuple(designs), "optimal")


# the structure "block" is solved as N coupled parts: is that the same problem?
@for_each_noise
@pytest.mark.parametrize(("seed", "count"), [(0, 2), (1, 3), (3, 5)])
def test_the_parts_of_the_block_structure_add_up_to_p2_9(
    seed: int, count: int, noise: Noise
) -> None:
    designs = random_clusters(seed, count)
    expected = least_of_p2_9(designs, noise, blocks(count, 2))
    assert design_fusion(designs, noise, "block").gamma == pytest.approx(expected, rel=1e-5)


@for_each_noise
@pytest.mark.parametrize(("seed", "count"), [(0, 1), (5, 2), (1, 3)])
def test_the_small_form_is_p2_9(seed: int, count: int, noise: Noise) -> None:
    designs = random_clusters(seed, count)
    P = cp.Variable((2 * count, 2 * count), symmetric=True)
    expected = least_of_p2_9(designs, noise, P)
    assert design_fusion(designs, noise, "full").gamma == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("L", [[[1.0, 0.0]], [[1.0, 2.0], [2.0, 4.0], [0.0, 0.0]]])
@for_each_structure
@for_each_noise
def test_l_need_not_see_all_states(
    L: list[list[float]], structure: Structure, noise: Noise
) -> None:
    """Both see one direction: all but that of the weights is I / N."""
    designs = random_clusters(7, 3, L)
    P = cp.Variable((6, 6), symmetric=True) if structure == "full" else blocks(3, 2)
    design = design_fusion(designs, noise, structure)
    assert design.gamma == pytest.approx(least_of_p2_9(designs, noise, P), rel=1e-5)
    assert design.weights.sum(axis=0) == pytest.approx(np.eye(2), abs=1e-12)
    unlike = np.hstack(list(design.weights - np.eye(2) / 3))
    assert np.linalg.matrix_rank(unlike, tol=1e-9) == 1


@for_each_structure
@pytest.mark.parametrize("count", [1, 5])
def test_clusters_that_are_alike(count: int, structure: Structure) -> None:
    """Each weighs 1 / N; with noises of their own, the norm falls with the root of N."""
    local = random_clusters(11, 1)[0]
    same, equal = [local] * count, np.stack([np.eye(2) / count] * count)
    for noise in NOISES:
        design = design_fusion(same, noise, structure)
        assert design.weights == pytest.approx(equal, abs=1e-6)
        assert design.gamma == pytest.approx(fusion_gain(same, equal, noise), rel=1e-6)
        assert design.P.shape == ((2 * count,) * 2 if structure == "full" else (count, 2, 2))
    assert design.gamma == pytest.approx(local.certificate.norm / count**0.5, rel=1e-6)


@for_each_noise
@pytest.mark.parametrize("seed", [0, 2])
def test_with_a_large_margin_the_weights_have_the_least_variance(seed: int, noise: Noise) -> None:
    designs = random_clusters(seed, 3)
    A, K = stacked(designs, noise)
    back = np.linalg.inv(solve_discrete_lyapunov(A, K @ K.T))
    e = np.vstack([np.eye(2)] * 3)
    expected = np.linalg.solve(e.T @ back @ e, e.T @ back)
    away = [
        np.abs(np.hstack(list(design_fusion(designs, noise, margin=m).weights)) - expected).max()
        for m in (0.01, 1e3, 1e9)
    ]
    assert away[0] > 1e-2
    assert max(away[1:]) < 1e-4


def test_the_second_criterion_of_the_block_structure() -> None:
    """The least tr K'PK at the level, by the large inequality with a P of diagonal blocks."""
    designs = random_clusters(5, 2)
    for noise in NOISES:
        design = design_fusion(designs, noise, "block", margin=0.3)
        A, K = stacked(designs, noise)
        P, M, u = blocks(2, 2), cp.Variable((2, 4)), K.shape[1]
        F = cp.bmat(
            [
                [A.T @ P @ A - P, A.T @ P @ K, M.T],
                [K.T @ P @ A, K.T @ P @ K - design.level**2 * np.eye(u), np.zeros((u, 2))],
                [M, np.zeros((2, u)), -np.eye(2)],
            ]
        )
        problem = cp.Problem(
            cp.Minimize(cp.trace(K.T @ P @ K)),
            [(F + F.T) / 2 << 0, M[:, :2] + M[:, 2:] == np.eye(2)],
        )
        problem.solve(solver=cp.CLARABEL)
        assert np.hstack(list(design.weights)) == pytest.approx(M.value, abs=1e-4)
        cost = np.trace(K.T @ block_diag(*design.P) @ K)
        assert cost == pytest.approx(problem.value, rel=1e-5)


@for_each_structure
@for_each_noise
def test_neither_order_nor_units_change_the_weights(noise: Noise, structure: Structure) -> None:
    designs = random_clusters(21, 3)
    one = design_fusion(designs, noise, structure)
    assert np.abs(one.weights[0] - one.weights[2]).max() > 0.1
    S = np.diag([1e3, 1e-2])
    back = np.linalg.inv(S)
    others = []
    for design in designs[::-1]:
        model = replace(
            design.model, A=S @ design.model.A @ back, B=S @ design.model.B,
            C=design.model.C @ back, L=design.model.L @ back,
        )  # fmt: skip
        others.append(replace(design, model=model, gain=S @ design.gain, P=back @ design.P @ back))
    other = design_fusion(others, noise, structure)
    assert other.gamma == pytest.approx(one.gamma, rel=1e-6)
    assert back @ other.weights[::-1] @ S == pytest.approx(one.weights, abs=1e-4)


def test_the_system_is_that_of_the_filters() -> None:
    """Run the plant and the filters, and compare the fused error with the system's output."""
    rng = np.random.default_rng(5)
    designs = random_clusters(6, 3)
    model, weights = designs[0].model, rng.normal(size=(3, 2, 2))
    weights[2] = np.eye(2) - weights[0] - weights[1]
    A, B, L = fusion_system(designs, weights, "common")
    x, estimates, stack = np.zeros(2), np.zeros((3, 2)), np.zeros(6)
    for _ in range(20):
        w, xi = rng.normal(size=2), rng.normal(size=(3, 2))
        for c, design in enumerate(designs):
            y = design.model.C @ x + design.model.D @ xi[c]
            estimates[c] = design.A_f @ estimates[c] + design.gain @ y
        x = model.A @ x + model.B @ w
        stack = A @ stack + B @ np.concatenate([w, xi.ravel()])
        fused = np.einsum("cij,cj->i", weights, estimates)
        assert L @ stack == pytest.approx(model.L @ (x - fused), abs=1e-9)
    for noise in NOISES:
        for found, expected in zip(fusion_system(designs, weights, noise), stacked(designs, noise)):  # noqa: B905
            assert found == pytest.approx(expected)


@for_each_noise
def test_the_gain_of_many_clusters_is_that_of_the_stacked_system(noise: Noise) -> None:
    designs = random_clusters(8, 3) * 11  # 66 states: the sweep
    weights = np.random.default_rng(1).normal(size=(33, 2, 2))
    expected = hinf_norm(*fusion_system(designs, weights, noise))
    assert fusion_gain(designs, weights, noise) == pytest.approx(expected, rel=1e-7)
    few = fusion_gain(designs[:3], weights[:3], noise)
    assert few == hinf_norm(*fusion_system(designs[:3], weights[:3], noise))
    unstable = [replace(designs[0], gain=-3 * designs[0].gain), *designs[1:]]
    assert fusion_gain(unstable, weights, noise) == np.inf


@for_each_structure
@for_each_noise
@pytest.mark.parametrize(("process", "velocity"), [((0.0, 3e-4), 0.13), ((0.05, 0.1), 10.0)])
def test_numbers_of_a_network(
    process: tuple[float, float], velocity: float, noise: Noise, structure: Structure
) -> None:
    designs = [
        design_filter(
            ErrorModel.p1(0.02, process_noise=process, measurement_noise=(size * 0.2, velocity))
        )
        for size in (1.0, 2.0)
    ]
    design = design_fusion([*designs, designs[0]], noise, structure)
    assert design.status == "optimal"
    assert design.gamma == pytest.approx(design.certificate.lower, rel=1e-6)
    assert design.certificate.upper <= design.certificate.lower * (1 + 5.1e-4)
    assert design.gamma <= min(d.certificate.norm for d in designs) * (1 + 1e-6)
    assert design.weights[0] == pytest.approx(design.weights[2], abs=1e-3)


@for_each_structure
@pytest.mark.parametrize("size", [1e-8, 1e-10, 1e-12])
def test_units_of_a_state_that_are_far_from_those_of_another(
    size: float, structure: Structure
) -> None:
    """Noise that is small in numbers is what drives the small state."""

    def fused(S: np.ndarray) -> FusionDesign:
        back, A = np.diag(1 / np.diag(S)), np.array([[0.5, 0.0], [0.05, 0.5]])
        model = ErrorModel(
            A=S @ A @ back, B=S, C=back, D=np.eye(2), L=np.diag([1, 1.3]) @ back, period=1.0
        )
        return design_fusion([design_filter(model, margin=1e-3)] * 2, structure=structure)

    plain, other = fused(np.eye(2)), fused(np.diag([1, size]))
    assert other.gamma == pytest.approx(plain.gamma, rel=1e-6)
    assert other.certificate.lower == pytest.approx(plain.certificate.lower, rel=1e-6)


def largest_of_walks(P: np.ndarray, weights: np.ndarray, level: float) -> float:
    """Return the largest eigenvalue for two random walks of the gain 1, of one process noise.

    In the units of the library: P over its local P, the noise over the level.
    """
    K = np.array([[1.0, -1.0, 0.0], [1.0, 0.0, -1.0]]) / level
    F = np.block([
        [-P, 0 * K, weights[:, None]],
        [0 * K.T, K.T @ P @ K - np.eye(3), np.zeros((3, 1))],
        [weights[None], np.zeros((1, 3)), -np.eye(1)],
    ])  # fmt: skip
    return float(np.linalg.eigvalsh(F)[-1] / np.abs(F).max())


def test_weights_that_do_not_pass_are_told() -> None:
    """Two random walks with A_f = 0 and local P = level = 1: the units are those of the walks."""
    local = replace(design_filter(WALK), gain=np.ones((1, 1)), P=np.ones((1, 1)), level=1.0)
    P, half = np.full((2, 2), 0.25) + 0.02 * np.eye(2), np.full(2, 0.5)

    def certified(P: np.ndarray, weights: np.ndarray, level: float, upper: float = 1.0) -> Any:
        weights = weights.reshape(2, 1, 1)
        return fusion._certified((local, local), "common", weights, P, level, (1.0, upper))

    made = certified(P, half, 1.3)
    assert made.largest_eigenvalue == pytest.approx(largest_of_walks(P, half, 1.3), abs=1e-12)
    assert made.norm == pytest.approx(1.5**0.5)
    assert made.weights_sum_error == 0
    for P_, weights, level, also in (
        (0.1 * P, half, 1.3, ""),
        (P, np.array([0.5, 0.501]), 1.3, "; the weights miss the identity by 0.001"),
        (P, half, 1.2, "; the norm is 1.22474, above 1.2"),
    ):
        with pytest.raises(InfeasibleDesignError) as caught:
            certified(P_, weights, level)
        largest = largest_of_walks(P_, weights, level)
        said = f"the inequality has the eigenvalue {largest:.3g}{also}."
        said = said if largest > 1e-6 else said.partition("; ")[2]
        assert str(caught.value) == f"The design does not pass its certificate: {said}"
    assert certified(P, half, 1.3, upper=1.0009).upper == 1.0009
    with pytest.raises(InfeasibleDesignError, match=r"known to lie between 1 and 1\.0011\.$"):
        certified(P, half, 1.3, upper=1.0011)


def test_other_states_are_tried_where_the_first_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """In both states, by each solver in turn, the design is the same; the first failure is told."""
    designs, right = random_clusters(5, 2), fusion._designed
    expected = design_fusion(designs, "common", "block")
    asked: list[tuple[bool, str]] = []

    def broken(*given: Any) -> Any:
        asked.append(given[-2:])
        made = right(*given)
        assert made.gamma == pytest.approx(expected.gamma, rel=1e-6)
        assert made.weights == pytest.approx(expected.weights, abs=1e-3)
        raise InfeasibleDesignError(f"Broken {len(asked)}.")

    monkeypatch.setattr(fusion, "_designed", broken)
    with pytest.raises(InfeasibleDesignError, match=r"^Broken 1\.$"):
        design_fusion(designs, "common", "block", solver=("scs", "clarabel"))
    assert asked == [(w, by) for w in (True, False) for by in ("scs", "clarabel")]


@for_each_structure
@for_each_noise
def test_what_knows_of_the_parts_and_what_does_not_come_to_the_same(
    noise: Noise, structure: Structure
) -> None:
    designs = random_clusters(31, 3)
    structured, general = (
        design_fusion(designs, noise, structure, solver=by) for by in ("structured", "clarabel")
    )
    assert (structured.solver, general.solver) == ("structured", "clarabel")
    assert structured.gamma == pytest.approx(general.gamma, rel=1e-6)
    assert structured.weights == pytest.approx(general.weights, abs=1e-3)


def test_where_the_parts_are_not_solved_clarabel_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(_: Any) -> Any:
        raise InfeasibleDesignError("It stops.")

    monkeypatch.setattr(fusion, "solve_arrow", stopped)
    designs = random_clusters(5, 2)
    assert design_fusion(designs, structure="block").solver == "clarabel"
    with pytest.raises(InfeasibleDesignError, match=r"^It stops\.$"):
        design_fusion(designs, structure="block", solver="structured")


@for_each_noise
def test_the_largest_eigenvalue_of_an_arrow_is_that_of_the_whole_matrix(noise: Noise) -> None:
    """The P of a design as its blocks, and as one matrix."""
    designs = tuple(random_clusters(8, 3))
    design = design_fusion(designs, noise, "block")
    for level in (design.level, 0.9 * design.level):
        arrow, whole = (
            fusion._largest_eigenvalue(designs, noise, design.weights, P, level)
            for P in (design.P, block_diag(*design.P))
        )
        assert arrow == pytest.approx(whole, abs=1e-12)


#: The local filter of a position and a velocity
LOCAL = design_filter(
    ErrorModel(A=[[1.0, 0.02], [0.0, 1.0]], B=np.eye(2), C=np.eye(2), D=np.eye(2), period=0.02)
)


def other(**matrices: Any) -> FilterDesign:
    return replace(LOCAL, model=replace(LOCAL.model, **matrices))


@pytest.mark.parametrize(
    ("designs", "options", "said"),
    [
        ([], {}, "designs must be one or more designs of `design_filter` without "),
        (None, {}, "designs .* not None"),
        ([LOCAL, 1], {}, "designs must be"),
        ([LOCAL, other(A=np.eye(2))], {}, "designs .* for models that differ in A"),
        ([LOCAL, other(B=np.ones((2, 1)))], {}, "designs .* for models that differ in B"),
        ([LOCAL, LOCAL, other(L=np.ones((1, 2)))], {}, "designs .* for models that differ in L"),
        ([other(E=np.eye(2))], {}, "designs .* not for a model with jitter"),
        ([LOCAL], {"noise": "white"}, "noise .* not 'white'"),
        ([LOCAL], {"structure": ["full"]}, "structure .* not \\['full'\\]"),
        ([LOCAL], {"margin": 0}, "margin must be a number above 0 and at most 1e.09, not 0."),
        ([LOCAL], {"margin": 2e9}, "margin must be"),
        ([LOCAL], {"solver": "x"}, "solver .* not 'x'"),
        ([LOCAL], {"weights": np.eye(2)}, "weights must be"),
    ],
)
def test_what_cannot_be_fused_is_refused(designs: Any, options: dict[str, Any], said: str) -> None:
    if "weights" not in options:
        with pytest.raises(ParameterError, match=f"^{said}"):
            design_fusion(designs, **options)
    if not {"structure", "margin", "solver"} & {*options}:
        weights = [np.eye(2)] * len(designs or ())
        for function in (fusion_system, fusion_gain):
            with pytest.raises(ParameterError, match=f"^{said}"):
                function(designs, **({"weights": weights} | options))  # type: ignore[operator]


def test_a_local_filter_that_is_not_stable_is_refused() -> None:
    with pytest.raises(InfeasibleDesignError) as caught:
        design_fusion([LOCAL, replace(LOCAL, gain=-0.5 * np.eye(2))])
    assert str(caught.value) == "A local filter has the spectral radius 1.5."
