"""Local constant-gain filters and their fusion, against plain loops and filters known otherwise."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inswsn_lib.errors import ParameterError
from inswsn_lib.filters import (
    deadbeat_gain,
    distributed,
    handover_weights,
    patterns_of,
    predictor_gain,
    run_distributed,
    run_hinfinity,
    run_switched,
)
from inswsn_lib.lmi import design_filter
from inswsn_lib.models import ErrorModel

MODEL = ErrorModel.p1(0.2, process_noise=(0.1, 0.3), measurement_noise=(0.4, 0.2))
STEPS = 40
ALL = (True, True, True)
PATTERNS = [tuple(bool(code >> c & 1) for c in range(3)) for code in range(1, 8)]


def random_designs(rng: np.random.Generator, clusters: int = 3) -> list[Any]:
    """Filters that each measure and correct in a way of their own."""
    made = []
    for _ in range(clusters):
        C = np.eye(4) + 0.2 * rng.normal(size=(4, 4))
        model = ErrorModel(A=MODEL.A, B=MODEL.B, C=C, D=MODEL.D, L=MODEL.L, E=MODEL.E, period=0.2)
        made.append((model, np.diag(rng.uniform(0.2, 0.8, 4)) @ np.linalg.inv(C)))
    return made


def random_weights(rng: np.random.Generator) -> dict[tuple[bool, ...], np.ndarray]:
    """Full matrices for each pattern, positive definite before they are made to add up to I."""
    found = {}
    for pattern in PATTERNS:
        roots = rng.normal(size=(3, 4, 4))
        M = roots @ np.swapaxes(roots, 1, 2) * np.array(pattern)[:, None, None]
        found[pattern] = np.linalg.inv(M.sum(axis=0)) @ M
    return found


def random_data(rng: np.random.Generator, runs: int) -> np.ndarray:
    """Clusters come and go for some steps on end; single components are missing as well."""
    y = rng.normal(size=(3, STEPS, 4, runs))
    away = rng.random((3, STEPS // 4, 1, runs)) < 0.5
    y[np.broadcast_to(away.repeat(4, axis=1), y.shape)] = np.nan
    y[rng.random(y.shape) < 0.1] = np.nan
    y[:, 20:24, :, 0] = np.nan
    return y


def by_hand(
    designs: list[Any],
    y: np.ndarray,
    weights: Any,
    handover: str,
    margins: Any,
    lost: Any,
    delays: tuple[int, ...],
    start: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return predicted and filtered estimates of one run: y (N, steps, m), start (n,)."""
    A, clusters = MODEL.A, len(designs)
    x, fused = [start.copy() for _ in range(clusters)], start
    sent: list[list[tuple[np.ndarray, bool, float]]] = []
    predicted, filtered = [], []
    for k in range(y.shape[1]):
        predicted.append(fused)
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
            fused = sum(M @ state for M, (state, _, _) in zip(weights, known, strict=True))
        else:
            inside = tuple(heard and margin > 0 for _, heard, margin in known)
            factors = [margin for _, _, margin in known]
            if not any(inside):
                inside, factors = tuple(heard for _, heard, _ in known), [1.0] * clusters
            if any(inside):
                W = [factor * M for factor, M in zip(factors, weights[inside], strict=True)]
                total = sum(M @ state for M, (state, _, _) in zip(W, known, strict=True))
                fused = np.linalg.solve(sum(W), total)
            else:
                fused = A @ fused
        for c, (state, heard, _) in enumerate(messages):
            x[c] = state if heard or handover == "constant" else fused
        filtered.append(np.linalg.solve(A, fused))
    return np.array(predicted), np.array(filtered)


@pytest.mark.parametrize("handover", ["restart", "constant", "fading"])
@pytest.mark.parametrize("losing", [False, True])
@pytest.mark.parametrize("delay", [0, 2, (0, 3, 1)])
@pytest.mark.parametrize("shared", [False, True])
def test_it_is_the_recursion_written_out(
    handover: Any, losing: bool, delay: Any, shared: bool
) -> None:
    rng = np.random.default_rng(21)
    designs, runs = random_designs(rng), 4
    y = random_data(rng, runs)
    margins = rng.uniform(0, 1, (3, STEPS, runs))
    margins[rng.random(margins.shape) < 0.3] = 0.0
    lost = rng.random((3, STEPS, runs)) < 0.4
    if shared:  # one pattern of data and losses for all runs
        y = np.where(np.isnan(y[..., :1]), np.nan, np.nan_to_num(y, nan=0.7))
        lost, margins = lost[..., :1].repeat(runs, axis=2), margins[..., :1].repeat(runs, axis=2)
    weights: Any = random_weights(rng)
    if handover == "constant":
        weights = weights[ALL]
    start = rng.normal(size=(4, runs))
    options: dict[str, Any] = {"weights": weights, "handover": handover, "delay": delay,
                               "initial_state": start}  # fmt: skip
    if losing:
        options["lost"] = lost
    if handover == "fading":
        options["margins"] = margins[..., 0] if shared else margins
    predicted = run_distributed(designs, y, **options)
    filtered = run_distributed(designs, y, predicted=False, **options)
    assert predicted[0] == pytest.approx(start)
    for run in range(runs):
        expected = by_hand(
            designs, y[..., run], weights, handover,
            margins[..., run] if handover == "fading" else None,
            lost[..., run] if losing else None,
            tuple(np.broadcast_to(delay, 3)), start[:, run],
        )  # fmt: skip
        assert predicted[:, :, run] == pytest.approx(expected[0], rel=1e-9, abs=1e-9)
        assert filtered[:, :, run] == pytest.approx(expected[1], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("handover", ["restart", "constant"])
@pytest.mark.parametrize("predicted", [True, False])
def test_one_cluster_is_the_h_infinity_filter(handover: Any, predicted: bool) -> None:
    rng = np.random.default_rng(22)
    design = design_filter(MODEL)
    y = rng.normal(size=(1, STEPS, 4, 3))
    y[rng.random(y.shape) < 0.3] = np.nan
    y[:, 5:9] = np.nan
    found = run_distributed([design], y, weights=np.eye(4)[None], handover=handover,
                            predicted=predicted)  # fmt: skip
    assert found == pytest.approx(run_hinfinity(design, y[0], predicted=predicted), abs=1e-10)


def test_two_clusters_that_are_equal_in_all_are_one() -> None:
    rng = np.random.default_rng(23)
    design = (MODEL, predictor_gain(MODEL))
    y = rng.normal(size=(1, STEPS, 4, 3))
    y[:, 10:15] = np.nan
    M = rng.normal(size=(4, 4))
    found = run_distributed([design] * 2, np.concatenate([y, y]),
                            weights={(True, True): [M, np.eye(4) - M]})  # fmt: skip
    assert found == pytest.approx(run_hinfinity(design, y[0]), abs=1e-10)


def test_weights_switch_exactly_at_the_handover() -> None:
    """With deadbeat gains a filtered estimate is the weighted mean of the data of its step."""
    y = np.empty((2, 9, 4, 1))
    y[0], y[1] = 1.0, 2.0
    y[1, :3] = y[0, 6:] = np.nan
    y[:, 8] = np.nan
    quarter = np.stack([0.25 * np.eye(4), 0.75 * np.eye(4)])
    alone = np.stack([np.eye(4), np.zeros((4, 4))])
    weights = {(True, True): quarter, (True, False): alone, (False, True): alone[::-1]}
    found = run_distributed([(MODEL, deadbeat_gain(MODEL))] * 2, y, weights=weights,
                            predicted=False)  # fmt: skip
    assert found[:8, :, 0] == pytest.approx(np.repeat([1, 1, 1, 1.75, 1.75, 1.75, 2, 2], 4)
                                            .reshape(8, 4))  # fmt: skip
    assert found[8] == pytest.approx(MODEL.A @ found[7])  # none hears the node


def test_a_cluster_that_returns_starts_from_the_fused_state() -> None:
    """One of no gain at all shows what state it has: the fused one of its last deaf step, moved."""
    rng = np.random.default_rng(24)
    y = rng.normal(size=(2, 12, 4, 2))
    y[1, 3:7] = np.nan
    y[0, 7:] = np.nan
    designs = [(MODEL, predictor_gain(MODEL)), (MODEL, np.zeros((4, 4)))]
    alone = np.stack([np.eye(4), np.zeros((4, 4))])
    weights = {(True, True): alone, (True, False): alone, (False, True): alone[::-1]}
    found = run_distributed(designs, y, weights=weights)
    known = run_hinfinity(designs[0], y[0])
    assert found[:8] == pytest.approx(known[:8], abs=1e-12)
    for k in range(8, 12):
        expected = np.linalg.matrix_power(MODEL.A, k - 7) @ known[7]
        assert found[k] == pytest.approx(expected, abs=1e-12)


def test_constant_weights_grow_without_bound_where_a_restart_does_not() -> None:
    """The truth moves at 1 m/s from rest at 0 as known; only the first cluster hears it.

    The deaf one stays at 0, so that its position error is the time, and the fused error half of it.
    """
    steps, period = 4000, 0.2
    truth = np.zeros((steps, 4, 1))
    truth[:, 2:] = 1.0
    truth[:, :2, 0] = period * np.arange(steps)[:, None]
    y = np.stack([truth, np.full(truth.shape, np.nan)])
    designs = [(MODEL, deadbeat_gain(MODEL))] * 2
    half = np.stack([0.5 * np.eye(4)] * 2)
    found = run_distributed(designs, y, weights=half, handover="constant")
    assert found[1:, :2] == pytest.approx(0.5 * truth[1:, :2])
    alone = np.stack([np.eye(4), np.zeros((4, 4))])
    restarted = run_distributed(designs, y, weights={(True, True): half, (True, False): alone})
    assert restarted[1:] == pytest.approx(truth[1:])


def test_margins_of_one_or_all_alike_change_nothing() -> None:
    rng = np.random.default_rng(25)
    designs, weights, y = random_designs(rng), random_weights(rng), random_data(rng, 5)
    restart = run_distributed(designs, y, weights=weights)
    for margins in (np.ones((3, STEPS)), np.full((3, STEPS, 5), 0.3), np.zeros((3, STEPS))):
        fading = run_distributed(designs, y, weights=weights, handover="fading", margins=margins)
        assert fading == pytest.approx(restart, abs=1e-9)


def test_a_margin_moves_the_weight_in_proportion() -> None:
    """Scalar weights 1/4 and 3/4, margins 1 and 1/3: both have half; and margin 0 is no weight."""
    y = np.empty((2, 2, 4, 1))
    y[0], y[1] = 1.0, 2.0
    quarter = np.stack([0.25 * np.eye(4), 0.75 * np.eye(4)])
    weights = {(True, True): quarter, (True, False): np.stack([np.eye(4), np.zeros((4, 4))])}
    found = run_distributed([(MODEL, deadbeat_gain(MODEL))] * 2, y, weights=weights,
                            handover="fading", margins=[[1, 0.5], [1 / 3, 0]],
                            predicted=False)  # fmt: skip
    assert found[0] == pytest.approx(1.5)
    assert found[1] == pytest.approx(1.0)


@pytest.mark.parametrize("handover", ["restart", "constant", "fading"])
def test_nothing_lost_and_no_delay_is_the_plain_filter(handover: Any) -> None:
    rng = np.random.default_rng(26)
    designs, y, weights = random_designs(rng), random_data(rng, 5), random_weights(rng)
    options: dict[str, Any] = {"weights": weights, "handover": handover}
    if handover == "constant":
        options["weights"] = weights[ALL]
    if handover == "fading":
        options["margins"] = rng.random((3, STEPS))
    plain = run_distributed(designs, y, **options)
    never = run_distributed(designs, y, lost=np.zeros((3, STEPS, 5), bool), delay=(0, 0, 0),
                            **options)  # fmt: skip
    assert never == pytest.approx(plain, abs=1e-11)


@pytest.mark.parametrize("handover", ["restart", "constant"])
@pytest.mark.parametrize("delay", [1, 5])
def test_a_delay_carries_the_fused_state_of_then(handover: Any, delay: int) -> None:
    """Weights that are multiples of I commute with A, so that fusing and carrying do."""
    rng = np.random.default_rng(27)
    designs, y = random_designs(rng), rng.normal(size=(3, STEPS, 4, 5))
    weights = np.array([0.2, 0.5, 0.3])[:, None, None] * np.eye(4)
    start = rng.normal(size=4)
    prompt = run_distributed(designs, y, weights=weights, handover=handover, initial_state=start)
    late = run_distributed(designs, y, weights=weights, handover=handover, initial_state=start,
                           delay=delay)  # fmt: skip
    carried = np.linalg.matrix_power(MODEL.A, delay)
    assert late[delay:] == pytest.approx(carried @ prompt[:-delay], abs=1e-10)
    for k in range(delay):
        expected = np.linalg.matrix_power(MODEL.A, k) @ start
        assert late[k, :, 0] == pytest.approx(expected)


def test_weights_by_design_for_each_pattern(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def stub(designs: Any, noise: str, structure: str, *, margin: float) -> SimpleNamespace:
        asked.append((list(designs), noise, structure, margin))
        n = len(designs)
        shares = np.arange(1, n + 1) / (n * (n + 1) / 2)
        return SimpleNamespace(weights=shares[:, None, None] * np.eye(4))

    monkeypatch.setattr(distributed, "design_fusion", stub)
    designs = [design_filter(MODEL.with_covariances(s * np.eye(4), np.eye(4))) for s in (1, 2, 3)]
    found = handover_weights(designs, PATTERNS, "independent", "block", margin=0.1)
    assert sorted(found) == sorted(PATTERNS)
    assert [number for _, *number in asked] == [["independent", "block", 0.1]] * 4
    assert found[True, False, True][:, 0, 0] == pytest.approx([1 / 3, 0, 2 / 3])
    assert found[ALL][:, 0, 0] == pytest.approx([1 / 6, 2 / 6, 3 / 6])
    assert found[False, True, False][:, 0, 0] == pytest.approx([0, 1, 0])
    assert [designs[0], designs[2]] in [given for given, *_ in asked]
    with pytest.raises(ParameterError, match="patterns"):
        handover_weights(designs, [(False, False, False)])
    with pytest.raises(ParameterError, match="patterns"):
        handover_weights(designs, [(True, False)])


def test_designed_weights_are_taken() -> None:
    rng = np.random.default_rng(28)
    model = MODEL.contracted(0.9)
    designs = [design_filter(model.with_covariances(np.eye(4), s * np.eye(4))) for s in (1, 4)]
    y = rng.normal(size=(2, 9, 4, 3))
    y[0, 2:5, :, 1] = y[1, 4:7] = np.nan
    weights = handover_weights(designs, patterns_of(y))
    assert sorted(weights) == [(False, True), (True, False), (True, True)]
    found = run_distributed(designs, y, weights=weights)
    assert np.isfinite(found).all()
    # the better cluster has more weight
    assert np.trace(weights[True, True][0]) > np.trace(weights[True, True][1])


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


def test_the_patterns_that_occur_are_all_that_a_run_asks_for() -> None:
    rng = np.random.default_rng(29)
    designs, weights, y = random_designs(rng), random_weights(rng), random_data(rng, 1)
    y = y[:, :8]
    lost, margins = rng.random((3, 8, 1)) < 0.3, rng.integers(0, 2, (3, 8)).astype(float)
    options: dict[str, Any] = {"lost": lost, "delay": (0, 1, 2), "margins": margins}
    occurring = patterns_of(y, **options)
    chosen = {pattern: weights[pattern] for pattern in occurring}
    run_distributed(designs, y, weights=chosen, handover="fading", **options)
    for pattern in occurring:
        others = {key: value for key, value in chosen.items() if key != pattern}
        with pytest.raises(ParameterError, match=f"weights is .*{pattern[0]}, {pattern[1]}"):
            run_distributed(designs, y, weights=others, handover="fading", **options)


def stacked(pattern: tuple[bool, ...], rng: np.random.Generator) -> tuple[ErrorModel, np.ndarray]:
    heard = sum(pattern)
    C = rng.normal(size=(4 * heard, 4))
    model = ErrorModel(A=MODEL.A, B=MODEL.B, C=C, D=np.eye(4 * heard), L=MODEL.L, E=MODEL.E,
                       period=MODEL.period)  # fmt: skip
    return model, 0.1 * rng.normal(size=(4, 4 * heard))


@pytest.mark.parametrize("shared", [False, True])
def test_the_switched_filter_is_its_recursion(shared: bool) -> None:
    rng = np.random.default_rng(30)
    designs = {pattern: stacked(pattern, rng) for pattern in PATTERNS}
    y, start = random_data(rng, 4), rng.normal(size=(4, 4))
    if shared:
        y = np.where(np.isnan(y[..., :1]), np.nan, np.nan_to_num(y, nan=0.7))
    predicted = run_switched(designs, y, initial_state=start)
    filtered = run_switched(designs, y, initial_state=start, predicted=False)
    for run in range(4):
        x = start[:, run]
        for k in range(STEPS):
            assert predicted[k, :, run] == pytest.approx(x, rel=1e-9, abs=1e-9)
            data = y[:, k, :, run]
            pattern = tuple(bool(hears) for hears in ~np.isnan(data).all(axis=1))
            ahead = MODEL.A @ x
            if any(pattern):
                model, gain = designs[pattern]
                innovation = data[list(pattern)].ravel() - model.C @ x
                ahead = ahead + gain @ np.where(np.isnan(innovation), 0.0, innovation)
            x = ahead
            assert filtered[k, :, run] == pytest.approx(np.linalg.solve(MODEL.A, x), abs=1e-8)


def test_the_switched_filter_of_one_pattern_is_the_h_infinity_filter() -> None:
    rng = np.random.default_rng(31)
    y = rng.normal(size=(2, STEPS, 4, 3))
    y[rng.random(y.shape) < 0.1] = np.nan
    y[:, 5, :, 1] = np.nan
    both = stacked((True, True), rng)
    one = {(True, False): stacked((True, False), rng), (False, True): stacked((True, False), rng)}
    found = run_switched({(True, True): both} | one, y)
    together = np.moveaxis(y, 0, 1).reshape(STEPS, 8, 3)
    assert found == pytest.approx(run_hinfinity(both, together), abs=1e-10)


def refused(changed: dict[str, Any], said: str) -> None:
    fine: dict[str, Any] = {
        "designs": [(MODEL, np.eye(4))] * 2,
        "measurements": np.zeros((2, 5, 4, 1)),
        "weights": np.stack([0.5 * np.eye(4)] * 2),
    }
    run_distributed(**fine)
    with pytest.raises(ParameterError, match=said):
        run_distributed(**(fine | changed))


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"designs": []}, "designs is 'empty"),
        ({"designs": [(MODEL, np.eye(3))] * 2}, "designs is 'with a gain of shape"),
        ({"designs": [(MODEL, np.full((4, 4), np.nan))] * 2}, "designs is 'with a gain"),
        (
            {"designs": [(MODEL, np.eye(4)), (ErrorModel.p1(0.3), np.eye(4))]},
            "designs is 'with different transitions",
        ),
        ({"measurements": np.zeros((3, 5, 4, 1))}, "measurements is 'of shape"),
        ({"measurements": np.zeros((2, 5, 3, 1))}, "measurements is 'of shape"),
        ({"measurements": np.full((2, 5, 4, 1), -np.inf)}, "measurements is 'infinite"),
        ({"weights": np.eye(4)}, "weights is 'of shape"),
        ({"weights": np.stack([np.eye(4)] * 2)}, "weights is 'of another sum"),
        ({"weights": np.full((2, 4, 4), np.inf)}, "weights is 'of shape"),
        ({"weights": {(True,): np.eye(4)[None]}}, "weights is 'for the pattern"),
        ({"weights": {(False, False): np.zeros((2, 4, 4))}}, "weights is 'for the pattern"),
        ({"weights": {(True, False): np.stack([0.5 * np.eye(4)] * 2)}}, "weights is 'not zero"),
        (
            {"weights": {(True, False): np.stack([np.eye(4), np.zeros((4, 4))])}},
            r"weights is 'without the pattern \(True, True\)",
        ),
        (
            {"measurements": np.stack([np.zeros((5, 4, 1)), np.full((5, 4, 1), np.nan)])},
            r"weights is 'without the pattern \(True, False\)",
        ),
        ({"handover": "constant", "weights": {}}, "weights is 'a mapping"),
        ({"handover": "soft"}, "handover is 'soft'"),
        ({"handover": "fading"}, "margins is 'missing"),
        ({"margins": np.ones((2, 5))}, "margins is 'given"),
        ({"handover": "fading", "margins": np.ones((2, 4))}, "margins is 'of shape"),
        ({"handover": "fading", "margins": np.full((2, 5), 1.1)}, "margins is 'outside"),
        ({"handover": "fading", "margins": np.full((2, 5), -0.1)}, "margins is 'outside"),
        ({"handover": "fading", "margins": np.full((2, 5), np.nan)}, "margins is 'outside"),
        ({"lost": np.zeros((2, 5), bool)}, "lost is 'bool of shape"),
        ({"lost": np.zeros((2, 5, 1))}, "lost is 'float64"),
        ({"delay": -1}, "delay is -1"),
        ({"delay": 0.5}, "delay is 0.5"),
        ({"delay": (1, 2, 3)}, "delay is "),
        ({"initial_state": np.zeros(3)}, "initial_state"),
    ],
)
def test_what_does_not_fit_is_refused(changed: dict[str, Any], said: str) -> None:
    refused(changed, said)


def test_margins_that_leave_no_sum_are_refused() -> None:
    """M and I - M with M = -I/2: margins 1 and 1/3 cancel."""
    refused(
        {
            "weights": np.stack([-0.5 * np.eye(4), 1.5 * np.eye(4)]),
            "handover": "fading",
            "margins": np.array([[1.0], [1 / 3]]).repeat(5, axis=1),
        },
        "margins is 'such that",
    )


def test_a_transition_that_cannot_be_inverted() -> None:
    flat = ErrorModel(A=np.diag([1.0, 0.0]), B=np.eye(2), C=np.eye(2), D=np.eye(2), L=np.eye(2),
                      E=np.zeros((2, 2)), period=1.0)  # fmt: skip
    y = np.zeros((1, 3, 2, 1))
    with pytest.raises(ParameterError, match="predicted"):
        run_distributed([(flat, np.eye(2))], y, weights=np.eye(2)[None], predicted=False)
    with pytest.raises(ParameterError, match="predicted"):
        run_switched({(True,): (flat, np.eye(2))}, y, predicted=False)


def test_switched_designs_that_do_not_fit_are_refused() -> None:
    rng = np.random.default_rng(32)
    y = np.zeros((2, 3, 4, 1))
    one, both = stacked((True, False), rng), stacked((True, True), rng)
    other = (ErrorModel.p1(0.3), np.eye(4))
    for designs, said in (
        ({}, "designs is 'empty"),
        ({(True, True): one}, "designs is 'with 4 measurements"),
        ({(True, False): one}, r"designs is 'without the pattern \(True, True\)"),
        ({(True, True): both, (True, False): other}, "designs is 'with different transitions"),
        ({(True,): one}, "designs is 'for the pattern"),
    ):
        with pytest.raises(ParameterError, match=said):
            run_switched(designs, y)


@pytest.mark.parametrize("shape", [(2, 3, 4, 0), (2, 0, 4, 3)])
@pytest.mark.parametrize("handover", ["restart", "constant", "fading"])
def test_no_runs_and_no_steps(shape: tuple[int, ...], handover: Any) -> None:
    margins = np.ones(shape[:2]) if handover == "fading" else None
    half, y = np.stack([0.5 * np.eye(4)] * 2), np.zeros(shape)
    found = run_distributed([(MODEL, np.eye(4))] * 2, y, weights=half, handover=handover,
                            margins=margins, delay=(0, 9))  # fmt: skip
    assert found.shape == shape[1:]
    both = stacked((True, True), np.random.default_rng(33))
    assert run_switched({(True, True): both}, y).shape == shape[1:]


NO_NUMBERS = ["1", "word", ["1", "2"], {"a": 1.0}, [[1.0], [1.0, 2.0]], 1j * np.eye(4), [None]]


@pytest.mark.parametrize("value", NO_NUMBERS)
@pytest.mark.parametrize(
    "name",
    ["measurements", "weights", "handover", "margins", "lost", "delay", "initial_state"],
)
@pytest.mark.filterwarnings("error")
def test_what_is_no_array_of_numbers_is_refused(name: str, value: Any) -> None:
    fine: dict[str, Any] = {
        "designs": [(MODEL, np.eye(4))] * 2,
        "measurements": np.zeros((2, 5, 4, 1)),
        "weights": np.stack([0.5 * np.eye(4)] * 2),
    }
    if name == "margins":
        fine["handover"] = "fading"
    with pytest.raises(ParameterError) as caught:
        run_distributed(**(fine | {name: value}))
    assert caught.value.name == name


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_gains_and_weights_of_a_pattern_that_are_no_numbers_are_refused(value: Any) -> None:
    refused({"designs": [(MODEL, np.eye(4)), (MODEL, value)]}, "designs is")
    refused({"weights": {(True, True): value}}, "weights is")


@pytest.mark.parametrize("value", [*NO_NUMBERS, None, 1.0, "", (MODEL, np.eye(4)), [MODEL]])
def test_designs_that_are_none_are_refused(value: Any) -> None:
    y = np.zeros((1, 3, 4, 1))
    with pytest.raises(ParameterError, match="designs is"):
        run_distributed(value, y, weights=np.eye(4)[None])
    with pytest.raises(ParameterError, match="designs is"):
        handover_weights(value, [(True,)])
    with pytest.raises(ParameterError, match="designs is"):
        run_switched(value, y)
    with pytest.raises(ParameterError, match="designs is"):
        run_switched({(True,): [value]}, y)


def test_a_design_alone_is_no_sequence() -> None:
    design = design_filter(MODEL)
    y = np.zeros((1, 3, 4, 1))
    run_distributed([design], y, weights=np.eye(4)[None])
    for wrong in (design, [design, MODEL], [design, None], [design, "design"]):
        with pytest.raises(ParameterError, match="designs is"):
            run_distributed(wrong, y, weights=np.eye(4)[None])
        with pytest.raises(ParameterError, match="designs is"):
            handover_weights(wrong, [(True,)])
    with pytest.raises(ParameterError, match="designs is"):
        run_switched(design, y)


@pytest.mark.parametrize("pattern", ["ab", (1, 1), (1.0, True), ("a", "b"), 3, None, ((True,), 1)])
def test_a_pattern_is_a_tuple_of_bools(pattern: Any) -> None:
    designs = [design_filter(MODEL)] * 2
    half = np.stack([0.5 * np.eye(4)] * 2)
    y = np.zeros((2, 3, 4, 1))
    with pytest.raises(ParameterError, match=r"weights is .for the pattern"):
        run_distributed(designs, y, weights={pattern: half})
    with pytest.raises(ParameterError, match=r"patterns is .for the pattern"):
        handover_weights(designs, [pattern])
    with pytest.raises(ParameterError, match=r"designs is .for the pattern"):
        run_switched({pattern: designs[0]}, y)


def test_patterns_that_are_no_tuples_are_refused() -> None:
    designs = [design_filter(MODEL)] * 2
    for patterns in (None, 1, "ab", (True, True), [[True, False]], [np.array([True, False])]):
        with pytest.raises(ParameterError, match="patterns is"):
            handover_weights(designs, patterns)
    found = handover_weights(designs, [(np.True_, np.False_)])
    assert list(found) == [(True, False)]
    assert all(type(hears) is bool for hears in next(iter(found)))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("noise", "white"), ("noise", np.zeros(2)), ("structure", "half"), ("structure", ["full"]),
        ("margin", 0.0), ("margin", "0.1"), ("margin", None), ("margin", np.ones(2)),
    ],
)  # fmt: skip
def test_options_are_checked_even_where_no_weights_are_designed(name: str, value: Any) -> None:
    options: dict[str, Any] = {name: value}
    with pytest.raises(ParameterError) as caught:
        handover_weights([design_filter(MODEL)] * 2, [(True, False)], **options)
    assert caught.value.name == name


def test_as_many_clusters_as_an_integer_has_bits_for() -> None:
    """The highest cluster is told from none; one more than 62 is refused by all that count them."""
    rng = np.random.default_rng(42)
    y = rng.normal(size=(62, 3, 4, 2))
    y[:61, 1], y[:, 2, :, 1] = np.nan, np.nan
    last, every = (False,) * 61 + (True,), (True,) * 62
    assert patterns_of(y) == [last, every]
    weights = {every: np.stack([np.eye(4) / 62] * 62), last: np.zeros((62, 4, 4))}
    weights[last][61] = np.eye(4)
    designs = [(MODEL, 0.1 * np.eye(4))] * 62
    found = run_distributed(designs, y, weights=weights)
    assert found[1] == pytest.approx(0.1 * y[:, 0].mean(axis=0))
    own = 0.1 * y[61, 0]
    assert found[2] == pytest.approx((MODEL.A - 0.1 * MODEL.C) @ own + 0.1 * y[61, 1])
    for many in (63, 64, 65):
        y = np.zeros((many, 2, 4, 1))
        said = f"measurements is 'of {many} clusters'"
        with pytest.raises(ParameterError, match=said):
            patterns_of(y)
        with pytest.raises(ParameterError, match=said):
            run_distributed(designs[:1] * many, y, weights=np.stack([np.eye(4) / many] * many))
        with pytest.raises(ParameterError, match=said):
            run_switched({(True,) * many: designs[0]}, y)
