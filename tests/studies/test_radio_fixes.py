"""The study of fixes by radio: on a made recording with a known answer, and on the kept one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import radio_fixes as study
from made_folders import needs

from inswsn_lib.errors import InswsnError


def made(offset: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a recording of a tag at rest in a cube of anchors, each range too long by `offset`."""
    corners = np.array([[x, y, z] for x in (0.0, 4.0) for y in (0.0, 4.0) for z in (0.0, 4.0)])
    anchor = np.column_stack([np.arange(8), corners])
    body = np.array([1.0, 2.5, 1.2])
    # turned by half a turn about x, so that the lever of 1 cm points down
    pose = np.array([[t, *body, 1.0, 0.0, 0.0, 0.0] for t in (0.0, 2.0)])
    tag = body - [0, 0, 0.010]
    rows = [
        [i, t, k, np.linalg.norm(corners[k] - tag) + offset]
        for i, t in enumerate(np.arange(0.01, 1.99, 0.02))
        for k in range(8)
    ]
    return anchor, pose, np.array(rows)


def test_exact_ranges_give_exact_fixes() -> None:
    found = study.measure(*made(0.0))
    assert found["horizontal_rms"] == 0
    assert found["range_deviation"] == 0
    assert (found["anchors"], found["ranges"]) == (8, 99 * 8)
    assert found["fixes"] == found["intervals"] == 10


def test_an_offset_of_all_ranges_is_found_and_nearly_cancels_in_the_fix() -> None:
    found = study.measure(*made(0.3))
    assert found["range_median_error"] == pytest.approx(0.3)
    assert found["range_deviation"] == 0
    # the anchors surround the tag, so that a common offset pushes from all sides
    assert 0 < found["horizontal_rms"] < 0.3


def test_a_wrong_mirror_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INSWSN_DATA", str(tmp_path))
    with pytest.raises(InswsnError, match=r"anchor\.txt is not there, or is not the original"):
        study.recording()


@needs("inrol/1")
def test_the_kept_numbers_are_those_of_the_recording(root: Path) -> None:
    files = study.recording()
    kept = json.loads((root / "data/recorded/uwb-fixes.json").read_text(encoding="utf-8"))
    found = study.measure(*(files[name] for name in study.DIGESTS))
    series, again = kept.pop("horizontal_errors"), found.pop("horizontal_errors")
    assert {name: kept[name] for name in found} == pytest.approx(found, abs=2e-4)
    assert [e is None for e in series] == [e is None for e in again]
    np.testing.assert_allclose([e for e in series if e], [e for e in again if e], atol=1.1e-3)
