"""What the papers print: their tables and numbers, with the rounding that the digits carry.

A printed number stands for every value that rounds to it. All arithmetic on printed numbers in
this book is therefore interval arithmetic: a statement of a paper is contradicted by the paper's
own cells only if no values that round to the cells can give it.
"""

from inswsn_lib.papers.comparisons import (
    AXES,
    COLUMNS,
    ordered_columns,
    orders_below,
    pooled_reductions,
    reductions,
    supported,
)
from inswsn_lib.papers.printed import (
    Derived,
    Printed,
    about,
    admits,
    bounds,
    derive,
    intersects,
    interval,
    interval_matrix,
    mean,
    meet,
    reduction,
    root,
    span,
)
from inswsn_lib.papers.readings import (
    Reading,
    chance_assignments,
    offset_scores,
    rows_admitted,
    score,
    shifted_mean,
)
from inswsn_lib.papers.tables import read_numbers, read_table

__all__ = [
    "AXES",
    "COLUMNS",
    "Derived",
    "Printed",
    "Reading",
    "about",
    "admits",
    "bounds",
    "chance_assignments",
    "derive",
    "intersects",
    "interval",
    "interval_matrix",
    "mean",
    "meet",
    "offset_scores",
    "ordered_columns",
    "orders_below",
    "pooled_reductions",
    "read_numbers",
    "read_table",
    "reduction",
    "reductions",
    "root",
    "rows_admitted",
    "score",
    "shifted_mean",
    "span",
    "supported",
]
