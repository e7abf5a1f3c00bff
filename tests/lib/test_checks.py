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
REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "a shape": (lambda: checks.array("x", [[1]], ("n",)), "x is of shape (1, 1)"),
    "a size": (lambda: checks.array("x", [1, 2], (3,), ("n", 2)), "(3,) or (n, 2)"),
    "a text": (lambda: checks.array("x", "word", ()), "x is <U4 of shape ()"),
    "complex": (lambda: checks.array("x", [1j], ("n",)), "x is complex128"),
    "ragged": (lambda: checks.array("x", [[1], [1, 2]], ("n", "n")), "x is no array"),
    "a gap": (lambda: checks.array("x", [NAN], ("n",)), "x is not finite"),
    "infinite": (lambda: checks.array("x", [NAN, INF], ("n",), gaps=True), "x is infinite"),
    "not square": (lambda: checks.matrices(A=([[1, 2]], "nn")), "A is of shape (1, 2)"),
    "empty": (lambda: checks.matrices(A=(np.ones((0, 0)), "nn")), "A is of shape (0, 0)"),
    "another size": (
        lambda: checks.matrices(A=(np.eye(2), "nn"), B=(np.eye(3), "np")), "finite numbers (2, p)"
    ),
    "not symmetric": (lambda: checks.covariance("P", [[1, 1], [0, 1]], (2, 2)), "not symmetric"),
    "negative": (lambda: checks.covariance("P", [[-1e-30]], (1, 1)), "not positive semidefinite"),
    "singular": (lambda: checks.covariance("P", [[0]], (1, 1), definite=True), "P is singular"),
    "one of several": (
        lambda: checks.covariance("P", [np.eye(2), -np.eye(2)], ("k", 2, 2)), "semidefinite"
    ),
    "a number as bool": (lambda: checks.mask("lost", [0, 1], (2,)), "lost is int64"),
    "bools of a size": (lambda: checks.mask("lost", [True], (2,)), "lost is of shape (1,)"),
    "not above": (lambda: checks.number("x", 0, above=0), "x is 0; it may be a number, above 0."),
    "not below": (lambda: checks.number("x", 1.0, below=1), "below 1"),
    "too small": (lambda: checks.number("x", -1, least=0), "at least 0"),
    "too large": (lambda: checks.number("x", 2, most=1), "at most 1"),
    "NaN": (lambda: checks.number("x", NAN), "x is nan; it may be a finite number."),
    "no number": (lambda: checks.number("x", True), "x is True"),
    "no whole number": (lambda: checks.whole("n", 1.0), "n is 1.0; it may be a whole number, 0"),
    "a bool": (lambda: checks.whole("n", True), "n is True"),
    "too few": (lambda: checks.whole("n", 0, 1), "1 or more"),
    "too many": (lambda: checks.whole("n", 9, 1, 8), "from 1 to 8"),
    "no such name": (lambda: checks.one_of("rule", "c", ("a", "b")), 'one of "a", "b"'),
    "no text": (lambda: checks.one_of("rule", 1, ("a", "b")), "rule is 1"),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_what_does_not_fit_is_refused(kind: str) -> None:
    call, said = REFUSED[kind]
    with pytest.raises(ParameterError) as raised:
        call()
    assert said in str(raised.value)


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


@given(root=arrays(float, (3, 2), elements=st.floats(-1e6, 1e6, allow_subnormal=False)))
def test_a_square_is_a_covariance(root: np.ndarray) -> None:
    """Of rank 2 at most, so that one eigenvalue is zero up to rounding."""
    square = root @ root.T
    assert checks.covariance("P", square, (3, 3)) is not None
    with pytest.raises(ParameterError, match="singular"):
        checks.covariance("P", np.zeros((3, 3)), (3, 3), definite=True)
