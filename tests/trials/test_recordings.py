"""Mistakes put into recordings that are right: what is refused, what is found, what is it called.

A recording is simulated by the filter's own model. A mistake that changes what the network says is
*detectable* if the change against the reference, over the noise of the network and freed of another
origin, is 8 long or more: a test that knew what to look for would then miss it once in ten thousand
times. What no reference shows, as a late network without one, may be unseen. Others are made large
enough to be seen by the eye: so many rows are changed. What is detectable may not fit.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from inswsn_book.live.own_page import look

from inswsn_lib import ErrorModel, InswsnError, design_kalman, read_recording, run_kalman
from inswsn_lib.logs import (
    INS,
    REFERENCE,
    TIME,
    WSN,
    check_recording,
    filter_checks as checks,
    verdict,
)

Random = np.random.Generator
DETECTABLE = 8.0
_TESTS = ("size", "colour", "whiteness")
CHANCE = 0.015  # of a finding on a recording that is right: 14 checks of a thousandth each


def turn(angle: float) -> np.ndarray:
    """Return the matrix that turns positions and velocities."""
    c, s = np.cos(angle), np.sin(angle)
    return np.kron(np.eye(2), [[c, -s], [s, c]])


EXCHANGE = np.kron(np.eye(2), [[0.0, 1.0], [1.0, 0.0]])
MIRROR = np.kron(np.eye(2), [[1.0, 0.0], [0.0, -1.0]])


@dataclass
class Walk:
    """A recording that is right, and the parts that it was made of."""

    rng: Random
    period: float = 0.2
    steps: int = 300
    noise: tuple[float, float] = (0.2, 0.1)
    acceleration: float = 0.05
    referenced: bool = True
    with_velocities: bool = True
    every: int = 1
    still: bool = False
    waves: np.ndarray = field(init=False)

    @classmethod
    def draw(cls, rng: Random) -> Walk:
        position = float(rng.uniform(0.05, 0.5))
        return cls(
            rng,
            period=float(rng.choice([0.1, 0.2, 0.5])),
            steps=int(rng.integers(300, 700)),
            noise=(position, position * float(rng.uniform(0.3, 1))),
            acceleration=float(rng.uniform(0.01, 0.1)),
            referenced=bool(rng.random() < 0.6),
            with_velocities=bool(rng.random() < 0.7),
            every=int(rng.choice([1, 1, 2, 5])),
        )

    def __post_init__(self) -> None:
        rng, T = self.rng, self.period
        # the way is a sum of slow turns, some m to each side
        span = self.steps * T
        self.waves = np.array(
            [(rng.uniform(4, 10) / (k + 1), 2 * np.pi * (k + rng.uniform(0.7, 1.3)) / min(span, 40),
              rng.uniform(0, 2 * np.pi)) for k in range(3) for _ in range(2)]
        )  # fmt: skip
        if self.still:
            self.waves[:, 0] = 0
        self.time = T * np.arange(self.steps)
        self.truth = self.at(self.time)
        wrong = self.acceleration * rng.standard_normal((self.steps - 1, 2))
        v = np.vstack([np.zeros(2), np.cumsum(wrong * T, axis=0)]) + 0.1 * rng.standard_normal(2)
        p = np.zeros((self.steps, 2)) + rng.standard_normal(2)
        p[1:] += np.cumsum(v[:-1] * T + wrong * T**2 / 2, axis=0)
        self.drift = np.hstack([p, v])
        self.fix_noise = np.repeat(self.noise, 2) * rng.standard_normal((self.steps, 4))
        self.heard = np.arange(self.steps) % self.every == 0
        begin = int(rng.integers(60, self.steps - 100))
        self.heard[begin : begin + int(rng.integers(0, 40))] = False
        self.ins, self.reference = self.truth + self.drift, self.truth.copy()
        self.wsn = self.truth + self.fix_noise

    def at(self, time: np.ndarray) -> np.ndarray:
        """Return the true position and velocity at times."""
        phase = self.waves[:, 1] * time[:, None] + self.waves[:, 2]
        p = self.waves[:, 0] * np.sin(phase)
        v = self.waves[:, 0] * self.waves[:, 1] * np.cos(phase)
        return np.column_stack(
            [p[:, ::2].sum(1), p[:, 1::2].sum(1), v[:, ::2].sum(1), v[:, 1::2].sum(1)]
        )

    def table(self) -> pd.DataFrame:
        """Return the columns of the file."""
        stamps = self.time + 0.01 * self.period * self.rng.standard_normal(self.steps)
        wsn = np.where(self.heard[:, None], self.wsn, np.nan)
        made = pd.DataFrame(np.column_stack([stamps, self.ins, wsn]), columns=[TIME, *INS, *WSN])
        if not self.with_velocities:
            made = made.drop(columns=[*WSN[2:]])
        if self.referenced:
            made[list(REFERENCE)] = self.reference
        return made.round(4) if np.abs(self.wsn).max() < 1e100 else made

    def model(self) -> ErrorModel:
        """Return the filter's model."""
        T, a = self.period, self.acceleration
        model = ErrorModel.p1(T, process_noise=(a * T**2 / 2, a * T), measurement_noise=self.noise)
        if self.with_velocities:
            return model
        return ErrorModel(A=model.A, B=model.B, C=model.C[:2], D=model.D[:2], period=T)

    def length(self, change: np.ndarray) -> float:
        """Return how long a change of the network is, by its noise, free of another origin."""
        m = 4 if self.with_velocities else 2
        change = np.clip(change, -1e9, 1e9)[self.heard, :m]
        change[:, :2] -= change[:, :2].mean(axis=0)
        return float(np.linalg.norm(change / np.repeat(self.noise, 2)[:m]))


#: What a mistake makes: the recording is changed in place, or its file is; and how it may be called
Mistake = Callable[[Walk, Random], tuple[str, ...]]
KINDS: dict[str, Mistake] = {}


def called(*names: str) -> Callable[[Callable[[Walk, Random], None]], None]:
    """Add a mistake, named by its function, with the names that a finding may have."""

    def add(change: Callable[[Walk, Random], None]) -> None:
        def mistake(walk: Walk, rng: Random) -> tuple[str, ...]:
            walk.referenced |= change.__name__.startswith("reference")
            change(walk, rng)
            return names

        KINDS[change.__name__] = mistake

    return add


def late(who: str, lag: Callable[[Walk, Random], np.ndarray | float], *names: str) -> None:
    """Add a mistake: a part of the recording is of an earlier time, by a lag (s)."""

    def mistake(walk: Walk, rng: Random) -> tuple[str, ...]:
        walk.referenced |= who == "reference"
        noise = {"wsn": walk.fix_noise, "ins": walk.drift, "reference": 0.0}[who]
        setattr(walk, who, walk.at(walk.time - lag(walk, rng)) + noise)
        return names

    KINDS[f"{who}_late_{len(KINDS)}"] = mistake


def either(rng: Random, least: float, most: float) -> float:
    """Draw a size of either sign."""
    return float(rng.choice([-1, 1]) * rng.uniform(least, most))


late("wsn", lambda _, rng: either(rng, 0.1, 3), "time")
late("wsn", lambda walk, rng: either(rng, 0.005, 0.05) * walk.time, "clock", "time")
late("wsn", lambda _, rng: rng.uniform(500, 3600), "run")
late("wsn", lambda walk, rng: np.where(walk.time > walk.time[-1] / 2, rng.uniform(1, 3), 0.0),
     "clock", "time", "outliers", "size", "colour", "whiteness", "run", "misfit")  # fmt: skip
late("ins", lambda _, rng: rng.uniform(0.2, 3), "time")
late("reference", lambda _, rng: either(rng, 0.2, 3), "time")


def turned(who: str, matrix: Callable[[Random], np.ndarray], *names: str) -> Mistake:
    def mistake(walk: Walk, rng: Random) -> tuple[str, ...]:
        walk.referenced |= who == "reference"
        setattr(walk, who, getattr(walk, who) @ matrix(rng).T)
        return names

    return mistake


FRAMES: dict[str, tuple[Callable[[Random], np.ndarray], str]] = {
    "turned": (lambda rng: turn(either(rng, 0.05, 1.5)), "frame"),
    "turned_by_90": (lambda rng: turn(rng.choice([-1, 1]) * np.pi / 2), "frame"),
    "turned_by_180": (lambda rng: turn(np.pi), "frame"),
    "mirrored": (lambda rng: MIRROR * rng.choice([-1, 1]), "axes"),
    "exchanged": (lambda rng: EXCHANGE, "axes"),
    "in_another_unit": (
        lambda rng: rng.choice([3.2808, 1.0936, 100.0, 1000.0, 0.001]) * np.eye(4), "scale"
    ),
    "scaled": (
        lambda rng: rng.choice([rng.uniform(1.05, 1.5), rng.uniform(0.6, 0.95)]) * np.eye(4),
        "scale",
    ),
}  # fmt: skip
for who in ("wsn", "ins", "reference"):
    for what, (matrix, name) in FRAMES.items():
        KINDS[f"{who}_{what}"] = turned(who, matrix, name)


def stretch(walk: Walk, rng: Random, rows: int = 40) -> slice:
    begin = int(rng.integers(20, walk.steps - rows - 20))
    return slice(begin, begin + rows)


def smoothed(noise: np.ndarray, fixes: int) -> np.ndarray:
    return np.column_stack([np.convolve(x, np.ones(fixes) / fixes, "same") for x in noise.T])


# The network's ------------------------------------------------------------------------------------


@called("origin", "start")
def network_of_another_origin(walk: Walk, rng: Random) -> None:
    walk.wsn[:, :2] += rng.uniform(20, 500) * np.array([1, -1])


@called("outliers", "origin", "run")
def network_jumps_to_another_origin(walk: Walk, rng: Random) -> None:
    walk.wsn[walk.steps // 2 :, :2] += rng.uniform(20, 100)


@called("axes", "frame", "run")
def network_velocities_turned(walk: Walk, rng: Random) -> None:
    walk.with_velocities = True
    axes = EXCHANGE if rng.random() < 0.5 else turn(rng.uniform(0.5, 1.5))
    walk.wsn[:, 2:] = walk.wsn[:, 2:] @ axes[2:, 2:].T


@called("repeats")
def network_stuck(walk: Walk, rng: Random) -> None:
    part = stretch(walk, rng, 60)
    walk.wsn[part] = walk.wsn[part.start]


@called("repeats")
def network_held(walk: Walk, rng: Random) -> None:
    every = int(rng.integers(2, 10)) * walk.every
    walk.wsn = walk.wsn[np.arange(walk.steps) // every * every]
    walk.heard[:] = True


@called("repeats", "colour", "whiteness", "size", "copy")
def network_interpolated(walk: Walk, rng: Random) -> None:
    every, rows = int(rng.integers(3, 10)), np.arange(walk.steps)
    walk.wsn = np.column_stack([np.interp(rows, rows[::every], x[::every]) for x in walk.wsn.T])
    walk.heard[:] = True


@called("colour", "whiteness", "size")
def network_smoothed(walk: Walk, rng: Random) -> None:
    walk.wsn = walk.truth + smoothed(walk.fix_noise, 5)
    walk.heard[:] = True


@called("repeats")
def network_filled(walk: Walk, rng: Random) -> None:
    walk.wsn[stretch(walk, rng)] = rng.choice([0.0, -9999.0])
    walk.heard[:] = True


@called("repeats")
def network_clipped(walk: Walk, rng: Random) -> None:
    walk.wsn[:, 0] = np.minimum(walk.wsn[:, 0], np.quantile(walk.wsn[walk.heard, 0], 0.8))


@called("outliers")
def network_spikes(walk: Walk, rng: Random) -> None:
    rows = rng.choice(np.flatnonzero(walk.heard)[3:], 5, replace=False)
    walk.wsn[rows, :2] += rng.choice([-1, 1], (5, 2)) * rng.uniform(10, 100) * walk.noise[0]


@called("outliers")
def network_1e200(walk: Walk, rng: Random) -> None:
    walk.wsn[int(rng.choice(np.flatnonzero(walk.heard))), 0] = 1e200


@called("run", "size", "outliers", "noise")
def network_in_another_order(walk: Walk, rng: Random) -> None:
    backwards = np.arange(walk.steps)[::-1]
    walk.wsn = walk.wsn[backwards if rng.random() < 0.5 else rng.permutation(walk.steps)]


@called("size")
def network_noise_of_another_size(walk: Walk, rng: Random) -> None:
    factor = rng.choice([rng.uniform(1.7, 4), rng.uniform(0.2, 0.55)])
    walk.wsn = walk.truth + factor * walk.fix_noise


@called("colour", "whiteness", "size")
def network_noise_with_memory(walk: Walk, rng: Random) -> None:
    e, share = walk.fix_noise, rng.uniform(0.6, 0.9)
    for k in range(1, walk.steps):
        e[k] = share * e[k - 1] + np.sqrt(1 - share**2) * e[k]
    walk.wsn, walk.every, walk.heard[:] = walk.truth + e, 1, True


# The INS's ----------------------------------------------------------------------------------------


@called("itself")
def ins_velocities_of_other_axes_or_in_kmh(walk: Walk, rng: Random) -> None:
    walk.ins[:, 2:] = walk.ins[:, [3, 2]] if rng.random() < 0.5 else 3.6 * walk.ins[:, 2:]


@called("itself")
def ins_stuck(walk: Walk, rng: Random) -> None:
    part = stretch(walk, rng, 60)
    columns = slice(None, rng.choice([2, 4]))
    walk.ins[part, columns] = walk.ins[part.start, columns]


@called("itself")
def ins_set_back(walk: Walk, rng: Random) -> None:
    for row in rng.choice(np.arange(30, walk.steps - 30), 4, replace=False):
        walk.ins[row:, :2] += rng.uniform(5, 20, 2)


@called("size", "itself")
def ins_already_corrected(walk: Walk, rng: Random) -> None:
    walk.ins = walk.wsn.copy()
    walk.heard[:] = True


# The reference's ----------------------------------------------------------------------------------


@called("origin")
def reference_of_another_origin(walk: Walk, rng: Random) -> None:
    walk.reference[:, :2] += rng.uniform(0.5, 50) * np.array([1, -1])


@called("copy")
def reference_is_the_network(walk: Walk, rng: Random) -> None:
    walk.with_velocities = True
    walk.reference = walk.wsn.copy()


@called("copy")
def reference_is_the_network_smoothed(walk: Walk, rng: Random) -> None:
    walk.heard[:] = True
    walk.reference = walk.truth + smoothed(walk.fix_noise, 3)


@called("noise")
def reference_as_noisy_as_the_network(walk: Walk, rng: Random) -> None:
    walk.heard[:] = True
    walk.reference = walk.truth + np.repeat(walk.noise, 2) * rng.standard_normal((walk.steps, 4))


@called("run")
def reference_of_another_run(walk: Walk, rng: Random) -> None:
    walk.reference = Walk(rng, walk.period, walk.steps).truth


@called("itself", "time", "noise", "run")
def reference_held(walk: Walk, rng: Random) -> None:
    every = max(2, round(rng.uniform(1, 3) / walk.period))
    walk.reference = walk.truth[np.arange(walk.steps) // every * every]


@called("origin", "noise", "frame", "time", "scale", "clock", "axes", "run")
def reference_is_the_ins(walk: Walk, rng: Random) -> None:
    walk.acceleration = max(walk.acceleration, 0.05)
    walk.reference = walk.ins.copy()


def text(made: pd.DataFrame) -> str:
    return str(made.to_csv(index=False))


def findings(walk: Walk, written: str, path: Path) -> list[str]:
    """Return the names of what is found in a file, the first telling most; refused, if it is."""
    path.write_text(written, encoding="utf-8")
    try:
        data = read_recording(path)
    except InswsnError as error:
        return ["refused"] if "\n" not in str(error) else ["not one sentence"]
    P0 = np.diag([1.0, 1.0, 0.01, 0.01])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = check_recording(data, walk.model(), initial_covariance=P0)
    assert verdict(found).startswith("Recording and figures do not") == any(
        each.fits is False for each in found
    )
    return [each.name for each in found if each.fits is False]


def of_values(what: str, walk: Walk, rng: Random, path: Path) -> str:
    """Return what comes of a mistake of the values."""
    to_reference = walk.wsn - walk.reference
    expected = KINDS[what](walk, rng)
    change = walk.wsn - walk.reference - to_reference
    found = findings(walk, text(walk.table()), path)
    if found[:1] == ["refused"]:
        return "refused"
    alike = {"time", "clock", "frame", "axes", "scale", "run"} & set(expected)
    if alike and not (walk.referenced and np.any(change)):
        return f"{'noticed' if found else 'unseen'} without a reference that shows it"
    if found:
        named = found[0] in expected or found[0].split(" ")[0] in expected
        return "named" if named else f"named otherwise: {what} {found[0]}"
    length = walk.length(change)
    return "too small to tell" if alike and length < DETECTABLE else f"silent: {what} {length:.3g}"


def test_recordings(
    size: Callable[[int, int], int], seed: int, tell: Callable[[str], None], tmp_path: Path
) -> None:
    rng, path = np.random.default_rng(seed), tmp_path / "my.csv"
    count, right = size(15, 500), size(6, 500)
    names = [*KINDS]
    order = [names[i % len(names)] for i in rng.permutation(len(names) * (1 + count // len(names)))]
    came = []
    for what in order[:count]:
        came.append(of_values(what, Walk.draw(rng), rng, path))
    alarms = [walk for walk in (Walk.draw(rng) for _ in range(right))
              if findings(walk, text(walk.table()), path)]  # fmt: skip
    counts = Counter(each.partition(":")[0] for each in came)
    told = ", ".join(f"{number} {each}" for each, number in sorted(counts.items()))
    tell(
        f"{count} mistakes of {len(names)} kinds: {told}; {len(alarms)} of {right} right ones fail"
    )
    print(*Counter(each for each in came if ":" in each).items(), sep="\n")
    assert not any(each.startswith(("silent", "not one")) for each in came)
    assert counts["named otherwise"] <= 0.1 * count
    assert len(alarms) <= CHANCE * right + 4 * np.sqrt(CHANCE * right)


def test_page_chapter_and_checks_say_the_same(
    size: Callable[[int, int], int], seed: int, root: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """Of recordings whose noise is as the filter takes it, and of others."""
    rng, path, verdicts = np.random.default_rng(seed), tmp_path / "my.csv", Counter[str]()
    chapter = (root / "chapters" / "your-own-data.md").read_text(encoding="utf-8")
    cells = re.findall(r"```{code-cell} ipython3\n([^:`].*?)```", chapter, re.DOTALL)
    wanted = ("model = ", "predicted = ")
    code = "\n".join(cell for start in wanted for cell in cells if cell.startswith(start))
    for _ in range(size(20, 200)):
        walk = Walk.draw(rng)
        factors = rng.choice([0.8, 1.0, 1.0, 1.25], size=2)
        figures = {
            "wsn_position_noise": walk.noise[0] * factors[0],
            "wsn_velocity_noise": walk.noise[1] * factors[0],
            "acceleration_noise": walk.acceleration * factors[1],
            "initial_position_error": 1.0, "initial_velocity_error": 0.1,
        }  # fmt: skip
        path.write_text(text(walk.table()), encoding="utf-8")
        data = read_recording(path, resample=True)
        names = figures | vars(checks) | {"data": data, "np": np, "ErrorModel": ErrorModel}
        names |= {"run_kalman": run_kalman, "design_kalman": design_kalman}
        exec(code, names)  # cells of this project
        checked = check_recording(data, names["model"], initial_covariance=names["initial"])
        of_filter = [each for each in checked if each.subject == "innovations"]
        in_order = sorted(of_filter, key=lambda each: _TESTS.index(each.name))
        assert len(in_order) == 3
        assert in_order == names["noise"]
        printed = capsys.readouterr().out
        assert all(each.says in printed for each in in_order)
        told = f"The verdict on the noise figures: {checks.say_noise(in_order)}."
        assert told in look(path.read_text(encoding="utf-8"), figures)["sentences"]
        verdicts[told] += 1
    assert len(verdicts) > 3
