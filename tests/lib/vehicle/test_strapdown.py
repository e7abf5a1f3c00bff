"""What the filter integrates against pyins' public class, and corrections against known errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from inswsn_lib.vehicle import VehicleState


def state(position: np.ndarray, velocity: np.ndarray, attitude: np.ndarray) -> VehicleState:
    """Return what one run knows, or several."""
    lead = position.shape[:-1]
    return VehicleState(
        position, velocity, attitude, np.zeros((*lead, 3)), np.zeros((*lead, 3)),
        np.zeros((*lead, 15)), np.zeros((*lead, 15, 15)),
    )  # fmt: skip


@given(st.integers(0, 2**32 - 1), st.integers(0, 2))
def test_a_known_error_is_undone(seed: int, extra: int) -> None:
    """INS that is wrong by a known error, corrected by it, is the truth again, not only nearly.

    C' = (I - [phi x]) C: the attitude error turns the true frame into the computed one.
    """
    rng = np.random.default_rng(seed)
    true = state(
        *rng.normal(size=(2, 2, 4, 3)), Rotation.random(8, rng=rng).as_matrix().reshape(2, 4, 3, 3)
    )
    x = rng.normal(size=(2, 4, 15 + extra)) * 0.3
    turned = Rotation.from_rotvec(-x[..., 6:9].reshape(-1, 3)).as_matrix().reshape(2, 4, 3, 3)
    bias, drift = rng.normal(size=(2, 2, 4, 3))
    wrong = VehicleState(
        true.position + x[..., 0:3], true.velocity + x[..., 3:6], turned @ true.attitude,
        bias - x[..., 9:12], drift - x[..., 12:15],  # what of the bias is not yet taken off
        x, rng.normal(size=(2, 4, 15 + extra, 15 + extra)),
    )  # fmt: skip
    kept, found = x.copy(), wrong.corrected()
    right = replace(true, accelerometer_bias=bias, gyro_drift=drift)
    for name in ("position", "velocity", "attitude", "accelerometer_bias", "gyro_drift"):
        assert getattr(found, name) == pytest.approx(getattr(right, name))
    assert not found.error[..., :15].any()
    assert np.array_equal(found.error[..., 15:], x[..., 15:])  # of other states it stays
    assert np.array_equal(found.covariance, wrong.covariance)
    assert np.array_equal(wrong.error, kept)  # and the old state is as it was
