from .comparisons import (
    AXES as AXES,
    COLUMNS as COLUMNS,
    ordered_columns as ordered_columns,
    orders_below as orders_below,
    pooled_reductions as pooled_reductions,
    reductions as reductions,
    supported as supported,
)
from .printed import (
    Derived as Derived,
    Printed as Printed,
    about as about,
    admits as admits,
    bounds as bounds,
    derive as derive,
    intersects as intersects,
    interval as interval,
    interval_matrix as interval_matrix,
    mean as mean,
    meet as meet,
    reduction as reduction,
    root as root,
    span as span,
)
from .readings import (
    Reading as Reading,
    chance_assignments as chance_assignments,
    offset_scores as offset_scores,
    rows_admitted as rows_admitted,
    score as score,
    shifted_mean as shifted_mean,
)
from .tables import read_numbers as read_numbers, read_table as read_table
