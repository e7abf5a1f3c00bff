"""Fix a tag from recorded ranges of ultra-wideband radio and keep how good that is: `make studies`.

Evidence p1-training puts the errors of these fixes, in their order, into P1's scene, and
shows how accurate radio can be. A tag was carried by hand among eight surveyed anchors in a room,
and motion capture tells where it was. Each fix uses the ranges of one interval of 0.2 s alone, P1's
period: least squares in three dimensions from the middle of the anchors, nothing filtered and
nothing rejected.

The recording is fetched, or comes from the mirror that INSWSN_DATA names; it is not kept here.
"""

from __future__ import annotations

import datetime
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pooch
from inswsn_book.record.files import file_digest, write_whole
from inswsn_book.record.provenance import repository_state
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from inswsn_lib.errors import InswsnError
from inswsn_lib.files import DATA_VARIABLE

ROOT = Path(__file__).parent.parent
OWNER, NAME = "INRoL", "inrol_uwb_localization"
COMMIT = "40562b6fee3c72920b6f6972524990612a7f58b9"
FOLDER = "example/filtering_state_estimation1/parsed_dataset"
DIGESTS = {
    "anchor.txt": "0dfac95032f40fc66835c7b483df773693c3b992ee81401bba00bb8d8d3aad54",
    "imu_pose.txt": "58b123ccf5a46b140c3e8b2d30b4d1210ad52ff0f7b8deb8c1398b14418330e4",
    "uwb.txt": "25ffd69f5c330ef5b619941e338f8f46bc83e146923a9ce368db798b3d36030c",
}
INTERVAL = 0.2  # s
LEVER = np.array([0.0, 0.0, 0.010])  # m, from the tracked body to the tag, in the body's axes

Array = NDArray[np.float64]


def recording() -> dict[str, Array]:
    """Return the columns of the three files; m, s."""
    mirror = os.environ.get(DATA_VARIABLE)
    if mirror:
        folder = Path(mirror) / f"{OWNER}__{NAME}" / COMMIT / FOLDER
        paths = {name: folder / name for name in DIGESTS}
    else:
        store = pooch.create(
            path=pooch.os_cache("inswsn") / f"{OWNER}__{NAME}" / COMMIT / FOLDER,
            base_url=f"https://raw.githubusercontent.com/{OWNER}/{NAME}/{COMMIT}/{FOLDER}/",
            registry={name: f"sha256:{digest}" for name, digest in DIGESTS.items()},
        )
        paths = {name: Path(store.fetch(name)) for name in DIGESTS}
    for name, path in paths.items():
        if not path.is_file() or file_digest(path) != DIGESTS[name]:
            raise InswsnError(f"{path} is not there, or is not the original {name}.")
    return {name: np.loadtxt(path) for name, path in paths.items()}


def tag_positions(pose: Array, times: Array) -> Array:
    """Return where the tag was, (times, 3), by interpolation of the motion capture."""
    turned = Rotation.from_quat(pose[:, 4:8]).apply(LEVER)
    track = pose[:, 1:4] + turned
    return np.column_stack([np.interp(times, pose[:, 0], track[:, i]) for i in range(3)])


def fix(anchors: Array, ranges: Array, start: Array) -> Array:
    """Return the position that fits the ranges best, m."""

    def residual(position: Array) -> Array:
        return np.asarray(np.linalg.norm(anchors - position, axis=1) - ranges)

    return np.asarray(least_squares(residual, start).x)


def measure(anchor: Array, pose: Array, uwb: Array) -> dict[str, Any]:
    """Return how good ranges and fixes are, by name, and the horizontal errors in their order.

    Parameters
    ----------
    anchor, pose, uwb : ndarray
        The columns of the three files: number and position (m); time (s), position (m) and
        attitude (quaternion); row, time (s), anchor and range (m).
    """
    anchors = {int(row[0]): row[1:4] for row in anchor}
    uwb = uwb[(uwb[:, 1] >= pose[0, 0]) & (uwb[:, 1] <= pose[-1, 0])]
    nodes = np.array([anchors[int(i)] for i in uwb[:, 2]])
    truth = tag_positions(pose, uwb[:, 1])
    range_error = uwb[:, 3] - np.linalg.norm(nodes - truth, axis=1)
    middle = np.mean(list(anchors.values()), axis=0)
    epoch = np.floor((uwb[:, 1] - uwb[0, 1]) / INTERVAL).astype(int)
    errors = []
    series = np.full((epoch[-1] + 1, 2), np.nan)
    for k in np.unique(epoch):
        rows = epoch == k
        if len(set(uwb[rows, 2])) < 4:  # fewer anchors do not fix three coordinates
            continue
        errors.append(fix(nodes[rows], uwb[rows, 3], middle) - truth[rows].mean(axis=0))
        series[k] = errors[-1][:2]
    horizontal = np.hypot(*np.array(errors)[:, :2].T)
    median = np.median(range_error)
    found = {
        "anchors": len(anchors),
        "ranges": len(uwb),
        "seconds": np.ptp(uwb[:, 1]),
        "range_median_error": median,
        # of a normal distribution with the same median absolute deviation
        "range_deviation": 1.4826 * np.median(np.abs(range_error - median)),
        "range_beyond_half_metre": np.mean(np.abs(range_error) > 0.5),
        "intervals": len(np.unique(epoch)),
        "fixes": len(errors),
        "horizontal_rms": np.sqrt(np.mean(horizontal**2)),
        "horizontal_median": np.median(horizontal),
        "horizontal_95": np.quantile(horizontal, 0.95),
    }
    rounded = {name: round(float(value), 4) for name, value in found.items()}
    # to the millimetre; an interval without a fix has none
    errors_kept = [None if np.isnan(e).any() else [round(float(v), 3) for v in e] for e in series]
    return rounded | {"horizontal_errors": errors_kept}


def main() -> None:
    """Fix, compare and write."""
    files = recording()
    commit, clean = repository_state(ROOT)
    facts = {
        "made": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "commit": commit,
        "clean": clean,
        "source": f"{OWNER}/{NAME} at {COMMIT}, {FOLDER}",
        "digests": DIGESTS,
        "interval": INTERVAL,
    }
    kept = {"form": 1, "facts": facts} | measure(*(files[name] for name in DIGESTS))
    text = json.dumps(kept, indent=1)
    # a pair a line
    text = re.sub(r"\[\s+(-?[\d.]+),\s+(-?[\d.]+)\s+\]", r"[\1, \2]", text)
    write_whole(ROOT / "data/recorded/uwb-fixes.json", text + "\n")


if __name__ == "__main__":
    main()
