"""P1's proof written out as matrices, and its plant and filter in simulation."""

from __future__ import annotations

import numpy as np

from inswsn_lib.checks import Array
from inswsn_lib.lmi import FilterDesign, WorstCase
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


def attack(
    design: FilterDesign, worst: WorstCase | None, seed: int, steps: int, runs: int
) -> tuple[Array, Array]:
    """Simulate plant and filter; return output and disturbance energies, (steps, runs)."""
    plant, rng = design.model, np.random.default_rng(seed)
    x, estimate = np.zeros((2, 4, runs))
    noises = plant.B.shape[1]
    spent, seen = [], []
    for k in range(steps):
        e = x - estimate
        if worst is None:
            s = rng.standard_normal((noises + plant.D.shape[1], runs))
        else:
            first = np.repeat(worst.first[:, None], runs, axis=1)
            s = first if k == 0 else worst.feedback[k - 1] @ e
        b = rng.standard_normal(runs)
        y = plant.C @ x + plant.D @ s[noises:]
        estimate = design.A_f @ estimate + (plant.E @ estimate) * b + design.gain @ y
        x = plant.A @ x + (plant.E @ x) * b + plant.B @ s[:noises]
        spent.append((s**2).sum(axis=0))
        seen.append(((plant.L @ (x - estimate)) ** 2).sum(axis=0))
    return np.array(seen), np.array(spent)
