"""The uncertainty of fits to errors correlated over time, by leaving out whole blocks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inswsn_lib.checks import Array, Mask
from inswsn_lib.errors import InswsnError

#: Blocks below which a covariance says nothing
FEWEST = 6

_ROUNDING = 1e-6  # of a block
_MOST, _ALWAYS = 20.0, 2e4  # windows for each row, and those that are no matter
_SINGULAR = 1e-10  # of eigenvalues of a scaled information


def spaced(begin: float, end: float, step: float, rows: int) -> Array:
    """Return the times from one to another, as `numpy.arange`; refuse far more than rows."""
    if end - begin > step * max(_ALWAYS, _MOST * rows):
        raise InswsnError(
            f"{rows} rows are spread over {end - begin:.3g} s: a clock was set in between, or time "
            "stamps are not in s."
        )
    return np.arange(begin, end, step)


def block_starts(time: Array, seconds: float) -> NDArray[np.intp]:
    """Return the first row of each block of some seconds, from the first stamp on.

    Blocks without a row are none. Where the time is short there are ten of them.
    """
    length = min(seconds, float(time[-1] - time[0]) / 10)
    cell = np.floor((time - time[0]) / max(length, 1e-9) + _ROUNDING)
    cell = np.minimum(cell, cell[-1] - (cell[-1] > 9))  # the last stamp begins no block of its own
    return np.flatnonzero(np.diff(cell, prepend=-1.0))


def block_sums(
    jacobian: Array, push: Array, weight: Array, starts: NDArray[np.intp]
) -> tuple[Array, Array]:
    """Return the information (blocks, p, p) and the gradient (blocks, p) of each block.

    Of residuals e with the derivatives J and a loss with the derivatives psi and psi', they are the
    sums of psi' J J' and of psi J.
    """
    ends = [*starts[1:].tolist(), len(push)]
    parts = [slice(a, b) for a, b in zip(starts.tolist(), ends, strict=True)]
    information = [(jacobian[p] * weight[p, None]).T @ jacobian[p] for p in parts]
    return np.array(information), np.array([push[p] @ jacobian[p] for p in parts])


def jackknife(information: Array, gradient: Array) -> tuple[Array, Mask]:
    r"""Return the covariance (p, p) of an estimate, and which unknowns a single block tells.

    Errors of one block may hang together in any way; those of two are taken for independent, so
    blocks have to be longer than errors last. The estimate without block g differs by
    :math:`(A - A_g)^{-1} s_g` to first order, and

    .. math:: V = \frac{G - 1}{G} \sum_g (A - A_g)^{-1} s_g s_g' (A - A_g)^{-1}.

    This is the covariance by clusters (Liang and Zeger 1986), in the form CR3, which is not too
    small when the clusters are few (MacKinnon, Nielsen and Webb 2023; a jackknife by blocks in
    time is Künsch's, 1989). Unknowns that are lost with a block have NaN.

    Parameters
    ----------
    information : ndarray, (G, p, p)
        Of each block, A_g; A is their sum.
    gradient : ndarray, (G, p)
        Of each block at the estimate, s_g.
    """
    size = np.sqrt(np.maximum(np.diagonal(information.sum(axis=0)), 1e-300))
    scaled = information / (size[:, None] * size)
    without = scaled.sum(axis=0) - scaled
    values, vectors = np.linalg.eigh(without)
    gone = values <= np.maximum(_SINGULAR * values[:, -1:], 1e-300)
    lost: Mask = ((gone[:, None, :] * vectors**2).sum(axis=2) > 0.01).any(axis=0)
    inverse = np.where(gone, 0.0, 1 / np.where(gone, 1.0, values))
    along = np.einsum("gji,gj->gi", vectors, gradient / size) * inverse
    moved = np.einsum("gij,gj->gi", vectors, along) / size
    count = len(gradient)
    covariance = (count - 1) / count * moved.T @ moved
    covariance[lost], covariance[:, lost] = np.nan, np.nan
    return covariance, lost
