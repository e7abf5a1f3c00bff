"""Printed numbers as the intervals of values that round to them.

The arithmetic is that of mpmath's interval context, which rounds outward: the interval of a
result contains every result that values inside the operands' intervals can give.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from mpmath import iv

from inswsn_lib.checks import number
from inswsn_lib.errors import ParameterError

#: A closed interval of real numbers (``mpmath.iv.mpf``; mpmath has no type stubs).
Interval = Any
#: A number as a paper prints it, for example ``"0.0900"``: its digits carry its rounding.
Printed = str

# What fits into a float, and on a page
_FORM = re.compile(r"[-+]?([0-9]{1,99}(\.[0-9]{0,99})?|\.[0-9]{1,99})([eE][-+]?[0-9]{1,2})?")


def _decimal(text: Printed) -> Decimal:
    if not isinstance(text, str) or not _FORM.fullmatch(text):
        raise ParameterError("text", text, "a printed decimal number such as '0.0900'")
    return Decimal(text)


def interval(text: Printed) -> Interval:
    r"""Return the closed interval of the values that round to a printed number.

    With :math:`d` digits after the point, the number :math:`a` stands for
    :math:`[a - \tfrac12 10^{-d},\; a + \tfrac12 10^{-d}]`. Both ends belong to it, since the
    papers do not say how they round a tie.

    Examples
    --------
    The trailing zero of 0.50 says that it is known ten times better than 0.5:

    >>> from inswsn_lib.papers import bounds, interval
    >>> for text in ("0.5", "0.50"):
    ...     print("{:.3f} to {:.3f}".format(*bounds(interval(text))))
    0.450 to 0.550
    0.495 to 0.505
    """
    exponent = _decimal(text).as_tuple().exponent
    assert isinstance(exponent, int)  # finite numbers have one
    return about(text, Decimal(5).scaleb(min(exponent, 0) - 1))


def about(text: Printed, half_width: float | Decimal) -> Interval:
    """Return the interval that "about `text`" stands for: the number less and plus a half width.

    Parameters
    ----------
    text : str
        The number as it is printed.
    half_width : float or decimal.Decimal
        In the unit of the number, not negative.

    Examples
    --------
    P1's "about 85 %", if it speaks in multiples of 5 %, stands for 82.5 % to 87.5 %:

    >>> from inswsn_lib.papers import about, bounds
    >>> bounds(about("85", 2.5))
    (82.5, 87.5)
    """
    number("half_width", float(half_width), least=0)
    value, half = _decimal(text), Decimal(str(half_width))
    return iv.mpf([str(value - half), str(value + half)])


def span(low: float, high: float) -> Interval:
    """Return the closed interval between two numbers.

    Parameters
    ----------
    low, high : float
        In order.

    Examples
    --------
    >>> from inswsn_lib.papers import bounds, span
    >>> bounds(span(0, 1) - span(0, 1))  # two values from it need not be the same
    (-1.0, 1.0)
    """
    if not low <= high:
        raise ParameterError("low", low, f"at most high, {high}")
    return iv.mpf([low, high])


def bounds(x: Interval) -> tuple[float, float]:
    """Return the lower and upper end of an interval as floats.

    Examples
    --------
    >>> from inswsn_lib.papers import bounds, span
    >>> bounds(span(0.25, 0.5))
    (0.25, 0.5)
    """
    return float(x.a), float(x.b)


def intersects(x: Interval, y: Interval) -> bool:
    """Tell whether two closed intervals have a value in common.

    Parameters
    ----------
    x, y : Interval

    Examples
    --------
    >>> from inswsn_lib.papers import intersects, span
    >>> intersects(span(0, 1), span(1, 2)), intersects(span(0, 1), span(1.5, 2))
    (True, False)
    """
    return bool(x.a <= y.b) and bool(y.a <= x.b)


def meet(x: Interval, y: Interval) -> Interval:
    """Return the interval of the values that two closed intervals have in common.

    Parameters
    ----------
    x, y : Interval
        Those that intersect.

    Examples
    --------
    >>> from inswsn_lib.papers import bounds, meet, span
    >>> bounds(meet(span(0, 2), span(1, 3)))
    (1.0, 2.0)
    """
    if not intersects(x, y):
        raise ParameterError("y", bounds(y), f"an interval that meets {bounds(x)}")
    return iv.mpf([max(x.a, y.a), min(x.b, y.b)])


def admits(x: Interval, text: Printed) -> bool:
    """Tell whether some value in an interval rounds to a printed number.

    Parameters
    ----------
    x : Interval
    text : str
        The number as it is printed.

    Examples
    --------
    The mean of 0.1 and 0.2, each within its rounding, may be printed as either, but not as 0.3:

    >>> from inswsn_lib.papers import admits, interval, mean
    >>> both = mean(interval("0.1"), interval("0.2"))
    >>> [text for text in ("0.1", "0.2", "0.3") if admits(both, text)]
    ['0.1', '0.2']
    """
    return intersects(x, interval(text))


def mean(*cells: Interval) -> Interval:
    """Return the interval of the arithmetic mean of independent values in `cells`.

    Examples
    --------
    >>> from inswsn_lib.papers import bounds, mean, span
    >>> bounds(mean(span(0, 1), span(2, 4)))
    (1.0, 2.5)
    """
    if not cells:
        raise ParameterError("cells", cells, "at least one interval")
    return sum(cells, iv.mpf(0)) / len(cells)


def reduction(after: Interval, before: Interval) -> Interval:
    r"""Return the reduction :math:`100\,(1 - \text{after}/\text{before})` in per cent.

    Parameters
    ----------
    after, before : Interval
        In one unit; `before` does not hold zero.

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


@dataclass(frozen=True)
class Derived:
    """A number computed from printed numbers, by `derive`.

    Attributes
    ----------
    value : float
        What the printed digits themselves give.
    interval : interval
        All that values within their rounding can give.

    Examples
    --------
    >>> from inswsn_lib.papers import Derived, span
    >>> Derived(1.5, span(1.25, 1.75)).limits
    (1.25, 1.75)
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
    From 1.00 to 0.50 is a reduction by 50 %, and by less or more for all that rounds to the two:

    >>> from inswsn_lib.papers import derive, reduction
    >>> found = derive(reduction, "0.50", "1.00")
    >>> print(f"{found.value:.2f}, {found.limits[0]:.2f} to {found.limits[1]:.2f}")
    50.00, 49.25 to 50.75
    """
    exact = function(*(about(text, 0) for text in texts))
    return Derived(float(exact.mid), function(*map(interval, texts)))
