"""The errata: each derivation worked out again by itself.

The computations use numpy and the printed numbers alone, nothing of the library under test.
"""

from __future__ import annotations

import csv
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.linalg import eigvalsh, inv, norm, solve
from scipy.linalg import block_diag, solve_discrete_lyapunov


def test_every_test_that_an_erratum_names_is_here(known: dict[str, Any]) -> None:
    errata = known["errata"].errata
    named = {entry.tested for entry in errata if entry.tested}
    assert len(named) > 25
    assert [name for name in named if not callable(globals().get(name))] == []
    assert [e.id for e in errata if e.kind == "algebra" and not e.tested] == []


def random_matrix(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return rng.standard_normal(shape)


def positive(rng: np.random.Generator, n: int) -> np.ndarray:
    root = random_matrix(rng, n, n)
    return root @ root.T + 0.1 * np.eye(n)


def lssvm(K: np.ndarray, y: np.ndarray, eta: float) -> tuple[float, np.ndarray]:
    """Return the bias and the multipliers of an LS-SVM, by (3.6) of P1."""
    C = np.block([[np.zeros((1, 1)), np.ones((1, len(y)))],
                  [np.ones((len(y), 1)), K + np.eye(len(y)) / eta]])  # fmt: skip
    b, *alpha = solve(C, [0, *y])
    return b, np.array(alpha)


def gauss(x: np.ndarray, z: np.ndarray, sigma: float) -> np.ndarray:
    return np.exp(-(np.subtract.outer(x, z) ** 2) / (2 * sigma**2))


def rows_of(root: Path, name: str) -> list[dict[str, str]]:
    with (root / "data/papers" / f"{name}.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def cells(root: Path, table: str) -> dict[str, dict[str, float]]:
    rows = rows_of(root, f"p1-{table}")
    return {row.pop("method"): {c: float(v) for c, v in row.items()} for row in rows}


def even_motion(T: float) -> np.ndarray:
    """Return the transition of a point that moves evenly in a plane: positions, velocities."""
    return np.eye(4) + T * np.eye(4, k=2)


POSITIONS = ("rx1", "rx2", "ry1", "ry2")


# P1 ----------------------------------------------------------------------------------------------


def test_a_term_is_counted_twice() -> None:
    rng = np.random.default_rng(1)
    n, m, gamma = 4, 6, 7.0
    A, B, E, L = (random_matrix(rng, n, k) for k in (n, m, n, n))
    P, AB = positive(rng, n), np.hstack([A, B])
    delta = -P + A.T @ P @ A + L.T @ L + E.T @ P @ E
    of_218 = np.block([[delta, A.T @ P @ B], [B.T @ P @ A, B.T @ P @ B - gamma**2 * np.eye(m)]])
    of_219 = block_diag(delta, -(gamma**2) * np.eye(m)) + AB.T @ P @ AB
    np.testing.assert_allclose(
        of_219 - of_218, block_diag(A.T @ P @ A, np.zeros((m, m))), atol=1e-9
    )
    # the Schur complement of (2.15) with respect to its rows from the third on is (2.19); without
    # the fourth it is (2.18), so the corrected inequality is the lemma
    rows = np.vstack([P @ AB, np.hstack([np.vstack([P @ A, L, P @ E]), np.zeros((3 * n, m))])])
    corner = block_diag(-P, -P, -np.eye(n), -P)
    top = block_diag(-P, -(gamma**2) * np.eye(m))
    np.testing.assert_allclose(top - rows.T @ solve(corner, rows), of_219, atol=1e-8)
    keep = [*range(n), *range(2 * n, 4 * n)]
    exact = top - rows[keep].T @ solve(corner[np.ix_(keep, keep)], rows[keep])
    np.testing.assert_allclose(exact, of_218, atol=1e-8)

    # a scalar that is not measured: p > 0 must satisfy -p + k a^2 p + 1 + a^2 p^2/(g^2 - p) < 0
    def solvable(a: float, gamma: float, copies: int) -> bool:
        p = np.linspace(0.01, min(60, gamma**2), 60001)[:-1]
        return bool(np.any(-p + copies * a**2 * p + 1 + a**2 * p**2 / (gamma**2 - p) < 0))

    # the gain is 1/(1 - 0.8); counted twice there is none beyond 1/sqrt(2)
    assert [solvable(0.8, gamma, 1) for gamma in (4.95, 5.05)] == [False, True]
    assert not any(solvable(0.8, gamma, 2) for gamma in (5.05, 7, 20, 1e4))
    assert [solvable(a, 1e4, 2) for a in (0.7, 0.71)] == [True, False]


def test_without_the_jitter_the_error_energy_grows_without_end() -> None:
    T, dt, nu = 0.2, 0.0012, 3.0
    A, E = even_motion(T), dt * np.eye(4, k=2)
    start = np.tile([0, 0, nu, 0], 2)  # (e, x) after a push of nu into v_x
    for A_error in (0 * A, 0.5 * A):  # two filters, A - B_f C
        F, G = block_diag(A_error, A), np.kron([[0, 1], [0, 1]], E)
        X, energies = np.outer(start, start), []
        for _ in range(1000):
            X = F @ X @ F.T + G @ X @ G.T
            energies.append(np.trace(X[:4, :4]) / (dt * nu) ** 2)
        assert min(energies) >= 1 - 1e-9
        assert A_error.any() or max(energies) == pytest.approx(1)  # deadbeat attains the bound


def test_a_jitter_that_stays_is_not_covered_by_the_lemma() -> None:
    a, eps = 0.8, 0.5
    # white: the mean over all courses of ten steps is the product of the mean squares, which falls
    courses = np.array(list(itertools.product((1, -1), repeat=10)))
    mean = np.mean(np.prod(a + eps * courses, axis=1) ** 2)
    assert mean == pytest.approx((a**2 + eps**2) ** 10)
    assert a**2 + eps**2 < 1
    # constant: the mean over the two signs grows
    assert np.mean([(a + sign * eps) ** 80 for sign in (1, -1)]) > 1e8
    # the inequality without disturbance, -p + (a^2 + eps^2) p + 1 < 0, has a solution
    assert -20 + (a**2 + eps**2) * 20 + 1 < 0


def test_without_a_margin_the_inequality_is_not_necessary() -> None:
    p = np.linspace(1e-3, 4 - 1e-3, 9999)
    left = -p + p / 4 + 1 + (p / 2) ** 2 / (4 - p)
    np.testing.assert_allclose(left * (4 - p), (p - 2) ** 2, atol=1e-9)
    assert left.min() >= 0
    # gains over N steps stay below 2 and tend to it
    gains = []
    for n in (10, 100, 400):
        k = np.subtract.outer(np.arange(n), np.arange(n))
        gains.append(norm(np.where(k > 0, 0.5 ** np.maximum(k - 1, 0), 0), 2))
    assert gains == sorted(gains)
    assert 1.99 < gains[-1] < 2


def test_the_two_models_of_the_jitter_differ() -> None:
    T, dt, signs = 0.2, 0.0012, np.array([1, -1])
    of_22, of_23 = (T + dt) * signs, T + dt * signs
    assert of_22.mean() == 0
    assert of_23.mean() == pytest.approx(T)
    assert of_22.var() == pytest.approx((T + dt) ** 2)
    assert of_23.var() == pytest.approx(dt**2)


def test_the_matrices_hold_the_period() -> None:
    # (1,3) of the printed A_f and B_f, with half a unit of the last digit of B_f
    for a_f, b_f, half, period in ((0.0658e-11, 0.2, 0.05, 0.2), (-0.0524e-11, 0.21, 0.005, 0.21)):
        assert a_f + b_f == pytest.approx(period)
        assert not b_f - half <= 1 - a_f <= b_f + half
    # the bound of the tables is attained: q = x^2 - 1/4 on [-1, 1], and no ramp is below it
    x = np.linspace(-1, 1, 200001)
    places = [(0, -0.25), *np.random.default_rng(2).uniform(-3, 3, (200, 2))]
    ratios = [np.trapezoid(abs((x + r) ** 2 + c), x) / np.trapezoid(abs(2 * (x + r)), x)
              for r, c in places]  # fmt: skip
    assert ratios[0] == pytest.approx(0.25, rel=1e-4)
    assert min(ratios) >= 0.25 * (1 - 1e-6)


def test_velocities_from_fixes_are_too_noisy() -> None:
    sigma, t = 0.2 / math.sqrt(2), np.arange(5) - 2.0
    # a difference of two fixes 0.2 s and 1 s apart, and a line through five
    assert sigma * norm([1, -1]) / 0.2 == pytest.approx(1.0)
    assert sigma * norm([1, -1]) / 1.0 == pytest.approx(0.2)
    assert sigma * norm(t / (t @ t) / 0.2) == pytest.approx(0.2236, abs=1e-4)
    # P2: neighbours share a fix, so their correlation is minus one half
    assert 0.14 * norm([1, -1]) / 0.02 == pytest.approx(10, rel=0.02)
    first, second = np.array([-1, 1, 0]), np.array([0, -1, 1])
    assert first @ second / (first @ first) == -0.5


def test_the_printed_lagrangian_has_no_stationary_point() -> None:
    rng = np.random.default_rng(3)
    phi, y, eta = random_matrix(rng, 7, 3), random_matrix(rng, 7), 5.0

    def lagrangian(z: np.ndarray, printed: bool) -> float:
        w, b, e, alpha = z[:3], z[3], z[4:11], z[11:]
        objective = w @ w / 2 + eta * e @ e / 2
        if printed:
            return float(objective - alpha @ (phi @ w) + b + e[0] - y[0])
        return float(objective - alpha @ (phi @ w + b + e - y))

    def slope(z: np.ndarray, printed: bool) -> np.ndarray:
        steps = 1e-6 * np.eye(len(z))
        ends = [(lagrangian(z + s, printed), lagrangian(z - s, printed)) for s in steps]
        return -np.diff(ends, axis=1).ravel() / 2e-6

    b, alpha = lssvm(phi @ phi.T, y, eta)
    z = np.concatenate([phi.T @ alpha, [b], alpha / eta, alpha])
    np.testing.assert_allclose(slope(z, printed=False), 0, atol=1e-7)  # so (3.6) is its solution
    for point in (z, random_matrix(rng, len(z))):
        assert slope(point, printed=True)[3] == pytest.approx(1)  # whatever the point


def test_two_paths_give_one_ins_reading() -> None:
    t, bias, c = np.linspace(0, 50, 5001), 0.1, 0.04
    path = 3 * np.sin(t / 5) + 0.2 * t
    other = path + c * t**2 / 2
    sensed = [
        np.gradient(np.gradient(p, t), t)[2:-2] + b for p, b in ((path, bias), (other, bias - c))
    ]
    np.testing.assert_allclose(*sensed, atol=1e-6)
    indicated = [path + bias * t**2 / 2, other + (bias - c) * t**2 / 2]
    np.testing.assert_allclose(*indicated, atol=1e-9)
    assert abs(path - other).max() == pytest.approx(c * 50**2 / 2)


def test_the_means_of_table_1_take_y_from_the_row_below(root: Path) -> None:
    columns = ("drx", "dry", "mean_position")
    x, y, printed = (np.array([float(r[c]) for r in rows_of(root, "p1-table1")]) for c in columns)
    np.testing.assert_allclose((x + np.append(y[1:], 0)) / 2, printed, rtol=0, atol=1e-4 + 1e-12)
    own = (x + y) / 2
    assert np.sum(abs(own - printed) > 1e-4 + 1e-12) == 7
    assert np.sum(own < own[9]) == 7  # row 10 is the eighth
    assert (own.argmin(), printed.argmin()) == (2, 9)
    assert abs(x[9] - printed[9]) > 0.1  # what AVERAGE would have made of an empty cell


def test_training_errors_fall_with_the_regularisation(root: Path) -> None:
    rng = np.random.default_rng(4)
    x, y = np.sort(rng.uniform(0, 10, 30)), random_matrix(rng, 30)
    for sigma in (0.01, 1.0, 30.0):
        K = gauss(x, x, sigma)
        squares = [norm(lssvm(K, y, eta)[1] / eta) for eta in (1.0, 10.0, 100.0, 1e3, 1e5)]
        assert squares == sorted(squares, reverse=True)
        assert squares[-1] < 1e-3 or sigma > 0.1  # a narrow kernel repeats its targets
    v = [float(row["dvy"]) for row in rows_of(root, "p1-table1")]
    grows = [v[b - 1] > v[a - 1] for a, b in ((1, 2), (2, 3), (4, 5), (6, 7), (8, 9))]
    assert grows == [True, False, True, True, True]


def test_a_kalman_filter_is_not_worse_than_its_fixes(root: Path) -> None:
    A, rng = np.array([[1, 0.2], [0, 1]]), np.random.default_rng(5)
    for _ in range(50):
        Q, R = positive(rng, 2) * rng.uniform(0.01, 10), np.diag(rng.uniform(0.01, 10, 2))
        P = 100 * np.eye(2)
        for _ in range(500):
            M = A @ P @ A.T + Q
            P = M - M @ solve(M + R, M)
        assert eigvalsh(R - P).min() > 0
    # printed KF positions over 0.2 m, and over INS-only
    kf, ins = (
        np.array([cells(root, "table2")[m][c] for c in POSITIONS]) for m in ("KF", "INS-only")
    )
    np.testing.assert_allclose([kf.min() / 0.2, kf.max() / 0.2], [9, 74.8], atol=0.1)
    assert max(kf / ins) / min(kf / ins) < 1.02


def test_the_deadbeat_filter_has_the_error_of_the_fix(root: Path) -> None:
    T, rng = 0.2, np.random.default_rng(6)
    # A_f = 0, B_f = A: the estimate is the last fix, carried on; the INS errs by 0.5 m/s^2
    v = np.array([0.2, 0.126]) * rng.standard_normal((20000, 2))
    errors = 0.5 * T**2 / 2 - v @ [1, T]
    assert np.mean(abs(errors)) == pytest.approx(
        math.hypot(0.2, T * 0.126) * math.sqrt(2 / math.pi), rel=0.03
    )
    hf = np.array([cells(root, "table2")["HF"][c] for c in POSITIONS])
    ratios = hf / (0.2 * math.sqrt(2 / math.pi))
    np.testing.assert_allclose([ratios.min(), ratios.max()], [2.4, 5.3], atol=0.05)


def test_percentages_of_the_text_are_not_those_of_the_tables(root: Path) -> None:
    two, three = cells(root, "table2"), cells(root, "table3")
    hf = [100 * (1 - two["HF"][c] / two["KF"][c]) for c in ("rx1", "ry1", "vx1", "vy1")]
    far = [abs(a - b) for a, b in zip(hf, (85, 80, 70, 75), strict=True)]
    assert far[0] < 2.5
    assert all(8 < size < 10 for size in far[1:])
    svm = [100 * (1 - three["LS-SVM"][c] / three["BP"][c]) for c in three["BP"]]
    assert min(svm) > 85


def test_a_plane_leaves_nearly_all_of_a_white_error(root: Path) -> None:
    rng = np.random.default_rng(19)
    inputs = np.cumsum(rng.standard_normal((50, 4)), axis=0)  # any four that run along
    plane = np.column_stack([np.ones(50), inputs])
    rest = np.eye(50) - plane @ np.linalg.pinv(plane)
    assert rest.trace() == pytest.approx(50 - 5)
    assert norm(rest @ plane) < 1e-9 * norm(plane)  # an offset, or what runs along, is taken in
    teacher = cells(root, "table2")["HF"]["ry1"]
    wide = [float(r["dry"]) for r in rows_of(root, "p1-table1") if float(r["sigma"]) >= 30]
    assert len(wide) == 7
    assert max(wide) < 0.25 * teacher < 0.9 * math.sqrt(1 - 5 / 50) * teacher
    # the mean of |x| is sigma sqrt(2/pi), the RMS in the plane sigma sqrt(2)
    x, y = rng.standard_normal((2, 200_000))
    plane_rms = math.sqrt(np.mean(x**2 + y**2))
    assert plane_rms / np.mean(np.abs(x)) == pytest.approx(math.sqrt(math.pi), rel=0.01)
    assert 0.18 < min(wide) * math.sqrt(math.pi) < max(wide) * math.sqrt(math.pi) < 0.2


def test_velocity_errors_of_the_ls_svm_fall_while_those_of_the_ins_triple(root: Path) -> None:
    three = cells(root, "table3")
    growth = {
        method: {axis: row[axis + "2"] / row[axis + "1"] for axis in ("rx", "ry", "vx", "vy")}
        for method, row in three.items()
    }
    assert growth["INS-only"]["vx"] == pytest.approx(3.46, abs=0.01)
    assert growth["INS-only"]["vy"] == pytest.approx(2.96, abs=0.01)
    assert min(growth["LS-SVM"]["rx"], growth["LS-SVM"]["ry"]) > 8
    assert growth["LS-SVM"]["vx"] == pytest.approx(0.117, abs=1e-3)
    assert growth["LS-SVM"]["vy"] == pytest.approx(0.752, abs=1e-3)


def test_a_matrix_with_the_jitter_is_not_constant() -> None:
    T, jitter = 0.2, 0.0012
    A, E = even_motion(T), jitter * np.eye(4, k=2)
    gain = A @ (0.6 * np.eye(4))
    beta = np.random.default_rng(21).choice([-1.0, 1.0], 1000)
    A_f = A - gain + E * beta[:, None, None]  # (2.24) with C = I
    assert A_f[:, 0, 2].std() == pytest.approx(jitter, rel=0.01)
    moved = A_f.std(axis=0) > 1e-9
    assert sorted(zip(*np.nonzero(moved), strict=True)) == [(0, 2), (1, 3)]


# P2 ----------------------------------------------------------------------------------------------


def test_the_tied_inequality_splits() -> None:
    rng = np.random.default_rng(7)
    n, clusters, gamma = 2, 3, 1.5
    A = [0.3 * random_matrix(rng, n, n) for _ in range(clusters)]
    B = [0.2 * random_matrix(rng, n, 3) for _ in range(clusters)]
    P = [positive(rng, n) + 1.5 * np.eye(n) for _ in range(clusters)]
    S = []
    for a, b, p in zip(A, B, P, strict=True):
        theta = gamma**2 * np.eye(3) - b.T @ p @ b
        assert eigvalsh(theta).min() > 0
        S.append(p - a.T @ p @ a - a.T @ p @ b @ solve(theta, b.T @ p @ a))
        assert eigvalsh(S[-1]).min() > 0
    total = sum(S)
    best = [solve(total, s) for s in S]
    np.testing.assert_allclose(sum(best), np.eye(n), atol=1e-12)

    def spent(M: list[np.ndarray]) -> np.ndarray:
        return sum(m @ solve(s, m.T) for m, s in zip(M, S, strict=True))

    np.testing.assert_allclose(spent(best), inv(total), atol=1e-10)
    for _ in range(50):  # no other weights that add up to I spend less
        free = [random_matrix(rng, n, n) for _ in range(clusters - 1)]
        other = [*free, np.eye(n) - sum(free)]
        assert eigvalsh(spent(other) - spent(best)).min() > -1e-9

    # the whole of (9) is negative exactly if M S^-1 M' <= I; scale the weights to both sides
    def largest(scale: float) -> float:
        a, b, p = block_diag(*A), block_diag(*B), block_diag(*P)
        m, ab = scale * np.hstack(best), np.hstack([a, b])
        lmi = ab.T @ p @ ab + block_diag(m.T @ m - p, -(gamma**2) * np.eye(b.shape[1]))
        return float(eigvalsh(lmi).max())

    edge = 1 / math.sqrt(eigvalsh(spent(best)).max())
    assert largest(0.99 * edge) < 0 < largest(1.01 * edge)


def test_the_noise_of_one_ins_does_not_average_out() -> None:
    # one state, e+ = (1 - g) e + w - g v: closed forms at the frequency zero
    g = 0.6
    for clusters in (3, 30, 300):
        own = norm([1 / clusters, g / clusters] * clusters) / g
        assert own == pytest.approx(norm([1, g]) / g / math.sqrt(clusters))
        true = norm([1, *[g / clusters] * clusters]) / g  # they share one INS
        assert max(own, 1 / g) < true <= math.sqrt(clusters) * own * (1 + 1e-12)
    assert true == pytest.approx(1 / g, rel=1e-3)
    # the map from (w, xi_1 .. xi_N) to N copies of w, and the xi, has the norm sqrt(N)
    assert norm(block_diag(np.ones((5, 1)), np.eye(5)), 2) == pytest.approx(math.sqrt(5))


def test_zero_weights_satisfy_the_fusion_inequality() -> None:
    rng = np.random.default_rng(8)
    A, K = random_matrix(rng, 6, 6), random_matrix(rng, 6, 9)
    A *= 0.95 / abs(np.linalg.eigvals(A)).max()
    P0 = solve_discrete_lyapunov(A.T, np.eye(6))
    for gamma in (1.0, 1e-3):
        P = 1e-4 * gamma**2 / norm(K.T @ P0 @ K, 2) / norm(P0, 2) * P0
        lmi = block_diag(-P, -(gamma**2) * np.eye(9), -P, -np.eye(4))
        lmi[15:21, :15] = P @ np.hstack([A, K])
        lmi[:15, 15:21] = lmi[15:21, :15].T
        assert eigvalsh(lmi).max() < 0


def test_a_cluster_out_of_reach_drifts() -> None:
    T, nu = 0.02, 0.3
    A = even_motion(T)
    np.testing.assert_allclose(np.linalg.eigvals(A), 1)
    e = np.array([0, 0, nu, 0])
    for k in range(1, 500):
        e = A @ e
        assert e[0] == pytest.approx(k * T * nu)
    # noise in the velocities reaches all states, so no weight but zero hides what grows
    B = np.vstack([np.zeros((2, 2)), np.eye(2)])
    assert np.linalg.matrix_rank(np.hstack([B, A @ B])) == 4


def test_the_index_of_p2_is_not_what_its_inequality_bounds() -> None:
    # two scalars without measurement, e+ = a e + w; L sees the first alone
    A, L = np.diag([0.2, 0.9]), np.array([[1.0, 0.0]])

    def gain(out: np.ndarray) -> float:
        z = np.exp(1j * np.linspace(0, math.pi, 400))
        return max(norm(out @ inv(w * np.eye(2) - A), 2) for w in z)

    assert gain(L) == pytest.approx(1 / (1 - 0.2))
    assert gain(np.eye(2)) == pytest.approx(1 / (1 - 0.9))


def test_theta_of_p2_has_the_wrong_size() -> None:
    rng = np.random.default_rng(9)
    n, m, k = 4, 3, 2
    P, A = positive(rng, n), random_matrix(rng, n, n)
    B, K, D = (random_matrix(rng, *shape) for shape in ((n, m), (n, k), (k, k)))
    B_tilde = np.hstack([B, -K @ D])
    PB = A.T @ P @ B_tilde
    with pytest.raises(ValueError, match=r"mismatch|size"):
        PB @ inv(100 * np.eye(m) - B.T @ P @ B) @ PB.T
    # with the right one, (15) is the Schur complement of (16)
    theta = 1000 * np.eye(m + k) - B_tilde.T @ P @ B_tilde
    of_15 = -P + A.T @ P @ A + PB @ solve(theta, PB.T) + np.eye(n)
    row = P @ np.hstack([A, B_tilde])
    reduced = block_diag(np.eye(n) - P, -1000 * np.eye(m + k)) + row.T @ solve(P, row)
    schur = reduced[:n, :n] - reduced[:n, n:] @ solve(reduced[n:, n:], reduced[n:, :n])
    np.testing.assert_allclose(schur, of_15, atol=1e-8)


def test_the_percentages_of_p2_imply_a_worse_rival() -> None:
    def ratio(a: float, b: float) -> float:
        return (1 - a / 100) / (1 - b / 100)

    assert ratio(40, 90) == pytest.approx(6)
    assert min(ratio(a, b) for a in (37.5, 42.5) for b in (87.5, 92.5)) > 4
    assert ratio(82.5, 82.5) == 1  # the edge of what 80 about and 83 rounded allow
    found = [ratio(a, b) for a, b in ((80, 83), (80, 50), (85, 40), (90, 40))]
    np.testing.assert_allclose(found, [1.18, 0.4, 0.25, 0.17], atol=0.01)
    assert pytest.approx(85, abs=2.5) == (90 + 83) / 2
    assert (40 + 83) / 2 == 61.5


def test_sound_needs_longer_than_a_period_of_p2() -> None:
    speed = np.sqrt(1.4 * 8.314 * 293.15 / 0.02897)  # of an ideal gas as light as air, m/s
    assert speed == pytest.approx(343, abs=1)
    assert 12 / speed == pytest.approx(0.035, abs=1e-4)
    assert 0.02 * speed < 7
    assert 5 * 12 / speed < 0.2 < 6 * 12 / speed


def test_a_noise_with_a_mean_has_no_finite_energy() -> None:
    w = 6.5 + 1.2 * np.random.default_rng(10).standard_normal(100000)
    for n in (1000, 100000):
        assert w[:n] @ w[:n] == pytest.approx(n * (6.5**2 + 1.2**2), rel=0.05)


# P3 ----------------------------------------------------------------------------------------------


def test_the_centralised_update_gives_both_estimates() -> None:
    """One sensor after the other, in either order, or both at once."""
    rng = np.random.default_rng(11)
    P, x = positive(rng, 5), random_matrix(rng, 5)
    H1, H2, z1, z2 = (random_matrix(rng, *shape) for shape in ((2, 5), (4, 5), (2,), (4,)))
    R1, R2 = np.diag([0.3, 0.7]), np.diag([1.0, 2.0, 3.0, 4.0])

    def update(x: np.ndarray, P: np.ndarray, z: np.ndarray, H: np.ndarray, R: np.ndarray) -> Any:
        K = P @ H.T @ inv(H @ P @ H.T + R)
        return x + K @ (z - H @ x), P - K @ H @ P

    at_once = update(x, P, np.append(z1, z2), np.vstack([H1, H2]), block_diag(R1, R2))
    first, second = (z1, H1, R1), (z2, H2, R2)
    for one, other in ((first, second), (second, first)):
        for part, whole in zip(update(*update(x, P, *one), *other), at_once, strict=True):
            np.testing.assert_allclose(part, whole, atol=1e-10)


def test_subtracting_an_unrelated_ramp_adds_to_the_error() -> None:
    rng = np.random.default_rng(12)
    first, second = rng.standard_normal((2, 400000))
    for rho, c in ((0.0, 1.0), (0.0, 0.3), (0.4, 0.4), (0.4, 1.0)):
        next_one = rho * first + math.sqrt(1 - rho**2) * second
        left = np.mean((next_one - c * first) ** 2)
        assert left == pytest.approx(1 - 2 * c * rho + c**2, rel=0.02)


def test_a_gaussian_machine_falls_back_to_its_bias() -> None:
    t = np.arange(0.0, 41.0)
    y = 0.02 * t**2
    for sigma in (2.548, 10.0):
        _, alpha = lssvm(gauss(t, t, sigma), y, 100)
        size = sum(map(abs, alpha))
        for far in (5.0, 20.0, 60.0):
            left = abs(gauss(np.array(40 + far), t, sigma) @ alpha)
            assert left <= size * math.exp(-(far**2) / (2 * sigma**2)) * (1 + 1e-12)
        assert left < 1e-3
    # newrb's spread: half of the height at that distance
    assert math.exp(-(3**2) / (2 * 2.548**2)) == pytest.approx(0.5, abs=1e-3)


def test_the_goal_of_the_network_in_radians_is_met_at_once() -> None:
    earth, metres = 6.371e6, 100.0  # a large difference of two modules
    assert (metres / earth) ** 2 < 0.01 < metres**2
    assert math.sqrt(0.01) * earth == pytest.approx(600e3, rel=0.1)


def test_an_ls_svm_is_ridge_regression() -> None:
    rng = np.random.default_rng(13)
    phi, y, eta = random_matrix(rng, 20, 4), random_matrix(rng, 20), 3.0
    b, alpha = lssvm(phi @ phi.T, y, eta)
    centred = phi - phi.mean(axis=0)
    ridge = solve(
        centred.T @ centred + np.eye(4) / eta, centred.T @ (y - y.mean())
    )  # the bias is not penalised
    np.testing.assert_allclose(phi.T @ alpha, ridge, atol=1e-10)
    assert b == pytest.approx(y.mean() - phi.mean(axis=0) @ ridge)


def test_a_yaw_error_moves_an_ins_by_its_change_of_velocity() -> None:
    t = np.linspace(0, 40, 40001)
    dt, phi = t[1], math.radians(0.5)
    J = np.array([[0, 1], [-1, 0]])
    for speed, rate in ((14.0, 0.0), (14.0, math.pi / 2 / 40)):
        heading = rate * t
        v = speed * np.stack([np.sin(heading), np.cos(heading)])  # east, north
        f = np.gradient(v, t, axis=1)
        # dv' = f x (0, 0, phi) in east and north
        dv = np.cumsum(phi * np.stack([f[1], -f[0]]), axis=1) * dt
        dp = np.cumsum(dv, axis=1)[:, -1] * dt
        way = np.cumsum(v, axis=1)[:, -1] * dt
        expected = phi * J @ (way - v[:, 0] * 40)
        np.testing.assert_allclose(dp, expected, atol=2e-2)
        assert (norm(dp) < 1e-6) == (rate == 0)
    tilt = math.radians(0.1)
    assert 9.81 * tilt * 40**2 / 2 == pytest.approx(14, abs=0.5)
