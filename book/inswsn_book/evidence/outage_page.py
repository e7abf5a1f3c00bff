"""What the page p1-outages checks of the LS-SVM, and the frames of its tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import cvxpy as cp
import numpy as np
import pandas as pd
import torch
from numpy.typing import ArrayLike

from inswsn_book.evidence.outage_tables import METHODS, Hypothesis
from inswsn_book.judge.verdicts import count_verdicts
from inswsn_lib.checks import Array
from inswsn_lib.evaluation import Finding
from inswsn_lib.learning import LSSVMRegressor, kernel_matrix, select_lssvm
from inswsn_lib.navigation.bridged_outages import (
    COASTING,
    HF_COASTING,
    KINDS,
    BridgedOutages,
    Judged,
    Passage,
)
from inswsn_lib.papers import COLUMNS

if TYPE_CHECKING:
    from inswsn_book.judge.verdicts import Judged as Verdict

#: Methods and inputs that exist, which are compared column by column
COMPARED = {f"{name}, motion": (name, "motion")
            for name in ("LS-SVM", "Gaussian process", "BP", "LS-SVM, linear kernel")} | {
    "Kalman filter, coasting": (COASTING, "state"),
    "mean of the last fixes": ("mean of the last fixes", "time"),
}  # fmt: skip
_HEADS = [f"${c[0]}_{c[1]}$, {c[2]}" for c in COLUMNS]
_EXACT = {f"tol_{name}": 1e-12 for name in ("gap_rel", "gap_abs", "feas")}


def solve_four_ways(
    X: Array, targets: Array, fresh: Array, strength: float = 10.0
) -> tuple[dict[str, float], str]:
    """Return how far the solutions of P1's problem are apart, by name, and the solver's status.

    The kernel is (1 + x'z)^2, whose features can be written down. The solutions are those of the
    library, of the bordered system, of least squares in omega and b, and of a convex program.

    Parameters
    ----------
    X, targets : ndarray, (samples, 2) and (samples,)
    fresh : ndarray, (points, 2)
        Inputs at which predictions are compared.
    strength : float
        The regularisation eta.
    """
    machine = LSSVMRegressor(1.0, strength, "polynomial", 2).fit(X, targets)
    Phi, alpha, bias, n = _features(X), machine.alpha_[:, 0], machine.bias_[0], len(X)
    omega, root, ones = Phi.T @ alpha, strength**0.5, np.ones((n, 1))
    slack = targets - Phi @ omega - bias
    K = kernel_matrix(X, X, "polynomial", 1.0, 2)
    bordered = np.block([[np.zeros((1, 1)), ones.T], [ones, K + np.eye(n) / strength]])
    direct = np.linalg.solve(bordered, np.append(0.0, targets))
    tall = np.vstack([root * np.hstack([Phi, ones]), np.eye(6, 7)])
    primal = np.linalg.lstsq(tall, np.append(root * targets, np.zeros(6)), rcond=None)[0]
    w, b = cp.Variable(6), cp.Variable()
    squares = cp.sum_squares(w) + strength * cp.sum_squares(targets - Phi @ w - b)
    problem = cp.Problem(cp.Minimize(squares / 2))
    problem.solve(solver="CLARABEL", **_EXACT)
    cost = (omega @ omega + strength * slack @ slack) / 2
    by_weights = _features(fresh) @ primal[:6] + primal[6]
    largest, size = np.abs(targets).max(), np.abs(alpha).max()
    point = [torch.tensor(v, requires_grad=True) for v in (omega, bias, slack, alpha)]
    most = {}
    for reading in ("right", "over all terms", "over the first"):
        value = _lagrangian(reading, point, torch.tensor(Phi), torch.tensor(targets), strength)
        most[reading] = max(float(p.abs().max()) for p in torch.autograd.grad(value, point))
    return {
        "lssvm.primal-dual": np.abs(by_weights - machine.predict(fresh)).max() / largest,
        "lssvm.objective-excess": cost / problem.value - 1,
        "lssvm.constraint-residual": np.abs(slack - alpha / strength).max() / largest,
        "lssvm.corrected-lagrangian": most["right"] / size,
        "lssvm.kernel-dual": max(
            np.abs(K - Phi @ Phi.T).max() / K.max(),
            np.abs(direct[1:] - alpha).max() / size,
            abs(direct[0] - bias) / largest,
        ),
        "lssvm.printed-lagrangian": min(most["over all terms"], most["over the first"]) / size,
    }, problem.status


def _lagrangian(
    reading: str, at: Sequence[torch.Tensor], features: torch.Tensor, y: torch.Tensor, eta: float
) -> torch.Tensor:
    """Return P1 (3.4), as it must be, or by what the sum may hold as it is printed."""
    w, b, e, a = at
    cost, fitted = w @ w / 2 + eta / 2 * e @ e, features @ w
    if reading == "right":
        return cost - a @ (fitted + b + e - y)
    if reading == "over all terms":
        return cost - (a * fitted + b + e - y).sum()
    return cost - a @ fitted + b + (e - y).sum()


def _features(X: Array) -> Array:
    """Return phi(x) with phi(x)'phi(z) = (1 + x'z)^2."""
    a, b = X.T
    r = 2**0.5
    return np.column_stack([0 * a + 1, r * a, r * b, a * a, b * b, r * a * b])


def least_eigenvalue(passages: Iterable[Passage]) -> float:
    """Return the least eigenvalue of the RBF kernel over the largest, of areas and ten widths."""
    found = []
    for passage in passages:
        inputs = passage.error[: passage.heard, :, 0]
        for width in np.logspace(-2, 4, 10):
            values = np.linalg.eigvalsh(kernel_matrix(inputs, inputs, "rbf", width, 1))
            found.append(values.min() / values.max())
    return float(min(found))


def correlations(inputs: Array, states: Array) -> Array:
    """Return the largest correlation of each state with an input, (states, runs)."""
    x, y = (values - values.mean(axis=0) for values in (inputs, states))
    sizes = np.sqrt((x**2).sum(axis=0))[:, None] * np.sqrt((y**2).sum(axis=0))[None]
    return np.asarray((np.abs(np.einsum("kir,kjr->ijr", x, y)) / sizes).max(axis=0))


def with_past(passage: Passage) -> Passage:
    """Return a passage whose oracle tells the errors of the last four samples, sixteen inputs."""
    steps = np.arange(len(passage.error))
    past = [passage.error[np.maximum(steps - lag, 0)] for lag in range(4)]
    return replace(passage, inputs={**passage.inputs, "oracle": np.concatenate(past, axis=1)})


def first_half(passage: Passage) -> Passage:
    """Return a passage of whose samples before the outage the first half alone is heard."""
    y = passage.y.copy()
    y[passage.heard // 2 :] = np.nan
    return replace(passage, y=y)


def held_out(passage: Passage, sigmas: ArrayLike, etas: ArrayLike, runs: int) -> Array:
    """Return the position error in the second half of an area, (runs, sigmas, etas)."""
    errors = [
        select_lssvm(of.error[: of.heard], of.y[: of.heard], sigmas, etas, trained_on=of.heard // 2)
        for of in map(passage.run, range(runs))
    ]
    return np.array([e.by_output[:, :, :2].mean(axis=2) for e in errors])


def told(entries: Iterable[Verdict]) -> str:
    """Return how many claims have which verdict, in words."""
    return ", ".join(f"{count} {verdict}" for verdict, count in count_verdicts(entries).items())


def table1_frame(
    judged: Iterable[Verdict], pairs: Mapping[int, tuple[float, float]], printed: Array
) -> pd.DataFrame:
    """Return Table 1, each row as printed and as rebuilt, whose cells link to their claims."""
    words = {"reproduced": "yes", "not reproduced": "no"}
    cells = {
        e.claim.id: f"{e.quantity.value:.3f} [{words.get(e.verdict, e.words)}](#{e.claim.anchor})"
        for e in judged
        if e.quantity is not None
    }
    rows: dict[str, list[str]] = {}
    for (n, pair), of_row in zip(pairs.items(), printed, strict=True):
        rows[f"{n}, printed"] = [f"{v:g}" for v in pair] + [f"{v:.3f}" for v in of_row]
        names = [f"P1-T1-{n:02d}-{c}" for c in ("drx", "dry", "dvx", "dvy")]
        rows[f"{n}, rebuilt"] = ["", "", *(cells[name] for name in names)]
    heads = [r"$\sigma$", r"$\eta$", "$r_x$ (m)", "$r_y$ (m)", "$v_x$ (m/s)", "$v_y$ (m/s)"]
    return _frame(rows, heads, "row")


def table3_frame(judged: Iterable[Verdict]) -> pd.DataFrame:
    """Return Table 3 cell by cell, each with a link to its claim."""
    rows = {}
    for e in judged:
        if e.quantity is not None and e.quantity.interval is not None:
            low, high = e.quantity.interval
            printed = str(e.claim.value)
            rows[f"[{e.claim.id.removeprefix('P1-T3-')}](#{e.claim.anchor})"] = [
                printed, f"{e.quantity.value:.3g}", f"{low:.3g} to {high:.3g}",
                f"{e.quantity.value / float(printed):.2f}", str(e.verdict),
            ]  # fmt: skip
    heads = ["printed", "rebuilt, median", "95 % of runs", "rebuilt over printed", "verdict"]
    return _frame(rows, heads, "cell")


def exist_frame(
    medians: Mapping[str, Array],
    exist: Mapping[tuple[str, str], Array],
    printed: Mapping[str, ArrayLike],
) -> pd.DataFrame:
    """Return Table 3 of both learners as printed, with the oracle, and with inputs that exist."""
    rows = {"INS-only": medians["ins"]}
    for key in ("bp", "lssvm"):
        rows[f"{METHODS[key]}, printed"] = np.asarray(printed[METHODS[key]])
        rows[f"{METHODS[key]}, oracle"] = medians[key]
        rows |= {f"{METHODS[m]}, {kind}": cells for (m, kind), cells in exist.items() if m == key}
    return _frame(rows, _HEADS, "method, input").map("{:.2f}".format)


def hypotheses_frame(
    guesses: Mapping[tuple[str, str], Hypothesis], lower: Mapping[str, int]
) -> pd.DataFrame:
    """Return what the rows of BP and LS-SVM may be, with the columns in which each is ahead."""
    rows = []
    for (method, name), g in guesses.items():
        fitted = "" if g.number is None else f" (fitted: {g.number:.2g})"
        below = f"{lower[name]} of 8" if method == "LS-SVM" else "–"
        score = f"{g.score.met} of 8", f"{g.score.spread:.2f}", f"{g.score.worst:.3g}"
        rows.append((method, name + fitted, *score, below))
    heads = ["row", "hypothesis", "cells within 10 %", "spread", "worst ratio"]
    frame = pd.DataFrame(rows, columns=[*heads, "below INS-only and BP"])
    return frame.set_index("row").sort_index(kind="stable")


def fair_frame(
    outages: BridgedOutages, fair: Mapping[tuple[str, str], Judged], own: Mapping[str, Array]
) -> pd.DataFrame:
    """Return the shares of all methods by input, and those of the reader's own."""
    shares = {key: entry.by_run for key, entry in fair.items()}
    mine = f"`{outages.learner.partition(':')[2]}`, as made"
    shares |= {(mine, kind): 100 * values.mean(axis=0) for kind, values in own.items()}
    names = [*outages.fits, COASTING, HF_COASTING, *outages.learners, mine]
    rows = {name: [_told_share(shares.get((name, kind))) for kind in KINDS] for name in names}
    return _frame(rows, ["the true error (oracle)", *KINDS[1:-1], "last state"], "method")


def _told_share(values: Array | None) -> str:
    """Return the median over runs of the mean share, with the ends of 95 % of them."""
    if values is None:
        return "–"
    found = Finding.of_runs(values, "%", "")
    return f"{found.value:.0f} ({found.low:.0f} to {found.high:.0f})"


def columns_frame(
    fair: Mapping[tuple[str, str], Judged], geometric: Mapping[str, float]
) -> pd.DataFrame:
    """Return the shares of the methods of `COMPARED` by column, their means and losses, in %."""
    rows = {}
    for name, key in COMPARED.items():
        shares, loss = fair[key].shares, fair[key].tuning.loss
        means = [shares.mean(axis=0).mean(), geometric[name], loss]
        rows[name] = 100 * np.append(np.median(shares, axis=1), means)
    heads = [f"${c}$, {a}" for a in "12" for c in ("r_x", "r_y", "v_x", "v_y")]
    frame = _frame(rows, [*heads, "mean", "geometric mean", "rehearsal"], "method, input")
    return frame.map("{:.0f}".format)


def _frame(rows: dict[str, Any], heads: list[str], index: str) -> pd.DataFrame:
    return pd.DataFrame.from_dict(rows, orient="index", columns=heads).rename_axis(index)


def area_squares(outages: BridgedOutages) -> Array:
    """Return the mean squared position error in the areas, m^2, (2 filters, 2 areas, runs).

    The filters are P1's HF and a Kalman filter that takes the errors of fixes for white and knows
    their size. Both have the measurement of the step itself.
    """
    squares = []
    for area, passage in outages.passages(outages.drawn).items():
        error, y = passage.error[: passage.heard], passage.y[: passage.heard]
        hf = outages.navigator(area, outages.printed, "oracle").filter
        left = [error - estimate(y) for estimate in (hf, outages.coasting(area, 1.0))]
        squares.append([(each[:, :2] ** 2).mean(axis=(0, 1)) for each in left])
    return np.swapaxes(squares, 0, 1)


def hf_over_kf(squares: Array) -> float:
    """Return the error of HF over that of the Kalman filter, of `area_squares`, mean over areas."""
    hf, kf = squares.mean(axis=-1)
    return float(np.sqrt(hf / kf).mean())


def turning_time(squares: Mapping[float, Array], seed: int) -> tuple[float, tuple[float, float]]:
    """Return the correlation time from which HF has less error than the Kalman filter, s.

    By linear interpolation of the logarithms between the times whose `area_squares` are given, in
    rising order; behind it the interval of 95 % of 1000 bootstrap samples of the runs.
    """
    times, each = np.log(list(squares)), np.stack([*squares.values()])
    runs = each.shape[-1]
    drawn = np.random.default_rng(seed).integers(runs, size=(1000, runs))
    times_drawn = [np.bincount(row, minlength=runs) for row in drawn]
    hf, kf = np.moveaxis(each @ np.transpose([np.ones(runs), *times_drawn]), 1, 0)
    logs = -np.log(np.sqrt(hf / kf).mean(axis=1))
    turn, *turns = (float(np.exp(np.interp(0.0, each, times))) for each in logs.T)
    low, high = np.quantile(turns, [0.025, 0.975])
    return turn, (float(low), float(high))
