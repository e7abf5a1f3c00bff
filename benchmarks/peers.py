"""The Kalman filter of other libraries, each used as it is quickest.

A peer is a function from a model and measurements (steps, m, runs) to a function without arguments
that filters them; what a peer needs but once, such as its own layout of the data, is done before.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from inswsn_lib.models import ErrorModel

Run = Callable[[], np.ndarray]


def by_filterpy(model: ErrorModel, y: np.ndarray) -> Run:
    """Return one filter object a run, in a loop."""
    from filterpy.kalman import KalmanFilter  # noqa: PLC0415

    n, m = len(model.A), len(model.C)

    def run() -> np.ndarray:
        estimates = np.empty((len(y), n, y.shape[2]))
        for run in range(y.shape[2]):
            kf = KalmanFilter(dim_x=n, dim_z=m)
            kf.F, kf.H, kf.P = model.A, model.C, np.eye(n)
            kf.Q, kf.R = model.process_covariance, model.measurement_covariance
            for k in range(len(y)):
                kf.update(y[k, :, run])
                estimates[k, :, run] = kf.x.ravel()
                kf.predict()
        return estimates

    return run


def by_simdkalman(model: ErrorModel, y: np.ndarray) -> Run:
    """Return the filter that takes all runs as one array of numpy."""
    import simdkalman  # noqa: PLC0415

    kf = simdkalman.KalmanFilter(
        model.A, model.process_covariance, model.C, model.measurement_covariance
    )
    n, data = len(model.A), np.ascontiguousarray(y.transpose(2, 0, 1))

    def run() -> np.ndarray:
        done = kf.compute(
            data, 0, initial_value=np.zeros(n), initial_covariance=np.eye(n), smoothed=False,
            filtered=True,
        )  # fmt: skip
        return np.asarray(done.filtered.states.mean).transpose(1, 2, 0)

    return run


def by_dynamax(model: ErrorModel, y: np.ndarray) -> Run:
    """Return the filter of JAX, compiled, mapped over the runs, in double precision."""
    import jax  # noqa: PLC0415
    from dynamax.linear_gaussian_ssm import inference  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    n = len(model.A)
    parts = (
        np.zeros(n), np.eye(n), model.A, model.process_covariance, model.C,
        model.measurement_covariance,
    )  # fmt: skip
    told = inference.make_lgssm_params(*map(jax.numpy.asarray, parts))
    # states alone: the compiler drops what nobody asks for
    means = jax.jit(jax.vmap(lambda each: inference.lgssm_filter(told, each).filtered_means))
    data = jax.numpy.asarray(y.transpose(2, 0, 1))
    return lambda: np.asarray(means(data).block_until_ready()).transpose(1, 2, 0)


def by_torch_kf(model: ErrorModel, y: np.ndarray) -> Run:
    """Return the filter of PyTorch, with one covariance for all runs."""
    import torch  # noqa: PLC0415
    from torch_kf import GaussianState, KalmanFilter  # noqa: PLC0415

    parts = model.A, model.C, model.process_covariance, model.measurement_covariance
    kf = KalmanFilter(*map(torch.tensor, parts))
    n, runs = len(model.A), y.shape[2]
    zero = torch.zeros((runs, n, 1), dtype=torch.float64)
    start = GaussianState(zero, torch.eye(n, dtype=torch.float64)[None])
    data = torch.tensor(y.transpose(0, 2, 1)[..., None])

    def run() -> np.ndarray:
        found = kf.filter(start, data, return_all=True)
        return np.asarray(found.mean[..., 0].numpy().transpose(0, 2, 1))

    return run


#: By name; what is needed of each beside the environment of the book
PEERS: dict[str, tuple[Callable[[ErrorModel, np.ndarray], Run], str]] = {
    "simdkalman": (by_simdkalman, "simdkalman"),
    "dynamax (JAX, jit and vmap)": (by_dynamax, "dynamax"),
    "torch-kf": (by_torch_kf, "torch_kf"),
}


def installed() -> dict[str, Callable[[ErrorModel, np.ndarray], Run]]:
    """Return the peers that are here, beside filterpy."""
    return {name: peer for name, (peer, module) in PEERS.items() if find_spec(module)}
