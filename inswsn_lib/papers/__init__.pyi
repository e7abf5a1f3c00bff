from .printed import (
    Derived as Derived,
    Printed as Printed,
    about as about,
    admits as admits,
    bounds as bounds,
    derive as derive,
    intersects as intersects,
    interval as interval,
    mean as mean,
    meet as meet,
    reduction as reduction,
    span as span,
)
from .tables import (
    AXES as AXES,
    COLUMNS as COLUMNS,
    read_numbers as read_numbers,
    read_rows as read_rows,
    read_table as read_table,
)
