"""What arguments are held to: each kind is told from what is none, in one sentence."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from inswsn_lib import checks
from inswsn_lib.errors import ParameterError

NAN, INF = float("nan"), float("inf")
NUMBERS = "must be finite numbers"
REFUSED: dict[str, Callable[[], Any]] = {
    f"x {NUMBERS} of shape (n,), not of shape (1, 1).": lambda: checks.array("x", [[1]], ("n",)),
    f"x {NUMBERS} of shape (3,) or (n, 2), not of shape (2,).": lambda: checks.array(
        "x", [1, 2], (3,), ("n", 2)
    ),
    f"x {NUMBERS} of shape (), not <U4 of shape ().": lambda: checks.array("x", "word", ()),
    f"x {NUMBERS} of shape (n,), not complex128 of shape (1,).": lambda: checks.array(
        "x", [1j], ("n",)
    ),
    f"x {NUMBERS} of shape (n, n), not rows of unequal length.": lambda: checks.array(
        "x", [[1], [1, 2]], ("n", "n")
    ),
    f"x {NUMBERS} of shape (n,), not NaN or infinite.": lambda: checks.array("x", [NAN], ("n",)),
    f"x {NUMBERS} (or NaN where missing) of shape (n,), not infinite.": lambda: checks.array(
        "x", [NAN, INF], ("n",), gaps=True
    ),
    **{
        f"A must be non-empty and of shape (n, n), not of shape {np.shape(A)}.": (
            lambda A=A: checks.matrices(A=(A, "nn"))
        )
        for A in ([[1, 2]], np.ones((0, 0)))
    },
    f"B {NUMBERS} of shape (2, p), not of shape (3, 3).": lambda: checks.matrices(
        A=(np.eye(2), "nn"), B=(np.eye(3), "np")
    ),
    "P must be a covariance, not asymmetric.": lambda: checks.covariance(
        "P", [[1, 1], [0, 1]], (2, 2)
    ),
    "P must be a covariance, not one with a negative eigenvalue.": lambda: checks.covariance(
        "P", [[-1e-30]], (1, 1)
    ),
    "P must be positive definite, not singular.": lambda: checks.covariance(
        "P", [[0]], (1, 1), definite=True
    ),
    "lost must be booleans of shape (2,) or (n, 1), not int64 of shape (2,).": lambda: checks.mask(
        "lost", [0, 1], (2,), ("n", 1)
    ),
    "m must be booleans of shape (2,), not of shape (1,).": lambda: checks.mask("m", [True], (2,)),
    "x must be a number above 0, not 0.": lambda: checks.number("x", 0, above=0),
    "x must be a number of at least 0 and below 1, not 1.0.": lambda: checks.number(
        "x", 1.0, least=0, below=1
    ),
    "x must be a number of at least 0, not -1.": lambda: checks.number("x", -1, least=0),
    "x must be a number of at most 1, not 2.": lambda: checks.number("x", 2, most=1),
    "x must be a finite number, not nan.": lambda: checks.number("x", NAN),
    "x must be a finite number, not True.": lambda: checks.number("x", True),
    "x must be a finite number, not 1j.": lambda: checks.number("x", 1j),
    "x must be a finite number, not inf.": lambda: checks.number("x", float("inf")),
    f"x must be a finite number, not {str(10**400)[:200]}….": lambda: checks.number("x", 10**400),
    "n must be a whole number of at least 0, not 1.0.": lambda: checks.whole("n", 1.0),
    "n must be a whole number of at least 0, not True.": lambda: checks.whole("n", True),
    "n must be a whole number of at least 1, not 0.": lambda: checks.whole("n", 0, 1),
    "n must be a whole number between 1 and 8, not 9.": lambda: checks.whole("n", 9, 1, 8),
    'rule must be one of "a", "b", not \'c\'.': lambda: checks.one_of("rule", "c", ("a", "b")),
    'rule must be one of "a", "b", not 1.': lambda: checks.one_of("rule", 1, ("a", "b")),
}


@pytest.mark.parametrize("said", REFUSED)
def test_what_does_not_fit_is_refused(said: str) -> None:
    with pytest.raises(ParameterError) as raised:
        REFUSED[said]()
    assert str(raised.value) == said


def test_each_of_several_covariances_is_looked_at() -> None:
    with pytest.raises(ParameterError, match=r"P .* not one with a negative eigenvalue"):
        checks.covariance("P", [np.eye(2), -np.eye(2)], ("k", 2, 2))
    with pytest.raises(ParameterError, match="asymmetric"):  # by its own size
        checks.covariance("P", [1e12 * np.eye(2), [[1, 1e-3], [0, 1]]], ("k", 2, 2))


def test_what_fits_is_returned() -> None:
    assert checks.array("x", [[True, 2]], ("n", 2)).tolist() == [[1.0, 2.0]]
    assert np.isnan(checks.array("x", [NAN], ("n",), gaps=True)).all()
    assert checks.array("x", [1e308, 1e308], (2,)).tolist() == [1e308, 1e308]  # their sum is not
    assert [m.shape for m in checks.matrices(A=(np.eye(2), "nn"), B=(np.ones((2, 3)), "np"))] == [
        (2, 2), (2, 3),
    ]  # fmt: skip
    assert checks.number("x", np.float32(1), above=0, most=1) == 1.0
    assert checks.whole("n", np.int8(3), 3, 3) == 3
    assert checks.mask("lost", [[True]], ("n", 1)).tolist() == [[True]]
    checks.one_of("rule", "a", ("a", "b"))
    assert checks.covariance("P", [[2, 1], [1, 2]], (2, 2), definite=True).sum() == 6


@given(root=arrays(float, (3, 2), elements=st.floats(-1e6, 1e6, allow_subnormal=False)))
def test_a_square_is_a_covariance(root: np.ndarray) -> None:
    """Of rank 2 at most, so that one eigenvalue is zero up to rounding."""
    square = root @ root.T
    assert checks.covariance("P", square, (3, 3)) is not None
    with pytest.raises(ParameterError, match="singular"):
        checks.covariance("P", np.zeros((3, 3)), (3, 3), definite=True)
