"""Local constant-gain filters and their fusion, against plain loops and filters known otherwise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from random_filters import PATTERNS, gappy, random_weights

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import deadbeat_gain, handover_weights, patterns_of, run_distributed
from inswsn_lib.lmi import design_filter, design_fusion
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2, process_noise=(0.1, 0.3), measurement_noise=(0.4, 0.2))
STEPS = 40
ALL = (True, True, True)
ALONE = np.stack([np.eye(4), np.zeros((4, 4))])
FLAT = ErrorModel(A=np.diag([1, 1, 1, 0]), B=np.eye(4), C=np.eye(4), D=np.eye(4), period=1.0)


def random_designs(rng: np.random.Generator) -> list[Any]:
    """Three filters that each measure and correct in a way of their own."""
    made = []
    for _ in range(3):
        C = np.eye(4) + 0.2 * rng.normal(size=(4, 4))
        model = ErrorModel(A=MODEL.A, B=MODEL.B, C=C, D=MODEL.D, period=0.2)
        made.append((model, np.diag(rng.uniform(0.2, 0.8, 4)) @ np.linalg.inv(C)))
    return made


def by_hand(
    designs: list[Any], y: np.ndarray, weights: Any, handover: str, margins: Any, lost: Any,
    delays: tuple[int, ...], start: np.ndarray, asked: set[tuple[bool, ...]],
) -> np.ndarray:  # fmt: skip
    """Return the fused predictions of one run, y (N, steps, m), the start first.

    The patterns whose weights are asked for are added to a set.
    """
    A, clusters = MODEL.A, len(designs)
    x, fused = [start.copy() for _ in range(clusters)], [start]
    sent: list[list[tuple[np.ndarray, bool, float]]] = []
    for k in range(y.shape[1]):
        messages = []
        for c, (model, gain) in enumerate(designs):
            innovation = y[c, k] - model.C @ x[c]
            innovation[np.isnan(innovation)] = 0.0
            heard = not np.isnan(y[c, k]).all()
            margin = 1.0 if margins is None else margins[c, k]
            messages.append((A @ x[c] + gain @ innovation, heard, margin))
        sent.append(messages)
        known = []
        for c in range(clusters):
            arrived = [j for j in range(k - delays[c] + 1) if lost is None or not lost[c, j]]
            if arrived:
                state, heard, margin = sent[arrived[-1]][c]
                carried = np.linalg.matrix_power(A, k - arrived[-1]) @ state
            else:
                carried, heard, margin = np.linalg.matrix_power(A, k + 1) @ start, False, 1.0
            known.append((carried, heard, margin))
        if handover == "constant":
            result = sum(M @ state for M, (state, _, _) in zip(weights, known, strict=True))
        else:
            inside = tuple(heard and margin > 0 for _, heard, margin in known)
            factors = [margin for _, _, margin in known]
            if not any(inside):
                inside, factors = tuple(heard for _, heard, _ in known), [1.0] * clusters
            if any(inside):
                asked.add(tuple(bool(hears) for hears in inside))
                W = [factor * M for factor, M in zip(factors, weights[inside], strict=True)]
                total = sum(M @ state for M, (state, _, _) in zip(W, known, strict=True))
                result = np.linalg.solve(sum(W), total)
            else:
                result = A @ fused[-1]
        fused.append(result)
        for c, (state, heard, _) in enumerate(messages):
            x[c] = state if heard or handover == "constant" else result
    return np.array(fused)


@pytest.mark.parametrize("handover", ["restart", "constant", "fading"])
@pytest.mark.parametrize("losing", [False, True])
@pytest.mark.parametrize("delay", [0, 2, (0, 3, 1), (50, 0, 0)])
@pytest.mark.parametrize("shared", [False, True])
def test_it_is_the_recursion_written_out(
    handover: Any, losing: bool, delay: Any, shared: bool
) -> None:
    rng = np.random.default_rng(21)
    designs, runs, own = random_designs(rng), 4, 1 if shared else 4
    y, start = gappy(rng, (3, STEPS, 4, runs), shared=shared), rng.normal(size=(4, runs))
    margins = rng.uniform(0, 1, (3, STEPS, own))
    margins[rng.random(margins.shape) < 0.3] = 0.0
    lost = np.broadcast_to(rng.random((3, STEPS, own)) < 0.4, (3, STEPS, runs))
    weights: Any = random_weights(rng, 4)
    weights = weights[ALL] if handover == "constant" else weights
    links: dict[str, Any] = {"delay": delay, "lost": lost if losing else None}
    if handover == "fading":
        links["margins"] = margins[..., 0] if shared else margins
    options = {"weights": weights, "handover": handover, "initial_state": start} | links
    predicted = run_distributed(designs, y, predicted=True, **options)
    filtered = run_distributed(designs, y, **options)
    asked: set[tuple[bool, ...]] = set()
    for run in range(runs):
        expected = by_hand(
            designs, y[..., run], weights, handover,
            margins[..., run % own] if handover == "fading" else None,
            lost[..., run] if losing else None, tuple(np.broadcast_to(delay, 3)), start[:, run],
            asked,
        )  # fmt: skip
        assert predicted[:, :, run] == pytest.approx(expected[:-1], rel=1e-9, abs=1e-9)
        undone = np.linalg.solve(MODEL.A, expected[1:].T).T
        assert filtered[:, :, run] == pytest.approx(undone, rel=1e-8, abs=1e-8)
    if handover != "constant":
        assert patterns_of(y, **links) == sorted(asked)


def test_weights_switch_exactly_at_the_handover() -> None:
    """With deadbeat gains a filtered estimate is the weighted mean of the data of its step."""
    y = np.empty((2, 9, 4, 1))
    y[0], y[1] = 1.0, 2.0
    y[1, :3] = y[0, 6:] = np.nan
    y[:, 8] = np.nan
    quarter = np.stack([0.25 * np.eye(4), 0.75 * np.eye(4)])
    weights = {(True, True): quarter, (True, False): ALONE, (False, True): ALONE[::-1]}
    filters = [(MODEL, deadbeat_gain(MODEL))] * 2
    found = run_distributed(filters, y, weights=weights)
    expected = np.repeat([1, 1, 1, 1.75, 1.75, 1.75, 2, 2], 4).reshape(8, 4)
    assert found[:8, :, 0] == pytest.approx(expected)
    assert found[8] == pytest.approx(MODEL.A @ found[7])  # none hears the node
    # margins 1 and 1/3 take both to a half, and margin 0 is no weight
    margins = np.array([[1] * 9, [1 / 3] * 4 + [0] * 5])
    fading = run_distributed(filters, y, weights=weights, handover="fading", margins=margins)
    assert fading[3:6, 0, 0] == pytest.approx([1.5, 1, 1])


def test_constant_weights_grow_without_bound_where_a_restart_does_not() -> None:
    """The truth moves at 1 m/s from rest at 0 as known; only the first cluster hears it.

    The deaf one stays at 0, so that its position error is the time, and the fused error half of it.
    """
    steps, period = 1000, 0.2
    truth = np.zeros((steps, 4, 1))
    truth[:, 2:] = 1.0
    truth[:, :2, 0] = period * np.arange(steps)[:, None]
    y = np.stack([truth, np.full(truth.shape, np.nan)])
    designs = [(MODEL, deadbeat_gain(MODEL))] * 2
    weights = {(True, True): np.stack([0.5 * np.eye(4)] * 2), (True, False): ALONE}
    found = run_distributed(designs, y, weights=weights, handover="constant")
    assert found[:, :2] == pytest.approx(0.5 * truth[:, :2], abs=1e-9)
    assert run_distributed(designs, y, weights=weights) == pytest.approx(truth, abs=1e-9)


def test_weights_of_a_handover_are_those_of_the_clusters_that_are_heard() -> None:
    """The better cluster has more weight, and one that is alone all of it."""
    model = MODEL.contracted(0.9)
    designs = [design_filter(model.with_covariances(np.eye(4), s * np.eye(4))) for s in (1, 4, 9)]
    options: dict[str, Any] = {"margin": 0.1, "solver": "clarabel"}
    found = handover_weights(designs, iter(PATTERNS), "independent", "block", **options)
    assert list(found) == PATTERNS
    for pattern, weights in found.items():
        expected, heard = np.zeros((3, 4, 4)), np.flatnonzero(pattern)
        of = design_fusion([designs[c] for c in heard], "independent", "block", **options)
        expected[heard] = of.weights
        assert weights == pytest.approx(expected, abs=1e-6)
        shares = np.trace(weights, axis1=1, axis2=2)[heard]
        assert sum(shares) == pytest.approx(4)
        assert [*shares] == sorted(shares, reverse=True)
    plain = handover_weights(designs, [ALL])
    assert plain[ALL] == pytest.approx(design_fusion(designs).weights)
    y = np.random.default_rng(28).normal(size=(3, 9, 4, 3))
    run_distributed(designs, y, weights=plain)
    with pytest.raises(ParameterError, match="patterns"):
        handover_weights(designs, [(True, False)])


def test_patterns_that_occur() -> None:
    y = np.zeros((2, 4, 3, 2))
    y[0, 1, :, 1] = np.nan
    y[1, 1, :2] = np.nan  # one component is left
    y[:, 2] = np.nan
    assert patterns_of(y) == [(False, True), (True, True)]
    # a message that is lost is known by the one before; none has come before step 0
    lost = np.zeros((2, 4, 2), bool)
    lost[1, 0] = True
    assert patterns_of(y, lost=lost) == [(False, True), (True, False), (True, True)]
    assert patterns_of(y, delay=(0, 3)) == [(True, False), (True, True)]
    margins = np.ones((2, 4))
    margins[1, 3] = 0.0
    assert patterns_of(y, margins=margins) == [(False, True), (True, False), (True, True)]
    assert patterns_of(np.full((2, 3, 4, 1), np.nan)) == []


def test_as_many_clusters_as_an_integer_has_bits_for() -> None:
    """The highest cluster is told from none; one more than 62 is refused."""
    y = np.zeros((62, 3, 4, 2))
    y[:61, 1], y[:, 2, :, 1] = np.nan, np.nan
    assert patterns_of(y) == [(False,) * 61 + (True,), (True,) * 62]
    with pytest.raises(ParameterError, match=r"measurements .* not 63"):
        patterns_of(np.zeros((63, 2, 4, 1)))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"designs": [(MODEL, np.eye(3))] * 2}, "gain .* not of shape"),
        ({"designs": [(MODEL, np.eye(4)), MODEL]}, "designs .* not of ErrorModel"),
        ({"designs": [(MODEL, np.eye(4)), (ErrorModel.p1(0.3), np.eye(4))]}, "of different ones"),
        ({"measurements": np.zeros((3, 5, 4, 1))}, "measurements .* not of shape"),
        ({"weights": np.eye(4)}, "weights .* not of shape"),
        ({"weights": np.stack([np.eye(4)] * 2)}, "weights must be of sum I, .*not those for"),
        ({"weights": {(True,): np.eye(4)[None]}}, "weights .* not of shape"),
        ({"weights": {(True, False): np.stack([0.5 * np.eye(4)] * 2)}}, "and zero for clusters"),
        ({"weights": {(True, False): ALONE}}, r"weights .* not without \(True, True\)"),
        ({"handover": "soft"}, "handover .* not 'soft'"),
        ({"handover": "fading"}, "margins .* not None"),
        ({"margins": np.ones((2, 5))}, "margins .* not array"),
        ({"handover": "fading", "margins": np.ones((2, 4))}, "margins .* not of shape"),
        ({"handover": "fading", "margins": np.full((2, 5), 1.1)}, "margins must be between 0"),
        ({"handover": "fading", "margins": np.full((2, 5), -0.1)}, "margins must be between 0"),
        ({"lost": np.zeros((2, 5), bool)}, "lost .* not of shape"),
        ({"delay": -1}, "delay .* not -1"),
        ({"delay": 0.5}, "delay .* not 0.5"),
        ({"delay": (1, 2, 3)}, "delay .* not of shape"),
        ({"designs": [(FLAT, np.eye(4))] * 2}, "predicted .* not False"),
    ],
)
def test_what_does_not_fit_is_refused(changed: dict[str, Any], said: str) -> None:
    fine: dict[str, Any] = {
        "designs": [(MODEL, np.eye(4))] * 2,
        "measurements": np.zeros((2, 5, 4, 1)),
        "weights": np.stack([0.5 * np.eye(4)] * 2),
    }
    with pytest.raises(ParameterError, match=said):
        run_distributed(**(fine | changed))
