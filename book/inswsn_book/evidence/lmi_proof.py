"""P1's proof written out as matrices and tried, and its plant and filter in simulation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd

from inswsn_book.show import tick
from inswsn_lib.checks import Array
from inswsn_lib.filters import run_hinfinity
from inswsn_lib.lmi import (
    FilterDesign,
    WorstCase,
    design_filter,
    hinf_norm,
    mean_square_radius,
    stochastic_gain,
)
from inswsn_lib.lmi.designs import Solver
from inswsn_lib.models import ErrorModel

#: A, B, E, L of an error system, P and gamma
Case = tuple[Array, Array, Array, Array, Array, float]


def negative_definite(matrix: Array) -> bool:
    """Tell whether a symmetric matrix is negative definite."""
    return bool(np.linalg.eigvalsh(matrix).max() < 0)


def printed_steps(
    A: Array, B: Array, E: Array, L: Array, P: Array, gamma: float
) -> dict[str, Array]:
    """Return the matrices of (2.16) to (2.21); (2.17) is (2.16) with another name for a part."""
    n, p, outputs = len(A), B.shape[1], len(L)
    PA, PB, PE, cost = P @ A, P @ B, P @ E, gamma**2 * np.eye(p)
    theta, across = cost - B.T @ PB, A.T @ PB
    delta = -P + A.T @ PA + L.T @ L + E.T @ PE
    schur = delta + across @ np.linalg.solve(theta, across.T)
    both = np.hstack([A, B])
    zero, none = np.zeros((n, n)), np.zeros((n, p))
    from_n, from_p = np.zeros((outputs, n)), np.zeros((outputs, p))
    return {
        "2.16": np.block([[schur, none], [none.T, -theta]]),
        "2.18": np.block([[delta, across], [across.T, -theta]]),
        "2.19": np.block([[delta, none], [none.T, -cost]]) + both.T @ P @ both,
        "2.20": np.block([[delta, none, PA.T], [none.T, -cost, PB.T], [PA, PB, -P]]),
        "2.21": np.block(
            [
                [-P, none, PA.T, PA.T, L.T, PE.T],
                [none.T, -cost, PB.T, none.T, from_p.T, none.T],
                [PA, PB, -P, zero, from_n.T, zero],
                [PA, none, zero, -P, from_n.T, zero],
                [L, from_p, from_n, from_n, -np.eye(outputs), from_n],
                [PE, none, zero, zero, from_n.T, -P],
            ]
        ),
    }


def try_steps(cases: Iterable[Case]) -> pd.DataFrame:
    """Tell which inequality holds for which case; a column for each inequality."""
    return pd.DataFrame(
        {name: negative_definite(m) for name, m in printed_steps(*case).items()} for case in cases
    )


def compare_steps(truth: pd.DataFrame) -> pd.DataFrame:
    """Count for each step of the proof for how many cases what is before and after it holds."""
    rows = {}
    for before, after in pairwise(truth.columns):
        first, second = truth[before], truth[after]
        rows[f"({before}) to ({after})"] = {
            "both hold": (first & second).sum(),
            "neither": (~first & ~second).sum(),
            "only the first": (first & ~second).sum(),
            "only the second": (~first & second).sum(),
            "equivalent": tick(bool((first == second).all())),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("step")


def second_copy(case: Case) -> tuple[float, float]:
    """Compare (2.19) less (2.18) with A'PA in its first block and zero elsewhere.

    Return its largest entry over that of A'PA, and the largest that is left, over that of (2.18).
    """
    A, *_, P, _ = case
    steps, twice = printed_steps(*case), A.T @ P @ A
    more = steps["2.19"] - steps["2.18"]
    extra = np.abs(more).max() / np.abs(twice).max()
    more[: len(A), : len(A)] -= twice
    return extra, np.abs(more).max() / np.abs(steps["2.18"]).max()


def delta_difference(case: Case) -> float:
    """Return the largest difference of the left sides of (2.16) and (2.17)."""
    A, B, E, L, P, gamma = case
    left, across = printed_steps(*case)["2.16"][: len(A), : len(A)], A.T @ P @ B
    theta = gamma**2 * np.eye(B.shape[1]) - B.T @ P @ B
    by_name = -P + A.T @ P @ A + L.T @ L + E.T @ P @ E
    by_name = by_name + across @ np.linalg.solve(theta, across.T)
    return float(np.abs(by_name - left).max() / np.abs(left).max())


def forms_of_p2(case: Case) -> tuple[bool, bool]:
    """Tell whether (15) of P2, with the tilde, and whether (16) holds."""
    A, B, E, L, P, gamma = case
    # (15) is (2.16) without jitter; as printed its theta holds B, of too few columns
    fifteen = printed_steps(A, B, 0 * E, L, P, gamma)["2.16"]
    PA, PB, cost, none = P @ A, P @ B, gamma**2 * np.eye(B.shape[1]), np.zeros(B.shape)
    sixteen = np.block([[L.T @ L - P, none, PA.T], [none.T, -cost, PB.T], [PA, PB, -P]])
    return negative_definite(fifteen), negative_definite(sixteen)


def enumerated_gain(A: Array, B: Array, E: Array, L: Array, steps: int) -> float:
    """Return the gain over a few steps, from all courses of the jitter."""
    inputs, columns = B.shape[1], B.shape[1] * (2**steps - 1)
    states = np.zeros((1, len(A), columns))  # of each course so far, as a map of all inputs
    rows, first = [], 0
    for k in range(steps):
        # one vector for each course, over the root of its probability: of unit energy
        push = np.zeros((len(states), len(A), columns))
        for course in range(len(states)):
            there = slice(first + course * inputs, first + (course + 1) * inputs)
            push[course, :, there] = 2 ** (k / 2) * B
        first += len(states) * inputs
        states = np.concatenate([(A + sign * E) @ states + push for sign in (1, -1)])
        rows.append((L @ states).reshape(-1, columns) / 2 ** ((k + 1) / 2))
    return float(np.linalg.norm(np.vstack(rows), 2))


def bounded(case: Case) -> bool:
    """Tell by what knows of no P whether a system is stable and has its gain below gamma."""
    A, B, E, L, _, gamma = case
    gains = hinf_norm(A, B, L), enumerated_gain(A, B, E, L, 6)
    return mean_square_radius(A, E) < 1 and max(gains) < gamma


def least_over_gain(cases: Iterable[Case], solver: tuple[Solver, ...]) -> dict[str, Array]:
    """Return by how much the least gamma of the inequality is above the gain, of stable systems."""
    found: dict[str, list[float]] = {"without jitter": [], "with jitter": []}
    for A, B, E, L, _, _ in cases:
        for kind, jump in zip(found, (0 * E, E), strict=True):
            if mean_square_radius(A, jump) > 0.9:
                continue
            # nothing is measured, so that the system is its own error
            C, D = np.zeros((1, len(A))), np.eye(1)
            blind = ErrorModel(A=A, B=B, C=C, D=D, L=L, E=jump, period=1.0)
            gain = (
                stochastic_gain(A, jump, B, L, relative=2e-4) if jump.any() else hinf_norm(A, B, L)
            )
            found[kind].append(design_filter(blind, solver=solver).gamma / gain - 1)
    return {kind: np.array(values) for kind, values in found.items()}


def random_case(rng: np.random.Generator) -> Case:
    """Return a random error system with a P that is about wide enough."""
    A = rng.uniform(0.2, 0.9) * np.linalg.qr(rng.standard_normal((3, 3)))[0]
    E, B = 0.2 * rng.standard_normal((3, 3)), rng.standard_normal((3, 2))
    P = np.eye(3)
    for _ in range(60):
        P = A.T @ P @ A + E.T @ P @ E + 1.25 * np.eye(3)
    P = rng.uniform(0.9, 2.0) * (P + P.T) / 2
    return A, B, E, np.eye(3), P, rng.uniform(2.0, 40.0)


def schur_agrees(rng: np.random.Generator) -> tuple[bool, bool]:
    """Tell whether both sides of Lemma 2.2 agree on random matrices."""
    root, N = rng.standard_normal((2, 2)), rng.standard_normal((3, 2))
    R = -root @ root.T - 0.05 * np.eye(2)
    M = rng.standard_normal((3, 3))
    M = (M + M.T) / 2 - rng.uniform(0, 8) * np.eye(3)
    left = negative_definite(M - N @ np.linalg.solve(R, N.T))
    return left, left == negative_definite(np.block([[M, N], [N.T, R]]))


def simulate(
    model: ErrorModel, gain: Array, disturbance: Array, beta: Array, *, known: bool
) -> tuple[Array, Array]:
    """Run plant and filter; return the states and the estimates, (steps + 1, n)."""
    w, v = np.split(disturbance, [model.B.shape[1]], axis=1)
    states, estimates = [np.zeros(len(model.A))], [np.zeros(len(model.A))]
    for k, b in enumerate(beta):
        x, estimate = states[-1], estimates[-1]
        y = model.C @ x + model.D @ v[k]
        A_f = model.A - gain @ model.C + (model.E * b if known else 0)
        estimates.append(A_f @ estimate + gain @ y)
        states.append((model.A + model.E * b) @ x + model.B @ w[k])
    return np.array(states), np.array(estimates)


def left_over(
    model: ErrorModel, gain: Array, runs: tuple[Array, Array], disturbance: Array, beta: Array
) -> float:
    """Return the largest residual of (2.11), over the size of the state."""
    A, B = model.A - gain @ model.C, np.hstack([model.B, -gain @ model.D])
    states, estimates = runs
    e = states - estimates
    expected = e[:-1] @ A.T + beta[:, None] * (e[:-1] @ model.E.T) + disturbance @ B.T
    return float(np.abs(e[1:] - expected).max() / np.abs(states).max())


def error_residuals(design: FilterDesign, disturbance: Array, beta: Array) -> dict[str, float]:
    """Compare simulated plant and filter, the jitter known, with P1 (2.9) to (2.13)."""
    model, gain = design.model, design.gain
    runs = simulate(model, gain, disturbance, beta, known=True)
    states, estimates = runs
    size, L = np.abs(states).max(), model.L

    calm = replace(model, E=0 * model.E)
    calm_states, calm_estimates = simulate(calm, gain, disturbance, beta, known=False)
    measured = calm_states[:-1] @ model.C.T + disturbance[:, model.B.shape[1] :] @ model.D.T
    from_library = run_hinfinity((calm, gain), measured, predicted=True)

    outputs = states @ L.T - estimates @ L.T
    B, D = stacked_inputs(model)
    A_tilde, B_tilde = model.A - gain @ model.C, np.hstack([model.B, -gain @ model.D])
    put_in = np.abs(design.A_f - A_tilde).max(), np.abs(B - gain @ D - B_tilde).max()
    return {
        "error.filter-residual": np.abs(from_library - calm_estimates[:-1]).max() / size,
        "error.output-residual": np.abs((states - estimates) @ L.T - outputs).max() / size,
        "error.known-residual": left_over(model, gain, runs, disturbance, beta),
        "error.lemma-difference": max(put_in),
    }


def cluster_residuals(design: FilterDesign, disturbance: Array) -> dict[str, float]:
    """Compare simulated plant and filter of a cluster with P2 (1) to (5)."""
    model, gain, still = design.model, design.gain, np.zeros(len(disturbance))
    runs = simulate(model, gain, disturbance, still, known=False)
    states, estimates = runs
    size = np.abs(states).max()
    w, v = np.split(disturbance, [model.B.shape[1]], axis=1)
    measured = states[:-1] @ model.C.T + v @ model.D.T
    driven, (B, D) = states[1:] - states[:-1] @ model.A.T, stacked_inputs(model)
    noise = measured - states[:-1] @ model.C.T
    stacked = np.abs(driven - disturbance @ B.T).max(), np.abs(noise - disturbance @ D.T).max()
    innovations = (measured - estimates[:-1] @ model.C.T) @ gain.T
    followed = estimates[:-1] @ model.A.T + innovations
    return {
        "p2.model-residual": np.abs(driven - w @ model.B.T).max() / size,
        "p2.transition-difference": np.abs(model.A - ErrorModel.p1(model.period).A).max(),
        "p2.stacked-residual": max(stacked) / size,
        "p2.filter-residual": np.abs(followed - estimates[1:]).max() / size,
        "p2.error-residual": left_over(model, gain, runs, disturbance, still),
    }


def stacked_inputs(model: ErrorModel) -> tuple[Array, Array]:
    """Return [B 0] and [0 D]."""
    none_of_v = np.zeros((len(model.B), model.D.shape[1]))
    none_of_w = np.zeros((len(model.D), model.B.shape[1]))
    return np.hstack([model.B, none_of_v]), np.hstack([none_of_w, model.D])


def buildable_system(model: ErrorModel, gain: Array) -> tuple[Array, Array, Array, Array]:
    """Return A, E, B and L for the state (e, x) of a filter that does not know the jitter."""
    zero, unseen = np.zeros_like(model.A), np.zeros_like(model.L)
    A_f, driven = model.A - gain @ model.C, -gain @ model.D
    return (
        np.block([[A_f, zero], [zero, model.A]]),
        np.block([[zero, model.E], [zero, model.E]]),
        np.block([[model.B, driven], [model.B, np.zeros_like(driven)]]),
        np.hstack([model.L, unseen]),
    )


def attack(
    design: FilterDesign, worst: WorstCase, seed: int, steps: int, runs: int, known: bool = True
) -> tuple[Array, Array]:
    """Simulate plant and filter; return output and disturbance energies, (steps, runs).

    A filter to which the jitter is not known takes each interval for the nominal one.
    """
    plant, rng = design.model, np.random.default_rng(seed)
    x, estimate = np.zeros((2, 4, runs))
    noises = plant.B.shape[1]
    spent, seen = [], []
    for k in range(steps):
        e = x - estimate
        first = np.repeat(worst.first[:, None], runs, axis=1)
        s = first if k == 0 else worst.feedback[k - 1] @ e
        b = rng.standard_normal(runs)
        y = plant.C @ x + plant.D @ s[noises:]
        estimate = design.A_f @ estimate + known * (plant.E @ estimate) * b + design.gain @ y
        x = plant.A @ x + (plant.E @ x) * b + plant.B @ s[:noises]
        spent.append((s**2).sum(axis=0))
        seen.append(((plant.L @ (x - estimate)) ** 2).sum(axis=0))
    return np.array(seen), np.array(spent)
