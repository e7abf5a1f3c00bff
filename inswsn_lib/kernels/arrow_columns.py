"""What each unknown of a part does to the part's inequality."""

from __future__ import annotations

from typing import Any

import numpy as np

from inswsn_lib.kernels.choice import kernel


@kernel()
def arrow_columns(J: Any, unknown: Any, row: Any, column: Any, weight: Any) -> Any:
    """Return the sums of w (j k' + k j') / 2 over the places of each unknown, j and k rows of J.

    Of each sum, (d, d), the upper triangle is taken by rows, with the root of 2 off the diagonal.
    """
    parts, _, d = J.shape
    columns = np.zeros((parts, unknown[-1] + 1, d * (d + 1) // 2))
    root = np.sqrt(2.0)
    for c in range(parts):
        for place in range(len(unknown)):
            left, right, at = J[c, row[place]], J[c, column[place]], 0
            into = columns[c, unknown[place]]
            for a in range(d):
                into[at] += weight[place] * left[a] * right[a]
                at += 1
                for b in range(a + 1, d):
                    both = left[a] * right[b] + left[b] * right[a]
                    into[at] += weight[place] * both / 2 * root
                    at += 1
    return columns
