"""Models, covariances and measurements for the tests of filters, drawn with a seed."""

from __future__ import annotations

import numpy as np

from inswsn_lib.models import ErrorModel

#: Which of three clusters hear the node, all but none of them
PATTERNS = [tuple(bool(code >> c & 1) for c in range(3)) for code in range(1, 8)]


def random_model(rng: np.random.Generator, n: int, m: int) -> ErrorModel:
    return ErrorModel(
        A=np.eye(n) + 0.4 * rng.normal(size=(n, n)), B=rng.normal(size=(n, n)),
        C=rng.normal(size=(m, n)), D=np.eye(m) + 0.3 * rng.normal(size=(m, m)), period=1.0,
    )  # fmt: skip


def random_covariances(rng: np.random.Generator, size: int, *shape: int) -> np.ndarray:
    root = rng.normal(size=(*shape, size, size))
    return root @ np.swapaxes(root, -1, -2) + 0.3 * np.eye(size)


def random_weights(rng: np.random.Generator, n: int) -> dict[tuple[bool, ...], np.ndarray]:
    """Full matrices for each pattern, positive definite before they are made to add up to I."""
    found = {}
    for pattern in PATTERNS:
        roots = rng.normal(size=(3, n, n))
        M = roots @ np.swapaxes(roots, 1, 2) * np.array(pattern)[:, None, None]
        found[pattern] = np.linalg.inv(M.sum(axis=0)) @ M
    return found


def gappy(rng: np.random.Generator, shape: tuple[int, ...], *, shared: bool = False) -> np.ndarray:
    """Return measurements (N, steps, m, runs); clusters come and go, and components are missing.

    For some steps nobody hears the node in the first run; if shared, in any run.
    """
    clusters, steps, _, runs = shape
    y, own = rng.normal(size=shape), 1 if shared else runs
    away = (rng.random((clusters, -(-steps // 4), 1, own)) < 0.5).repeat(4, axis=1)[:, :steps]
    gaps = away | (rng.random((*shape[:3], own)) < 0.1)
    gaps[:, 20:24, :, 0] = True
    return np.where(gaps, np.nan, y)
