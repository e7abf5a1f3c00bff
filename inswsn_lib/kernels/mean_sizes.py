"""Mean absolute values of errors that are linear in a few numbers, and their derivatives."""

from __future__ import annotations

from math import erf, exp, pi, sqrt

import numpy as np

from inswsn_lib.kernels.choice import kernel


@kernel(error_model="numpy", fastmath={"contract"})
def mean_sizes(basis, deviation, mean, numbers):
    """Return cells, (cells,), and slopes, (cells, numbers); arguments as in `drift_family`."""
    cells, slopes = np.zeros(len(mean)), np.zeros((len(mean), len(numbers)))
    for e in range(len(basis)):
        error = 0.0
        for j in range(len(numbers)):
            error += basis[e, j] * numbers[j]
        ratio = error / deviation[e]
        if abs(ratio) > 40.0:  # what is left out is zero in double precision
            sign = 1.0 if ratio > 0.0 else -1.0
            size = abs(error)
        else:
            sign = erf(ratio / sqrt(2.0))
            size = sqrt(2.0 / pi) * deviation[e] * exp(-(ratio**2) / 2.0) + error * sign
        for c in range(len(mean)):
            weight = mean[c, e]
            if weight != 0.0:
                cells[c] += weight * size
                for j in range(len(numbers)):
                    slopes[c, j] += weight * sign * basis[e, j]
    return cells, slopes
