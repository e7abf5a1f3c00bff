"""Fusion weights against P2's inequality written out, closed forms, and their own certificates."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import clarabel  # type: ignore[import-untyped]
import cvxpy as cp
import numpy as np
import pytest
from scipy.linalg import block_diag, solve_discrete_lyapunov

from inswsn_lib.errors import ParameterError
from inswsn_lib.lmi import (
    FilterDesign,
    FusionDesign,
    InfeasibleDesignError,
    design_filter,
    design_fusion,
    fusion,
    fusion_gain,
    fusion_system,
    hinf_norm,
    tied_level,
)
from inswsn_lib.models import ErrorModel

NOISES = ["common", "independent"]
STRUCTURES = ["full", "block"]


def cluster(size: float = 1.0, margin: float = 0.01) -> FilterDesign:
    """The local filter of a position and a velocity, all noises identities but for a size of D."""
    A, eye = np.array([[1.0, 0.02], [0.0, 1.0]]), np.eye(2)
    model = ErrorModel(A=A, B=eye, C=eye, D=size * eye, L=eye, E=0 * eye, period=0.02)
    return design_filter(model, margin=margin)


def random_clusters(seed: int, count: int, L: Any = None) -> list[FilterDesign]:
    """Local filters of one random plant, each with measurements of its own."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(2, 2))
    A *= rng.uniform(0.5, 1.0) / np.abs(np.linalg.eigvals(A)).max()
    B = rng.normal(size=(2, 2))
    return [
        design_filter(
            ErrorModel(
                A=A, B=B, C=rng.normal(size=(2, 2)), D=rng.uniform(0.3, 3.0) * np.eye(2),
                L=np.eye(2) if L is None else np.asarray(L), E=0 * A, period=1.0,
            )
        )
        for _ in range(count)
    ]  # fmt: skip


def stacked(designs: list[FilterDesign], noise: str) -> tuple[Any, Any]:
    """A~ and K of P2 (13), for either noise."""
    own = [-design.gain @ design.model.D for design in designs]
    A = block_diag(*(design.A_f for design in designs))
    if noise == "independent":
        return A, block_diag(*(np.hstack([d.model.B, G]) for d, G in zip(designs, own)))  # noqa: B905
    return A, np.hstack([np.vstack([d.model.B for d in designs]), block_diag(*own)])


def least_of_p2_9(designs: list[FilterDesign], noise: str, P: Any) -> float:
    """Return the least level of P2 (9) as it is printed, for a P that is a variable or a number."""
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


# the structure "block" is solved as N coupled parts: is that the same problem?
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize(("seed", "count"), [(0, 2), (5, 2), (1, 3), (2, 4), (3, 6), (4, 8)])
def test_the_parts_of_the_block_structure_add_up_to_p2_9(seed: int, count: int, noise: str) -> None:
    designs = random_clusters(seed, count)
    expected = least_of_p2_9(designs, noise, blocks(count, 2))
    assert design_fusion(designs, noise, "block").gamma == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize(("seed", "count"), [(0, 1), (0, 2), (5, 2), (1, 3), (2, 4)])
def test_the_small_form_is_p2_9(seed: int, count: int, noise: str) -> None:
    designs = random_clusters(seed, count)
    P = cp.Variable((2 * count, 2 * count), symmetric=True)
    expected = least_of_p2_9(designs, noise, P)
    assert design_fusion(designs, noise, "full").gamma == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("L", [[[1.0, 0.0]], [[1.0, 2.0], [2.0, 4.0], [0.0, 0.0]]])
@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("noise", NOISES)
def test_l_need_not_see_all_states(L: list[list[float]], structure: str, noise: str) -> None:
    designs = random_clusters(7, 3, L)
    P = cp.Variable((6, 6), symmetric=True) if structure == "full" else blocks(3, 2)
    design = design_fusion(designs, noise, structure)
    assert design.gamma == pytest.approx(least_of_p2_9(designs, noise, P), rel=1e-5)
    assert design.weights.sum(axis=0) == pytest.approx(np.eye(2), abs=1e-12)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_tied_to_the_local_solutions_it_is_p2_9_with_that_p(seed: int, noise: str) -> None:
    designs = random_clusters(seed, 3)
    P = block_diag(*(design.P for design in designs))
    expected = least_of_p2_9(designs, noise, P)
    assert tied_level(designs, noise) == pytest.approx(expected, rel=1e-5)
    assert tied_level(designs, noise) >= design_fusion(designs, noise, "block").gamma


def test_values_of_another_program() -> None:
    three = [cluster(margin=1e-4)] * 3
    assert three[0].gamma == pytest.approx(1.4213, abs=1e-4)
    design = design_fusion(three, "independent", "block")
    assert design.gamma == pytest.approx(0.8206, abs=2e-4)
    assert fusion_gain(three, design.weights, "common") == pytest.approx(1.163, abs=1e-3)
    unlike = [cluster(size, 1e-4) for size in (0.5, 1.0, 2.0)]
    assert unlike[0].gamma == pytest.approx(1.1203, abs=1e-4)
    assert tied_level(unlike) == pytest.approx(2.254, abs=1e-3)
    assert design_fusion(unlike, "independent", "block").gamma == pytest.approx(0.8196, abs=2e-4)


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("count", [1, 2, 5])
def test_clusters_that_are_alike(count: int, structure: str) -> None:
    """Each weighs 1 / N; with noises of their own, the norm falls with the root of N."""
    local = random_clusters(11, 1)[0]
    same = [local] * count
    norm = hinf_norm(*fusion_system([local], [np.eye(2)]))
    for noise in ("common", "independent"):
        design = design_fusion(same, noise, structure)
        equal = np.stack([np.eye(2) / count] * count)
        assert design.weights == pytest.approx(equal, abs=1e-6)
        assert design.gamma == pytest.approx(fusion_gain(same, equal, noise), rel=1e-6)
    assert design.gamma == pytest.approx(norm / count**0.5, rel=1e-6)  # of the noise "independent"


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("noise", NOISES)
def test_a_useless_cluster_has_next_to_no_weight(noise: str, structure: str) -> None:
    design = design_fusion([cluster(), cluster(1000.0), cluster()], noise, structure)
    assert np.abs(design.weights[1]).max() < 1e-2
    assert design.weights[0] == pytest.approx(np.eye(2) / 2, abs=1e-2)


@pytest.mark.parametrize("seed", range(6))
def test_what_must_be_larger_is_larger(seed: int) -> None:
    count = 2 + seed % 3
    designs = random_clusters(100 + seed, count)
    of = {(n, s): design_fusion(designs, n, s) for n in NOISES for s in STRUCTURES}
    best = min(design.certificate.norm for design in designs)
    slack = 1 + 1e-6
    for noise in NOISES:
        assert of[noise, "full"].gamma <= of[noise, "block"].gamma * slack
        assert of[noise, "block"].gamma <= best * slack  # all weight on the best cluster
    for structure in STRUCTURES:
        common, independent = of["common", structure], of["independent", structure]
        assert common.gamma <= count**0.5 * independent.gamma * slack
    for design in of.values():
        gains = [fusion_gain(designs, design.weights, noise) for noise in NOISES]
        assert gains[0] <= count**0.5 * gains[1] * slack
        assert design.certificate.norm <= design.level * slack
        assert design.weights.sum(axis=0) == pytest.approx(np.eye(2), abs=1e-12)
        if design.structure == "full":  # exact: no weights are better than gamma
            assert design.certificate.norm >= design.gamma * (1 - 1e-5)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_with_a_large_margin_the_weights_have_the_least_variance(seed: int, noise: str) -> None:
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


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("noise", NOISES)
def test_one_cluster_keeps_its_filter(noise: str, structure: str) -> None:
    local = random_clusters(3, 1)
    design = design_fusion(local, noise, structure)
    assert design.weights[0] == pytest.approx(np.eye(2), abs=1e-12)
    assert design.gamma == pytest.approx(local[0].certificate.norm, rel=1e-6)
    assert design.P.shape == ((2, 2) if structure == "full" else (1, 2, 2))


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("noise", NOISES)
def test_the_order_of_the_clusters_is_that_of_the_weights(noise: str, structure: str) -> None:
    designs = random_clusters(21, 3)
    one = design_fusion(designs, noise, structure)
    other = design_fusion(designs[::-1], noise, structure)
    assert np.abs(one.weights[0] - one.weights[2]).max() > 0.1
    assert other.weights[::-1] == pytest.approx(one.weights, abs=1e-4)


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("noise", NOISES)
def test_units_change_neither_gamma_nor_the_weights(noise: str, structure: str) -> None:
    designs = random_clusters(22, 3)
    S = np.diag([1e3, 1e-2])
    back = np.linalg.inv(S)
    others = []
    for design in designs:
        model = replace(
            design.model, A=S @ design.model.A @ back, B=S @ design.model.B,
            C=design.model.C @ back, L=design.model.L @ back,
        )  # fmt: skip
        others.append(
            replace(design, model=model, gain=S @ design.gain, A_f=S @ design.A_f @ back,
                    P=back @ design.P @ back)
        )  # fmt: skip
    one, other = (design_fusion(d, noise, structure) for d in (designs, others))
    assert other.gamma == pytest.approx(one.gamma, rel=1e-6)
    assert back @ other.weights @ S == pytest.approx(one.weights, abs=1e-4)


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


def test_the_system_with_independent_noise_orders_its_inputs_by_cluster() -> None:
    designs = random_clusters(6, 2)
    A, B, L = fusion_system(designs, np.stack([np.eye(2)] * 2), "independent")
    assert A[2:, 2:] == pytest.approx(designs[1].A_f)
    assert B.shape == (4, 8)
    assert B[2:, 4:6] == pytest.approx(designs[1].model.B)
    assert B[:2, 2:4] == pytest.approx(-designs[0].gain @ designs[0].model.D)
    assert not B[2:, :4].any()
    assert pytest.approx(np.hstack([np.eye(2)] * 2)) == L


@pytest.mark.parametrize("noise", NOISES)
def test_the_gain_of_many_clusters_is_that_of_the_stacked_system(noise: str) -> None:
    designs = random_clusters(8, 3) * 11  # 66 states: the sweep
    weights = np.random.default_rng(1).normal(size=(33, 2, 2))
    expected = hinf_norm(*fusion_system(designs, weights, noise))
    assert fusion_gain(designs, weights, noise) == pytest.approx(expected, rel=1e-7)


def test_the_sweep_finds_a_narrow_peak() -> None:
    slow = cluster(1000.0)  # poles very near one
    designs = [slow] * 33
    weights = np.stack([np.eye(2) / 33] * 33)
    assert np.abs(np.linalg.eigvals(slow.A_f)).max() > 0.99
    expected = hinf_norm(*fusion_system([slow], [np.eye(2)])) / 33**0.5
    assert fusion_gain(designs, weights, "independent") == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("structure", STRUCTURES)
@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize(("process", "velocity"), [((0.0, 3e-4), 0.13), ((0.05, 0.1), 10.0)])
def test_numbers_of_a_network(
    process: tuple[float, float], velocity: float, noise: str, structure: str
) -> None:
    designs = [
        design_filter(
            ErrorModel.p1(0.02, process_noise=process, measurement_noise=(size * 0.2, velocity))
        )
        for size in (1.0, 2.0, 1.0)
    ]
    design = design_fusion(designs, noise, structure)
    assert design.status == "Solved"
    assert design.gamma <= min(d.certificate.norm for d in designs) * (1 + 1e-6)
    assert design.weights[0] == pytest.approx(design.weights[2], abs=1e-3)


def test_many_clusters() -> None:
    three = [cluster(size) for size in (0.5, 1.0, 2.0)]
    design = design_fusion(three * 12, "common", "block")
    few = design_fusion(three, "common", "block")
    assert design.status == "Solved"
    assert design.gamma < few.gamma
    assert design.weights[:3] == pytest.approx(design.weights[33:], abs=1e-4)


def bad_inputs() -> list[tuple[str, Any, dict[str, Any]]]:
    local = cluster()
    model = local.model
    return [
        ("designs", [], {}),
        ("designs", local, {}),
        ("designs", None, {}),
        ("designs", [local, model], {}),
        ("designs", [local, replace(local, model=replace(model, A=2 * model.A))], {}),
        ("designs", [local, replace(local, model=replace(model, B=model.B[:, :1]))], {}),
        ("designs", [local, replace(local, model=replace(model, L=model.L[:1]))], {}),
        ("designs", [replace(local, model=replace(model, E=0.1 * np.eye(2)))], {}),
        ("noise", [local], {"noise": "white"}),
        ("structure", [local], {"structure": "diagonal"}),
        ("margin", [local], {"margin": 0.0}),
        ("margin", [local], {"margin": float("nan")}),
        ("margin", [local], {"margin": 1e10}),
        ("margin", [local], {"margin": "0.1"}),
        ("margin", [local], {"margin": None}),
        ("margin", [local], {"margin": 0.1j}),
        ("margin", [local], {"margin": np.full(2, 0.1)}),
        ("noise", [local], {"noise": np.array(["common", "common"])}),
        ("noise", [local], {"noise": ["common"]}),
        ("noise", [local], {"noise": None}),
        ("structure", [local], {"structure": np.array(["full", "block"])}),
        ("structure", [local], {"structure": {"full": 1}}),
    ]


@pytest.mark.parametrize("case", range(22))
def test_what_cannot_be_fused_is_refused(case: int) -> None:
    name, designs, options = bad_inputs()[case]
    with pytest.raises(ParameterError) as caught:
        design_fusion(designs, **options)
    assert caught.value.name == name
    if name == "designs":
        with pytest.raises(ParameterError, match="designs is"):
            tied_level(designs)


def test_weights_that_are_none_are_refused() -> None:
    local = [cluster()] * 2
    whole = np.stack([np.eye(2) / 2] * 2)
    wrong = [np.eye(2), np.full((2, 2, 2), np.nan), "weights", [[1.0], [1.0, 2.0]]]
    for weights in (*wrong, whole * (1 + 1j), whole.astype(str), {"a": whole}, None):
        for function in (fusion_gain, fusion_system):
            with pytest.raises(ParameterError, match="weights is"):
                function(local, weights)
    for function in (fusion_gain, fusion_system):
        with pytest.raises(ParameterError, match="noise is"):
            function(local, np.stack([np.eye(2) / 2] * 2), "white")
    with pytest.raises(ParameterError, match="noise is"):
        tied_level(local, "white")


def test_a_local_filter_that_is_not_stable_is_refused() -> None:
    local = cluster()
    with pytest.raises(InfeasibleDesignError, match=r"spectral radius 1\.5"):
        design_fusion([local, replace(local, A_f=1.5 * np.eye(2))])


@pytest.mark.parametrize("structure", STRUCTURES)
def test_a_wrong_answer_of_the_solver_does_not_pass(
    structure: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The least level too low, P too small, or weights other than those that P vouches for."""
    designs = [cluster(size) for size in (0.5, 1.0)]
    right, weights = fusion._solved, fusion._weights

    def with_lower_level(program: Any, cost: Any, solver: Any) -> Any:
        answer, status = right(program, cost, solver)
        if cost[0] == 1 and not cost[1:].any():
            answer[0] *= 0.9
        return answer, status

    def with_smaller_p(program: Any, cost: Any, solver: Any) -> Any:
        answer, status = right(program, cost, solver)
        halved = np.where(cost != 0, 0.5, 1.0) * answer
        return (answer if cost[0] == 1 and not cost[1:].any() else halved), status

    def swapped(*arguments: Any) -> Any:
        return weights(*arguments)[::-1]

    def not_of_sum_one(*arguments: Any) -> Any:
        return 1.001 * weights(*arguments)

    assert isinstance(design_fusion(designs, "common", structure), FusionDesign)
    for name, wrong, said in (
        ("_solved", with_lower_level, "."),
        ("_solved", with_smaller_p, "the inequality has the eigenvalue"),
        ("_weights", swapped, "the norm is"),
        ("_weights", not_of_sum_one, "miss the identity by 0.001"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(fusion, name, wrong)
            with pytest.raises(InfeasibleDesignError, match=said):
                design_fusion(designs, "common", structure)


def test_a_solver_that_gives_up_is_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    designs, settings = [cluster()] * 2, clarabel.DefaultSettings

    def impatient() -> Any:
        found = settings()
        found.max_iter = 2
        return found

    monkeypatch.setattr(clarabel, "DefaultSettings", impatient)
    with pytest.raises(InfeasibleDesignError, match="the solver says MaxIterations"):
        design_fusion(designs)


def test_other_states_are_tried_where_the_solver_has_difficulties(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    right, asked = fusion._balanced, []

    def first_broken(designs: Any, noise: Any, structure: Any, states: Any) -> Any:
        asked.append(states)
        if states == "covariance":
            raise InfeasibleDesignError("Broken.")
        return right(designs, noise, structure, states)

    monkeypatch.setattr(fusion, "_balanced", first_broken)
    design = design_fusion([cluster()] * 2, "common", "block")
    assert asked[:2] == ["covariance", "designs"]
    assert design.weights == pytest.approx(np.stack([np.eye(2) / 2] * 2), abs=1e-6)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_the_certificate_is_what_it_says(structure: str) -> None:
    """The returned P satisfies the inequality in the states of the designs as well."""
    designs = random_clusters(9, 3)
    design = design_fusion(designs, "common", structure)
    A, K = stacked(designs, "common")
    P = design.P if structure == "full" else block_diag(*design.P)
    LM = np.hstack(list(design.weights))
    F = np.block(
        [
            [A.T @ P @ A - P, A.T @ P @ K, LM.T],
            [K.T @ P @ A, K.T @ P @ K - design.level**2 * np.eye(8), np.zeros((8, 2))],
            [LM, np.zeros((2, 8)), -np.eye(2)],
        ]
    )
    assert np.linalg.eigvalsh(F).max() < 1e-6 * np.abs(F).max()
    assert design.certificate.largest_eigenvalue < 1e-6
    assert design.certificate.norm == pytest.approx(hinf_norm(A, K, LM), rel=1e-8)
    assert design.level == pytest.approx(1.01 * design.gamma)
