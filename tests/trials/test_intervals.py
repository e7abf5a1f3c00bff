"""How often intervals over clusters hold the truth, in the layouts that the book uses."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from scipy.stats import binomtest

from inswsn_lib.evaluation import cluster_mean, cluster_median, cluster_share

WHOLE = 4000


# blocks, places, routes, and places of the routes: how many clusters, of how many values
def share(values: np.ndarray, labels: np.ndarray) -> tuple[float, float, float]:
    """Return that of values in what is eight and the values of other clusters."""
    return cluster_share(values, 8 + np.roll(values, len(values) // len(set(labels))), labels)


LAYOUTS: dict[Callable[..., tuple[float, float, float]], list[tuple[int, int]]] = {
    cluster_mean: [(6, 2), (8, 5), (12, 5), (96, 5)],
    cluster_median: [(12, 5)],
    share: [(6, 2), (96, 5)],
}
POPULATIONS: dict[str, Callable[[np.random.Generator, Any], np.ndarray]] = {
    "normal": lambda rng, size: rng.normal(size=size),
    "exponential": lambda rng, size: rng.exponential(size=size),
    "heavy-tailed": lambda rng, size: rng.standard_t(3, size=size),
}
MEANS = {"normal": 0.0, "exponential": 2.0, "heavy-tailed": 0.0}
SHARES = {name: mean / (8 + mean) for name, mean in MEANS.items()}
# of the sum of two exponentials: x with (1 + x) exp(-x) = 1/2
MEDIANS = MEANS | {"exponential": 1.6783469900166606}


def test_intervals(size: Callable[[int, int], int], seed: int, tell: Callable[[str], None]) -> None:
    """Half of the variance is between clusters. Confidence bounds of the coverage are 95 %."""
    trials, worst = size(200, WHOLE), {}
    for how, truths in ((cluster_mean, MEANS), (cluster_median, MEDIANS), (share, SHARES)):
        for (clusters, each), (name, draw) in product(LAYOUTS[how], POPULATIONS.items()):
            rng, labels = np.random.default_rng(seed), np.repeat(np.arange(clusters), each)
            hits = 0
            for trial in range(trials):
                values = draw(rng, clusters)[labels] + draw(rng, len(labels))
                options = {"seed": trial, "resamples": 400} if how is cluster_median else {}
                _, low, high = how(values, labels, **options)
                hits += low <= truths[name] <= high
            worst[how.__name__, clusters, name] = hits
    ends = [binomtest(hits, trials).proportion_ci(0.95) for hits in worst.values()]
    shares = np.array(list(worst.values())) / trials
    tell(
        f"{len(worst)} layouts and populations of {trials} trials: intervals of 95 % hold "
        f"{100 * shares.min():.1f} to {100 * shares.max():.1f} %"
    )
    if trials == WHOLE:
        assert min(end.low for end in ends) >= 0.92, worst
        assert max(end.high for end in ends) <= 0.98, worst
    # of fewer: not refuted, where each would be once in 10,000 by chance
    for hits in worst.values():
        assert binomtest(hits, trials, 0.93, "less").pvalue > 1e-4
        assert binomtest(hits, trials, 0.97, "greater").pvalue > 1e-4
