"""The study of fixes by radio: on a made recording with a known answer, and on the kept one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import radio_fixes as study
from made_folders import needs

from inswsn_lib import logs
from inswsn_lib.streams import Ranges, Recording, Reference


def made(offset: float) -> Recording:
    """Return a recording of a tag at rest in a cube of anchors, each range too long by `offset`."""
    corners = np.array([[x, y, z] for x in (0.0, 4.0) for y in (0.0, 4.0) for z in (0.0, 4.0)])
    body = np.array([1.0, 2.5, 1.2])
    # turned by half a turn about x, so that the lever of 1 cm points down
    pose = Reference(np.array([0.0, 2.0]), np.tile(body, (2, 1)), np.tile([1.0, 0, 0, 0], (2, 1)))
    time, anchor = np.repeat(np.arange(0.01, 1.99, 0.02), 8), np.tile(np.arange(8), 99)
    distance = np.linalg.norm(corners[anchor] - (body - [0, 0, 0.010]), axis=1) + offset
    ranges = Ranges(time, anchor, distance, corners, tuple("abcdefgh"))
    return Recording("cube", ranges=ranges, reference=pose, lever_arm=np.array([0, 0, 0.010]))


def test_exact_ranges_give_exact_fixes() -> None:
    found = study.measure(made(0.0))
    assert found["horizontal_rms"] == 0
    assert found["range_deviation"] == 0
    assert (found["anchors"], found["ranges"]) == (8, 99 * 8)
    assert found["fixes"] == found["intervals"] == 10


def test_an_offset_of_all_ranges_is_found_and_nearly_cancels_in_the_fix() -> None:
    found = study.measure(made(0.3))
    assert found["range_median_error"] == pytest.approx(0.3)
    assert found["range_deviation"] == 0
    # the anchors surround the tag, so that a common offset pushes from all sides
    assert 0 < found["horizontal_rms"] < 0.3


@needs("inrol/1")
def test_the_kept_numbers_are_those_of_the_recording(root: Path) -> None:
    kept = json.loads((root / "data/recorded/uwb-fixes.json").read_text(encoding="utf-8"))
    found = study.measure(logs.load(study.NAME))
    series, again = kept.pop("horizontal_errors"), found.pop("horizontal_errors")
    assert {name: kept[name] for name in found} == pytest.approx(found, abs=2e-4)
    assert [e is None for e in series] == [e is None for e in again]
    np.testing.assert_allclose([e for e in series if e], [e for e in again if e], atol=1.1e-3)
