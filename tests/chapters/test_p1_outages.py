"""Evidence p1-outages: its results against closed forms, another route and the printed cells."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from inswsn_book.record.results import Results
from sklearn.kernel_ridge import KernelRidge
from sklearn.linear_model import LinearRegression, Ridge

from inswsn_lib.evaluation import monte_carlo
from inswsn_lib.scenario import from_settings, load_scenario
from inswsn_lib.simulation import Scene

CHAPTER = "p1-outages"
HALF_NORMAL = np.sqrt(2 / np.pi)  # mean absolute value of a standard normal number
COLUMNS = [f"{axis}{half}" for axis in ("rx", "ry", "vx", "vy") for half in "12"]


@pytest.fixture(scope="module")
def drawn(root: Path) -> dict[str, np.ndarray]:
    """The first runs of the chapter, drawn again."""
    scenarios = root / "data" / "scenarios"
    settings = load_scenario(scenarios / "p1.yaml") | load_scenario(scenarios / "p1-inertial.yaml")
    return monte_carlo(from_settings(Scene, settings).simulate, 64, 2012)


BY_HAND = {
    "table1.sigma-best": 1,
    "table1.eta-best": 2,
    "table1.best-position": (0.2331 + 0.1067) / 2,
    "table1.chosen-position": (0.2903 + 0.1063) / 2,
    "table1.rank-of-chosen": 8,
    "table1.velocity-margin": 1000 * ((0.0923 + 0.0903) / 2 - (0.0922 + 0.0900) / 2),
    "table1.same-lambda-printed": 100 * (1 - 0.2641 / 0.2862),
    "outage.longest": 8 * 8.7879 / 2.0265,
    "percent.least-printed": 100 * (1 - 5.2938 / 36.4784),
    "slip.reduction": 100 * (1 - 0.092 / 1.1008),
    "slip.against-hf": 0.1041 / 0.0092,
    "slip.floor": 0.126 * HALF_NORMAL / 10,
    "headline.least": 100 * 0.0092 / 3.0793,
    "headline.bp-most": 100 * 0.6502 / 0.8897,
    "jitter.share": 0.0012 / 0.2,
    "linear.lambda": 1000,
    "mode.training": 200,
    "mode.predictor": 100,
}


@pytest.mark.parametrize(("name", "expected"), BY_HAND.items())
def test_a_number_worked_out_by_hand(results: Results, name: str, expected: float) -> None:
    assert results[name].value == pytest.approx(expected, rel=1e-9)


def test_targets_scatter_by_the_noise_of_the_network(results: Results) -> None:
    assert results["floor.velocity"].value == pytest.approx(0.126 * HALF_NORMAL, rel=0.01)


def kernel_errors(drawn: dict[str, np.ndarray], half: str, runs: int) -> np.ndarray:
    """Return Table 3's LS-SVM errors by another library, (steps, components, runs).

    On targets less their mean, with the kernel double-centred, KernelRidge is an LS-SVM.
    """
    errors = []
    for r in range(runs):
        X = drawn[f"ins.area{half}"][:, :, r]
        y = X - drawn[f"wsn.area{half}"][:, :, r]
        Z = drawn[f"ins.outage{half}"][:, :, r]
        squares = [((a[:, None] - X[None]) ** 2).sum(axis=2) for a in (X, Z)]
        K, k = (np.exp(-s / (2 * 1000.0**2)) for s in squares)
        centred = K - K.mean(axis=0) - K.mean(axis=1)[:, None] + K.mean()
        ahead = k - k.mean(axis=1)[:, None] - K.mean(axis=0) + K.mean()
        ridge = KernelRidge(alpha=1 / 1000, kernel="precomputed").fit(centred, y - y.mean(axis=0))
        errors.append(Z - ridge.predict(ahead) - y.mean(axis=0))
    return np.stack(errors, axis=2)


@pytest.mark.parametrize("half", ["1", "2"])
def test_table_3_of_the_machine_by_another_library(
    results: Results, drawn: dict[str, np.ndarray], half: str
) -> None:
    """The median of 64 runs against that of 256: standard error of 64 below an eighth of spread."""
    found = np.median(np.abs(kernel_errors(drawn, half, 64)).mean(axis=0), axis=1)
    for axis, value in zip(("rx", "ry", "vx", "vy"), found, strict=True):
        q = results[f"table3.lssvm.{axis}{half}"]
        assert abs(value - q.value) < (q.interval[1] - q.interval[0]) / 4


def test_the_machine_is_a_ridge_of_1000(results: Results, drawn: dict[str, np.ndarray]) -> None:
    """In position, with scikit-learn's ridge regression in place of the kernel."""
    X = drawn["ins.area2"][:, :, 0]
    y, Z = X - drawn["wsn.area2"][:, :, 0], drawn["ins.outage2"][:, :, 0]
    ridge = Z - Ridge(1000.0).fit(X, y).predict(Z)
    kernel = kernel_errors(drawn, "2", 1)[:, :, 0]
    largest = np.abs(ridge - kernel)[:, :2].max()
    assert largest <= results["linear.prediction"].value * 1.001
    assert results["linear.prediction"].value < 0.01 * results["linear.size"].value


def test_your_own_method_is_least_squares(results: Results, drawn: dict[str, np.ndarray]) -> None:
    """The default of the parameter, on the oracle, by hand: median of 64 runs within a tenth."""
    shares = []
    for half in "12":
        for r in range(64):
            X = drawn[f"ins.area{half}"][:, :, r]
            Z = drawn[f"ins.outage{half}"][:, :, r]
            line = LinearRegression().fit(X, X - drawn[f"wsn.area{half}"][:, :, r])
            shares.append(np.abs(Z - line.predict(Z)).mean(axis=0) / np.abs(Z).mean(axis=0))
    by_run = np.array(shares).reshape(2, 64, 4).mean(axis=(0, 2))
    assert results["own.oracle"].value == pytest.approx(100 * np.median(by_run), rel=0.25)


# Readings of sigma and of the scaling ------------------------------------------------------------


@pytest.mark.parametrize("prefix", ["", "scaled.", "square.", "square-scaled."])
def test_what_is_said_of_table_3_follows_from_the_cells(results: Results, prefix: str) -> None:
    ins, bp = ({c: results[f"table3.{m}.{c}"].value for c in COLUMNS} for m in ("ins", "bp"))
    own = {c: results[f"{prefix}table3.lssvm.{c}"].value for c in COLUMNS}
    found = {
        "lssvm-smallest": sum(own[c] < min(ins[c], bp[c]) for c in COLUMNS),
        "lssvm-below-ins": sum(own[c] < ins[c] for c in COLUMNS),
        "lssvm-below-bp": sum(own[c] < bp[c] for c in COLUMNS),
        "second-outage-halved": sum(own[c] <= bp[c] / 2 for c in COLUMNS if c[2] == "2"),
        "first-outage.position-smallest": sum(own[c] < bp[c] < ins[c] for c in ("rx1", "ry1")),
        "first-outage.velocity-smallest": sum(own[c] < bp[c] < ins[c] for c in ("vx1", "vy1")),
    }
    for name, count in found.items():
        assert results[f"{prefix}table3.{name}"].value == count
