"""What the page "Which filter?" answers of a file whose drift and noise are known."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inswsn_book.live.own_data import read
from inswsn_book.live.which_page import decide, fit, measured
from test_live_own_data import TEXT, lasting, looked_at_alone, table, wild, without

import inswsn_lib as iw
from inswsn_lib.errors import InswsnError


def decided(text: str) -> dict[str, Any]:
    return decide(text, {"name": "my.csv"})


def test_white_noise_takes_the_kalman_filter_whose_code_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The example is simulated with fixes of 0.2 m and 0.1 m/s, and an outage of 12 s."""
    found = decided(TEXT)
    said = " ".join(found["sentences"])
    assert "Take the Kalman filter; " in said
    assert "stop for longer than the INS holds: yes. The longest gap is 12 s" in said
    (line,) = (line for line in found["code"].splitlines() if "measurement_noise" in line)
    numbers = [float(x) for x in line[line.index("(") + 1 : -1].split(",")]
    assert numbers == pytest.approx([0.2, 0.1], rel=0.15)
    monkeypatch.chdir(tmp_path)
    Path("my.csv").write_text(TEXT, encoding="utf-8")
    exec(compile(found["code"], "pasted", "exec"), {})
    data = iw.read_recording(Path("my.csv"), resample=True)
    error = np.loadtxt("corrected.csv", delimiter=",") - data.reference
    fixed = np.isfinite(data.wsn[:, 0])
    far = np.hypot(*error[fixed][:, :2].T).mean()
    assert far < 0.8 * np.hypot(*(data.wsn - data.reference)[fixed][:, :2].T).mean()


@pytest.mark.parametrize(
    ("made", "taken", "code"),
    [
        (lasting, "errors that last", "with_coloured_noise(3"),
        (wild, "the H-infinity filter", "design_filter(model)"),
        (lambda: lasting(tau=0.0), "the Kalman filter;", "run_kalman(model"),
    ],
)
def test_each_answer_is_found_where_it_is_right(made: Any, taken: str, code: str) -> None:
    found = decided(made().to_csv(index=False))
    assert taken in found["sentences"][-1]
    # a drift that changes is as wild as is tried
    assert ("did not settle" in found["sentences"][-2]) == (made is wild)
    assert code in found["code"]
    compile(found["code"], "pasted", "exec")


def test_how_long_errors_last_is_searched_for() -> None:
    """Errors of 0.2 m last for 8 s, beside a drift that holds them for 3.9 s."""
    found, _ = fit(*measured(read("my.csv", lasting(tau=8.0).to_csv(index=False)))[:2])
    assert found.settled
    assert [found.lasts, found.noise[0], found.holds] == pytest.approx([8, 0.2, 3.9], rel=0.2)


def test_a_gap_at_the_end_is_no_half_and_no_fix() -> None:
    """Each half is of as many fixes, and what a filter leaves is told of a fix."""
    made = wild()
    made.loc[250:, list(iw.logs.WSN)] = np.nan
    said = decided(made.to_csv(index=False))["sentences"]
    assert len(re.findall(r" \d\d% of the error| \d\d% in velocity", said[1])) == 2


def test_both_ways_of_being_wrong_are_shown() -> None:
    found = decided(TEXT)
    small, right, large = (found["figure"]["numbers"][1]["values"][k] for k in (0, 3, 6))
    assert float(small) > 2 > float(right) > 0.8 > float(large)
    sizes = [float(text.split()[0]) for text in found["figure"]["numbers"][0]["values"]]
    assert min(sizes) == sizes[3]


def test_without_velocities_and_reference_it_answers_too() -> None:
    names = [*iw.logs.WSN[2:], *iw.logs.REFERENCE]
    found = decided(without(*names))
    assert "next fix" in found["figure"]["sentence"]["values"][0]
    assert "Take the Kalman filter; " in found["sentences"][-1]


def test_numpy_alone_answers_the_same() -> None:
    alone = looked_at_alone(TEXT, which=True, name="my.csv")
    assert alone["sentences"] == decided(TEXT)["sentences"]


def test_what_is_too_short_is_refused() -> None:
    with pytest.raises(InswsnError, match="Fewer than 60 fixes are too few"):
        decided(table()[:50].to_csv(index=False))
