"""Speed as ratios, against peers on the same work in the same run: `make bench`.

Monte Carlo of a Kalman filter on P1's model is run by this library and by others (`peers`), by
filterpy in a loop over the runs; and it is held against a copy of its data in memory, and against
drawing the random numbers that such a study needs. Peers that are not installed are left out.
A design of the H-infinity filter, with its certificate, is held against the time that the solver
itself reports. An LS-SVM is held against the solvers of numpy and scikit-learn and against the
floating-point operations that its Cholesky factor takes, and its selection against a grid search.
Each figure is the best of several repetitions; each peer's answer is compared with ours
first. The ratios go to data/benchmarks.yaml, from which the book takes its table.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import clarabel
import numpy as np
import yaml
from inswsn_book.record.files import write_whole
from inswsn_book.record.provenance import machine_facts
from peers import PEERS, by_filterpy, installed
from sklearn.kernel_ridge import KernelRidge
from sklearn.model_selection import GridSearchCV, LeaveOneOut

from inswsn_lib.filters import run_kalman
from inswsn_lib.learning import LSSVMRegressor, kernel_matrix, select_lssvm
from inswsn_lib.lmi import design_filter, filter_design
from inswsn_lib.models import ErrorModel

OUT = Path(__file__).parent.parent / "data" / "benchmarks.yaml"
Row = dict[str, str]
STEPS, RUNS, LOOPED, REPEATS = 200, 10_000, 20, 5
MODEL = ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))


def best_of(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the shortest time of several repetitions, s."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def row(
    chapter: str,
    work: str,
    against: str,
    ratio: float,
    aim: float | None = None,
    *,
    more_is_better: bool = True,
) -> Row:
    """Return a row of the table: a ratio, what was aimed at, and whether it was met."""
    met = aim is None or (ratio >= aim if more_is_better else ratio <= aim)
    digits = 0 if ratio >= 10 else 2
    return {
        "chapter": chapter,
        "work": work,
        "against": against,
        "ratio": f"{ratio:.{digits}f}",
        "aim": "–" if aim is None else f"{aim:g} or {'more' if more_is_better else 'less'}",
        "met": "–" if aim is None else "yes" if met else "no",
    }


def filters() -> list[Row]:
    """Compare the Monte Carlo of a Kalman filter, with data missing run by run as well."""
    rng, start = np.random.default_rng(1), np.eye(4)
    y = rng.standard_normal((STEPS, 4, RUNS))
    gappy = np.where(rng.random((STEPS, 1, RUNS)) < 0.1, np.nan, y)
    ours = run_kalman(MODEL, y, initial_covariance=start)
    few = by_filterpy(MODEL, y[:, :, :LOOPED])
    assert np.allclose(ours[:, :, :LOOPED], few())
    mine = best_of(lambda: run_kalman(MODEL, y, initial_covariance=start))
    looped = best_of(few, 3) * RUNS / LOOPED
    missing = best_of(lambda: run_kalman(MODEL, gappy, initial_covariance=start), 3)
    # process noise and measurement noise of every step
    random = best_of(lambda: rng.standard_normal((STEPS, 8, RUNS)), 3)
    work = f"Kalman filter, {RUNS} runs of {STEPS} steps ({1000 * mine:.0f} ms)"
    rows = [
        row(
            "p1-training", work,
            f"filterpy, one object a run, time of {LOOPED} runs scaled up; theirs over ours",
            looped / mine, 2500,
        ),
    ]  # fmt: skip
    for name, peer in installed().items():
        theirs = peer(MODEL, y)
        # what is compiled is, before it is timed; dynamax adds 1e-9 to what it inverts
        assert np.allclose(ours, theirs(), atol=1e-6)
        rows.append(
            row("p1-training", work, f"{name}; theirs over ours", best_of(theirs, 3) / mine, 4)
        )
    return [
        *rows,
        row(
            "p1-training", work,
            f"a copy of its measurements ({1000 * best_of(y.copy):.0f} ms); ours over "
            "that", mine / best_of(y.copy),
        ),
        row(
            "p1-training", work,
            f"drawing its random numbers ({1000 * random:.0f} ms); ours over that",
            mine / random, 1.5, more_is_better=False,
        ),
        row(
            "p1-training",
            f"the same, each run without a tenth of its fixes of its own ({1000 * missing:.0f} ms)",
            "complete data; ours over ours", missing / mine, 10, more_is_better=False,
        ),
    ]  # fmt: skip


def designs() -> list[Row]:
    """Compare a design as it is called, units, bounds and certificate included, with its solver."""
    asked, inside, ratios, whole = filter_design.solve, [0.0], [], []

    def timed(*problem: Any) -> Any:
        answer = asked(*problem)
        inside[-1] += answer.seconds
        return answer

    design_filter(MODEL)  # imports, and the places of the unknowns of this shape
    filter_design.solve = timed
    try:
        for i in range(30):
            model = ErrorModel.p1(
                0.2, process_noise=(0.05 + 0.01 * i, 0.1), measurement_noise=(0.2, 0.3)
            )
            inside[-1] = 0.0
            began = time.perf_counter()
            design_filter(model)
            whole.append(time.perf_counter() - began)
            ratios.append(whole[-1] / inside[-1])
    finally:
        filter_design.solve = asked
    return [
        row(
            "p1-training",
            f"H-infinity design with its certificate ({1000 * np.median(whole):.0f} ms)",
            "the time that Clarabel itself reports; ours over that",
            float(np.median(ratios)), 1.2, more_is_better=False,
        )
    ]  # fmt: skip


def machines() -> list[Row]:
    """Compare the training and the selection of an LS-SVM."""
    return [line for n in (100, 1000, 5000) for line in training(n)] + [selection()]


def training(n: int) -> list[Row]:
    """Compare the training of an LS-SVM on some samples."""
    rng = np.random.default_rng(2)
    X, y = rng.standard_normal((n, 4)), rng.standard_normal((n, 4))
    machine, ridge = LSSVMRegressor(2.0, 10.0), KernelRidge(alpha=0.1, kernel="rbf", gamma=1 / 8)
    trained = machine.fit(X, y)
    assert np.allclose(np.vstack([trained.bias_, trained.alpha_]), by_numpy(X, y), atol=1e-8)
    repeats = 20 if n == 100 else REPEATS
    mine = best_of(lambda: machine.fit(X, y), repeats)
    numpys = best_of(lambda: by_numpy(X, y), repeats)
    ridges = best_of(lambda: ridge.fit(X, y), repeats)
    work = f"LS-SVM on {n} samples, 4 outputs ({1000 * mine:.3g} ms)"
    rows = [
        row(
            "p1-outages",
            work,
            "the bordered system by numpy's solve; theirs over ours",
            numpys / mine,
        ),
        row("p1-outages", work, "KernelRidge, which has no bias; theirs over ours", ridges / mine),
    ]
    if n < 5000:
        return rows
    A = np.ones((4000, 4000))
    rate = 2 * 4000**3 / best_of(lambda: A @ A, 3)  # operations a second
    limit = n**3 / 3 / rate
    against = f"n^3/3 operations at the rate of a product of matrices ({1000 * limit:.0f} ms)"
    against += "; ours over that"
    return [*rows, row("p1-outages", work, against, mine / limit, 1.3, more_is_better=False)]


def selection() -> Row:
    """Compare the selection of width and regularisation."""
    rng = np.random.default_rng(3)
    X, y = rng.standard_normal((100, 4)), rng.standard_normal((100, 1))
    sigmas, etas = np.logspace(-1, 3, 20), np.logspace(-2, 4, 20)
    search = GridSearchCV(
        LSSVMRegressor(),
        {"sigma": sigmas[::10], "eta": etas[::10]},
        scoring="neg_mean_absolute_error",
        cv=LeaveOneOut(),
    )
    theirs = best_of(lambda: search.fit(X, y), 1) * 100  # 4 of the 400 pairs
    errors = select_lssvm(X, y, sigmas, etas).errors[::10, ::10]
    assert np.allclose(-search.cv_results_["mean_test_score"], errors.T.ravel())
    mine = best_of(lambda: select_lssvm(X, y, sigmas, etas))
    work = f"leave-one-out of 400 pairs on 100 samples ({1000 * mine:.0f} ms)"
    against = "GridSearchCV, time of 4 pairs scaled up; theirs over ours"
    return row("p1-outages", work, against, theirs / mine, 100)


def by_numpy(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return bias and multipliers from the bordered system."""
    n = len(X)
    system = np.zeros((n + 1, n + 1))
    system[0, 1:] = system[1:, 0] = 1
    system[1:, 1:] = kernel_matrix(X, X, "rbf", 2.0, 2) + np.eye(n) / 10.0
    return np.linalg.solve(system, np.vstack([np.zeros((1, y.shape[1])), y]))


if __name__ == "__main__":
    rows = filters() + designs() + machines()
    facts = machine_facts()
    for line in rows:
        print(f"{line['work']}, against {line['against']}: {line['ratio']} (aim: {line['aim']})")
    head = "# Made by `make bench` (benchmarks/throughput.py); do not edit.\n"
    content = {
        "machine": f"{facts['cpu']}, {facts['cores']} cores, {facts['system']}, "
        f"Python {facts['python']}, numpy {np.__version__}, Clarabel {clarabel.__version__}",
        "date": datetime.now(UTC).date().isoformat(),
        "rows": rows,
    }
    for name in PEERS.keys() - installed().keys():
        print(f"{name} is not installed, so its row is left out; `make bench` installs it.")
    write_whole(OUT, head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
    print(f"Wrote {OUT.relative_to(OUT.parent.parent)}.")
