"""Printed numbers as the intervals of values that round to them.

The arithmetic is that of mpmath's interval context, which rounds outward: the interval of a
result contains every result that values inside the operands' intervals can give.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from typing import Any

from mpmath import iv

from inswsn_lib.errors import ParameterError

#: A closed interval of real numbers (``mpmath.iv.mpf``; mpmath has no type stubs).
Interval = Any
#: A number as a paper prints it, for example ``"0.0900"``: its digits carry its rounding.
Printed = str


def _decimal(text: Printed, name: str = "text") -> Decimal:
    try:
        value = Decimal(text)
    except (InvalidOperation, TypeError):
        raise ParameterError(name, text, "a printed decimal number such as '0.0900'") from None
    if not value.is_finite():
        raise ParameterError(name, text, "a finite printed number")
    return value


def interval(text: Printed) -> Interval:
    r"""Return the closed interval of the values that round to a printed number.

    With :math:`d` digits after the point, the number :math:`a` stands for
    :math:`[a - \tfrac12 10^{-d},\; a + \tfrac12 10^{-d}]`. Both ends belong to it, since the
    papers do not say how they round a tie.

    Parameters
    ----------
    text : str
        The number as printed, with its trailing zeros.

    Returns
    -------
    mpmath.iv.mpf
        The interval, in the unit of the number.

    Raises
    ------
    ParameterError
        If `text` is not a finite decimal number.

    Examples
    --------
    The trailing zero of 0.50 says that it is known ten times better than 0.5:

    >>> from inswsn_lib.papers import bounds, interval
    >>> for text in ("0.5", "0.50"):
    ...     print("{:.3f} to {:.3f}".format(*bounds(interval(text))))
    0.450 to 0.550
    0.495 to 0.505
    """
    value = _decimal(text)
    exponent = value.as_tuple().exponent
    assert isinstance(exponent, int)  # finite numbers have one
    half = Decimal(5).scaleb(min(exponent, 0) - 1)
    return iv.mpf([str(value - half), str(value + half)])


def about(text: Printed, half_width: float) -> Interval:
    """Return the interval that "about `text`" stands for.

    Parameters
    ----------
    text : str
        The number as printed.
    half_width : float
        Half the width of the interval, in the unit of the number; at least 0.

    Returns
    -------
    mpmath.iv.mpf
        The value less and plus the half width.

    Raises
    ------
    ParameterError
        If `text` is not a number or `half_width` is negative or not finite.

    Examples
    --------
    P1's "about 85 %", if it speaks in multiples of 5 %, stands for 82.5 % to 87.5 %:

    >>> from inswsn_lib.papers import about, bounds
    >>> bounds(about("85", 2.5))
    (82.5, 87.5)
    """
    if not 0 <= half_width < float("inf"):
        raise ParameterError("half_width", half_width, "a finite number of at least 0")
    value, half = _decimal(text), Decimal(str(half_width))
    return iv.mpf([str(value - half), str(value + half)])


@dataclass(frozen=True)
class Derived:
    """A number computed from printed numbers.

    Attributes
    ----------
    value : float
        What the printed digits themselves give.
    interval : interval
        All that values within their rounding can give.

    Examples
    --------
    P1 prints the errors 0.3881 m and 2.9170 m. Whatever the rounding hides, 86.7 % are saved:

    >>> from inswsn_lib.papers import derive, reduction
    >>> found = derive(reduction, "0.3881", "2.9170")
    >>> print(f"{found.value:.2f}")
    86.70
    >>> print("{:.3f} to {:.3f}".format(*found.limits))
    86.693 to 86.697
    """

    value: float
    interval: Interval

    @property
    def limits(self) -> tuple[float, float]:
        """The ends of the interval."""
        return bounds(self.interval)


def derive(function: Callable[..., Interval], *texts: Printed) -> Derived:
    """Compute with printed numbers twice: with their digits, and with their rounding intervals.

    Parameters
    ----------
    function : callable
        Takes as many intervals as there are `texts`, returns one.
    *texts : str
        Printed numbers.

    Returns
    -------
    Derived
        The value from the digits, and the interval from their rounding.

    Examples
    --------
    From 1.00 to 0.50 is a reduction by 50 %, and by less or more for all that rounds to the two:

    >>> from inswsn_lib.papers import derive, reduction
    >>> found = derive(reduction, "0.50", "1.00")
    >>> print(f"{found.value:.2f}, {found.limits[0]:.2f} to {found.limits[1]:.2f}")
    50.00, 49.25 to 50.75
    """
    exact = function(*(iv.mpf(str(_decimal(text))) for text in texts))
    return Derived(float(exact.mid), function(*map(interval, texts)))


def bounds(x: Interval) -> tuple[float, float]:
    """Return the lower and upper end of an interval as floats.

    Parameters
    ----------
    x : interval
        The interval.

    Returns
    -------
    low, high : float

    Examples
    --------
    >>> from inswsn_lib.papers import bounds, span
    >>> bounds(span(0.25, 0.5))
    (0.25, 0.5)
    """
    return float(x.a), float(x.b)


def admits(x: Interval, text: Printed) -> bool:
    """Tell whether some value in an interval rounds to a printed number.

    Parameters
    ----------
    x : interval
        The interval, in the unit of the number.
    text : str
        The number as printed.

    Returns
    -------
    bool

    Examples
    --------
    A third is printed as 0.33. The mean of 0.1 and 0.2 may be printed as either, but not as 0.3:

    >>> from inswsn_lib.papers import admits, interval, mean, span
    >>> admits(span(1 / 3, 1 / 3), "0.33")
    True
    >>> both = mean(interval("0.1"), interval("0.2"))
    >>> [text for text in ("0.1", "0.2", "0.3") if admits(both, text)]
    ['0.1', '0.2']
    """
    return intersects(x, interval(text))


def intersects(x: Interval, y: Interval) -> bool:
    """Tell whether two closed intervals have a value in common.

    Parameters
    ----------
    x, y : interval
        Two intervals in one unit.

    Returns
    -------
    bool

    Examples
    --------
    >>> from inswsn_lib.papers import intersects, span
    >>> intersects(span(0, 1), span(1, 2)), intersects(span(0, 1), span(1.5, 2))
    (True, False)
    """
    return bool(x.a <= y.b) and bool(y.a <= x.b)


def span(low: float, high: float) -> Interval:
    """Return the closed interval between two numbers.

    Parameters
    ----------
    low, high : float
        Its ends.

    Returns
    -------
    mpmath.iv.mpf
        The interval, in the unit of its ends.

    Raises
    ------
    ParameterError
        If `low` is above `high`.

    Examples
    --------
    >>> from inswsn_lib.papers import bounds, span
    >>> bounds(span(0, 1) - span(0, 1))  # two values from it need not be the same
    (-1.0, 1.0)
    """
    if not low <= high:
        raise ParameterError("low", low, f"a number of at most high, {high}")
    return iv.mpf([low, high])


def meet(x: Interval, y: Interval) -> Interval:
    """Return the interval of the values that two closed intervals have in common.

    Parameters
    ----------
    x, y : interval
        Two intervals in one unit.

    Returns
    -------
    mpmath.iv.mpf
        In the same unit.

    Raises
    ------
    ParameterError
        If they have none.

    Examples
    --------
    Two measurements of one number leave what both allow:

    >>> from inswsn_lib.papers import bounds, meet, span
    >>> bounds(meet(span(0, 2), span(1, 3)))
    (1.0, 2.0)
    """
    if not intersects(x, y):
        raise ParameterError("y", bounds(y), f"an interval that meets {bounds(x)}")
    return iv.mpf([max(x.a, y.a), min(x.b, y.b)])


def root(x: Interval) -> Interval:
    """Return the interval of the square roots of the values in an interval.

    Parameters
    ----------
    x : interval
        The interval.

    Returns
    -------
    mpmath.iv.mpf
        In the root of its unit.

    Raises
    ------
    ParameterError
        If `x` holds a negative value.

    Examples
    --------
    >>> from inswsn_lib.papers import bounds, root, span
    >>> bounds(root(span(4, 9)))
    (2.0, 3.0)
    """
    if x.a < 0:
        raise ParameterError("x", bounds(x), "an interval without negative values")
    return iv.sqrt(x)


def mean(*cells: Interval) -> Interval:
    """Return the interval of the arithmetic mean of independent values in `cells`.

    Parameters
    ----------
    *cells : interval
        Intervals in one unit.

    Returns
    -------
    mpmath.iv.mpf
        In the same unit.

    Raises
    ------
    ParameterError
        If there are no cells.

    Examples
    --------
    The mean of 0.1 and 0.2, each within its rounding, is 0.15 within half a unit of the last digit:

    >>> from inswsn_lib.papers import interval, mean
    >>> found = mean(interval("0.1"), interval("0.2"))
    >>> print(f"{float(found.a):.2f} to {float(found.b):.2f}")
    0.10 to 0.20
    """
    if not cells:
        raise ParameterError("cells", cells, "at least one interval")
    return sum(cells, iv.mpf(0)) / len(cells)


def reduction(after: Interval, before: Interval) -> Interval:
    r"""Return the reduction :math:`100\,(1 - \text{after}/\text{before})` in per cent.

    Parameters
    ----------
    after, before : interval
        Two errors in one unit, independent of each other.

    Returns
    -------
    mpmath.iv.mpf
        Per cent; negative where the error has grown.

    Raises
    ------
    ParameterError
        If `before` may be zero.

    Examples
    --------
    From between 10 m and 20 m down to 5 m:

    >>> from inswsn_lib.papers import bounds, reduction, span
    >>> bounds(reduction(span(5, 5), span(10, 20)))
    (50.0, 75.0)
    """
    if before.a <= 0 <= before.b:
        raise ParameterError("before", bounds(before), "an interval without zero")
    return 100 * (1 - after / before)


def interval_matrix(rows: Sequence[Sequence[Printed]], factor: Printed = "1") -> list[list[Any]]:
    """Return a printed matrix as intervals, each entry times the exact common `factor`.

    An entry printed without a decimal point, such as the 0 and 1 of a structural matrix, is
    taken as exact.

    Parameters
    ----------
    rows : sequence of sequences of str
        The entries as printed.
    factor : str
        The power of ten printed before the matrix, for example ``"1e-11"``.

    Returns
    -------
    list of lists of mpmath.iv.mpf
        The rows.

    Examples
    --------
    The 1 and the 0 of a structural matrix are exact, and 0.5 is what rounds to it:

    >>> from inswsn_lib.papers import interval_matrix
    >>> for row in interval_matrix([["1", "0"], ["0", "0.5"]]):
    ...     print([f"{float(entry.a):.2f} to {float(entry.b):.2f}" for entry in row])
    ['1.00 to 1.00', '0.00 to 0.00']
    ['0.00 to 0.00', '0.45 to 0.55']
    """
    scale = iv.mpf(str(_decimal(factor, "factor")))

    def entry(text: Printed) -> Interval:
        return (interval(text) if "." in text else iv.mpf(str(_decimal(text)))) * scale

    return [[entry(text) for text in row] for row in rows]
