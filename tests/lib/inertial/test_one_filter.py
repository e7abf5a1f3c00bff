"""The inertial filter against the two that it was made of, by their outputs on P3's drive."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from lib.inertial import two_filters
from scipy.spatial.transform import Rotation

from inswsn_lib.checks import Array
from inswsn_lib.inertial import InertialState, metres

CLOSE = 0.01  # of a standard deviation


@cache
def kept(name: str) -> dict[str, Array]:
    found = np.load(two_filters.KEPT)
    begin = f"{name}: "
    return {n.removeprefix(begin): found[n] for n in found.files if n.startswith(begin)}


def apart(found: dict[str, Array], old: dict[str, Array]) -> Array:
    """Return the largest difference at each epoch, in deviations, those of deviations in shares."""
    size, deviation = metres(old["position"]), old["deviation"]
    turned = found["attitude"] @ np.swapaxes(old["attitude"], -1, -2)
    turns = Rotation.from_matrix(turned.reshape(-1, 3, 3)).as_rotvec()
    parts = [
        (found["position"] - old["position"]) * size, found["velocity"] - old["velocity"],
        turns.reshape(size.shape), found["accelerometer_bias"] - old["accelerometer_bias"],
        found["gyro_drift"] - old["gyro_drift"], found["error"] - old["error"],
    ]  # fmt: skip
    first = (found["first"] - old["first"]) * size / deviation[..., :3]
    shares = np.concatenate(parts, axis=-1) / deviation, first, found["deviation"] / deviation - 1
    return np.abs(np.concatenate(shares, axis=-1)).max(axis=(1, 2))


@pytest.mark.parametrize("name", [name for name in two_filters.CASES if "open" not in name])
def test_on_the_round_earth_it_is_the_filter_of_the_car(name: str) -> None:
    assert apart(two_filters.on_the_round_earth(name), kept(name)).max() < CLOSE


@pytest.mark.parametrize("name", ["open", "extra, open"])
def test_in_open_loop_while_the_ins_is_not_far(name: str) -> None:
    """Within 200 m; after 160 s it is 3 km off, where what both leave out is no longer small."""
    assert apart(two_filters.on_the_round_earth(name), kept(name))[0] < CLOSE


@pytest.mark.parametrize("period", [0.02, 0.1])
def test_in_a_flat_frame_it_is_the_filter_of_logs(period: float) -> None:
    found, old = two_filters.in_a_flat_frame(period), kept(f"flat {period}")
    deviation = old["deviation"]
    for k in range(len(deviation)):
        one, other = (InertialState.of_row(x["row"][k]) for x in (found, old))
        assert np.abs(one.minus(other) / deviation[k]).max() < CLOSE
    assert found["deviation"] == pytest.approx(deviation, rel=CLOSE)
    assert np.abs((found["smoothed"] - old["smoothed"]) / deviation[:, :3]).max() < CLOSE
