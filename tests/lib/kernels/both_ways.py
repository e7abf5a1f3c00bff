"""Kernels compiled and in Python, for the tests of those who call them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from inswsn_lib.kernels import PLAIN


def both(call: Callable[[], Any]) -> tuple[Any, Any]:
    """Return what a call gives with compiled kernels, and what without."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(PLAIN, "0")
        compiled = call()
        patch.setenv(PLAIN, "1")
        return compiled, call()


@contextmanager
def unchanged(given: Any) -> Iterator[None]:
    """Hold that arrays are afterwards what they were."""
    before = [np.copy(each) for each in given]
    yield
    for one, other in zip(given, before, strict=True):
        np.testing.assert_array_equal(one, other)
