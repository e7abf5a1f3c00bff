"""Checks of arguments, made once, where a user calls the library.

A function that a user calls passes its arguments through one of these. A refusal is one sentence
that names the parameter, what it must be, and what it is. Functions inside do not check again.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inswsn_lib.errors import Described, ParameterError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
#: Sizes of an array; a word stands for any size
Shape = tuple[int | str, ...]
#: Takes an axis of runs off results again where it was put on
Back = Callable[[NDArray[Any]], NDArray[Any]]

_ROUNDING = 1e-9  # of a covariance, as a share of its largest entry


def array(name: str, value: ArrayLike, *shapes: Shape, gaps: bool = False) -> Array:
    """Return a value as an array of finite floats of one of some shapes.

    Parameters
    ----------
    name : str
        Of the parameter.
    value : array_like
    *shapes : tuple of int or str
        Such as ``("steps", 4, "runs")``.
    gaps : bool
        Whether NaN may stand where a number is missing. What a masked array hides is NaN.

    Raises
    ------
    ParameterError
        If it is something else.

    Examples
    --------
    >>> from inswsn_lib.checks import array
    >>> array("gain", [[1, 2]], ("n", 2)).tolist()
    [[1.0, 2.0]]
    >>> array("G", [1, 2], ("n", 2))
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: G must be finite numbers of shape (n, 2), not of shape (2,).
    """
    must_be = f"finite numbers{' (or NaN where missing)' if gaps else ''} {_told(shapes)}"
    found = _of_kind(name, value, "biuf", must_be)
    if not any(_fits(found.shape, shape) for shape in shapes):
        raise ParameterError(name, Described(f"of shape {found.shape}"), must_be)
    numbers = found.astype(float, copy=False)
    with np.errstate(over="ignore", invalid="ignore"):
        finite = bool(np.isfinite(numbers.sum()))  # quicker than to look at each
    if not finite and (np.isinf(numbers) if gaps else ~np.isfinite(numbers)).any():
        raise ParameterError(name, Described("infinite" if gaps else "NaN or infinite"), must_be)
    return numbers


def of_runs(
    name: str, value: ArrayLike, *shape: int | str, gaps: bool = False
) -> tuple[Array, Back]:
    """Return an array whose last axis is that of runs, and what takes it off again.

    A value without that axis is one run, and results of it are given back without one.

    Examples
    --------
    >>> from inswsn_lib.checks import of_runs
    >>> x, back = of_runs("x", [[1.0], [2.0]], "steps", 1, "runs")
    >>> x.shape, back(x).shape
    ((2, 1, 1), (2, 1))
    """
    plain = (shape[:-1],) if shape[-1] in ("runs", 1) else ()
    found = array(name, value, *plain, shape, gaps=gaps)
    one = found.ndim < len(shape)
    return found[..., None] if one else found, lambda result: result[..., 0] if one else result


def matrices(**named: tuple[ArrayLike, str]) -> list[Array]:
    """Return matrices of finite floats whose sizes fit together.

    Parameters
    ----------
    **named : tuple of array_like and str
        A matrix and two letters for its sizes, such as ``B=(B, "np")``; letters that are the same
        stand for sizes that are the same.

    Raises
    ------
    ParameterError
        If one is no such matrix, is empty, or does not fit those before it.

    Examples
    --------
    >>> from inswsn_lib.checks import matrices
    >>> matrices(A=([[1.0]], "nn"), B=([[1.0], [2.0]], "np"))
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: B must be finite numbers of shape (1, p), not of shape (2, 1).
    """
    sizes: dict[str, int] = {}
    found = []
    for name, (value, letters) in named.items():
        shape: Shape = tuple(sizes.get(letter, letter) for letter in letters)
        matrix = array(name, value, shape)
        sizes |= dict(zip(letters, matrix.shape, strict=True))
        if not matrix.size or matrix.shape != tuple(sizes[letter] for letter in letters):
            wanted = f"non-empty and of shape ({', '.join(letters)})"
            raise ParameterError(name, Described(f"of shape {matrix.shape}"), wanted)
        found.append(matrix)
    return found


def covariance(name: str, value: ArrayLike, *shapes: Shape, definite: bool = False) -> Array:
    """Return covariances (..., n, n): symmetric, and positive semidefinite or definite.

    Each is judged by the size of its own entries.

    Parameters
    ----------
    name, value, *shapes
        As in `array`.
    definite : bool
        Whether a singular one is refused.

    Raises
    ------
    ParameterError
        If it is something else.

    Examples
    --------
    >>> from inswsn_lib.checks import covariance
    >>> covariance("R", [[1, 2], [2, 1]], (2, 2))
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: R must be a covariance, not one with a negative eigenvalue.
    """
    found = array(name, value, *shapes)
    slack = _ROUNDING * np.abs(found).max(axis=(-2, -1), initial=0.0)
    if (np.abs(found - np.swapaxes(found, -1, -2)) > slack[..., None, None]).any():
        raise ParameterError(name, Described("asymmetric"), "a covariance")
    if found.size and (np.linalg.eigvalsh(found).min(axis=-1) < -slack).any():
        raise ParameterError(name, Described("one with a negative eigenvalue"), "a covariance")
    return positive_definite(name, found) if definite else found


def positive_definite(name: str, value: Array) -> Array:
    """Return symmetric matrices (..., n, n) that have a Cholesky factor."""
    try:
        np.linalg.cholesky(value)
    except np.linalg.LinAlgError:
        raise ParameterError(name, Described("singular"), "positive definite") from None
    return value


def mask(name: str, value: ArrayLike, *shapes: Shape) -> Mask:
    """Return an array of bools of one of some shapes."""
    must_be = f"booleans {_told(shapes)}"
    found = _of_kind(name, value, "b", must_be)
    if not any(_fits(found.shape, shape) for shape in shapes):
        raise ParameterError(name, Described(f"of shape {found.shape}"), must_be)
    return found


def number(
    name: str,
    value: Any,
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
) -> float:
    """Return a finite number within bounds.

    Parameters
    ----------
    name : str
        Of the parameter.
    value : object
    above, least, below, most : float, optional
        Bounds; the number may equal `least` and `most`.

    Raises
    ------
    ParameterError
        If it is something else.

    Examples
    --------
    >>> from inswsn_lib.checks import number
    >>> number("margin", 0, above=0, most=1e9)
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: margin must be a number above 0 and at most 1e+09, not 0.
    """
    found = math.nan
    if isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool):
        try:
            found = float(value)
        except OverflowError:  # of a whole number
            found = math.inf
    fits = (
        math.isfinite(found)
        and (above is None or found > above)
        and (least is None or found >= least)
        and (below is None or found < below)
        and (most is None or found <= most)
    )
    if not fits:
        bounds = {"above": above, "of at least": least, "below": below, "at most": most}
        words = " and ".join(f"{word} {b:g}" for word, b in bounds.items() if b is not None)
        if least is not None and most is not None:
            words = f"between {least:g} and {most:g}"
        words = f"of {words}" if words.startswith("at") else words
        raise ParameterError(name, value, f"a number {words}" if words else "a finite number")
    return found


def whole(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """Return a whole number within bounds.

    Examples
    --------
    >>> from inswsn_lib.checks import whole
    >>> whole("runs", 0, 1)
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: runs must be a whole number of at least 1, not 0.
    """
    fits = isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= least
    if not fits or (most is not None and value > most):
        bounds = f"of at least {least}" if most is None else f"between {least} and {most}"
        raise ParameterError(name, value, f"a whole number {bounds}")
    return int(value)


def one_of(name: str, value: Any, names: tuple[str, ...]) -> None:
    """Refuse a value that is not one of some names.

    Examples
    --------
    >>> from inswsn_lib.checks import one_of
    >>> one_of("noise", "white", ("common", "independent"))
    Traceback (most recent call last):
        ...
    inswsn_lib.errors.ParameterError: noise must be one of "common", "independent", not 'white'.
    """
    if not isinstance(value, str) or value not in names:
        raise ParameterError(name, value, "one of " + ", ".join(f'"{each}"' for each in names))


def unmasked(value: Any) -> Any:
    """Return a value, with NaN for the numbers that masked arrays hide, also those in a list.

    Examples
    --------
    >>> import numpy as np
    >>> from inswsn_lib.checks import unmasked
    >>> unmasked([[1, 2], np.ma.masked_equal([3, 4], 4)]).tolist()
    [[1.0, 2.0], [3.0, nan]]
    """
    hidden = _hidden(value)
    return value if hidden is False else np.where(hidden, np.nan, np.asarray(value))


def _hidden(value: Any) -> Any:
    """Return which entries masked arrays hide; False if there are no such arrays."""
    if isinstance(value, np.ma.MaskedArray):
        return np.ma.getmaskarray(value)
    # a list of a million numbers is told by its types
    nests = isinstance(value, list | tuple) and any(
        issubclass(kind, list | tuple | np.ma.MaskedArray) for kind in set(map(type, value))
    )
    parts = [_hidden(each) for each in value] if nests else []
    if all(part is False for part in parts):
        return False
    pairs = zip(parts, value, strict=True)
    return np.array([np.broadcast_to(part, np.shape(each)) for part, each in pairs])


def _of_kind(name: str, value: ArrayLike, kinds: str, must_be: str) -> NDArray[Any]:
    """Return an array of one of some kinds of dtype."""
    try:
        found, hidden = np.asarray(value), _hidden(value)
    except (TypeError, ValueError):
        raise ParameterError(name, Described("rows of unequal length"), must_be) from None
    if found.dtype.kind not in kinds:
        raise ParameterError(name, Described(f"{found.dtype} of shape {found.shape}"), must_be)
    if hidden is False or not hidden.any():
        return found
    if "f" not in kinds:  # only numbers can be NaN
        raise ParameterError(name, Described("partly masked"), must_be)
    return np.where(hidden, np.nan, found)


def _told(shapes: tuple[Shape, ...]) -> str:
    return f"of shape {' or '.join(str(s).replace(chr(39), '') for s in shapes)}"


def _fits(found: tuple[int, ...], shape: Shape) -> bool:
    return len(found) == len(shape) and all(
        isinstance(wanted, str) or wanted == size for wanted, size in zip(shape, found, strict=True)
    )
