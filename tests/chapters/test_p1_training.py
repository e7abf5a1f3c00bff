"""Evidence p1-training: its results against closed forms and the printed cells."""

from __future__ import annotations

import numpy as np
import pytest
from inswsn_book.record.results import Results
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

CHAPTER = "p1-training"
HALF_NORMAL = np.sqrt(2 / np.pi)  # mean absolute value of a standard normal number


BY_HAND = {
    "timeline.text.way2": 150.0,
    "timeline.matrices.way2": 150 / 20 * 21,
    "timeline.diagonal2": 100 * 2**0.5,
    "kf.share.rx1": 2.9170 / 7.8315,
    "kf.share.rx2": 14.9663 / 40.6179,
    "kf.share.ry1": 1.7916 / 4.7923,
    "kf.share.ry2": 13.2591 / 36.0891,
    "headline.published-ratio": (2.9170 + 14.9663 + 1.7916 + 13.2591)
    / (0.3881 + 0.4958 + 0.5338 + 0.8464),
    "hf.needed.least": 0.3881 / HALF_NORMAL,
    "hf.needed.most": 0.8464 / HALF_NORMAL,
    "scene.area1-side": 150,
    "scene.jitter1": -0.0012,
    "scene.velocity-noise": 0.126,
}


@pytest.mark.parametrize(("name", "expected"), BY_HAND.items())
def test_a_number_worked_out_by_hand(results: Results, name: str, expected: float) -> None:
    assert results[name].value == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("area", ["1", "2"])
def test_the_network_has_the_mean_error_of_gaussian_noise(results: Results, area: str) -> None:
    # standard error of the median of 1,024 means of 100 numbers: 0.3 %
    assert results[f"table2.wsn.vx{area}"].value == pytest.approx(0.126 * HALF_NORMAL, rel=0.02)
    sigma = results["wsn.accuracy"].value / 100 / 2**0.5
    assert results[f"table2.wsn.rx{area}"].value == pytest.approx(sigma * HALF_NORMAL, rel=0.05)


BY_COLUMN = ("rx1", "ry1", "vx1", "vy1", "rx2", "ry2", "vx2", "vy2")


@pytest.mark.parametrize("column", BY_COLUMN)
def test_the_published_filter_is_the_network(results: Results, column: str) -> None:
    filtered = results[f"table2.hf-printed-filtered.{column}"]
    assert filtered.value == pytest.approx(results[f"table2.wsn.{column}"].value, rel=1e-9)


def test_a_kalman_filter_with_identities_has_the_error_of_its_steady_gain(results: Results) -> None:
    """On the straight part of area 1 nothing but the noise of the network is left."""
    A = np.eye(4)
    A[0, 2] = A[1, 3] = 0.2
    P = solve_discrete_are(A.T, np.eye(4), np.eye(4), np.eye(4))
    K = P @ np.linalg.inv(P + np.eye(4))
    sigma = results["wsn.accuracy"].value / 100 / 2**0.5
    R = np.diag([sigma, sigma, 0.126, 0.126]) ** 2
    spread = solve_discrete_lyapunov((np.eye(4) - K) @ A, K @ R @ K.T)
    found = results["table2.kf-identity-filtered.rx1"].value
    assert found == pytest.approx(np.sqrt(spread[0, 0]) * HALF_NORMAL, rel=0.05)


def test_designs_have_the_known_gamma_of_identities(results: Results) -> None:
    # the least gamma of P1's model with identities, found by two other solvers to five digits
    assert results["design.exact.identity1"].value == pytest.approx(1.48967, abs=1e-4)
    assert results["design.printed.identity1"].value == pytest.approx(1.48970, abs=1e-4)
    # deadbeat: gamma^2 is the largest eigenvalue of I + A A'
    A = np.eye(4)
    A[0, 2] = A[1, 3] = 0.2
    expected = np.sqrt(np.linalg.eigvalsh(np.eye(4) + A @ A.T).max())
    assert results["design.deadbeat1"].value == pytest.approx(expected, rel=1e-6)


# The percentages of the text ---------------------------------------------------------------------

PAIRS = {
    "": ("kf-matched-filtered", "hf-printed-filtered"),
    "predicted.": ("kf-matched-predicted", "hf-printed-predicted"),
    "identity.": ("kf-identity-filtered", "hf-printed-filtered"),
}


@pytest.mark.parametrize("prefix", PAIRS)
def test_the_orderings_of_the_text_follow_from_the_cells(results: Results, prefix: str) -> None:
    kf, hf, ins = (
        {c: results[f"table2.{method}.{c}"].value for c in BY_COLUMN}
        for method in (*PAIRS[prefix], "ins")
    )
    found = {
        "first-area.position-ordered": sum(hf[c] < kf[c] < ins[c] for c in ("rx1", "ry1")),
        "first-area.velocity-smallest": sum(hf[c] < min(kf[c], ins[c]) for c in ("vx1", "vy1")),
        "second-area.halved": sum(hf[c] <= kf[c] / 2 for c in BY_COLUMN if c[2] == "2"),
    }
    for name, count in found.items():
        assert results[f"{prefix}percent.{name}"].value == count
    for axis in ("rx", "ry", "vx", "vy"):  # a median of ratios is near the ratio of medians
        ratio = 100 * (1 - hf[f"{axis}1"] / kf[f"{axis}1"])
        assert results[f"{prefix}percent.{axis}"].value == pytest.approx(ratio, abs=5)


def test_a_filter_without_memory_leaves_the_golden_share(results: Results) -> None:
    """With Q = R = I its gain is the golden ratio less one; what it leaves, HF is held against."""
    left = 1 - (5**0.5 - 1) / 2
    for axis in ("rx", "ry"):
        ins = results[f"table2.ins.{axis}1"].value
        hf = results[f"table2.hf-printed-predicted.{axis}1"].value
        expected = 100 * (1 - hf / (left * ins))
        assert results[f"zero.percent.{axis}"].value == pytest.approx(expected, abs=1)
    for name, columns in (("first-area.position-ordered", 2), ("second-area.halved", 4)):
        assert results[f"zero.percent.{name}"].value == columns
