"""How time and memory grow with the size of the work, beside what the machine allows: `make bench`.

Each point is measured in a process of its own: seconds of the work, the best of a few repetitions
where it is short, and by how much the process grew. Beside it stands a limit: the time to move the
data once through memory, or to do the floating-point operations, at the rates that are measured in
the same run. A curve ends where its next point would take longer than is worth it. All goes to
data/growth.json and is drawn in data/growth.svg, for the page "Benchmarks" of the book.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import resource
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from growth_figure import growth_svg
from inswsn_book.record.files import write_whole
from inswsn_book.record.provenance import machine_facts
from threadpoolctl import threadpool_limits

from inswsn_lib.evaluation import monte_carlo
from inswsn_lib.filters import run_kalman, stream_kalman
from inswsn_lib.learning import LSSVMRegressor
from inswsn_lib.lmi import design_filter, design_fusion, riccati_filter, riccati_gamma
from inswsn_lib.models import ErrorModel

OUT = Path(__file__).parent.parent / "data" / "growth.json"
PICTURE = OUT.with_suffix(".svg")
MODEL = ErrorModel.p1(0.2, process_noise=(0.05, 0.1), measurement_noise=(0.2, 0.3))
STEPS, PIECE, FEW, RANK = 200, 1000, 100, 500
#: Seconds: repeated until then, and longer than this no point is expected to take
SHORT, LONGEST = 0.5, 60.0


class Curve(NamedTuple):
    """What is measured, over what, at which sizes, and the work that the limit counts.

    The work gives the seconds that it took itself, or None for all of its time. Of a size, `load`
    tells the bytes to move or the operations to do, by the `rate` of the machine; `order` guesses
    by what power of the size the time grows.
    """

    name: str
    over: str
    sizes: tuple[int, ...]
    work: Callable[[int], Callable[[], float | None]]
    rate: str
    load: Callable[[int], float]
    limit: str
    order: float = 1.0


def by_runs(runs: int, missing: float = 0.0) -> Callable[[], float]:
    """Return a Monte Carlo of a filter, drawn, filtered and scored some runs at a time."""

    def simulate(rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
        y = rng.standard_normal((STEPS, 4, count))
        if missing:
            y[np.broadcast_to(rng.random((STEPS, 1, count)) < missing, y.shape)] = np.nan
        return {"y": y}

    def score(drawn: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        began = time.process_time()
        found = run_kalman(MODEL, drawn["y"], initial_covariance=np.eye(4))
        spent.append(time.process_time() - began)
        return {"last": found[-1, 0]}

    def work() -> float:
        spent.clear()
        monte_carlo(simulate, runs, 1, keep=score)
        return sum(spent)

    spent: list[float] = []
    return work


def by_steps(steps: int) -> Callable[[], float]:
    """Return a filter over a long record, which comes in pieces."""

    def work() -> float:
        def pieces() -> Iterator[np.ndarray]:
            rng = np.random.default_rng(2)
            for first in range(0, steps, PIECE):
                began = time.process_time()
                drawn = rng.standard_normal((min(PIECE, steps - first), 4, FEW))
                drawing.append(time.process_time() - began)
                yield drawn

        drawing: list[float] = []
        began = time.process_time()
        for found in stream_kalman(MODEL, pieces(), initial_covariance=np.eye(4)):
            assert np.isfinite(found[-1]).all()
        return time.process_time() - began - sum(drawing)

    return work


def model_of(states: int) -> ErrorModel:
    """Return a model without zeros, all of whose states are measured."""
    rng = np.random.default_rng(states)
    A = np.linalg.qr(rng.standard_normal((states, states)))[0]
    eye = np.eye(states)
    return ErrorModel(A=0.99 * A, B=0.1 * eye, C=eye, D=0.3 * eye, L=eye, period=1.0)


def by_states(states: int, missing: float = 0.0) -> Callable[[], None]:
    """Return a filter of few runs, with gaps of its own in each run if some are missing."""
    model, rng, runs = model_of(states), np.random.default_rng(3), 64 if missing else 1000
    y = rng.standard_normal((FEW, states, runs))
    if missing:
        y[np.broadcast_to(rng.random((FEW, 1, runs)) < missing, y.shape)] = np.nan
    return lambda: void(run_kalman(model, y, initial_covariance=np.eye(states)))


def by_states_of_design(states: int) -> Callable[[], None]:
    """Return the design of an H-infinity filter, with its certificate."""
    model = model_of(states)
    return lambda: void(design_filter(model))


def by_states_of_riccati(states: int) -> Callable[[], None]:
    """Return the least worst-case gain by Riccati equations, and a filter within a hundredth."""
    model = model_of(states)

    def work() -> None:
        assert riccati_filter(model, 1.01 * riccati_gamma(model, 1e-4)) is not None

    return work


def by_clusters(count: int, noise: Any) -> Callable[[], None]:
    """Return the design of the weights of a fusion, with its certificate.

    The clusters have 0.7, 1 and 1.4 times the usual noise, in turn.
    """
    noisy = [(0.14 * f, 0.2 * f) for f in (0.7, 1.0, 1.4)]
    kinds = [
        design_filter(ErrorModel.p1(0.02, process_noise=(1e-4, 0.01), measurement_noise=size))
        for size in noisy
    ]
    designs = [kinds[i % 3] for i in range(count)]
    return lambda: void(design_fusion(designs, noise, "block"))


def by_samples(samples: int, rank: int | None = None) -> Callable[[], None]:
    """Return the training of an LS-SVM, dense or of low rank."""
    rng = np.random.default_rng(4)
    X, y = rng.standard_normal((samples, 4)), rng.standard_normal((samples, 4))
    return lambda: void(LSSVMRegressor(2.0, 10.0, rank=rank).fit(X, y))


def void(_: object) -> None:
    """Return nothing: the work tells no time of its own."""


def _joseph(n: int, runs: int = 64) -> float:
    """Return the operations of a step of a filter with as many outputs as states, of each run."""
    return FEW * runs * n**3 * (1 / 3 + 2 + 2 * 5)  # a factor, two triangles, five products


def _factors(variables: int) -> float:
    """Return the operations of as many factors as an interior-point method takes steps."""
    return 30 * variables**3 / 3


def _riccati(n: int) -> float:
    """Return the operations of a QZ decomposition of a pencil of size 2 n (Golub, Van Loan)."""
    return 66.0 * (2 * n) ** 3


DATA = "the data once through memory"
DENSE = "its floating-point operations at the rate of a product of matrices"
CURVES = (
    Curve(
        "Kalman filter, complete data", "runs", tuple(10**k for k in range(2, 7)), by_runs, "copy",
        lambda runs: 64.0 * STEPS * runs, DATA,
    ),
    Curve(
        "Kalman filter, data missing run by run", "runs", tuple(10**k for k in range(2, 7)),
        partial(by_runs, missing=0.1), "copy", lambda runs: 64.0 * STEPS * runs, DATA,
    ),
    Curve(
        f"Kalman filter, {FEW} runs", "steps", tuple(10**k for k in range(2, 6)), by_steps, "copy",
        lambda steps: 64.0 * FEW * steps, DATA,
    ),
    Curve(
        "Kalman filter, complete data", "states", (2, 4, 8, 16, 32, 64), by_states, "flops",
        lambda n: FEW * 1000 * 4.0 * n**2, DENSE, 2,
    ),
    Curve(
        "Kalman filter, data missing run by run", "states", (2, 4, 8, 16, 32, 64),
        partial(by_states, missing=0.1), "flops", _joseph, DENSE, 3,
    ),
    Curve(
        "H-infinity design with certificate", "states", (2, 4, 8, 16, 32, 64), by_states_of_design,
        "flops", lambda n: _factors((n * (n + 1)) // 2 + n**2),
        "30 Cholesky factors of the normal matrix of its variables, dense", 5,
    ),
    Curve(
        "H-infinity design by Riccati equations", "states", (2, 4, 8, 16, 32, 64),
        by_states_of_riccati, "flops", lambda n: 25 * _riccati(n),
        "25 Schur forms of the pencils of Riccati equations", 3,
    ),
    Curve(
        "fusion, independent noise", "clusters", (2, 4, 8, 16, 32, 64, 128, 256, 512),
        partial(by_clusters, noise="independent"), "flops", lambda count: count * _factors(26),
        "30 Cholesky factors of a block for each cluster", 1.5,
    ),
    Curve(
        "fusion, common noise", "clusters", (2, 4, 8, 16, 32, 64, 128, 256, 512),
        partial(by_clusters, noise="common"), "flops", lambda count: count * _factors(26),
        "30 Cholesky factors of a block for each cluster", 1.5,
    ),
    Curve(
        "LS-SVM, dense", "samples", (100, 200, 500, 1000, 2000, 5000), by_samples, "flops",
        lambda n: n**3 / 3.0, "its Cholesky factor at the rate of a product of matrices", 3,
    ),
    Curve(
        f"LS-SVM, rank {RANK}", "samples", (1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000),
        partial(by_samples, rank=RANK), "flops", lambda n: 2.0 * RANK**2 * n,
        "pivots and normal matrix at the rate of a product of matrices",
    ),
)  # fmt: skip


def rates() -> dict[str, float]:
    """Return the bytes that are read and written in a copy, and operations, both in a second."""
    data, A = np.ones(2**23), np.ones((1500, 1500))
    copy = min(_seconds(partial(np.copyto, np.empty_like(data), data)) for _ in range(5))
    product = min(_seconds(lambda: void(A @ A)) for _ in range(5))
    return {"copy": 2 * data.nbytes / copy, "flops": 2 * len(A) ** 3 / product}


def _seconds(work: Callable[[], float | None]) -> float:
    began = time.process_time()  # of one thread; it does not see what else the machine does
    own = work()
    return time.process_time() - began if own is None else own


def measured(curve: Curve, size: int) -> tuple[float, float, float]:
    """Return the seconds of a point, the MB and the seconds of its process, which is its own."""
    queue = multiprocessing.get_context("fork").SimpleQueue()
    process = multiprocessing.get_context("fork").Process(
        target=lambda: queue.put(_measured(curve, size))
    )
    process.start()
    process.join()
    seconds, grown, whole = queue.get()
    return seconds, grown, whole


def _measured(curve: Curve, size: int) -> tuple[float, float, float]:
    # what is compiled or imported once is; not before the fork, which no solver's threads outlive
    curve.work(curve.sizes[0])()
    began = time.process_time()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    work = curve.work(size)
    seconds, total, first = math.inf, 0.0, True
    while first or total < SHORT:
        spent = _seconds(work)
        seconds, total, first = min(seconds, spent), total + max(spent, 1e-3), False
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    return seconds, grown, time.process_time() - began


def points(curve: Curve, machine: dict[str, float]) -> list[dict[str, float]]:
    """Return the points of a curve."""
    found: list[dict[str, float]] = []
    for size in curve.sizes:
        if found and found[-1]["whole"] * (size / found[-1]["size"]) ** curve.order > LONGEST:
            print(f"  {curve.name}: no longer than {found[-1]['size']:g} {curve.over}")
            break
        seconds, grown, whole = measured(curve, size)
        limit = curve.load(size) / machine[curve.rate]
        found.append(
            {
                "size": size,
                "seconds": float(f"{seconds:.3g}"),
                "megabytes": float(f"{grown:.3g}"),
                "limit": float(f"{limit:.3g}"),
                "whole": whole,
            }
        )
        print(
            f"  {curve.name}, {size} {curve.over}: {seconds:.3g} s, {grown:.0f} MB, {limit:.2g} s"
        )
    return [{key: value for key, value in each.items() if key != "whole"} for each in found]


def exponent(found: list[dict[str, float]]) -> float:
    """Return by what power of the size time grows between the last two points."""
    before, last = found[-2:]
    times, sizes = (math.log(last[key] / before[key]) for key in ("seconds", "size"))
    return round(times / sizes, 2)


if __name__ == "__main__":
    threadpool_limits(1)  # one thread, as the processes of the book have
    facts, machine = machine_facts(), rates()
    content = {
        "machine": f"{facts['cpu']}, {facts['cores']} cores, one in use, {facts['system']}, "
        f"Python {facts['python']}, numpy {np.__version__}",
        "date": datetime.now(UTC).date().isoformat(),
        "longest": LONGEST,
        "rates": {key: float(f"{value:.3g}") for key, value in machine.items()},
        "curves": [
            {
                "name": curve.name, "over": curve.over, "limit": curve.limit,
                "exponent": exponent(found), "points": found,
            }
            for curve in CURVES
            for found in [points(curve, machine)]
        ],
    }  # fmt: skip
    write_whole(OUT, json.dumps(content, indent=1) + "\n")
    write_whole(PICTURE, growth_svg(content))
    print(f"Wrote {OUT.relative_to(OUT.parent.parent)}.")
