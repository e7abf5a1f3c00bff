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
REFUSED: dict[str, Callable[[], Any]] = {
    "x is of shape (1, 1); it may be finite numbers (n,).": lambda: checks.array(
        "x", [[1]], ("n",)
    ),
    "x is of shape (2,); it may be finite numbers (3,) or (n, 2).": lambda: checks.array(
        "x", [1, 2], (3,), ("n", 2)
    ),
    "x is <U4 of shape (); it may be finite numbers ().": lambda: checks.array("x", "word", ()),
    "x is complex128 of shape (1,); it may be finite numbers (n,).": lambda: checks.array(
        "x", [1j], ("n",)
    ),
    "x is no array; it may be finite numbers (n, n).": lambda: checks.array(
        "x", [[1], [1, 2]], ("n", "n")
    ),
    "x is not finite; it may be finite numbers (n,).": lambda: checks.array("x", [NAN], ("n",)),
    "x is infinite; it may be finite numbers (n,), NaN where missing.": lambda: checks.array(
        "x", [NAN, INF], ("n",), gaps=True
    ),
    "A is of shape (1, 2); it may be (n, n).": lambda: checks.matrices(A=([[1, 2]], "nn")),
    "A is of shape (0, 0); it may be (n, n).": lambda: checks.matrices(A=(np.ones((0, 0)), "nn")),
    "B is of shape (3, 3); it may be finite numbers (2, p).": lambda: checks.matrices(
        A=(np.eye(2), "nn"), B=(np.eye(3), "np")
    ),
    "P is not symmetric; it may be a covariance.": lambda: checks.covariance(
        "P", [[1, 1], [0, 1]], (2, 2)
    ),
    "P is not positive semidefinite; it may be a covariance.": lambda: checks.covariance(
        "P", [[-1e-30]], (1, 1)
    ),
    "P is singular; it may be positive definite.": lambda: checks.covariance(
        "P", [[0]], (1, 1), definite=True
    ),
    "lost is int64 of shape (2,); it may be bools (2,) or (n, 1).": lambda: checks.mask(
        "lost", [0, 1], (2,), ("n", 1)
    ),
    "lost is of shape (1,); it may be bools (2,).": lambda: checks.mask("lost", [True], (2,)),
    "x is 0; it may be a number above 0.": lambda: checks.number("x", 0, above=0),
    "x is 1.0; it may be a number at least 0, below 1.": lambda: checks.number(
        "x", 1.0, least=0, below=1
    ),
    "x is -1; it may be a number at least 0.": lambda: checks.number("x", -1, least=0),
    "x is 2; it may be a number at most 1.": lambda: checks.number("x", 2, most=1),
    "x is nan; it may be a finite number.": lambda: checks.number("x", NAN),
    "x is True; it may be a finite number.": lambda: checks.number("x", True),
    "x is 1j; it may be a finite number.": lambda: checks.number("x", 1j),
    "x is inf; it may be a finite number.": lambda: checks.number("x", float("inf")),
    f"x is {str(10**400)[:200]}…; it may be a finite number.": lambda: checks.number("x", 10**400),
    "n is 1.0; it may be a whole number, 0 or more.": lambda: checks.whole("n", 1.0),
    "n is True; it may be a whole number, 0 or more.": lambda: checks.whole("n", True),
    "n is 0; it may be a whole number, 1 or more.": lambda: checks.whole("n", 0, 1),
    "n is 9; it may be a whole number, from 1 to 8.": lambda: checks.whole("n", 9, 1, 8),
    'rule is \'c\'; it may be one of "a", "b".': lambda: checks.one_of("rule", "c", ("a", "b")),
    'rule is 1; it may be one of "a", "b".': lambda: checks.one_of("rule", 1, ("a", "b")),
}


@pytest.mark.parametrize("said", REFUSED)
def test_what_does_not_fit_is_refused(said: str) -> None:
    with pytest.raises(ParameterError) as raised:
        REFUSED[said]()
    assert str(raised.value) == said


def test_each_of_several_covariances_is_looked_at() -> None:
    with pytest.raises(ParameterError, match="P is not positive semidefinite"):
        checks.covariance("P", [np.eye(2), -np.eye(2)], ("k", 2, 2))
    with pytest.raises(ParameterError, match="not symmetric"):  # by its own size
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
