"""Make book/inswsn_book/live/chi_square.json, the bounds that a page without scipy looks up.

    python studies/chi_square_bounds.py [FILE]

It holds the 2.5 % and 97.5 % quantiles of the chi-square distribution over its degrees of freedom,
by one over the root of these. There they run nearly straight, down to 1 for degrees without end:
every whole number of degrees up to 100 is there, and beyond them every thousandth.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from inswsn_book.files import write_whole
from scipy.stats import chi2

TAIL = 0.025  # on either side
TARGET = Path(__file__).parents[1] / "book" / "inswsn_book" / "live" / "chi_square.json"


def make() -> str:
    """Return the text of the file."""
    roots = np.concatenate([np.arange(1, 100) / 1000, 1 / np.sqrt(np.arange(100, 0, -1))])
    degrees = roots**-2
    columns = {"roots": roots} | {
        name: chi2.ppf(level, degrees) / degrees
        for name, level in (("low", TAIL), ("high", 1 - TAIL))
    }
    limit = {"roots": 0.0, "low": 1.0, "high": 1.0}
    told = {name: [limit[name], *values.round(10).tolist()] for name, values in columns.items()}
    return json.dumps(told) + "\n"


if __name__ == "__main__":
    write_whole(Path(sys.argv[1]) if len(sys.argv) > 1 else TARGET, make())
