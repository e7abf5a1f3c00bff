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
    >>> bounds(interval("0.5"))
    (0.45, 0.55)
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

    Raises
    ------
    ParameterError
        If `text` is not a number or `half_width` is negative or not finite.
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

    Examples
    --------
    >>> derive(reduction, "14.77", "28.54").value  # doctest: +ELLIPSIS
    48.248...
    """
    exact = function(*(iv.mpf(str(_decimal(text))) for text in texts))
    return Derived(float(exact.mid), function(*map(interval, texts)))


def bounds(x: Interval) -> tuple[float, float]:
    """Return the lower and upper end of an interval as floats."""
    return float(x.a), float(x.b)


def admits(x: Interval, text: Printed) -> bool:
    """Tell whether some value in an interval rounds to a printed number.

    Parameters
    ----------
    x : interval
        The interval, in the unit of the number.
    text : str
        The number as printed.
    """
    return intersects(x, interval(text))


def intersects(x: Interval, y: Interval) -> bool:
    """Tell whether two closed intervals have a value in common.

    Parameters
    ----------
    x, y : interval
        Two intervals in one unit.
    """
    return bool(x.a <= y.b) and bool(y.a <= x.b)


def span(low: float, high: float) -> Interval:
    """Return the closed interval between two numbers.

    Parameters
    ----------
    low, high : float
        Its ends.

    Raises
    ------
    ParameterError
        If `low` is above `high`.
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

    Raises
    ------
    ParameterError
        If they have none.
    """
    if not intersects(x, y):
        raise ParameterError("y", bounds(y), f"an interval that meets {bounds(x)}")
    return iv.mpf([max(x.a, y.a), min(x.b, y.b)])


def root(x: Interval) -> Interval:
    """Return the interval of the square roots of the values in an interval.

    Raises
    ------
    ParameterError
        If `x` holds a negative value.
    """
    if x.a < 0:
        raise ParameterError("x", bounds(x), "an interval without negative values")
    return iv.sqrt(x)


def mean(*cells: Interval) -> Interval:
    """Return the interval of the arithmetic mean of independent values in `cells`.

    Raises
    ------
    ParameterError
        If there are no cells.
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

    Raises
    ------
    ParameterError
        If `before` may be zero.
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
    """
    scale = iv.mpf(str(_decimal(factor, "factor")))

    def entry(text: Printed) -> Interval:
        return (interval(text) if "." in text else iv.mpf(str(_decimal(text)))) * scale

    return [[entry(text) for text in row] for row in rows]
