"""Files of every kind, spoilt in one place: each is told with the file, and where it is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_folders import MADE

from inswsn_lib import logs
from inswsn_lib.errors import InswsnError

STAMP = "2025/08/28 17:30:40.500"
#: Kind, file, what is replaced (else all of it), by what, and what is said
SPOILT = [
    ("csv", "imu.csv", "force_z_mps2", "force_z", r"has no column force_z_mps2; it has time_s, "),
    ("csv", "imu.csv", "0.01,0.1", "0.01,much", r"has 'much' in column rate_x_radps, row 3; it mu"),
    ("csv", "imu.csv", "0.01,0.1", "0.01,", r"an empty cell is in column rate_x_radps, row 3; "),
    ("csv", "imu.csv", "0.01,0.1", "0.00,0.1", r"in time_s: the time stamp repeats in row 3;"),
    ("csv", "imu.csv", "0.01,0.1", "-1,0.1", r"in time_s: .* goes back by 1 s in row 3; time"),
    ("csv", "imu.csv", "0.01,0.1", ",0.1", r"an empty cell is in column time_s, row 3"),
    ("csv", "imu.csv", "0.01,0.1", "0.01,40", r"is 40 in row 3; it seems to be in degrees a secon"),
    ("csv", "imu.csv", "0.01,0.1", "0.01,0.1,1", r"has 8 cells in row 3; there must be 7"),
    ("csv", "imu.csv", "9.", "1000.", r"has a median size of 1001; it seems to be in mg or cm/s\^"),
    ("csv", "imu.csv", "9.9", "9e99", r"has '9e\+?99' in column force_z_mps2, row 3; it must be"),
    ("csv", "imu.csv", "0.01,0.1", "17e11,0.1", r"'17e11' in column time_s, .* in ms, of which th"),
    ("csv", "odometry.csv", "time_s,speed_mps", "time_ms,t_us", r"has the columns time_ms, t_us; "),
    ("csv", "odometry.csv", "0.2,1", "0.1,1", r"in time_s: the time stamp repeats in row 3"),
    ("csv", "odometry.csv", None, "time_s,speed_mps,rate_radps\n", r"it has a header and no rows"),
    ("csv", "ranges.csv", "007", "7", r"the anchor is '7' in row 3; it .* '007', 'A 1'\."),
    ("csv", "ranges.csv", "007", "", r"csv: an empty cell is in column anchor, row 3; .* a word, "),
    ("csv", "ranges.csv", "0.2", "0.0", r"in time_s: .* goes back by 0.1 s in row 4"),
    ("csv", "ranges.csv", "range_m", "range", r"has no column range_m"),
    ("csv", "anchors.csv", "007", "A 1", r"the anchor 'A 1' is there more than once\."),
    ("csv", "anchors.csv", "6", "", r"an empty cell is in column z_m, row 3"),
    ("csv", "fixes.csv", "vx_mps", "v", r"only vy_mps of the columns vx_mps, vy_mps; it must have"),
    ("csv", "fixes.csv", "vx_mps,vy_mps", "vz_mps,v", r"it has vz_mps without vx_mps, vy_mps"),
    ("csv", "fixes.csv", ",,,0", ",,,2", r"2 is in column good, row 3; it must be 0 or 1"),
    ("csv", "fixes.csv", ",,,0", ",,,", r"an empty cell is in column good, row 3"),
    ("csv", "reference.csv", "0,0,0,1", "0,0,1,1", r"the quaternion in row 2 is 1.41421 long; it "),
    ("csv", "reference.csv", "qw", "w", r"has only qx, qy, qz of the columns qx, qy, q"),
    ("csv", "reference.csv", "time_s", "time", r"has no column time_s; it has time, x_m"),
    ("csv", "recording.yaml", "name:", "nmae:", r"the key 'nmae' is not known; it must be one of "),
    ("csv", "recording.yaml", "a walk", "[1]", r"name must be text, not \[1\]\."),
    ("csv", "recording.yaml", "0.5, 1]", "0.5]", r"lever_arm_m must be finite numb"),
    ("csv", "recording.yaml", "0.5, 1]", "a, 1]", r"lever_arm_m must"),
    ("csv", "recording.yaml", "name: ", "- ", r"is not YAML: "),
    ("inrol", "anchor.txt", "2 -1.0", "7 -1.0", r"the anchor 7 is there more than once\."),
    ("inrol", "uwb.txt", "2 0.020 2", "2 0.020 9", r"the anchor is 9 in row 4; it .* 7, 2, 4\."),
    ("inrol", "uwb.txt", "3.5", "far", r"has 'far' in line 4; it must be a finite number"),
    ("inrol", "uwb.txt", "3.5", "inf", r"has 'inf' in line 4"),
    ("inrol", "uwb.txt", "3.5", "", r"has 3 cells in line 4; there must be 4\."),
    ("inrol", "imu.txt", "3 0.03", "3 0.02", r"Imu: the time stamp repeats in row 4;"),
    ("inrol", "imu_pose.txt", "0.016", "0.001", r"Reference: .* goes back by 0.007 s in"),
    ("inrol", "imu_pose.txt", "2 3 0 0", "2 3 0 1", r"the quaternion in row 4 is 1.41421"),
    ("inrol", "imu.txt", None, "# index timestamp\n\n", r"has no row of 8 numbers\."),
    ("labyrinth", "Some_Input.txt", "odom2diff 1", "odom3 1", r"Input.txt has 'odom3' in line 5; "),
    ("labyrinth", "Some_Input.txt", "range2 1.5 2", "range2 1.5 two",
     r"Input.txt has 'two' in line 2;"),
    ("labyrinth", "Some_Input.txt", "range2 1.5 2", "range2 1.5",
     r"Input.txt has 6 cells in line "),
    ("labyrinth", "Some_Input.txt", "0 0.1 1e-4", "0 0 1e-4", r"the distance of the wheels is 0; "),
    ("labyrinth", "Some_Input.txt", "odom2diff 1.5", "odom2diff 0.5",
     r"Input.txt: Odometry: the time "),
    ("labyrinth", "Some_Input.txt", "odom2diff", "range2", r"Input.txt has 8 cells in line 4; the"),
    ("labyrinth", "Some_GT.txt", "point2 2.5", "point2 1.5", r"GT.txt: Reference: the time stamp "),
    ("labyrinth", "Some_GT.txt", None, "", r"GT.txt has no row of 7 numbers\."),
    ("rtklib", "imu_1.csv", "2.0,-1.5,5030", "2.0,5030", r"has 6 cells in line 4; there must"),
    ("rtklib", "imu_1.csv", "-1.5,5030", "x,5030", r"has 'x' in line 4"),
    ("rtklib", "imu_1.csv", "5030", "5020", r"the device's time: the .* repeats in row 4"),
    ("rtklib", "imu_1.csv", "5030", "5015", r"the device's time: .* goes back by 0.005 s in"),
    ("rtklib", "gnss_1.pos", "40.500", "40", r"Fixes: the time stamp goes back by 0.25 s in"),
    ("rtklib", "gnss_1.pos", STAMP, "2381 608658.5", r"has '2381 608658.5' in line 4"),
    ("rtklib", "gnss_1.pos", STAMP, "2025/13/28 17:30:40.500", r"it must be a date an"),
    ("rtklib", "gnss_1.pos", "%  GPST", "%  UTC", r"has UTC in its head; it must be GPST\."),
    ("rtklib", "gnss_1.pos", "latitude(deg) longitude(deg) height", "x-ecef(m) y-ecef(m) z-ecef",
     r"has x-ecef\(m\), y-ecef\(m\), "),
    ("rtklib", "gnss_1.pos", "(deg)", "(d'\")", r"has latitude\(d'\"\), longitude\(d'\"\), height"),
    ("rtklib", "gnss_1.pos", " ratio", "", r"has 24 cells in line 2; there must be 23"),
    ("rtklib", "gnss_1.pos", "40.0000200 -1", "40:00:00.1 -1", r"has '40:00:00.1' in li"),
    ("rtklib", "imu_1.csv.tag", None, "TIME", r"it is not an RTKLIB time tag\."),
    ("rtklib", "imu_1.csv.tag", None, "TIMETAG RTKLIB".ljust(76, "\0"),
     r"tag: it ends before imu_1.csv "),
    ("rtklib", "imu_1.csv", None, "1\n0,0,1,0,0,0,5\n2\n", r"one row is too few"),
    ("rtklib", "imu_1.csv", None, "1\n" + 50 * "0,0,1,0,0,0,5\n", r"repeats|it ends before"),
    ("rtklib", "imu_1.csv", None, "1\n", r"has no row of 7 numbers\."),
    ("rtklib", "gnss_1.pos", None, "% nothing\n", r"has no row of 15 numbers\."),
    ("rtklib", "gnss_1.pos", None, "2025/08/28 17:30:40.000 40 -105\n",
     r"has 4 cells in line 1; there m"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "name", "old", "new", "said"), SPOILT)
def test_what_is_wrong_is_told_with_file_and_place(
    tmp_path: Path, kind: str, name: str, old: str | None, new: str, said: str
) -> None:
    MADE[kind](tmp_path)
    path = tmp_path / name
    if old is not None:
        text = path.read_text()
        assert old in text
        new = text.replace(old, new)
    path.write_bytes(new.encode())
    with pytest.raises(InswsnError, match=said) as error:
        logs.load(kind, tmp_path)
    assert str(error.value).startswith(str(path))
    assert str(error.value).endswith(".")
